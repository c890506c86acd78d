//! The simplification kernel: mesh in, mesh and statistics out.
//!
//! It knows no files, threads, clock or logging, and its result depends on nothing but its arguments. The stages call
//! `simplify_mesh` once per cell and once for the finish; their pilot drives a `Stepwise`.
//!
//! The main path, from the top down; a room imports only those below it. docs/algorithm.md has the equations.
//!
//! - `run`: builds the surface, repairs it, collapses, fits, takes the mesh out; `stepwise`: level by level
//! - `schedule`: the order of collapses: `levels` of blocks, the `queue`, the inner loop (`drain`)
//! - `fit`: moves the vertices of the result towards the original; `quality` estimates the error, `quality_curve` judges it
//! - `topology`: components that vanish, tubes that are cut; `repair`: what is cleaned, joined and taken apart
//! - `followed`: where each vertex of the input went; `history`: every step, so that it can be taken back; `earlier`: all
//!   collapses, so that a later run can repeat them
//! - `bound`: refuses collapses that lead too far from the original
//! - `crossing`: refuses what makes the surface pass through itself
//! - `collapse`: one collapse, its legality and carrying it out
//! - `state`: the surface with its attributes and seams; builds, compacts, checks it
//! - `cost`: quadrics, placement, attributes, seams
//! - `surface`: the data, vertices, triangles, rings, wedges
//! - `simd`: eight lanes, portably or by AVX2; `vertex`: a vertex as the lanes read it; `interrupt`: a request to stop

mod bound;
mod collapse;
mod cost;
mod crossing;
mod earlier;
mod fit;
mod followed;
mod history;
mod interrupt;
mod memory;
mod options;
mod quality;
mod quality_curve;
pub(crate) mod repair;
mod run;
mod schedule;
mod simd;
mod state;
mod statistics;
mod stepwise;
mod surface;
#[cfg(test)]
mod tests;
mod topology;
mod vertex;

pub use bound::tight::Tightened;
pub use cost::attributes::MAX_WEIGHTED;
pub use earlier::EarlierRun;
pub use history::{Cursor, Gone, History, Step};
pub use interrupt::Interrupt;
pub use memory::{
    attribute_bytes, bound_bytes, crossing_bytes, extremes_bytes, fit_bytes, history_bytes,
    peak_bytes, round_fit_bytes, wedge_bytes,
};
pub use options::{
    AUTO_FIT_RATIO, Bound, Fit, MAX_TRIANGLES, MAX_VERTICES, Options, Placement, Stop, Tight,
    Topology,
};
pub use quality::{Quality, QualityAt};
pub use quality_curve::{QualityCurve, QualityReport, is_off_volume, two_digits_up};
pub use run::{simplify_mesh, simplify_mesh_portably};
pub use statistics::{FitStatistics, Simplified, Statistics};
pub use stepwise::{CloseLevels, Stepwise};
pub use surface::models::Models;
pub use topology::MAX_SPECK;
