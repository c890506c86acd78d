//! Cuts a polygon of space into triangles: exact for any simple polygon, with all its corners.
//!
//! A polygon lies in the plane of its Newell normal (the sum of the normals of a fan): corners that leave that plane
//! are projected along it. A quadrilateral is cut along the diagonal inside of it, the shorter one where both are.
//! More corners: a fan around the first corner where that is a triangulation, and ears (`earcut`) otherwise. Does not
//! read or write files.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // What is not a number fails every comparison.

use earcut::Earcut;
use std::collections::BTreeMap;
use stonecut_mesh::vec3::{cross, dot, sub};

/// Sine below which a corner is taken to lie on the straight line between its neighbours: ten steps of a float.
const FLAT: f64 = 1e-6;

/// Share of a polygon's area by which its triangles may miss it; more, and it crosses itself.
const MISSED: f64 = 1e-6;

/// Area below which nothing is left of a polygon but rounding, as a share of the squares of its edges.
const NO_AREA: f64 = 1e-12;

/// Diagonal of a quadrilateral that parts it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Diagonal {
    /// From the first corner to the third.
    First,
    /// From the second corner to the fourth.
    Second,
}

/// The diagonal of a quadrilateral, and whether its sides do not cross. Equal diagonals, and places that are not
/// numbers, give the first.
pub fn cut_quad(corners: [[f64; 3]; 4]) -> (Diagonal, bool) {
    let [a, b, c, d] = corners;
    let (first, second) = (sub(c, a), sub(d, b));
    let shorter = match dot(second, second) < dot(first, first) {
        true => Diagonal::Second,
        false => Diagonal::First,
    };
    let normal = cross(first, second);
    let twice_area = dot(normal, normal).sqrt();
    // Areas of the two triangles beside a diagonal as shares of the whole; the smaller one.
    let least = |p: [f64; 3], q: [f64; 3], r: [f64; 3], s: [f64; 3]| {
        let share = |t: [f64; 3]| dot(t, normal) / (twice_area * twice_area);
        let diagonal = sub(q, p);
        share(cross(sub(r, p), diagonal)).min(share(cross(diagonal, sub(s, p))))
    };
    if !(twice_area > NO_AREA * (dot(first, first) + dot(second, second))) {
        return (shorter, !(twice_area >= 0.0) || is_straight(&corners));
    }
    let (along_first, along_second) = (least(a, c, b, d), least(b, d, c, a));
    match (along_first > FLAT, along_second > FLAT) {
        (true, true) => (shorter, true),
        (true, false) => (Diagonal::First, true),
        (false, true) => (Diagonal::Second, true),
        (false, false) if along_second > along_first => (Diagonal::Second, along_second > -FLAT),
        (false, false) => (Diagonal::First, along_first > -FLAT),
    }
}

/// Cuts polygons of any number of corners; keeps its memory from one to the next.
pub struct PolygonCutter {
    earcut: Earcut<f64>,
    /// The polygon in its plane, its outside to the right.
    flat: Vec<[f64; 2]>,
    /// Corners that are not on a straight line, and where they lie.
    kept: Vec<usize>,
    ring: Vec<[f64; 2]>,
    ears: Vec<usize>,
    /// The result: corners by their place in the polygon.
    pub triangles: Vec<[usize; 3]>,
}

impl Default for PolygonCutter {
    fn default() -> Self {
        PolygonCutter {
            earcut: Earcut::new(),
            flat: Vec::new(),
            kept: Vec::new(),
            ring: Vec::new(),
            ears: Vec::new(),
            triangles: Vec::new(),
        }
    }
}

impl PolygonCutter {
    /// Fills `triangles`; false if the polygon crosses itself, so that no triangles are exactly its area.
    ///
    /// Time: n log n for n corners of common polygons. Memory: some 200 bytes a corner.
    pub fn cut(&mut self, corners: &[[f64; 3]]) -> bool {
        self.triangles.clear();
        if let [a, b, c, d] = *corners {
            let (diagonal, is_simple) = cut_quad([a, b, c, d]);
            self.triangles.extend(match diagonal {
                Diagonal::First => [[0, 1, 2], [0, 2, 3]],
                Diagonal::Second => [[0, 1, 3], [1, 2, 3]],
            });
            return is_simple;
        }
        let fan = |i| [0, i, i + 1];
        if !self.project(corners) {
            self.triangles.extend((1..corners.len().saturating_sub(1)).map(fan));
            return corners.len() < 4
                || is_straight(corners)
                || !corners.as_flattened().iter().all(|x| x.is_finite());
        }
        if corners.len() < 4 || self.is_fan() {
            self.triangles.extend((1..corners.len() - 1).map(fan));
            return true;
        }
        self.cut_ears();
        self.is_covered()
    }

    /// Lays the polygon into its plane; false if it has no area.
    fn project(&mut self, corners: &[[f64; 3]]) -> bool {
        let (mut normal, mut edges) = ([0.0; 3], 0.0);
        for (i, &corner) in corners.iter().enumerate() {
            let next = corners[(i + 1) % corners.len()];
            let part = cross(sub(corner, corners[0]), sub(next, corners[0]));
            (0..3).for_each(|axis| normal[axis] += part[axis]);
            edges += dot(sub(next, corner), sub(next, corner));
        }
        let length = dot(normal, normal).sqrt();
        if !(length > NO_AREA * edges) {
            return false;
        }
        let n = normal.map(|x| x / length);
        // The axis that is farthest from the normal; planes along two axes stay exact.
        let least = (0..3).fold(0, |best, i| if n[i].abs() < n[best].abs() { i } else { best });
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let side = cross(axis, n);
        let u = side.map(|x| x / dot(side, side).sqrt());
        let v = cross(n, u);
        self.flat.clear();
        self.flat.extend(corners.iter().map(|&corner| {
            let from = sub(corner, corners[0]);
            [dot(from, u), dot(from, v)]
        }));
        true
    }

    /// Returns whether all of the polygon is seen from its first corner, and no corner is on a straight line with it.
    fn is_fan(&self) -> bool {
        let mut turned = 0.0;
        for pair in self.flat[1..].windows(2) {
            let (a, b) = (minus(pair[0], self.flat[0]), minus(pair[1], self.flat[0]));
            let area = cross2(a, b);
            if !(area > FLAT * (dot2(a, a) * dot2(b, b)).sqrt()) {
                return false;
            }
            turned += area.atan2(dot2(a, b));
        }
        turned < std::f64::consts::TAU
    }

    /// Cuts ears off the corners that are not on straight lines, then puts the others back.
    fn cut_ears(&mut self) {
        let n = self.flat.len();
        self.kept.clear();
        self.kept.push(0);
        for i in 1..n {
            let last = self.flat[*self.kept.last().unwrap_or(&0)];
            let (before, behind) =
                (minus(self.flat[i], last), minus(self.flat[(i + 1) % n], self.flat[i]));
            let sine = cross2(before, behind).abs();
            let lengths = (dot2(before, before) * dot2(behind, behind)).sqrt();
            if !(sine <= FLAT * lengths && dot2(before, behind) > 0.0) {
                self.kept.push(i);
            }
        }
        self.ring.clear();
        self.ring.extend(self.kept.iter().map(|&i| self.flat[i]));
        self.earcut.earcut_slice(&self.ring, &[] as &[usize], &mut self.ears);
        let corners = |ear: &[usize]| [self.kept[ear[0]], self.kept[ear[1]], self.kept[ear[2]]];
        self.triangles.extend(self.ears.chunks_exact(3).map(corners));
        if self.triangles.len() + 2 < n {
            put_back(&self.flat, &mut self.triangles);
        }
    }

    /// Returns whether the triangles have the area of the polygon.
    fn is_covered(&self) -> bool {
        let n = self.flat.len();
        let whole: f64 = (0..n).map(|i| cross2(self.flat[i], self.flat[(i + 1) % n])).sum();
        let area = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| self.flat[i]);
            cross2(minus(b, a), minus(c, a)).abs()
        };
        let sum: f64 = self.triangles.iter().map(area).sum();
        (sum - whole).abs() <= MISSED * whole
    }
}

/// Puts corners that no triangle uses into the sides of those that pass over them, so that no T-junction is left.
///
/// Sides of triangles and of the polygon that have no other side opposite are loops without area: the longest side of
/// each is one of a triangle, and the others divide it.
fn put_back(flat: &[[f64; 2]], triangles: &mut Vec<[usize; 3]>) {
    let n = flat.len();
    let mut open: BTreeMap<(usize, usize), i32> = BTreeMap::new();
    let mut add = |from: usize, to: usize, by: i32| {
        let (key, by) = if from < to { ((from, to), by) } else { ((to, from), -by) };
        *open.entry(key).or_default() += by;
    };
    let mut owners: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    (0..n).for_each(|i| add(i, (i + 1) % n, 1));
    for (number, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            add(t[k], t[(k + 1) % 3], -1);
            owners.insert((t[k], t[(k + 1) % 3]), number);
        }
    }
    let mut next: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for ((low, high), count) in open {
        let (from, to) = if count > 0 { (low, high) } else { (high, low) };
        if count != 0 {
            next.entry(from).or_default().push(to);
        }
    }
    while let Some(&start) = next.keys().next() {
        // Loops may meet in a corner: the way is cut at the first corner that it comes back to.
        let (mut way, mut places) = (vec![start], BTreeMap::from([(start, 0)]));
        while let Some(&last) = way.last() {
            let Some(list) = next.get_mut(&last) else { break };
            let to = list.pop();
            if list.is_empty() {
                next.remove(&last);
            }
            let Some(to) = to else { break };
            match places.get(&to) {
                None => {
                    places.insert(to, way.len());
                    way.push(to);
                }
                Some(&place) => {
                    let ring: Vec<usize> = way[place..].to_vec();
                    way.truncate(place + 1);
                    ring[1..].iter().for_each(|corner| {
                        places.remove(corner);
                    });
                    divide(flat, ring, triangles, &mut owners);
                }
            }
        }
    }
}

/// Divides the triangle that has the longest side of a loop without area at the corners of the other sides.
fn divide(
    flat: &[[f64; 2]],
    mut ring: Vec<usize>,
    triangles: &mut Vec<[usize; 3]>,
    owners: &mut BTreeMap<(usize, usize), usize>,
) {
    let n = ring.len();
    let side = |i: usize| {
        let along = minus(flat[ring[(i + 1) % n]], flat[ring[i]]);
        dot2(along, along).sqrt()
    };
    let longest = (0..n).fold(0, |best, i| if side(i) > side(best) { i } else { best });
    let others: f64 = (0..n).filter(|&i| i != longest).map(side).sum();
    if others > side(longest) * (1.0 + 10.0 * FLAT) {
        return;
    }
    // Now the last corner and the first one are the ends of the longest side.
    ring.rotate_left((longest + 1) % n);
    let (first, last) = (ring[0], ring[n - 1]);
    let Some(&number) = owners.get(&(first, last)) else { return };
    let tip = triangles[number].iter().find(|&&i| i != first && i != last);
    let Some(&tip) = tip else { return };
    for (k, pair) in ring.windows(2).enumerate() {
        let triangle = [pair[0], pair[1], tip];
        let place = if k == 0 { number } else { triangles.len() };
        if k == 0 {
            triangles[number] = triangle;
        } else {
            triangles.push(triangle);
        }
        for k in 0..3 {
            owners.insert((triangle[k], triangle[(k + 1) % 3]), place);
        }
    }
}

/// Returns whether all corners lie on one line.
fn is_straight(corners: &[[f64; 3]]) -> bool {
    let far = corners
        .iter()
        .map(|&c| sub(c, corners[0]))
        .fold([0.0; 3], |far, c| if dot(c, c) > dot(far, far) { c } else { far });
    corners.iter().all(|&corner| {
        let area = cross(sub(corner, corners[0]), far);
        dot(area, area).sqrt() <= FLAT * dot(far, far)
    })
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot2(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross2(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
