//! One collapse: tests of its legality, then carrying it out.
//!
//! `v0` goes and `v1` stays. Looks at the two rings once (`gather`), so that the tests, the new quadrics and the new
//! ring come from the same pass. The topological part is in `link`, the rest of the tests here, all changes in
//! `carry_out`. `schedule` chooses the edges.

mod carry_out;
pub(crate) mod collapser;
mod gather;
mod junction;
pub(crate) mod legality;
mod link;
pub(crate) mod roles;

use crate::bound::scratch::Patch;
use crate::bound::tracker::Tracker;
use crate::collapse::collapser::{Collapser, Plan, eight};
use crate::collapse::legality::Reject;
use crate::cost::placement::place_on_edge;
use crate::cost::quadric::{Around, RingSums};
use crate::crossing::{Change, Crossings};
use crate::simd::unchecked::KnownIds;
use crate::simd::{Lanes, Portable};
use crate::state::MeshState;
use crate::surface::class::Class;
use crate::surface::wedges::{Corners, Wedges};
use crate::surface::{MAX_VALENCE, Surface};

/// A survivor this near to an end of the edge, as a share of it, carries what that end does.
const NEAR_END: f32 = 1e-4;
/// A normal that turns further than this cosine is put off.
const FLIP_COSINE: f32 = 0.5;
/// Double area over the sum of squared edges below which a triangle is a needle (an aspect of about 70),
/// unless there was a worse one before.
const MIN_SHAPE: f32 = 0.007;

/// May refuse a legal collapse: the bound, and the guard that keeps the surface from passing through itself.
pub(crate) type Watchers<'a> = (Option<&'a mut Tracker>, Option<&'a mut Crossings>);

impl Collapser {
    /// Checks topology, then geometry; carries the collapse out if both agree. `number` becomes the
    /// stamp of every vertex whose quadric changes.
    #[inline(always)]
    pub(crate) fn attempt<L: Lanes>(
        &mut self,
        known: KnownIds,
        state: &mut MeshState,
        plan: Plan,
        number: u32,
        (mut bound, crossings): Watchers,
    ) -> Result<(), Reject> {
        let surface = &state.surface;
        let (v0, v1) = (plan.v0, plan.v1);
        self.gather::<L>(known, surface, v0, v1)?;
        self.link::<L>(known, surface, v0, v1)?;
        if let Some(wedges) = &state.wedges {
            self.keep_locked_wedges(surface, wedges, plan)?;
        }
        let (p0, p1) =
            (known.at(&surface.vertices, v0).position, known.at(&surface.vertices, v1).position);
        let middle = |i: usize| p0[i] + (p1[i] - p0[i]) * 0.5;
        let around = Around {
            centre: [middle(0), middle(1), middle(2)],
            scale: surface.scale,
            half: surface.scaled(p0, p1).map(|x| x * 0.5),
            after: plan.place,
        };
        let mut found = RingSums::<L>::new();
        let (bs, cs) = (self.b.as_chunks::<8>().0, self.c.as_chunks::<8>().0);
        let (mut n0, mut n_kept) = (self.n0 as f32, self.n_kept as f32);
        let parts = bs.iter().zip(cs).zip(&mut self.changes);
        for ((b, c), change) in parts.take(self.n.div_ceil(8)) {
            let corners = (eight(known, &surface.vertices, b), eight(known, &surface.vertices, c));
            found.look(&around, corners, (n0, n_kept), change);
            (n0, n_kept) = (n0 - 8.0, n_kept - 8.0);
        }
        if !plan.may_turn {
            if found.cosine() < FLIP_COSINE {
                return Err(Reject::Flip);
            }
            let (before, after) = found.shapes();
            if after < MIN_SHAPE && after < before {
                return Err(Reject::Sliver);
            }
        }
        if let Some(tracker) = &mut bound {
            let place = Collapser::place_of_survivor(surface, plan, &around);
            let patch = Patch {
                ends: [v0, v1],
                ids: &self.ids[..self.n],
                n_kept: self.n_kept,
                b: &self.b[..self.n_kept],
                c: &self.c[..self.n_kept],
                place,
                turns: found.cosine() < FLIP_COSINE,
                open: &self.open,
            };
            if !tracker.admits(surface, &patch) {
                return Err(Reject::Bound);
            }
        }
        let crossings = match crossings {
            Some(crossings) => {
                let change = Change {
                    ids: &self.ids[..self.n],
                    ends: [v0, v1],
                    around: (&self.b[..self.n_kept], &self.c[..self.n_kept]),
                    vertex: v1,
                    place: Collapser::place_of_survivor(surface, plan, &around),
                };
                if !crossings.admits::<L>(surface, &change) {
                    return Err(Reject::SelfIntersection);
                }
                Some(crossings)
            }
            None => None,
        };
        let label =
            state.labels.map(|own| (own.channel, state.surface.channels_of(v1)[own.channel]));
        if state.attributes.is_some() | state.wedges.is_some() {
            self.with_wedges(known, state, plan, &around, found.quadric(), number);
        } else {
            self.carry_out::<L>(known, &mut state.surface, plan, &around, found.quadric(), number);
        }
        if let Some((channel, label)) = label {
            state.set_at(v1, channel, label);
        }
        if let Some(tracker) = bound {
            tracker.carry_out(&self.ids[..self.n]);
        }
        if let Some(crossings) = crossings {
            let (kept, gone) = self.ids[..self.n].split_at(self.n_kept);
            crossings.changed(&state.surface, kept, gone);
        }
        Ok(())
    }

    /// A locked vertex keeps a triangle with the wedge that other cells know.
    #[inline(never)]
    fn keep_locked_wedges(
        &self,
        surface: &Surface,
        wedges: &Wedges,
        plan: Plan,
    ) -> Result<(), Reject> {
        let is_locked = |v: u32| surface.rings[v as usize].class == Some(Class::Locked);
        let vanishing = &self.ids[self.n_kept..self.n];
        let is_kept = |w: u32| {
            let mut others = surface.ring(w).iter().filter(|t| !vanishing.contains(t));
            others.any(|&t| wedges.is_own(surface, t, w))
        };
        let third = &self.opposite[..self.n - self.n_kept];
        if third.iter().any(|&w| is_locked(w) && !is_kept(w))
            || is_locked(plan.v1)
                && wedges.concern(plan.v0, plan.v1)
                && !is_kept(plan.v1)
                && !wedges.becomes_own(surface, &self.ids[..self.n0], (plan.v0, plan.v1))
        {
            return Err(Reject::Locked);
        }
        Ok(())
    }

    /// Carries the collapse out where channels count or seams are.
    #[inline(never)]
    fn with_wedges(
        &mut self,
        known: KnownIds,
        state: &mut MeshState,
        plan: Plan,
        around: &Around,
        quadric: [f32; 9],
        number: u32,
    ) {
        let (v0, v1) = (plan.v0, plan.v1);
        let Some(wedges) = &mut state.wedges else {
            self.with_attributes(known, state, plan, around, quadric, number);
            return;
        };
        if !wedges.concern(v0, v1) {
            let wedge = wedges.single(&state.surface, v1);
            self.with_attributes(known, state, plan, around, quadric, number);
            if let (Some(wedge), Some(wedges)) = (wedge, &mut state.wedges) {
                wedges.rename(&state.surface, &self.ids[..self.n0], v1, wedge);
                // A chart may have vanished from the third corners.
                for &w in &self.opposite[..self.n - self.n_kept] {
                    wedges.look_again(&mut state.surface, w);
                }
            }
            return;
        }
        let surface = &mut state.surface;
        let on_edge = place_on_edge(around.half, plan.place);
        // Values that are to be the same have to be so bit by bit.
        let on_edge = match on_edge {
            s if s < NEAR_END => 0.0,
            s if s > 1.0 - NEAR_END => 1.0,
            s => s,
        };
        let seam = wedges.plan(surface, (v0, v1), on_edge);
        self.carry_out::<Portable>(known, surface, plan, around, quadric, number);
        wedges.carry_out(surface, &self.ids[..self.n0], v1, seam);
        if let Some(attributes) = &mut state.attributes {
            let corners = Corners { surface, wedges: Some(wedges) };
            attributes.refresh(corners, v1);
            // Each neighbour comes up as both corners, as a rule.
            let mut around = [&self.b[..self.n], &self.c[..self.n]].concat();
            around.sort_unstable();
            around.dedup();
            // A vertex of more triangles takes part in no collapse.
            let may_collapse = |w: &u32| corners.surface.ring(*w).len() <= MAX_VALENCE as usize;
            for w in around.into_iter().filter(may_collapse) {
                attributes.refresh(corners, w);
            }
        }
    }

    /// Carries the collapse out off the seams.
    fn with_attributes(
        &mut self,
        known: KnownIds,
        state: &mut MeshState,
        plan: Plan,
        around: &Around,
        quadric: [f32; 9],
        number: u32,
    ) {
        let surface = &mut state.surface;
        let Some(attributes) = &mut state.attributes else {
            self.carry_out::<Portable>(known, surface, plan, around, quadric, number);
            return;
        };
        let fixed = surface.stays_at_v1(plan.v0, plan.v1);
        let corners = Corners { surface, wedges: state.wedges.as_deref() };
        attributes.before(corners, self.lists(plan), (&around.centre, plan.place), fixed);
        self.carry_out::<Portable>(known, surface, plan, around, quadric, number);
        attributes.after(surface, self.lists(plan), fixed);
    }
}
