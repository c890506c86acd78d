//! STL in and out: loose triangles, welded while they are read.

mod reader;
mod weld;
mod writer;

pub(super) use reader::{is_ascii, is_binary, read_ascii, read_binary};
pub use writer::StlWriter;
