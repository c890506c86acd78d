//! `--receipt` and `--sign` of `simplify` and `tiles`: a receipt is filled in from the files once they are whole.

use super::arguments::require_ending;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::io::InputPaths;
use crate::io::ply::MeshSource;
use crate::io::sidecars::Georeference;
use crate::measure::compare::compare;
use crate::measure::{Certificate, Certify};
use crate::mesh::topology_counts::Topology;
use crate::pipeline::run_report::RunReport;
use crate::pipeline::verify::{MeasuredPair, TOLERANCE};
use crate::receipt::hashes::{Hashes, of_file};
use crate::receipt::signature::{SigningKey, path_beside};
use crate::receipt::{
    ABOUT, HashedFiles, MadeBy, ProvenInterval, Receipt, ReceiptInput, ReceiptOutcome,
    ReceiptOutput, ReceiptPlace, json,
};
use crate::store::job::fingerprint::unchanged;
use crate::system::disk::{Disk, folder_of, read_regular};
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::{Seen, write_whole};
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Options that change no byte of the result, or name other files: no receipt has them.
const NOT_KEPT: [&str; 20] = [
    "dry-run",
    "force",
    "help",
    "keep-temp",
    "log-file",
    "map",
    "memory",
    "min-free",
    "progress",
    "quiet",
    "receipt",
    "report",
    "restart",
    "seams",
    "sign",
    "temp-dir",
    "threads",
    "until",
    "verbose",
    "verify",
];

/// Samples on each surface: the proof needs few to begin with.
const SAMPLES: u64 = 1000;

/// Files of keys and signatures have three lines.
const MOST_KEY_BYTES: u64 = 64 << 10;

/// Options about the receipt.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct TypedReceipt {
    /// Write a receipt: hashes of all files of input and output, settings, counts, losses, and the distance between the
    /// two, proven as by 'measure --certify'; of tiles the distances that they state. 'stonecut verify' checks it.
    #[arg(long, value_name = "FILE.json")]
    receipt: Option<PathBuf>,
    /// With --receipt: sign it with a secret key of minisign that has no password, in FILE.json.minisig.
    #[arg(long, value_name = "KEYFILE", requires = "receipt")]
    sign: Option<PathBuf>,
    /// Every word of the command line.
    #[arg(skip)]
    pub(super) words: Vec<std::ffi::OsString>,
}

impl TypedReceipt {
    /// Returns whether a receipt is still to be written.
    pub(super) fn is_owed(&self) -> bool {
        self.receipt.as_ref().is_some_and(|path| !path.exists())
    }

    /// The option, if it was given.
    pub(super) fn given(&self) -> Option<&'static str> {
        self.receipt.as_ref().map(|_| "--receipt")
    }

    /// Adds what is read and written; `streams` are input and output.
    pub(super) fn add_to(&self, paths: Paths, streams: [&Path; 2]) -> Result<Paths> {
        let Some(receipt) = &self.receipt else { return Ok(paths) };
        require_ending("--receipt", receipt, &["json"])?;
        if streams.contains(&Path::new("-")) {
            let what = "--receipt is of files, and '-' is none; give INPUT and OUTPUT names";
            return Err(Error::Usage(what.to_owned()));
        }
        let paths = paths.with(Role::Side(Kind::Receipt), "--receipt", receipt);
        Ok(match &self.sign {
            Some(key) => paths.with(Role::InputFile, "--sign", key).with(
                Role::Side(Kind::Signature),
                "the signature of --receipt",
                path_beside(receipt),
            ),
            None => paths,
        })
    }

    /// Looks at the files before the work; `None` where no receipt was asked for.
    pub(super) fn begin(&self) -> Result<Option<ReceiptWriter>> {
        let Some(receipt) = &self.receipt else { return Ok(None) };
        let key = match &self.sign {
            Some(path) => {
                let key = SigningKey::parse(&read_text(path)?);
                Some((
                    key.map_err(|e| Error::bad_input(path, e))?,
                    Seen::new(&path_beside(receipt)),
                ))
            }
            None => None,
        };
        Ok(Some(ReceiptWriter { to: Seen::new(receipt), key, words: self.words.clone() }))
    }
}

/// Reads a file of a key or a signature.
pub(super) fn read_text(path: &Path) -> Result<String> {
    let bytes = read_regular(path, MOST_KEY_BYTES)
        .map_err(|e| Error::bad_input(path, format!("cannot read: {e}")))?;
    String::from_utf8(bytes).map_err(|_| Error::bad_input(path, "not a key or signature: no text"))
}

/// A receipt that will be written.
pub(super) struct ReceiptWriter {
    to: Seen,
    key: Option<(SigningKey, Seen)>,
    words: Vec<std::ffi::OsString>,
}

impl ReceiptWriter {
    /// The path of the receipt.
    pub(super) fn path(&self) -> &Path {
        self.to.path()
    }

    /// Hashes and measures the files, and writes the receipt.
    pub(super) fn write(
        &self,
        typed: Typed,
        run: (&Config, &RunReport),
        progress: &Progress,
    ) -> Result<()> {
        let (config, report) = run;
        let mut hashes = Hashes::beside(self.to.path(), progress)?;
        let given = names_given(&config.input, &hashes)?;
        let taken = take(config, given, TOLERANCE, &mut hashes, progress)?;
        // The hashes are of what the run has read and written, or of nothing.
        if let Some(done) = &report.done {
            unchanged(&config.input, &done.input, Ok(()))?;
            for (path, marks) in &done.outputs {
                unchanged(&path.as_str().into(), marks, Ok(()))?;
            }
        }
        let receipt = Receipt {
            about: ABOUT.to_owned(),
            coordinates: taken.coordinates,
            input: taken.input,
            losses: report.losses.clone(),
            options: self.options(&typed),
            outcome: outcome_of(report),
            output: hashes.name(typed.output)?,
            outputs: taken.outputs,
            program: made_by(&typed, progress)?,
            settings: report.settings.clone(),
            sha256: String::new(),
            tree: None,
        };
        self.seal(receipt, progress)
    }

    /// The options that decide the bytes.
    pub(super) fn options(&self, typed: &Typed) -> Vec<String> {
        options(typed.line, &self.words)
    }

    /// Writes a receipt that is filled in, and its signature.
    pub(super) fn seal(&self, receipt: Receipt, progress: &Progress) -> Result<()> {
        let bytes = receipt.sealed()?;
        progress.check()?;
        write_whole(self.to.place(&Disk::default()), &bytes)?;
        if let Some((key, to)) = &self.key {
            let signature = key.sign(&bytes).map_err(Error::Internal)?;
            write_whole(to.place(&Disk::default()), signature.as_bytes())?;
        }
        Ok(())
    }
}

/// Words of a run that its settings do not have.
pub(super) struct Typed<'a> {
    /// The output, of a chain with its mark.
    pub(super) output: &'a Path,
    /// The whole command line.
    pub(super) line: fn() -> clap::Command,
    /// True if stonecut is the process, false within another program.
    pub(super) is_program: bool,
}

/// The program of this process.
pub(super) fn made_by(typed: &Typed, progress: &Progress) -> Result<MadeBy> {
    let build = match std::env::current_exe() {
        Ok(program) if typed.is_program => Some(of_file(&program, progress)?.sha256),
        _ => None,
    };
    Ok(MadeBy { build, version: env!("CARGO_PKG_VERSION").to_owned() })
}

/// The names of inputs as typed.
pub(super) fn names_given(input: &InputPaths, hashes: &Hashes) -> Result<Vec<String>> {
    input.given().iter().map(|path| name_given(path, hashes)).collect()
}

/// The name of an input as typed; a list keeps its mark.
fn name_given(path: &Path, hashes: &Hashes) -> Result<String> {
    match path.to_str().and_then(|text| text.strip_prefix('@')) {
        Some(list) if !path.exists() => Ok(format!("@{}", hashes.name(Path::new(list))?)),
        _ => hashes.name(path),
    }
}

/// Options of a command that decide the bytes of its result, sorted.
fn options(line: fn() -> clap::Command, words: &[std::ffi::OsString]) -> Vec<String> {
    let mut line = line();
    line.build();
    let Ok(found) = line.try_get_matches_from_mut(words) else { return Vec::new() };
    let Some((name, found)) = found.subcommand() else { return Vec::new() };
    let mut options = Vec::new();
    for arg in line.find_subcommand(name).into_iter().flat_map(|command| command.get_arguments()) {
        let (Some(long), id) = (arg.get_long(), arg.get_id().as_str()) else { continue };
        let is_typed = || found.value_source(id) == Some(clap::parser::ValueSource::CommandLine);
        if NOT_KEPT.contains(&long) || !is_typed() {
            continue;
        }
        match arg.get_action().takes_values() {
            true => options.extend(
                found
                    .get_raw(id)
                    .into_iter()
                    .flatten()
                    .map(|value| format!("--{long}={}", value.to_string_lossy())),
            ),
            false => options.push(format!("--{long}")),
        }
    }
    options.sort();
    options
}

/// Refuses an option of a receipt that no receipt has: it could name a file to be written.
pub(super) fn is_kept(option: &str) -> bool {
    let name = option.strip_prefix("--").map(|rest| rest.split('=').next().unwrap_or_default());
    name.is_some_and(|name| !name.is_empty() && !NOT_KEPT.contains(&name))
}

/// The end of a run.
pub(super) fn outcome_of(report: &RunReport) -> ReceiptOutcome {
    ReceiptOutcome {
        faults: report.input.faults.clone(),
        stop_reason: report.stop_reason.clone(),
        target_met: report.target_met,
    }
}

/// The parts of a receipt that follow from the files.
pub(super) struct TakenReceipt {
    pub(super) input: ReceiptInput,
    pub(super) outputs: Vec<ReceiptOutput>,
    pub(super) coordinates: ReceiptPlace,
}

/// Hashes the files of a run and measures its outputs.
pub(super) fn take(
    config: &Config,
    given: Vec<String>,
    tolerance: f64,
    hashes: &mut Hashes,
    progress: &Progress,
) -> Result<TakenReceipt> {
    let mut taken = TakenReceipt {
        input: ReceiptInput { given, ..ReceiptInput::default() },
        outputs: Vec::new(),
        coordinates: ReceiptPlace::default(),
    };
    for path in config.input.files()? {
        taken.input.files.extend([hashes.entry(&path)?]);
    }
    for (number, output) in config.outputs().enumerate() {
        let pair = MeasuredPair::open(config, output)?;
        let (distance, [original, simplified]) = enclose(&pair, config, tolerance, progress)?;
        if number == 0 {
            let mut beside = companions(&pair.original, hashes)?;
            beside.retain(|name, _| !taken.input.files.contains_key(name));
            taken.input.beside = beside;
            taken.input.counts = counts(&original)?;
            taken.coordinates = place_of(&config.input, &pair.original);
        }
        let mut files = companions(&pair.simplified, hashes)?;
        let (path, file) = hashes.entry(output)?;
        files.insert(path.clone(), file);
        taken.outputs.push(ReceiptOutput { counts: counts(&simplified)?, distance, files, path });
    }
    Ok(taken)
}

/// Encloses the distance between input and output, and counts both.
pub(super) fn enclose(
    pair: &MeasuredPair,
    config: &Config,
    tolerance: f64,
    progress: &Progress,
) -> Result<(ProvenInterval, [Topology; 2])> {
    let mut request = pair.request(config, folder_of(&config.job_folder));
    request.options.samples = SAMPLES;
    request.options.certify = Some(Certify { tolerance, bound: None });
    let measured = compare(&request, progress)?.measured;
    let Some(Certificate { lower, upper, tolerance, certified, .. }) = measured.certificate else {
        return Err(Error::Internal("a measurement without its certificate".to_owned()));
    };
    let distance = ProvenInterval { certified, lower, tolerance, upper };
    Ok((distance, [measured.original, measured.simplified]))
}

/// The place of an input on the globe.
pub(super) fn place_of(input: &InputPaths, source: &MeshSource) -> ReceiptPlace {
    let georeference = Georeference::beside(&input.first());
    ReceiptPlace {
        offset: georeference.as_ref().map(|found| found.offset),
        recentred: source.offset(),
        system: georeference.map(|found| found.crs).filter(|crs| !crs.is_empty()),
    }
}

/// The files that a mesh names.
pub(super) fn companions(source: &MeshSource, hashes: &mut Hashes) -> Result<HashedFiles> {
    let named = source.materials().into_iter().flat_map(|materials| materials.files());
    let buffers = source.beside().iter().map(PathBuf::as_path);
    buffers.chain(named).map(|path| hashes.entry(path)).collect()
}

fn counts(topology: &Topology) -> Result<BTreeMap<String, i64>> {
    serde_json::from_value(json(topology)?)
        .map_err(|e| Error::Internal(format!("counts are not numbers: {e}")))
}
