//! Keeps a surface from passing through itself: refuses what would make more pairs of triangles meet than there were.
//!
//! Pairs are counted among the triangles that change, and of these with all others. Positions are those of the output, so what
//! is held here is what `info --check --self-intersections` counts. docs/design/self-intersections.md.

mod apart;
mod facet;
mod hubs;
mod screen;
pub(crate) mod tree;

use crate::simd::unchecked::prefetch;
use crate::simd::{Job, Lanes, Portable, Simd};
use crate::surface::Surface;
use crate::vertex::GONE;
use facet::{Facet, is_graph};
use hubs::Hubs;
use screen::{AT_ONCE, Around, Screen, Seen};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::corners::others;
use stonecut_mesh::steps;
use stonecut_mesh::vec3::Vec3;
use tree::{Hull, Hulls, Tree};

/// Triangles around a vertex that is to be somewhere else, or whose corners become that vertex.
pub(crate) struct Change<'a> {
    /// All triangles that change or vanish: those of `ends`.
    pub(crate) ids: &'a [u32],
    pub(crate) ends: [u32; 2],
    /// The other corners of those that stay.
    pub(crate) around: (&'a [u32], &'a [u32]),
    /// The vertex, and where it is to be.
    pub(crate) vertex: u32,
    pub(crate) place: Vec3,
}

/// The boxes of all triangles. About 28 bytes a triangle.
#[derive(Clone)]
pub(crate) struct Crossings {
    /// Those of hubs have no box here.
    tree: Tree,
    hubs: Hubs,
    fan: Vec<Facet>,
    /// The boxes of the fan.
    hulls: Hulls,
    near: Vec<u32>,
    seen: Seen,
    /// The last triangle of the surface that another one was found to meet.
    met: Option<u32>,
}

impl Crossings {
    /// Begins to watch a surface.
    pub(crate) fn new(surface: &Surface, simd: Simd) -> Crossings {
        let mut bounds = Bounds::EMPTY;
        surface.vertices.iter().for_each(|vertex| bounds.add(vertex.position));
        let mut tree = Tree::of_surface(surface, bounds.or_origin().middle(), simd);
        let hubs = Hubs::of(surface, &tree);
        hubs.triangles().for_each(|t| tree.set(t, Hull::EMPTY));
        Crossings {
            tree,
            hubs,
            fan: Vec::new(),
            hulls: Hulls::default(),
            near: Vec::new(),
            seen: Seen::default(),
            met: None,
        }
    }

    /// Memory that it holds, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.tree.bytes() + self.hubs.bytes()
    }

    /// Takes in the triangles that are new at the end of the surface's list.
    pub(crate) fn extend(&mut self, surface: &Surface) {
        let first = self.tree.len();
        for triangle in &surface.triangles[first..] {
            let hull = match triangle[0] {
                GONE => Hull::EMPTY,
                _ => self.tree.hull(&corners(surface, *triangle)),
            };
            self.tree.push(hull);
        }
    }

    /// Takes over where triangles are now.
    pub(crate) fn moved(&mut self, surface: &Surface, triangles: &[u32]) {
        for &t in triangles {
            if self.hubs.moved(surface, &self.tree, t) {
                continue;
            }
            let triangle = surface.triangles[t as usize];
            let hull = match triangle[0] {
                GONE => Hull::EMPTY,
                _ => self.tree.hull(&corners(surface, triangle)),
            };
            self.tree.set(t, hull);
        }
    }

    /// Takes over that the last change that was looked at was made: triangles that stay, in the order of the change, and those that
    /// vanished.
    #[inline(always)]
    pub(crate) fn changed(&mut self, surface: &Surface, kept: &[u32], gone: &[u32]) {
        if !self.hubs.are_none() || self.hulls.len() < kept.len() {
            self.moved(surface, kept);
            self.moved(surface, gone);
            return;
        }
        for (i, &t) in kept.iter().enumerate() {
            self.tree.set(t, self.hulls.get(i));
        }
        gone.iter().for_each(|&t| self.tree.set(t, Hull::EMPTY));
    }

    /// Returns whether no more pairs of triangles meet after a change than before it.
    #[inline(always)]
    pub(crate) fn admits<L: Lanes>(&mut self, surface: &Surface, change: &Change) -> bool {
        self.hulls.clear();
        self.is_clear::<L>(surface, change) || self.admits_counted(surface, change)
    }

    /// Returns whether after a change its triangles lie one beside the other and for certain meet no others.
    #[inline(always)]
    fn is_clear<L: Lanes>(&mut self, surface: &Surface, change: &Change) -> bool {
        let Some(around) = Around::new(change.around) else { return false };
        let Crossings { tree, hubs, hulls, near, seen, .. } = self;
        let whole = hulls.take_around::<L>((surface, &tree.centre()), &around, &change.place);
        if !hubs.are_none() {
            return false;
        }
        let Some(screen) = Screen::<L>::new(surface, &around, &change.place) else { return false };
        tree.touching::<L>(&whole, near);
        steps::count(near.len());
        near.iter().for_each(|&t| prefetch(&surface.triangles, t));
        let mut others = [[0; 3]; AT_ONCE];
        for near in near.chunks_mut(AT_ONCE) {
            // Those of the ends go, without a branch that nothing predicts.
            let mut n = 0;
            for i in 0..near.len() {
                let (t, [a, b, c]) = (near[i], surface.triangles[near[i] as usize]);
                (near[n], others[n]) = (t, [a, b, c]);
                let is_of = |end: u32| (a == end) | (b == end) | (c == end);
                n += usize::from(!((a == GONE) | is_of(change.ends[0]) | is_of(change.ends[1])));
            }
            screen.look(surface, &others[..n], seen);
            for i in 0..n {
                let left = screen.left(i, seen);
                if left != 0 {
                    let left = left & hulls.bits::<L>(&tree.of(near[i]));
                    if left != 0 && meets_any(surface, change, left, others[i]) {
                        return false;
                    }
                }
            }
        }
        true
    }

    #[inline(never)]
    fn admits_counted(&mut self, surface: &Surface, change: &Change) -> bool {
        let around = change.around.0.iter().zip(change.around.1);
        let place = |v: u32| surface.vertices[v as usize].position;
        self.fan.clear();
        self.fan.extend(
            around.map(|(&b, &c)| {
                Facet::new([change.vertex, b, c], [change.place, place(b), place(c)])
            }),
        );
        let mut admits = is_graph(&self.fan) && self.near(surface, change.ids, 1) == 0;
        if !admits {
            let after = self.count(surface, change.ids);
            admits = after == 0 || after <= self.before(surface, change.ids);
        }
        self.hulls.clear();
        admits
    }

    /// Returns whether a new triangle meets no other than some.
    pub(crate) fn admits_triangle(
        &mut self,
        surface: &Surface,
        triangle: [u32; 3],
        except: &[u32],
    ) -> bool {
        self.fan.clear();
        self.fan.push(Facet::new(triangle, corners(surface, triangle)));
        self.near(surface, except, 1) == 0
    }

    /// From a triangle on, the first that meets another one, and that one; hubs left out.
    pub(crate) fn next_pair(
        &mut self,
        surface: &Surface,
        from: u32,
        simd: Simd,
    ) -> Option<[u32; 2]> {
        simd.run(NextPair { crossings: self, surface, from })
    }

    #[inline(always)]
    fn met_by<L: Lanes>(&mut self, surface: &Surface, t: u32) -> Option<u32> {
        let of = |t: u32| {
            let triangle = surface.triangles[t as usize];
            Facet::new(triangle, corners(surface, triangle))
        };
        let own = of(t);
        let hull = self.tree.of(t);
        self.tree.touching::<L>(&hull, &mut self.near);
        let mut near = self.near.iter().copied();
        // What has vanished may have left its box.
        let is_there = |&other: &u32| surface.triangles[other as usize][0] != GONE;
        near.find(|other| *other != t && is_there(other) && own.meets(&of(*other)))
    }

    /// The triangle of the surface that was met last, once.
    pub(crate) fn take_met(&mut self) -> Option<u32> {
        self.met.take()
    }

    /// The first of some new triangles that meets another one, of the surface or among those before it.
    pub(crate) fn first_to_meet(
        &mut self,
        surface: &Surface,
        triangles: &[[u32; 3]],
    ) -> Option<usize> {
        let new: Vec<(Facet, Hull)> = triangles
            .iter()
            .map(|&t| (Facet::new(t, corners(surface, t)), self.tree.hull(&corners(surface, t))))
            .collect();
        new.iter().enumerate().position(|(i, (facet, hull))| {
            self.fan.clear();
            self.fan.push(*facet);
            let before = || new[..i].iter().any(|(f, h)| h.touches(hull) && f.meets(facet));
            self.near(surface, &[], 1) > 0 || before()
        })
    }

    /// Pairs of which one or both are among these triangles.
    #[inline(never)]
    pub(crate) fn before(&mut self, surface: &Surface, ids: &[u32]) -> usize {
        self.fan.clear();
        self.fan.extend(ids.iter().map(|&t| {
            let triangle = surface.triangles[t as usize];
            Facet::new(triangle, corners(surface, triangle))
        }));
        self.count(surface, ids)
    }

    /// Pairs within the fan, and of it with all triangles but these.
    fn count(&mut self, surface: &Surface, except: &[u32]) -> usize {
        let own = self.fan.iter().enumerate();
        let own = own.map(|(i, a)| self.fan[i + 1..].iter().filter(|b| a.meets(b)).count());
        own.sum::<usize>() + self.near(surface, except, usize::MAX)
    }

    /// Pairs of the fan with all triangles but these; at `most` as many are counted.
    fn near(&mut self, surface: &Surface, except: &[u32], most: usize) -> usize {
        let Crossings { tree, hubs, fan, hulls, near, met, .. } = self;
        let whole = hulls.fill(fan.iter().map(|facet| tree.hull(&facet.corners)));
        tree.touching::<Portable>(&whole, near);
        steps::count(near.len());
        let mut n = 0;
        for &t in near.iter() {
            let triangle = surface.triangles[t as usize];
            if triangle[0] == GONE || except.contains(&t) {
                continue;
            }
            let mut other = None;
            for own in hulls.touching::<Portable>(&tree.of(t)) {
                let other =
                    other.get_or_insert_with(|| Facet::new(triangle, corners(surface, triangle)));
                n += usize::from(fan[own].meets(other));
                if n >= most {
                    *met = Some(t);
                    return n;
                }
            }
        }
        let own = fan.iter().map(|facet| &facet.corners);
        hubs.near(surface, (own, &whole), |own, t| {
            let own = &fan[own];
            let other = corners(surface, surface.triangles[t as usize]);
            if except.contains(&t) || !tree.hull(&own.corners).touches(&tree.hull(&other)) {
                return false;
            }
            let other = Facet::new(surface.triangles[t as usize], other);
            n += usize::from(own.meets(&other));
            n >= most
        });
        n
    }
}

/// A look at a change with the lanes of a processor.
pub(crate) struct Look<'a> {
    pub(crate) crossings: &'a mut Crossings,
    pub(crate) surface: &'a Surface,
    pub(crate) change: &'a Change<'a>,
}

impl Job for Look<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        self.crossings.admits::<L>(self.surface, self.change)
    }
}

/// A search for the next pair with the lanes of a processor.
struct NextPair<'a> {
    crossings: &'a mut Crossings,
    surface: &'a Surface,
    from: u32,
}

impl Job for NextPair<'_> {
    type Output = Option<[u32; 2]>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<[u32; 2]> {
        for t in self.from..self.surface.triangles.len() as u32 {
            if self.surface.triangles[t as usize][0] != GONE
                && let Some(other) = self.crossings.met_by::<L>(self.surface, t)
            {
                return Some([t, other]);
            }
        }
        None
    }
}

/// Returns whether a triangle meets one of the new ones whose bits are set.
#[inline(never)]
fn meets_any(surface: &Surface, change: &Change, mut left: u32, triangle: [u32; 3]) -> bool {
    let other = Facet::new(triangle, corners(surface, triangle));
    let place = |v: u32| surface.vertices[v as usize].position;
    while left != 0 {
        let i = left.trailing_zeros() as usize;
        left &= left - 1;
        let (b, c) = (change.around.0[i], change.around.1[i]);
        let own = Facet::new([change.vertex, b, c], [change.place, place(b), place(c)]);
        if own.meets(&other) {
            return true;
        }
    }
    false
}

/// The other corners of the triangles of a vertex, in their sense.
pub(crate) fn around(surface: &Surface, v: u32, b: &mut Vec<u32>, c: &mut Vec<u32>) {
    b.clear();
    c.clear();
    for &t in surface.ring(v) {
        let (next, last) = others(surface.triangles[t as usize], v);
        b.push(next);
        c.push(last);
    }
}

fn corners(surface: &Surface, triangle: [u32; 3]) -> [Vec3; 3] {
    triangle.map(|v| surface.vertices[v as usize].position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::MeshState;
    use stonecut_mesh::Mesh;

    /// Sheets of squares above each other.
    fn sheets(n: u32, apart: f64) -> Surface {
        let place = |i: u32| {
            let (x, y) = (f64::from(i % n), f64::from(i / n % n));
            [x, y, 0.2 * (x * 0.7).sin() * y.cos() + apart * f64::from(i / (n * n))]
        };
        let at = |z: u32, x: u32, y: u32| (z * n + y) * n + x;
        let squares = (0..3).flat_map(|z| (0..n - 1).map(move |y| (z, y)));
        let squares = squares.flat_map(|(z, y)| (0..n - 1).map(move |x| (z, x, y)));
        let triangles = squares.flat_map(|(z, x, y)| {
            let [a, b] = [at(z, x, y), at(z, x + 1, y)];
            let [c, d] = [at(z, x + 1, y + 1), at(z, x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        let mesh = Mesh::new((0..3 * n * n).map(place).collect(), triangles.collect());
        let locked = vec![false; mesh.positions.len()];
        MeshState::new(mesh, &locked, (&[], &[]), Simd::Portable).0.surface
    }

    #[test]
    fn what_is_clear_meets_nothing() {
        let mut state = 5u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let mut found = [0; 3];
        for apart in [0.1, 0.5] {
            let surface = sheets(12, apart);
            let mut crossings = Crossings::new(&surface, Simd::detect());
            let (mut b, mut c) = (Vec::new(), Vec::new());
            for i in 0..4000u32 {
                let v = i * 7 % surface.vertices.len() as u32;
                let own = surface.vertices[v as usize].position;
                // A step, often within the sheet or onto another corner.
                let size = [0.3, 1.0, 3.0][i as usize % 3];
                let step = [0, 1, 2].map(|_| (8.0 * next()).round() / 8.0 * size);
                let place = [own[0] + step[0], own[1] + step[1], own[2] + step[2] * 0.3];
                around(&surface, v, &mut b, &mut c);
                let ids = surface.ring(v);
                let change = Change { ids, ends: [v; 2], around: (&b, &c), vertex: v, place };
                let is_clear = crossings.is_clear::<Portable>(&surface, &change);
                let look = Look { crossings: &mut crossings, surface: &surface, change: &change };
                let admits = Simd::detect().run(look);
                assert_eq!(admits, crossings.admits_counted(&surface, &change));
                crossings.fan.clear();
                let corners = b.iter().zip(&c);
                crossings.fan.extend(corners.map(|(&b, &c)| {
                    let at = |v: u32| surface.vertices[v as usize].position;
                    Facet::new([v, b, c], [place, at(b), at(c)])
                }));
                let after = crossings.count(&surface, ids);
                assert!(!is_clear || after == 0, "{i} at {place:?}: {after}");
                found[usize::from(is_clear) + usize::from(after == 0)] += 1;
            }
        }
        assert!(found[0] > 500 && found[2] > 500 && found[1] < found[2], "{found:?}");
    }
}
