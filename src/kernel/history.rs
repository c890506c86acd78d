//! Records every step on the way down, so that it can be taken back: for progressive meshes.
//!
//! Only the schedule for it (`levels::recorded`) fills it: there the numbers of vertices and triangles stay the same from
//! the first step to the last. Each step is a few numbers behind those of the one before, its kind and length last, so
//! that they can be read from the end.
//!
//! Source: Hoppe 1996 (docs/references.md).

use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::vec3::Vec3;

/// Kind of a step, in the two highest bits of its last number; below them the number of vanished triangles where it is one
/// or two, then the length.
const COLLAPSE: u32 = 0;
const VANISH: u32 = 1;
const CUT: u32 = 2;
const KIND_AT: u32 = 30;
const GONE_AT: u32 = 28;
const LENGTH: u32 = (1 << GONE_AT) - 1;

/// The steps of a run, and what they left: about 50 bytes for each triangle of the mesh that they began with, and 4 bytes a
/// channel for each collapse and each vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    words: Vec<u32>,
    /// Of each collapse: place and channels of the survivor before.
    places: Vec<Vec3>,
    channels: Vec<f32>,
    n_channels: usize,
    /// Kept from before a collapse that is under way.
    sources: [u32; 2],
    place: Vec3,
    /// Places of all vertices at the end; of one that is gone, its last.
    pub positions: Vec<Vec3>,
    /// The channels of the same, vertex by vertex.
    pub vertex_channels: Vec<f32>,
    /// Input vertex of each vertex at the end.
    pub source: Vec<u32>,
    /// Corners of all triangles; the first is `u32::MAX` where one is gone, and the others are its last.
    pub triangles: Vec<[u32; 3]>,
}

/// A triangle that a step removes, and its first corner.
pub type Gone = [u32; 2];

/// A step on the way down. Vertices and triangles are numbers in the lists of the `History`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step<'a> {
    /// `removed` vanishes into `kept`.
    Collapse {
        /// The vertex that goes.
        removed: u32,
        /// The one that stays.
        kept: u32,
        /// Input vertices of both before.
        sources: [u32; 2],
        /// Place of `kept` before.
        place: Vec3,
        /// Its channels before.
        channels: &'a [f32],
        /// Triangles that go.
        gone: &'a [Gone],
        /// Triangles of `removed` that stay: its corner in them becomes `kept`.
        fan: &'a [u32],
    },
    /// Triangles go, and their vertices with them.
    Vanish {
        /// The triangles.
        gone: &'a [Gone],
    },
    /// The surface is cut along three edges and both sides are capped; what that separates may vanish.
    Cut {
        /// Vertices of the cut.
        cycle: [u32; 3],
        /// New vertices, which take over one side.
        new: [u32; 3],
        /// The two caps: new triangles.
        caps: [u32; 2],
        /// Triangles that vanish, perhaps with a cap.
        gone: &'a [Gone],
    },
}

impl Step<'_> {
    /// Triangles that are there before but not after, less those that are new.
    pub fn freed(&self) -> i64 {
        match self {
            Step::Collapse { gone, .. } | Step::Vanish { gone } => gone.len() as i64,
            Step::Cut { gone, .. } => gone.len() as i64 - 2,
        }
    }
}

/// Place of a step in a `History`.
#[derive(Clone, Copy, Debug)]
pub struct Cursor {
    end: u32,
    /// Collapses before.
    collapses: u32,
}

impl History {
    pub(crate) fn new(n_channels: usize) -> History {
        History { n_channels, ..History::default() }
    }

    /// Notes what a collapse is about to change.
    pub(crate) fn before(&mut self, surface: &Surface, removed: u32, kept: u32) {
        self.sources = [removed, kept].map(|v| surface.source[v as usize]);
        self.place = surface.vertices[kept as usize].position;
        self.channels.truncate(self.places.len() * self.n_channels);
        self.channels.extend_from_slice(surface.channels_of(kept));
    }

    /// Adds the collapse that `before` was called for; `gone` are vanished triangles with their third corners.
    pub(crate) fn collapsed(
        &mut self,
        surface: &Surface,
        (removed, kept): (u32, u32),
        fan: &[u32],
        gone: impl Iterator<Item = (u32, u32)>,
    ) {
        self.places.push(self.place);
        let start = self.words.len();
        self.words.extend([self.sources[0], self.sources[1], removed, kept]);
        let mut n_gone = 0;
        for (t, third) in gone {
            let [_, b, c] = surface.triangles[t as usize];
            let first = [removed, kept, third].into_iter().find(|&v| v != b && v != c);
            self.words.extend([t, first.unwrap_or(third)]);
            n_gone += 1;
        }
        self.words.extend_from_slice(fan);
        self.close(start, COLLAPSE, n_gone);
    }

    /// Adds triangles that are about to vanish.
    pub(crate) fn vanishes(&mut self, surface: &Surface, triangles: &[u32]) {
        let start = self.words.len();
        self.push_gone(surface, triangles);
        self.close(start, VANISH, 0);
    }

    /// Adds a cut that was made, and the triangles that are about to vanish with it.
    pub(crate) fn cut(
        &mut self,
        surface: &Surface,
        cycle: [u32; 3],
        new: [u32; 3],
        stripped: &[u32],
    ) {
        let start = self.words.len();
        let n = surface.triangles.len() as u32;
        self.words.extend(cycle.into_iter().chain(new).chain([n - 2, n - 1]));
        self.push_gone(surface, stripped);
        self.close(start, CUT, 0);
    }

    fn push_gone(&mut self, surface: &Surface, triangles: &[u32]) {
        self.words.extend(triangles.iter().flat_map(|&t| [t, surface.triangles[t as usize][0]]));
    }

    fn close(&mut self, start: usize, kind: u32, n_gone: u32) {
        let length = (self.words.len() - start) as u32;
        assert!(length <= LENGTH, "a step has few triangles");
        self.words.push(kind << KIND_AT | n_gone << GONE_AT | length);
    }

    /// Forgets what was recorded so far.
    pub(crate) fn clear(&mut self) {
        *self = History::new(self.n_channels);
    }

    /// Takes over what is left of the vertices and triangles.
    pub(crate) fn end(&mut self, surface: &Surface) {
        self.positions = surface.vertices.iter().map(|vertex| vertex.position).collect();
        self.vertex_channels = surface.channels.clone();
        self.source = surface.source.clone();
        self.triangles = surface.triangles.clone();
    }

    /// Triangles that are left at the end.
    pub fn left(&self) -> impl Iterator<Item = (u32, [u32; 3])> {
        (0..).zip(&self.triangles).filter(|(_, t)| t[0] != GONE).map(|(id, &t)| (id, t))
    }

    /// Corners of a triangle that was removed.
    pub fn corners(&self, [t, first]: Gone) -> [u32; 3] {
        let [_, b, c] = self.triangles[t as usize];
        [first, b, c]
    }

    /// Channels of a vertex as they were last.
    pub fn channels_of(&self, v: u32) -> &[f32] {
        &self.vertex_channels[v as usize * self.n_channels..][..self.n_channels]
    }

    /// Places of all steps, the last one first. Memory: 8 bytes a step.
    pub fn back(&self) -> Vec<Cursor> {
        let mut cursors = Vec::with_capacity(self.places.len());
        let (mut end, mut collapses) = (self.words.len(), self.places.len());
        while let Some(&last) = end.checked_sub(1).and_then(|at| self.words.get(at)) {
            collapses -= usize::from(last >> KIND_AT == COLLAPSE);
            cursors.push(Cursor { end: end as u32, collapses: collapses as u32 });
            end -= 1 + (last & LENGTH) as usize;
        }
        cursors
    }

    /// The step at a place.
    pub fn step(&self, at: Cursor) -> Step<'_> {
        let last = self.words[at.end as usize - 1];
        let end = at.end as usize - 1;
        let words = &self.words[end - (last & LENGTH) as usize..end];
        match last >> KIND_AT {
            COLLAPSE => {
                let (ends, rest) = words.split_at(4);
                let (gone, fan) = rest.split_at(2 * (last >> GONE_AT & 3) as usize);
                let n = self.n_channels;
                Step::Collapse {
                    removed: ends[2],
                    kept: ends[3],
                    sources: [ends[0], ends[1]],
                    place: self.places[at.collapses as usize],
                    channels: &self.channels[at.collapses as usize * n..][..n],
                    gone: gone.as_chunks().0,
                    fan,
                }
            }
            VANISH => Step::Vanish { gone: words.as_chunks().0 },
            _ => Step::Cut {
                cycle: [words[0], words[1], words[2]],
                new: [words[3], words[4], words[5]],
                caps: [words[6], words[7]],
                gone: words[8..].as_chunks().0,
            },
        }
    }
}
