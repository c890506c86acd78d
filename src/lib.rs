//! Out-of-core simplification of triangle meshes of any size.
//!
//! [`Simplify`], [`Measure`] and [`Tiles`] work from file to file, as the commands of the same names do: any size, any format,
//! within a budget of memory. They give typed reports; an [`Error`] has a code (`exit_code`, `code`) and a `remedy`.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let (scan, small) = (folder.path().join("scan.obj"), folder.path().join("small.ply"));
//! // A plate of 32 triangles.
//! let corners = (0..25).map(|i| format!("v {} {} 0\n", i % 5, i / 5));
//! let faces = (0..16).map(|i| i % 4 + i / 4 * 5 + 1).map(|v| format!("f {v} {} {} {}\n", v + 1, v + 6, v + 5));
//! std::fs::write(&scan, corners.chain(faces).collect::<String>())?;
//!
//! let report = stonecut::Simplify::new(&scan, &small)
//!     .triangles(8)
//!     .memory(1 << 30)
//!     .on_progress(|p| assert!(p.fraction <= 1.0))
//!     .run()?;
//! assert_eq!(report.output.triangles, 8);
//!
//! let apart = stonecut::Measure::new(&scan, &small).samples(1000).run()?;
//! assert!(apart.deviation.relative_rms < 0.05);
//! # Ok(())
//! # }
//! ```
//!
//! Meshes in memory go through [`in_memory`], in parallel, or through [`simplify_mesh`], in one thread. The modules that are not
//! listed here are the program's own; they may change with any version. docs/ARCHITECTURE.md has the map.
//!
//! ```
//! use stonecut::{KernelOptions, Mesh, Stop, simplify_mesh};
//!
//! // A plate of 32 triangles.
//! let positions: Vec<[f64; 3]> = (0..25).map(|i| [f64::from(i % 5), f64::from(i / 5), 0.0]).collect();
//! let squares = (0..16).map(|i| i % 4 + i / 4 * 5);
//! let triangles = squares.flat_map(|v| [[v, v + 1, v + 6], [v, v + 6, v + 5]]).collect();
//! let mesh = Mesh::new(positions, triangles);
//!
//! let free = vec![false; 25];
//! let options = KernelOptions { stop: Stop::Triangles(2), ..KernelOptions::default() };
//! let simplified = simplify_mesh(mesh, &free, &options);
//! assert_eq!(simplified.mesh.triangles.len(), 2);
//! ```

mod builders;
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod pipeline;
mod receipt;
mod report;

#[doc(hidden)]
pub use builders::followed;
pub use builders::{Measure, Moment, Simplify, Tiles};
pub use measure::compare::Report as MeasureReport;
pub use pipeline::in_memory;
pub use pipeline::run_report::RunReport as Report;
pub use pipeline::tiles::report::TilesReport;
pub use pipeline::tiles::{Finest, TileTexture, TilesConfig};
pub use stonecut_kernel::{Options as KernelOptions, Stop, simplify_mesh};
pub use stonecut_mesh::Mesh;
pub use stonecut_store::config::{
    Attributes, BakeSettings, Config, Level, Method, MinComponent, Target, Texture,
};
pub use stonecut_system::error::{Offers, Remedy};
pub use stonecut_system::progress::Progress;
pub use stonecut_system::{Error, Result};

use stonecut_bake as bake;
#[doc(hidden)]
pub use stonecut_io as io;
#[doc(hidden)]
pub use stonecut_kernel as kernel;
#[doc(hidden)]
pub use stonecut_measure as measure;
#[doc(hidden)]
pub use stonecut_mesh as mesh;
use stonecut_methods as methods;
use stonecut_methods::optimize;
#[doc(hidden)]
pub use stonecut_progressive as progressive;
#[doc(hidden)]
pub use stonecut_render as render;
use stonecut_render::texture;
use stonecut_stages as stages;
use stonecut_store as store;
#[doc(hidden)]
pub use stonecut_store::config;
#[doc(hidden)]
pub use stonecut_synth as synth;
#[doc(hidden)]
pub use stonecut_system as system;
#[doc(hidden)]
pub use stonecut_system::error;
