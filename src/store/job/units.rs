//! Units of a job that many processes work on: their names, their records, and the files of their attempts.
//!
//! The folder of such a job holds the plan and the folder `units`. An attempt at a unit writes files whose names begin
//! with the unit and a name that no other attempt has. When all of them are durable it publishes a record that names them.
//! The first record of a unit counts; nothing is ever replaced, and there are no locks. What other machines have
//! written may be seen late, so whoever misses something looks again for a while.

use super::manifest::{decode_line, encode_line};
use super::own_names::{self, PLAN, UNITS};
use super::{Identity, is_own_scratch};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use stonecut_system::disk::{Disk, read_own};
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::Seen;
use stonecut_system::program::unique_name;
use stonecut_system::progress::Progress;

/// No record comes near this.
const MOST_RECORD_BYTES: u64 = 1 << 30;

/// Waiting is told after this time, and then again and again.
const FIRST_WORD: Duration = Duration::from_millis(500);
const WORDS_EVERY: Duration = Duration::from_secs(10);

/// Errno of a file that was removed on another machine while it was open here.
const STALE: i32 = 116;

/// A unit: a phase and a number in it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unit {
    /// The phase.
    pub phase: String,
    /// From 0.
    pub index: u32,
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.phase, self.index)
    }
}

impl std::str::FromStr for Unit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(phase, index)| {
            Some(Unit { phase: phase.to_owned(), index: index.parse().ok()? })
        });
        parts.ok_or_else(|| format!("'{text}' names no unit: give PHASE/INDEX, as simplify/17"))
    }
}

impl Unit {
    /// Begin of the names of its files, up to a dot.
    fn stem(&self) -> String {
        format!("{}-{:04}", self.phase, self.index)
    }

    fn record_name(&self) -> String {
        format!("{}.record", self.stem())
    }
}

/// A phase: units that may run in any order, all at once, after all units of other phases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Phase {
    /// Its name.
    pub name: String,
    /// Number of units.
    pub units: u32,
    /// The phases that must be over.
    pub after: Vec<String>,
    /// Memory that a unit needs at least, in bytes.
    pub memory: u64,
    /// Expected seconds of a unit on one core.
    pub seconds: f64,
}

/// Decisions that were made before the first unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frozen {
    /// Version of the program.
    pub version: String,
    /// Checksum of the program.
    pub program: String,
    /// Mark of its file: whoever runs that file need not read it for the checksum.
    pub program_mark: Option<String>,
    /// The words of the command.
    pub words: Vec<String>,
    /// The folder in which it was given.
    pub folder: PathBuf,
    /// Checksum of all settings, those that do not change the result included.
    pub settings: String,
    /// The input and all settings that change the result.
    pub identity: Identity,
    /// Triangles of the input.
    pub triangles: u64,
    /// The phases, in order.
    pub phases: Vec<Phase>,
    /// The file for the report, as it was found by the plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report: Option<Seen>,
}

impl Frozen {
    /// The phase of this name.
    pub fn phase(&self, name: &str) -> Option<&Phase> {
        self.phases.iter().find(|phase| phase.name == name)
    }

    /// All units of a phase.
    pub fn units_of(&self, name: &str) -> Vec<Unit> {
        let n = self.phase(name).map_or(0, |phase| phase.units);
        (0..n).map(|index| Unit { phase: name.to_owned(), index }).collect()
    }
}

/// A file that a unit has left.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnitFile {
    /// Its name in the folder of units.
    pub pack: String,
    /// Its length.
    pub bytes: u64,
}

/// The record of a unit that is done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Begin of the names of the attempt's files.
    pub attempt: String,
    /// The files that it has left.
    pub files: Vec<UnitFile>,
    /// Outcomes for later phases, by name.
    pub outcomes: BTreeMap<String, serde_json::Value>,
    /// Triangles that were worked on.
    pub triangles: u64,
    /// Begin and end in seconds since 1970, by the clock of the machine.
    pub span: [f64; 2],
    /// Processor time in seconds.
    pub processor_seconds: f64,
    /// Bytes of job files that were read and written.
    pub bytes_read: u64,
    /// Bytes of job files and output that were written.
    pub bytes_written: u64,
    /// Peak memory of the process.
    pub peak_memory_bytes: u64,
}

impl Record {
    /// An outcome that the unit is bound to have.
    pub fn outcome<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        let value = self.outcomes.get(name).cloned().unwrap_or_default();
        serde_json::from_value(value).map_err(|e| {
            Error::corrupt(&self.attempt, format!("the outcome '{name}' cannot be understood: {e}"))
        })
    }
}

/// The folder of a job that many processes work on.
#[derive(Clone, Debug)]
pub struct UnitJob {
    folder: PathBuf,
    disk: Disk,
    /// Missing files are looked for again during this time.
    patience: Duration,
}

impl UnitJob {
    /// The job in `folder`; nothing is read or written yet.
    pub fn new(folder: &Path, disk: &Disk, patience: Duration) -> UnitJob {
        UnitJob { folder: folder.into(), disk: disk.clone(), patience }
    }

    /// True if a folder holds the plan of such a job.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(PLAN).exists()
    }

    /// The folder in which units leave their files.
    pub fn units_folder(&self) -> PathBuf {
        self.folder.join(UNITS)
    }

    /// The disk that it works through.
    pub fn disk(&self) -> &Disk {
        &self.disk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.units_folder().join(name)
    }

    /// Freezes the job; a job that is frozen already must be the same one.
    pub fn freeze(&self, frozen: &Frozen) -> Result<()> {
        if !self.disk.own_dir(&self.folder)? {
            own_names::refuse_foreign_units(&self.folder)?;
        }
        self.disk.own_dir(&self.units_folder())?;
        let value = serde_json::to_value(frozen).expect("plain data");
        let temporary = self.folder.join(format!("plan.{}.part", unique_name()));
        let line = encode_line("plan", &value);
        if self.disk.publish(&self.folder.join(PLAN), &temporary, line.as_bytes())? {
            return self.disk.sync_folder_of(&self.units_folder());
        }
        let found = self.frozen(&Progress::default())?;
        let units = |plan: &Frozen| plan.phases.iter().map(|phase| phase.units).collect::<Vec<_>>();
        let is_same = found.identity == frozen.identity
            && found.settings == frozen.settings
            && units(&found) == units(frozen);
        if found.program == frozen.program && !is_same {
            let what =
                "holds another job; give the same command to continue that, or another folder";
            return Err(Error::StateMismatch { path: self.folder.clone(), what: what.to_owned() });
        }
        found.check_program(&self.folder, &frozen.version, &frozen.program)
    }

    /// Refuses folders that are not ours: their owner could lead what is written there elsewhere.
    pub fn check_own(&self) -> Result<()> {
        own_names::check_own_units(&self.folder)
    }

    /// The plan of the job.
    pub fn frozen(&self, progress: &Progress) -> Result<Frozen> {
        let path = self.folder.join(PLAN);
        let found = self.look_again("the plan", progress, || read_line(&path, "plan"))?;
        let value = found.ok_or_else(|| {
            Error::bad_input(&self.folder, "holds no plan; make one with 'stonecut plan'")
        })?;
        serde_json::from_value(value).map_err(|_| Error::StateMismatch {
            path: self.folder.clone(),
            what: "the plan is that of another version of the program".to_owned(),
        })
    }

    /// The record of a unit, if it is done.
    pub fn record(&self, unit: &Unit) -> Result<Option<Record>> {
        let path = self.path(&unit.record_name());
        let Some(value) = read_line(&path, &unit.to_string())? else { return Ok(None) };
        let record = serde_json::from_value(value);
        record.map(Some).map_err(|e| Error::corrupt(&path, format!("cannot be understood: {e}")))
    }

    /// The record of a unit that has to be done, and whose files are there.
    ///
    /// Errors: `Io` if it is not, after having looked again.
    pub fn require(&self, unit: &Unit, progress: &Progress) -> Result<Record> {
        let mut missing = None;
        let found = self.look_again(&format!("unit {unit}"), progress, || {
            let Some(record) = self.record(unit)? else { return Ok(None) };
            let is_there = |file: &&UnitFile| {
                std::fs::metadata(self.path(&file.pack)).is_ok_and(|meta| meta.len() >= file.bytes)
            };
            missing = record.files.iter().find(|file| !is_there(file)).cloned();
            Ok(missing.is_none().then_some(record))
        })?;
        found.ok_or_else(|| match missing {
            Some(file) => Error::corrupt(
                self.path(&file.pack),
                format!("is missing or too short; {}", self.mending(unit)),
            ),
            None => Error::reading(
                self.path(&unit.record_name()),
                "cannot begin before this unit is done",
                std::io::Error::other(format!("give 'stonecut work JOBDIR {unit}' first")),
            ),
        })
    }

    /// Advice against a damaged file of a unit.
    fn mending(&self, unit: &Unit) -> String {
        let folder = self.folder.display();
        format!("'stonecut work {folder} {unit} --mend' makes it again")
    }

    /// Names the unit that has left a damaged file, and what to do.
    pub fn explain(&self, error: Error, frozen: &Frozen) -> Error {
        let Error::Corrupt { path, what } = error else { return error };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let units = frozen.phases.iter().flat_map(|phase| frozen.units_of(&phase.name));
        let unit = units.into_iter().find(|unit| name.starts_with(&format!("{}.", unit.stem())));
        let what = match unit {
            Some(unit) => {
                let what = what.split("; run again").next().unwrap_or(&what);
                format!("{what} (of unit {unit}); {}", self.mending(&unit))
            }
            None => what,
        };
        Error::Corrupt { path, what }
    }

    /// Looks until something is there, or the time is over, and says so meanwhile. What is half written, or was replaced,
    /// counts as missing until then.
    fn look_again<T>(
        &self,
        what: &str,
        progress: &Progress,
        mut look: impl FnMut() -> Result<Option<T>>,
    ) -> Result<Option<T>> {
        let (start, mut pause) = (Instant::now(), Duration::from_millis(20));
        let mut next_word = FIRST_WORD;
        loop {
            let waited = start.elapsed();
            let is_over = waited >= self.patience;
            if waited >= next_word && !is_over {
                let [waited, most] = [waited, self.patience].map(|time| time.as_secs());
                progress.note(format!("waits for {what}, which another process has to do: {waited} of at most {most} s"));
                next_word += WORDS_EVERY;
            }
            match look() {
                Ok(Some(found)) => return Ok(Some(found)),
                Ok(None) if is_over => return Ok(None),
                Err(error) if is_over || !may_pass(&error) => return Err(error),
                _ => {}
            }
            progress.check()?;
            std::thread::sleep(pause);
            pause = (2 * pause).min(Duration::from_secs(1));
        }
    }

    /// Begins an attempt at a unit.
    pub fn attempt(&self, unit: &Unit) -> Attempt<'_> {
        let prefix = format!("{}.{}.", unit.stem(), unique_name());
        Attempt { job: self, unit: unit.clone(), prefix, is_published: false }
    }

    /// Withdraws the record of a unit, so that it can be done again.
    pub fn withdraw(&self, unit: &Unit) -> Result<()> {
        let path = self.path(&unit.record_name());
        self.disk.remove(&path)?;
        self.disk.sync_folder_of(&path)
    }

    /// Removes what attempts at units that are done have left, but for those that count.
    pub fn sweep(&self, done: &[(Unit, Record)]) -> Result<()> {
        let of =
            |(unit, record): &(Unit, Record)| (format!("{}.", unit.stem()), record.attempt.clone());
        let done: Vec<(String, String)> = done.iter().map(of).collect();
        self.remove_files(|name| {
            done.iter().any(|(stem, attempt)| {
                name.starts_with(stem.as_str()) && !name.starts_with(attempt.as_str())
            })
        })
    }

    /// Removes all files but the records.
    pub fn clear(&self) -> Result<()> {
        self.remove_files(|_| true)
    }

    fn remove_files(&self, is_chosen: impl Fn(&str) -> bool) -> Result<()> {
        let folder = self.units_folder();
        let entries =
            std::fs::read_dir(&folder).map_err(|e| Error::reading(&folder, "cannot list", e))?;
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if !is_chosen(&name) {
                continue;
            }
            if own_names::is_of_attempt(&name) {
                self.disk.remove(&entry.path())?;
            } else if is_own_scratch(&entry.path()) {
                let _ = self.disk.remove_own(&entry.path(), &own_names::is_in_scratch, &|_| 0);
            }
        }
        Ok(())
    }

    /// Notes that the output may be there from now on; see `has_begun`.
    pub fn begin_to_write(&self) -> Result<()> {
        let path = self.path(BEGUN);
        match self.disk.create_new(&path)? {
            Some(_) => self.disk.sync_folder_of(&path),
            None => Ok(()),
        }
    }

    /// The units that are done, by listing the folder once.
    pub fn done(&self) -> Result<Vec<Unit>> {
        let folder = self.units_folder();
        let entries =
            std::fs::read_dir(&folder).map_err(|e| Error::reading(&folder, "cannot list", e))?;
        let unit = |name: &str| {
            let (phase, index) = name.strip_suffix(".record")?.rsplit_once('-')?;
            Some(Unit { phase: phase.to_owned(), index: index.parse().ok()? })
        };
        let names = entries.flatten().map(|entry| entry.file_name());
        let mut done: Vec<Unit> = names.filter_map(|name| unit(&name.to_string_lossy())).collect();
        done.sort();
        Ok(done)
    }
}

/// A file in the folder of units: an output that is found may be this job's.
const BEGUN: &str = "writing";

/// Returns whether the output of a job may have been written by one of its units.
pub fn has_begun(units_folder: &Path) -> bool {
    units_folder.join(BEGUN).exists()
}

impl Frozen {
    /// Refuses another program than the one that made the plan.
    pub fn check_program(&self, folder: &Path, version: &str, program: &str) -> Result<()> {
        if self.version == version && self.program == program {
            return Ok(());
        }
        Err(Error::StateMismatch {
            path: folder.into(),
            what: format!(
                "was planned by stonecut {} (checksum {}), this is {version} ({program}); use the same program on \
                 all machines, or plan again in another folder",
                self.version, self.program
            ),
        })
    }
}

/// Faults of reading that end when a file is there in full.
fn may_pass(error: &Error) -> bool {
    match error {
        Error::Corrupt { .. } => true,
        Error::Io { source, .. } => source.raw_os_error() == Some(STALE),
        _ => false,
    }
}

/// The content of a file of one line; `None` if it is not there.
fn read_line(path: &Path, name: &str) -> Result<Option<serde_json::Value>> {
    let bytes = match read_own(path, MOST_RECORD_BYTES) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::reading(path, "cannot read", e)),
    };
    let what = "is damaged; remove it, and do that unit again";
    decode_line(name, &bytes).map(Some).ok_or_else(|| Error::corrupt(path, what))
}

/// One process at work on one unit. Dropped without having won, it removes its files.
#[derive(Debug)]
pub struct Attempt<'a> {
    job: &'a UnitJob,
    unit: Unit,
    prefix: String,
    is_published: bool,
}

impl Attempt<'_> {
    /// Begin of the names of all its files.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The files that it has left up to now.
    pub fn files(&self) -> Result<Vec<UnitFile>> {
        let folder = self.job.units_folder();
        let failed = |e| Error::reading(&folder, "cannot list", e);
        let mut files = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let pack = entry.file_name().to_string_lossy().into_owned();
            if pack.starts_with(&self.prefix) {
                files.push(UnitFile { pack, bytes: entry.metadata().map_err(failed)?.len() });
            }
        }
        files.sort_by(|a, b| a.pack.cmp(&b.pack));
        Ok(files)
    }

    /// Publishes the record; everything that it names must be durable. `false` if another attempt was faster.
    pub fn publish(mut self, record: Record) -> Result<bool> {
        let record = Record { attempt: self.prefix.clone(), ..record };
        let value = serde_json::to_value(&record).expect("plain data");
        let line = encode_line(&self.unit.to_string(), &value);
        let temporary = self.job.path(&format!("{}part", self.prefix));
        let path = self.job.path(&self.unit.record_name());
        let published = self.job.disk.publish(&path, &temporary, line.as_bytes());
        // The record may be there though making it durable has failed: then it names these files.
        self.is_published = *published.as_ref().unwrap_or(&path.exists());
        published
    }
}

impl Drop for Attempt<'_> {
    fn drop(&mut self) {
        if !self.is_published {
            // What stays is swept by a later phase.
            let _ = self.job.remove_files(|name| name.starts_with(&self.prefix));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_record_counts_and_the_other_attempt_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let job = UnitJob::new(folder.path(), &disk, Duration::ZERO);
        std::fs::create_dir(job.units_folder()).unwrap();
        let unit: Unit = "simplify/17".parse().unwrap();
        assert_eq!(job.record(&unit).unwrap(), None);
        let (first, second) = (job.attempt(&unit), job.attempt(&unit));
        let file = |attempt: &Attempt| format!("{}round-0.survivors", attempt.prefix());
        let names = [file(&first), file(&second)];
        names.iter().for_each(|name| std::fs::write(job.path(name), "x").unwrap());
        assert!(second.publish(Record { triangles: 2, ..Record::default() }).unwrap());
        assert!(!first.publish(Record { triangles: 1, ..Record::default() }).unwrap());
        assert_eq!(job.record(&unit).unwrap().unwrap().triangles, 2);
        assert!(!job.path(&names[0]).exists() && job.path(&names[1]).exists());
        assert_eq!(job.done().unwrap(), [unit]);
    }

    #[test]
    fn what_is_missing_is_looked_for_again_and_then_named() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let job = UnitJob::new(folder.path(), &disk, Duration::from_secs(20));
        std::fs::create_dir(job.units_folder()).unwrap();
        let unit: Unit = "pilot/0".parse().unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(100));
                job.attempt(&unit).publish(Record::default()).unwrap();
            });
            job.require(&unit, &Progress::default()).unwrap();
        });
        let impatient = UnitJob::new(folder.path(), &disk, Duration::from_secs(1));
        let (other, progress): (Unit, _) = ("pilot/1".parse().unwrap(), Progress::default());
        let error = impatient.require(&other, &progress).unwrap_err();
        assert!(error.exit_code() == 1 && error.to_string().contains("pilot-0001"), "{error}");
        let notes = progress.take_notes();
        assert!(notes[0].starts_with("waits for unit pilot/1"), "{notes:?}");
        std::fs::write(job.path("pilot-0001.record"), "torn").unwrap();
        let error = impatient.require(&other, &Progress::default()).unwrap_err();
        assert!(error.to_string().contains("damaged"), "{error}");
    }
}
