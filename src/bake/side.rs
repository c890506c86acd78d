//! The surface of the result at a point, as its place on the original sees it: the side that it faces, and how texture
//! coordinates go on around the place. Uses neither cells nor charts.

use stonecut_measure::triangle::Vector;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{cross, dot, length_sq, sub};

/// Texture coordinates that go on farther than this, in lengths of the same area, are not trusted.
const MOST_STRETCH: f64 = 4.0;

/// The surface of the result at a point, as its place on the original sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    /// Normal of any length.
    pub normal: Vector,
    /// Ways of a texel along the axes of the page; zeros where nothing is looked up around the point.
    pub steps: [Vector; 2],
}

impl Side {
    /// Ways in the texture coordinates `uv` of a triangle along the steps; zeros where they lead too far to be trusted.
    pub fn along(
        &self,
        t: &[Vector; 3],
        uv: Option<[[f64; 3]; 2]>,
        per_unit: f32,
    ) -> [[f32; 2]; 2] {
        const NONE: [[f32; 2]; 2] = [[0.0; 2]; 2];
        if self.steps == [[0.0; 3]; 2] {
            return NONE;
        }
        let Some(uv) = uv else { return NONE };
        let (e, f) = (sub(t[1], t[0]), sub(t[2], t[0]));
        let n = cross(e, f);
        let of_area = 1.0 / length_sq(n);
        let rise = [cross(f, n), cross(n, e)];
        let along = self.steps.map(|step| {
            let [v, w] = rise.map(|rise| of_area * dot(rise, step));
            uv.map(|of| v * (of[1] - of[0]) + w * (of[2] - of[0]))
        });
        let is_near = |(step, [u, v]): (&Vector, &[f64; 2])| {
            let most = MOST_STRETCH * f64::from(per_unit);
            u * u + v * v <= most * most * length_sq(*step)
        };
        let is_known = self.steps.iter().zip(&along).all(is_near);
        if is_known { along.map(|way| way.map(|x| x as f32)) } else { NONE }
    }
}

/// Ways on a triangle of a mesh with given corners on a page of a texel along the page's axes; zeros where they are too long.
pub(super) fn steps_on(mesh: &Mesh, t: usize, [a, b, c]: [[f32; 2]; 3]) -> [Vector; 2] {
    let [a, b, c] = [a, b, c].map(|at| at.map(f64::from));
    let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let [at, to_b, to_c] = mesh.corners(t);
    let (to_b, to_c) = (sub(to_b, at), sub(to_c, at));
    let step = |v: f64, w: f64| [0, 1, 2].map(|k| (v * to_b[k] + w * to_c[k]) / twice);
    let steps = [step(c[1] - a[1], a[1] - b[1]), step(a[0] - c[0], b[0] - a[0])];
    let is_known = steps.iter().flatten().all(|x| x.is_finite());
    if is_known { steps } else { [[0.0; 3]; 2] }
}

/// Texture coordinates at a point of a triangle with those of its corners; NaN without any.
pub(super) fn uv_at(corners: Option<[[f64; 3]; 2]>, [a, b, c]: [f64; 3]) -> [f32; 2] {
    corners.map_or([f32::NAN; 2], |corners| {
        corners.map(|[of_a, of_b, of_c]| (a * of_a + b * of_b + c * of_c) as f32)
    })
}
