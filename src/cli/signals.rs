//! One way of stopping for all commands: SIGINT and SIGTERM end any of them within a second.
//!
//! The first signal asks the workers to stop at the end of a block or cell. Where that takes too long (a large
//! cell, a finish, a slow disk, an index being built) the process ends in the middle: a resumable run loses
//! nothing that is sealed, an unfinished output has no name yet, and scratch folders are removed on the way.

use super::log::{Show, complain};
use crate::error::{Error, Offers, Result};
use crate::system::progress::Progress;
use signal_hook::consts::{SIGINT, SIGTERM, SIGXFSZ};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Time that workers have to reach the end of a block or cell after the first signal.
const GRACE: Duration = Duration::from_millis(500);

/// Listens to SIGINT and SIGTERM from now on; a file that grows too large (`ulimit -f`) becomes an error of the
/// write instead of a death by SIGXFSZ.
pub fn listen(progress: &Arc<Progress>, show: Show, offers: Offers) -> Result<()> {
    let fail = |e| Error::reading(".", "cannot listen to signals", e);
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]).map_err(fail)?;
    // Any handler will do; the flag is never read.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map_err(fail)?;
    let progress = Arc::clone(progress);
    let listen = move || {
        let mut is_first = true;
        for signal in signals.forever() {
            if !is_first {
                end(&progress, signal);
            }
            is_first = false;
            progress.request_stop(signal);
            let progress = Arc::clone(&progress);
            let wait_and_end = move || {
                std::thread::sleep(GRACE);
                complain(&mut std::io::stderr(), show, &Error::Interrupted { signal }, offers);
                end(&progress, signal);
            };
            // Without memory for a thread the time is not granted; the next signal ends the process.
            let _ = std::thread::Builder::new().spawn(wait_and_end);
        }
    };
    let started = std::thread::Builder::new().spawn(listen);
    started.map(drop).map_err(|e| Error::NoMemory(format!("cannot start a thread: {e}")))
}

fn end(progress: &Progress, signal: i32) -> ! {
    progress.settle_all();
    signal_hook::low_level::exit(128 + signal)
}
