//! Ends the process with its own exit code where the system gives no memory.
//!
//! The budget keeps the program below the limits that it can see; a limit on address space (`ulimit -v`) or a
//! system without overcommitment may still refuse. Rust then aborts (134), which scripts take for a crash.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

/// The system's allocator; where it fails, the process ends with exit code 6 and a message.
pub struct Allocator;

/// Says so and ends, without the allocator: nothing else is sure to work now.
#[cold]
fn give_up(bytes: usize) -> ! {
    let mut line = *b"stonecut: the system gives no more memory (a limit on address space, ulimit -v?), \
        not even                      bytes; raise the limit, or give fewer --threads and less --memory\n";
    // The number's last digit goes before " bytes".
    let mut at = line.windows(6).position(|w| w == b" bytes").unwrap_or(0);
    let mut rest = bytes;
    while at > 0 && line[at - 1] == b' ' {
        at -= 1;
        line[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    // Standard error is not buffered, so this allocates nothing.
    let _ = std::io::stderr().write_all(&line);
    signal_hook::low_level::exit(6)
}

// SAFETY: every call goes to the system's allocator as it came, and its answer is handed on as it is, unless it
// is null: then the process ends, which no caller can observe.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        let memory = unsafe { System.alloc(layout) };
        if memory.is_null() { give_up(layout.size()) } else { memory }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        let memory = unsafe { System.alloc_zeroed(layout) };
        if memory.is_null() { give_up(layout.size()) } else { memory }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: as above.
        let memory = unsafe { System.realloc(memory, layout, new_size) };
        if memory.is_null() { give_up(new_size) } else { memory }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
}
