//! Charts of a tile by projection: neighbours that face about the same way, seen from one of 26 directions.
//!
//! A tile has few triangles and its level has its own density, so no unwrapping for the least distortion is needed: a
//! chart is stretched by at most 1 / 0.55, but for triangles of a few texels. It is several times as fast as `charts`.
//! Charts neither overlap nor share texels. They depend on the tile alone. Knows nothing of the original.

use super::grid::each_point;
use super::settings::NONE;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use stonecut_measure::triangle;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{cross, dot, unit};

/// Texels around every chart that show its own colours. At 1/2 of the size a texel mixes what is up to 3 away; coarser
/// levels have pages for smaller sizes.
const PADDING: u32 = 4;

/// Sides of pages are multiples of this: blocks of JPEG with halved colours.
const SIDE_STEP: u32 = 16;

/// The surface around a triangle of a chart leans from its direction by less than the angle of this cosine.
const LEAST_FACING: f64 = 0.55;

/// The same for the triangle itself: noise leans more than the surface does, but nothing may be folded over.
const LEAST_OWN_FACING: f64 = 0.15;

/// Triangles of fewer texels may lean as far as their own normals may: pages would be full of charts of a few texels.
const SMALL_TEXELS: f64 = 8.0;

/// Charts begin where the surface faces a direction best, in this many steps.
const SEED_STEPS: f64 = 64.0;

/// Halvings of the density until a tile fits on its page.
const MOST_HALVINGS: u32 = 40;

/// Charts of a tile on its page.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Projected {
    /// Width and height of the page.
    pub size: [u32; 2],
    /// For each triangle its chart.
    pub chart: Vec<u32>,
    /// For each triangle its corners in texels, from the upper left corner of the page.
    pub corners: Vec<[[f32; 2]; 3]>,
    pub n_charts: u32,
    pub texels_per_unit: f64,
}

/// Charts at a density, halved until the page has at most `most_side` texels a side.
pub(super) fn project(mesh: &Mesh, texels_per_unit: f64, most_side: u32) -> Projected {
    let surface = Surface::new(mesh);
    let most_chart = most_side - 2 * PADDING;
    // Charts do not overlap, and show each triangle at this share of its area at least; half of that, since slivers between texels may.
    let least_area = surface.faced_area() * LEAST_OWN_FACING / 2.0;
    for halvings in 0..MOST_HALVINGS {
        let density = texels_per_unit / f64::from(halvings).exp2();
        if least_area * density * density > f64::from(most_side).powi(2) {
            continue;
        }
        let charts = surface.charts(density, most_chart);
        if let Some(page) = charts.and_then(|charts| charts.packed(most_side)) {
            return Projected { texels_per_unit: density, ..page };
        }
    }
    // Nothing has an area, or a triangle is larger than any scan.
    Projected {
        size: [SIDE_STEP; 2],
        chart: vec![NONE; mesh.triangles.len()],
        corners: vec![[[0.0; 2]; 3]; mesh.triangles.len()],
        n_charts: 0,
        texels_per_unit,
    }
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
    directions: Vec<Direction>,
    /// Triangles in the order in which charts begin, with the direction that each faces best.
    seeds: Vec<(u32, u32)>,
}

/// A direction to look from, and the axes of the picture.
struct Direction {
    normal: [f64; 3],
    axes: [[f64; 3]; 2],
    /// Least coordinates of the mesh.
    low: [f64; 2],
}

/// Zeros of what has no direction.
pub(super) fn direction_of(v: [f64; 3]) -> [f64; 3] {
    unit(v).unwrap_or_default()
}

/// All sums of up to three axes that have no opposites in them.
fn directions(mesh: &Mesh) -> Vec<Direction> {
    let mut out = Vec::new();
    for i in 0..27 {
        let normal = [i / 9, i / 3 % 3, i % 3].map(|k| f64::from(k) - 1.0);
        if normal == [0.0; 3] {
            continue;
        }
        let normal = direction_of(normal);
        // Level where that is possible.
        let up = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let across = direction_of(cross(up, normal));
        let axes = [across, cross(normal, across)];
        let low = axes
            .map(|axis| mesh.positions.iter().map(|&p| dot(axis, p)).fold(f64::INFINITY, f64::min));
        out.push(Direction { normal, axes, low });
    }
    out
}

impl Direction {
    fn flat(&self, corners: [[f64; 3]; 3], density: f64) -> [[f64; 2]; 3] {
        corners.map(|p| [0, 1].map(|k| density * (dot(self.axes[k], p) - self.low[k])))
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
        let smooth: Vec<_> = triangles.iter().map(smooth).collect();
        let areas = (0..n).map(|t| triangle::area(&mesh.corners(t))).collect();
        let own: Vec<_> = normals.iter().map(|&normal| direction_of(normal)).collect();
        let directions = directions(mesh);
        let mut seeds = Vec::with_capacity(n);
        for t in (0u32..).take(n).filter(|&t| own[t as usize] != [0.0; 3]) {
            let facing = |d: usize| dot(directions[d].normal, smooth[t as usize]);
            let is_seen =
                |&d: &usize| dot(directions[d].normal, own[t as usize]) >= LEAST_OWN_FACING;
            let all = (0..directions.len()).filter(is_seen);
            let Some(best) = all.max_by(|&a, &b| facing(a).total_cmp(&facing(b)).then(b.cmp(&a)))
            else {
                continue;
            };
            let step = (SEED_STEPS * (1.0 - facing(best))) as u32;
            seeds.push((step, t, best as u32));
        }
        seeds.sort_unstable();
        let seeds = seeds.into_iter().map(|(_, t, best)| (t, best)).collect();
        Surface { mesh, areas, own, smooth, beside: beside(&triangles), directions, seeds }
    }

    /// The area of all triangles that face somewhere.
    fn faced_area(&self) -> f64 {
        let faced = self.areas.iter().zip(&self.own).filter(|(_, own)| **own != [0.0; 3]);
        faced.map(|(area, _)| area).sum()
    }

    /// Grows charts; `None` if one would be wider than `most` texels.
    fn charts(&self, density: f64, most: u32) -> Option<Charts> {
        let n = self.mesh.triangles.len();
        let mut out =
            Charts { chart: vec![NONE; n], flat: vec![[[0.0; 2]; 3]; n], boxes: Vec::new() };
        // The chart that was last at each point of a direction's picture.
        let mut taken = TakenPoints::default();
        let mut open: Vec<u32> = Vec::new();
        for &(seed, direction) in &self.seeds {
            if out.chart[seed as usize] != NONE {
                continue;
            }
            let number = out.boxes.len() as u32;
            let direction = &self.directions[direction as usize];
            let mut around = Extent::EMPTY;
            open.clear();
            open.push(seed);
            let mut next = 0;
            while next < open.len() {
                let t = open[next] as usize;
                next += 1;
                if out.chart[t] != NONE {
                    continue;
                }
                let flat = direction.flat(self.mesh.corners(t), density);
                let wider = around.with(&flat);
                let is_first = t == seed as usize;
                if wider.size().iter().any(|&side| side > f64::from(most)) {
                    match is_first {
                        true => return None,
                        false => continue,
                    }
                }
                if !claim(&flat, number, &mut taken) && !is_first {
                    continue;
                }
                around = wider;
                (out.chart[t], out.flat[t]) = (number, flat);
                for &other in self.beside[t].iter().filter(|&&other| other != NONE) {
                    let o = other as usize;
                    let is_small = self.areas[o] * density * density < SMALL_TEXELS;
                    let faces = dot(direction.normal, self.own[o]) >= LEAST_OWN_FACING
                        && (is_small || dot(direction.normal, self.smooth[o]) >= LEAST_FACING);
                    if faces && out.chart[o] == NONE {
                        open.push(other);
                    }
                }
            }
            out.boxes.push(around);
        }
        Some(out)
    }
}

/// The chart that was last at points, in squares of 8 by 8.
#[derive(Default)]
struct TakenPoints {
    /// Numbers of squares by both coordinates.
    squares: HashMap<u64, u32, BuildHasherDefault<PointHasher>>,
    charts: Vec<u32>,
    /// The points of a triangle, as places in `charts`.
    points: Vec<u32>,
}

/// Mixes the coordinates of a point; the standard hash costs as much as the rest of a chart.
#[derive(Default)]
struct PointHasher(u64);

impl Hasher for PointHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u64(self.0 ^ u64::from(byte)));
    }

    fn write_u64(&mut self, both: u64) {
        let mixed = (both ^ both >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = (mixed ^ both << 17).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(32);
    }
}

/// Takes the points of a triangle for a chart; false, and nothing is taken, if one belongs to it already.
fn claim(flat: &[[f64; 2]; 3], chart: u32, taken: &mut TakenPoints) -> bool {
    let TakenPoints { squares, charts, points } = taken;
    points.clear();
    let mut last = (u64::MAX, 0);
    each_point(flat, 1, 0..u32::MAX, |x, y, _| {
        let (x, y) = (x as u64, y as u64);
        let key = x >> 3 << 32 | y >> 3;
        if key != last.0 {
            last = (key, *squares.entry(key).or_insert(charts.len() as u32));
            charts.resize(charts.len().max(last.1 as usize + 64), NONE);
        }
        points.push(last.1 + (8 * (y & 7) + (x & 7)) as u32);
    });
    if points.iter().any(|&at| charts[at as usize] == chart) {
        return false;
    }
    points.iter().for_each(|&at| charts[at as usize] = chart);
    true
}

/// The triangles with one vertex for each place: scans are often cut along the charts of the input's textures.
pub(super) fn joined(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let place = |(v, p): (u32, &[f64; 3])| *first.entry(p.map(f64::to_bits)).or_insert(v);
    let same: Vec<u32> = (0u32..).zip(&mesh.positions).map(place).collect();
    mesh.triangles.iter().map(|t| t.map(|v| same[v as usize])).collect()
}

/// For each triangle those at its edges; `NONE` where another is missing, or there are several.
pub(super) fn beside(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
    let all = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    for (corner, [a, b]) in (0u32..).zip(all) {
        edges.push(([a.min(b), a.max(b)], corner));
    }
    edges.sort_unstable();
    let mut out = vec![[NONE; 3]; triangles.len()];
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, a), (_, b)] = *run {
            out[a as usize / 3][a as usize % 3] = b / 3;
            out[b as usize / 3][b as usize % 3] = a / 3;
        }
    }
    out
}

/// A rectangle of a picture.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: [f64; 2],
    high: [f64; 2],
}

impl Extent {
    const EMPTY: Extent = Extent { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };

    fn with(mut self, flat: &[[f64; 2]; 3]) -> Extent {
        for p in flat {
            self.low = [0, 1].map(|k| self.low[k].min(p[k]));
            self.high = [0, 1].map(|k| self.high[k].max(p[k]));
        }
        self
    }

    /// Whole texels.
    fn size(&self) -> [f64; 2] {
        [0, 1].map(|k| self.high[k].ceil() - self.low[k].floor())
    }
}

/// Charts that have no place on the page yet.
struct Charts {
    chart: Vec<u32>,
    flat: Vec<[[f64; 2]; 3]>,
    boxes: Vec<Extent>,
}

impl Charts {
    /// Puts the charts on a page, in rows of falling height; `None` if they do not fit.
    fn packed(self, most_side: u32) -> Option<Projected> {
        let sizes: Vec<[u32; 2]> =
            self.boxes.iter().map(|b| b.size().map(|side| side as u32 + 2 * PADDING)).collect();
        let mut order: Vec<usize> = (0..sizes.len()).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse([sizes[i][1], sizes[i][0]]), i));
        let widest = sizes.iter().map(|size| size[0]).max()?;
        let texels: f64 = sizes.iter().map(|&[w, h]| f64::from(w) * f64::from(h)).sum();
        let mut best: Option<([u32; 2], Vec<[u32; 2]>)> = None;
        for share in [0.7, 0.85, 1.0, 1.15, 1.4, 2.0] {
            let wanted = (share * texels.sqrt()).min(f64::from(most_side)) as u32;
            let width = wanted.max(widest).next_multiple_of(SIDE_STEP).min(most_side);
            let (places, height) = rows(&sizes, &order, width);
            let height = height.next_multiple_of(SIDE_STEP);
            let is_less = |size: [u32; 2]| {
                u64::from(width) * u64::from(height) < u64::from(size[0]) * u64::from(size[1])
            };
            if height <= most_side && best.as_ref().is_none_or(|(size, _)| is_less(*size)) {
                best = Some(([width, height], places));
            }
        }
        let (size, places) = best?;
        let mut corners = vec![[[0f32; 2]; 3]; self.chart.len()];
        for (t, &chart) in self.chart.iter().enumerate().filter(|(_, chart)| **chart != NONE) {
            let (low, place) = (self.boxes[chart as usize].low, places[chart as usize]);
            // By whole texels, so points of the grid stay such.
            let shift = [0, 1].map(|k| f64::from(place[k] + PADDING) - low[k].floor());
            corners[t] = self.flat[t].map(|p| [0, 1].map(|k| (p[k] + shift[k]) as f32));
        }
        let n_charts = sizes.len() as u32;
        Some(Projected { size, chart: self.chart, corners, n_charts, texels_per_unit: 0.0 })
    }
}

/// Places in rows of a page, and its height.
fn rows(sizes: &[[u32; 2]], order: &[usize], width: u32) -> (Vec<[u32; 2]>, u32) {
    let mut places = vec![[0; 2]; sizes.len()];
    let ([mut x, mut y], mut height) = ([0, 0], 0);
    for &i in order {
        let [w, h] = sizes[i];
        if x + w > width {
            (x, y) = (0, y + height);
            height = 0;
        }
        places[i] = [x, y];
        x += w;
        height = height.max(h);
    }
    (places, y + height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// A strip that winds around an axis like a spiral staircase, three times: seen from above it lies over itself.
    fn staircase() -> Mesh {
        let (n, turns) = (120, 3.0);
        let at = |i: u32, radius: f64| {
            let share = f64::from(i) / f64::from(n);
            let angle = turns * std::f64::consts::TAU * share;
            [radius * angle.cos(), radius * angle.sin(), 2.0 * share]
        };
        let positions = (0..=n).flat_map(|i| [at(i, 1.0), at(i, 3.0)]).collect();
        let triangles = (0..n).flat_map(|i| {
            let i = 2 * i;
            [[i, i + 1, i + 3], [i, i + 3, i + 2]]
        });
        Mesh::new(positions, triangles.collect())
    }

    #[test]
    fn no_texel_belongs_to_two_places() {
        let mesh = staircase();
        let page = project(&mesh, 20.0, 1024);
        assert_eq!(page.texels_per_unit, 20.0);
        assert!((2..12).contains(&page.n_charts), "{} charts", page.n_charts);
        let mut owner: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        for (t, corners) in page.corners.iter().enumerate() {
            assert_ne!(page.chart[t], NONE);
            let flat = corners.map(|p| p.map(f64::from));
            each_point(&flat, 1, 0..u32::MAX, |x, y, _| {
                assert!(x < f64::from(page.size[0]) && y < f64::from(page.size[1]));
                let other = owner.insert([x as u32, y as u32], t as u32);
                assert_eq!(other, None, "{x} {y}");
            });
        }
        // Charts keep their distance.
        for (&[x, y], &t) in &owner {
            for off in 1..2 * PADDING {
                for at in [[x + off, y], [x, y + off], [x + off, y + off]] {
                    let other = owner.get(&at).unwrap_or(&t);
                    assert_eq!(page.chart[t as usize], page.chart[*other as usize], "{x} {y}");
                }
            }
        }
    }

    #[test]
    fn what_does_not_fit_gets_fewer_texels() {
        let mesh = staircase();
        let page = project(&mesh, 5000.0, 256);
        assert!(page.size.iter().all(|&side| side <= 256), "{:?}", page.size);
        assert!((1.0..100.0).contains(&page.texels_per_unit));
        let nothing = Mesh::new(vec![[1.0; 3]; 3], vec![[0, 1, 2]]);
        assert_eq!(project(&nothing, 1.0, 256).chart, [NONE]);
    }
}
