//! The operating system and the user's numbers: files, paths, threads, memory limits, progress, units.
//!
//! The lowest room but for `error`: nothing here knows meshes.

pub(crate) mod background;
pub mod disk;
pub(crate) mod free_space;
pub(crate) mod json_keys;
pub mod losses;
pub(crate) mod made;
pub mod mapped_file;
pub mod memory;
pub(crate) mod parallel;
pub(crate) mod paths;
pub(crate) mod pending_file;
pub(crate) mod program;
pub mod progress;
pub mod units;
