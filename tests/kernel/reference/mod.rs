//! The reference simplifier: simple, slow, obviously right.
//!
//! One heap over all edges, accumulated area-weighted quadrics, optimal placement with regularisation
//! about the edge midpoint, hard checks. Tests and `tools/bench` compare the production kernel with it; it shares no code with
//! it. Roughly 600 bytes and 4 microseconds a triangle.
//!
//! Source: Garland & Heckbert 1997; boundary planes as there, section 6 (docs/references.md).

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeSet, BinaryHeap};

mod legality;
mod vec3;

use legality::{Class, MAY_COLLAPSE, Reject, RejectCounts};
use stonecut::Mesh;
use stonecut::kernel::{Options, Simplified, Statistics, Stop};
use vec3::{Vec3, add, along, cross, dot, length_sq, normal, scale, sub};

/// Share of the trace added to the diagonal when the best position is solved for.
const REGULARISATION: f64 = 3e-5;
/// Weight of a boundary edge's plane, times its squared length.
const BOUNDARY_WEIGHT: f64 = 3.0;
/// A collapse may turn no normal further than this cosine.
const FLIP_COSINE: f64 = 0.2;

/// Weighted squared distance to a set of planes: x^T a x + 2 b x + c, x relative to an origin that its
/// owner knows. `a` holds xx, xy, xz, yy, yz, zz.
#[derive(Clone, Copy, Default)]
struct Quadric {
    a: [f64; 6],
    b: Vec3,
    c: f64,
}

impl Quadric {
    /// Of a plane with unit normal `n` through the point `through`.
    fn plane(n: Vec3, through: Vec3, weight: f64) -> Self {
        let d = -dot(n, through);
        let a = [n[0] * n[0], n[0] * n[1], n[0] * n[2], n[1] * n[1], n[1] * n[2], n[2] * n[2]];
        Quadric { a: a.map(|x| x * weight), b: scale(n, d * weight), c: d * d * weight }
    }

    fn plus(self, other: Quadric) -> Self {
        Quadric {
            a: std::array::from_fn(|i| self.a[i] + other.a[i]),
            b: add(self.b, other.b),
            c: self.c + other.c,
        }
    }

    fn times(&self, x: Vec3) -> Vec3 {
        let a = &self.a;
        [
            a[0] * x[0] + a[1] * x[1] + a[2] * x[2],
            a[1] * x[0] + a[3] * x[1] + a[4] * x[2],
            a[2] * x[0] + a[4] * x[1] + a[5] * x[2],
        ]
    }

    /// The same planes seen from an origin moved by `by`.
    fn moved(self, by: Vec3) -> Self {
        Quadric { a: self.a, b: add(self.b, self.times(by)), c: self.at(by) }
    }

    fn at(&self, x: Vec3) -> f64 {
        (dot(x, self.times(x)) + 2.0 * dot(self.b, x) + self.c).max(0.0)
    }

    /// The point of least value, held near the origin where the planes leave it undetermined.
    fn minimum(&self) -> Option<Vec3> {
        let lift = REGULARISATION * (self.a[0] + self.a[3] + self.a[5]);
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let rows = [[xx + lift, xy, xz], [xy, yy + lift, yz], [xz, yz, zz + lift]];
        let c0 = cross(rows[1], rows[2]);
        let det = dot(rows[0], c0);
        if det.is_nan() || det <= 0.0 || det.is_infinite() {
            return None;
        }
        let inverse = [c0, cross(rows[2], rows[0]), cross(rows[0], rows[1])];
        let x = scale(
            [dot(inverse[0], self.b), dot(inverse[1], self.b), dot(inverse[2], self.b)],
            -1.0 / det,
        );
        x.iter().all(|c| c.is_finite()).then_some(x)
    }
}

/// An edge in the heap; `versions` tells whether it is still what was evaluated.
#[derive(PartialEq)]
struct Entry {
    cost: f64,
    v0: u32,
    v1: u32,
    versions: [u32; 2],
}

impl Eq for Entry {}
impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost.total_cmp(&other.cost).then((self.v0, self.v1).cmp(&(other.v0, other.v1)))
    }
}

struct Reference<'a> {
    mesh: Mesh,
    locked: &'a [bool],
    alive: Vec<bool>,
    n_alive: u64,
    ring: Vec<Vec<u32>>,
    class: Vec<Class>,
    /// Relative to the position of its vertex.
    quadrics: Vec<Quadric>,
    versions: Vec<u32>,
    heap: BinaryHeap<Reverse<Entry>>,
    rejects: RejectCounts,
    collapses: u64,
}

/// Simplifies as `super::simplify_mesh` does, but slowly; same contract.
pub fn simplify_mesh(mesh: Mesh, locked: &[bool], options: &Options) -> Simplified {
    let mut work = Reference::new(mesh, locked);
    let mut statistics = Statistics::default();
    match &options.stop {
        Stop::Triangles(target) => {
            work.drain(f64::INFINITY, *target);
            statistics.reached = work.n_alive <= *target;
        }
        Stop::Costs(levels) | Stop::CloseCosts(levels) => {
            for &level in levels {
                work.drain(level, 0);
                statistics.level_counts.push(work.n_alive);
            }
            statistics.reached = true;
        }
        Stop::Free { cost, triangles } => {
            work.drain(*cost, *triangles);
            statistics.reached = true;
        }
    }
    statistics.collapses = work.collapses;
    statistics.rejects = work.rejects.named();
    let kept = work.alive.iter();
    work.mesh.triangles = work
        .mesh
        .triangles
        .iter()
        .zip(kept)
        .filter(|&(_, &alive)| alive)
        .map(|(&t, _)| t)
        .collect();
    let (mesh, source) = compact(work.mesh);
    Simplified { mesh, source, statistics, ..Simplified::default() }
}

impl<'a> Reference<'a> {
    fn new(mut mesh: Mesh, locked: &'a [bool]) -> Self {
        mesh.triangles.retain(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
        let n_vertices = mesh.positions.len();
        let mut ring = vec![Vec::new(); n_vertices];
        for (id, triangle) in mesh.triangles.iter().enumerate() {
            for &v in triangle {
                ring[v as usize].push(id as u32);
            }
        }
        let n_alive = mesh.triangles.len();
        let mut work = Reference {
            alive: vec![true; n_alive],
            n_alive: n_alive as u64,
            ring,
            class: vec![Class::Interior; n_vertices],
            quadrics: vec![Quadric::default(); n_vertices],
            versions: vec![0; n_vertices],
            heap: BinaryHeap::new(),
            rejects: RejectCounts::default(),
            collapses: 0,
            mesh,
            locked,
        };
        for v in 0..n_vertices as u32 {
            work.class[v as usize] = work.classify(v);
        }
        work.add_quadrics();
        for v in 0..n_vertices as u32 {
            for w in work.neighbours(v).into_iter().filter(|&w| w > v) {
                work.push(v, w);
            }
        }
        work
    }

    fn neighbours(&self, v: u32) -> BTreeSet<u32> {
        let corners = self.ring[v as usize].iter().flat_map(|&t| self.mesh.triangles[t as usize]);
        corners.filter(|&w| w != v).collect()
    }

    /// Triangles that hold both vertices.
    fn shared(&self, v: u32, w: u32) -> Vec<u32> {
        let ring = self.ring[v as usize].iter().copied();
        ring.filter(|&t| self.mesh.triangles[t as usize].contains(&w)).collect()
    }

    fn classify(&self, v: u32) -> Class {
        if self.locked[v as usize] {
            return Class::Locked;
        }
        let ring = &self.ring[v as usize];
        let (mut open, mut many) = (0, false);
        for w in self.neighbours(v) {
            match self.shared(v, w).len() {
                1 => open += 1,
                2 => {}
                _ => many = true,
            }
        }
        // Every fan of a vertex without non-manifold edges is either closed or has two open edges.
        // One fan is reached whole by walking from triangle to triangle over edges at `v`.
        let mut fan: Vec<u32> = ring.first().copied().into_iter().collect();
        let mut next = 0;
        while next < fan.len() {
            let at = self.mesh.triangles[fan[next] as usize];
            for w in at.into_iter().filter(|&w| w != v) {
                for t in self.shared(v, w) {
                    if !fan.contains(&t) {
                        fan.push(t);
                    }
                }
            }
            next += 1;
        }
        match (many || fan.len() != ring.len(), open) {
            (true, _) => Class::Complex,
            (false, 0) => Class::Interior,
            _ => Class::Boundary,
        }
    }

    fn add_quadrics(&mut self) {
        for id in 0..self.mesh.triangles.len() {
            let triangle = self.mesh.triangles[id];
            let corners = self.mesh.corners(id);
            let n = normal(corners);
            let double_area = length_sq(n).sqrt();
            if double_area.is_nan() || double_area <= 0.0 {
                continue;
            }
            let unit = scale(n, 1.0 / double_area);
            for (corner, &v) in triangle.iter().enumerate() {
                let plane = Quadric::plane(unit, [0.0; 3], double_area * 0.5);
                self.quadrics[v as usize] = self.quadrics[v as usize].plus(plane);
                let w = triangle[(corner + 1) % 3];
                if self.shared(v, w).len() == 1 {
                    let edge = sub(corners[(corner + 1) % 3], corners[corner]);
                    let across = cross(edge, unit);
                    let across_length = length_sq(across).sqrt();
                    if across_length > 0.0 {
                        let weight = BOUNDARY_WEIGHT * length_sq(edge);
                        let across = scale(across, 1.0 / across_length);
                        let plane = Quadric::plane(across, [0.0; 3], weight);
                        self.quadrics[v as usize] = self.quadrics[v as usize].plus(plane);
                        self.quadrics[w as usize] = self.quadrics[w as usize].plus(plane);
                    }
                }
            }
        }
    }

    /// Which end goes, which stays, where the survivor is put, and at what cost.
    fn plan(&self, a: u32, b: u32) -> Result<(u32, u32, Vec3, f64), Reject> {
        let (low, high) = (a.min(b), a.max(b));
        // The lower class goes into the higher one; between equals the lower id stays.
        let goes_low = self.class[low as usize] < self.class[high as usize];
        let (v0, v1) = if goes_low { (low, high) } else { (high, low) };
        let (class0, class1) = (self.class[v0 as usize], self.class[v1 as usize]);
        MAY_COLLAPSE[class0 as usize][class1 as usize]?;
        let (p0, p1) = (self.mesh.positions[v0 as usize], self.mesh.positions[v1 as usize]);
        let half = scale(sub(p1, p0), 0.5);
        // Both quadrics as seen from the midpoint.
        let both = self.quadrics[v0 as usize].moved(half);
        let both = both.plus(self.quadrics[v1 as usize].moved(scale(half, -1.0)));
        if class1.is_fixed() {
            return Ok((v0, v1, p1, both.at(half)));
        }
        let place = both.minimum().unwrap_or([0.0; 3]);
        Ok((v0, v1, add(add(p0, half), place), both.at(place)))
    }

    fn push(&mut self, a: u32, b: u32) {
        match self.plan(a, b) {
            Ok((v0, v1, _, cost)) => {
                let versions = [self.versions[v0 as usize], self.versions[v1 as usize]];
                self.heap.push(Reverse(Entry { cost, v0, v1, versions }));
            }
            Err(reason) => self.rejects.add(reason),
        }
    }

    /// Collapses the cheapest edges until the next would cost more, or few enough triangles are left.
    fn drain(&mut self, level: f64, target: u64) {
        while self.n_alive > target {
            let Some(Reverse(entry)) = self.heap.peek() else { return };
            if entry.cost > level {
                return;
            }
            let Some(Reverse(entry)) = self.heap.pop() else { return };
            let (v0, v1) = (entry.v0, entry.v1);
            if [self.versions[v0 as usize], self.versions[v1 as usize]] != entry.versions {
                continue;
            }
            match self.plan(v0, v1) {
                Ok((_, _, place, _)) => match self.legal(v0, v1, place) {
                    Ok(()) => self.collapse(v0, v1, place),
                    Err(reason) => self.rejects.add(reason),
                },
                Err(reason) => self.rejects.add(reason),
            }
        }
    }

    fn legal(&self, v0: u32, v1: u32, place: Vec3) -> Result<(), Reject> {
        let edge = self.shared(v0, v1);
        let opposite: BTreeSet<u32> = edge
            .iter()
            .flat_map(|&t| self.mesh.triangles[t as usize])
            .filter(|&w| w != v0 && w != v1)
            .collect();
        if edge.is_empty() || edge.len() > 2 {
            return Err(Reject::NonManifold);
        }
        if opposite.len() != edge.len() {
            return Err(Reject::LinkCondition);
        }
        let (near0, near1) = (self.neighbours(v0), self.neighbours(v1));
        if near0.intersection(&near1).copied().collect::<BTreeSet<_>>() != opposite {
            return Err(Reject::LinkCondition);
        }
        // The same edge opposite to both ends: the collapse would fold two triangles onto each other.
        let far = |v: u32, t: u32| {
            let mut pair: Vec<u32> =
                self.mesh.triangles[t as usize].into_iter().filter(|&w| w != v).collect();
            pair.sort_unstable();
            pair
        };
        let far0: BTreeSet<Vec<u32>> = self.ring[v0 as usize].iter().map(|&t| far(v0, t)).collect();
        if self.ring[v1 as usize].iter().any(|&t| far0.contains(&far(v1, t))) {
            return Err(Reject::LinkCondition);
        }
        // An inner edge between two boundaries is a bridge; a lone triangle would vanish.
        let (class0, class1) = (self.class[v0 as usize], self.class[v1 as usize]);
        if edge.len() == 2 && class0 == Class::Boundary && self.is_open(v1) {
            return Err(Reject::Boundary);
        }
        if opposite.iter().any(|&w| self.ring[w as usize].len() == 1) {
            return Err(Reject::Boundary);
        }
        if class1 == Class::Locked {
            let new = near0.iter().filter(|&&w| w != v1 && !near1.contains(&w));
            if new.clone().any(|&w| self.locked[w as usize]) {
                return Err(Reject::Locked);
            }
        }
        for (v, other) in [(v0, v1), (v1, v0)] {
            for &t in &self.ring[v as usize] {
                let triangle = self.mesh.triangles[t as usize];
                if triangle.contains(&other) {
                    continue;
                }
                let before = self.mesh.corners(t as usize);
                let corner = |i: usize| if triangle[i] == v { place } else { before[i] };
                let (old, new) = (normal(before), normal([corner(0), corner(1), corner(2)]));
                let limit = FLIP_COSINE * (length_sq(old) * length_sq(new)).sqrt();
                let kept = dot(old, new) > limit;
                if length_sq(old) > 0.0 && !kept {
                    return Err(Reject::Flip);
                }
            }
        }
        Ok(())
    }

    /// Whether an open edge meets the vertex, locked or not.
    fn is_open(&self, v: u32) -> bool {
        self.neighbours(v).into_iter().any(|w| self.shared(v, w).len() == 1)
    }

    fn collapse(&mut self, v0: u32, v1: u32, place: Vec3) {
        let (i0, i1) = (v0 as usize, v1 as usize);
        let (p0, p1) = (self.mesh.positions[i0], self.mesh.positions[i1]);
        if !self.class[i1].is_fixed() {
            let t = along(place, p0, p1) as f32;
            let n = self.mesh.n_channels;
            for channel in 0..n {
                let (c0, c1) =
                    (self.mesh.channels[i0 * n + channel], self.mesh.channels[i1 * n + channel]);
                self.mesh.channels[i1 * n + channel] = c0 + t * (c1 - c0);
            }
            self.mesh.positions[i1] = place;
        }
        let moved = |q: &Quadric, p: Vec3| q.moved(sub(place, p));
        self.quadrics[i1] = moved(&self.quadrics[i0], p0).plus(moved(&self.quadrics[i1], p1));
        for t in std::mem::take(&mut self.ring[i0]) {
            let triangle = &mut self.mesh.triangles[t as usize];
            if triangle.contains(&v1) {
                for &w in triangle.iter() {
                    self.ring[w as usize].retain(|&other| other != t);
                }
                self.alive[t as usize] = false;
                self.n_alive -= 1;
            } else {
                *triangle = triangle.map(|w| if w == v0 { v1 } else { w });
                self.ring[i1].push(t);
            }
        }
        self.versions[i0] += 1;
        self.versions[i1] += 1;
        self.collapses += 1;
        self.class[i1] = self.classify(v1);
        for w in self.neighbours(v1) {
            self.class[w as usize] = self.classify(w);
        }
        // What was refused around here may be legal now, so the whole ring is looked at anew.
        for w in self.neighbours(v1) {
            self.push(v1, w);
        }
    }
}

/// Drops vertices that no triangle uses; the second value tells where each kept vertex was.
fn compact(mesh: Mesh) -> (Mesh, Vec<u32>) {
    const UNUSED: u32 = u32::MAX;
    let mut place = vec![UNUSED; mesh.positions.len()];
    for triangle in &mesh.triangles {
        for &v in triangle {
            place[v as usize] = 0;
        }
    }
    let mut source = Vec::new();
    for (v, place) in place.iter_mut().enumerate().filter(|(_, place)| **place != UNUSED) {
        *place = source.len() as u32;
        source.push(v as u32);
    }
    let compacted = Mesh {
        positions: source.iter().map(|&v| mesh.positions[v as usize]).collect(),
        channels: source.iter().flat_map(|&v| mesh.channels_of(v).iter().copied()).collect(),
        n_channels: mesh.n_channels,
        triangles: mesh.triangles.iter().map(|t| t.map(|v| place[v as usize])).collect(),
        ..Mesh::default()
    };
    (compacted, source)
}
