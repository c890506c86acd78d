//! Out-of-core simplification of triangle meshes of any size.
//!
//! `pipeline` is the program: read it first. It calls the stages (`stages::partition`, `components`, `simplify`,
//! `stitch`, `write`) one after another; a stage never calls another stage. Below them `store` keeps cells on disk,
//! `io` reads and writes mesh files, and `kernel` collapses edges and knows no files, threads, clock or logging.
//! docs/ARCHITECTURE.md has the map.
//!
//! A mesh in memory: `simplify_mesh` in one thread, `pipeline::in_memory` through cells in parallel. From file to file:
//! `pipeline::prepare`, then `pipeline::simplify`; tiles: `pipeline::tiles`; distances: `measure`.
//!
//! ```
//! use stonecut::kernel::{Options, Stop};
//! use stonecut::{Mesh, simplify_mesh};
//!
//! // A plate of 32 triangles.
//! let positions: Vec<[f64; 3]> = (0..25).map(|i| [f64::from(i % 5), f64::from(i / 5), 0.0]).collect();
//! let squares = (0..16).map(|i| i % 4 + i / 4 * 5);
//! let triangles = squares.flat_map(|v| [[v, v + 1, v + 6], [v, v + 6, v + 5]]).collect();
//! let mesh = Mesh::new(positions, triangles);
//!
//! let free = vec![false; 25];
//! let options = Options { stop: Stop::Triangles(2), ..Options::default() };
//! let simplified = simplify_mesh(mesh, &free, &options);
//! assert_eq!(simplified.mesh.triangles.len(), 2);
//! ```

pub mod cli;
pub mod pipeline;
mod report;

use stonecut_bake as bake;
pub use stonecut_io as io;
pub use stonecut_kernel as kernel;
pub use stonecut_kernel::simplify_mesh;
pub use stonecut_measure as measure;
pub use stonecut_mesh as mesh;
pub use stonecut_mesh::Mesh;
use stonecut_methods as methods;
use stonecut_methods::optimize;
pub use stonecut_progressive as progressive;
pub use stonecut_render as render;
use stonecut_render::texture;
use stonecut_stages as stages;
use stonecut_store as store;
pub use stonecut_store::config;
pub use stonecut_synth as synth;
pub use stonecut_system as system;
pub use stonecut_system::error;
pub use stonecut_system::{Error, Result};
