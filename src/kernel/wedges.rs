//! Attribute seams: one place, several values.
//!
//! A scan that was split along texture seams has several vertices in one place, each with the values of its
//! own chart. `weld` makes them one vertex of the surface; what they carry stays apart here, as *wedges*, and
//! every corner of a triangle names the wedge it uses. So a collapse moves all sides of a seam together, no
//! crack can open, and no value is mixed with that of another chart: where both ends of the edge have a
//! wedge of the same chart, the two become one, interpolated along the edge; any other keeps its value.
//! A channel in which all wedges of both ends agree (a colour beside the texture) knows no seam and is
//! interpolated for all of them.
//! Such a collapse is in `seam_collapse`; the result is split again by `Surface::into_mesh`.

mod seam_collapse;

use std::collections::BTreeMap;

use super::surface::{GONE, Surface};

pub(crate) use seam_collapse::place_on_edge;

/// The wedges of a surface: 12 bytes a triangle, 4 a channel and input vertex, 9 an input vertex.
pub(crate) struct Wedges {
    /// For each triangle the wedges of its corners.
    pub(crate) corner: Vec<[u32; 3]>,
    /// Channels of each wedge; those of a vertex with a single wedge are the surface's, too.
    values: Vec<f32>,
    /// Input vertex of each wedge.
    source: Vec<u32>,
    /// Whether a vertex has several wedges.
    is_seam: Vec<bool>,
    n_channels: usize,
    /// The channel that tells regions apart, whose borders are kept as boundaries are.
    pub(crate) region: Option<usize>,
    /// What any other seam counts against that.
    pub(crate) seam_share: f64,
    /// For each wedge one of its chart, the same for all of them.
    chart: Vec<u32>,
    n_charts: u64,
}

impl Wedges {
    /// Wedges of a surface that is about to be welded: each vertex is its own.
    pub(crate) fn new(surface: &Surface) -> Wedges {
        Wedges {
            corner: surface.triangles.clone(),
            values: surface.channels.clone(),
            source: surface.source.clone(),
            is_seam: Vec::new(),
            n_channels: surface.n_channels,
            region: None,
            seam_share: 0.0,
            chart: Vec::new(),
            n_charts: 0,
        }
    }

    /// Finds the charts: wedges that triangles connect.
    pub(crate) fn find_charts(&mut self, triangles: &[[u32; 3]]) {
        fn first(chart: &mut [u32], mut wedge: u32) -> u32 {
            while chart[wedge as usize] != wedge {
                let next = chart[chart[wedge as usize] as usize];
                chart[wedge as usize] = next;
                wedge = next;
            }
            wedge
        }
        let mut chart: Vec<u32> = (0..self.source.len() as u32).collect();
        let alive = self.corner.iter().zip(triangles).filter(|(_, t)| t[0] != GONE);
        for (&[a, b, c], _) in alive {
            for (a, b) in [(a, b), (b, c)] {
                let (a, b) = (first(&mut chart, a), first(&mut chart, b));
                chart[a.max(b) as usize] = a.min(b);
            }
        }
        for wedge in 0..chart.len() as u32 {
            chart[wedge as usize] = first(&mut chart, wedge);
        }
        self.chart = chart;
        self.n_charts = self.count_charts(triangles);
    }

    /// Charts that still have a triangle.
    fn count_charts(&self, triangles: &[[u32; 3]]) -> u64 {
        let mut is_there = vec![false; self.source.len()];
        for (corner, t) in self.corner.iter().zip(triangles) {
            if t[0] != GONE {
                is_there[self.chart[corner[0] as usize] as usize] = true;
            }
        }
        is_there.iter().filter(|there| **there).count() as u64
    }

    /// Charts whose last triangle has gone.
    pub(crate) fn n_charts_vanished(&self, triangles: &[[u32; 3]]) -> u64 {
        self.n_charts.saturating_sub(self.count_charts(triangles))
    }

    /// How many vertices are on seams.
    pub(crate) fn n_seam_vertices(&self, surface: &Surface) -> u64 {
        let vertices = self.is_seam.iter().zip(&surface.rings);
        vertices.filter(|(is_seam, ring)| **is_seam && ring.class.is_some() && ring.len > 0).count()
            as u64
    }

    /// Makes one of wedges that are to be joined and have the same confined values; lowest first.
    pub(crate) fn join_equal(&mut self, join: &BTreeMap<u32, u32>, confined: &[bool]) {
        let alike = |a: &[f32], b: &[f32]| {
            let mut pairs = a.iter().zip(b).zip(confined);
            pairs.all(|((a, b), confined)| !confined || a.to_bits() == b.to_bits())
        };
        // Groups by the vertex they are joined into, in ascending order of it.
        let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (&v, &into) in join {
            groups.entry(into).or_insert_with(|| vec![into]).push(v);
        }
        let mut same: BTreeMap<u32, u32> = BTreeMap::new();
        for group in groups.values() {
            for (i, &v) in group.iter().enumerate() {
                let equal = |&&w: &&u32| alike(self.values_of(w), self.values_of(v));
                if let Some(&first) = group[..i].iter().find(equal) {
                    same.insert(v, first);
                }
            }
        }
        for corner in self.corner.iter_mut().flatten() {
            *corner = same.get(corner).copied().unwrap_or(*corner);
        }
    }

    /// The wedge that triangle `t` uses at its corner `v`.
    #[inline(always)]
    fn at(&self, surface: &Surface, t: u32, v: u32) -> u32 {
        let corners = surface.triangles[t as usize];
        let k = usize::from(corners[1] == v) + 2 * usize::from(corners[2] == v);
        self.corner[t as usize][k.min(2)]
    }

    /// Channels at corner `v` of triangle `t`.
    #[inline(always)]
    pub(crate) fn values_at<'a>(&'a self, surface: &'a Surface, t: u32, v: u32) -> &'a [f32] {
        if self.is_seam[v as usize] {
            self.values_of(self.at(surface, t, v))
        } else {
            surface.channels_of(v)
        }
    }

    fn values_of(&self, wedge: u32) -> &[f32] {
        &self.values[wedge as usize * self.n_channels..][..self.n_channels]
    }

    /// Whether a collapse has to do with a seam.
    #[inline(always)]
    pub(crate) fn concern(&self, v0: u32, v1: u32) -> bool {
        self.is_seam[v0 as usize] || self.is_seam[v1 as usize]
    }

    /// Whether a vertex is on a seam.
    #[inline(always)]
    pub(crate) fn is_seam(&self, v: u32) -> bool {
        self.is_seam[v as usize]
    }

    /// Drops the corners of triangles that are gone, before the triangles themselves are dropped.
    pub(crate) fn retain(&mut self, triangles: &[[u32; 3]]) {
        let mut gone = triangles.iter().map(|t| t[0] == GONE);
        self.corner.retain(|_| gone.next() == Some(false));
    }

    /// Finds out anew which vertices are on seams; after vertices or triangles have got new numbers.
    pub(crate) fn find_seams(&mut self, surface: &Surface) {
        const NONE: u32 = u32::MAX;
        let mut first = vec![NONE; surface.vertices.len()];
        let mut is_seam = vec![false; surface.vertices.len()];
        for (t, corner) in surface.triangles.iter().zip(&self.corner) {
            for (&v, &w) in t.iter().zip(corner) {
                let first = &mut first[v as usize];
                if *first == NONE {
                    *first = w;
                }
                is_seam[v as usize] |= *first != w;
            }
        }
        self.is_seam = is_seam;
    }

    /// The wedge of a vertex off the seams (one of them of a vertex on a seam).
    pub(crate) fn single(&self, surface: &Surface, v1: u32) -> Option<u32> {
        surface.ring(v1).first().map(|&t| self.at(surface, t, v1))
    }

    /// Takes over the surface's values for a vertex off the seams.
    pub(crate) fn set_single(&mut self, surface: &Surface, v: u32) {
        if let (false, Some(wedge)) = (self.is_seam(v), self.single(surface, v)) {
            self.rename(surface, &[], v, wedge);
        }
    }

    /// After a collapse off the seams: the triangles that came from `v0` use the wedge of `v1`, which has
    /// the surface's new values.
    pub(crate) fn rename(&mut self, surface: &Surface, triangles: &[u32], v1: u32, wedge: u32) {
        let at = wedge as usize * self.n_channels;
        self.values[at..at + self.n_channels].copy_from_slice(surface.channels_of(v1));
        for &t in triangles {
            let corners = surface.triangles[t as usize];
            for (corner, &v) in self.corner[t as usize].iter_mut().zip(&corners) {
                if v == v1 {
                    *corner = wedge;
                }
            }
        }
    }

<<<<<<< HEAD
    /// Puts in cost and place of those of eight edges that have to do with a seam.
    #[inline(never)]
    pub(crate) fn correct(
        &self,
        surface: &Surface,
        v0: &[u32; 8],
        v1: &[u32; 8],
        fixed: &[f32; 8],
        found: &mut Evaluated,
    ) {
        let active = surface.attributes.as_ref().map_or(&[][..], |a| a.active());
        for i in 0..8 {
            if self.concern(v0[i], v1[i]) {
                let (cost, place) = self.evaluate(surface, (v0[i], v1[i]), fixed[i] > 0.0, active);
                found.cost[i] = cost;
                (0..3).for_each(|k| found.place[k][i] = place[k]);
            }
        }
    }

    /// Cost and place (relative to the edge's midpoint) of a collapse at a seam: the best place on the edge
    /// itself. `active` are the channels that count, with their factors.
    fn evaluate(
        &self,
        surface: &Surface,
        (v0, v1): (u32, u32),
        fixed: bool,
        active: &[(usize, f32)],
    ) -> (f32, [f32; 3]) {
        let pairs = Pairs::of(self, surface, v0, v1);
        let half = surface.edge(v0, v1).map(|x| 0.5 * f64::from(x));
        let half_f32 = half.map(|x| x as f32);
        // A seam that ends at v0 may only become shorter by going to v0.
        if (pairs.splits && fixed) || pairs.n == 0 {
            return (f32::INFINITY, half_f32);
        }
        let edge = half.map(|x| 2.0 * x);
        // Quadratic in the place on the edge, 0 at v0 and 1 at v1: c0 + 2 c1 s + c2 s^2.
        let geometric = |v: u32| {
            let q = surface.vertices[v as usize].quadric.map(f64::from);
            let product = [
                q[0] * edge[0] + q[1] * edge[1] + q[2] * edge[2],
                q[1] * edge[0] + q[3] * edge[1] + q[4] * edge[2],
                q[2] * edge[0] + q[4] * edge[1] + q[5] * edge[2],
            ];
            (dot(edge, product), q[0] + q[3] + q[5])
        };
        let ((along0, area0), (along1, area1)) = (geometric(v0), geometric(v1));
        let mut c = [along1, -along1, along0 + along1];
        let mut common = [None; MAX_WEIGHTED];
        for (common, &(channel, _)) in common.iter_mut().zip(active) {
            let ends = [v0, v1].map(|v| self.common(surface, v, channel));
            *common = ends[0].zip(ends[1]).map(|(a, b)| [a, b]);
        }
        for (end, v) in [v0, v1].into_iter().enumerate() {
            for &t in surface.ring(v) {
                self.add_triangle(surface, (t, v, end), (&pairs, edge), (active, &common), &mut c);
            }
            if self.is_seam[v as usize] {
                let away = self.border_cost(surface, v, edge);
                match end {
                    0 => c[2] += away,
                    _ => c = [c[0] + away, c[1] - away, c[2] + away],
                }
            }
        }
        let free = if c[2] > 0.0 { (-c[1] / c[2]).clamp(0.0, 1.0) } else { 0.5 };
        let s = match (fixed || pairs.joins, pairs.splits) {
            (true, _) => 1.0,
            (_, true) => 0.0,
            _ => free,
        };
        let floor = (area0 + area1) * length_sq(half) * LENGTH_COST;
        let cost = (c[0] + s * (2.0 * c[1] + s * c[2])).max(0.0) + floor;
        // NaN is no cost.
        let cost = if cost < f64::from(f32::MAX) { cost as f32 } else { f32::INFINITY };
        let place = match s {
            1.0 => half_f32,
            0.0 => half_f32.map(|x| -x),
            _ => half.map(|x| ((2.0 * s - 1.0) * x) as f32),
        };
        (cost, place)
    }

    /// What it costs to take `v` from the seams that end there by the vector `way`: squared length times
    /// squared distance for each, as at a boundary of the surface; less where it is no border of a region.
    fn border_cost(&self, surface: &Surface, v: u32, way: [f64; 3]) -> f64 {
        let ring = surface.ring(v);
        let region = |w: u32| self.region.map(|channel| self.values_of(w)[channel].to_bits());
        let share = |a: u32, b: u32| match a == b {
            true => 0.0,
            false if region(a) != region(b) => 1.0,
            false => self.seam_share,
        };
        let mut cost = 0.0;
        for &t in ring {
            let (b, _) = others(surface.triangles[t as usize], v);
            let is_next = |n: &&u32| others(surface.triangles[**n as usize], v).1 == b;
            let Some(&next) = ring.iter().find(is_next) else { continue };
            let share = share(self.at(surface, t, v), self.at(surface, next, v));
            if share > 0.0 {
                let q = boundary_quadric(surface.edge(v, b)).map(f64::from);
                let product = [
                    q[0] * way[0] + q[1] * way[1] + q[2] * way[2],
                    q[1] * way[0] + q[3] * way[1] + q[4] * way[2],
                    q[2] * way[0] + q[4] * way[1] + q[5] * way[2],
                ];
                cost += share * dot(way, product);
            }
        }
        cost
    }

    /// Adds area times squared difference between what a triangle says of a place on the edge and what its
    /// corner's wedge will say.
    fn add_triangle(
        &self,
        surface: &Surface,
        (t, v, end): (u32, u32, usize),
        (pairs, edge): (&Pairs, [f64; 3]),
        (active, common): (&[(usize, f32)], &[CommonEnds]),
        c: &mut [f64; 3],
    ) {
        let (b, d) = others(surface.triangles[t as usize], v);
        let (to_b, to_d) = (surface.edge(v, b).map(f64::from), surface.edge(v, d).map(f64::from));
        let n = cross(to_b, to_d);
        let double_area = length_sq(n).sqrt();
        let edges_sq = length_sq(to_b) + length_sq(to_d) + length_sq(sub(to_d, to_b));
        let below = length_sq(n).max(edges_sq * edges_sq * LEAST_SHAPE_SQ);
        // NaN is no triangle either.
        if below <= 0.0 || below.is_nan() {
            return;
        }
        // What one unit of step at b, and at d, is worth along the whole edge.
        let (at_b, at_d) = (dot(cross(to_d, n), edge) / below, dot(cross(n, to_b), edge) / below);
        let own = self.values_at(surface, t, v);
        let (values_b, values_d) = (self.values_at(surface, t, b), self.values_at(surface, t, d));
        let wedge = self.at(surface, t, v);
        let pair = if end == 0 { pairs.of_v0(wedge) } else { pairs.of_v1(wedge) };
        let other = pair.map(|(w0, w1)| match end {
            0 => self.values_of(w1),
            _ => self.values_of(w0),
        });
        for (&(channel, factor), common) in active.iter().zip(common) {
            let value = |list: &[f32]| f64::from(list[channel]) * f64::from(factor);
            let here = value(own);
            let per_edge = at_b * (value(values_b) - here) + at_d * (value(values_d) - here);
            let step = match (common, other) {
                (Some(ends), _) => f64::from(ends[1 - end]) * f64::from(factor) - here,
                (None, Some(other)) => value(other) - here,
                (None, None) => 0.0,
            };
            // The residual at either end of the edge.
            let [r0, r1] = match end {
                0 => [0.0, per_edge - step],
                _ => [-per_edge - step, 0.0],
            };
            let area = 0.5 * double_area;
            c[0] += area * r0 * r0;
            c[1] += area * r0 * (r1 - r0);
            c[2] += area * (r1 - r0) * (r1 - r0);
        }
    }

    /// What a collapse at a seam will do, before it is carried out; `s` is its place on the edge, 0 at `v0`.
    pub(crate) fn plan(&self, surface: &Surface, (v0, v1): (u32, u32), s: f32) -> SeamPlan {
        let pairs = Pairs::of(self, surface, v0, v1);
        let mix = |a: f32, b: f32| match s {
            1.0 => b,
            0.0 => a,
            _ => a + s * (b - a),
        };
        let common: Vec<Option<f32>> = (0..self.n_channels)
            .map(|channel| {
                let ends = [v0, v1].map(|v| self.common(surface, v, channel));
                ends[0].zip(ends[1]).map(|(a, b)| mix(a, b))
            })
            .collect();
        let mut values: Vec<(u32, Vec<f32>)> = Vec::new();
        let after0 = surface.ring(v0).iter().map(|&t| {
            let wedge = self.at(surface, t, v0);
            pairs.of_v0(wedge).map_or(wedge, |pair| pair.1)
        });
        for wedge in after0.chain(surface.ring(v1).iter().map(|&t| self.at(surface, t, v1))) {
            if values.iter().any(|(known, _)| *known == wedge) {
                continue;
            }
            let own = self.values_of(wedge);
            let from = pairs.of_v1(wedge).map(|pair| self.values_of(pair.0));
            let value = |channel: usize| match (common[channel], from) {
                (Some(value), _) => value,
                (None, Some(from)) => mix(from[channel], own[channel]),
                (None, None) => own[channel],
            };
            values.push((wedge, (0..self.n_channels).map(value).collect()));
        }
        SeamPlan { pairs, values }
    }

    /// The value of a channel that all wedges of a vertex have in common, if they do.
    fn common(&self, surface: &Surface, v: u32, channel: usize) -> Option<f32> {
        let ring = surface.ring(v);
        let value = |&t: &u32| self.values_of(self.at(surface, t, v))[channel];
        let first = value(ring.first()?);
        let same =
            !self.is_seam[v as usize] || ring.iter().all(|t| value(t).to_bits() == first.to_bits());
        same.then_some(first)
    }

    /// After the collapse: renames the corners that came from `v0` (those of `triangles`), and sets values.
    pub(crate) fn carry_out(
        &mut self,
        surface: &mut Surface,
        triangles: &[u32],
        v1: u32,
        plan: SeamPlan,
    ) {
        for (wedge, values) in plan.values {
            let at = wedge as usize * self.n_channels;
            self.values[at..at + self.n_channels].copy_from_slice(&values);
        }
        for &t in triangles {
            let corners = surface.triangles[t as usize];
            for (corner, &v) in self.corner[t as usize].iter_mut().zip(&corners) {
                if let (true, Some((_, new))) = (v == v1, plan.pairs.of_v0(*corner)) {
                    *corner = new;
                }
            }
        }
        self.look_again(surface, v1);
        // Charts may have vanished from the third corners, too.
        let around: Vec<u32> = surface.ring(v1).to_vec();
        for t in around {
            let (b, c) = others(surface.triangles[t as usize], v1);
            for w in [b, c] {
                if self.is_seam[w as usize] {
                    self.look_again(surface, w);
                }
            }
        }
    }

    /// Whether `v` still has several wedges; if not, their values become the surface's.
    fn look_again(&mut self, surface: &mut Surface, v: u32) {
        let Some(first) = self.single(surface, v) else { return };
        let ring = surface.ring(v);
        // Wedges that have come to the same values are one: the seam is closed there.
        let mut kept: Vec<u32> = Vec::new();
        for &t in ring {
            let wedge = self.at(surface, t, v);
            let own = self.values_of(wedge);
            match kept.iter().find(|&&w| w == wedge || self.values_of(w) == own).copied() {
                None => kept.push(wedge),
                Some(same) if same != wedge => {
                    let k = surface.triangles[t as usize].iter().position(|&x| x == v);
                    self.corner[t as usize][k.unwrap_or(0)] = same;
                }
                Some(_) => {}
            }
        }
        self.is_seam[v as usize] = ring.iter().any(|&t| self.at(surface, t, v) != first);
        if !self.is_seam[v as usize] {
            let at = v as usize * surface.n_channels;
            surface.channels[at..at + self.n_channels].copy_from_slice(self.values_of(first));
        }
    }

=======
>>>>>>> main
    /// New wedges for vertices that a cut adds to the surface, off the seams: with the values of `like`.
    pub(crate) fn add(&mut self, surface: &Surface, like: u32, source: u32) -> u32 {
        self.values.extend_from_slice(surface.channels_of(like));
        self.source.push(source);
        let chart = self.single(surface, like).map(|wedge| self.chart[wedge as usize]);
        self.chart.push(chart.unwrap_or(self.source.len() as u32 - 1));
        self.is_seam.push(false);
        (self.source.len() - 1) as u32
    }

    /// Input vertex and channels of a wedge.
    pub(crate) fn of(&self, wedge: u32) -> (u32, &[f32]) {
        (self.source[wedge as usize], self.values_of(wedge))
    }
}

#[cfg(test)]
mod tests {
    use crate::kernel::{Options, Simplified, Stop, Topology, simplify_mesh, tests::sheet};
    use crate::mesh::Mesh;
    use std::collections::{BTreeMap, BTreeSet};

    /// A sheet of n x n quads cut into charts of 8 x 8, each with its own piece of the unit square, and a
    /// channel that is the same in all of them.
    fn charts(n: usize) -> Mesh {
        let whole = sheet(n);
        let mut split = Mesh { n_channels: 3, ..Mesh::default() };
        let mut known = BTreeMap::new();
        for (i, t) in whole.triangles.iter().enumerate() {
            let (row, column) = (i / 2 / n, i / 2 % n);
            let chart = row / 8 * n.div_ceil(8) + column / 8;
            let t = t.map(|v| {
                *known.entry((chart, v)).or_insert_with(|| {
                    let p = whole.positions[v as usize];
                    let (x, y) = ((p[0] - 1e5) as f32, (p[1] + 3e4) as f32);
                    split.positions.push(p);
                    split.channels.extend([chart as f32 + 0.02 * x, y, 0.5]);
                    split.positions.len() as u32 - 1
                })
            });
            split.triangles.push(t);
        }
        split
    }

    fn simplify(mesh: &Mesh, target: u64, weights: &[f32], topology: Topology) -> Simplified {
        let locked = vec![false; mesh.positions.len()];
        let weights = weights.to_vec();
        let stop = Stop::Triangles(target);
        let confined = vec![true; 2];
        let options = Options { stop, topology, weights, confined, ..Options::default() };
        simplify_mesh(mesh.clone(), &locked, &options)
    }

    /// Edges used once only, when what lies in one place is one vertex.
    fn open_edges(mesh: &Mesh) -> usize {
        let place = |v: u32| mesh.positions[v as usize].map(f64::to_bits);
        let mut count: BTreeMap<_, usize> = BTreeMap::new();
        for t in &mesh.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let (a, b) = (place(a), place(b));
                *count.entry((a.min(b), a.max(b))).or_default() += 1;
            }
        }
        assert!(count.values().all(|&n| n <= 2));
        count.values().filter(|&&n| n == 1).count()
    }

    /// No corner of a triangle has a value of another chart than the others.
    fn assert_no_bleeding(mesh: &Mesh) {
        for t in &mesh.triangles {
            let charts: BTreeSet<i32> =
                t.iter().map(|&v| (mesh.channels_of(v)[0] - 0.01).round() as i32).collect();
            assert_eq!(charts.len(), 1);
            for &v in t {
                let [u, y, same] = mesh.channels_of(v) else { unreachable!("three channels") };
                let x = (u - (u - 0.01).round()) / 0.02;
                assert!((-0.02..1.02).contains(&x) && (-0.02..1.02).contains(y), "{x} {y}");
                assert_eq!(*same, 0.5);
            }
        }
    }

    #[test]
    fn seams_neither_crack_nor_bleed_and_give_way() {
        let mesh = charts(64);
        for (target, weights) in
            [(3000, &[0.1, 0.1][..]), (300, &[0.1, 0.1]), (60, &[]), (300, &[])]
        {
            for topology in [Topology::Error, Topology::Keep] {
                let result = simplify(&mesh, target, weights, topology);
                let left: BTreeSet<i32> = (result.mesh.triangles.iter())
                    .map(|t| (result.mesh.channels_of(t[0])[0] - 0.01).round() as i32)
                    .collect();
                assert_eq!(result.statistics.charts_vanished, 64 - left.len() as u64);
                assert!(result.statistics.seam_vertices > 0);
                assert!(result.statistics.reached);
                assert_no_bleeding(&result.mesh);
                // Only the border of the sheet is open: an even ring, far shorter than all charts' borders.
                let open = open_edges(&result.mesh);
                assert!(open * open < 40 * target as usize, "{open} of {target}");
                let sources: BTreeSet<u32> = result.source.iter().copied().collect();
                assert_eq!(sources.len(), result.source.len());
            }
        }
    }

    /// A bumpy sheet in two regions whose border, at x = 1/2, is not seen in its shape.
    fn two_regions(n: usize) -> Mesh {
        let whole = sheet(n);
        let mut split = Mesh { n_channels: 1, ..Mesh::default() };
        let mut known = BTreeMap::new();
        for (i, t) in whole.triangles.iter().enumerate() {
            let right = i / 2 / n >= n / 2;
            let t = t.map(|v| {
                *known.entry((right, v)).or_insert_with(|| {
                    split.positions.push(whole.positions[v as usize]);
                    split.channels.push(if right { 300.0 } else { 7.0 });
                    split.positions.len() as u32 - 1
                })
            });
            split.triangles.push(t);
        }
        split
    }

    #[test]
    fn the_border_of_a_region_stays_where_it_is() {
        let mesh = two_regions(64);
        let locked = vec![false; mesh.positions.len()];
        // How far the ends of the border are from it, on average.
        let off = |region: Option<usize>, seam_share: f32| {
            let stop = Stop::Triangles(300);
            let confined = vec![true];
            let options = Options { stop, region, seam_share, confined, ..Options::default() };
            let result = simplify_mesh(mesh.clone(), &locked, &options);
            assert!(result.statistics.reached);
            let mut sides: BTreeMap<_, BTreeSet<u32>> = BTreeMap::new();
            for t in &result.mesh.triangles {
                let value = |v: u32| result.mesh.channels_of(v)[0].to_bits();
                assert!(t.iter().all(|&v| value(v) == value(t[0])));
                for &v in t {
                    let place = result.mesh.positions[v as usize].map(f64::to_bits);
                    sides.entry(place).or_default().insert(value(v));
                }
            }
            let border: Vec<f64> = (sides.iter().filter(|(_, values)| values.len() == 2))
                .map(|(place, _)| (f64::from_bits(place[0]) - 1e5 - 0.5).abs())
                .collect();
            border.iter().sum::<f64>() / border.len() as f64
        };
        let (kept, dear, cheap, free) =
            (off(Some(0), 0.0), off(None, 1.0), off(None, 0.01), off(None, 0.0));
        assert_eq!(kept, dear);
        assert!(kept < 0.005 && cheap < 0.02 && free > 4.0 * kept, "{kept} {cheap} {free}");
    }

    #[test]
    fn what_coincides_with_a_locked_vertex_stays() {
        let mesh = charts(32);
        // One of two coinciding vertices is locked, wherever the sheet is cut at x = 1/2.
        let mut seen = BTreeSet::new();
        let middle: Vec<bool> = mesh.positions.iter().map(|p| p[0] - 1e5 == 0.5).collect();
        let locked: Vec<bool> = mesh
            .positions
            .iter()
            .zip(&middle)
            .map(|(p, middle)| *middle && seen.insert(p.map(f64::to_bits)))
            .collect();
        let stop = Stop::Triangles(200);
        let options = Options { stop, weights: vec![0.1, 0.1], ..Options::default() };
        let result = simplify_mesh(mesh.clone(), &locked, &options);
        let left: BTreeSet<u32> = result.source.iter().copied().collect();
        for v in (0..mesh.positions.len()).filter(|&v| middle[v]) {
            assert!(left.contains(&(v as u32)));
        }
    }
}
