//! Small nasty meshes for the kernel: made from a seed or from bytes, simplified, judged, shrunk.
//!
//! Used by `tests/kernel/property.rs` and `tests/measure` (seconds), by the target `kernel` of cargo-fuzz, and by the program
//! `soak` of this folder, which judges millions. A mesh is put together from blocks (`blocks`), spoilt
//! (`spoil`) and given channels, locks and options (`case`). `judge` holds the result against what
//! `simplify_mesh` promises; `shrink` looks for the smallest mesh that still breaks the same promise.
//! The program gives `crossing_pairs`, which counts pairs of triangles that meet where they should not.

#![allow(dead_code)]

pub mod blocks;
pub mod case;
pub mod census;
pub mod choices;
pub mod judge;
pub mod shrink;
pub mod spoil;

use case::Case;
use judge::Depth;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

/// A broken promise: its kind, the same for meshes that break the same one, and the particulars.
#[derive(Clone, Debug)]
pub struct Fault {
    /// The promise, or the place of the panic.
    pub kind: String,
    /// What was expected and what was found.
    pub detail: String,
}

thread_local! {
    static IS_JUDGING: Cell<bool> = const { Cell::new(false) };
    static PANIC: RefCell<Option<(String, String)>> = const { RefCell::new(None) };
}

/// Makes panics under `verdict` be noted instead of printed; once a process.
fn note_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !IS_JUDGING.get() {
                return before(info);
            }
            let place = info.location().map_or_else(String::new, |at| {
                let file = at.file().rsplit_once("src/").map_or(at.file(), |(_, end)| end);
                format!("{file}:{}", at.line())
            });
            PANIC.with(|note| *note.borrow_mut() = Some((place, info.to_string())));
        }));
    });
}

/// Judges a case; a panic is a fault too.
pub fn verdict(case: &Case, depth: Depth) -> Result<(), Fault> {
    note_panics();
    IS_JUDGING.set(true);
    let result = catch_unwind(AssertUnwindSafe(|| judge::judge(case, depth)));
    IS_JUDGING.set(false);
    result.unwrap_or_else(|_| {
        let (place, detail) = PANIC.with(|note| note.borrow_mut().take()).unwrap_or_default();
        Err(Fault { kind: format!("panic at {place}"), detail })
    })
}
