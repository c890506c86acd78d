//! The mesh while it is being simplified: vertices of one cache line, triangles, rings.
//!
//! A ring lists the triangles of a vertex in a common arena; a merged ring takes over a slot that is
//! large enough or is appended. The data and how it is read are here; `state` builds it.

pub(crate) mod class;
pub(crate) mod faces;
pub(crate) mod fan;
pub(crate) mod flats;
pub(crate) mod junction;
pub(crate) mod models;
pub(crate) mod morton;
mod rings;
pub(crate) mod wedges;

use crate::options::Placement;
use crate::surface::class::Class;
use crate::surface::flats::Flats;
use crate::surface::models::Models;
use crate::vertex::Vertex;
use stonecut_mesh::vec3::Vec3;

/// Weight of a boundary edge: |e|^2 times the squared distance to its line times this.
const BOUNDARY_WEIGHT: f32 = 1.0;
/// Vertices of more triangles than this are left alone, so that no ring costs more than that.
pub(crate) const MAX_VALENCE: u32 = 200;
/// Distance of prefetching: the vertices of the triangle this many places ahead are fetched.
pub(crate) const AHEAD: usize = 24;

/// Rings longer than this keep triangles that are gone until the next compaction.
pub(crate) const HUB: u32 = 4096;

/// Place of the list of a vertex's triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ring {
    /// First place in the arena; of a vertex that is gone: the vertex it was merged into.
    pub(crate) start: u32,
    pub(crate) len: u32,
    pub(crate) room: u32,
    /// `None` if the vertex is gone.
    pub(crate) class: Option<Class>,
}

impl Ring {
    /// An empty ring.
    pub(crate) fn open(locked: bool) -> Self {
        let class = Some(if locked { Class::Locked } else { Class::Interior });
        Ring { start: 0, len: 0, room: 0, class }
    }
}

/// The mesh, its rings and what it came from. About 70 bytes a triangle at the start.
#[derive(Clone)]
pub(crate) struct Surface {
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) rings: Vec<Ring>,
    pub(crate) arena: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) n_alive: u64,
    /// Input vertex of each vertex.
    pub(crate) source: Vec<u32>,
    pub(crate) models: Models,
    pub(crate) channels: Vec<f32>,
    pub(crate) n_channels: usize,
    /// Position of survivors; set by the owner.
    pub(crate) placement: Placement,
    /// Planes that parts of it lie in exactly, if there are any.
    pub(crate) flats: Option<Box<Flats>>,
    /// True if there are vertices of class `Junction`.
    pub(crate) has_junctions: bool,
    /// True if locked vertices lie in one place: wedges of one vertex that other cells know apart.
    pub(crate) has_locked_copies: bool,
    /// True if its triangles are walls of regions, of which none may be missing.
    pub(crate) has_walls: bool,
    /// True if new places are numbers of `f32`, as the output's are.
    pub(crate) rounds: bool,
    /// Size of a box from which on a curve of an odd number of sheets is not noise, however few its edges are; infinite where other
    /// cells may hold more of it.
    pub(crate) long_curve: f64,
    /// Power of two that brings edges near to length 1, so that f32 neither over- nor underflows.
    pub(crate) scale: f64,
    /// 1 / scale, which is exact.
    pub(crate) unscale: f64,
}

/// Quadric of a boundary edge: squared length times squared distance to its line.
#[inline(always)]
pub(crate) fn boundary_quadric(edge: [f32; 3]) -> [f32; 6] {
    let [x, y, z] = edge;
    let sq = x * x + y * y + z * z;
    let w = BOUNDARY_WEIGHT;
    [w * (sq - x * x), -w * (x * y), -w * (x * z), w * (sq - y * y), -w * (y * z), w * (sq - z * z)]
}

impl Surface {
    /// The channels of a vertex off the seams.
    #[inline(always)]
    pub(crate) fn channels_of(&self, v: u32) -> &[f32] {
        &self.channels[v as usize * self.n_channels..][..self.n_channels]
    }

    /// Scaled vector from one vertex to another.
    #[inline(always)]
    pub(crate) fn edge(&self, from: u32, to: u32) -> [f32; 3] {
        self.scaled(self.vertices[from as usize].position, self.vertices[to as usize].position)
    }

    /// Scaled vector from one place to another.
    #[inline(always)]
    pub(crate) fn scaled(&self, from: Vec3, to: Vec3) -> [f32; 3] {
        let along = |i: usize| ((to[i] - from[i]) * self.scale) as f32;
        [along(0), along(1), along(2)]
    }

    /// A new place as the output will have it, if that counts.
    #[inline(always)]
    pub(crate) fn rounded(&self, place: Vec3) -> Vec3 {
        if self.rounds { place.map(|x| f64::from(x as f32)) } else { place }
    }

    /// The triangles of a vertex.
    #[inline(always)]
    pub(crate) fn ring(&self, v: u32) -> &[u32] {
        let ring = &self.rings[v as usize];
        &self.arena[ring.start as usize..][..ring.len as usize]
    }
}
