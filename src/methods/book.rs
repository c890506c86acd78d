//! Pairs of pages of a book: triangles of one edge, of which there are too many to try every two.
//!
//! As in `manifold`, the flattest pair comes first. A page is an angle around the edge; turned half around, the angle of a page of the other
//! direction is that of its flattest partner. The two that are nearest to each other on the circle are neighbours there, so one queue of
//! neighbours is enough.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, TAU};
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{Vec3, cross, dot, sub, unit};

/// A page: its angle, half a turn off if it is forward, and the caller's number.
struct Page {
    angle: f64,
    is_forward: bool,
    number: u32,
}

/// Two pages that may be a pair: bits of the angle between them, their numbers, their places on the circle.
type Near = Reverse<(u64, [u32; 2], [usize; 2])>;

/// Pairs forward pages with others, the flattest first, until one kind is used up. Pages are given by the corner that is not on the
/// edge, whether they go along it, and a number.
pub(super) fn pair_pages(edge: [Vec3; 2], pages: &[(Vec3, bool, u32)]) -> Vec<[u32; 2]> {
    let axis = unit(sub(edge[1], edge[0])).unwrap_or([0.0, 0.0, 1.0]);
    let aside = if axis[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let across = unit(cross(axis, aside)).unwrap_or(aside);
    let along = cross(axis, across);
    let page = |&(corner, is_forward, number): &(Vec3, bool, u32)| {
        let off = sub(corner, edge[0]);
        let angle = dot(off, along).atan2(dot(off, across));
        let angle = if is_forward { angle + PI } else { angle };
        Page { angle: angle.rem_euclid(TAU), is_forward, number }
    };
    let mut circle: Vec<Page> = pages.iter().map(page).collect();
    circle.sort_unstable_by(|a, b| a.angle.total_cmp(&b.angle).then(a.number.cmp(&b.number)));
    let n = circle.len();
    let mut next: Vec<usize> = (0..n).map(|i| (i + 1) % n).collect();
    let mut last: Vec<usize> = (0..n).map(|i| (i + n - 1) % n).collect();
    let near = |i: usize, j: usize| {
        let (a, b) = (&circle[i], &circle[j]);
        let apart = (b.angle - a.angle).rem_euclid(TAU);
        let (forward, other) = if a.is_forward { (a, b) } else { (b, a) };
        let numbers = [forward.number, other.number];
        // The bits of floats that are not negative are in the order of the floats.
        let entry = Reverse((apart.min(TAU - apart).to_bits(), numbers, [i, j]));
        (a.is_forward != b.is_forward).then_some(entry)
    };
    let mut queue: BinaryHeap<Near> = (0..n).filter_map(|i| near(i, next[i])).collect();
    let mut is_free = vec![true; n];
    let mut pairs = Vec::new();
    while let Some(Reverse((_, numbers, places))) = queue.pop() {
        if !places.iter().all(|&i| is_free[i]) {
            continue;
        }
        pairs.push(numbers);
        for i in places {
            is_free[i] = false;
            (next[last[i]], last[next[i]]) = (next[i], last[i]);
        }
        let [i, j] = places;
        // What is left of the first one, and what is left behind the second.
        let (from, to) = (last[i], next[j]);
        if is_free[from] && is_free[to] {
            queue.extend(near(from, to));
        }
    }
    count(n + pairs.len());
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_paired_as_if_every_two_were_tried() {
        let mut random = 1u64;
        let mut draw = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695);
            (random >> 33) as f64 / (1u64 << 31) as f64
        };
        for n in [1, 2, 3, 7, 40] {
            let edge = [[draw(), draw(), draw()], [1.0 + draw(), draw(), draw()]];
            let pages: Vec<(Vec3, bool, u32)> = (0..n)
                .map(|i| ([draw(), 9.0 * draw() - 4.0, 9.0 * draw() - 4.0], draw() < 0.5, i))
                .collect();
            let normal = |(corner, is_forward, _): &(Vec3, bool, u32)| {
                let n = unit(cross(sub(edge[1], edge[0]), sub(*corner, edge[0]))).unwrap();
                if *is_forward { n } else { n.map(|x| -x) }
            };
            let mut all = Vec::new();
            for a in pages.iter().filter(|page| page.1) {
                for b in pages.iter().filter(|page| !page.1) {
                    all.push((-dot(normal(a), normal(b)), [a.2, b.2]));
                }
            }
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut expected: Vec<[u32; 2]> = Vec::new();
            for (_, [a, b]) in all {
                if expected.iter().all(|pair| pair[0] != a && pair[1] != b) {
                    expected.push([a, b]);
                }
            }
            assert_eq!(pair_pages(edge, &pages), expected, "{n} pages");
        }
    }
}
