//! Triangles of a chart that lie side by side, seen by their outline alone.
//!
//! All triangles are turned one way, so the outline goes as often around a point as triangles cover it. Where no edges of the
//! outline meet and one loop goes around all others, that is once at most. This takes n log n steps for fans and needles, which a
//! grid (`overlaps`) compares with each other in most of its cells. Says nothing of other outlines.

use super::overlaps::twice_area;
use std::collections::HashMap;
use stonecut_mesh::steps::{HUB, count};

/// A point of the plane of a chart.
type Point = [f64; 2];

/// Edges that are held against one of the outline in the mean, at most.
const MOST_BESIDE: usize = 64;

/// Rounding of a product of two lengths, as a share of it.
const ROUNDING: f64 = 1e-14;

/// The direction that edges are sorted along: across the sides of hardly any outline.
const ALONG: Point = [0.8, 0.617];

/// True if triangles are many, and seen not to overlap. False says nothing.
pub(super) fn is_simple(all: &[[Point; 3]]) -> bool {
    let Some(first) = all.first().filter(|_| all.len() > HUB) else { return false };
    let sense = twice_area(first).signum();
    if !all.iter().all(|t| sense * twice_area(t) > 0.0) {
        return false;
    }
    outline(all).is_some_and(|edges| has_one_outside(&edges, sense) && !may_meet(&edges))
}

/// Bits of a point; equal where points are.
fn key(p: Point) -> [u64; 2] {
    p.map(|x| (x + 0.0).to_bits())
}

/// Edges of triangles that no other triangle has; `None` where an edge has more than two.
fn outline(all: &[[Point; 3]]) -> Option<Vec<[Point; 2]>> {
    let mut edges: Vec<([[u64; 2]; 2], [Point; 2])> = Vec::with_capacity(3 * all.len());
    for t in all {
        for k in 0..3 {
            let edge = [t[k], t[(k + 1) % 3]];
            let mut ends = edge.map(key);
            ends.sort_unstable();
            edges.push((ends, edge));
        }
    }
    edges.sort_unstable_by_key(|(ends, _)| *ends);
    let mut out = Vec::new();
    for same in edges.chunk_by(|a, b| a.0 == b.0) {
        match same {
            [(_, edge)] => out.push(*edge),
            [(_, a), (_, b)] if key(a[0]) != key(b[0]) => {}
            _ => return None,
        }
    }
    Some(out)
}

/// True if the edges are loops, of which one alone goes around what lies within it.
fn has_one_outside(edges: &[[Point; 2]], sense: f64) -> bool {
    let mut next: HashMap<[u64; 2], usize> = HashMap::with_capacity(edges.len());
    for (i, edge) in edges.iter().enumerate() {
        if next.insert(key(edge[0]), i).is_some() {
            return false;
        }
    }
    let mut is_met = vec![false; edges.len()];
    let (mut n_outside, origin) = (0, edges.first().map_or([0.0; 2], |edge| edge[0]));
    for first in 0..edges.len() {
        let (mut at, mut area) = (first, 0.0);
        while !is_met[at] {
            is_met[at] = true;
            let [p, q] = edges[at];
            area += twice_area(&[origin, p, q]);
            match next.get(&key(q)) {
                Some(&i) => at = i,
                None => return false,
            }
        }
        n_outside += usize::from(sense * area > 0.0);
    }
    n_outside == 1
}

/// True if two edges meet otherwise than end to end, or nearly so; or if that takes long to find out.
fn may_meet(edges: &[[Point; 2]]) -> bool {
    let along = |p: Point| p[0] * ALONG[0] + p[1] * ALONG[1];
    let span = |edge: &[Point; 2]| {
        let [a, b] = edge.map(along);
        [a.min(b), a.max(b)]
    };
    let mut order: Vec<([f64; 2], u32)> = (0..).zip(edges).map(|(i, e)| (span(e), i)).collect();
    order.sort_unstable_by(|a, b| a.0[0].total_cmp(&b.0[0]).then(a.1.cmp(&b.1)));
    let (mut open, mut n): (Vec<([f64; 2], u32)>, usize) = (Vec::new(), 0);
    for (span, i) in order {
        open.retain(|(other, _)| other[1] >= span[0]);
        n += open.len();
        let edge = &edges[i as usize];
        let meets = |&(_, other): &([f64; 2], u32)| !is_apart(edge, &edges[other as usize]);
        if n > MOST_BESIDE * edges.len() || open.iter().any(meets) {
            count(n);
            return true;
        }
        open.push((span, i));
    }
    count(n);
    false
}

/// Twice the area of a triangle, 0 if rounding alone may make it so.
fn turn(a: Point, b: Point, c: Point) -> f64 {
    let area = twice_area(&[a, b, c]);
    let size = |p: Point, q: Point| (q[0] - p[0]).abs() + (q[1] - p[1]).abs();
    let is_certain = area.abs() > ROUNDING * size(a, b) * size(a, c);
    if is_certain { area } else { 0.0 }
}

/// True if two edges have nothing in common but an end.
fn is_apart(a: &[Point; 2], b: &[Point; 2]) -> bool {
    for (i, j) in [(0, 1), (1, 0)] {
        if key(a[i]) == key(b[j]) {
            // They may not lead back.
            let [p, q, r] = [a[1 - i], a[i], b[1 - j]];
            let ahead = (q[0] - p[0]) * (r[0] - q[0]) + (q[1] - p[1]) * (r[1] - q[1]);
            return turn(p, q, r) != 0.0 || ahead > 0.0;
        }
    }
    let beside = |[p, q]: [Point; 2], r: &[Point; 2]| turn(p, q, r[0]) * turn(p, q, r[1]) > 0.0;
    let gap = |k: usize| {
        let [low, high] = [a, b].map(|e| [e[0][k].min(e[1][k]), e[0][k].max(e[1][k])]);
        low[1] < high[0] || high[1] < low[0]
    };
    gap(0) || gap(1) || beside(*a, b) || beside(*b, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rim(i: usize, n: usize, radius: f64) -> Point {
        let (y, x) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
        [radius * x, radius * y]
    }

    #[test]
    fn fans_strips_and_rings_are_simple_and_what_turns_twice_is_not() {
        let n = 1000;
        let fan: Vec<_> =
            (0..n).map(|i| [[0.0; 2], rim(i, n, 1.0), rim((i + 1) % n, n, 1.0)]).collect();
        assert!(is_simple(&fan));
        assert!(!is_simple(&fan[..100]), "few");
        assert!(is_simple(&fan[..700]));
        let turned: Vec<_> = fan.iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert!(is_simple(&turned));
        assert!(!is_simple(&[&fan[..], &turned[..]].concat()));
        // Twice around, a little smaller the second time.
        let spiral = |i: usize| rim(i, n, 1.0 - 1e-4 * i as f64);
        let twice: Vec<_> = (0..2 * n).map(|i| [[0.0; 2], spiral(i), spiral(i + 1)]).collect();
        assert!(!is_simple(&twice) && is_simple(&twice[..900]));
        let ring = |i: usize| {
            let (a, b) = (i % n, (i + 1) % n);
            let [p, q, r, s] = [rim(a, n, 0.5), rim(a, n, 1.0), rim(b, n, 1.0), rim(b, n, 0.5)];
            [[p, q, r], [p, r, s]]
        };
        let ring: Vec<_> = (0..n).flat_map(ring).collect();
        assert!(is_simple(&ring));
        // A plate over the hole of the ring and more.
        let plate: Vec<_> = fan.iter().map(|t| t.map(|p| p.map(|x| 0.7 * x))).collect();
        assert!(!is_simple(&[&ring[..], &plate[..]].concat()));
        // A strip of needles, turned; two of them one over the other.
        let at = |v: usize, z: f64| {
            let (x, y) = ((v / 2) as f64 * 1e-3, (v % 2) as f64 + z);
            [0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y]
        };
        let strip = |z: f64| -> Vec<[Point; 3]> {
            let pair = |i: usize| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]];
            (0..n).flat_map(pair).map(|t| t.map(|v| at(v, z))).collect()
        };
        assert!(is_simple(&strip(0.0)));
        assert!(!is_simple(&[strip(0.0), strip(0.5)].concat()));
        assert!(!is_simple(&[strip(0.0), strip(3.0)].concat()), "two outsides");
    }
}
