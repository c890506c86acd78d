//! What is measured of meshes: deviation, certificates, self-intersections.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

#[path = "../../tools/fuzz/kernel/mod.rs"]
mod nasty;

mod cells;
mod certify;
mod deviation;
mod self_intersections;
mod verify;

/// Pairs of triangles that meet where they should not.
fn crossing_pairs(mesh: &stonecut::Mesh) -> u64 {
    let found = stonecut::measure::intersections::in_memory(mesh, 1, &Default::default());
    found.map_or(0, |found| found.self_intersections)
}
