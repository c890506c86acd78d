//! Input fingerprint (size, time of change, checksums of pages), taken before opening and compared after the last
//! reading.
//!
//! Marks bind a job to its input (the manifest holds them), and tell when a file was changed while it was
//! read. They are not a proof: a change that sets the time back and keeps the sampled bytes is not found.

use crate::config::Config;
use crate::job::Identity;
use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;
use stonecut_io::InputPaths;
use stonecut_io::ply::MeshSource;
use stonecut_system::disk::open_input;
use stonecut_system::error::{Error, Result};

/// Pages that are sampled besides the beginning of the file.
const PAGES: u64 = 64;
const PAGE_BYTES: usize = 4096;
const HEAD_BYTES: usize = 65_536;

/// Name and value of each mark: bytes, time of the last change, checksum of samples.
///
/// Standard input (`-`) has none. Of several files each has one, and there is the sum of their bytes.
pub fn input_marks(input: &InputPaths) -> Result<BTreeMap<String, String>> {
    if input.is_one() {
        return file_marks(input);
    }
    let (mut marks, mut n_bytes) = (BTreeMap::new(), 0u64);
    for path in input.files()? {
        let own = file_marks(&path)?;
        n_bytes += own.get("bytes").and_then(|n| n.parse::<u64>().ok()).unwrap_or(0);
        let path = std::path::absolute(&path).unwrap_or(path);
        marks.insert(format!("{PART}{}", path.display()), one_mark(own));
    }
    marks.insert("bytes".to_owned(), n_bytes.to_string());
    Ok(marks)
}

/// The marks of one file.
pub fn file_marks(path: &Path) -> Result<BTreeMap<String, String>> {
    let mut marks = BTreeMap::new();
    if path == Path::new("-") {
        return Ok(marks);
    }
    let file = open_input(path)?;
    let meta = file.metadata().map_err(|e| Error::reading(path, "cannot stat", e))?;
    let mtime = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    let mtime = mtime.map_or_else(|| "unknown".to_owned(), |t| t.as_nanos().to_string());
    let samples =
        sample_checksum(&file, meta.len()).map_err(|e| Error::reading(path, "cannot read", e))?;
    marks.insert("bytes".to_owned(), meta.len().to_string());
    marks.insert("mtime".to_owned(), mtime);
    marks.insert("sample_checksum".to_owned(), format!("{samples:016x}"));
    Ok(marks)
}

/// xxh3 over the first 64 KiB and 64 pages evenly spread over the file, its last bytes included.
fn sample_checksum(file: &File, bytes: u64) -> std::io::Result<u64> {
    let mut hasher = xxhash_rust::xxh3::Xxh3::new();
    let mut page = vec![0; HEAD_BYTES];
    for i in 0..=PAGES {
        let wanted = if i == 0 { HEAD_BYTES } else { PAGE_BYTES };
        let last = bytes.saturating_sub(PAGE_BYTES as u64);
        let at = (u128::from(last) * u128::from(i) / u128::from(PAGES)) as u64;
        let n = file.read_at(&mut page[..wanted], at)?;
        hasher.update(&page[..n]);
    }
    Ok(hasher.digest())
}

/// Name of the mark of a file that the input names, before its path.
const BESIDE: &str = "beside ";

/// The same of a file of several that are the input.
const PART: &str = "file ";

/// Name and value of a mark for every file that the input names and that is read with it: buffers, libraries, images; for
/// standard input a checksum of all its bytes.
pub fn marks_beside(source: &MeshSource) -> BTreeMap<String, String> {
    let mut paths: Vec<&Path> = source.beside().iter().map(PathBuf::as_path).collect();
    if let Some(materials) = source.materials() {
        paths.extend(materials.files());
    }
    let named = paths
        .into_iter()
        .filter_map(|path| Some(std::path::absolute(path).ok()?.to_str()?.to_owned()));
    let mut marks: BTreeMap<String, String> =
        named.map(|path| (format!("{BESIDE}{path}"), mark_of(Path::new(&path)))).collect();
    if let Some(checksum) = source.stream_checksum() {
        marks.insert("checksum".to_owned(), format!("{checksum:016x}"));
    }
    marks
}

/// The marks of an input as they are now, and of the files beside it that it had before.
pub fn marks_now(
    input: &InputPaths,
    before: &BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>> {
    let mut now = match input_marks(input) {
        // The one that is not there is named below.
        Err(_) if !input.is_one() && !before.is_empty() => BTreeMap::new(),
        marks => marks?,
    };
    for name in before.keys() {
        if let Some(path) = name.strip_prefix(BESIDE).or_else(|| name.strip_prefix(PART)) {
            now.insert(name.clone(), mark_of(Path::new(path)));
        }
    }
    Ok(now)
}

fn one_mark(marks: BTreeMap<String, String>) -> String {
    marks.into_values().collect::<Vec<_>>().join(" ")
}

/// All marks of a file in one value.
fn mark_of(path: &Path) -> String {
    match file_marks(path) {
        Ok(marks) => one_mark(marks),
        Err(_) => "missing".to_owned(),
    }
}

/// Returns the result of reading `path` if the file's fingerprint is still the one taken `before`, else an error that
/// says so, whatever came out. A file that changes can give rise to any error, and to a mesh that never was.
pub fn unchanged<T>(
    path: &InputPaths,
    before: &BTreeMap<String, String>,
    outcome: Result<T>,
) -> Result<T> {
    // The wish to stop, or a full disk, is not worse for a changed input; the next run will find that.
    if matches!(outcome, Err(Error::Interrupted { .. } | Error::NoSpace { .. })) {
        return outcome;
    }
    let now = match marks_now(path, before) {
        Ok(now) => now,
        // Whatever was wrong before, or the want of open files, is not the input's fault.
        Err(_) if is_out_of_files(path) => {
            return Err(outcome.err().unwrap_or_else(|| {
                let source = std::io::Error::from_raw_os_error(TOO_MANY_FILES);
                Error::reading(path, "cannot open", source)
            }));
        }
        Err(_) => return Err(changed(path, "it can no longer be opened")),
    };
    let differences: Vec<String> = now
        .iter()
        .filter(|(name, value)| before.get(*name) != Some(value))
        .map(|(name, value)| {
            let old = before.get(name).map_or("none", String::as_str);
            format!("{name} {value}, before {old}")
        })
        .collect();
    if differences.is_empty() { outcome } else { Err(changed(path, &differences.join("; "))) }
}

/// Errno of a process that has all the files open that it may have.
const TOO_MANY_FILES: i32 = 24;

/// Returns whether a file that is there cannot be opened because too many are.
fn is_out_of_files(path: &Path) -> bool {
    let opened = File::open(path);
    opened.is_err_and(|e| matches!(e.raw_os_error(), Some(TOO_MANY_FILES | 23)))
}

fn changed(path: &Path, how: &str) -> Error {
    let what = format!(
        "was changed during the run ({how}); run again with --restart once it stays as it is"
    );
    Error::bad_input(path, what)
}

/// Returns the identity that a job's files are valid for: this input and every setting that changes the result.
pub fn job_identity(
    source: &MeshSource,
    marks: &BTreeMap<String, String>,
    config: &Config,
) -> Identity {
    let mut marks = marks.clone();
    marks.extend(marks_beside(source));
    marks.insert("vertices".to_owned(), source.n_vertices().to_string());
    marks.insert("faces".to_owned(), source.n_face_rows().to_string());
    let input = std::path::absolute(&*config.input).unwrap_or_else(|_| config.input.to_path_buf());
    let input = input.display().to_string();
    let mut settings = config.settings();
    if config.map.is_some() {
        // Changes no byte of the result, but what the job keeps on the way.
        settings.insert("map".to_owned(), "vertices".to_owned());
    }
    Identity { input, input_marks: marks, settings }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_change_shows_in_the_marks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let input = InputPaths::from(&path);
        let bytes = vec![7u8; 3 << 20];
        std::fs::write(&path, &bytes).unwrap();
        let before = input_marks(&input).unwrap();
        assert_eq!(unchanged(&input, &before, Ok(5)).unwrap(), 5);
        let fault = || Err::<u32, _>(Error::bad_input("a", "row 7 is bad"));
        assert!(unchanged(&input, &before, fault()).unwrap_err().to_string().contains("row 7"));
        let told = |how: &str| {
            for outcome in [Ok(5), fault()] {
                let error = unchanged(&input, &before, outcome).unwrap_err();
                assert_eq!(error.exit_code(), 4);
                let said = error.to_string();
                assert!(said.contains("changed during the run") && said.contains(how), "{said}");
            }
        };
        std::fs::write(&path, &bytes[1..]).unwrap();
        told("bytes 3145727, before 3145728");
        let mut other = bytes;
        *other.last_mut().unwrap() = 8;
        std::fs::write(&path, &other).unwrap();
        told("sample_checksum");
        std::fs::remove_file(&path).unwrap();
        told("no longer");
        // Nothing to compare, and nothing to fail.
        assert!(input_marks(&"-".into()).unwrap().is_empty());
        assert_eq!(unchanged(&"-".into(), &BTreeMap::new(), Ok(3)).unwrap(), 3);
    }
    #[test]
    fn a_file_of_several_that_changed_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a", "b"].map(|name| folder.path().join(name));
        paths.iter().for_each(|path| std::fs::write(path, "1").unwrap());
        let input = InputPaths::new(paths.to_vec());
        let before = input_marks(&input).unwrap();
        assert_eq!((before.len(), before["bytes"].as_str()), (3, "2"));
        assert!(unchanged(&input, &before, Ok(())).is_ok());
        let told = |word: &str| {
            let said = unchanged(&input, &before, Ok(())).unwrap_err().to_string();
            let name = format!("{} {word}", paths[1].display());
            assert!(said.contains(&name), "{said}");
        };
        std::fs::write(&paths[1], "12").unwrap();
        told("2 ");
        std::fs::remove_file(&paths[1]).unwrap();
        told("missing");
    }
}
