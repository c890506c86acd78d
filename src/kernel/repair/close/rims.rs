//! Boundary loops, and those that lie within others in their plane. They run as the triangles of a filling would.

use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::class::Class;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub};

/// Off its plane by at most this share of its size, a loop may have others within it.
const FLAT: f64 = 0.02;
/// Of the largest loops, others are looked for within them, and they within others: of that many at most.
const MOST_NESTED: usize = 2000;

/// A boundary loop.
pub(super) struct Rim {
    pub(super) ring: Vec<u32>,
    /// Of the length of twice the area.
    pub(super) normal: Vec3,
    pub(super) middle: Vec3,
    bounds: Bounds,
    /// Diagonal of the box around it.
    pub(super) size: f64,
}

impl Rim {
    pub(super) fn new(surface: &Surface, ring: Vec<u32>) -> Rim {
        let mut bounds = Bounds::EMPTY;
        ring.iter().for_each(|&v| bounds.add(place(surface, v)));
        let middle = bounds.or_origin().middle();
        let at = |i: usize| sub(place(surface, ring[i % ring.len()]), middle);
        let normal = (0..ring.len()).fold([0.0; 3], |sum, i| add(sum, cross(at(i), at(i + 1))));
        Rim { normal, middle, size: bounds.diagonal(), bounds, ring }
    }

    pub(super) fn area(&self) -> f64 {
        length_sq(self.normal).sqrt()
    }

    /// Two axes of its plane, so that it runs with rising angles; `None` without a plane.
    pub(super) fn axes(&self) -> Option<[Vec3; 2]> {
        let n = scale(self.normal, 1.0 / self.area());
        let least = (0..3).min_by(|&a, &b| n[a].abs().total_cmp(&n[b].abs()))?;
        let mut u = cross(n, std::array::from_fn(|k| f64::from(u8::from(k == least))));
        u = scale(u, 1.0 / length_sq(u).sqrt());
        u[0].is_finite().then(|| [u, cross(n, u)])
    }

    /// Places in its plane.
    pub(super) fn flat(&self, surface: &Surface, axes: [Vec3; 2], v: u32) -> [f64; 2] {
        let off = sub(place(surface, v), self.middle);
        axes.map(|axis| dot(off, axis))
    }

    /// True if points lie in its plane, nearly.
    fn has_in_plane(&self, surface: &Surface, ring: &[u32]) -> bool {
        let most = FLAT * self.size * self.area();
        ring.iter().all(|&v| dot(sub(place(surface, v), self.middle), self.normal).abs() <= most)
    }

    /// True if a point of its plane lies within it.
    fn surrounds(&self, surface: &Surface, axes: [Vec3; 2], v: u32) -> bool {
        let [x, y] = self.flat(surface, axes, v);
        let corners: Vec<[f64; 2]> =
            self.ring.iter().map(|&w| self.flat(surface, axes, w)).collect();
        let mut is_within = false;
        for (i, a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            if (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
                is_within = !is_within;
            }
        }
        is_within
    }
}

/// Finds the loops of free boundary vertices of which none is `held`, and counts the parts of others that end at held or locked
/// ones.
pub(super) fn find(state: &MeshState, held: impl Fn(u32) -> bool) -> (Vec<Rim>, u64) {
    let surface = &state.surface;
    let is_free = |v: u32| {
        let ring = &surface.rings[v as usize];
        ring.class == Some(Class::Boundary) && ring.len > 0 && !held(v)
    };
    // Against the sense of the triangle that is there.
    let next = |v: u32| {
        let around = || surface.ring(v).iter().map(|&t| others(surface.triangles[t as usize], v));
        around().map(|(_, c)| c).find(|&c| around().all(|(b, _)| b != c))
    };
    let mut is_seen = vec![false; surface.vertices.len()];
    let (mut rims, mut parts) = (Vec::new(), 0);
    for start in (0..surface.vertices.len() as u32).filter(|&v| is_free(v)) {
        let mut ring = Vec::new();
        let mut at = Some(start);
        while let Some(v) = at.filter(|&v| is_free(v) && !is_seen[v as usize]) {
            is_seen[v as usize] = true;
            ring.push(v);
            at = next(v);
        }
        if at == Some(start) && ring.len() > 2 {
            rims.push(Rim::new(surface, ring));
        } else if !ring.is_empty() && at.is_some_and(|v| !is_free(v)) {
            parts += 1;
        }
    }
    (rims, parts)
}

/// For each loop, largest first, the one that it is a hole of.
pub(super) fn parents(surface: &Surface, rims: &[Rim]) -> Vec<Option<usize>> {
    let axes: Vec<Option<[Vec3; 2]>> = (rims.iter().take(MOST_NESTED))
        .map(|rim| rim.axes().filter(|_| rim.has_in_plane(surface, &rim.ring)))
        .collect();
    let mut parent = vec![None; rims.len()];
    for (i, own) in rims.iter().enumerate().take(MOST_NESTED) {
        let holds = |&k: &usize| {
            let outer = &rims[k];
            let slack = FLAT * outer.size;
            let fits = (0..3).all(|k| {
                outer.bounds.low[k] <= own.bounds.low[k] + slack
                    && own.bounds.high[k] <= outer.bounds.high[k] + slack
            });
            fits && axes[k].is_some_and(|axes| {
                outer.has_in_plane(surface, &own.ring)
                    && outer.surrounds(surface, axes, own.ring[0])
            })
        };
        // The last one is the smallest.
        if let Some(k) = (0..i).rev().find(holds) {
            let is_opposite = dot(rims[k].normal, own.normal) < 0.0;
            parent[i] = Some(k).filter(|_| is_opposite && parent[k].is_none());
        }
    }
    parent
}

/// The place of a vertex.
pub(super) fn place(surface: &Surface, v: u32) -> Vec3 {
    surface.vertices[v as usize].position
}
