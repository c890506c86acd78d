//! The job folder: who works in it, what it belongs to, and which stages are done.
//!
//! `Job::sealed` is how stages become resumable: it hands back the recorded outcome of a stage, or runs the
//! stage and records its outcome once everything the stage wrote is durable.

pub mod fingerprint;
mod lock;
mod manifest;
mod own_names;
pub mod units;

pub use lock::{hold, look};
pub use manifest::{Identity, ManifestView, has_manifest, view};
pub use own_names::{SCRATCH_EXTENSION, TRIALS, is_in_job};

use lock::JobLock;
use manifest::Manifest;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use stonecut_system::disk::{Disk, check_own};
use stonecut_system::error::{Error, Result};

/// An open job folder, locked against other runs; or a guest in the folder of a job that many processes work on.
#[derive(Debug)]
pub struct Job {
    folder: PathBuf,
    disk: Disk,
    manifest: Mutex<Manifest>,
    /// Begin of the names of all files that are made here; empty but for guests.
    prefix: String,
    /// Held for its destructor, which gives the folder free. None for guests.
    _lock: Option<JobLock>,
}

impl Job {
    /// The report of a run of this identity that ended, and was stopped while it removed its job folder; the rest of that
    /// goes now. A run of another identity that ended is cleared away, too.
    ///
    /// Errors: `Locked` when a living run works there.
    pub fn concluded<T: DeserializeOwned>(
        folder: &Path,
        disk: &Disk,
        identity: &Identity,
    ) -> Result<Option<T>> {
        let Ok(ManifestView { identity: found, outcomes }) = view(folder) else { return Ok(None) };
        let Some(report) = outcomes.get(OVER) else { return Ok(None) };
        let job = Job::open(folder, disk, &found, false)?;
        job.remove()?;
        // A report that this build cannot read is made again.
        Ok(serde_json::from_value(report.clone()).ok().filter(|_| found == *identity))
    }

    /// Records the report of a run whose output stands, and removes the whole folder.
    pub fn conclude<T: Serialize>(&self, report: &T) -> Result<()> {
        self.record(OVER, report)?;
        self.remove()
    }

    /// Begins a job in a folder that has none, with an empty outcome of this name recorded from its first moment on.
    ///
    /// Errors: `Locked` when a living run works there.
    pub fn begin_with(folder: &Path, disk: &Disk, identity: &Identity, name: &str) -> Result<()> {
        let _lock = take_folder(folder, disk)?;
        if has_manifest(folder) {
            return Ok(());
        }
        clear_data(folder, disk)?;
        let outcomes = [(name.to_owned(), serde_json::Value::Null)].into();
        Manifest::replace(folder, disk, &ManifestView { identity: identity.clone(), outcomes })
    }

    /// Opens the job in `folder`, or begins it; `restart` throws away what an earlier run left.
    ///
    /// Errors: `Locked` when a living run works there, `StateMismatch` when the folder belongs to another
    /// input, other settings or another format version.
    pub fn open(folder: &Path, disk: &Disk, identity: &Identity, restart: bool) -> Result<Job> {
        let lock = take_folder(folder, disk)?;
        if restart {
            clear(folder, disk)?;
        }
        let manifest = Manifest::open(folder, disk, identity)?;
        if manifest.is_new() {
            clear_data(folder, disk)?;
        }
        Ok(Job {
            folder: folder.into(),
            disk: disk.clone(),
            manifest: Mutex::new(manifest),
            prefix: String::new(),
            _lock: Some(lock),
        })
    }

    /// Opens a folder that others work in, too: without a lock, with `outcomes` that they have published. Files that
    /// are made here have names that begin with `prefix`; outcomes are kept in memory, and no file of others is removed.
    pub fn guest(
        folder: &Path,
        disk: &Disk,
        prefix: &str,
        outcomes: BTreeMap<String, serde_json::Value>,
    ) -> Job {
        let mut manifest = Manifest::in_memory(folder.join(prefix));
        manifest.inherit(outcomes);
        Job {
            folder: folder.into(),
            disk: disk.clone(),
            manifest: Mutex::new(manifest),
            prefix: prefix.to_owned(),
            _lock: None,
        }
    }

    /// The outcomes that were recorded since the job was opened.
    pub fn recorded(&self) -> BTreeMap<String, serde_json::Value> {
        self.manifest.lock().unwrap_or_else(PoisonError::into_inner).recorded()
    }

    /// The name that a file of a stage has in the folder.
    pub fn name(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// The path of a file of a stage.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(self.name(name))
    }

    /// Removes a file that no later stage needs, by its name in the folder; a guest leaves those of others.
    pub fn discard(&self, name_in_folder: &str) -> Result<()> {
        match self.owns(name_in_folder) {
            true => self.disk.remove(&self.folder.join(name_in_folder)),
            false => Ok(()),
        }
    }

    /// Returns whether a file was made here, so that nothing else needs it.
    pub fn owns(&self, name_in_folder: &str) -> bool {
        name_in_folder.starts_with(&self.prefix)
    }

    /// The file in which progress is posted for `status`; none for guests.
    pub fn board(&self) -> Option<PathBuf> {
        self._lock.as_ref().map(|_| self.folder.join(lock::FILE_NAME))
    }

    /// The job folder itself.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file system this job writes through.
    pub fn disk(&self) -> &Disk {
        &self.disk
    }

    /// The recorded outcome of stage `name`, or the outcome of running it now, recorded.
    ///
    /// `work` must have synced every file that its outcome names.
    pub fn sealed<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        work: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        if let Some(outcome) = self.outcome(name)? {
            return Ok(outcome);
        }
        let outcome = work()?;
        self.record(name, &outcome)?;
        Ok(outcome)
    }

    /// The recorded outcome of a stage, if it is done.
    pub fn outcome<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>> {
        self.manifest.lock().unwrap_or_else(PoisonError::into_inner).outcome(name)
    }

    /// Records an outcome; a later record of the same name replaces the earlier one.
    pub fn record<T: Serialize>(&self, name: &str, outcome: &T) -> Result<()> {
        self.manifest.lock().unwrap_or_else(PoisonError::into_inner).record(name, outcome)
    }

    /// Removes scratch folders inside the job folder that a killed run has left.
    pub fn clear_scratch(&self) -> Result<()> {
        match self._lock {
            Some(_) => clear_scratch(&self.folder, &self.disk),
            None => {
                sweep_scratch(&self.folder);
                Ok(())
            }
        }
    }

    /// Removes the whole folder: the run is over and its output stands. A guest removes nothing: whoever published
    /// its outcomes does.
    pub fn remove(&self) -> Result<()> {
        if self._lock.is_none() {
            return Ok(());
        }
        let is_over = self.manifest.lock().unwrap_or_else(PoisonError::into_inner).has(OVER);
        let manifest = self.folder.join(manifest::FILE_NAME);
        match is_over {
            // It says that nothing is left to be done, so it goes last.
            true => clear_data(&self.folder, &self.disk)
                .and_then(|()| self.disk.remove(&manifest))
                .and_then(|()| self.disk.sync_folder_of(&manifest))?,
            false => clear(&self.folder, &self.disk)?,
        }
        // Removed while held: a run that has just opened the old file sees that it is gone and starts again.
        self.disk.remove(&self.folder.join(lock::FILE_NAME))?;
        self.disk.remove_dir(&self.folder)
    }
}

/// Removes a job that no run goes on with, as far as it is ours and of these settings; `None` for any.
pub fn remove_job(folder: &Path, settings: Option<&BTreeMap<String, String>>) {
    let is_meant = settings.is_none_or(|settings| {
        lock::is_free(folder) == Some(true)
            && view(folder).is_ok_and(|found| found.identity.settings == *settings)
    });
    if is_meant && folder.is_dir() && check_own(folder).is_ok() {
        // What stays costs space; the error that led here matters more.
        let _ = Disk::default().remove_own(folder, &is_in_job, &|_| 0);
    }
}

/// Makes a job folder, or takes one that is ours and not in use for something else, and locks it.
fn take_folder(folder: &Path, disk: &Disk) -> Result<JobLock> {
    if !disk.own_dir(folder)? {
        own_names::refuse_foreign(folder)?;
    }
    JobLock::take(folder)
}

/// True if a folder holds what is left of a job without its manifest: of a run that ended after `output` was written, and was
/// stopped while it removed the folder.
pub fn is_remainder(folder: &Path, output: &Path) -> bool {
    // Units are done again one by one, and say by themselves when the output may be theirs.
    let is_of_units = folder.file_name().is_some_and(|name| name == own_names::UNITS);
    let is_bare = !is_of_units
        && !folder.join(manifest::FILE_NAME).exists()
        && check_own(folder).is_ok()
        && own_names::refuse_foreign(folder).is_ok();
    let made = std::fs::symlink_metadata(folder).and_then(|meta| meta.created()).ok();
    let written = std::fs::symlink_metadata(output).and_then(|meta| meta.modified()).ok();
    // An earlier output is not that of this job.
    is_bare && (made.is_none() || written >= made)
}

/// Takes a job back to where only the stages whose names are kept are done, for another attempt at the rest; `attempt`
/// counts from 1. Nothing happens if this attempt has begun, or if there is no job. Survivors of rounds that are to be done
/// again stay by another name (`round-1-trial.survivors`).
///
/// Errors: `Locked` when a living run works there.
pub fn rewind(
    folder: &Path,
    disk: &Disk,
    is_kept: impl Fn(&str) -> bool,
    attempt: usize,
) -> Result<()> {
    if !folder.join(manifest::FILE_NAME).exists() {
        return Ok(());
    }
    let _lock = take_folder(folder, disk)?;
    let mut view = view(folder)?;
    let begun = view.outcomes.get(ATTEMPT).and_then(serde_json::Value::as_u64).unwrap_or(1);
    if begun == attempt as u64 {
        return Ok(());
    }
    view.outcomes.retain(|name, _| is_kept(name));
    // Before the outcomes are forgotten: a later stage would go on with what is left of its files.
    let packs: Vec<&str> = view.outcomes.values().flat_map(manifest::pack_names).collect();
    clear_data_but(folder, disk, |name| match own_names::earlier_name(name) {
        _ if packs.contains(&name) => Ok(true),
        Some(earlier) => disk.rename(&folder.join(name), &folder.join(earlier)).map(|()| true),
        None => Ok(own_names::is_earlier(name)),
    })?;
    view.outcomes.insert(ATTEMPT.to_owned(), attempt.into());
    Manifest::replace(folder, disk, &view)
}

/// Removes every file of a job but its lock.
fn clear(folder: &Path, disk: &Disk) -> Result<()> {
    let manifest = folder.join(manifest::FILE_NAME);
    disk.remove(&manifest)?;
    // Before the data goes: a manifest that came back after a power loss would name files that are gone.
    disk.sync_folder_of(&manifest)?;
    clear_data(folder, disk)
}

fn clear_scratch(folder: &Path, disk: &Disk) -> Result<()> {
    let entries =
        std::fs::read_dir(folder).map_err(|e| Error::reading(folder, "cannot list", e))?;
    for entry in entries {
        let path = entry.map_err(|e| Error::reading(folder, "cannot list", e))?.path();
        if is_own_scratch(&path) {
            // What is not ours in it is left.
            let _ = disk.remove_own(&path, &own_names::is_in_scratch, &|_| 0);
        }
    }
    Ok(())
}

/// Returns whether a path is that of a folder of scratch of ours.
fn is_own_scratch(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(own_names::is_scratch) && check_own(path).is_ok()
}

/// Removes scratch folders in `folder` whose process has ended: their lock is free. What cannot be read or
/// removed is left.
pub fn sweep_scratch(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if is_own_scratch(&path) {
            // Looked at before the lock, which is the first file of a folder.
            let has_files = !stonecut_system::disk::is_empty(&path);
            let remove = || Disk::default().remove_own(&path, &own_names::is_in_scratch, &|_| 0);
            let _ = match lock::is_free(&path) {
                Some(false) => Ok(()),
                Some(true) => remove(),
                // The lock is gone again: its owner is removing the folder, or was killed while it did.
                None if has_files => remove(),
                // It has no lock yet, and goes only if it is empty; its owner makes it again.
                None => Disk::default().remove_dir(&path),
            };
        }
    }
}

fn clear_data(folder: &Path, disk: &Disk) -> Result<()> {
    clear_data_but(folder, disk, |_| Ok(false))
}

/// Removes data and scratch, but for the files that stay by their names.
fn clear_data_but(folder: &Path, disk: &Disk, stays: impl Fn(&str) -> Result<bool>) -> Result<()> {
    clear_scratch(folder, disk)?;
    let trials = folder.join(TRIALS);
    if std::fs::symlink_metadata(&trials).is_ok() {
        check_own(&trials)?;
        disk.remove_own(&trials, &own_names::is_in_trials, &|_| 0)?;
    }
    let entries =
        std::fs::read_dir(folder).map_err(|e| Error::reading(folder, "cannot list", e))?;
    for entry in entries {
        let name = entry.map_err(|e| Error::reading(folder, "cannot list", e))?.file_name();
        if let Some(name) = name.to_str().filter(|name| own_names::is_data(name))
            && !stays(name)?
        {
            disk.remove(&folder.join(name))?;
        }
    }
    Ok(())
}

/// Record of the attempt that a job is at, if it is not the first.
const ATTEMPT: &str = "attempt";

/// Record of a run whose output stands: its report.
pub const OVER: &str = "over";

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_job_is_taken_back_once_for_an_attempt() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("job");
        let disk = Disk::default();
        rewind(&folder, &disk, |name| name == "first", 2).unwrap();
        assert!(!folder.exists(), "there is no job");
        let identity = Identity {
            input: "a".to_owned(),
            input_marks: BTreeMap::new(),
            settings: BTreeMap::new(),
        };
        let open = || Job::open(&folder, &disk, &identity, false).unwrap();
        let job = open();
        job.record("first", &json!([{ "packs": [{ "pack": "round-1.survivors" }] }])).unwrap();
        job.record("second", &json!({ "pack": "round-2.survivors" })).unwrap();
        assert!(rewind(&folder, &disk, |name| name == "first", 2).is_err(), "a run holds it");
        drop(job);
        for name in ["round-1.survivors", "round-2.survivors", "round-3.cells"] {
            std::fs::write(folder.join(name), name).unwrap();
        }
        let names = || {
            let mut names: Vec<String> = std::fs::read_dir(&folder)
                .unwrap()
                .map(|entry| entry.unwrap().file_name().into_string().unwrap())
                .filter(|name| !name.contains("lock"))
                .collect();
            names.sort();
            names
        };
        rewind(&folder, &disk, |name| name == "first", 1).unwrap();
        assert_eq!(
            names(),
            ["manifest.jsonl", "round-1.survivors", "round-2.survivors", "round-3.cells"]
        );
        rewind(&folder, &disk, |name| name == "first", 2).unwrap();
        let left = ["manifest.jsonl", "round-1.survivors", "round-2-trial.survivors"];
        assert_eq!(names(), left);
        let job = open();
        assert!(job.outcome::<serde_json::Value>("first").unwrap().is_some());
        assert!(job.outcome::<serde_json::Value>("second").unwrap().is_none());
        job.record("second", &json!({ "pack": "round-2.survivors" })).unwrap();
        drop(job);
        rewind(&folder, &disk, |name| name == "first", 2).unwrap();
        assert!(open().outcome::<serde_json::Value>("second").unwrap().is_some(), "has begun");
    }
}
