//! Joins open boundaries that touch: vertices in exactly the same place become one.
//!
//! Before anything is collapsed. A scan that was split along texture seams is otherwise a heap of charts,
//! each with its boundary, and cracks would open between them. Where joining would put two
//! triangles on the same side of an edge, it is not done, unless three or more sheets meet there along a curve. Locked vertices are never joined: another cell
//! knows them; what coincides with one is locked too, so that both sides stay together.
//!
//! Vertices whose confined channels (texture coordinates) are the same become one for good under
//! `Topology::Error`, with the channels of the lowest id; if others are to stay apart, they do as wedges
//! (`wedges`). Without confined channels and under `Topology::Error`, only junction curves are joined: `make_manifold` does the
//! rest, and more.

use crate::options::{Placement, Topology};
use crate::repair::curves::Curves;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::surface::wedges::Wedges;
use crate::vertex::GONE;
use stonecut_mesh::vec3::place_bits;

/// Joins what coincides; returns how many vertices went. Sorts boundary vertices only.
pub(crate) fn coincident(
    state: &mut MeshState,
    topology: Topology,
    confined: &[bool],
    simd: Simd,
) -> u64 {
    let surface = &mut state.surface;
    let mends = topology == Topology::Error && !confined.contains(&true);
    let Candidates { mut join, locked } = candidates(surface, mends);
    surface.has_locked_copies = !locked.is_empty() && !mends;
    if join.is_empty() || mends && !locked.is_empty() {
        return 0;
    }
    let mut joined: Vec<u32> = (0..surface.vertices.len() as u32).collect();
    join.iter().chain(&locked).for_each(|&(v, first)| joined[v as usize] = first);
    let is_open = |v: u32| surface.rings[v as usize].class != Some(Class::Locked);
    let is_off = |v: u32| is_inner(surface, v) && joined[v as usize] == v;
    let curves = Curves::find(surface, |v| joined[v as usize], (is_open, is_off));
    locked.iter().for_each(|&(v, _)| joined[v as usize] = v);
    join.retain(|&(v, into)| {
        let joins = !mends && !is_inner(surface, v) || curves.has(into);
        joined[v as usize] = if joins { into } else { v };
        joins
    });
    loop {
        let bad = conflicts(surface, &join, &joined, &curves);
        if bad.is_empty() {
            break;
        }
        join.retain(|&(v, into)| {
            let stays = bad.binary_search(&v).is_err() && bad.binary_search(&into).is_err();
            if !stays {
                joined[v as usize] = v;
            }
            stays
        });
    }
    if join.is_empty() {
        return 0;
    }
    let kept_apart = |surface: &Surface, &(v, into): &(u32, u32)| {
        let (a, b) = (surface.channels_of(v), surface.channels_of(into));
        let differ = |channel: usize| a[channel].to_bits() != b[channel].to_bits();
        topology == Topology::Keep
            || (0..a.len()).any(|c| confined.get(c) == Some(&true) && differ(c))
    };
    if join.iter().any(|pair| kept_apart(surface, pair)) {
        let mut wedges = Box::new(Wedges::new(surface, confined, simd));
        if topology == Topology::Error {
            wedges.join_equal(&join);
        }
        if surface.placement == Placement::Subset {
            wedges.keep_places(&join);
        }
        wedges.find_charts(&surface.triangles);
        state.wedges = Some(wedges);
    }
    for t in &mut surface.triangles {
        if t[0] != GONE {
            *t = t.map(|v| joined[v as usize]);
        }
    }
    for &(v, _) in &join {
        surface.rings[v as usize].len = 0;
    }
    drop(joined);
    state.compact(simd);
    join.len() as u64
}

/// Vertices with open edges, and those within a sheet on which an open edge of another ends, each with the one of lowest source
/// with open edges in the same place.
struct Candidates {
    /// Free ones, ascending.
    join: Vec<(u32, u32)>,
    /// Locked ones, which are not joined.
    locked: Vec<(u32, u32)>,
}

/// True for a vertex within a sheet. It joins others along junction curves alone.
fn is_inner(surface: &Surface, v: u32) -> bool {
    surface.rings[v as usize].class == Some(Class::Interior)
}

/// Finds vertices with open edges in one place, and those within sheets there. Where one of them is locked, they all become so.
///
/// Those within sheets are not locked where nothing locked is joined (`mends`).
fn candidates(surface: &mut Surface, mends: bool) -> Candidates {
    // Where several fans of one chart meet in a vertex, the gaps may be what other charts fill.
    let may_join = |v: &u32| {
        let ring = &surface.rings[*v as usize];
        match ring.class {
            Some(Class::Locked) => true,
            // Cleaning may have taken all triangles of a vertex: it is gone as far as others can tell.
            Some(Class::Boundary | Class::Junction | Class::Complex) => ring.len > 0,
            Some(Class::Interior) | None => false,
        }
    };
    let place = |v: u32| place_bits(surface.vertices[v as usize].position);
    let entry = |v: u32| (place(v), is_inner(surface, v), surface.source[v as usize], v);
    let all = 0..surface.vertices.len() as u32;
    let mut found: Vec<_> = all.clone().filter(may_join).map(entry).collect();
    let marks = MarkedPlaces::new(found.iter().map(|entry| entry.0));
    found.extend(all.filter(|&v| is_inner(surface, v) && marks.may_have(place(v))).map(entry));
    found.sort_unstable();
    let (mut join, mut locked) = (Vec::new(), Vec::new());
    for group in found.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1) {
        // Those with open edges come first.
        let n_open = group.iter().filter(|entry| !entry.1).count();
        let class = |v: u32| surface.rings[v as usize].class;
        let first = group[0].3;
        if group.iter().any(|&(.., v)| class(v) == Some(Class::Locked)) {
            let group = if mends { &group[..n_open] } else { group };
            for &(.., v) in group.iter().filter(|_| group.len() > 1) {
                surface.rings[v as usize].class = Some(Class::Locked);
                locked.push((v, first));
            }
        } else if !is_inner(surface, first) {
            join.extend(group[1..].iter().map(|&(.., v)| (v, first)));
        }
    }
    join.sort_unstable();
    Candidates { join, locked }
}

/// Places, a bit each, of which some are marked that are not among them.
struct MarkedPlaces(Vec<u64>);

impl MarkedPlaces {
    /// Memory: 2 to 4 bytes a place.
    fn new(places: impl ExactSizeIterator<Item = [u64; 3]>) -> Self {
        let n_words =
            if places.len() == 0 { 0 } else { (places.len() / 4 + 1).next_power_of_two() };
        let mut marks = Self(vec![0; n_words]);
        for place in places {
            let (word, bit) = marks.at(place);
            marks.0[word] |= bit;
        }
        marks
    }

    fn at(&self, place: [u64; 3]) -> (usize, u64) {
        let mixed = place
            .into_iter()
            .fold(0u64, |sum, x| (sum.rotate_left(21) ^ x).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        ((mixed >> 6) as usize >> 20 & (self.0.len() - 1), 1 << (mixed >> 58))
    }

    /// True for each of the places, and for one in sixteen others.
    fn may_have(&self, place: [u64; 3]) -> bool {
        let (word, bit) = if self.0.is_empty() { return false } else { self.at(place) };
        self.0[word] & bit != 0
    }
}

/// Vertices, ascending, whose joining would repeat a directed edge or a corner, but on junction curves.
fn conflicts(surface: &Surface, join: &[(u32, u32)], joined: &[u32], curves: &Curves) -> Vec<u32> {
    let joined = |v: u32| joined[v as usize];
    let mut touched: Vec<u32> = join.iter().flat_map(|&(v, into)| [v, into]).collect();
    touched.sort_unstable();
    touched.dedup();
    let mut triangles: Vec<u32> =
        touched.iter().flat_map(|&v| surface.ring(v).iter().copied()).collect();
    triangles.sort_unstable();
    triangles.dedup();
    // Each directed edge as it would be, and as it is.
    let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::with_capacity(triangles.len() * 3);
    let mut bad = Vec::new();
    for &t in &triangles {
        let t = surface.triangles[t as usize];
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let edge = [joined(a), joined(b)];
            if edge[0] == edge[1] {
                bad.extend([a, b]);
            }
            edges.push((edge, [a, b]));
        }
    }
    edges.sort_unstable();
    for same in edges.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        if curves.has_edge(same[0].0) {
            continue;
        }
        bad.extend(same.iter().flat_map(|(_, now)| now));
    }
    bad.retain(|v| touched.binary_search(v).is_ok());
    bad.sort_unstable();
    bad.dedup();
    bad
}
