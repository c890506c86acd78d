//! Roles of the ends of an edge: removed or kept, and whether the classes of both allow the collapse.

use std::hint::select_unpredictable;

use crate::collapse::legality::{MAY_COLLAPSE, Reject};
use crate::simd::unchecked::KnownIds;
use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::wedges::Wedges;

/// Returns the removed and the kept end: the lower class goes, between equals the smaller room.
#[inline(always)]
pub(crate) fn roles(known: KnownIds, state: &MeshState, a: u32, b: u32) -> (u32, u32) {
    let surface = &state.surface;
    if let Some(wedges) = &state.wedges {
        return roles_at_seams((surface, wedges), a, b);
    }
    let key = |v: u32| {
        let ring = known.at(&surface.rings, v);
        (ring.class.map_or(0, |class| class as u64) << 32) | u64::from(ring.room)
    };
    let (of_a, of_b) = (key(a), key(b));
    let swap = (of_b < of_a) | ((of_b == of_a) & (b < a));
    (select_unpredictable(swap, b, a), select_unpredictable(swap, a, b))
}

/// The same where there are seams: between equals what is off the seams goes.
#[inline(never)]
fn roles_at_seams((surface, wedges): (&Surface, &Wedges), a: u32, b: u32) -> (u32, u32) {
    let key = |v: u32| {
        let ring = &surface.rings[v as usize];
        (ring.class, wedges.is_seam(v), ring.room, v)
    };
    if key(b) < key(a) { (b, a) } else { (a, b) }
}

/// Returns whether the classes of the ends allow it.
#[inline(always)]
pub(crate) fn classes_allow(
    known: KnownIds,
    surface: &Surface,
    v0: u32,
    v1: u32,
) -> Result<(), Reject> {
    match (known.at(&surface.rings, v0).class, known.at(&surface.rings, v1).class) {
        (Some(class0), Some(class1)) => MAY_COLLAPSE[class0 as usize][class1 as usize],
        _ => Err(Reject::LinkCondition),
    }
}
