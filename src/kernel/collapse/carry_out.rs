//! Carries a collapse out that was found legal: quadrics, channels, triangles and rings of its surroundings.

use std::hint::select_unpredictable;

use crate::collapse::collapser::{Collapser, Plan};
use crate::cost::quadric::Around;
use crate::cost::{fold_quadric, placement};
use crate::options::Placement;
use crate::simd::Lanes;
use crate::simd::unchecked::KnownIds;
use crate::surface::class::Class;
use crate::surface::junction::stays_at_v1;
use crate::surface::{HUB, Ring, Surface, boundary_quadric};
use crate::vertex::GONE;
use stonecut_mesh::blend::between;
use stonecut_mesh::vec3::{Vec3, along, length_sq};

impl Collapser {
    #[inline(always)]
    pub(super) fn carry_out<L: Lanes>(
        &mut self,
        known: KnownIds,
        surface: &mut Surface,
        plan: Plan,
        around: &Around,
        mut quadric: [f32; 9],
        number: u32,
    ) {
        let (v0, v1) = (plan.v0, plan.v1);
        let folds = self.n_kept <= fold_quadric::MOST_OF_STRIP || fold_quadric::may_fold(&quadric);
        let (class0, class1) =
            (known.at(&surface.rings, v0).class, known.at(&surface.rings, v1).class);
        let fixed = stays_at_v1(class0, class1);
        // The open edges change before the corner moves: their old lengths are still known.
        for &(w, from) in &self.open {
            let old = boundary_quadric(surface.edge(w, from));
            let sum = &mut surface.vertices[w as usize].quadric;
            for (sum, x) in sum.iter_mut().zip(old) {
                *sum -= x;
            }
        }
        if !fixed && surface.placement == Placement::Subset {
            placement::keep_an_end(surface, (v0, v1), &plan.place);
        } else if !fixed {
            let (place, planes) = Self::free_place(surface, plan, around);
            if let Some(flats) = &mut surface.flats {
                flats.set(v1, planes);
            }
            if surface.n_channels > 0 {
                self.blend_channels(surface, plan, place);
            }
            known.at_mut(&mut surface.vertices, v1).position = place;
        } else if let Some(flats) = &mut surface.flats {
            flats.hold_fixed((v0, v1), surface.vertices[v1 as usize].position);
        }
        // The rows of vanishing triangles also touch v0, which is deleted.
        let (bs, cs) = (self.b.as_chunks::<8>().0, self.c.as_chunks::<8>().0);
        let mut left = self.n;
        for ((b, c), change) in bs.iter().zip(cs).zip(&self.changes).take(self.n.div_ceil(8)) {
            for row in 0..left.min(8) {
                for w in [b[row], c[row]] {
                    let vertex = known.at_mut(&mut surface.vertices, w);
                    change.add_to(row, &mut vertex.quadric);
                    vertex.stamp = number;
                }
            }
            left = left.saturating_sub(8);
        }
        for &(w, _) in &self.open {
            if self.closes == Some(w) {
                continue;
            }
            let new = boundary_quadric(surface.edge(w, v1));
            let sum = &mut surface.vertices[w as usize].quadric;
            for k in 0..6 {
                sum[k] += new[k];
                quadric[k] += new[k];
            }
            surface.vertices[w as usize].stamp = number;
        }
        if folds {
            let around = (&self.b[..self.n_kept], &self.c[..self.n_kept]);
            let held = fold_quadric::quadric(surface, v1, around.0, around.1);
            for (sum, x) in quadric.iter_mut().zip(held) {
                *sum += x;
            }
        }
        let survivor = known.at_mut(&mut surface.vertices, v1);
        (survivor.quadric, survivor.stamp) = (quadric, number);
        self.rewire::<L>(known, surface, v0, v1);
        if class0 != Some(Class::Interior) {
            let ring = known.at_mut(&mut surface.rings, v1);
            ring.class = ring.class.max(class0);
        }
        if let Some(w) = self.closes {
            for v in [v1, w] {
                surface.rings[v as usize].class = Some(self.fan.look(surface, v));
            }
        }
    }

    /// The place that the survivor will have.
    pub(super) fn place_of_survivor(surface: &Surface, plan: Plan, around: &Around) -> Vec3 {
        let (v0, v1) = (plan.v0, plan.v1);
        let own = surface.vertices[v1 as usize].position;
        if surface.stays_at_v1(v0, v1) {
            return own;
        }
        if surface.placement == Placement::Subset {
            let is_kept = placement::is_nearer_to_v1(surface, (v0, v1), &plan.place);
            return if is_kept { own } else { surface.vertices[v0 as usize].position };
        }
        Self::free_place(surface, plan, around).0
    }

    /// The place of a survivor that may be anywhere, with a bit for each plane that it lies in.
    #[inline(always)]
    fn free_place(surface: &Surface, plan: Plan, around: &Around) -> (Vec3, u32) {
        let unscale = surface.unscale;
        let place = |i: usize| around.centre[i] + f64::from(plan.place[i]) * unscale;
        let place = [place(0), place(1), place(2)];
        let (place, planes) = match &surface.flats {
            Some(flats) => {
                let half = around.half.map(f64::from);
                flats.hold((plan.v0, plan.v1), place, 2.0 * length_sq(half).sqrt() * unscale)
            }
            None => (place, 0),
        };
        (surface.rounded(place), planes)
    }

    /// Interpolates the channels of the survivor along the edge.
    fn blend_channels(&self, surface: &mut Surface, plan: Plan, place: Vec3) {
        let (i0, i1) = (plan.v0 as usize, plan.v1 as usize);
        let n = surface.n_channels;
        let (p0, p1) = (surface.vertices[i0].position, surface.vertices[i1].position);
        let t = along(place, p0, p1) as f32;
        for channel in 0..n {
            let c0 = surface.channels[i0 * n + channel];
            let c1 = &mut surface.channels[i1 * n + channel];
            *c1 = between(c0, *c1, t);
        }
    }

    /// Triangles and rings after the collapse.
    #[inline(always)]
    fn rewire<L: Lanes>(&mut self, known: KnownIds, surface: &mut Surface, v0: u32, v1: u32) {
        for &t in &self.ids[..self.n0] {
            let triangle = known.at_mut(&mut surface.triangles, t);
            let [x, y, z] = *triangle;
            let moved = |v: u32| select_unpredictable(v == v0, v1, v);
            *triangle = [moved(x), moved(y), moved(z)];
        }
        for (&t, &w) in self.ids[self.n_kept..self.n].iter().zip(&self.opposite) {
            known.at_mut(&mut surface.triangles, t)[0] = GONE;
            surface.n_alive -= 1;
            let ring = known.at_mut(&mut surface.rings, w);
            // Never gathered, and built again by the next compaction: a search would cost its length each time.
            if ring.len > HUB {
                continue;
            }
            let place = place_in_ring::<L>(known, &surface.arena, ring, t);
            if place < ring.len {
                let last = *known.at(&surface.arena, ring.start + ring.len - 1);
                *known.at_mut(&mut surface.arena, ring.start + place) = last;
                ring.len -= 1;
            }
        }
        let kept = &self.ids[..self.n_kept];
        let (ring0, ring1) = (*known.at(&surface.rings, v0), *known.at(&surface.rings, v1));
        let n = kept.len() as u32;
        let (start, room) = if n <= ring1.room {
            (ring1.start, ring1.room)
        } else if n <= ring0.room {
            (ring0.start, ring0.room)
        } else {
            (surface.append_room(n as usize), n)
        };
        // Too few to be worth a call.
        for (to, &id) in known.part_mut(&mut surface.arena, start, n).iter_mut().zip(kept) {
            *to = id;
        }
        let ring = known.at_mut(&mut surface.rings, v1);
        (ring.start, ring.len, ring.room) = (start, n, room);
        let ring = known.at_mut(&mut surface.rings, v0);
        (ring.start, ring.len, ring.class) = (v1, 0, None);
    }
}

/// Returns the place of a triangle in a ring; at its length or beyond if it is not in it.
#[inline(always)]
fn place_in_ring<L: Lanes>(known: KnownIds, arena: &[u32], ring: &Ring, triangle: u32) -> u32 {
    // Most rings are no longer than eight, and what comes after them in the arena is anyone's.
    if let Some(first) = arena.get(ring.start as usize..).and_then(|list| list.first_chunk::<8>()) {
        let place = L::matches(first, triangle).trailing_zeros();
        if place < 8 || ring.len <= 8 {
            return place;
        }
    }
    let place = known.part(arena, ring.start, ring.len).iter().position(|&x| x == triangle);
    place.map_or(ring.len, |place| place as u32)
}
