//! Out-of-core simplification of triangle meshes of any size.
//!
//! `pipeline` is the program: read it first. It calls the stages (`stages::partition`, `components`, `simplify`,
//! `stitch`, `write`) one after another; a stage never calls another stage. Below them `store` keeps cells on disk,
//! `io` reads and writes mesh files, and `kernel` collapses edges and knows no files, threads, clock or logging.
//! docs/ARCHITECTURE.md has the map.

mod bake;
pub mod cli;
pub mod config;
pub mod error;
pub mod io;
pub mod kernel;
pub mod measure;
pub mod mesh;
mod methods;
mod optimize;
pub mod pipeline;
pub mod progressive;
pub mod render;
mod report;
mod stages;
mod store;
pub mod synth;
pub mod system;
mod texture;

pub use error::{Error, Result};
pub use kernel::simplify_mesh;
pub use mesh::Mesh;
