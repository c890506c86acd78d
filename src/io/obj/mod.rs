//! OBJ in and out, with texture coordinates at corners and the names of materials.

mod named;
mod reader;
mod rows;
mod texture;
mod writer;

pub(super) use reader::{looks_like, read};
pub use writer::ObjWriter;
pub use writer::{find_texture, find3};
