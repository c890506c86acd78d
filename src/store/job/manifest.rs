//! The manifest: what a job belongs to, and the recorded outcomes of its stages.
//!
//! A text file of lines, each a JSON object, a tab and the xxh3 checksum of the JSON in hexadecimal. Lines
//! are only appended, each synced before the next stage may rely on it. A torn last line (power loss) is
//! cut off; a damaged line before the last is an error.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use stonecut_system::disk::{Disk, DiskFile, read_own};
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::{Place, write_whole};
use stonecut_system::units::show_time;
use xxhash_rust::xxh3::xxh3_64;

/// The manifest's name in the job folder.
pub const FILE_NAME: &str = "manifest.jsonl";

/// First bytes of a manifest.
pub const BEGIN: &str = "{\"name\":\"identity\"";

/// No manifest comes near this.
pub const MOST_BYTES: u64 = 1 << 30;

/// Version of everything in a job folder; another version is refused.
const FORMAT_VERSION: u32 = 10;

/// Identity that a job's files are valid for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// The input as the user named it, for messages.
    pub input: String,
    /// Name and value of everything about the input that must not change: bytes, mtime, checksums.
    pub input_marks: BTreeMap<String, String>,
    /// Name and value of every setting that changes the result.
    pub settings: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct ManifestLine {
    name: String,
    outcome: serde_json::Value,
}

/// An open manifest.
#[derive(Debug)]
pub struct Manifest {
    /// None: outcomes are kept in memory, for whoever publishes them otherwise.
    file: Option<DiskFile>,
    path: PathBuf,
    outcomes: BTreeMap<String, serde_json::Value>,
    /// Names of the outcomes that were recorded since the manifest was opened.
    recorded: BTreeSet<String>,
    is_new: bool,
}

/// Content of a manifest for `stonecut status`.
#[derive(Clone, Debug)]
pub struct ManifestView {
    /// Identity that the job belongs to.
    pub identity: Identity,
    /// Recorded outcomes by stage name.
    pub outcomes: BTreeMap<String, serde_json::Value>,
}

/// True of the folder of a job that has begun.
pub fn has_manifest(folder: &Path) -> bool {
    folder.join(FILE_NAME).exists()
}

/// Reads the manifest of a job folder without opening the job.
pub fn view(folder: &Path) -> Result<ManifestView> {
    let path = folder.join(FILE_NAME);
    let bytes = read_own(&path, MOST_BYTES)
        .map_err(|e| Error::reading(&path, "cannot read (is this a job folder?)", e))?;
    let (mut outcomes, _) = parse(&path, &bytes)?;
    let identity =
        outcomes.remove(IDENTITY).ok_or_else(|| Error::corrupt(&path, "has no identity line"))?;
    let (_, identity): (u32, Identity) = from_value(&path, IDENTITY, identity)?;
    Ok(ManifestView { identity, outcomes })
}

const IDENTITY: &str = "identity";

/// The mark of the time of an input.
const MTIME: &str = "mtime";

impl Manifest {
    /// Opens a job folder's manifest, or begins one for `identity`.
    pub fn open(folder: &Path, disk: &Disk, identity: &Identity) -> Result<Manifest> {
        let path = folder.join(FILE_NAME);
        let bytes = match read_own(&path, MOST_BYTES) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            Err(e) => return Err(Error::reading(&path, "cannot read", e)),
        };
        let (outcomes, valid_bytes) = parse(&path, &bytes)?;
        if let Some(found) = outcomes.get(IDENTITY) {
            let (version, found): (u32, Identity) = from_value(&path, IDENTITY, found.clone())?;
            check(folder, version, &found, identity)?;
            let file = Some(disk.open_append(&path, valid_bytes)?);
            return Ok(Manifest { file, path, outcomes, recorded: BTreeSet::new(), is_new: false });
        }
        let file = Some(disk.create(&path)?);
        let mut manifest = Manifest { file, is_new: true, ..Manifest::in_memory(path.clone()) };
        manifest.record(IDENTITY, &(FORMAT_VERSION, identity))?;
        disk.sync_folder_of(&path)?;
        Ok(manifest)
    }

    /// Puts a manifest in the place of the one in a job folder that no run holds; whole, or not at all.
    pub fn replace(folder: &Path, disk: &Disk, view: &ManifestView) -> Result<()> {
        let path = folder.join(FILE_NAME);
        let identity = serde_json::json!((FORMAT_VERSION, &view.identity));
        let mut lines = encode_line(IDENTITY, &identity);
        view.outcomes.iter().for_each(|(name, outcome)| lines += &encode_line(name, outcome));
        write_whole(Place { path, disk: disk.clone(), replace: true }, lines.as_bytes())
    }

    /// A manifest without a file; `path` is for messages.
    pub fn in_memory(path: PathBuf) -> Manifest {
        let (outcomes, recorded) = (BTreeMap::new(), BTreeSet::new());
        Manifest { file: None, path, outcomes, recorded, is_new: false }
    }

    /// Takes over outcomes that others have recorded.
    pub fn inherit(&mut self, outcomes: BTreeMap<String, serde_json::Value>) {
        self.outcomes.extend(outcomes);
    }

    /// The outcomes that were recorded since the manifest was opened.
    pub fn recorded(&self) -> BTreeMap<String, serde_json::Value> {
        let value = |name: &String| Some((name.clone(), self.outcomes.get(name)?.clone()));
        self.recorded.iter().filter_map(value).collect()
    }

    /// Returns whether this run began the manifest.
    pub fn is_new(&self) -> bool {
        self.is_new
    }

    /// Returns whether an outcome was recorded.
    pub fn has(&self, name: &str) -> bool {
        self.outcomes.contains_key(name)
    }

    /// The recorded outcome of a stage.
    pub fn outcome<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>> {
        let Some(value) = self.outcomes.get(name) else { return Ok(None) };
        from_value(&self.path, name, value.clone()).map(Some)
    }

    /// Appends an outcome and syncs it.
    pub fn record<T: Serialize>(&mut self, name: &str, outcome: &T) -> Result<()> {
        let outcome = serde_json::to_value(outcome).expect("outcomes are plain data");
        if let Some(file) = &mut self.file {
            file.append(encode_line(name, &outcome).as_bytes())?;
            file.sync()?;
        }
        self.recorded.insert(name.to_owned());
        self.outcomes.insert(name.to_owned(), outcome);
        Ok(())
    }
}

/// A line as it is stored: name and outcome, and their checksum.
pub fn encode_line(name: &str, outcome: &serde_json::Value) -> String {
    let line = serde_json::json!({ "name": name, "outcome": outcome });
    let json = line.to_string();
    format!("{json}\t{:016x}\n", xxh3_64(json.as_bytes()))
}

/// The outcome in a file of one line; `None` if the line is not whole, or is another's.
pub fn decode_line(name: &str, bytes: &[u8]) -> Option<serde_json::Value> {
    let line = parse_line(bytes.strip_suffix(b"\n")?)?;
    (line.name == name && foreign_name(&line.outcome).is_none()).then_some(line.outcome)
}

fn from_value<T: DeserializeOwned>(path: &Path, name: &str, value: serde_json::Value) -> Result<T> {
    serde_json::from_value(value).map_err(|e| {
        Error::corrupt(
            path,
            format!("the record of '{name}' cannot be understood ({e}); run again with --restart"),
        )
    })
}

/// The records of a manifest and how many of its bytes are whole lines.
fn parse(path: &Path, bytes: &[u8]) -> Result<(BTreeMap<String, serde_json::Value>, u64)> {
    let mut outcomes = BTreeMap::new();
    let mut valid = 0;
    while let Some(length) = bytes[valid..].iter().position(|&b| b == b'\n') {
        let line = &bytes[valid..valid + length];
        let Some(record) = parse_line(line) else {
            if valid + length + 1 == bytes.len() {
                break;
            }
            return Err(Error::corrupt(
                path,
                format!("the line at byte {valid} is damaged; run again with --restart"),
            ));
        };
        if let Some(name) = foreign_name(&record.outcome) {
            return Err(Error::corrupt(
                path,
                format!(
                    "the record of '{}' names the file {name:?}, which is not a file of a job folder",
                    record.name
                ),
            ));
        }
        outcomes.insert(record.name, record.outcome);
        valid += length + 1;
    }
    Ok((outcomes, valid as u64))
}

/// Names of the packs in an outcome.
pub fn pack_names(outcome: &serde_json::Value) -> Vec<&str> {
    match outcome {
        serde_json::Value::Object(fields) => {
            let own = fields.get("pack").and_then(serde_json::Value::as_str);
            own.into_iter().chain(fields.values().flat_map(pack_names)).collect()
        }
        serde_json::Value::Array(values) => values.iter().flat_map(pack_names).collect(),
        _ => Vec::new(),
    }
}

/// A pack's name that is not just a name: joined to the job folder it would lead out of it.
fn foreign_name(outcome: &serde_json::Value) -> Option<&str> {
    let is_name = |name: &str| Path::new(name).file_name() == Some(OsStr::new(name));
    pack_names(outcome).into_iter().find(|name| !is_name(name))
}

fn parse_line(line: &[u8]) -> Option<ManifestLine> {
    let text = std::str::from_utf8(line).ok()?;
    let (json, sum) = text.rsplit_once('\t')?;
    (u64::from_str_radix(sum, 16).ok()? == xxh3_64(json.as_bytes())).then_some(())?;
    serde_json::from_str(json).ok()
}

/// Names what differs between the job's identity and this run's.
fn check(folder: &Path, version: u32, found: &Identity, wanted: &Identity) -> Result<()> {
    if version != FORMAT_VERSION {
        return Err(Error::StateMismatch {
            path: folder.into(),
            what: format!(
                "holds an unfinished job of format version {version}, this program writes version {FORMAT_VERSION}; \
                 continue it with the program that began it, or give --restart to discard it"
            ),
        });
    }
    let mut differences = Vec::new();
    // A file that was moved with its job keeps its time and samples. Several files are marks by their paths.
    let is_moved = found.input_marks == wanted.input_marks && found.input_marks.contains_key(MTIME);
    if found.input != wanted.input && !is_moved {
        differences.push(format!("input {} instead of {}", found.input, wanted.input));
    }
    for (what, old, new) in [
        ("input ", &found.input_marks, &wanted.input_marks),
        ("", &found.settings, &wanted.settings),
    ] {
        let mut names: Vec<_> = old.keys().chain(new.keys()).collect();
        names.sort();
        names.dedup();
        for name in names {
            let (old, new) = (old.get(name), new.get(name));
            if old != new {
                let show = |v: Option<&String>| v.map_or("nothing".to_owned(), |v| shown(name, v));
                differences.push(format!("{what}{name} {} instead of {}", show(old), show(new)));
            }
        }
    }
    if differences.is_empty() {
        return Ok(());
    }
    let old_time = found.input_marks.get(MTIME).and_then(|time| time.parse::<u64>().ok());
    let mut retimed = wanted.input_marks.clone();
    retimed.extend(found.input_marks.get_key_value(MTIME).map(|(k, v)| (k.clone(), v.clone())));
    if let (Some(time), true) =
        (old_time, retimed == found.input_marks && found.settings == wanted.settings)
    {
        let (seconds, rest) = (time / 1_000_000_000, time % 1_000_000_000);
        return Err(Error::StateMismatch {
            path: folder.into(),
            what: format!(
                "the input changed since this job began ({}), or only its time did: its samples are the same; if it is the same file, \
                 touch -d @{seconds}.{rest:09} {} continues the job, and --restart throws it away",
                differences.join(", "),
                wanted.input
            ),
        });
    }
    if found.input == wanted.input && found.settings == wanted.settings {
        return Err(Error::StateMismatch {
            path: folder.into(),
            what: format!(
                "the input changed since this job began ({}); put the old input back to continue the job, or give --restart to \
                 throw it away",
                differences.join(", ")
            ),
        });
    }
    Err(Error::StateMismatch {
        path: folder.into(),
        what: format!(
            "holds an unfinished job with {}; give the same command to continue it, or --restart to throw it away",
            differences.join(", ")
        ),
    })
}

/// A mark as people read it: times in nanoseconds since 1970 become dates.
fn shown(name: &str, value: &str) -> String {
    match value.parse::<u64>() {
        Ok(nanoseconds) if name == MTIME => show_time(nanoseconds / 1_000_000_000),
        _ => value.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity(cells: &str) -> Identity {
        Identity {
            input: "a.ply".into(),
            input_marks: BTreeMap::from([("bytes".into(), "12".into())]),
            settings: BTreeMap::from([("cell_triangles".into(), cells.into())]),
        }
    }

    #[test]
    fn outcomes_survive_a_torn_last_line_but_not_a_damaged_one() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let mut manifest = Manifest::open(folder.path(), &disk, &identity("5")).unwrap();
        manifest.record("scan", &7u32).unwrap();
        manifest.record("partition", &8u32).unwrap();
        let path = folder.path().join(FILE_NAME);
        let whole = std::fs::read(&path).unwrap();
        for cut in 1..20 {
            std::fs::write(&path, &whole[..whole.len() - cut]).unwrap();
            let again = Manifest::open(folder.path(), &disk, &identity("5")).unwrap();
            assert_eq!(again.outcome::<u32>("scan").unwrap(), Some(7));
            assert_eq!(again.outcome::<u32>("partition").unwrap(), None);
        }
        let mut damaged = whole.clone();
        damaged[whole.len() / 2] ^= 4;
        std::fs::write(&path, &damaged).unwrap();
        assert!(matches!(
            Manifest::open(folder.path(), &disk, &identity("5")),
            Err(Error::Corrupt { .. })
        ));
    }

    #[test]
    fn a_job_of_other_settings_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        Manifest::open(folder.path(), &disk, &identity("5")).unwrap();
        let error = Manifest::open(folder.path(), &disk, &identity("6")).unwrap_err();
        assert!(error.to_string().contains("cell_triangles 5 instead of 6"), "{error}");
    }

    #[test]
    fn a_changed_input_is_named_with_dates() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let with = |mtime: &str| Identity {
            input_marks: BTreeMap::from([("mtime".into(), mtime.into())]),
            ..identity("5")
        };
        Manifest::open(folder.path(), &disk, &with("1700000000123456789")).unwrap();
        let error = Manifest::open(folder.path(), &disk, &with("1709164800000000000")).unwrap_err();
        let said = error.to_string();
        let dates = "input mtime 2023-11-14 22:13:20 UTC instead of 2024-02-29 00:00:00 UTC";
        assert!(said.contains("the input changed") && said.contains(dates), "{said}");
        assert!(said.contains("touch -d @1700000000.123456789 a.ply"), "{said}");
        let moved = Identity { input: "b.ply".into(), ..with("1700000000123456789") };
        assert!(Manifest::open(folder.path(), &disk, &moved).is_ok());
        let other = Identity { input: "b.ply".into(), ..with("1700000000123456788") };
        assert!(Manifest::open(folder.path(), &disk, &other).is_err());
    }

    #[test]
    fn no_record_leads_out_of_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let mut manifest = Manifest::open(folder.path(), &disk, &identity("5")).unwrap();
        manifest.record("round 0", &[serde_json::json!({"pack": "round-0.cells"})]).unwrap();
        let again = || Manifest::open(folder.path(), &disk, &identity("5"));
        assert!(again().is_ok());
        for name in ["../in.ply", "/etc/passwd", "a/b", "..", ".", ""] {
            let mut manifest = Manifest::open(folder.path(), &disk, &identity("5")).unwrap();
            manifest.record("round 0", &[serde_json::json!({"pack": name})]).unwrap();
            assert!(matches!(again(), Err(Error::Corrupt { .. })), "{name}");
            std::fs::remove_file(folder.path().join(FILE_NAME)).unwrap();
        }
    }
}
