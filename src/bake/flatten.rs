//! Charts of a surface, laid flat by projection, in units of the surface: no texels, no pages.
//!
//! A chart grows over neighbours that face about the same way, flat regions first. Charts that another one could show as
//! well are given to it, the smallest first, so few remain. Each is then seen along its mean normal; triangles that lie
//! over others there, or face away, are left for charts of the next turn. A chart is scaled to the area of its surface and
//! turned so that its box is small. Knows nothing of the original.

use super::outline;
use super::overlaps::{Grid, twice_area};
use super::projected::{beside, direction_of, joined};
use super::sectors::hubs;
use super::settings::NONE;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;
use stonecut_measure::triangle;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{cross, dot};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// The surface around a triangle leans from the mean normal of its growing chart by less than the angle of this cosine.
const LEAST_FACING: f64 = 0.7;

/// The same for triangles of a chart that is given to another one.
const LEAST_FACING_GIVEN: f64 = 0.5;

/// The same for the triangle itself.
const LEAST_OWN_FACING: f64 = 0.5;

/// The same for triangles of so small a share of the surface that hardly a texel is lost with them: noise turns them.
const LEAST_SMALL_FACING: f64 = 0.15;
const SMALL_SHARE: f64 = 2e-5;

/// Charts of so small a share of the surface are given to others as far as the triangles themselves allow.
const FEW_SHARE: f64 = 1e-4;

/// The mean normal of a chart that is whole may have turned away from a triangle, by this factor of its cosine.
const DRIFT: f64 = 0.7;

/// Turns of growing, and of giving charts to others.
const MOST_TURNS: usize = 6;

/// Directions between level and upright that a chart's box is tried in.
const TURNS: u32 = 16;

/// A chart is enlarged by this factor at most to make up for what leans.
const MOST_ENLARGED: f64 = 1.5;

/// Charts of a mesh.
#[derive(Clone, Debug, Default)]
pub(super) struct Flat {
    /// For each triangle its chart; `NONE` without an area.
    pub chart: Vec<u32>,
    /// For each triangle its corners in units of the mesh, from the upper left corner of its chart.
    pub corners: Vec<[[f32; 2]; 3]>,
    pub n_charts: u32,
}

/// Bytes of a triangle while charts are made.
pub(super) const FLATTEN_BYTES: u64 = 400;

/// Makes charts of a mesh.
///
/// Memory: `FLATTEN_BYTES` a triangle.
pub(super) fn flatten(mesh: &Mesh, progress: &Progress) -> Result<Flat> {
    let surface = Surface::new(mesh);
    let n = mesh.triangles.len();
    let mut out = Flat { chart: vec![NONE; n], corners: vec![[[0.0; 2]; 3]; n], n_charts: 0 };
    let mut left = surface.seeds();
    for _ in 0..MOST_TURNS {
        progress.check()?;
        let mut parts = surface.grown(&left);
        for _ in 0..MOST_TURNS {
            if !surface.give(&mut parts) {
                break;
            }
        }
        progress.check()?;
        left = surface.settle(&parts, &mut out);
        if left.is_empty() {
            break;
        }
    }
    // What still lies over others gets a chart for each triangle.
    for t in left {
        surface.lay(&[t], surface.own[t as usize], &mut out, &mut Vec::new());
    }
    Ok(out)
}

/// A mesh with what its charts grow by.
struct Surface<'a> {
    mesh: &'a Mesh,
    areas: Vec<f64>,
    /// Unit normals of triangles; zeros without an area.
    own: Vec<[f64; 3]>,
    /// Unit normals of the triangles around each.
    smooth: Vec<[f64; 3]>,
    /// Triangles at the three edges.
    beside: Vec<[u32; 3]>,
    /// A vertex of each that thousands may have in common, and its place among the corners.
    hubs: Vec<(u32, u8)>,
    /// Area of all.
    area: f64,
}

/// Triangles in parts that become charts.
struct Parts {
    /// For each triangle its part; `NONE` where it is in none.
    part: Vec<u32>,
    /// Triangles, part by part.
    order: Vec<u32>,
    /// Place of each part in `order`.
    ranges: Vec<Range<usize>>,
    /// Unit normals.
    normals: Vec<[f64; 3]>,
    areas: Vec<f64>,
}

impl Parts {
    /// Parts by number; `order` is taken as it comes within each.
    fn new(part: Vec<u32>, mut order: Vec<u32>, normals: Vec<[f64; 3]>, areas: &[f64]) -> Parts {
        order.sort_by_key(|&t| part[t as usize]);
        let mut ranges = vec![0..0; normals.len()];
        let mut sums = vec![0.0; normals.len()];
        for (i, &t) in order.iter().enumerate() {
            let range = &mut ranges[part[t as usize] as usize];
            *range = if range.start == range.end { i..i + 1 } else { range.start..i + 1 };
            sums[part[t as usize] as usize] += areas[t as usize];
        }
        Parts { part, order, ranges, normals, areas: sums }
    }
}

impl<'a> Surface<'a> {
    fn new(mesh: &'a Mesh) -> Surface<'a> {
        let n = mesh.triangles.len();
        let normals: Vec<_> = (0..n).map(|t| triangle::area_normal(&mesh.corners(t))).collect();
        let triangles = joined(mesh);
        let mut around = vec![[0.0; 3]; mesh.positions.len()];
        for (corners, normal) in triangles.iter().zip(&normals) {
            for &v in corners {
                (0..3).for_each(|k| around[v as usize][k] += normal[k]);
            }
        }
        let smooth = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| around[v as usize]);
            direction_of([0, 1, 2].map(|k| a[k] + b[k] + c[k]))
        };
        let areas: Vec<f64> = (0..n).map(|t| triangle::area(&mesh.corners(t))).collect();
        Surface {
            mesh,
            area: areas.iter().sum(),
            areas,
            own: normals.iter().map(|&normal| direction_of(normal)).collect(),
            smooth: triangles.iter().map(smooth).collect(),
            beside: beside(&triangles),
            hubs: hubs(&triangles, mesh.positions.len()),
        }
    }

    /// True if a triangle faces a direction well enough for a chart that is seen from there.
    fn is_seen(&self, t: u32, normal: [f64; 3]) -> bool {
        dot(normal, self.own[t as usize]) >= self.least_facing(t)
    }

    /// Cosine of the angle that a triangle may lean by.
    fn least_facing(&self, t: u32) -> f64 {
        let is_small = self.areas[t as usize] <= SMALL_SHARE * self.area;
        if is_small { LEAST_SMALL_FACING } else { LEAST_OWN_FACING }
    }

    /// Triangles with an area, those first whose surroundings are flat.
    fn seeds(&self) -> Vec<u32> {
        let is_seen = |&t: &u32| self.own[t as usize] != [0.0; 3];
        let mut all: Vec<u32> = (0..self.own.len() as u32).filter(is_seen).collect();
        let bend = |t: u32| {
            let own = self.own[t as usize];
            let beside = self.beside[t as usize].into_iter().filter(|&other| other != NONE);
            beside.map(|other| 1.0 - dot(own, self.own[other as usize])).fold(0.0, f64::max)
        };
        all.sort_by_cached_key(|&t| ((32.0 * bend(t)) as u32, t));
        all
    }

    /// Grows parts over some triangles.
    fn grown(&self, seeds: &[u32]) -> Parts {
        let n = self.own.len();
        let mut is_free = vec![false; n];
        seeds.iter().for_each(|&t| is_free[t as usize] = true);
        let mut part = vec![NONE; n];
        let (mut normals, mut order) = (Vec::new(), Vec::with_capacity(seeds.len()));
        let mut open: BinaryHeap<Reverse<(u32, u32)>> = BinaryHeap::new();
        for &seed in seeds {
            if part[seed as usize] != NONE {
                continue;
            }
            let number = normals.len() as u32;
            let mut sum = [0.0; 3];
            open.clear();
            open.push(Reverse((0, seed)));
            while let Some(Reverse((_, t))) = open.pop() {
                let at = t as usize;
                if part[at] != NONE {
                    continue;
                }
                let normal = direction_of(sum);
                let faces = self.is_seen(t, normal) && dot(normal, self.smooth[at]) >= LEAST_FACING;
                if t != seed && !faces {
                    continue;
                }
                part[at] = number;
                order.push(t);
                // A seed whose surroundings face elsewhere counts by itself.
                let is_bent = !self.is_seen(t, self.smooth[at]);
                let adds = if is_bent { self.own[at] } else { self.smooth[at] };
                (0..3).for_each(|k| sum[k] += self.areas[at] * adds[k]);
                let normal = direction_of(sum);
                for other in self.beside[at] {
                    let is_open =
                        other != NONE && is_free[other as usize] && part[other as usize] == NONE;
                    if is_open {
                        let leans = 1.0 - dot(normal, self.smooth[other as usize]);
                        open.push(Reverse(((leans * 65536.0) as u32, other)));
                    }
                }
            }
            normals.push(direction_of(sum));
        }
        Parts::new(part, order, normals, &self.areas)
    }

    /// Gives parts to larger neighbours that see all of their triangles well enough; false if there are none.
    fn give(&self, parts: &mut Parts) -> bool {
        let n_parts = parts.normals.len();
        // Lengths of the borders between parts.
        let mut borders: Vec<(u32, u32, f64)> = Vec::new();
        for &t in &parts.order {
            let own = parts.part[t as usize];
            let corners = self.mesh.corners(t as usize);
            for (k, &other) in self.beside[t as usize].iter().enumerate() {
                let Some(&other) = parts.part.get(other as usize) else { continue };
                if other != NONE && other != own {
                    let (a, b) = (corners[k], corners[(k + 1) % 3]);
                    let length = [0, 1, 2].map(|k| b[k] - a[k]);
                    borders.push((own, other, dot(length, length).sqrt()));
                }
            }
        }
        borders.sort_by_key(|&(own, other, _)| (own, other));
        let mut neighbours: Vec<(u32, u32, f64)> = Vec::new();
        for run in borders.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            neighbours.push((run[0].0, run[0].1, run.iter().map(|&(_, _, length)| length).sum()));
        }
        neighbours.sort_by(|a, b| a.0.cmp(&b.0).then(b.2.total_cmp(&a.2)).then(a.1.cmp(&b.1)));
        let mut to: Vec<u32> = (0..n_parts as u32).collect();
        let mut has_taken = vec![false; n_parts];
        let mut by_size: Vec<u32> = (0..n_parts as u32).collect();
        let size = |part: u32| parts.areas[part as usize];
        by_size.sort_by(|&a, &b| size(a).total_cmp(&size(b)).then(b.cmp(&a)));
        let mut rank = vec![0; n_parts];
        by_size.iter().enumerate().for_each(|(i, &part)| rank[part as usize] = i);
        let mut is_any = false;
        for &part in by_size.iter().filter(|&&part| !parts.ranges[part as usize].is_empty()) {
            if has_taken[part as usize] {
                continue;
            }
            let triangles = &parts.order[parts.ranges[part as usize].clone()];
            let first = neighbours.partition_point(|&(own, _, _)| own < part);
            let beside = neighbours[first..].iter().take_while(|&&(own, _, _)| own == part);
            for &(_, other, _) in beside {
                // Given to one that was itself given to a third: to that.
                let mut other = other;
                while to[other as usize] != other {
                    other = to[other as usize];
                }
                if rank[other as usize] <= rank[part as usize] {
                    continue;
                }
                let normal = parts.normals[other as usize];
                let is_small = parts.areas[part as usize] <= FEW_SHARE * self.area;
                let least = if is_small { -1.0 } else { LEAST_FACING_GIVEN };
                let is_seen = triangles.iter().all(|&t| {
                    self.is_seen(t, normal) && dot(normal, self.smooth[t as usize]) >= least
                });
                if is_seen {
                    to[part as usize] = other;
                    (has_taken[other as usize], is_any) = (true, true);
                    break;
                }
            }
        }
        let end = |mut part: u32| {
            while to[part as usize] != part {
                part = to[part as usize];
            }
            part
        };
        let part = parts.part.iter().map(|&part| if part == NONE { NONE } else { end(part) });
        let (part, order) = (part.collect(), std::mem::take(&mut parts.order));
        *parts = Parts::new(part, order, std::mem::take(&mut parts.normals), &self.areas);
        is_any
    }

    /// Makes charts of parts; returns triangles that lie over others, or face away.
    fn settle(&self, parts: &Parts, out: &mut Flat) -> Vec<u32> {
        let mut left = Vec::new();
        let mut is_met = vec![false; self.own.len()];
        for (range, &normal) in parts.ranges.iter().zip(&parts.normals) {
            for &seed in &parts.order[range.clone()] {
                if is_met[seed as usize] {
                    continue;
                }
                // What hangs together, from the first triangle outwards.
                let mut some = vec![seed];
                is_met[seed as usize] = true;
                let mut next = 0;
                while next < some.len() {
                    for other in self.beside[some[next] as usize] {
                        let is_own = other != NONE
                            && parts.part[other as usize] == parts.part[seed as usize]
                            && !is_met[other as usize];
                        if is_own {
                            is_met[other as usize] = true;
                            some.push(other);
                        }
                    }
                    next += 1;
                }
                self.lay(&some, normal, out, &mut left);
            }
        }
        left
    }

    /// Lays triangles flat as a chart; those that it cannot hold go to `left`.
    fn lay(&self, triangles: &[u32], normal: [f64; 3], out: &mut Flat, left: &mut Vec<u32>) {
        // Level where that is possible, seen from outside: to the right and down.
        let up = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let across = direction_of(cross(up, normal));
        let down = cross(across, normal);
        let origin = self.mesh.corners(triangles[0] as usize)[0];
        let flat = |t: u32| {
            self.mesh.corners(t as usize).map(|p| {
                let from = [0, 1, 2].map(|k| p[k] - origin[k]);
                [dot(across, from), dot(down, from)]
            })
        };
        let all: Vec<_> = triangles.iter().map(|&t| flat(t)).collect();
        let faces = |t: u32| dot(normal, self.own[t as usize]) >= DRIFT * self.least_facing(t);
        let mut kept: Vec<usize> = Vec::with_capacity(all.len());
        if triangles.iter().all(|&t| faces(t)) && outline::is_simple(&all) {
            kept.extend(0..all.len());
        } else {
            let mut grid = Grid::around(&all);
            for (i, &t) in triangles.iter().enumerate() {
                if faces(t) && grid.take(i as u32, self.hubs[t as usize], &all) {
                    kept.push(i);
                } else {
                    left.push(t);
                }
            }
        }
        if kept.is_empty() {
            return;
        }
        let seen: f64 = kept.iter().map(|&i| twice_area(&all[i]).abs() / 2.0).sum();
        let area: f64 = kept.iter().map(|&i| self.areas[triangles[i] as usize]).sum();
        let scale = (area / seen).sqrt();
        let scale = if scale.is_finite() { scale.clamp(1.0, MOST_ENLARGED) } else { 1.0 };
        let points: Vec<[f64; 2]> = kept.iter().flat_map(|&i| all[i]).collect();
        let (axis, low) = upright(&points);
        for &i in &kept {
            let t = triangles[i] as usize;
            out.chart[t] = out.n_charts;
            out.corners[t] = all[i].map(|p| {
                let turned = turn(p, axis);
                [0, 1].map(|k| (scale * (turned[k] - low[k])) as f32)
            });
        }
        out.n_charts += 1;
    }
}

/// A point turned so that `axis` is level.
fn turn([x, y]: [f64; 2], [c, s]: [f64; 2]) -> [f64; 2] {
    [c * x + s * y, c * y - s * x]
}

/// The direction of the wide side of a small box around points, and the box's least coordinates once it is turned.
fn upright(points: &[[f64; 2]]) -> ([f64; 2], [f64; 2]) {
    let mut best: Option<(f64, [f64; 2], [f64; 2])> = None;
    for i in 0..TURNS {
        // The tangent of half the angle, from 0 to that of an eighth of a turn: the same bits on every machine.
        let half = f64::from(i) / f64::from(TURNS) * (std::f64::consts::SQRT_2 - 1.0);
        let axis = [1.0 - half * half, 2.0 * half].map(|x| x / (1.0 + half * half));
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &p in points {
            let p = turn(p, axis);
            low = [low[0].min(p[0]), low[1].min(p[1])];
            high = [high[0].max(p[0]), high[1].max(p[1])];
        }
        let [width, height] = [high[0] - low[0], high[1] - low[1]];
        let found = match width >= height {
            true => (width * height, axis, low),
            // A quarter more: x becomes y, and -x what y was.
            false => (width * height, [-axis[1], axis[0]], [low[1], -high[0]]),
        };
        if best.is_none_or(|best| found.0 < 0.999 * best.0) {
            best = Some(found);
        }
    }
    best.map_or(([1.0, 0.0], [0.0; 2]), |(_, axis, low)| (axis, low))
}
