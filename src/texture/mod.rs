//! Looks of surfaces: materials as factors and images, images decoded in a cache within a budget, tangent frames.
//!
//! For those that look colours up: a new texture is filled from them (`bake`), pictures are drawn with them (`render`),
//! vertices of a cut through tiles get them (`pipeline/extract`).
//! Knows no triangles; the description of materials is in `io/materials`.

mod frames;
mod images;
#[cfg(feature = "ktx2")]
mod ktx2_image;
mod lights;
mod page;
mod palette;

pub(crate) use frames::{Axes, FrameCorner, Tangent, tangents, unpacked};
pub(crate) use images::{Decoded, ImageCache, Light, pixel_of};
pub(crate) use lights::{Spot, multiply, times_opacity};
pub(crate) use page::{add_corners, apart, corner_bytes};
pub use palette::Finish;
pub(crate) use palette::{MapUse, Paint, Palette, Purpose};
