//! The plan of a collapse, and the scratch space in which it is tested and carried out.

use crate::cost::attributes::RingLists;
use crate::cost::quadric::Rows;
use crate::simd::unchecked::KnownIds;
use crate::surface::MAX_VALENCE;
use crate::surface::fan::Fan;
use crate::surface::junction::MOST_SHEETS;
use crate::vertex::Vertex;

/// A collapse as planned by the evaluation of its edge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan {
    pub(crate) v0: u32,
    pub(crate) v1: u32,
    /// Survivor's place relative to the edge's midpoint, scaled.
    pub(crate) place: [f32; 3],
    /// True if a triangle may turn further than `FLIP_COSINE`.
    pub(crate) may_turn: bool,
}

/// Room for the triangles of both ends, in whole parts of eight; a power of two, so that a place in it needs
/// no check.
pub(super) const ROOM: usize = 256;
/// First place for the vanishing triangles until their number is known.
pub(super) const GONE_AT: usize = ROOM - 16;
const _: () = assert!(GONE_AT >= MAX_VALENCE as usize + 16);

/// Scratch space of one collapse, re-used.
#[derive(Clone)]
pub(crate) struct Collapser {
    /// Triangles of `v0` (first `n0`) and of `v1` that stay (up to `n_kept`), then those that vanish (up
    /// to `n`).
    pub(super) ids: [u32; ROOM],
    pub(super) b: [u32; ROOM],
    pub(super) c: [u32; ROOM],
    pub(super) n0: usize,
    pub(super) n_kept: usize,
    pub(super) n: usize,
    /// Third corners of the vanishing triangles; the first twice if there is only one.
    pub(super) opposite: [u32; MOST_SHEETS],
    /// Neighbours over open edges and edges of junction curves of either end, and from which end.
    pub(super) open: Vec<(u32, u32)>,
    /// Third vertex of a hole of three edges that the collapse closes.
    pub(super) closes: Option<u32>,
    pub(crate) may_close: bool,
    /// True if vertices on junction curves may go along them.
    pub(crate) may_go_along: bool,
    pub(super) fan: Fan,
    /// Quadrics of the triangles after minus before.
    pub(super) changes: Vec<Rows>,
}

/// The vertices of some ids.
#[inline(always)]
pub(crate) fn eight<'a>(
    known: KnownIds,
    vertices: &'a [Vertex],
    ids: &[u32; 8],
) -> [&'a Vertex; 8] {
    let of = |i: usize| known.at(vertices, ids[i]);
    [of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)]
}

impl Collapser {
    /// `may_close`: whether holes of three edges may close.
    pub(crate) fn new(may_close: bool) -> Self {
        Collapser {
            ids: [0; ROOM],
            b: [0; ROOM],
            c: [0; ROOM],
            n0: 0,
            n_kept: 0,
            n: 0,
            opposite: [0; MOST_SHEETS],
            open: Vec::new(),
            closes: None,
            may_close,
            may_go_along: true,
            fan: Fan::new(),
            changes: vec![Rows::ZERO; ROOM / 8],
        }
    }

    /// Of the collapse that was carried out last: the triangles whose corner `v0` became `v1`, and those that vanished, each with
    /// its third corner.
    pub(crate) fn carried_out(&self) -> (&[u32], impl Iterator<Item = (u32, u32)>) {
        let gone = &self.ids[self.n_kept..self.n];
        (&self.ids[..self.n0], gone.iter().copied().zip(self.opposite))
    }

    /// The lists as attributes need them.
    pub(super) fn lists(&self, plan: Plan) -> RingLists<'_> {
        RingLists {
            v0: plan.v0,
            v1: plan.v1,
            b: &self.b,
            c: &self.c,
            ids: &self.ids,
            n0: self.n0,
            n_kept: self.n_kept,
            n: self.n,
        }
    }
}
