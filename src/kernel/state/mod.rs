//! The state of a mesh under simplification: the surface, and what rides along with it.
//!
//! One owner of parts that are borrowed apart: a function that changes the wedges of a surface is given both.

mod build;
mod output;
pub(crate) mod recompute;
pub(crate) mod validate;

use crate::cost::attributes::Attributes;
use crate::cost::labels::Labels;
use crate::options::{Options, Placement};
use crate::surface::Surface;
use crate::surface::flats::Flats;
use crate::surface::wedges::{Corners, Wedges};
use crate::vertex::Vertex;

/// A surface with the sums of its attributes and the wedges of its seams.
#[derive(Clone)]
pub(crate) struct MeshState {
    pub(crate) surface: Surface,
    /// Only if a channel has a weight.
    pub(crate) attributes: Option<Box<Attributes>>,
    /// Only if there are attribute seams.
    pub(crate) wedges: Option<Box<Wedges>>,
    /// Only if vertices have labels.
    pub(crate) labels: Option<Labels>,
}

impl MeshState {
    /// Finds the planes that parts of the surface lie in exactly: where positions are free and nothing but them counts.
    pub(crate) fn find_flats(&mut self, options: &Options) {
        let is_plain = self.attributes.is_none() && self.wedges.is_none();
        if options.placement != Placement::Optimal || options.bound.is_some() || !is_plain {
            return;
        }
        let spacing = spacing(&self.surface.vertices);
        let Surface { vertices, triangles, flats, .. } = &mut self.surface;
        *flats = Flats::find(vertices, triangles, spacing);
    }

    /// Sets one channel of every vertex, on seams too.
    pub(crate) fn set_channel(&mut self, channel: usize, values: &[f32]) {
        let n = self.surface.n_channels.max(1);
        for (row, &value) in self.surface.channels.chunks_exact_mut(n).zip(values) {
            row[channel] = value;
        }
        if let Some(wedges) = &mut self.wedges {
            wedges.set_channel(&self.surface.triangles, channel, values);
        }
    }

    /// Sets one channel of one vertex, whatever wedges it has.
    pub(crate) fn set_at(&mut self, v: u32, channel: usize, value: f32) {
        let n = self.surface.n_channels;
        self.surface.channels[v as usize * n + channel] = value;
        if let Some(wedges) = &mut self.wedges {
            wedges.set_at(&self.surface, v, channel, value);
        }
    }

    /// The surface with the values at its corners.
    pub(crate) fn corners(&self) -> Corners<'_> {
        Corners { surface: &self.surface, wedges: self.wedges.as_deref() }
    }
}

/// Rounding of the coordinates as far as they tell it themselves: that of `f32`, if some of them are such numbers.
fn spacing(vertices: &[Vertex]) -> f64 {
    let step = vertices.len().div_ceil(1024).max(1);
    let coordinates = || vertices.iter().step_by(step).flat_map(|vertex| vertex.position);
    let (mut n, mut n_short, mut most) = (0, 0, 0.0f64);
    for x in coordinates() {
        n += 1;
        n_short += usize::from(f64::from(x as f32) == x);
        most = most.max(x.abs());
    }
    most * if 2 * n_short >= n { f64::from(f32::EPSILON) } else { 16.0 * f64::EPSILON }
}
