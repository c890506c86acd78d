//! One collapse as it is looked at: the triangles around it, and what is noted until it is carried out.

use super::fan::Fans;
use crate::surface::faces::Face;
use stonecut_mesh::vec3::Vec3;

/// The triangles around a collapse.
pub(crate) struct Patch<'a> {
    /// `v0` and `v1`.
    pub(crate) ends: [u32; 2],
    /// Triangles of either end; the first `n_kept` stay, the others vanish.
    pub(crate) ids: &'a [u32],
    pub(crate) n_kept: usize,
    /// Second and third corners of those that stay; the first will be the survivor.
    pub(crate) b: &'a [u32],
    pub(crate) c: &'a [u32],
    /// The survivor's place.
    pub(crate) place: Vec3,
    /// True if a triangle turns far.
    pub(crate) turns: bool,
    /// Neighbours over open edges of either end.
    pub(crate) open: &'a [(u32, u32)],
}

/// Notes on a collapse until it is carried out; re-used.
#[derive(Clone, Default)]
pub(crate) struct Scratch {
    pub(super) faces: Vec<Face>,
    /// Of the input, around witnesses.
    pub(super) fans: Fans,
    pub(super) witnesses: Vec<u32>,
    /// Longest edge of the input at any of them.
    pub(super) longest: f32,
    /// Place in `faces` and squared distance of each.
    pub(super) found: Vec<(u32, f32)>,
    /// True of each that the edges of the input from it were looked at.
    pub(super) is_done: Vec<bool>,
}

/// Up to eight witnesses that are held against the faces together.
#[derive(Default)]
pub(super) struct Eight {
    /// Relative to the survivor.
    pub(super) points: [[f32; 8]; 3],
    pub(super) limit_sq: [f32; 8],
    pub(super) n: usize,
}
