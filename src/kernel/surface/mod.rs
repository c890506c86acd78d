//! The mesh while it is being simplified: vertices of one cache line, triangles, rings.
//!
//! A ring lists the triangles of a vertex in a common arena; a merged ring takes over a slot that is
//! large enough or is appended. Building and compacting live here, collapses do not.

pub(crate) mod morton;
pub(crate) mod validate;

use std::hint::select_unpredictable;

use crate::kernel::Placement;
use crate::kernel::collapse::legality::Class;
use crate::kernel::collapse::wedges::Wedges;
use crate::kernel::cost::attributes::Attributes;
use crate::kernel::cost::fold_quadric;
use crate::kernel::cost::quadric::{Rows, Triangles};
use crate::kernel::simd::unchecked::{at, at_mut, part, prefetch};
use crate::kernel::simd::{Job, Lanes, Simd};
use crate::kernel::surface::validate::validate;
use crate::mesh::Mesh;
use crate::mesh::vec3::Vec3;

/// First corner of a triangle that is gone.
pub(crate) const GONE: u32 = u32::MAX;
/// Weight of a boundary edge: |e|^2 times the squared distance to its line times this.
const BOUNDARY_WEIGHT: f32 = 1.0;
/// Vertices of more triangles than this are left alone, so that no ring costs more than that.
pub(crate) const MAX_VALENCE: u32 = 200;
/// Rings longer than this keep triangles that are gone until the next compaction.
pub(crate) const HUB: u32 = 4096;

/// All that an edge's evaluation needs to know of its ends: one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Vertex {
    /// In input units, exactly.
    pub(crate) position: Vec3,
    /// A (xx, xy, xz, yy, yz, zz) and G (x, y, z), in scaled units.
    pub(crate) quadric: [f32; 9],
    /// Number of the collapse that changed it last.
    pub(crate) stamp: u32,
}

/// Where the triangles of a vertex are listed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ring {
    /// First place in the arena; of a vertex that is gone: the vertex it was merged into.
    pub(crate) start: u32,
    pub(crate) len: u32,
    pub(crate) room: u32,
    /// `None` if the vertex is gone.
    pub(crate) class: Option<Class>,
}

impl Vertex {
    /// A vertex without triangles.
    fn at(position: Vec3) -> Self {
        Vertex { position, quadric: [0.0; 9], stamp: 0 }
    }
}

impl Ring {
    /// An empty ring.
    fn open(locked: bool) -> Self {
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
    pub(crate) channels: Vec<f32>,
    pub(crate) n_channels: usize,
    /// Triangles of the input that may be without area.
    pub(crate) flat: Vec<u32>,
    /// Where survivors go; set by the owner.
    pub(crate) placement: Placement,
    /// Power of two that brings edges near to length 1, so that f32 neither over- nor underflows.
    pub(crate) scale: f64,
    /// 1 / scale, which is exact.
    pub(crate) unscale: f64,
    /// Only if a channel has a weight.
    pub(crate) attributes: Option<Box<Attributes>>,
    /// Only if there are attribute seams.
    pub(crate) wedges: Option<Box<Wedges>>,
}

/// Quadric of a boundary edge: squared length times squared distance to its line.
#[inline(always)]
pub(crate) fn boundary_quadric(edge: [f32; 3]) -> [f32; 6] {
    let [x, y, z] = edge;
    let sq = x * x + y * y + z * z;
    let w = BOUNDARY_WEIGHT;
    [w * (sq - x * x), -w * (x * y), -w * (x * z), w * (sq - y * y), -w * (y * z), w * (sq - z * z)]
}

/// A triangle as seen from one of its corners: the other two, in its sense of rotation.
#[inline(always)]
pub(crate) fn others(triangle: [u32; 3], v: u32) -> (u32, u32) {
    // Which corner it is cannot be predicted.
    let [x, y, z] = triangle;
    let (first, second) = (x == v, y == v);
    let next = select_unpredictable(first, y, select_unpredictable(second, z, x));
    let last = select_unpredictable(first, z, select_unpredictable(second, x, y));
    (next, last)
}

/// Vertices of the triangle that comes so many places later are asked for in time.
pub(crate) const AHEAD: usize = 24;

fn is_proper(t: &[u32; 3]) -> bool {
    t[0] != t[1] && t[1] != t[2] && t[2] != t[0]
}

/// Exponent of a positive number, from its bits: `log2` may differ between processors. 0 for anything else.
fn exponent(x: f64) -> i64 {
    let is_usable = x > 0.0 && x.is_finite();
    if is_usable { (x.to_bits() >> 52) as i64 - 1023 } else { 0 }
}

/// 2 to a power that is first brought to between -1000 and 1000.
fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((exponent.clamp(-1000, 1000) + 1023) as u64) << 52)
}

impl Surface {
    /// Takes a mesh apart. Triangles that repeat a corner are dropped.
    pub(crate) fn new(
        mut mesh: Mesh,
        locked: &[bool],
        (weights, confined): (&[f32], &[bool]),
        simd: Simd,
    ) -> Self {
        mesh.triangles.retain(is_proper);
        let extent = morton::bounds(&mesh.positions);
        let order = morton::morton(&mesh.positions, &mesh.triangles, extent);
        let (_, side) = extent;
        // Powers of two do not round: the scale changes no bit of the result.
        let scale = power_of_two(10 - exponent(side));
        let n_channels = mesh.n_channels;
        let source = order.source;
        // Mending adds vertices, collapses add rings: room that is never used is never touched either.
        let room = source.len() + source.len() / 8;
        let mut vertices = Vec::with_capacity(room);
        vertices.extend(source.iter().map(|&old| Vertex::at(mesh.positions[old as usize])));
        let mut rings = Vec::with_capacity(room);
        rings.extend(source.iter().map(|&old| Ring::open(locked[old as usize])));
        let mut channels = Vec::with_capacity(mesh.channels.len());
        if n_channels > 0 {
            for &old in &source {
                channels.extend_from_slice(mesh.channels_of(old));
            }
        }
        let mut triangles = vec![[0u32; 3]; mesh.triangles.len()];
        for (t, &new) in mesh.triangles.iter().zip(&order.triangle_place) {
            triangles[new as usize] = t.map(|v| order.vertex_place[v as usize]);
        }
        let n_alive = triangles.len() as u64;
        drop((mesh, order.vertex_place, order.triangle_place));
        let mut surface = Surface {
            vertices,
            rings,
            arena: Vec::with_capacity(4 * n_alive as usize),
            triangles,
            n_alive,
            source,
            channels,
            n_channels,
            flat: Vec::new(),
            placement: Placement::default(),
            scale,
            unscale: 1.0 / scale,
            attributes: Attributes::new(weights, confined, scale, simd).map(Box::new),
            wedges: None,
        };
        surface.build(simd, false);
        surface
    }

    /// Drops what is gone, keeps the order of the rest, and builds rings and quadrics anew. For each vertex its
    /// new number, `GONE` if it is gone.
    pub(crate) fn compact(&mut self, simd: Simd) -> Vec<u32> {
        let mut place = vec![GONE; self.vertices.len()];
        let mut n = 0;
        for (old, place) in place.iter_mut().enumerate() {
            let ring = self.rings[old];
            if ring.class.is_none() || ring.len == 0 {
                continue;
            }
            *place = n as u32;
            self.vertices[n] = Vertex::at(self.vertices[old].position);
            self.rings[n] = Ring { len: 0, ..ring };
            self.source[n] = self.source[old];
            for channel in 0..self.n_channels {
                self.channels[n * self.n_channels + channel] =
                    self.channels[old * self.n_channels + channel];
            }
            n += 1;
        }
        self.vertices.truncate(n);
        self.rings.truncate(n);
        self.source.truncate(n);
        self.channels.truncate(n * self.n_channels);
        if let Some(wedges) = &mut self.wedges {
            wedges.retain(&self.triangles);
        }
        self.triangles.retain(|t| t[0] != GONE);
        for t in &mut self.triangles {
            *t = t.map(|v| place[v as usize]);
        }
        self.build(simd, true);
        place
    }

    /// Rings, quadrics and classes from triangles and blank vertices; `again` after a compaction.
    fn build(&mut self, simd: Simd, again: bool) {
        let flat = self.sum_quadrics(simd);
        if !again {
            self.flat = flat;
        }
        let mut start = 0;
        for ring in &mut self.rings {
            ring.start = start;
            ring.room = ring.len;
            start += ring.len;
            ring.len = 0;
        }
        self.arena.clear();
        self.arena.resize(start as usize, 0);
        for (id, t) in self.triangles.iter().enumerate() {
            for &v in t {
                let ring = at_mut(&mut self.rings, v);
                *at_mut(&mut self.arena, ring.start + ring.len) = id as u32;
                ring.len += 1;
            }
        }
        simd.run(Classify { surface: self, again });
        if let Some(mut wedges) = self.wedges.take() {
            wedges.find_seams(self);
            self.wedges = Some(wedges);
        }
        if let Some(mut attributes) = self.attributes.take() {
            attributes.build(self);
            self.attributes = Some(attributes);
        }
        validate(self);
    }

    /// Adds up the quadrics of all triangles, and the lengths of the rings; gives back the triangles that
    /// may be without area.
    fn sum_quadrics(&mut self, simd: Simd) -> Vec<u32> {
        let mut rows = Rows::ZERO;
        let mut flat = Vec::new();
        for first in (0..self.triangles.len()).step_by(8) {
            for t in self.triangles.iter().skip(first + AHEAD).take(8) {
                // The first corners of some are the others of most.
                prefetch(&self.vertices, t[1]);
                prefetch(&self.vertices, t[2]);
            }
            let eight = &self.triangles[first..(first + 8).min(self.triangles.len())];
            let corner = |i: usize, k: usize| {
                let t = eight[i.min(eight.len() - 1)];
                &self.vertices[t[k] as usize]
            };
            let mut may_be_flat = simd.run(Triangles {
                a: std::array::from_fn(|i| corner(i, 0)),
                b: std::array::from_fn(|i| corner(i, 1)),
                c: std::array::from_fn(|i| corner(i, 2)),
                scale: self.scale,
                out: &mut rows,
            });
            may_be_flat &= 0xFF >> (8 - eight.len());
            while may_be_flat != 0 {
                flat.push(first as u32 + may_be_flat.trailing_zeros());
                may_be_flat &= may_be_flat - 1;
            }
            for (i, t) in eight.iter().enumerate() {
                for &v in t {
                    rows.add_to(i, &mut at_mut(&mut self.vertices, v).quadric);
                    at_mut(&mut self.rings, v).len += 1;
                }
            }
        }
        flat
    }

    /// The channels of a vertex off the seams.
    #[inline(always)]
    pub(crate) fn channels_of(&self, v: u32) -> &[f32] {
        &self.channels[v as usize * self.n_channels..][..self.n_channels]
    }

    /// The channels at corner `v` of triangle `t`.
    #[inline(always)]
    pub(crate) fn values_at(&self, t: u32, v: u32) -> &[f32] {
        match &self.wedges {
            None => self.channels_of(v),
            Some(wedges) => wedges.values_at(self, t, v),
        }
    }

    /// Scaled vector from one vertex to another.
    #[inline(always)]
    pub(crate) fn edge(&self, from: u32, to: u32) -> [f32; 3] {
        let (p, q) = (at(&self.vertices, from).position, at(&self.vertices, to).position);
        let along = |i: usize| ((q[i] - p[i]) * self.scale) as f32;
        [along(0), along(1), along(2)]
    }

    /// The triangles of a vertex.
    #[inline(always)]
    pub(crate) fn ring(&self, v: u32) -> &[u32] {
        let ring = at(&self.rings, v);
        part(&self.arena, ring.start, ring.len)
    }

    /// Room for `n` more places at the end of the arena, filled with the number of some triangle.
    #[inline(always)]
    pub(crate) fn append_room(&mut self, n: usize) -> u32 {
        let start = self.arena.len();
        assert!(start + n <= u32::MAX as usize, "places in the arena are 32 bits wide");
        self.arena.resize(start + n, 0);
        start as u32
    }

    /// Takes a triangle that goes out of the ring of one of its corners; the ring of a hub keeps it until the
    /// vertex is settled or the surface compacted.
    pub(crate) fn remove_from_ring(&mut self, v: u32, triangle: u32) {
        let ring = &mut self.rings[v as usize];
        if ring.len > HUB {
            return;
        }
        let list = &mut self.arena[ring.start as usize..(ring.start + ring.len) as usize];
        if let Some(at) = list.iter().position(|&t| t == triangle) {
            list[at] = list[list.len() - 1];
            ring.len -= 1;
        }
    }

    /// Finds the class of a vertex that is not locked and adds the quadrics of its boundary edges.
    pub(crate) fn classify(&mut self, v: u32, fan: &mut Fan) {
        if self.rings[v as usize].class == Some(Class::Locked) {
            return;
        }
        let valence = self.rings[v as usize].len;
        let class = if valence > MAX_VALENCE { Class::Complex } else { fan.look(self, v) };
        self.rings[v as usize].class = Some(class);
        if class == Class::Boundary {
            for &w in &fan.ends {
                let quadric = boundary_quadric(self.edge(v, w));
                let sum = &mut self.vertices[v as usize].quadric;
                for (sum, x) in sum.iter_mut().zip(quadric) {
                    *sum += x;
                }
            }
        }
    }

    /// Adds the quadrics of the folds at a vertex.
    #[inline(never)]
    fn hold_folds(&mut self, v: u32) {
        let held = fold_quadric::quadric_of(self, v);
        for (sum, x) in self.vertices[v as usize].quadric.iter_mut().zip(held) {
            *sum += x;
        }
    }

    /// The mesh that is left, vertices in the order of their sources; seams are split again.
    pub(crate) fn into_mesh(mut self) -> (Mesh, Vec<u32>) {
        if let Some(mut wedges) = self.wedges.take() {
            wedges.retain(&self.triangles);
            self.triangles.retain(|t| t[0] != GONE);
            return self.split(&wedges);
        }
        self.triangles.retain(|t| t[0] != GONE);
        let mut used: Vec<(u32, u32)> = Vec::new();
        let mut place = vec![GONE; self.vertices.len()];
        for t in &self.triangles {
            for &v in t {
                if place[v as usize] == GONE {
                    place[v as usize] = 0;
                    used.push((self.source[v as usize], v));
                }
            }
        }
        used.sort_unstable();
        let n = self.n_channels;
        let mut mesh = Mesh { n_channels: n, ..Mesh::default() };
        mesh.positions.reserve_exact(used.len());
        mesh.channels.reserve_exact(used.len() * n);
        for (new, &(_, v)) in used.iter().enumerate() {
            let v = v as usize;
            place[v] = new as u32;
            mesh.positions.push(self.vertices[v].position);
            mesh.channels.extend_from_slice(&self.channels[v * n..(v + 1) * n]);
        }
        for t in &mut self.triangles {
            *t = t.map(|v| place[v as usize]);
        }
        mesh.triangles = self.triangles;
        (mesh, used.into_iter().map(|(source, _)| source).collect())
    }
}

impl Surface {
    /// The mesh with a vertex for every wedge that is in use.
    fn split(self, wedges: &Wedges) -> (Mesh, Vec<u32>) {
        let corners = wedges.corner.iter().flatten().zip(self.triangles.iter().flatten());
        let mut used: Vec<(u32, u32, u32)> =
            corners.map(|(&w, &v)| (wedges.of(w).0, w, v)).collect();
        used.sort_unstable();
        used.dedup();
        let mut mesh = Mesh { n_channels: self.n_channels, ..Mesh::default() };
        let n_wedges = used.iter().map(|&(_, w, _)| w as usize + 1).max().unwrap_or(0);
        let mut place = vec![GONE; n_wedges];
        for (new, &(_, w, v)) in used.iter().enumerate() {
            place[w as usize] = new as u32;
            mesh.positions.push(self.vertices[v as usize].position);
            mesh.channels.extend_from_slice(wedges.of(w).1);
        }
        mesh.triangles = wedges.corner.iter().map(|t| t.map(|w| place[w as usize])).collect();
        (mesh, used.into_iter().map(|(source, ..)| source).collect())
    }
}

/// Finds the classes of all vertices; after a compaction, an interior vertex stays one.
struct Classify<'a> {
    surface: &'a mut Surface,
    again: bool,
}

impl Job for Classify<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut fan = Fan::new();
        for v in 0..self.surface.vertices.len() as u32 {
            let ring = at(&self.surface.rings, v);
            let interior = ring.class == Some(Class::Interior);
            if !(interior && (self.again || is_one_fan::<L>(self.surface, v))) {
                self.surface.classify(v, &mut fan);
            }
            if fold_quadric::may_fold(&at(&self.surface.vertices, v).quadric) {
                self.surface.hold_folds(v);
            }
        }
    }
}

/// Whether the triangles of a vertex form one closed fan; false if they are more than eight or too few to
/// tell quickly.
#[inline(always)]
fn is_one_fan<L: Lanes>(surface: &Surface, v: u32) -> bool {
    let ring = surface.ring(v);
    if ring.is_empty() || ring.len() > 8 {
        return false;
    }
    let (mut b, mut c) = ([GONE; 8], [GONE; 8]);
    for ((b, c), &t) in b.iter_mut().zip(&mut c).zip(ring) {
        (*b, *c) = others(*at(&surface.triangles, t), v);
    }
    // From triangle to triangle; a walk that is back after all of them, not earlier, has met each once.
    let (mut at, mut early) = (0, false);
    for _ in 1..ring.len() {
        at = L::matches(&b, c[at & 7]).trailing_zeros() as usize;
        early |= (at == 0) | (at > 7);
    }
    !early && L::matches(&b, c[at & 7]) & 1 == 1
}

/// The triangles of one vertex as pairs of corners; re-used from vertex to vertex.
#[derive(Clone)]
pub(crate) struct Fan {
    b: [u32; MAX_VALENCE as usize],
    c: [u32; MAX_VALENCE as usize],
    n: usize,
    /// Neighbours over open edges.
    pub(crate) ends: Vec<u32>,
}

impl Fan {
    pub(crate) fn new() -> Self {
        let none = [0; MAX_VALENCE as usize];
        Fan { b: none, c: none, n: 0, ends: Vec::new() }
    }

    /// Looks at a vertex of at most `MAX_VALENCE` triangles.
    pub(crate) fn look(&mut self, surface: &Surface, v: u32) -> Class {
        self.ends.clear();
        self.n = 0;
        for &t in surface.ring(v) {
            (self.b[self.n], self.c[self.n]) = others(surface.triangles[t as usize], v);
            self.n += 1;
        }
        let (b, c) = (&self.b[..self.n], &self.c[..self.n]);
        if b.is_empty() {
            return Class::Interior;
        }
        // A walk that comes back to its start after all triangles has met each once.
        if walk(b, c, b[0]) == (b.len(), true) {
            return Class::Interior;
        }
        let repeated = |list: &[u32]| (1..list.len()).any(|i| list[..i].contains(&list[i]));
        let mut start = None;
        for i in 0..b.len() {
            if !c.contains(&b[i]) {
                start = Some(b[i]);
                self.ends.push(b[i]);
            }
            if !b.contains(&c[i]) {
                self.ends.push(c[i]);
            }
        }
        match start {
            Some(start) if walk(b, c, start).0 == b.len() && !repeated(b) && !repeated(c) => {
                Class::Boundary
            }
            _ => Class::Complex,
        }
    }
}

/// Walks from triangle to triangle around a vertex: how many it met, and whether it came back.
fn walk(b: &[u32], c: &[u32], start: u32) -> (usize, bool) {
    let (mut at, mut seen) = (start, 0);
    while let Some(i) = b.iter().position(|&x| x == at) {
        at = c[i];
        seen += 1;
        if at == start || seen > b.len() {
            return (seen, at == start);
        }
    }
    (seen, false)
}
