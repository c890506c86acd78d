//! Looks of surfaces: materials as factors and images, images decoded in a cache within a budget, tangent frames.
//!
//! For those that look colours up: a new texture is filled from them (`bake`), pictures are drawn with them (`render`),
//! vertices of a cut through tiles get them (`pipeline/extract`).
//! Knows no triangles; the description of materials is in `io/materials`.

mod as_png;
mod basis_coding;
mod frames;
mod image_level;
mod images;
mod jpeg;
#[cfg(feature = "ktx2")]
mod ktx2_image;
#[cfg(feature = "ktx2")]
mod ktx2_out;
mod light_table;
mod lights;
mod map_use;
mod opacity;
mod page;
mod paint;
mod palette;
mod purpose;

pub use as_png::plan_textures;
pub use basis_coding::BasisCoding;
#[cfg(not(feature = "ktx2"))]
pub use basis_coding::ktx2_file;
pub use frames::{Axes, FrameCorner, Tangent, outward, tangents, unpacked};
pub use images::{Decoded, ImageCache, ImageFaults};
#[cfg(feature = "ktx2")]
pub use ktx2_out::ktx2_file;
pub use light_table::{Light, pixel_of};
pub use lights::{Spot, look_up, multiply, times_opacity};
pub use map_use::{MapUse, UvBox};
pub use page::{add_corners, apart, corner_bytes};
pub use paint::{Finish, Paint};
pub use palette::Palette;
pub use purpose::{Purpose, SEEN, SURFACE, WantedMaps};
