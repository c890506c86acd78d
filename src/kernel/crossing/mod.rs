//! Keeps a surface from passing through itself: refuses what would make more pairs of triangles meet than there were.
//!
//! Pairs are counted among the triangles that change, and of these with all others. Positions are those of the output, so what
//! is held here is what `info --check --self-intersections` counts. docs/design/self-intersections.md.

mod facet;
mod hubs;
pub(crate) mod tree;

use crate::surface::class::Class;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;
use facet::{Facet, is_graph};
use hubs::Hubs;
use std::collections::HashMap;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::corners::others;
use stonecut_mesh::steps;
use stonecut_mesh::vec3::Vec3;
use tree::{Hull, Hulls, Tree};

/// Shares of the way to the middle of a corner's neighbours by which triangles on each other are parted, tried in turn.
const STEPS: [f64; 3] = [0.05, 0.2, 0.5];

/// Triangles around a vertex that is to be somewhere else, or whose corners become that vertex.
pub(crate) struct Change<'a> {
    /// All triangles that change or vanish.
    pub(crate) ids: &'a [u32],
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
    hulls: Hulls,
    near: Vec<u32>,
}

impl Crossings {
    /// Begins to watch a surface.
    pub(crate) fn new(surface: &Surface) -> Crossings {
        let mut bounds = Bounds::EMPTY;
        surface.vertices.iter().for_each(|vertex| bounds.add(vertex.position));
        let tree = Tree::new(bounds.or_origin().middle());
        let mut crossings = Crossings {
            hubs: Hubs::of(surface, &tree),
            tree,
            fan: Vec::new(),
            hulls: Hulls::default(),
            near: Vec::new(),
        };
        crossings.extend(surface);
        crossings
    }

    /// Memory that it holds, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.tree.bytes() + self.hubs.bytes()
    }

    /// Takes in the triangles that are new at the end of the surface's list.
    pub(crate) fn extend(&mut self, surface: &Surface) {
        let first = self.tree.len();
        for (triangle, t) in surface.triangles[first..].iter().zip(first as u32..) {
            let hull = match triangle[0] {
                GONE => Hull::EMPTY,
                _ if self.hubs.has(t) => Hull::EMPTY,
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

    /// Returns whether no more pairs of triangles meet after a change than before it.
    pub(crate) fn admits(&mut self, surface: &Surface, change: &Change) -> bool {
        let around = change.around.0.iter().zip(change.around.1);
        let place = |v: u32| surface.vertices[v as usize].position;
        self.fan.clear();
        self.fan.extend(
            around.map(|(&b, &c)| {
                Facet::new([change.vertex, b, c], [change.place, place(b), place(c)])
            }),
        );
        if !is_graph(&self.fan) || self.near(surface, change.ids, 1) > 0 {
            let after = self.count(surface, change.ids);
            return after == 0 || after <= self.before(surface, change.ids);
        }
        true
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

    /// Parts triangles that lie on each other, as cuts leave them: one corner of each pair moves a little towards its neighbours.
    pub(crate) fn part(&mut self, surface: &mut Surface) {
        let mut known = HashMap::new();
        let mut pairs = Vec::new();
        for (t, triangle) in surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE) {
            let mut places = corners(surface, *triangle).map(|p| p.map(f64::to_bits));
            places.sort_unstable();
            if let Some(other) = known.insert(places, t as u32) {
                pairs.push([other, t as u32]);
            }
        }
        let (mut b, mut c) = (Vec::new(), Vec::new());
        for pair in pairs {
            let corners = pair.into_iter().flat_map(|t| surface.triangles[t as usize]);
            let inner = |&v: &u32| {
                let ring = &surface.rings[v as usize];
                ring.class == Some(Class::Interior) && ring.len <= MAX_VALENCE
            };
            let corners: Vec<u32> = corners.filter(inner).collect();
            let steps = STEPS.into_iter().flat_map(|step| corners.iter().map(move |&v| (v, step)));
            for (v, step) in steps {
                around(surface, v, &mut b, &mut c);
                let own = surface.vertices[v as usize].position;
                let n = b.len() as f64;
                let place = surface.rounded(std::array::from_fn(|k| {
                    let sum: f64 =
                        b.iter().map(|&w| surface.vertices[w as usize].position[k] - own[k]).sum();
                    own[k] + step * sum / n
                }));
                let ids = surface.ring(v);
                let before = self.before(surface, ids);
                self.fan.clear();
                self.fan.extend(b.iter().zip(&c).map(|(&b, &c)| {
                    let at = |v: u32| surface.vertices[v as usize].position;
                    Facet::new([v, b, c], [place, at(b), at(c)])
                }));
                if self.count(surface, ids) < before {
                    surface.vertices[v as usize].position = place;
                    self.moved(surface, surface.ring(v));
                    break;
                }
            }
        }
    }

    /// Pairs before a change of these triangles.
    #[inline(never)]
    fn before(&mut self, surface: &Surface, ids: &[u32]) -> usize {
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
        let Crossings { tree, hubs, fan, hulls, near } = self;
        let whole = hulls.fill(fan.iter().map(|facet| tree.hull(&facet.corners)));
        tree.touching(&whole, near);
        steps::count(near.len());
        let mut n = 0;
        for &t in near.iter() {
            let triangle = surface.triangles[t as usize];
            if triangle[0] == GONE || except.contains(&t) {
                continue;
            }
            let mut other = None;
            for own in hulls.touching(&tree.of(t)) {
                let other =
                    other.get_or_insert_with(|| Facet::new(triangle, corners(surface, triangle)));
                n += usize::from(fan[own].meets(other));
                if n >= most {
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
