//! Small nasty meshes for the kernel: made from a seed or from bytes, simplified, judged, shrunk.
//!
//! Used by `tests/kernel_property.rs` (seconds), by the target `kernel` of cargo-fuzz, and by the program
//! `soak` of this folder, which judges millions. A mesh is put together from blocks (`blocks`), spoilt
//! (`spoil`) and given channels, locks and options (`case`). `judge` holds the result against what
//! `simplify_mesh` promises; `shrink` looks for the smallest mesh that still breaks the same promise.

#![allow(dead_code)]

pub mod blocks;
pub mod case;
pub mod census;
pub mod choices;
pub mod judge;
pub mod shrink;
pub mod spoil;

use std::panic::{AssertUnwindSafe, catch_unwind};

/// A broken promise: its kind, the same for meshes that break the same one, and the particulars.
#[derive(Clone, Debug)]
pub struct Fault {
    /// The promise, or the place of the panic.
    pub kind: String,
    /// What was expected and what was found.
    pub detail: String,
}

thread_local! {
    static PANIC: std::cell::RefCell<Option<(String, String)>> = const { std::cell::RefCell::new(None) };
}

/// Notes panics for `verdict` instead of printing them. Once per process.
pub fn note_panics() {
    std::panic::set_hook(Box::new(|info| {
        let place = info.location().map_or_else(String::new, |at| {
            format!(
                "{}:{}",
                at.file().rsplit_once("src/").map_or(at.file(), |(_, end)| end),
                at.line()
            )
        });
        PANIC.with(|note| *note.borrow_mut() = Some((place, info.to_string())));
    }));
}

/// Judges a case; a panic is a fault too.
pub fn verdict(case: &case::Case, depth: judge::Depth) -> Result<(), Fault> {
    match catch_unwind(AssertUnwindSafe(|| judge::judge(case, depth))) {
        Ok(result) => result,
        Err(_) => {
            let (place, detail) = PANIC.with(|note| note.borrow_mut().take()).unwrap_or_default();
            Err(Fault { kind: format!("panic at {place}"), detail })
        }
    }
}
