//! Pairs of triangles at hubs: places that are a corner of many.
//!
//! Boxes of triangles with a common corner all touch. So those of a hub leave the tree of boxes, and are looked at from the
//! hub (`mesh::sight`): there two of them that meet have a common direction. Triangles that have an edge at the hub
//! in common have that direction in common, too, as the pages of a book; of these two meet if they are at the same
//! angle around the edge.

use super::boxes::{Boxes, Item};
use std::collections::HashMap;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::sight::{Faces, seen_of};
use stonecut_mesh::steps::HUB;
use stonecut_mesh::vec3::{Vec3, cross, dot, length_sq, place_bits, sub, unit};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Corners of triangles.
type Corners = [Vec3; 3];

/// Angles of corners that are nearer to an edge than this share of their distance are not known.
const NEAREST: f64 = 1e-6;

/// Angles are known at least to this, on the unit circle.
const MARGIN: f64 = 2e-8;

/// A hub and the triangles that are not those of an earlier one.
pub(super) struct Hub {
    place: Vec3,
    pub(super) own: Vec<u32>,
    /// Their box.
    pub(super) hull: Bounds,
}

/// A triangle as a hub sees it.
struct Sight {
    id: u32,
    faces: Faces,
}

/// A number below `n`, a power of two, for a place.
fn bucket(place: Vec3, n: usize) -> usize {
    let mix = |sum: u64, x: u64| (sum ^ x).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
    (place_bits(place).into_iter().fold(0, mix) >> 7) as usize & (n - 1)
}

/// Takes the triangles of hubs out of `items`.
///
/// Memory: 2 bytes for each item; where there are hubs, 100 for each triangle of these.
pub(super) fn take_hubs(items: &mut Vec<Item>, corners: impl Fn(u32) -> Corners) -> Vec<Hub> {
    if items.len() <= HUB {
        return Vec::new();
    }
    let n_buckets = (items.len() / 2).next_power_of_two().max(1024);
    let mut n_in = vec![0u16; n_buckets];
    for place in items.iter().flat_map(|item| corners(item.id)) {
        let n = &mut n_in[bucket(place, n_buckets)];
        *n = n.saturating_add(1);
    }
    let is_full = |place: Vec3| usize::from(n_in[bucket(place, n_buckets)]) > HUB;
    if n_in.iter().all(|n| usize::from(*n) <= HUB) {
        return Vec::new();
    }
    let mut n_at: HashMap<[u64; 3], usize> = HashMap::new();
    for place in items.iter().flat_map(|item| corners(item.id)).filter(|place| is_full(*place)) {
        *n_at.entry(place_bits(place)).or_default() += 1;
    }
    let mut order: Vec<(usize, [u64; 3])> =
        n_at.into_iter().map(|(key, n)| (n, key)).filter(|(n, _)| *n > HUB).collect();
    order.sort_unstable_by(|a, b| b.cmp(a));
    let rank: HashMap<[u64; 3], usize> =
        order.iter().enumerate().map(|(rank, (_, key))| (*key, rank)).collect();
    let hub = |(_, key): &(usize, [u64; 3])| Hub {
        place: key.map(f64::from_bits),
        own: Vec::new(),
        hull: Bounds::EMPTY,
    };
    let mut hubs: Vec<Hub> = order.iter().map(hub).collect();
    items.retain(|item| {
        let first = corners(item.id).iter().filter_map(|place| rank.get(&place_bits(*place))).min();
        let Some(&first) = first else { return true };
        hubs[first].own.push(item.id);
        hubs[first].hull = hubs[first].hull.joined(&item.bounds);
        false
    });
    hubs.retain(|hub| !hub.own.is_empty());
    hubs
}

impl Hub {
    /// Calls `visit` for pairs of the hub's own triangles that may meet, each once.
    pub(super) fn pairs(
        &self,
        corners: impl Fn(u32) -> Corners,
        progress: &Progress,
        mut visit: impl FnMut(u32, u32),
    ) -> Result<()> {
        // Books first: triangles with a second corner in common.
        let mut n_at: HashMap<[u64; 3], usize> = HashMap::new();
        for place in self.own.iter().flat_map(|&t| corners(t)) {
            *n_at.entry(place_bits(place)).or_default() += 1;
        }
        let is_edge = |place: &Vec3| *place != self.place && n_at[&place_bits(*place)] > HUB;
        let mut rest = Vec::new();
        let mut books: Vec<(Vec3, Vec<u32>)> = Vec::new();
        let mut number: HashMap<[u64; 3], usize> = HashMap::new();
        for &t in &self.own {
            match corners(t).into_iter().find(is_edge) {
                None => rest.push(t),
                Some(end) => {
                    let number = *number.entry(place_bits(end)).or_insert_with(|| {
                        books.push((end, Vec::new()));
                        books.len() - 1
                    });
                    books[number].1.push(t);
                }
            }
        }
        let sights = |list: &[u32]| self.sights(list.iter().map(|&t| (t, corners(t))));
        let mut done = sights(&rest);
        join(&done, None, progress, &mut visit)?;
        for (end, pages) in books {
            pages_pairs([self.place, end], &pages, &corners, progress, &mut visit)?;
            let own = sights(&pages);
            join(&done, Some(&own), progress, &mut visit)?;
            done.extend(own);
        }
        Ok(())
    }

    /// Calls `visit` for pairs of one of the hub's triangles and one of others that may meet, each once.
    pub(super) fn pairs_with(
        &self,
        corners: impl Fn(u32) -> Corners,
        others: impl Iterator<Item = (u32, Corners)>,
        progress: &Progress,
        mut visit: impl FnMut(u32, u32),
    ) -> Result<()> {
        let near = others.filter(|(_, t)| Bounds::around(t).touches(&self.hull));
        let others = self.sights(near);
        if others.is_empty() {
            return Ok(());
        }
        let own = self.sights(self.own.iter().map(|&t| (t, corners(t))));
        join(&own, Some(&others), progress, &mut visit)
    }

    fn sights(&self, triangles: impl Iterator<Item = (u32, Corners)>) -> Vec<Sight> {
        triangles.map(|(id, t)| Sight { id, faces: seen_of(self.place, &t) }).collect()
    }
}

/// Visits the pairs of a list, or of it and another one, that touch on a face, each once.
fn join(
    own: &[Sight],
    other: Option<&[Sight]>,
    progress: &Progress,
    visit: &mut impl FnMut(u32, u32),
) -> Result<()> {
    for face in 0..6 {
        let boxes = |list: &[Sight]| {
            let all = (0..).zip(list).map(|(id, sight)| Item { bounds: sight.faces[face], id });
            Boxes::build(all.filter(|item| !item.bounds.is_empty()).collect(), progress)
        };
        let others = other.unwrap_or(own);
        let found = |i: u32, j: u32| {
            let (a, b) = (&own[i as usize], &others[j as usize]);
            // On an earlier face they were visited already.
            if !(0..face).any(|face| a.faces[face].touches(&b.faces[face])) {
                visit(a.id, b.id);
            }
        };
        let tree = boxes(own)?;
        match other {
            None => {
                let tasks = tree.tasks(1);
                let mut found = found;
                tasks.into_iter().try_for_each(|task| tree.pairs(task, progress, &mut found))?;
            }
            Some(list) => tree.pairs_with(&boxes(list)?, progress, found)?,
        }
    }
    Ok(())
}

/// Visits the pairs of triangles at one edge that may be at the same angle around it.
fn pages_pairs(
    [from, to]: [Vec3; 2],
    pages: &[u32],
    corners: &impl Fn(u32) -> Corners,
    progress: &Progress,
    visit: &mut impl FnMut(u32, u32),
) -> Result<()> {
    let whole = Bounds { low: [-2.0; 3], high: [2.0; 3] };
    let axis = unit(sub(to, from));
    let page = |&t: &u32| {
        let axis = axis?;
        let corner = corners(t).into_iter().find(|place| *place != from && *place != to)?;
        let off = sub(corner, from);
        let aside = if axis[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let across = unit(cross(axis, aside))?;
        let (x, y) = (dot(off, across), dot(off, cross(axis, across)));
        let radius = (x * x + y * y).sqrt();
        let is_known = radius > NEAREST * length_sq(off).sqrt();
        let place = [x / radius, y / radius, 0.0];
        let bounds = Bounds { low: place.map(|x| x - MARGIN), high: place.map(|x| x + MARGIN) };
        (is_known && radius.is_finite()).then_some(bounds)
    };
    let items = pages.iter().map(|t| Item { bounds: page(t).unwrap_or(whole), id: *t });
    let tree = Boxes::build(items.collect(), progress)?;
    let tasks = tree.tasks(1);
    tasks.into_iter().try_for_each(|task| tree.pairs(task, progress, &mut *visit))
}

#[cfg(test)]
mod tests {
    use super::super::in_memory;
    use super::*;
    use stonecut_mesh::Mesh;
    use stonecut_mesh::meeting::{Meeting, is_flat, meet};

    /// Two books with one end in common, a cone at that and another one at its rim, all crossed by loose triangles.
    #[test]
    fn hubs_are_counted_as_if_every_two_were_tried() {
        let mut state = 9u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            // Few values, so that edges and planes are common at times.
            ((state >> 40) % 64) as f64 / 16.0 - 2.0
        };
        let mut draw = || [next(), next(), next()];
        let hub = [0.25, 0.0, -0.5];
        let ends = [[1.0, 2.0, 0.5], [-1.5, 0.0, 0.0]];
        let mut triangles: Vec<Corners> = Vec::new();
        for end in ends {
            triangles.extend((0..HUB + 20).map(|_| [draw(), hub, end]));
        }
        let rim: Vec<Vec3> = (0..HUB + 30)
            .map(|i| (std::f64::consts::TAU * i as f64 / (HUB + 30) as f64).sin_cos())
            .map(|(y, x)| [x, y, 1.0])
            .collect();
        for (i, &at) in rim.iter().enumerate() {
            let after = rim[(i + 1) % rim.len()];
            triangles.extend([[hub, at, after], [[0.0, 0.0, 2.0], after, at]]);
        }
        triangles.extend((0..300).map(|_| [draw(), draw(), draw()]));
        triangles.extend((0..30).map(|_| [draw(), hub, draw()]));
        let mut mesh = Mesh::default();
        for corners in &triangles {
            let at = mesh.positions.len() as u32;
            mesh.positions.extend(corners);
            mesh.triangles.push([at, at + 1, at + 2]);
        }
        let sound: Vec<&Corners> = triangles.iter().filter(|t| !is_flat(t)).collect();
        let (mut pairs, mut overlaps) = (0, 0);
        for (i, a) in sound.iter().enumerate() {
            for b in &sound[i + 1..] {
                let meeting = meet(a, b);
                pairs += u64::from(meeting != Meeting::None);
                overlaps += u64::from(meeting == Meeting::Overlap);
            }
        }
        let found = in_memory(&mesh, 2, &Progress::default()).unwrap();
        assert!(pairs > 10_000 && overlaps > 10, "{pairs} {overlaps}");
        assert_eq!((found.self_intersections, found.coplanar_overlaps), (pairs, overlaps));
    }
}
