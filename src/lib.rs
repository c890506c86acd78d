//! Out-of-core simplification of triangle meshes of any size.
//!
//! `pipeline` is the program: read it first. It calls the stages (`partition`, `components`, `simplify`, `stitch`)
//! one after another; a stage never calls another stage. Everything below them is a layer of its own:
//! `ply` reads and writes meshes, `cells` keeps them on disk cell by cell, `kernel` collapses edges and
//! knows no files, threads, clock or logging. docs/ARCHITECTURE.md has the map.

pub mod attributes;
pub mod cells;
pub mod check;
pub mod cli;
mod colours;
pub mod compare;
pub mod components;
pub mod config;
pub mod disk;
pub mod error;
pub mod faces;
pub mod format;
pub mod formats;
pub mod identity;
pub mod job;
pub mod kernel;
pub mod measure;
pub mod memory;
pub mod mesh;
pub mod oklab;
mod output;
pub mod parallel;
pub mod partition;
mod paths;
pub mod pipeline;
pub mod plan;
pub mod ply;
pub mod progress;
pub mod render;
pub mod report;
pub mod run;
pub mod schema;
pub mod scratch;
pub mod seams;
pub mod simplify;
pub mod stitch;
pub mod summary;
pub mod synth;
pub mod topology;
mod union;
pub mod units;
pub mod verify;
pub mod within;
pub mod write;

pub use error::{Error, Result};
pub use kernel::simplify_mesh;
pub use mesh::Mesh;
