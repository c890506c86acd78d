//! An order of triangles that packs well: each beside one of the last, over the edge that was come by last.
//!
//! The index codec of EXT_meshopt_compression remembers 16 edges: a triangle at one of these that has a new vertex takes a byte.
//! Of the two edges of a new triangle the one at the vertex with fewer triangles left is taken first, so that vertices are
//! done with early. docs/results/lod.md has the sizes beside other orders.

use std::collections::{BTreeSet, HashMap};
use stonecut_mesh::steps::{HUB, count};

/// The triangles in that order, each turned so that it begins with the edge that it was reached by.
pub(super) fn strips(triangles: &[[u32; 3]], n_vertices: usize) -> Vec<[u32; 3]> {
    let mut around = Around::new(triangles, n_vertices);
    let mut is_out = vec![false; triangles.len()];
    let mut out = Vec::with_capacity(triangles.len());
    // Edges with triangles behind them, perhaps; as their triangles have them.
    let mut edges: Vec<(u32, u32)> = Vec::new();
    let mut first = 0;
    loop {
        let behind = std::iter::from_fn(|| edges.pop()).find_map(|(v, w)| {
            let t = around.behind(triangles, (v, w))?;
            let corners = triangles[t as usize];
            let i = (0..3).find(|&i| (corners[i], corners[(i + 1) % 3]) == (w, v))?;
            Some((t as usize, [w, v, corners[(i + 2) % 3]]))
        });
        let (t, corners) = match behind {
            Some(found) => found,
            None => {
                while is_out.get(first) == Some(&true) {
                    first += 1;
                }
                let Some(&corners) = triangles.get(first) else { return out };
                (first, corners)
            }
        };
        is_out[t] = true;
        around.remove(triangles, t as u32);
        out.push(corners);
        let [a, b, c] = corners;
        edges.push((a, b));
        match around.left[b as usize] < around.left[a as usize] {
            true => edges.extend([(c, a), (b, c)]),
            false => edges.extend([(b, c), (c, a)]),
        }
    }
}

/// The triangles left at each vertex.
struct Around {
    first: Vec<u32>,
    left: Vec<u32>,
    triangles: Vec<AtVertex>,
    hubs: Hubs,
}

/// A triangle at a vertex.
#[derive(Clone, Copy, Default)]
struct AtVertex {
    triangle: u32,
    /// The corner before the vertex; `MANY` if the triangle has the vertex twice.
    before: u32,
}

/// No vertex.
const MANY: u32 = u32::MAX;

impl AtVertex {
    /// True if the triangle has the edge from `w` to the vertex `v`.
    #[inline]
    fn has(self, triangles: &[[u32; 3]], w: u32, v: u32) -> bool {
        self.before == w
            || self.before == MANY && edges(triangles[self.triangle as usize]).contains(&(w, v))
    }
}

/// Tables that make a walk through the triangles of a hub needless.
#[derive(Default)]
struct Hubs {
    is_hub: Vec<bool>,
    /// The place of a triangle among those of a hub.
    places: HashMap<(u32, u32), u32>,
    /// For each edge from hub to hub, as triangles have it, their places among those of the second hub.
    edges: HashMap<(u32, u32), BTreeSet<u32>>,
}

/// The corner of a triangle before another one of it.
fn before(t: [u32; 3], v: u32) -> u32 {
    edges(t).into_iter().find_map(|(from, to)| (to == v).then_some(from)).unwrap_or(v)
}

/// The edges of a triangle, each from the corner before.
fn edges([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)]
}

impl Around {
    fn new(triangles: &[[u32; 3]], n_vertices: usize) -> Around {
        let mut left = vec![0u32; n_vertices];
        triangles.as_flattened().iter().for_each(|&v| left[v as usize] += 1);
        let mut sum = 0;
        let mut first = Vec::with_capacity(n_vertices);
        for n in &left {
            first.push(sum);
            sum += n;
        }
        let mut next = first.clone();
        let mut list = vec![AtVertex::default(); sum as usize];
        for (triangle, &corners) in (0u32..).zip(triangles) {
            let [a, b, c] = corners;
            let is_plain = a != b && b != c && c != a;
            for (before, v) in edges(corners) {
                let before = if is_plain { before } else { MANY };
                list[next[v as usize] as usize] = AtVertex { triangle, before };
                next[v as usize] += 1;
            }
        }
        let mut around = Around { first, left, triangles: list, hubs: Hubs::default() };
        around.find_hubs(triangles);
        around
    }

    fn is_hub(&self, v: u32) -> bool {
        self.hubs.is_hub[v as usize]
    }

    fn find_hubs(&mut self, triangles: &[[u32; 3]]) {
        let mut is_hub: Vec<bool> = self.left.iter().map(|n| *n as usize > HUB).collect();
        // A triangle that has a hub twice would have two places there.
        for [a, b, c] in triangles.iter().filter(|[a, b, c]| a == b || b == c || c == a) {
            [a, b, c].into_iter().for_each(|v| is_hub[*v as usize] = false);
        }
        let mut hubs = Hubs::default();
        for v in (0..is_hub.len() as u32).filter(|v| is_hub[*v as usize]) {
            for (place, &AtVertex { triangle, before: from }) in (0..).zip(self.of(v).iter()) {
                hubs.places.insert((v, triangle), place);
                if is_hub[from as usize] {
                    hubs.edges.entry((from, v)).or_default().insert(place);
                }
            }
        }
        self.hubs = Hubs { is_hub, ..hubs };
    }

    fn of(&mut self, v: u32) -> &mut [AtVertex] {
        let first = self.first[v as usize] as usize;
        &mut self.triangles[first..first + self.left[v as usize] as usize]
    }

    /// The first triangle of `v` that has an edge the other way round.
    fn behind(&mut self, triangles: &[[u32; 3]], (v, w): (u32, u32)) -> Option<u32> {
        if self.is_hub(v) {
            if !self.is_hub(w) {
                let has = |t: &u32| edges(triangles[*t as usize]).contains(&(w, v));
                let of_w = self.of(w).iter().map(|at| at.triangle);
                let of_w: Vec<u32> = of_w.filter(has).collect();
                return of_w.into_iter().min_by_key(|t| self.hubs.places.get(&(v, *t)).copied());
            }
            let place = *self.hubs.edges.get(&(w, v))?.first()?;
            return Some(self.of(v)[place as usize].triangle);
        }
        let place = self.of(v).iter().position(|at| at.has(triangles, w, v));
        count(place.unwrap_or(0));
        place.map(|place| self.of(v)[place].triangle)
    }

    fn remove(&mut self, triangles: &[[u32; 3]], triangle: u32) {
        for v in triangles[triangle as usize] {
            self.remove_at(v, triangles, triangle);
        }
    }

    fn remove_at(&mut self, v: u32, triangles: &[[u32; 3]], triangle: u32) {
        let place = match self.is_hub(v) {
            true => self.hubs.places.remove(&(v, triangle)).map(|place| place as usize),
            false => self.of(v).iter().position(|at| at.triangle == triangle),
        };
        let Some(place) = place else { return };
        let of = self.of(v);
        let last = of.len() - 1;
        of.swap(place, last);
        let moved = of[place];
        self.left[v as usize] -= 1;
        if !self.is_hub(v) {
            return;
        }
        let Hubs { places, edges, .. } = &mut self.hubs;
        let edge = |t: u32| (before(triangles[t as usize], v), v);
        if let Some(among) = edges.get_mut(&edge(triangle)) {
            among.remove(&(place as u32));
        }
        if place != last {
            places.insert((v, moved.triangle), place as u32);
            if let Some(among) = edges.get_mut(&(moved.before, v)) {
                among.remove(&(last as u32));
                among.insert(place as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::strips;

    #[test]
    fn every_triangle_comes_once_and_keeps_its_sense() {
        // A sheet, a triangle apart, the same one again, and one whose corners are not all different.
        let n = 30u32;
        let at = |x: u32, y: u32| y * (n + 1) + x;
        let mut triangles = Vec::new();
        for i in 0..n * n {
            let (x, y) = (i % n, i / n);
            triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
        let m = (n + 1) * (n + 1);
        triangles.extend([[m, m + 1, m + 2], [m, m + 1, m + 2], [m, m, m + 1]]);
        let turned = |t: &[u32; 3]| {
            let least = (0..3).min_by_key(|&k| (t[k], t[(k + 1) % 3])).unwrap();
            [t[least], t[(least + 1) % 3], t[(least + 2) % 3]]
        };
        let sorted = |list: &[[u32; 3]]| {
            let mut list: Vec<_> = list.iter().map(turned).collect();
            list.sort_unstable();
            list
        };
        let out = strips(&triangles, m as usize + 3);
        assert_eq!(sorted(&out), sorted(&triangles));
        // Nearly every triangle is beside one of the last sixteen edges' triangles.
        let is_beside = |i: &usize| {
            let last = &out[i.saturating_sub(16)..*i];
            last.iter().any(|t| t.iter().filter(|v| out[*i].contains(v)).count() >= 2)
        };
        let n_beside = (1..out.len()).filter(is_beside).count();
        assert!(n_beside * 20 > out.len() * 19, "{n_beside} of {}", out.len());
        assert!(strips(&[], 0).is_empty());
    }
}
