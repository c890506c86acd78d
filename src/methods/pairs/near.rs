//! Pairs of vertices without an edge that may become one: their balls meet and they face each other across a gap.
//!
//! Balls as large as the edges around each vertex cover the surface, and where two meet the parts are nearer to each other than
//! triangles are long (a Cech complex of the vertices, as in Liu, Zhang & Yuksel 2025). Facing keeps the two sides of a
//! wall apart, which would be eaten away from within, and leaves gaps, cracks and tunnels. Sets no price.

use crate::surface::Surface;
use std::collections::{BTreeSet, HashMap};
use stonecut_mesh::steps::{HUB, count};
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, normal, scale, sub, unit};

/// Radius of a ball, in mean lengths of the edges around its vertex: two vertices pair up to twice the length apart.
const RADIUS: f64 = 1.0;
/// Radii are at most this many times the median, so that a few long triangles do not fill the lists.
const LARGEST: f64 = 3.0;
/// Least cosine between a normal and the way to the other vertex.
const FACING: f64 = 0.3;
/// Nearest partners that a vertex looks at.
const MOST: usize = 4;
/// Vertices that each looks at on the mean, at most; balls are made smaller where these are more, which takes needles: scans have
/// hundreds.
const MOST_LOOKS: u64 = 4096;
/// Times that balls are halved, at most. Vertices in one place are still together then.
const MOST_HALVINGS: u32 = 40;
/// Vertices at most this part of a ball apart are in one place.
const SAME_PLACE: f64 = 1e-6;

/// The vertices of a mesh as pairing needs them.
struct Vertices {
    used: Vec<u32>,
    normals: Vec<Option<Vec3>>,
    radii: Vec<f64>,
    is_boundary: Vec<bool>,
    is_hub: Vec<bool>,
}

impl Vertices {
    fn of(surface: &Surface) -> Vertices {
        let n = surface.positions.len();
        let mut sums = vec![[0.0; 3]; n];
        let mut lengths = vec![(0.0f64, 0u32); n];
        let mut sides: Vec<[u32; 2]> = Vec::with_capacity(3 * surface.n_alive());
        for corners in surface.alive() {
            let weighted = normal(corners.map(|v| surface.positions[v as usize]));
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let [p, q] = [a, b].map(|v| surface.positions[v as usize]);
                let length = length_sq(sub(p, q)).sqrt();
                for v in [a, b] {
                    lengths[v as usize].0 += length;
                    lengths[v as usize].1 += 1;
                }
                sums[a as usize] = add(sums[a as usize], weighted);
                sides.push([a.min(b), a.max(b)]);
            }
        }
        sides.sort_unstable();
        let mut is_boundary = vec![false; n];
        for edge in sides.chunk_by(|a, b| a == b).filter(|edge| edge.len() == 1) {
            edge[0].iter().for_each(|&v| is_boundary[v as usize] = true);
        }
        let used: Vec<u32> = (0..n as u32).filter(|&v| surface.is_used(v)).collect();
        // Each triangle has told of two edges.
        let is_hub = lengths.iter().map(|(_, n)| *n as usize > 2 * HUB).collect();
        let mut radii: Vec<f64> =
            lengths.iter().map(|(sum, n)| RADIUS * sum / f64::from((*n).max(1))).collect();
        let mut sorted: Vec<f64> = used.iter().map(|&v| radii[v as usize]).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let most = LARGEST * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        radii.iter_mut().for_each(|radius| *radius = radius.min(most));
        let normals = sums.into_iter().map(unit).collect();
        Vertices { used, normals, radii, is_boundary, is_hub }
    }

    /// True if two vertices face each other, lie on boundaries, or in one place.
    fn may_pair(&self, surface: &Surface, a: u32, b: u32) -> bool {
        let way = sub(surface.positions[b as usize], surface.positions[a as usize]);
        let [a, b] = [a, b].map(|v| v as usize);
        if self.is_boundary[a] && self.is_boundary[b] {
            return true;
        }
        let length = length_sq(way).sqrt();
        if length <= SAME_PLACE * (self.radii[a] + self.radii[b]) {
            return true;
        }
        let (Some(of_a), Some(of_b)) = (self.normals[a], self.normals[b]) else { return false };
        let way = scale(way, 1.0 / length);
        dot(of_a, way) > FACING && dot(of_b, way) < -FACING
    }
}

/// Rings of hubs, found once.
#[derive(Default)]
struct Hubs {
    rings: HashMap<u32, BTreeSet<u32>>,
    /// For each vertex the number of the set of hubs beside it; 0 if there is none.
    beside: Vec<u32>,
}

impl Hubs {
    fn of(surface: &Surface, is_hub: &[bool]) -> Hubs {
        let mut beside = vec![0; is_hub.len()];
        let all = (0..is_hub.len() as u32).filter(|&v| is_hub[v as usize]);
        let rings: HashMap<u32, BTreeSet<u32>> = all.map(|v| (v, ring(surface, v))).collect();
        let mut known = HashMap::new();
        for &v in rings.values().flatten() {
            if beside[v as usize] == 0 {
                let of_v: Vec<u32> = match is_hub[v as usize] {
                    true => rings.keys().filter(|hub| rings[hub].contains(&v)).copied().collect(),
                    false => ring(surface, v).into_iter().filter(|w| is_hub[*w as usize]).collect(),
                };
                let of_v: BTreeSet<u32> = of_v.into_iter().collect();
                let number = known.len() as u32 + 1;
                beside[v as usize] = *known.entry(of_v).or_insert(number);
            }
        }
        Hubs { rings, beside }
    }
}

/// True if two sets have nothing in common. Takes as long as the smaller one.
fn are_disjoint(a: &BTreeSet<u32>, b: &BTreeSet<u32>) -> bool {
    let (few, many) = if a.len() < b.len() { (a, b) } else { (b, a) };
    !few.iter().any(|v| many.contains(v))
}

/// The vertices that share a triangle with `vertex`.
fn ring(surface: &Surface, vertex: u32) -> BTreeSet<u32> {
    surface.around(vertex).flat_map(|t| surface.corners(t)).filter(|&v| v != vertex).collect()
}

/// A vertex with its cell, and the hubs that it is beside.
type Place = ([i64; 3], u32, u32);

/// The first and the last cell of each of nine rows around a cell; what lies in a row is one run of sorted places.
fn rows([x, y, z]: [i64; 3]) -> impl Iterator<Item = [[i64; 3]; 2]> {
    let beside = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy)));
    beside.map(move |(dx, dy)| [[x + dx, y + dy, z - 1], [x + dx, y + dy, z + 1]])
}

/// Pairs of vertices in the same cell or in cells beside each other; each twice.
fn looks(places: &[Place]) -> u64 {
    let n_in_rows = |cell: [i64; 3]| -> u64 {
        let n_in = |[first, last]: [[i64; 3]; 2]| {
            let start = places.partition_point(|place| place.0 < first);
            places[start..].partition_point(|place| place.0 <= last) as u64
        };
        rows(cell).map(n_in).sum()
    };
    places
        .chunk_by(|a, b| a.0 == b.0)
        .map(|of_one| of_one.len() as u64 * n_in_rows(of_one[0].0))
        .sum()
}

/// All pairs, lower vertex first, in ascending order.
///
/// Pairs with a common neighbour are left out: edges close those gaps.
pub(super) fn pairs(surface: &Surface) -> Vec<[u32; 2]> {
    let mut vertices = Vertices::of(surface);
    let mut largest = vertices.used.iter().map(|&v| vertices.radii[v as usize]).fold(0.0, f64::max);
    if largest <= 0.0 || !largest.is_finite() {
        return Vec::new();
    }
    let hubs = Hubs::of(surface, &vertices.is_hub);
    // A partner is at most two radii away, so in this cell of the grid or beside it.
    let cell = |p: Vec3, side: f64| p.map(|x| (x / side).floor() as i64);
    let place =
        |v: u32, side: f64| (cell(surface.positions[v as usize], side), hubs.beside[v as usize], v);
    let mut places: Vec<Place> = Vec::new();
    let mut n_halvings = 0;
    loop {
        places.clear();
        places.extend(vertices.used.iter().map(|&v| place(v, 2.0 * largest)));
        places.sort_unstable();
        let is_crowded = looks(&places) > MOST_LOOKS * vertices.used.len() as u64;
        if !is_crowded || n_halvings == MOST_HALVINGS {
            break;
        }
        n_halvings += 1;
        largest *= 0.5;
    }
    vertices.radii.iter_mut().for_each(|radius| *radius = radius.min(largest));
    let most_looks = if n_halvings < MOST_HALVINGS { u64::MAX } else { MOST_LOOKS };
    let mut found = Vec::new();
    let mut near: Vec<(f64, u32)> = Vec::new();
    for &a in &vertices.used {
        let at = surface.positions[a as usize];
        near.clear();
        let mut n_looks = 0;
        for [first, last] in rows(cell(at, 2.0 * largest)) {
            let mut next = places.partition_point(|place| place.0 < first);
            while let Some(&(cell, beside, b)) = places.get(next).filter(|place| place.0 <= last) {
                // Vertices beside the same hub have a common neighbour, all of them.
                if beside > 0 && beside == hubs.beside[a as usize] {
                    let rest = &places[next..];
                    next += rest.partition_point(|place| (place.0, place.1) <= (cell, beside));
                    continue;
                }
                next += 1;
                n_looks += 1;
                if n_looks > most_looks {
                    break;
                }
                let apart = length_sq(sub(surface.positions[b as usize], at));
                let reach = vertices.radii[a as usize] + vertices.radii[b as usize];
                if a != b && apart <= reach * reach && vertices.may_pair(surface, a, b) {
                    near.push((apart, b));
                }
            }
        }
        count(n_looks as usize);
        if near.is_empty() {
            continue;
        }
        near.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        count(near.len());
        let own = &ring(surface, a);
        let is_apart = |b: u32| {
            !own.contains(&b)
                && match hubs.rings.get(&b) {
                    Some(ring) => are_disjoint(own, ring),
                    None => are_disjoint(own, &ring(surface, b)),
                }
        };
        let partners = near.iter().map(|&(_, b)| b).filter(|&b| is_apart(b)).take(MOST);
        found.extend(partners.map(|b| [a.min(b), a.max(b)]));
    }
    found.sort_unstable();
    found.dedup();
    found
}
