//! Progress of opening inputs: what is not a plain PLY is read and brought into order before there is a plan.
//!
//! Readers do not count. What the process has read and written says enough of how far they are.

use crate::system::progress::Progress;
use std::path::{Path, PathBuf};

/// The stage while inputs are opened.
pub(super) const READ: &str = "read";
/// Bytes that are read and written for each byte of an input, by its ending: OBJ is read twice, the corners of STL are sorted three
/// times, glTF is joined besides.
const IO_BYTES: [(&str, f64); 4] = [("obj", 4.0), ("stl", 9.0), ("glb", 25.0), ("gltf", 25.0)];
/// The same of PLY and of what is compressed.
const OTHER_IO_BYTES: f64 = 4.0;
/// Seconds for one of these bytes.
const SECONDS_PER_BYTE: f64 = 1.6e-9;

/// Begins the stage; `process_bytes` counts it.
pub(super) fn begin(inputs: &[PathBuf], progress: &Progress) {
    let bytes_of = |path: &PathBuf| {
        let bytes = path.metadata().map_or(0, |meta| if meta.is_file() { meta.len() } else { 0 });
        bytes as f64 * io_bytes(path)
    };
    let all: f64 = inputs.iter().map(bytes_of).sum();
    progress.expect(vec![(READ, all * SECONDS_PER_BYTE)]);
    progress.begin(READ, 1, 1, all as u64);
}

fn io_bytes(path: &Path) -> f64 {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let known = IO_BYTES.iter().find(|(name, _)| ending.as_deref().is_some_and(|e| e == *name));
    known.map_or(OTHER_IO_BYTES, |(_, bytes)| *bytes)
}

/// Bytes that this process has read and written so far; 0 where the system does not say.
pub(super) fn process_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/self/io").unwrap_or_default();
    let number = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().parse::<u64>().ok()
    };
    number("rchar:").unwrap_or(0) + number("wchar:").unwrap_or(0)
}
