//! The state of a mesh under simplification: the surface, and what rides along with it.
//!
//! One owner of three parts that are borrowed apart: a function that changes the wedges of a surface is given both.

mod build;
mod output;
pub(crate) mod recompute;
pub(crate) mod validate;

use crate::kernel::cost::attributes::Attributes;
use crate::kernel::surface::Surface;
use crate::kernel::surface::wedges::{Corners, Wedges};

/// A surface with the sums of its attributes and the wedges of its seams.
#[derive(Clone)]
pub(crate) struct MeshState {
    pub(crate) surface: Surface,
    /// Only if a channel has a weight.
    pub(crate) attributes: Option<Box<Attributes>>,
    /// Only if there are attribute seams.
    pub(crate) wedges: Option<Box<Wedges>>,
}

impl MeshState {
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

    /// The surface with the values at its corners.
    pub(crate) fn corners(&self) -> Corners<'_> {
        Corners { surface: &self.surface, wedges: self.wedges.as_deref() }
    }
}
