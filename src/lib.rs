//! Out-of-core simplification of triangle meshes of any size.
//!
//! `pipeline` is the program: read it first. It calls the stages (`partition`, `simplify`, `stitch`)
//! one after another; a stage never calls another stage. Everything below them is a layer of its own:
//! `ply` reads and writes meshes, `cells` keeps them on disk cell by cell, `kernel` collapses edges and
//! knows no files, threads, clock or logging. docs/ARCHITECTURE.md has the map.

pub mod cli;
pub mod disk;
pub mod error;
pub mod formats;
pub mod job;
pub mod kernel;
pub mod memory;
pub mod mesh;
pub mod parallel;
pub mod ply;
pub mod progress;
pub mod schema;
pub mod synth;
pub mod units;

pub use error::{Error, Result};
pub use kernel::simplify_mesh;
pub use mesh::Mesh;
