//! Takes a triangle mesh apart where it is not manifold: edges of more than two triangles, vertices of more than one fan.
//!
//! Triangles at an edge are paired, those of opposite direction, the flattest first; the corners that hang together over
//! pairs become one vertex each. So a vertex has one fan, an edge one pair or a boundary, and no triangle is lost. Source:
//! cutting after Gueziec et al. 1998 (docs/references.md).

use super::book::pair_pages;
use std::collections::VecDeque;
use stonecut_mesh::steps::HUB;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::{Vec3, dot, length_sq, normal};

/// A side of a triangle: its ends, the lower one first, and the corner at which it begins.
type Side = ([u32; 2], u32);

/// Bytes that taking a mesh apart needs for each triangle: sides, pairs, fans.
pub const TRIANGLE_BYTES: u64 = 84;

/// No pair.
const NONE: u32 = u32::MAX;

/// The corner after this one, which is three times the triangle's number and 0, 1 or 2.
fn next(corner: u32) -> u32 {
    corner - corner % 3 + (corner + 1) % 3
}

/// Renumbers the corners of `triangles` so that the mesh is manifold. Returns the vertex that each vertex beyond those of
/// `positions` is a copy of.
///
/// Memory: `TRIANGLE_BYTES` for each triangle, while it runs.
pub fn take_apart(positions: &[Vec3], triangles: &mut [[u32; 3]]) -> Vec<u32> {
    let mut pairs = pairs(positions, triangles);
    loop {
        let fans = fans(triangles.len(), &pairs);
        let crowded = crowded(&pairs, &fans);
        if crowded.is_empty() {
            return renumber(positions.len(), triangles, &fans);
        }
        let mut crowded = crowded.into_iter().peekable();
        let mut place = 0;
        pairs.retain(|_| {
            place += 1;
            crowded.next_if_eq(&(place - 1)).is_none()
        });
    }
}

/// Turns those of the triangles `two_sided` over that do not agree with their neighbours, from those outwards that may not
/// be turned.
///
/// Memory: less than `TRIANGLE_BYTES` for each triangle.
pub fn orient(triangles: &mut [[u32; 3]], two_sided: &[u32]) {
    if two_sided.is_empty() {
        return;
    }
    let corner = |at: u32| triangles[at as usize / 3][at as usize % 3];
    let ends = |at: u32| {
        let (a, b) = (corner(at), corner(next(at)));
        [a.min(b), a.max(b)]
    };
    let mut sides: Vec<u32> = (0..3 * triangles.len() as u32).collect();
    sides.sort_unstable_by_key(|&at| (ends(at), at));
    // For each side the first place of its edge.
    let mut first = vec![0; sides.len()];
    let mut start = 0;
    for (place, &at) in sides.iter().enumerate() {
        if ends(at) != ends(sides[start]) {
            start = place;
        }
        first[at as usize] = start;
    }
    let mut is_known = vec![true; triangles.len()];
    two_sided.iter().for_each(|&t| is_known[t as usize] = false);
    let mut is_turned = vec![false; triangles.len()];
    let is_ahead = |at: u32, turned: bool| (corner(at) == ends(at)[0]) != turned;
    let mut queue: VecDeque<u32> =
        (0..triangles.len() as u32).filter(|&t| is_known[t as usize]).collect();
    for &seed in two_sided.iter().chain(&[NONE]) {
        while let Some(t) = queue.pop_front() {
            for at in 3 * t..3 * t + 3 {
                let own = is_ahead(at, is_turned[t as usize]);
                let edge = sides[first[at as usize]..].iter();
                for &other in edge.take_while(|&&side| first[side as usize] == first[at as usize]) {
                    let neighbour = other as usize / 3;
                    if !is_known[neighbour] {
                        is_known[neighbour] = true;
                        is_turned[neighbour] = is_ahead(other, false) == own;
                        queue.push_back(neighbour as u32);
                    }
                }
            }
        }
        if seed != NONE && !is_known[seed as usize] {
            is_known[seed as usize] = true;
            queue.push_back(seed);
        }
    }
    triangles
        .iter_mut()
        .zip(is_turned)
        .filter(|(_, turned)| *turned)
        .for_each(|(t, _)| t.swap(1, 2));
}

/// Sides that belong together, by the corners at which they begin.
fn pairs(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let normal_at =
        |corner: u32| normal(triangles[corner as usize / 3].map(|v| positions[v as usize]));
    let corner = |at: u32| triangles[at as usize / 3][at as usize % 3];
    let mut sides: Vec<Side> = (0..3 * triangles.len() as u32)
        .map(|at| (corner(at), corner(next(at)), at))
        .map(|(a, b, at)| ([a.min(b), a.max(b)], at))
        .collect();
    sides.sort_unstable();
    let is_forward = |&(ends, at): &Side| corner(at) == ends[0];
    let mut pairs = Vec::new();
    for edge in sides.chunk_by(|a, b| a.0 == b.0) {
        if let [one, other] = edge
            && is_forward(one) != is_forward(other)
        {
            pairs.push([one.1, other.1]);
            continue;
        }
        if edge.len() > HUB {
            let page = |side: &Side| {
                let third = corner(next(next(side.1)));
                (positions[third as usize], is_forward(side), side.1)
            };
            let pages: Vec<(Vec3, bool, u32)> = edge.iter().map(page).collect();
            pairs.extend(pair_pages(edge[0].0.map(|v| positions[v as usize]), &pages));
            continue;
        }
        let mut candidates = Vec::new();
        for one in edge.iter().filter(|side| is_forward(side)) {
            for other in edge.iter().filter(|side| !is_forward(side)) {
                let [n, m] = [one, other].map(|side| normal_at(side.1));
                let lengths = (length_sq(n) * length_sq(m)).sqrt().max(f64::MIN_POSITIVE);
                candidates.push((-dot(n, m) / lengths, [one.1, other.1]));
            }
        }
        candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let first = pairs.len();
        for (_, [one, other]) in candidates {
            let is_free = |pair: &[u32; 2]| pair[0] != one && pair[1] != other;
            if pairs[first..].iter().all(is_free) {
                pairs.push([one, other]);
            }
        }
    }
    pairs
}

/// For each corner the lowest one of its fan.
fn fans(n_triangles: usize, pairs: &[[u32; 2]]) -> Vec<u32> {
    let mut union = Union::new(3 * n_triangles);
    for &[one, other] in pairs {
        union.join(one, next(other));
        union.join(next(one), other);
    }
    union.into_roots()
}

/// Places in `pairs` of those that have to part, in ascending order: of edges that fans share with others still.
fn crowded(pairs: &[[u32; 2]], fans: &[u32]) -> Vec<u32> {
    let mut pair_of = vec![NONE; fans.len()];
    for (place, corners) in (0..).zip(pairs) {
        corners.iter().for_each(|&corner| pair_of[corner as usize] = place);
    }
    let mut sides: Vec<([u32; 2], bool, u32)> = (0..fans.len() as u32)
        .map(|corner| (fans[corner as usize], fans[next(corner) as usize], corner))
        .map(|(a, b, corner)| ([a.min(b), a.max(b)], a < b, corner))
        .collect();
    sides.sort_unstable();
    let mut part = Vec::new();
    for edge in sides.chunk_by(|a, b| a.0 == b.0) {
        let is_sound = edge.len() == 1 || edge.len() == 2 && edge[0].1 != edge[1].1;
        if is_sound {
            continue;
        }
        let mut own: Vec<u32> = edge.iter().map(|side| pair_of[side.2 as usize]).collect();
        own.sort_unstable();
        own.dedup();
        let is_paired = own.last() != Some(&NONE);
        own.retain(|&pair| pair != NONE);
        match own.is_empty() {
            // Nothing holds them together here, so they are let go at their other sides.
            true => part.extend(edge.iter().flat_map(|side| {
                let first = side.2 - side.2 % 3;
                (first..first + 3).map(|corner| pair_of[corner as usize])
            })),
            false => part.extend(&own[usize::from(is_paired)..]),
        }
    }
    part.retain(|&pair| pair != NONE);
    part.sort_unstable();
    part.dedup();
    part
}

/// Gives each fan a vertex: the first one of a vertex keeps its number.
fn renumber(n_vertices: usize, triangles: &mut [[u32; 3]], fans: &[u32]) -> Vec<u32> {
    let mut fan_of = vec![u32::MAX; n_vertices];
    let mut number = vec![u32::MAX; fans.len()];
    let mut copies = Vec::new();
    for corner in 0..fans.len() {
        let (vertex, fan) = (triangles[corner / 3][corner % 3], fans[corner] as usize);
        if number[fan] == u32::MAX {
            number[fan] = match fan_of[vertex as usize] {
                u32::MAX => {
                    fan_of[vertex as usize] = fan as u32;
                    vertex
                }
                _ => {
                    copies.push(vertex);
                    (n_vertices + copies.len() - 1) as u32
                }
            };
        }
        triangles[corner / 3][corner % 3] = number[fan];
    }
    copies
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// Fails unless every edge has one triangle, or two in opposite directions, and every vertex one fan.
    fn assert_manifold(triangles: &[[u32; 3]], what: &str) {
        let mut ahead = BTreeMap::<[u32; 2], u32>::new();
        let mut around = BTreeMap::<u32, Vec<[u32; 2]>>::new();
        for &[a, b, c] in triangles {
            for [a, b, c] in [[a, b, c], [b, c, a], [c, a, b]] {
                *ahead.entry([a, b]).or_default() += 1;
                around.entry(a).or_default().push([b, c]);
            }
        }
        assert!(ahead.values().all(|&n| n == 1), "{what}: an edge twice in one direction");
        for (vertex, spokes) in around {
            let mut seen = BTreeSet::from([spokes[0][0]]);
            while spokes.iter().any(|s| seen.contains(&s[0]) != seen.contains(&s[1])) {
                let new: Vec<[u32; 2]> =
                    spokes.iter().filter(|s| s.iter().any(|v| seen.contains(v))).copied().collect();
                seen.extend(new.into_iter().flatten());
            }
            assert!(spokes.iter().all(|s| seen.contains(&s[0])), "{what}: two fans at {vertex}");
        }
    }

    #[test]
    fn what_is_manifold_stays_and_the_rest_comes_apart() {
        let places: Vec<Vec3> =
            (0..9).map(f64::from).map(|x| [x * x % 7.0, x * x * x % 5.0, x % 3.0]).collect();
        let mut tetrahedron = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        assert!(take_apart(&places, &mut tetrahedron).is_empty());
        assert_eq!(tetrahedron, [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]);
        let mut bow = [[0, 1, 2], [0, 3, 4]];
        assert_eq!(take_apart(&places, &mut bow), [0]);
        assert_eq!(bow, [[0, 1, 2], [9, 3, 4]]);
        let mut book = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]];
        assert_eq!(take_apart(&places, &mut book).len(), 2);
        assert_manifold(&book, "book");
    }

    #[test]
    fn what_may_be_turned_over_agrees_with_its_neighbours() {
        let whole = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        let mut mixed = [[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 3, 0]];
        orient(&mut mixed, &[1, 2, 3]);
        let sorted = |triangles: [[u32; 3]; 4]| {
            triangles.map(|t| {
                let least = (0..3).min_by_key(|&k| t[k]).unwrap_or(0);
                [t[least], t[(least + 1) % 3], t[(least + 2) % 3]]
            })
        };
        assert_eq!(sorted(mixed), sorted(whole));
        let mut fixed = [[0, 1, 2], [0, 1, 3]];
        orient(&mut fixed, &[]);
        assert_eq!(fixed, [[0, 1, 2], [0, 1, 3]]);
        // All may be turned: the first one stays.
        orient(&mut fixed, &[0, 1]);
        assert_eq!(fixed, [[0, 1, 2], [0, 3, 1]]);
    }

    #[test]
    fn any_soup_becomes_manifold_and_keeps_its_triangles() {
        let mut random = 1u64;
        let mut draw = |n: u64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695);
            (random >> 33) % n
        };
        for round in 0..300 {
            let n = 4 + draw(9);
            let places: Vec<Vec3> = (0..n).map(|_| [0; 3].map(|_| draw(100) as f64)).collect();
            let mut triangles: Vec<[u32; 3]> = (0..2 + draw(60))
                .map(|_| [0; 3].map(|_| draw(n) as u32))
                .filter(|[a, b, c]| a != b && b != c && c != a)
                .collect();
            let before = triangles.clone();
            let copies = take_apart(&places, &mut triangles);
            assert_manifold(&triangles, &format!("soup {round}"));
            let old = |v: u32| copies.get((v as usize).wrapping_sub(n as usize)).map_or(v, |&v| v);
            assert_eq!(before, triangles.iter().map(|t| t.map(old)).collect::<Vec<_>>());
        }
    }
}
