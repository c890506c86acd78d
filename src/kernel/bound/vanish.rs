//! Small components that may vanish within the bound: all of the input that they stand for is near other triangles.

use super::input::NONE;
use super::tracker::Tracker;
use crate::crossing::tree::{Hull, Tree};
use crate::interrupt::Interrupt;
use crate::simd::{Portable, Simd};
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::vertex::GONE;
use stonecut_mesh::vec3::{Vec3, length_sq, normal, triangle_distance_sq};

/// Components of more triangles stay.
const MOST_TRIANGLES: usize = 1024;
/// Shares of an edge of the input at which it is looked at between its ends.
const BETWEEN: [f32; 3] = [0.25, 0.5, 0.75];

/// Components that have vanished.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Vanished {
    pub(crate) components: u64,
    /// Squared distance, integrated over their area, in units^4.
    pub(crate) error: f64,
}

/// The triangles of the surface, and what each belongs to.
struct Others {
    tree: Tree,
    /// The least vertex of the component of each vertex.
    root: Vec<u32>,
    near: Vec<u32>,
}

impl Tracker {
    /// Removes components by `remove`, the smallest first, as long as more than `target` triangles are left.
    ///
    /// `root` is the least vertex of the component of each vertex. Witnesses go over to the triangles that are nearest.
    /// Locked components stay. Memory: 28 bytes a triangle of the surface.
    pub(crate) fn vanish(
        &mut self,
        surface: &mut Surface,
        root: Vec<u32>,
        (target, interrupt): (u64, &Interrupt),
        remove: impl Fn(&mut Surface, &[u32]),
    ) -> Vanished {
        let mut vanished = Vanished::default();
        let small = small_components(surface, &root);
        if small.is_empty() {
            return vanished;
        }
        let tree = Tree::of_surface(surface, self.centre, Simd::detect());
        let mut others = Others { tree, root, near: Vec::new() };
        let mut found = Vec::new();
        for triangles in small {
            if interrupt.is_raised() {
                break;
            }
            let is_enough = surface.n_alive < target + triangles.len() as u64;
            if is_enough || !self.finds_others(surface, &triangles, &mut others, &mut found) {
                continue;
            }
            let area: f64 = triangles
                .iter()
                .map(|&t| places(surface, surface.triangles[t as usize]))
                .map(|corners| 0.5 * length_sq(normal(corners)).sqrt())
                .sum();
            let squares: f64 = found.iter().map(|&(_, _, distance)| distance * distance).sum();
            vanished.components += 1;
            vanished.error += area * squares / found.len().max(1) as f64;
            remove(surface, &triangles);
            for &t in &triangles {
                others.tree.set(t, Hull::EMPTY);
                self.head[t as usize] = NONE;
            }
            for &(witness, triangle, distance) in &found {
                self.input.witnesses[witness as usize].distance = (distance * self.scale) as f32;
                self.own(witness, triangle);
            }
        }
        vanished
    }

    /// Finds a triangle of another component for each witness of a component, with its distance in input units; false if
    /// one is too far from all of them, or a point between witnesses is.
    fn finds_others(
        &self,
        surface: &Surface,
        triangles: &[u32],
        others: &mut Others,
        found: &mut Vec<(u32, u32, f64)>,
    ) -> bool {
        found.clear();
        let own = others.root[surface.triangles[triangles[0] as usize][0] as usize];
        for &t in triangles {
            let mut witness = self.head[t as usize];
            while witness != NONE {
                let one = self.input.witnesses[witness as usize];
                let room = self.limit - one.before;
                let Some((triangle, distance)) =
                    self.nearest_other(surface, (one.at, room), own, others)
                else {
                    return false;
                };
                found.push((witness, triangle, distance));
                witness = one.next;
            }
        }
        // Between witnesses the input can be farther from the others than at them.
        for &(witness, ..) in found.iter() {
            let one = self.input.witnesses[witness as usize];
            for &[b, c] in self.input.around(witness) {
                let [b, c] = [b, c].map(|v| self.input.witnesses[v as usize]);
                let room = self.limit - one.before.max(b.before).max(c.before);
                let to_b = BETWEEN.map(|share| [share, 0.0]);
                for [u, v] in to_b.into_iter().chain([[1.0 / 3.0; 2]]) {
                    let at = |k: usize| {
                        one.at[k] + u * (b.at[k] - one.at[k]) + v * (c.at[k] - one.at[k])
                    };
                    let point = ([at(0), at(1), at(2)], room);
                    if self.nearest_other(surface, point, own, others).is_none() {
                        return false;
                    }
                }
            }
        }
        true
    }

    /// The nearest triangle of another component within `room` of a point, both scaled, and its distance in input units.
    fn nearest_other(
        &self,
        surface: &Surface,
        (point, room): ([f32; 3], f32),
        own: u32,
        others: &mut Others,
    ) -> Option<(u32, f64)> {
        // Written so that NaN is refused.
        let has_room = room >= 0.0;
        if !has_room {
            return None;
        }
        let place: Vec3 =
            std::array::from_fn(|k| f64::from(point[k]) / self.scale + self.centre[k]);
        let reach = f64::from(room) / self.scale;
        let hull = others.tree.hull(&[place.map(|x| x - reach), place.map(|x| x + reach)]);
        others.tree.touching::<Portable>(&hull, &mut others.near);
        let mut nearest = (reach * reach, GONE);
        for &t in &others.near {
            let triangle = surface.triangles[t as usize];
            if triangle[0] == GONE || others.root[triangle[0] as usize] == own {
                continue;
            }
            let distance_sq = triangle_distance_sq(place, places(surface, triangle));
            if distance_sq < nearest.0 {
                nearest = (distance_sq, t);
            }
        }
        (nearest.1 != GONE).then(|| (nearest.1, nearest.0.sqrt()))
    }
}

/// The triangles of each small component without a locked vertex, the fewest first; nothing if there is one component only.
fn small_components(surface: &Surface, root: &[u32]) -> Vec<Vec<u32>> {
    let mut count = vec![0usize; root.len()];
    let there = || surface.triangles.iter().zip(0u32..).filter(|(t, _)| t[0] != GONE);
    for (t, _) in there() {
        let is_locked = t.iter().any(|&v| surface.rings[v as usize].class == Some(Class::Locked));
        let count = &mut count[root[t[0] as usize] as usize];
        *count += if is_locked { MOST_TRIANGLES + 1 } else { 1 };
    }
    let mut small: Vec<(u32, u32)> = there()
        .map(|(t, id)| (root[t[0] as usize], id))
        .filter(|(root, _)| count[*root as usize] <= MOST_TRIANGLES)
        .collect();
    small.sort_unstable();
    let mut parts: Vec<Vec<u32>> = small
        .chunk_by(|a, b| a.0 == b.0)
        .map(|part| part.iter().map(|&(_, id)| id).collect())
        .collect();
    parts.sort_by_key(Vec::len);
    if count.iter().filter(|&&n| n > 0).count() < 2 { Vec::new() } else { parts }
}

fn places(surface: &Surface, triangle: [u32; 3]) -> [Vec3; 3] {
    triangle.map(|v| surface.vertices[v as usize].position)
}
