//! Arguments that several commands take: memory, threads, inputs, endings of names.

use super::log::Log;
use crate::error::Error;
use crate::io::StageOptions;
use crate::io::ply::MeshSource;
use crate::system::disk::folder_of;
use crate::system::units::show_bytes;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Settings for opening a mesh of any format within the memory of a command; other files than plain PLY are unpacked into
/// `temp_dir` for the time being.
pub(super) fn staging(temp_dir: &std::path::Path, memory: Option<u64>) -> StageOptions {
    StageOptions::new(temp_dir).within(memory_budget(memory))
}

/// Opens a mesh so.
pub(super) fn open_mesh(
    input: impl Into<crate::io::InputPaths>,
    temp_dir: &std::path::Path,
    memory: Option<u64>,
) -> crate::Result<MeshSource> {
    MeshSource::open_staged(input.into().within(memory), &staging(temp_dir, memory))
}

/// The threads to work with: as many as asked for, by default one a core.
///
/// More than `MOST_THREADS_PER_CORE` a core would only take memory, each with its own buffers.
pub(crate) fn threads(given: Option<NonZeroUsize>) -> NonZeroUsize {
    let cores = NonZeroUsize::new(crate::system::memory::cores()).unwrap_or(NonZeroUsize::MIN);
    let most = cores.saturating_mul(MOST_THREADS_PER_CORE);
    given.unwrap_or(cores).min(most)
}

const MOST_THREADS_PER_CORE: NonZeroUsize = NonZeroUsize::new(4).expect("above 0");

/// Refuses an output whose name says that it is something else.
pub(super) fn require_ending(
    name: &str,
    path: &std::path::Path,
    endings: &[&str],
) -> crate::Result<()> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if path == std::path::Path::new("-") || ending.is_some_and(|e| endings.contains(&e.as_str())) {
        return Ok(());
    }
    let endings = endings.join(" or .");
    Err(Error::Usage(format!("{name} {}: give it a name that ends in .{endings}", path.display())))
}

/// A fault in the words of a command line, without the lines on how to type it.
pub(super) fn usage(error: &clap::Error) -> Error {
    let text = error.to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let text = text.split("\n\nUsage:").next().unwrap_or(text);
    let text = text.split("\n\nFor more information").next().unwrap_or(text);
    Error::Usage(text.trim().to_owned())
}

/// Parses `--memory`: a size, or a share of the tightest limit in force.
pub(super) fn parse_memory(text: &str) -> Result<u64, String> {
    let limit = crate::system::memory::limit_bytes();
    match text.strip_suffix('%') {
        Some(_) => Ok((crate::system::units::parse_ratio(text)? * limit as f64) as u64),
        None => crate::system::units::parse_bytes(text),
    }
}

/// Parses a length.
pub(super) fn parse_length(text: &str) -> std::result::Result<f64, String> {
    let length = text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
    length.ok_or_else(|| {
        "write a length in units of the input, not below 0 and no share: 0.2 ('stonecut info' shows how large the mesh is)".to_owned()
    })
}

/// Parses `--cell-triangles`.
pub(super) fn parse_cell(text: &str) -> Result<u64, String> {
    match crate::system::units::parse_count(text)? {
        0..1000 => Err("cells below 1000 triangles are nothing but seam".to_owned()),
        count => Ok(count),
    }
}

/// The memory budget: as given, but within the tightest limit, or the default share of that.
pub(super) fn memory_budget(given: Option<u64>) -> u64 {
    crate::system::memory::budget_bytes(given, crate::system::memory::limit_bytes())
}

/// Says so where less is taken than `--memory` asks for.
pub(super) fn warn_of_limit(given: Option<u64>, log: &mut Log) {
    let limit = crate::system::memory::limit_bytes();
    let taken = crate::system::memory::budget_bytes(given, limit);
    if let Some(given) = given.filter(|&given| given > taken) {
        log.say(format!(
            "warning: --memory {} is more than this process may use (limit {}); {} are taken",
            show_bytes(given).replace(' ', ""),
            show_bytes(limit),
            show_bytes(taken)
        ));
    }
}

/// `OUTPUT.stonecut-job`. In a folder for the temporary data of several runs, outputs of one name are told
/// apart by a checksum of their whole path.
pub(crate) fn job_folder(output: &Path, temp_dir: Option<&Path>) -> crate::Result<PathBuf> {
    let mut name = match output.file_name() {
        Some(name) => name.to_owned(),
        None => {
            return Err(Error::Usage(format!("{} names no file to write", output.display())));
        }
    };
    if output == std::path::Path::new("-") {
        // A stream is not written again: the folder is the run's own, beside those of other pipelines.
        name.push(format!(".{}", std::process::id()));
    }
    let beside = folder_of(output);
    let folder = temp_dir.unwrap_or(beside);
    let real = |folder: &Path| folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    if real(folder) != real(beside) {
        let whole = real(beside).join(&name);
        name.push(format!("-{:08x}", xxh3_64(whole.as_os_str().as_encoded_bytes()) as u32));
    }
    name.push(".stonecut-job");
    Ok(folder.join(name))
}
