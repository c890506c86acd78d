//! The names that a job gives to its files: nothing else in a job folder is ever removed, or taken for a job's.
//!
//! Decides by names alone, and by the first bytes of the lock and of the manifest. Removes nothing itself.

use super::{lock, manifest};
use std::path::Path;
use stonecut_system::disk::{check_own, is_empty, read_own};
use stonecut_system::error::{Error, Result};

/// Extension of the folders of `Scratch`, which are never continued.
pub const SCRATCH_EXTENSION: &str = "stonecut-scratch";

/// The folder for the trials of `--max-error` in a job folder: their job, and their results.
pub const TRIALS: &str = "trials";

/// Extensions of the files that stages write into a job folder.
const DATA_EXTENSIONS: [&str; 7] = ["cells", "survivors", "index", "part", "pm", "map", "coloured"];

/// First words of their names.
const STEMS: [&str; 10] = [
    "round",
    "result",
    "verdicts",
    "components",
    "samples",
    "shared",
    "input",
    "bake",
    "shape",
    "plan",
];

/// Words that may follow, beside numbers.
const WORDS: [&str; 10] = [
    "corners",
    "tangents",
    "page",
    "normal",
    "normals",
    "trial",
    "emission",
    "surface",
    "roughness",
    "metal",
];

/// Name of the plan in the folder of a job for many machines, its first bytes, and the name of the folder of units.
pub(super) const PLAN: &str = "plan.record";
const PLAN_BEGIN: &str = "{\"name\":\"plan\"";
pub(super) const UNITS: &str = "units";

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

/// Returns whether a name is that of a file of a stage.
pub(super) fn is_data(name: &str) -> bool {
    let Some((stem, extension)) = name.rsplit_once('.') else { return false };
    let mut words = stem.split(['-', '_']);
    let first = words.next().unwrap_or_default();
    DATA_EXTENSIONS.contains(&extension)
        && STEMS.contains(&first)
        && words.all(|word| is_number(word) || WORDS.contains(&word))
}

/// The name under which an attempt at a bound finds what the one before has left of a round; `None` for other files.
pub(super) fn earlier_name(name: &str) -> Option<String> {
    let round = name.strip_prefix("round-")?.strip_suffix(".survivors")?;
    is_number(round).then(|| format!("round-{round}-trial.survivors"))
}

/// Returns whether a name is such a one.
pub(super) fn is_earlier(name: &str) -> bool {
    name.ends_with("-trial.survivors")
}

/// Returns whether a name is that of a file of an attempt at a unit: `PHASE-0000.HOST-PROCESS-MARK.` before the name of a file of a
/// stage.
pub(super) fn is_of_attempt(name: &str) -> bool {
    let mut parts = name.splitn(3, '.');
    let (unit, attempt, file) = (parts.next(), parts.next(), parts.next());
    let is_unit = unit.and_then(|unit| unit.rsplit_once('-')).is_some_and(|(phase, index)| {
        let is_word = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-';
        !phase.is_empty() && phase.bytes().all(is_word) && index.len() >= 4 && is_number(index)
    });
    let is_attempt = attempt.is_some_and(|attempt| {
        let parts: Vec<&str> = attempt.split('-').collect();
        let is_mark = |mark: &str| mark.len() == 8 && mark.bytes().all(|b| b.is_ascii_hexdigit());
        matches!(parts[..], [host, process, mark]
            if host.bytes().all(|b| b.is_ascii_alphanumeric()) && is_number(process) && is_mark(mark))
    });
    is_unit && is_attempt && file.is_some_and(|file| file == "part" || is_data(file))
}

/// Returns whether a name is that of a folder of scratch; what lies in it decides what goes.
pub(super) fn is_scratch(name: &str) -> bool {
    name.rsplit_once('.').is_some_and(|(_, extension)| extension == SCRATCH_EXTENSION)
}

/// Returns whether a path below a folder of scratch is ours.
pub(super) fn is_in_scratch(path: &Path, is_folder: bool) -> bool {
    let name = path.to_str().unwrap_or_default();
    !is_folder && (name == lock::FILE_NAME || name == manifest::FILE_NAME || is_data(name))
}

/// Returns whether a path below a job folder is ours.
pub fn is_in_job(path: &Path, is_folder: bool) -> bool {
    let mut parts = path.iter();
    let first = parts.next().and_then(|part| part.to_str()).unwrap_or_default();
    let rest = parts.as_path();
    match (first, rest.as_os_str().is_empty()) {
        (TRIALS, true) => is_folder,
        (TRIALS, false) => is_in_trials(rest, is_folder),
        (name, true) if is_folder => is_scratch(name),
        (name, true) => is_in_scratch(Path::new(name), false),
        (name, false) => is_scratch(name) && is_in_scratch(rest, is_folder),
    }
}

/// Returns whether a path below the folder of trials is ours: results by any name that we give them, and jobs.
pub(super) fn is_in_trials(path: &Path, is_folder: bool) -> bool {
    let mut parts = path.iter();
    let first = parts.next().and_then(|part| part.to_str()).unwrap_or_default();
    let rest = parts.as_path();
    let is_last = rest.as_os_str().is_empty();
    match first {
        "job" | "kept" if is_last => is_folder,
        "job" | "kept" => is_in_job(rest, is_folder),
        // Results and what stands beside them.
        name if is_folder => is_last && name.strip_suffix("_textures").is_some_and(is_result),
        name if is_last => {
            name.split_once('.').is_some_and(|(stem, _)| is_result(stem)) || is_hidden_result(name)
        }
        folder => {
            folder.strip_suffix("_textures").is_some_and(is_result) && rest.iter().count() == 1
        }
    }
}

fn is_result(stem: &str) -> bool {
    is_number(stem) || ["result", "joined", "kept", "last"].contains(&stem)
}

/// A result that was not finished, where files cannot be without a name.
fn is_hidden_result(name: &str) -> bool {
    let stem = name.strip_prefix('.').and_then(|rest| rest.split_once('.'));
    name.ends_with(".tmp") && stem.is_some_and(|(stem, _)| is_result(stem))
}

/// Refuses a folder that is in use for something else than a job.
pub(super) fn refuse_foreign(folder: &Path) -> Result<()> {
    let failed = |e| Error::reading(folder, "cannot list", e);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let kind = entry.file_type().map_err(failed)?;
        names.push((entry.file_name().to_string_lossy().into_owned(), kind));
    }
    let has = |wanted: &str| names.iter().any(|(name, _)| name == wanted);
    let (has_lock, has_manifest) = (has(lock::FILE_NAME), has(manifest::FILE_NAME));
    // One of both may be damaged.
    let is_marked = is_begun_by(&folder.join(lock::FILE_NAME), lock::BEGIN)
        || is_begun_by(&folder.join(manifest::FILE_NAME), manifest::BEGIN);
    let is_ours = |name: &str, kind: &std::fs::FileType| match name {
        lock::FILE_NAME | manifest::FILE_NAME => kind.is_file() && is_marked,
        // Files of others in a folder of ours are left where they are.
        _ if has_manifest => !kind.is_symlink(),
        // The lock is the first to come and the last to go.
        _ if !has_lock => false,
        _ if kind.is_dir() => name == TRIALS || is_scratch(name),
        _ => kind.is_file() && is_data(name),
    };
    match names.iter().find(|(name, kind)| !is_ours(name, kind)) {
        None => Ok(()),
        Some((name, _)) => Err(in_use(folder, name)),
    }
}

/// Refuses a folder that is in use for something else than a job for many machines.
pub(super) fn refuse_foreign_units(folder: &Path) -> Result<()> {
    let plan = folder.join(PLAN);
    if plan.exists() && is_begun_by(&plan, PLAN_BEGIN) {
        return Ok(());
    }
    let failed = |e| Error::reading(folder, "cannot list", e);
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name().to_string_lossy().into_owned();
        // Of a plan that was stopped before it was published.
        let is_part = name.starts_with("plan.") && name.ends_with(".part");
        let is_bare = name == UNITS && is_empty(&folder.join(UNITS));
        if !is_part && !is_bare {
            return Err(in_use(folder, &name));
        }
    }
    Ok(())
}

/// Refuses a job for many machines in folders of others.
pub(super) fn check_own_units(folder: &Path) -> Result<()> {
    // A link to the folder was typed; one in it is a trap.
    if let Ok(real) = folder.canonicalize() {
        check_own(&real)?;
    }
    let units = folder.join(UNITS);
    match std::fs::symlink_metadata(&units) {
        Ok(_) => check_own(&units),
        Err(_) => Ok(()),
    }
}

/// The error for a folder in use.
pub(super) fn in_use(folder: &Path, name: &str) -> Error {
    Error::Usage(format!(
        "{} holds {name}, which is not of a job of stonecut; move it elsewhere, or name another folder",
        folder.display()
    ))
}

/// True for a file that begins like ours, is cut off before that, or was lost as zeros.
pub(super) fn is_begun_by(path: &Path, begin: &str) -> bool {
    let Ok(bytes) = read_own(path, manifest::MOST_BYTES) else { return false };
    let n = bytes.len().min(begin.len());
    bytes[..n] == begin.as_bytes()[..n] || bytes.iter().all(|b| *b == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_jobs_are_known() {
        for name in [
            "round-0.cells",
            "result-1.survivors",
            "verdicts.cells",
            "bake-0-page-3.part",
            "bake-0_emission-page-0.part",
            "bake-0_surface-page-0.part",
            "bake-1_roughness-page-2.part",
            "bake-1_metal-page-2.part",
            "result.pm",
            "result.map",
        ] {
            assert!(is_data(name), "{name}");
            assert!(is_of_attempt(&format!("simplify-0017.host1-12-00ff00ff.{name}")), "{name}");
        }
        for name in ["my.cells", "round-x.cells", "notes.txt", "round-0", "thesis.part", "index"] {
            assert!(!is_data(name), "{name}");
            assert!(!is_of_attempt(&format!("simplify-0017.host1-12-00ff00ff.{name}")), "{name}");
        }
        assert!(
            is_of_attempt("recut-1-0000.-12-00ff00ff.part")
                && !is_of_attempt("simplify-0017.cells")
        );
        assert!(is_scratch(".in.ply.12-0.stonecut-scratch") && !is_scratch("stonecut-scratch"));
        for name in ["job", "job/trials", "kept"] {
            assert!(is_in_trials(Path::new(name), true), "{name}");
        }
        for name in [
            "job/lock",
            "job/round-0.cells",
            "job/trials/job/lock",
            "3.ply",
            "result.ply",
            ".7.ply.1-2.tmp",
        ] {
            assert!(is_in_trials(Path::new(name), false), "{name}");
        }
        for name in ["notes.txt", "job/notes.txt", "job/x/lock"] {
            assert!(!is_in_trials(Path::new(name), false), "{name}");
        }
    }
}
