//! Mesh files in and out: dialects of PLY, other formats, and what is not a mesh at all.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

mod borders;
mod bounds;
#[path = "../common/mod.rs"]
mod common;
mod dialects;
mod fuzz;
mod gltf_extensions;
mod inputs;
mod kept_and_named;
mod ledger;
mod names;
mod near_misses;
mod other;
mod placing;
mod polygons;
mod range_grids;
mod round_trips;
mod rounding;
mod shown;
mod texts;
