//! Meshes of a generator that takes its decisions from the bytes; see `kernel/mod.rs`.
#![no_main]

#[path = "../kernel/mod.rs"]
mod kernel;

use kernel::{case::Case, choices::Choices, judge};

/// Pairs of triangles that meet where they should not.
fn crossing_pairs(mesh: &stonecut::Mesh) -> u64 {
    let found = stonecut::measure::intersections::in_memory(mesh, 1, &Default::default());
    found.map_or(0, |found| found.self_intersections)
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let case = Case::new(&mut Choices::from_bytes(bytes));
    if let Err(fault) = judge::judge(&case, judge::Depth::AllRuns) {
        panic!("{}: {}", fault.kind, fault.detail);
    }
});
