//! Tangent frames of textured triangles: the home of `bevy_mikktspace`.
//!
//! A normal map holds directions in these frames, so those that make it (`bake`) and those that show it (`render`) must
//! have the same. glTF names Mikkelsen's frames (MikkTSpace); coordinates are taken with v upwards, so green is up.

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use stonecut_mesh::vec3::{Vec3, add, cross, dot, scale, unit};

/// Direction of rising u at a corner in steps of 1/32767, and the side on which the other axis is.
pub type Tangent = [i16; 4];

/// The step of a tangent's numbers.
const FULL: f32 = 32767.0;

/// A corner of a triangle.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameCorner {
    /// Place of the corner.
    pub position: [f32; 3],
    /// Normal of the vertex, of length 1.
    pub normal: [f32; 3],
    /// Texture coordinates, v upwards.
    pub uv: [f32; 2],
}

/// The tangents of `n` triangles of one image; `corner` has the corners of each.
///
/// Corners with the same position, normal and coordinates share their tangent where triangles between them share edges.
/// Memory: about 300 bytes a triangle. Source: Mikkelsen 2008 (docs/references.md).
pub fn tangents(n: usize, corner: impl Fn(usize, usize) -> FrameCorner) -> Vec<[Tangent; 3]> {
    let mut work = Triangles { corner, found: vec![[[0; 4]; 3]; n] };
    // The error has no cases.
    let _ = generate_tangents(&mut work);
    let Triangles { corner, mut found } = work;
    for (t, tangents) in found.iter_mut().enumerate() {
        for (k, tangent) in tangents.iter_mut().enumerate() {
            if *tangent == [0; 4] {
                *tangent = packed(any_across(corner(t, k).normal), 1.0);
            }
        }
    }
    found
}

struct Triangles<F> {
    corner: F,
    found: Vec<[Tangent; 3]>,
}

impl<F: Fn(usize, usize) -> FrameCorner> Geometry for Triangles<F> {
    fn num_faces(&self) -> usize {
        self.found.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        (self.corner)(face, vert).position
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        (self.corner)(face, vert).normal
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        (self.corner)(face, vert).uv
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, vert: usize) {
        let Some([x, y, z, side]) = tangent.map(|tangent| tangent.tangent_encoded()) else {
            return;
        };
        let has_direction = [x, y, z].iter().all(|x| x.is_finite()) && [x, y, z] != [0.0; 3];
        if has_direction {
            self.found[face][vert] = packed([x, y, z], side);
        }
    }
}

fn packed([x, y, z]: [f32; 3], side: f32) -> Tangent {
    [x, y, z, side].map(|x| (FULL * x.clamp(-1.0, 1.0)).round() as i16)
}

/// A direction across a normal.
fn any_across(normal: [f32; 3]) -> [f32; 3] {
    let normal = normal.map(f64::from);
    let flat = if normal[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    unit(cross(normal, flat)).unwrap_or([1.0, 0.0, 0.0]).map(|x| x as f32)
}

/// Axes at a place of a triangle: along u, along v, and the normal, each of length 1 and not quite across each other.
#[derive(Clone, Copy, Debug)]
pub struct Axes([Vec3; 3]);

impl Axes {
    /// Axes at barycentric coordinates; all three are interpolated and made unit length again, as viewers do it. `None`
    /// where an axis has no direction.
    pub fn at(normals: [[f32; 3]; 3], tangents: &[Tangent; 3], weights: [f64; 3]) -> Option<Axes> {
        let mut sums = [[0.0; 3]; 3];
        for (k, weight) in weights.into_iter().enumerate() {
            let normal = normals[k].map(f64::from);
            let (tangent, side) = unpacked(tangents[k]);
            let across = scale(cross(normal, tangent), side);
            for (sum, axis) in sums.iter_mut().zip([tangent, across, normal]) {
                *sum = add(*sum, scale(axis, weight));
            }
        }
        let [u, v, normal] = sums.map(unit);
        Some(Axes([u?, v?, normal?]))
    }

    /// A direction in these axes, of length 1; `None` where they lie in a plane.
    pub fn inward(&self, direction: Vec3) -> Option<Vec3> {
        let [u, v, normal] = self.0;
        let rows = [cross(v, normal), cross(normal, u), cross(u, v)];
        let volume = dot(u, rows[0]);
        let is_flat = volume.abs() < 1e-6;
        unit(rows.map(|row| dot(row, direction) / volume)).filter(|_| !is_flat)
    }
}

/// A direction in the axes of a normal, a tangent and the one across them on a side (1 or -1), turned outwards; `None` where
/// these have no directions.
pub fn outward(
    normal: [f32; 3],
    tangent: [f32; 3],
    side: f32,
    direction: [f32; 3],
) -> Option<[f32; 3]> {
    let [normal, tangent] = [normal, tangent].map(|axis| axis.map(f64::from));
    let [x, y, z] = direction.map(f64::from);
    let (tangent, normal) = (unit(tangent)?, unit(normal)?);
    let across = scale(unit(cross(normal, tangent))?, f64::from(side));
    let sum = add(add(scale(tangent, x), scale(across, y)), scale(normal, z));
    unit(sum).map(|axis| axis.map(|x| x as f32))
}

/// Direction of a tangent, and its side: 1 or -1.
pub fn unpacked([x, y, z, side]: Tangent) -> (Vec3, f64) {
    ([x, y, z].map(|x| f64::from(x) / f64::from(FULL)), if side < 0 { -1.0 } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles over the unit square in the plane z = 0, with coordinates turned by a quarter.
    #[test]
    fn tangents_follow_the_coordinates() {
        let places = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let corner = |is_mirrored: bool| {
            move |t: usize, k: usize| {
                let [x, y] = places[[[0, 1, 2], [0, 2, 3]][t][k]];
                let uv = if is_mirrored { [y, x] } else { [y, 1.0 - x] };
                FrameCorner { position: [x, y, 0.0], normal: [0.0, 0.0, 1.0], uv }
            }
        };
        assert_eq!(tangents(2, corner(false)), [[[0, 32767, 0, 32767]; 3]; 2]);
        assert_eq!(tangents(2, corner(true)), [[[0, 32767, 0, -32767]; 3]; 2]);
        let found = tangents(2, corner(false));
        let axes = Axes::at([[0.0, 0.0, 1.0]; 3], &found[0], [0.25, 0.25, 0.5]).unwrap();
        let there = axes.inward([0.6, 0.0, 0.8]).unwrap();
        for (x, expected) in there.into_iter().zip([0.0, -0.6, 0.8]) {
            assert!((x - expected).abs() < 1e-6, "{there:?}");
        }
        // Without an area of coordinates there is a tangent, too.
        let point = |t, k| FrameCorner { uv: [0.5; 2], ..corner(false)(t, k) };
        assert!(
            tangents(2, point).iter().flatten().all(|[x, y, z, _]| *z == 0 && (*x, *y) != (0, 0))
        );
    }
}
