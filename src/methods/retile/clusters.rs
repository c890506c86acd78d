//! Clusters of vertices that grow and shrink along their borders until none moves (Valette & Chassery 2004).
//!
//! The energy is the sum over all vertices of weight times squared distance from the centroid of their cluster: a centroidal
//! Voronoi tessellation, but on the vertices of the surface. A vertex on a border changes sides where that lowers it
//! (Hartigan 1975).

use super::refine::Surface;
use std::collections::BTreeMap;
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{Vec3, add, length_sq, scale, sub};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// No cluster.
pub(super) const NONE: u32 = u32::MAX;

/// Passes over all borders at a time, at most: the first time, and once only what was split or dissolved has to settle.
pub(super) const PASSES: u32 = 100;
pub(super) const FURTHER_PASSES: u32 = 8;
/// Passes after parts of clusters that had no connection changed hands.
pub(super) const SETTLING_PASSES: u32 = 2;
/// Passes end where fewer than one in this number of the vertices at borders has moved: more changes no angle.
const LEAST_MOVED: u64 = 1000;
/// Vertices of which a cluster can be made two.
const SPLITTABLE: u32 = 4;

/// Memory for a cluster, in bytes: its sums, and those from which its vertex is placed.
pub(super) const CLUSTER_BYTES: u64 = 8 + 24 + 4 + 4 + 8 + 192 + 48;

/// The vertices of the surface, each in a cluster.
pub(super) struct Clusters<'a> {
    surface: &'a Surface,
    pub(super) owner: Vec<u32>,
    /// Sum of the weights, and of weight times position.
    weight: Vec<f64>,
    moment: Vec<Vec3>,
    pub(super) n_vertices: Vec<u32>,
    /// The pass in which each cluster changed last.
    changed: Vec<u32>,
    pass: u32,
    /// Vertices that have a neighbour in another cluster, and some that had.
    border: Vec<u32>,
    is_border: Vec<bool>,
    /// Passes made in all.
    pub(super) n_passes: u64,
}

impl<'a> Clusters<'a> {
    pub(super) fn new(surface: &'a Surface, owner: Vec<u32>, n: usize) -> Self {
        let mut clusters = Clusters {
            surface,
            owner,
            weight: vec![0.0; n],
            moment: vec![[0.0; 3]; n],
            n_vertices: vec![0; n],
            changed: vec![0; n],
            pass: 0,
            border: Vec::new(),
            is_border: vec![false; surface.positions.len()],
            n_passes: 0,
        };
        for v in 0..clusters.owner.len() as u32 {
            let owner = clusters.owner[v as usize];
            if owner != NONE {
                clusters.owner[v as usize] = NONE;
                clusters.give(v, owner);
            }
        }
        clusters
    }

    /// Clusters, empty ones included.
    pub(super) fn len(&self) -> usize {
        self.weight.len()
    }

    pub(super) fn centroid(&self, cluster: u32) -> Vec3 {
        let c = cluster as usize;
        scale(self.moment[c], 1.0 / self.weight[c].max(f64::MIN_POSITIVE))
    }

    /// Weights of all clusters, to put them in order.
    pub(super) fn weights(&self) -> &[f64] {
        &self.weight
    }

    fn give(&mut self, v: u32, to: u32) {
        count(self.surface.neighbours(v).len());
        for &w in self.surface.neighbours(v).iter().chain(&[v]) {
            if !self.is_border[w as usize] {
                self.is_border[w as usize] = true;
                self.border.push(w);
            }
        }
        let (weight, position) = self.of(v);
        let from = std::mem::replace(&mut self.owner[v as usize], to);
        if from != NONE {
            let from = from as usize;
            self.weight[from] -= weight;
            self.moment[from] = sub(self.moment[from], scale(position, weight));
            self.n_vertices[from] -= 1;
            self.changed[from] = self.pass;
        }
        if to != NONE {
            let to = to as usize;
            self.weight[to] += weight;
            self.moment[to] = add(self.moment[to], scale(position, weight));
            self.n_vertices[to] += 1;
            self.changed[to] = self.pass;
        }
    }

    /// Weight and position of a vertex; a little weight where triangles have no area.
    fn of(&self, v: u32) -> (f64, Vec3) {
        let v = v as usize;
        (self.surface.weights[v].max(1e-30), self.surface.positions[v])
    }

    /// Moves vertices across borders until that lowers the energy nearly nowhere, in at most `passes` passes.
    pub(super) fn minimise(&mut self, passes: u32, progress: &Progress) -> Result<()> {
        for _ in 0..passes {
            progress.check()?;
            self.pass += 1;
            self.n_passes += 1;
            // Neighbours in the list are neighbours in memory.
            self.border.sort_unstable();
            count(self.border.len());
            let mut n_moved = 0u64;
            let mut border = std::mem::take(&mut self.border);
            border.retain(|&u| {
                let mut from = self.owner[u as usize];
                let around = self.surface.neighbours(u).iter();
                let is_border = around.map(|&w| self.owner[w as usize]).any(|owner| owner != from);
                if from == NONE || !is_border {
                    self.is_border[u as usize] = false;
                    return false;
                }
                for i in 0..self.surface.neighbours(u).len() {
                    let to = self.owner[self.surface.neighbours(u)[i] as usize];
                    if to == from || to == NONE || self.n_vertices[from as usize] < 2 {
                        continue;
                    }
                    let last = self.changed[from as usize].max(self.changed[to as usize]);
                    if last + 1 >= self.pass && self.gain(u, from, to) > 0.0 {
                        self.give(u, to);
                        from = to;
                        n_moved += 1;
                    }
                }
                true
            });
            border.append(&mut self.border);
            self.border = border;
            if n_moved * LEAST_MOVED <= self.border.len() as u64 {
                break;
            }
        }
        Ok(())
    }

    /// Energy that is saved if a vertex goes over, relative to its weight.
    fn gain(&self, v: u32, from: u32, to: u32) -> f64 {
        let (weight, position) = self.of(v);
        let of = self.weight[from as usize];
        let without = (of - weight).max(1e-3 * weight);
        let to_weight = self.weight[to as usize];
        let away = length_sq(sub(position, self.centroid(from)));
        let other = length_sq(sub(position, self.centroid(to)));
        // A hair more than rounding, or a vertex could go to and fro.
        of / without * away * (1.0 - 1e-12) - to_weight / (to_weight + weight) * other
    }

    /// Leaves each cluster its largest connected part; the rest goes to the neighbours. Returns how many vertices went.
    pub(super) fn connect(&mut self) -> u64 {
        let n = self.owner.len();
        let mut part = vec![NONE; n];
        let mut best: Vec<(f64, u32)> = vec![(-1.0, NONE); self.len()];
        let mut stack = Vec::new();
        for start in 0..n as u32 {
            let owner = self.owner[start as usize];
            if owner == NONE || part[start as usize] != NONE {
                continue;
            }
            let mut weight = 0.0;
            part[start as usize] = start;
            stack.push(start);
            while let Some(v) = stack.pop() {
                weight += self.of(v).0;
                for &w in self.surface.neighbours(v) {
                    if self.owner[w as usize] == owner && part[w as usize] == NONE {
                        part[w as usize] = start;
                        stack.push(w);
                    }
                }
            }
            let best = &mut best[owner as usize];
            if weight > best.0 {
                *best = (weight, start);
            }
        }
        self.pass += 1;
        let mut n_released = 0;
        for v in 0..n as u32 {
            let owner = self.owner[v as usize];
            if owner != NONE && part[v as usize] != best[owner as usize].1 {
                self.give(v, NONE);
                n_released += 1;
            }
        }
        self.grow();
        n_released
    }

    /// Gives vertices without a cluster to that of a neighbour, the nearest one, from the borders inwards.
    pub(super) fn grow(&mut self) {
        let is_free = |clusters: &Self, v: u32| clusters.owner[v as usize] == NONE;
        let mut free: Vec<u32> =
            (0..self.owner.len() as u32).filter(|&v| is_free(self, v)).collect();
        loop {
            count(free.len());
            let mut found = Vec::new();
            for &v in &free {
                let position = self.surface.positions[v as usize];
                let owners = self.surface.neighbours(v).iter().map(|&w| self.owner[w as usize]);
                let away = |c: u32| length_sq(sub(position, self.centroid(c)));
                let nearest = owners
                    .filter(|&c| c != NONE)
                    .map(|c| (away(c), c))
                    .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                if let Some((_, cluster)) = nearest {
                    found.push((v, cluster));
                }
            }
            if found.is_empty() {
                return;
            }
            found.iter().for_each(|&(v, cluster)| self.give(v, cluster));
            // All others have no more neighbours in clusters than before.
            let next = found.iter().flat_map(|&(v, _)| self.surface.neighbours(v));
            free = next.copied().filter(|&v| is_free(self, v)).collect();
            free.sort_unstable();
            free.dedup();
        }
    }

    /// Makes two of each of the clusters: around the vertex that is farthest from the centroid, and around the one
    /// farthest from that. Returns those that were large enough, and the new ones.
    pub(super) fn split(&mut self, clusters: &[u32]) -> Vec<u32> {
        self.pass += 1;
        let mut of_split = Vec::new();
        for (cluster, vertices) in self.vertices_of(clusters) {
            if self.n_vertices[cluster as usize] < SPLITTABLE {
                continue;
            }
            let farthest = |from: Vec3| {
                let away = |v: u32| length_sq(sub(self.surface.positions[v as usize], from));
                let far = vertices.iter().max_by(|a, b| away(**a).total_cmp(&away(**b)));
                far.map_or(from, |&v| self.surface.positions[v as usize])
            };
            let one = farthest(self.centroid(cluster));
            let other = farthest(one);
            let number = self.len() as u32;
            self.weight.push(0.0);
            self.moment.push([0.0; 3]);
            self.n_vertices.push(0);
            self.changed.push(self.pass);
            for &v in &vertices {
                let position = self.surface.positions[v as usize];
                if length_sq(sub(position, other)) < length_sq(sub(position, one)) {
                    self.give(v, number);
                }
            }
            of_split.extend([cluster, number]);
        }
        of_split
    }

    /// Gives the vertices of clusters to their neighbours.
    pub(super) fn dissolve(&mut self, clusters: &[u32]) {
        self.pass += 1;
        for (_, vertices) in self.vertices_of(clusters) {
            vertices.iter().for_each(|&v| self.give(v, NONE));
        }
        self.grow();
    }

    /// Vertices of some clusters, in the order of the clusters' numbers.
    fn vertices_of(&self, clusters: &[u32]) -> BTreeMap<u32, Vec<u32>> {
        let mut all: BTreeMap<u32, Vec<u32>> = clusters.iter().map(|&c| (c, Vec::new())).collect();
        for (v, owner) in self.owner.iter().enumerate() {
            if let Some(list) = all.get_mut(owner) {
                list.push(v as u32);
            }
        }
        all
    }

    /// Energy of each cluster.
    pub(super) fn energies(&self) -> Vec<f64> {
        let mut energies = vec![0.0; self.len()];
        for (v, &owner) in self.owner.iter().enumerate().filter(|(_, owner)| **owner != NONE) {
            let (weight, position) = self.of(v as u32);
            energies[owner as usize] += weight * length_sq(sub(position, self.centroid(owner)));
        }
        energies
    }
}
