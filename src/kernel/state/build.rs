//! Builds the state of a mesh, and compacts it once much of it is gone: rings, quadrics, classes.

use crate::cost::attributes::Attributes;
use crate::cost::fold_quadric;
use crate::cost::quadric::{Rows, Triangles};
use crate::options::Placement;
use crate::simd::unchecked::{KnownIds, prefetch};
use crate::simd::{Job, Lanes, Simd};
use crate::state::MeshState;
use crate::state::validate::validate;
use crate::surface::class::Class;
use crate::surface::fan::{Fan, is_one_fan};
use crate::surface::junction::LONG_CURVE;
use crate::surface::models::Models;
use crate::surface::wedges::Corners;
use crate::surface::{AHEAD, Ring, Surface, morton};
use crate::vertex::{GONE, Vertex};
use stonecut_mesh::Mesh;
use stonecut_mesh::extremes::Extremes;
use stonecut_mesh::relief::Relief;

fn is_proper(t: &[u32; 3]) -> bool {
    t[0] != t[1] && t[1] != t[2] && t[2] != t[0]
}

/// Exponent of a positive number, from its bits: `log2` may differ between processors. 0 for anything else.
fn exponent(x: f64) -> i64 {
    let is_usable = x > 0.0 && x.is_finite();
    if is_usable { (x.to_bits() >> 52) as i64 - 1023 } else { 0 }
}

/// 2 to a power that is first brought to between -1000 and 1000.
fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((exponent.clamp(-1000, 1000) + 1023) as u64) << 52)
}

/// The original over each triangle of a mesh, as far as it is known; empty where nothing is.
pub(crate) struct Original {
    pub(crate) relief: Vec<Relief>,
    pub(crate) extremes: Vec<Extremes>,
}

/// Values of proper triangles, where they go; none if there is not one for each triangle.
fn rearranged<T: Copy + Default>(given: Vec<T>, is_kept: &[bool], places: &[u32]) -> Vec<T> {
    if given.is_empty() || given.len() != is_kept.len() {
        return Vec::new();
    }
    let mut out = vec![T::default(); places.len()];
    let kept = given.iter().zip(is_kept).filter(|(_, kept)| **kept).map(|(value, _)| *value);
    for (value, &place) in kept.zip(places) {
        out[place as usize] = value;
    }
    out
}

/// State of the classes of interior vertices: not known, or known from before a compaction.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Classes {
    Unknown,
    Known,
}

impl MeshState {
    /// Takes a mesh apart. Triangles that repeat a corner are dropped. Returns also the triangles that may be without
    /// area, and what is known of the original.
    pub(crate) fn new(
        mut mesh: Mesh,
        locked: &[bool],
        (weights, confined): (&[f32], &[bool]),
        simd: Simd,
    ) -> (Self, Vec<u32>, Original) {
        let (relief, extremes) =
            (std::mem::take(&mut mesh.relief), std::mem::take(&mut mesh.extremes));
        let has_original = !relief.is_empty() || !extremes.is_empty();
        let is_kept: Vec<bool> =
            mesh.triangles.iter().filter(|_| has_original).map(is_proper).collect();
        mesh.triangles.retain(is_proper);
        let extent = morton::bounds(&mesh.positions);
        let order = morton::morton(&mesh.positions, &mesh.triangles, extent);
        let (_, side) = extent;
        // Powers of two do not round: the scale changes no bit of the result.
        let scale = power_of_two(10 - exponent(side));
        let n_channels = mesh.n_channels;
        let source = order.source;
        // Mending adds vertices, collapses add rings: room that is never used is never touched either.
        let room = source.len() + source.len() / 8;
        let mut vertices = Vec::with_capacity(room);
        vertices.extend(source.iter().map(|&old| Vertex::at(mesh.positions[old as usize])));
        let mut rings = Vec::with_capacity(room);
        rings.extend(source.iter().map(|&old| Ring::open(locked[old as usize])));
        let mut channels = Vec::with_capacity(mesh.channels.len());
        if n_channels > 0 {
            for &old in &source {
                channels.extend_from_slice(mesh.channels_of(old));
            }
        }
        let mut triangles = vec![[0u32; 3]; mesh.triangles.len()];
        for (t, &new) in mesh.triangles.iter().zip(&order.triangle_place) {
            triangles[new as usize] = t.map(|v| order.vertex_place[v as usize]);
        }
        let original = Original {
            relief: rearranged(relief, &is_kept, &order.triangle_place),
            extremes: rearranged(extremes, &is_kept, &order.triangle_place),
        };
        let n_alive = triangles.len() as u64;
        drop((mesh, order.vertex_place, order.triangle_place));
        let surface = Surface {
            vertices,
            rings,
            arena: Vec::with_capacity(4 * n_alive as usize),
            triangles,
            n_alive,
            source,
            models: Models::default(),
            channels,
            n_channels,
            placement: Placement::default(),
            flats: None,
            has_junctions: false,
            has_locked_copies: false,
            has_walls: false,
            rounds: false,
            long_curve: if locked.contains(&true) { f64::INFINITY } else { LONG_CURVE * side },
            scale,
            unscale: 1.0 / scale,
        };
        let attributes = Attributes::new(weights, confined, scale, simd).map(Box::new);
        let mut state = MeshState { surface, attributes, wedges: None, labels: None };
        let may_be_flat = state.build(simd, Classes::Unknown);
        (state, may_be_flat, original)
    }

    /// Drops what is gone, keeps the order of the rest, and builds rings and quadrics again. Returns for each vertex
    /// its new number, `GONE` if it is gone.
    pub(crate) fn compact(&mut self, simd: Simd) -> Vec<u32> {
        let surface = &mut self.surface;
        let mut place = vec![GONE; surface.vertices.len()];
        let mut n = 0;
        for (old, place) in place.iter_mut().enumerate() {
            let ring = surface.rings[old];
            if ring.class.is_none() || ring.len == 0 {
                continue;
            }
            *place = n as u32;
            surface.vertices[n] = Vertex::at(surface.vertices[old].position);
            surface.rings[n] = Ring { len: 0, ..ring };
            surface.source[n] = surface.source[old];
            for channel in 0..surface.n_channels {
                surface.channels[n * surface.n_channels + channel] =
                    surface.channels[old * surface.n_channels + channel];
            }
            n += 1;
        }
        surface.vertices.truncate(n);
        surface.rings.truncate(n);
        surface.source.truncate(n);
        surface.channels.truncate(n * surface.n_channels);
        if let Some(wedges) = &mut self.wedges {
            wedges.retain(&surface.triangles);
        }
        surface.triangles.retain(|t| t[0] != GONE);
        for t in &mut surface.triangles {
            *t = t.map(|v| place[v as usize]);
        }
        self.build(simd, Classes::Known);
        place
    }

    /// Builds rings, quadrics and classes from triangles and blank vertices; returns the triangles that may be without
    /// area.
    fn build(&mut self, simd: Simd, classes: Classes) -> Vec<u32> {
        let surface = &mut self.surface;
        let n = surface.vertices.len();
        let is_valid = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < n);
        assert!(
            surface.rings.len() == n && surface.triangles.iter().all(is_valid),
            "corners exist"
        );
        // SAFETY: all corners are vertices, as was just checked, and rings and arena are made of them.
        let known = unsafe { KnownIds::promise() };
        let may_be_flat = sum_quadrics(known, surface, simd);
        list_rings(known, surface);
        simd.run(Classify { known, surface, classes });
        if let Some(flats) = &mut surface.flats {
            flats.assign(&surface.vertices, &surface.triangles);
        }
        if let Some(wedges) = &mut self.wedges {
            wedges.find_seams(surface);
        }
        if let Some(attributes) = &mut self.attributes {
            attributes.build(Corners { surface, wedges: self.wedges.as_deref() });
        }
        validate(self);
        may_be_flat
    }
}

/// Lists the triangles of each vertex in the arena; the lengths of the rings are known.
fn list_rings(known: KnownIds, surface: &mut Surface) {
    let mut start = 0;
    for ring in &mut surface.rings {
        ring.start = start;
        ring.room = ring.len;
        start += ring.len;
        ring.len = 0;
    }
    surface.arena.clear();
    surface.arena.resize(start as usize, 0);
    for (id, t) in surface.triangles.iter().enumerate() {
        for &v in t {
            let ring = known.at_mut(&mut surface.rings, v);
            *known.at_mut(&mut surface.arena, ring.start + ring.len) = id as u32;
            ring.len += 1;
        }
    }
}

/// Adds up the quadrics of all triangles, and the lengths of the rings; gives back the triangles that
/// may be without area.
fn sum_quadrics(known: KnownIds, surface: &mut Surface, simd: Simd) -> Vec<u32> {
    let mut rows = Rows::ZERO;
    let mut flat = Vec::new();
    for first in (0..surface.triangles.len()).step_by(8) {
        for t in surface.triangles.iter().skip(first + AHEAD).take(8) {
            // The first corners of some are the others of most.
            prefetch(&surface.vertices, t[1]);
            prefetch(&surface.vertices, t[2]);
        }
        let eight = &surface.triangles[first..(first + 8).min(surface.triangles.len())];
        let corner = |i: usize, k: usize| {
            let t = eight[i.min(eight.len() - 1)];
            &surface.vertices[t[k] as usize]
        };
        let mut may_be_flat = simd.run(Triangles {
            a: std::array::from_fn(|i| corner(i, 0)),
            b: std::array::from_fn(|i| corner(i, 1)),
            c: std::array::from_fn(|i| corner(i, 2)),
            scale: surface.scale,
            out: &mut rows,
        });
        may_be_flat &= 0xFF >> (8 - eight.len());
        while may_be_flat != 0 {
            flat.push(first as u32 + may_be_flat.trailing_zeros());
            may_be_flat &= may_be_flat - 1;
        }
        for (i, t) in eight.iter().enumerate() {
            for &v in t {
                rows.add_to(i, &mut known.at_mut(&mut surface.vertices, v).quadric);
                known.at_mut(&mut surface.rings, v).len += 1;
            }
        }
    }
    flat
}

/// Finds the classes of all vertices; known ones of interior vertices stay.
struct Classify<'a> {
    known: KnownIds,
    surface: &'a mut Surface,
    classes: Classes,
}

impl Job for Classify<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let known = self.known;
        let mut fan = Fan::new();
        for v in 0..self.surface.vertices.len() as u32 {
            let ring = known.at(&self.surface.rings, v);
            let interior = ring.class == Some(Class::Interior);
            if !(interior
                && (self.classes == Classes::Known || is_one_fan::<L>(known, self.surface, v)))
            {
                self.surface.classify(v, &mut fan);
            }
            fold_quadric::hold(self.surface, v);
        }
    }
}
