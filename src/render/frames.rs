//! Tangent frames in pictures: of corners before faces are drawn, of samples when normal maps are looked up.
//!
//! A mesh that is not too large has Mikkelsen's frames, as glTF wants; each face of a larger one has the frame that its
//! coordinates have. Looks nothing up.

use super::raster::Corner;
use super::sample::Sample;
use super::turn::tangent_of;
use crate::texture::{FrameCorner, Tangent, tangents, unpacked};
use stonecut_mesh::vec3::{add, cross, scale, sub, unit};

/// Triangles whose frames are computed together at most.
pub(super) const MOST_TRIANGLES: u64 = 4_000_000;

/// Bytes of a triangle while frames are computed: its corners, and what the computation takes.
pub(super) const FRAME_BYTES: u64 = 420;

/// Frames of all faces of a scene, in their order.
#[derive(Default)]
pub(super) struct Frames(Vec<[Tangent; 3]>);

impl Frames {
    /// Frames of faces given by their corners, in camera space, with coordinates.
    pub(super) fn of(faces: &[[Corner; 3]]) -> Frames {
        let corner = |t: usize, k: usize| {
            let Corner { place: position, normal, uv, .. } = faces[t][k];
            FrameCorner { position, normal, uv }
        };
        Frames(tangents(faces.len(), corner))
    }

    /// Gives the corners of face `number` their tangents.
    pub(super) fn put(&self, number: usize, corners: &mut [Corner; 3]) {
        match self.0.get(number) {
            Some(tangents) => {
                for (corner, tangent) in corners.iter_mut().zip(tangents) {
                    let ([x, y, z], side) = unpacked(*tangent);
                    corner.tangent = [x, y, z, side].map(|x| x as f32);
                }
            }
            None => {
                let tangent = own_tangent(corners);
                corners.iter_mut().for_each(|corner| corner.tangent = tangent);
            }
        }
    }
}

/// The tangent of a face by its own coordinates.
fn own_tangent(corners: &[Corner; 3]) -> [f32; 4] {
    let [a, b, c] = [0, 1, 2].map(|k| corners[k].place.map(f64::from));
    let [p, q, r] = [0, 1, 2].map(|k| corners[k].uv.map(f64::from));
    let (first, second) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
    let area = first[0] * second[1] - first[1] * second[0];
    let along = sub(scale(sub(b, a), second[1]), scale(sub(c, a), first[1]));
    let side = if area < 0.0 { -1.0 } else { 1.0 };
    let [x, y, z] = unit(scale(along, side)).unwrap_or([1.0, 0.0, 0.0]);
    [x, y, z, side].map(|x| x as f32)
}

/// The normal of a sample, towards the viewer, whose normal map holds `direction`.
pub(super) fn bent(sample: &Sample, direction: [f32; 3]) -> [f32; 3] {
    let Some(normal) = unit(sample.normal.map(f64::from)) else { return sample.normal };
    let [x, y, z] = direction.map(f64::from);
    let tangent = tangent_of(normal, sample.turn);
    let is = |flag: u8| sample.flags & flag != 0;
    // The back shows the front's directions from behind.
    let towards = if is(Sample::BACK) { -1.0 } else { 1.0 };
    let side = if is(Sample::MIRRORED) { -1.0 } else { 1.0 };
    let across = scale(cross(normal, tangent), towards * side);
    let sum = add(scale(add(scale(tangent, x), scale(across, y)), towards), scale(normal, z));
    unit(sum).map_or(sample.normal, |n| n.map(|x| x as f32))
}
