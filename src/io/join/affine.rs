//! Affine maps by columns, as glTF and 3D Tiles write them.

/// The map that changes nothing.
pub(super) const NONE: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

/// Turns x upwards into z upwards.
pub(super) const X_TO_Z: [f64; 16] =
    [0., 0., 1., 0., 0., 1., 0., 0., -1., 0., 0., 0., 0., 0., 0., 1.];

/// The map of what lies in a frame that lies in another one.
pub(super) fn inside(inner: &[f64; 16], outer: &[f64; 16]) -> [f64; 16] {
    std::array::from_fn(|i| {
        let (column, row) = (i / 4, i % 4);
        (0..4).map(|k| outer[4 * k + row] * inner[4 * column + k]).sum()
    })
}

/// Returns whether all numbers are finite, and the last row is that of an affine map.
pub(super) fn is_finite(map: &[f64; 16]) -> bool {
    map.iter().all(|x| x.is_finite()) && [map[3], map[7], map[11], map[15]] == [0.0, 0.0, 0.0, 1.0]
}

/// A shift.
pub(super) fn shift([x, y, z]: [f64; 3]) -> [f64; 16] {
    [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, y, z, 1.]
}
