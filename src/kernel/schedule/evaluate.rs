//! Costs of eight edges and the places of their survivors, attributes and seams included.

use crate::collapse::collapser::eight;
use crate::cost::quadric::{self, Evaluated};
use crate::cost::{flats, junction, labels, placement, seam};
use crate::options::Placement;
use crate::simd::Lanes;
use crate::simd::unchecked::KnownIds;
use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::junction::stays_at_v1;

/// 1 if the survivor of a collapse stays at `v1`, else 0.
#[inline(always)]
pub(super) fn fixation(known: KnownIds, surface: &Surface, v0: u32, v1: u32) -> f32 {
    let class = |v: u32| known.at(&surface.rings, v).class;
    f32::from(u8::from(stays_at_v1(class(v0), class(v1))))
}

/// Evaluates eight edges from `v0` to `v1`; `fixed` is 1 where `v1` may not move, else 0.
#[inline(always)]
pub(super) fn evaluate_eight<L: Lanes>(
    (known, state): (KnownIds, &MeshState),
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
) -> Evaluated {
    let surface = &state.surface;
    let (from, to) = (eight(known, &surface.vertices, v0), eight(known, &surface.vertices, v1));
    let mut found = match state.attributes.is_some() | state.wedges.is_some() {
        true => evaluate_attributes::<L>((known, state), v0, v1, fixed),
        false => quadric::edges::<L>(from, to, fixed, surface.scale),
    };
    if surface.has_junctions && state.attributes.is_none() {
        junction::correct::<L>((surface, state.wedges.as_deref()), v0, v1, fixed, &mut found);
    }
    if let Some(flats) = &surface.flats {
        flats::correct((surface, flats), v0, v1, fixed, &mut found);
    }
    if surface.placement != Placement::Optimal {
        placement::choose(surface.placement, (from, to), fixed, surface.scale, &mut found);
    }
    if let Some(own) = state.labels {
        labels::correct(surface, (state.wedges.as_deref(), own), v0, v1, fixed, &mut found);
    }
    found
}

/// The same where channels count or seams are.
#[inline(always)]
fn evaluate_attributes<L: Lanes>(
    (known, state): (KnownIds, &MeshState),
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
) -> Evaluated {
    let surface = &state.surface;
    let mut found = match &state.attributes {
        Some(attributes) => attributes.evaluate(surface, v0, v1, fixed),
        None => {
            let (from, to) =
                (eight(known, &surface.vertices, v0), eight(known, &surface.vertices, v1));
            quadric::edges::<L>(from, to, fixed, surface.scale)
        }
    };
    if let Some(wedges) = &state.wedges {
        let active = state.attributes.as_ref().map_or(&[][..], |a| a.active());
        seam::correct(surface, (wedges, active), v0, v1, fixed, &mut found);
    }
    found
}
