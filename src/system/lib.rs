//! The operating system and the user's numbers: files, paths, threads, memory limits, progress, units.
//!
//! The lowest room but for `error`: nothing here knows meshes.

pub mod error;

pub mod background;
pub mod canonical_json;
pub mod disk;
pub mod first_bytes;
pub mod free_space;
pub mod json_keys;
pub mod losses;
pub mod made;
pub mod mapped_file;
pub mod memory;
pub mod pace;
pub mod parallel;
pub mod paths;
pub mod pending_file;
pub mod program;
pub mod progress;
pub mod terminal;
pub mod units;

pub use error::{Error, Result};
