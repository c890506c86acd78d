//! Attribute seams: one place, several values.
//!
//! A scan that was split along texture seams has several vertices in one place, each with the values of its
//! own chart. `weld` makes them one vertex of the surface; what they carry stays apart here, as *wedges*, and
//! every corner of a triangle names the wedge it uses. So a collapse moves all sides of a seam together, no
//! crack can open, and no value is mixed with that of another chart: where both ends of the edge have a
//! wedge of the same chart, the two become one, interpolated along the edge; any other keeps its value.
//! A channel in which all wedges of both ends agree (a colour beside the texture) knows no seam and is
//! interpolated for all of them.
//! `collapse` and `divide` (for cuts) change them, `cost::seam` prices collapses; `MeshState::into_mesh` splits the result again.
//!
//! Source: wedges of Hoppe 1999 (docs/references.md; docs/algorithm.md, section 7).

mod collapse;
pub(crate) mod divide;
pub(crate) mod pairs;

use crate::simd::Simd;
use crate::surface::Surface;
use crate::surface::models::Models;
use crate::vertex::GONE;
use stonecut_mesh::union_find::Union;

/// A surface with the values at the corners of its triangles.
#[derive(Clone, Copy)]
pub(crate) struct Corners<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) wedges: Option<&'a Wedges>,
}

impl<'a> Corners<'a> {
    /// The channels at corner `v` of triangle `t`.
    #[inline(always)]
    pub(crate) fn values_at(self, t: u32, v: u32) -> &'a [f32] {
        match self.wedges {
            None => self.surface.channels_of(v),
            Some(wedges) => wedges.values_at(self.surface, t, v),
        }
    }

    /// True if a value of one of these channels is NaN or infinite.
    pub(crate) fn has_gaps(self, channels: &[(usize, f32)]) -> bool {
        let n = self.surface.n_channels.max(1);
        let values = self.wedges.map_or(&[][..], |wedges| &wedges.values);
        let mut rows = self.surface.channels.chunks_exact(n).chain(values.chunks_exact(n));
        rows.any(|row| channels.iter().any(|&(channel, _)| !row[channel].is_finite()))
    }
}

/// The wedges of a surface: 12 bytes a triangle, 4 a channel and input vertex, 9 an input vertex.
#[derive(Clone)]
pub(crate) struct Wedges {
    /// For each triangle the wedges of its corners.
    pub(crate) corner: Vec<[u32; 3]>,
    /// Channels of each wedge; those of a vertex with a single wedge are the surface's, too.
    values: Vec<f32>,
    /// Input vertex of each wedge.
    source: Vec<u32>,
    pub(crate) models: Models,
    /// Sources of vertices that were joined and of those at whose place they are, ascending; only if survivors are input vertices.
    joined: Vec<(u32, u32)>,
    /// True if a vertex has several wedges.
    is_seam: Vec<bool>,
    n_channels: usize,
    /// True for channels that mean nothing outside of their chart.
    confined: Vec<bool>,
    /// The channel that tells regions apart, whose borders are kept as boundaries are.
    pub(crate) region: Option<usize>,
    /// Cost of moving any other seam, as a share of that.
    pub(crate) seam_share: f64,
    /// For each wedge one of its chart, the same for all of them.
    chart: Vec<u32>,
    n_charts: u64,
    pub(crate) simd: Simd,
}

impl Wedges {
    /// Wedges of a surface that is about to be welded: each vertex is its own.
    pub(crate) fn new(surface: &Surface, confined: &[bool], simd: Simd) -> Wedges {
        Wedges {
            corner: surface.triangles.clone(),
            values: surface.channels.clone(),
            source: surface.source.clone(),
            models: Models::default(),
            joined: Vec::new(),
            is_seam: Vec::new(),
            n_channels: surface.n_channels,
            confined: confined.to_vec(),
            region: None,
            seam_share: 0.0,
            chart: Vec::new(),
            n_charts: 0,
            simd,
        }
    }

    /// Remembers which vertices lie at one place: each of these is joined into another.
    pub(crate) fn keep_places(&mut self, join: &[(u32, u32)]) {
        let source = |v: u32| self.source[v as usize];
        self.joined = join.iter().map(|&(v, into)| (source(v), source(into))).collect();
        self.joined.sort_unstable();
    }

    /// Notes of all wedges whose vertices have come to the place of another that they are like that one.
    pub(crate) fn note_places(&mut self, surface: &Surface) {
        let place = |source: u32| {
            let known = self.joined.binary_search_by_key(&source, |joined| joined.0);
            known.map_or(source, |i| self.joined[i].1)
        };
        for (corner, t) in self.corner.iter().zip(&surface.triangles).filter(|(_, t)| t[0] != GONE)
        {
            for (&wedge, &v) in corner.iter().zip(t) {
                let (source, there) = (self.source[wedge as usize], surface.source[v as usize]);
                if place(self.models.of(source)) != place(there) {
                    self.models.set(source, there);
                }
            }
        }
    }

    /// Finds the charts: wedges that triangles connect.
    pub(crate) fn find_charts(&mut self, triangles: &[[u32; 3]]) {
        let mut charts = Union::new(self.source.len());
        let alive = self.corner.iter().zip(triangles).filter(|(_, t)| t[0] != GONE);
        for (&[a, b, c], _) in alive {
            charts.join(a, b);
            charts.join(b, c);
        }
        self.chart = charts.into_roots();
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

    /// Sets one channel of every wedge to a value of its vertex.
    pub(crate) fn set_channel(&mut self, triangles: &[[u32; 3]], channel: usize, values: &[f32]) {
        for (corner, t) in self.corner.iter().zip(triangles).filter(|(_, t)| t[0] != GONE) {
            for (&wedge, &v) in corner.iter().zip(t) {
                self.values[wedge as usize * self.n_channels + channel] = values[v as usize];
            }
        }
    }

    /// Sets one channel of all wedges of a vertex.
    pub(crate) fn set_at(&mut self, surface: &Surface, v: u32, channel: usize, value: f32) {
        for &t in surface.ring(v) {
            let wedge = self.at(surface, t, v) as usize;
            self.values[wedge * self.n_channels + channel] = value;
        }
    }

    /// Counts the vertices on seams.
    pub(crate) fn n_seam_vertices(&self, surface: &Surface) -> u64 {
        let vertices = self.is_seam.iter().zip(&surface.rings);
        vertices.filter(|(is_seam, ring)| **is_seam && ring.class.is_some() && ring.len > 0).count()
            as u64
    }

    /// Makes one of wedges that are to be joined and have the same confined values; lowest first.
    pub(crate) fn join_equal(&mut self, join: &[(u32, u32)]) {
        let confined = &self.confined;
        let alike = |a: &[f32], b: &[f32]| {
            let mut pairs = a.iter().zip(b).zip(confined);
            pairs.all(|((a, b), confined)| !confined || a.to_bits() == b.to_bits())
        };
        // Groups by the vertex they are joined into, in ascending order of it, which comes first.
        let mut groups: Vec<(u32, u32)> = join.iter().map(|&(v, into)| (into, v)).collect();
        groups.sort_unstable();
        let mut same: Vec<u32> = (0..self.source.len() as u32).collect();
        for group in groups.chunk_by(|a, b| a.0 == b.0) {
            let member = |i: usize| if i == 0 { group[0].0 } else { group[i - 1].1 };
            for i in 1..=group.len() {
                let v = member(i);
                let equal = |&w: &u32| alike(self.values_of(w), self.values_of(v));
                if let Some(first) = (0..i).map(member).find(equal) {
                    same[v as usize] = first;
                }
            }
        }
        for corner in self.corner.iter_mut().flatten() {
            // What is gone has no corner.
            *corner = same.get(*corner as usize).copied().unwrap_or(*corner);
        }
    }

    /// The wedge that triangle `t` uses at its corner `v`.
    #[inline(always)]
    pub(crate) fn at(&self, surface: &Surface, t: u32, v: u32) -> u32 {
        let corners = surface.triangles[t as usize];
        let k = usize::from(corners[1] == v) + 2 * usize::from(corners[2] == v);
        self.corner[t as usize][k.min(2)]
    }

    /// Returns whether triangle `t` uses at its corner `v` the wedge that came with the vertex itself.
    pub(crate) fn is_own(&self, surface: &Surface, t: u32, v: u32) -> bool {
        self.source[self.at(surface, t, v) as usize] == surface.source[v as usize]
    }

    /// Channels at corner `v` of triangle `t`.
    #[inline(always)]
    fn values_at<'a>(&'a self, surface: &'a Surface, t: u32, v: u32) -> &'a [f32] {
        if self.is_seam[v as usize] {
            self.values_of(self.at(surface, t, v))
        } else {
            surface.channels_of(v)
        }
    }

    #[inline(always)]
    pub(crate) fn values_of(&self, wedge: u32) -> &[f32] {
        &self.values[wedge as usize * self.n_channels..][..self.n_channels]
    }

    /// Returns whether a collapse has to do with a seam.
    #[inline(always)]
    pub(crate) fn concern(&self, v0: u32, v1: u32) -> bool {
        self.is_seam[v0 as usize] || self.is_seam[v1 as usize]
    }

    /// Returns whether a vertex is on a seam.
    #[inline(always)]
    pub(crate) fn is_seam(&self, v: u32) -> bool {
        self.is_seam[v as usize]
    }

    /// Drops the corners of triangles that are gone, before the triangles themselves are dropped.
    pub(crate) fn retain(&mut self, triangles: &[[u32; 3]]) {
        let mut gone = triangles.iter().map(|t| t[0] == GONE);
        self.corner.retain(|_| gone.next() == Some(false));
    }

    /// Finds again which vertices are on seams; after vertices or triangles have got new numbers.
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

    /// The source that is free once a vertex off the seams has gone.
    pub(crate) fn source_off_seams(&self, surface: &Surface, v: u32) -> Option<u32> {
        let wedge = if self.is_seam(v) { None } else { self.single(surface, v) };
        wedge.map(|wedge| self.source[wedge as usize])
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

    /// Contradictions between corners, wedges and the surface, in words.
    #[cfg(debug_assertions)]
    pub(crate) fn check(&self, surface: &Surface) -> Result<(), String> {
        let n = self.source.len();
        let lengths = [self.corner.len(), self.is_seam.len(), self.chart.len(), self.values.len()];
        let due = [surface.triangles.len(), surface.vertices.len(), n, n * self.n_channels];
        if lengths != due {
            return Err(format!("corners, vertices, charts, values: {lengths:?} for {due:?}"));
        }
        // Each wedge belongs to one vertex, each vertex off the seams has one wedge.
        let mut owner = vec![GONE; n];
        let mut wedge_of = vec![GONE; surface.vertices.len()];
        let mut has_several = vec![false; surface.vertices.len()];
        let alive = surface.triangles.iter().zip(&self.corner).filter(|(t, _)| t[0] != GONE);
        for (&v, &w) in alive.flat_map(|(t, corner)| t.iter().zip(corner)) {
            let Some(owner) = owner.get_mut(w as usize) else {
                return Err(format!("wedge {w} of vertex {v} does not exist"));
            };
            if *owner != GONE && *owner != v {
                return Err(format!("wedge {w} belongs to {v} and to {owner}"));
            }
            *owner = v;
            let known = &mut wedge_of[v as usize];
            has_several[v as usize] |= *known != GONE && *known != w;
            *known = w;
        }
        for (v, &w) in wedge_of.iter().enumerate().filter(|(_, w)| **w != GONE) {
            // Of a vertex of more triangles than that nothing is found again (`look_again`).
            let is_hub = surface.rings[v].len > crate::surface::MAX_VALENCE;
            if has_several[v] != self.is_seam[v] && !(is_hub && self.is_seam[v]) {
                return Err(format!("vertex {v} is on a seam: {}", has_several[v]));
            }
            let (values, own) = (self.values_of(w), surface.channels_of(v as u32));
            let is_same = values.iter().zip(own).all(|(a, b)| a.to_bits() == b.to_bits());
            if !self.is_seam[v] && !is_same {
                return Err(format!("vertex {v} has {own:?}, its wedge {values:?}"));
            }
        }
        Ok(())
    }

    /// Input vertex and channels of a wedge.
    pub(crate) fn of(&self, wedge: u32) -> (u32, &[f32]) {
        (self.source[wedge as usize], self.values_of(wedge))
    }
}

#[cfg(test)]
mod tests {
    use crate::{Options, Simplified, Stop, Topology, simplify_mesh, tests::sheet};
    use std::collections::{BTreeMap, BTreeSet};
    use stonecut_mesh::Mesh;

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
