//! glTF 2.0 (Khronos): GLB and glTF in, GLB out.

mod buffers;
mod document;
mod draco;
mod elements;
mod held;
mod instances;
mod join;
mod json;
mod left_out;
mod materials_in;
mod materials_out;
mod meshopt;
mod meshopt_out;
mod meshopt_vertices;
mod opening;
mod reader;
mod scene;
mod sparse;
mod split;
mod strips;
mod tile_in;
mod tile_out;
mod tile_scalars;
mod totals;
mod vertex_row;
mod weigh;
mod writer;

pub use document::Positions;
pub(super) use opening::looks_like;
pub(super) use reader::read;
pub use tile_in::{StoredPage, StoredTile, decode_tile, decode_tile_within};
pub use tile_out::{TileForm, TileMesh, TilePage, encode_tile};
pub use tile_scalars::TileScalar;
pub use writer::GlbWriter;
pub(super) use writer::{
    COLOUR_BYTES, FLOAT_BYTES, NORMAL_BYTES, POSITION_BYTES, SPOOLED_BYTES, TEXTURE_BYTES,
};
