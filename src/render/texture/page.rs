//! Colours of a mesh's corners out of the one image that lies on it, without a cache.
//!
//! For meshes that are put together from pieces with an image each (`pipeline/extract`). Several images and several
//! materials are in `lights`.

use super::images::Decoded;
use super::light_table::{Light, LightTable};
use super::lights::times_opacity;
use super::map_use::MapUse;
use super::palette::image_bytes;

/// Bytes that an image of `size` takes while colours are looked up in it: as its decoder leaves it, and with halves.
pub fn corner_bytes(size: [u32; 2]) -> u64 {
    2 * image_bytes(size)
}

/// Length in texture coordinates from a corner halfway to the next ones: the part of an image that its colour stands for.
pub fn apart(uv: [[f32; 2]; 3], corner: usize) -> f64 {
    let to = |other: usize| {
        let [u, v] = [0, 1].map(|k| f64::from(uv[other][k] - uv[corner][k]));
        u.hypot(v)
    };
    0.25 * (to((corner + 1) % 3) + to((corner + 2) % 3))
}

/// Adds to each vertex what its corners show, multiplied by opacity: the part of the image that reaches halfway along the
/// edges of each triangle.
///
/// `corner` gives a vertex's place in the image, from 0 to 1, from the upper left corner; triangles without an area in the
/// image do not count. The error says in words why the image cannot be decoded.
pub fn add_corners(
    (image, size): (&[u8], [u32; 2]),
    factor: [f32; 4],
    triangles: &[[u32; 3]],
    corner: impl Fn(u32) -> [f32; 2],
    sums: &mut [Light],
) -> Result<(), String> {
    let table = LightTable::new();
    let decoded = Decoded::of_bytes(image, size)?;
    let map = MapUse::whole(size);
    let factor = times_opacity(factor);
    for t in triangles {
        let uv = t.map(&corner).map(|[u, v]| [u, 1.0 - v]);
        let [a, b] = [1, 2].map(|k: usize| [0, 1].map(|i| uv[k][i] - uv[0][i]));
        let has_area = a[0] * b[1] != a[1] * b[0];
        if !has_area {
            continue;
        }
        for k in 0..3 {
            let width = apart(uv, k) * map.texels_per_coordinate;
            if let Some(light) = decoded.at(&map, (uv[k], [false; 2]), width as f32, &table) {
                let sum = &mut sums[t[k] as usize];
                *sum = std::array::from_fn(|i| sum[i] + light[i] * factor[i]);
            }
        }
    }
    Ok(())
}
