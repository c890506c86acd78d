//! Moves vertices apart that lie in one place: corners of triangles on each other, as cuts leave them, and those of sheets that touch.

use super::facet::Facet;
use super::{Crossings, around, corners};
use crate::surface::class::Class;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;
use std::collections::{HashMap, HashSet};
use stonecut_mesh::vec3::{Vec3, add, cross, length_sq, place_bits, scale, sub, unit};

/// Shares of the way to the middle of a corner's neighbours by which it moves, tried in turn.
const STEPS: [f64; 3] = [0.05, 0.2, 0.5];

impl Crossings {
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
        for pair in pairs {
            let corners = pair.into_iter().flat_map(|t| surface.triangles[t as usize]);
            let inner = |&v: &u32| surface.rings[v as usize].class == Some(Class::Interior);
            let corners: Vec<u32> = corners.filter(inner).collect();
            let mut steps =
                STEPS.into_iter().flat_map(|step| corners.iter().map(move |&v| (v, step)));
            steps.any(|(v, step)| {
                self.step_aside(surface, v, [step, 0.0], |before, after| after < before)
            });
        }
    }

    /// Moves vertices apart that lie in one place, as those of sheets that touch; returns those that stay in the place of another one.
    /// Where the output has `f32`, places are such numbers already (`Surface::rounds`).
    pub(crate) fn part_places(&mut self, surface: &mut Surface) -> Vec<u32> {
        let bits = |surface: &Surface, v: u32| place_bits(surface.vertices[v as usize].position);
        let used = (0..surface.vertices.len() as u32).filter(|&v| !surface.ring(v).is_empty());
        let mut places: Vec<([u64; 3], u32)> = used.map(|v| (bits(surface, v), v)).collect();
        places.sort_unstable();
        let mut left = Vec::new();
        let mut taken: HashSet<[u64; 3]> = HashSet::new();
        for same in places.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
            let mut staying: Vec<u32> = same.iter().map(|&(_, v)| v).collect();
            let steps = STEPS.into_iter().flat_map(|step| [[step, 0.0], [0.0, step], [step, step]]);
            for step in steps {
                let mut i = 0;
                while i < staying.len() && staying.len() > 1 {
                    let v = staying[i];
                    let from = surface.vertices[v as usize].position;
                    let is_free = |surface: &Surface| {
                        let place = bits(surface, v);
                        let at = places.partition_point(|other| other.0 < place);
                        places.get(at).is_none_or(|other| other.0 != place)
                            && !taken.contains(&place)
                    };
                    if !self.step_aside(surface, v, step, |before, after| after <= before) {
                        i += 1;
                    } else if is_free(surface) {
                        taken.insert(bits(surface, v));
                        staying.swap_remove(i);
                    } else {
                        surface.vertices[v as usize].position = from;
                        self.moved(surface, surface.ring(v));
                        i += 1;
                    }
                }
            }
            left.extend(&staying[1..]);
        }
        left
    }

    /// Moves a vertex by shares of the way to the middle of its neighbours and of the length of its edges inwards, if the pairs that
    /// meet before and after are `right`.
    fn step_aside(
        &mut self,
        surface: &mut Surface,
        v: u32,
        [to_middle, inwards]: [f64; 2],
        right: impl Fn(usize, usize) -> bool,
    ) -> bool {
        let ring = &surface.rings[v as usize];
        if ring.class == Some(Class::Locked) || ring.len > MAX_VALENCE {
            return false;
        }
        let (mut b, mut c) = (Vec::new(), Vec::new());
        around(surface, v, &mut b, &mut c);
        let own = surface.vertices[v as usize].position;
        let at = |v: u32| surface.vertices[v as usize].position;
        let (mut sum, mut normal, mut edges) = ([0.0; 3], [0.0; 3], 0.0);
        for (&b, &c) in b.iter().zip(&c) {
            let (b, c) = (sub(at(b), own), sub(at(c), own));
            sum = add(sum, b);
            normal = add(normal, cross(b, c));
            edges += length_sq(b).sqrt();
        }
        let n = b.len() as f64;
        let inwards = unit(normal).map_or([0.0; 3], |normal| scale(normal, -inwards * edges / n));
        let place = surface.rounded(add(add(own, sum.map(|x| to_middle * x / n)), inwards));
        self.put(surface, v, place, right)
    }

    /// Rounds places to numbers of `f32`, as the output has them: to the nearest, or to one beside it where pairs would meet that do not
    /// meet before.
    pub(crate) fn settle(&mut self, surface: &mut Surface) {
        for v in 0..surface.vertices.len() as u32 {
            let own = surface.vertices[v as usize].position;
            let near = own.map(|x| x as f32);
            let is_there = near.iter().zip(own).all(|(&near, x)| f64::from(near) == x);
            let ring = &surface.rings[v as usize];
            if is_there || ring.len == 0 || ring.len > MAX_VALENCE {
                continue;
            }
            let beside = [0, 1, 2].map(|k| match f64::from(near[k]) < own[k] {
                true => near[k].next_up(),
                false => near[k].next_down(),
            });
            (0..8).any(|bits| {
                let at = |k: usize| if bits >> k & 1 == 0 { near[k] } else { beside[k] };
                let place = [0, 1, 2].map(|k| f64::from(at(k)));
                self.put(surface, v, place, |before, after| after <= before)
            });
        }
    }

    /// Moves a vertex to a place, if the pairs that meet before and after are `right`.
    fn put(
        &mut self,
        surface: &mut Surface,
        v: u32,
        place: Vec3,
        right: impl Fn(usize, usize) -> bool,
    ) -> bool {
        let ids = surface.ring(v);
        let before = self.before(surface, ids);
        self.fan.clear();
        let at = |w: u32| if w == v { place } else { surface.vertices[w as usize].position };
        self.fan.extend(ids.iter().map(|&t| {
            let corners = surface.triangles[t as usize];
            Facet::new(corners, corners.map(at))
        }));
        let is_right = right(before, self.count(surface, ids));
        if is_right {
            surface.vertices[v as usize].position = place;
            self.moved(surface, surface.ring(v));
        }
        is_right
    }
}
