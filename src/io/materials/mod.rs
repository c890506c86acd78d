//! Materials and their images: one description between all readers and all writers.
//!
//! A reader fills `Materials`. `TexturePlan` decides once, before work begins, what becomes of the images for an
//! output, and a writer takes the plan. No format knows another (docs/design/textures.md).

mod companions;
mod description;
mod images;
mod light;
mod losses;
mod mode;
mod mtl;
mod mtl_text;
mod plan;
mod search;

pub(crate) use description::CLAMP_TO_EDGE;
pub use description::{Alpha, Image, ImageData, Map, MapKind, Material, Materials, Part};
pub use description::{CLAMPED, NUMBER};
pub use images::{copy_bytes, image_size, look as look_at_image};
pub use losses::{BARE_FACES, BARE_REASON, BARE_VERTICES, EMITTED, besides_pages};
pub use mode::TextureMode;
pub use mtl::{after_word, names_in_library, read_library, settle_images};
pub use plan::{Reference, all_missing, stem};
pub use plan::{TexturePlan, TextureRequest};
pub use search::{Search, folded, library_beside, plain, relative};
