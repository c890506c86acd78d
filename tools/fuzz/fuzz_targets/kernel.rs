//! Meshes of a generator that takes its decisions from the bytes; see `kernel/mod.rs`.
#![no_main]

#[path = "../kernel/mod.rs"]
mod kernel;

use kernel::{case::Case, choices::Choices, judge};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let case = Case::new(&mut Choices::from_bytes(bytes));
    if let Err(fault) = judge::judge(&case, judge::Depth::AllRuns) {
        panic!("{}: {}", fault.kind, fault.detail);
    }
});
