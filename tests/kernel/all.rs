//! The kernel alone, on families of meshes from clean to nasty.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

// The tests' meshes name the crate `stonecut`, which has the kernel and the meshes under these names.
extern crate self as stonecut;
pub use stonecut_kernel as kernel;
pub use stonecut_mesh::{self as mesh, Mesh};

#[path = "../common"]
mod common {
    #[allow(dead_code)] // Each test program uses its own part.
    pub mod meshes;
}

mod dirty;
mod facing;
mod gaps;
mod junctions;
mod property;
mod quality;
mod strays;

/// Not counted here: that takes crates above the kernel; `tests/measure/self_intersections.rs` does.
fn crossing_pairs(_: &Mesh) -> u64 {
    0
}
