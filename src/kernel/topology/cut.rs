//! Carries a cut out: new vertices on one side, caps on both.
//!
//! `topology` decides which cuts are allowed, and their price.

use crate::options::Placement;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::recompute::recompute_quadric;
use crate::surface::Ring;
use crate::surface::class::Class;
use crate::surface::wedges::Corners;
use crate::surface::wedges::divide::Sectors;
use crate::topology::sector;

/// Cuts along a cycle of three edges and caps both sides. What lies to the right of the cycle gets new
/// vertices, which are returned; their sources come from the end of `spare`. `None`, and nothing done, if it cannot be.
pub(crate) fn cut(
    state: &mut MeshState,
    cycle: [u32; 3],
    spare: &mut Vec<u32>,
    number: u32,
    simd: Simd,
) -> Option<[u32; 3]> {
    // New vertices have the sources of others, and with them the labels of walls elsewhere.
    if state.surface.has_walls {
        return None;
    }
    let surface = &mut state.surface;
    let (mut left, mut right) = (Sectors::default(), Sectors::default());
    for i in 0..3 {
        let (next, prev) = (cycle[(i + 1) % 3], cycle[(i + 2) % 3]);
        right[i] = sector(surface, cycle[i], prev, next)?;
        left[i] = sector(surface, cycle[i], next, prev)?;
    }
    let division = match &mut state.wedges {
        Some(wedges) => Some(wedges.divide(surface, cycle, [&left, &right], spare)?),
        None => None,
    };
    let sources = match &division {
        Some(division) => division.sources,
        None => {
            let sources = *spare.last_chunk::<3>()?;
            spare.truncate(spare.len() - 3);
            sources
        }
    };
    let first = surface.vertices.len() as u32;
    let new = [first, first + 1, first + 2];
    let caps = [surface.triangles.len() as u32, surface.triangles.len() as u32 + 1];
    let [v0, v1, w] = cycle;
    surface.triangles.push([v1, v0, w]);
    surface.triangles.push(new);
    surface.n_alive += 2;
    for i in 0..3 {
        let v = cycle[i];
        let mut vertex = surface.vertices[v as usize];
        vertex.stamp = number;
        surface.vertices.push(vertex);
        let own = surface.source[v as usize];
        // With wedges it is theirs to be numbered, and the vertex says only which place it has.
        let is_place = division.is_some() && surface.placement == Placement::Subset;
        surface.source.push(if is_place { own } else { sources[i] });
        surface.models.note(sources[i], own);
        for channel in 0..surface.n_channels {
            let value = surface.channels[v as usize * surface.n_channels + channel];
            surface.channels.push(value);
        }
        let mut left: Vec<u32> =
            surface.ring(v).iter().copied().filter(|t| !right[i].contains(t)).collect();
        left.push(caps[0]);
        right[i].push(caps[1]);
        surface.rings.push(Ring { start: 0, len: 0, room: 0, class: Some(Class::Interior) });
        surface.set_ring(v, &left);
        surface.set_ring(new[i], &right[i]);
    }
    for i in 0..3 {
        for &t in &right[i] {
            let triangle = &mut surface.triangles[t as usize];
            *triangle = triangle.map(|v| if v == cycle[i] { new[i] } else { v });
        }
    }
    if let (Some(wedges), Some(division)) = (&mut state.wedges, &division) {
        wedges.divided(surface, (cycle, new), &right, division);
    }
    for v in cycle.into_iter().chain(new) {
        recompute_quadric(surface, v, simd);
        surface.vertices[v as usize].stamp = number;
    }
    if let Some(attributes) = &mut state.attributes {
        let corners = Corners { surface, wedges: state.wedges.as_deref() };
        cycle.into_iter().chain(new).for_each(|v| attributes.refresh(corners, v));
    }
    Some(new)
}
