//! STL in and out: loose triangles, welded while they are read.

mod ascii;
mod binary;
mod facet_colours;
mod other_kind;
mod weld;
mod writer;

pub(super) use ascii::{is_ascii, read_ascii};
pub(super) use binary::{has_fitting_length, is_binary, read_binary};
pub use writer::StlWriter;
pub(super) use writer::colour_of_facets;
