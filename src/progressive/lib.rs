//! Progressive meshes: a coarse mesh and the steps back to a finer one, in one file.
//!
//! `write` takes the history of a run of the kernel, `Refiner` a file and goes as far as is asked for; `view` takes
//! only the steps that an eye sees. All take the same steps on a `replay`. `steps` tells them as columns of bytes
//! (`columns`, `rows`), `frame` guesses places, `file` puts columns into blocks, `step_reader` takes the steps out again, and
//! `ordered` hands the mesh over, `slides` tells all of it for a browser. Knows nothing of mesh files: records of vertices come and go as the caller
//! encodes them.
//!
//! Source: Hoppe 1996; columns in batches after Pajarola & Rossignac 2000 (docs/references.md).
//! docs/design/progressive.md.

mod columns;
mod file;
mod frame;
mod order;
mod ordered;
mod read;
mod replay;
mod rows;
mod slides;
mod step_reader;
mod steps;
mod view;
mod write;

pub use file::Head;
pub use ordered::Ordered;
pub use read::Refiner;
pub use slides::slides;
pub use steps::Spent;
pub use view::{View, Viewed, refine_for_view};
pub use write::{Original, Written, write};
