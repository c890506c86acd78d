//! `stonecut verify`: checks a receipt against the files that it names.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::job::{prepare, run_job};
use super::receipt::{enclose, is_kept, outcome_of, read_text, take};
use super::session::{Command, Session};
use super::{simplify, tiles, tree_receipt};
use crate::config::Config;
use crate::error::{Error, Offers, Result};
use crate::measure::LEAST_TOLERANCE;
use crate::pipeline::tiles::{TilesConfig, make_tiles};
use crate::pipeline::verify::MeasuredPair;
use crate::receipt::hashes::{Hashes, of_file};
use crate::receipt::{ProvenInterval, Receipt, ReceiptTree, json, signature};
use crate::system::canonical_json::differences;
use crate::system::disk::{Disk, folder_of};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::terminal::shown;
use crate::system::units::show_outward;
use clap::FromArgMatches;
use std::ffi::OsString;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Exit code of a receipt that does not hold.
const EXIT_MISMATCH: u8 = 4;

/// Times that a proof is repeated with a tenth of the width, where an interval overlaps the recorded one.
const MOST_FINER: usize = 2;

/// Checks a receipt of 'simplify --receipt' or 'tiles --receipt': its checksum and signature, the hashes of all files, and the
/// distance, proven again; of tiles their rules and what they state.
///
/// Every mismatch is named, on standard output; exit code 4 says that there are some.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The receipt.
    receipt: PathBuf,
    /// Public key of minisign that must have signed it: its file, or the key itself.
    #[arg(long, value_name = "KEY")]
    key: Option<OsString>,
    /// Also run again, and compare every byte of the output; takes the time and the disk of the run.
    #[arg(long)]
    again: bool,
    /// Print the outcome as JSON.
    #[arg(long)]
    json: bool,
    /// Memory to use [default: 75 % of what there is].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Threads to use [default: all cores].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Folder for temporary files [default: beside the output].
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
}

/// The outcome, as `--json` prints it.
#[derive(Debug, Default, serde::Serialize)]
struct Checked {
    /// True if nothing differs.
    verified: bool,
    /// Files whose hashes were compared.
    files: usize,
    /// True if a key was given and the signature is of it.
    signed: bool,
    /// The intervals that were proven again, one an output; empty where files differ.
    distances: Vec<ProvenInterval>,
    /// True if the run was done again.
    again: bool,
    /// Differences, by the keys of the receipt.
    mismatches: Vec<String>,
    /// Remarks.
    notes: Vec<String>,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        let key = self.key.as_ref().map(PathBuf::from).filter(|path| path.exists());
        Ok(Paths::default()
            .with(Role::InputFile, "RECEIPT", &self.receipt)
            .with_option(Role::InputFile, "--key", key.as_ref())
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref()))
    }

    fn offers(&self) -> Offers {
        Offers { resumes: false, temp_dir: true }
    }

    /// Losses are compared with those of the receipt.
    fn ignores_losses(&self) -> bool {
        true
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        super::arguments::warn_of_limit(self.memory, session.log);
        let means = (session.progress, session.line);
        let mut checked = session.watch(|| check(self, means))?;
        let progress = session.progress;
        progress.take_losses();
        checked.verified = checked.mismatches.is_empty();
        let text = if self.json { format!("{:#}\n", json(&checked)?) } else { lines(&checked) };
        session.print(&text)?;
        let code = if checked.verified { 0 } else { EXIT_MISMATCH };
        Ok(CommandEnd { code, ..CommandEnd::whole(&checked)? })
    }
}

/// The outcome for people.
fn lines(checked: &Checked) -> String {
    let mut text = String::new();
    let mut line = |words: String| text.push_str(&format!("{}\n", shown(&words)));
    checked.notes.iter().for_each(|note| line(format!("note: {note}")));
    for ProvenInterval { lower, upper, .. } in &checked.distances {
        let (lower, upper) = (show_outward(*lower, -1, 6), show_outward(*upper, 1, 6));
        line(format!("Hausdorff distance from {lower} to {upper}, proven again"));
    }
    checked.mismatches.iter().for_each(|mismatch| line(format!("mismatch: {mismatch}")));
    let again = if checked.again { ", run again to the same bytes" } else { "" };
    let signed = if checked.signed { ", signed by the key" } else { "" };
    line(match checked.mismatches.len() {
        0 => format!("verified: {} files as recorded{again}{signed}", checked.files),
        1 => "not verified: 1 mismatch".to_owned(),
        n => format!("not verified: {n} mismatches"),
    });
    text
}

/// Progress, and the whole command line.
type Means<'a> = (&'a Progress, fn() -> clap::Command);

fn check(args: &Args, means: Means) -> Result<Checked> {
    let (progress, line) = means;
    progress.begin("verify", 1, if args.again { 3 } else { 2 }, 0);
    let (receipt, bytes, mismatches) = Receipt::read(&args.receipt)?;
    let mut checked = Checked { mismatches, ..Checked::default() };
    check_signature(args, &bytes, &mut checked)?;
    let version = env!("CARGO_PKG_VERSION");
    if receipt.program.version != version {
        let made = &receipt.program.version;
        checked.notes.push(format!("made by stonecut {made}; this is {version}"));
    }
    let mut hashes = Hashes::beside(&args.receipt, progress)?;
    check_files(&receipt, &mut hashes, &mut checked)?;
    if !checked.mismatches.is_empty() {
        checked.notes.push("the distance was not proven again, since something differs".to_owned());
        return Ok(checked);
    }
    let place = |name: &str| hashes.place(name);
    match &receipt.tree {
        Some(tree) => {
            let (_, config) = tiles_settings(args, &receipt, line, place)?;
            check_tree((&receipt, tree), &config, &mut hashes, progress, &mut checked)?;
        }
        None => {
            let config = settings(args, &receipt, line, place)?;
            prove(&receipt, &config, &mut hashes, progress, &mut checked)?;
        }
    }
    if args.again && checked.mismatches.is_empty() {
        run_again(args, &receipt, &hashes, means, &mut checked)?;
    }
    Ok(checked)
}

/// Checks the signature, and says if there is one and no key.
fn check_signature(args: &Args, bytes: &[u8], checked: &mut Checked) -> Result<()> {
    let beside = signature::path_beside(&args.receipt);
    let Some(key) = &args.key else {
        if beside.exists() {
            checked.notes.push("signed; --key checks by whom".to_owned());
        }
        return Ok(());
    };
    let path = Path::new(key);
    let text = if path.exists() { read_text(path)? } else { key.to_string_lossy().into_owned() };
    let key = signature::public_key(&text)
        .map_err(|e| Error::Usage(format!("--key {}: {e}", path.display())))?;
    if !beside.exists() {
        checked.mismatches.push(format!("signature: {} is missing", beside.display()));
        return Ok(());
    }
    match signature::check(bytes, &read_text(&beside)?, &key) {
        Ok(()) => checked.signed = true,
        Err(what) => checked.mismatches.push(format!("signature: {what}")),
    }
    Ok(())
}

/// Compares the hashes of all files that the receipt names.
fn check_files(receipt: &Receipt, hashes: &mut Hashes, checked: &mut Checked) -> Result<()> {
    let of_input = [&receipt.input.files, &receipt.input.beside].map(|files| ("input", files));
    let of_outputs = receipt.outputs.iter().map(|output| ("output", &output.files));
    let of_tree = receipt.tree.iter().map(|tree| ("output", &tree.files));
    for (what, files) in of_input.into_iter().chain(of_outputs).chain(of_tree) {
        for (name, recorded) in files {
            checked.files += 1;
            let (_, found) = hashes.entry(&hashes.place(name))?;
            let at = format!("{what}: {name}");
            differences(&json(recorded)?, &json(&found)?, &at, &mut checked.mismatches);
        }
    }
    let folder = hashes.place(&receipt.output);
    if let Some(tree) = receipt.tree.as_ref().filter(|_| folder.is_dir()) {
        // Folders without a file that is recorded are not entered: a receipt cannot lead through the whole disk.
        let enters = |path: &Path| {
            hashes.name(path).is_ok_and(|name| {
                let within = format!("{name}/");
                let first = tree.files.range(within.clone()..).next();
                first.is_some_and(|(name, _)| name.starts_with(&within))
            })
        };
        for path in tree_receipt::files_below(&folder, &enters)? {
            let name = hashes.name(&path)?;
            if !tree.files.contains_key(&name) {
                let what = format!("output: {name}: nothing recorded, a file or folder found");
                checked.mismatches.push(what);
            }
        }
    }
    Ok(())
}

/// The settings of the run of a receipt, with the memory and threads of this one; `place` says where its paths lie.
fn settings(
    args: &Args,
    receipt: &Receipt,
    line: fn() -> clap::Command,
    place: impl Fn(&str) -> PathBuf,
) -> Result<Config> {
    let old = |e: &dyn std::fmt::Display| not_known(args, e);
    let found = typed_again(args, (receipt, "simplify"), line, place)?;
    let typed = simplify::Args::from_arg_matches(&found).map_err(|e| old(&e))?;
    let config = typed.config().map_err(|e| old(&e))?;
    Ok(Config {
        memory_bytes: memory_budget(args.memory),
        threads: super::arguments::threads(args.threads),
        ..config
    })
}

/// The same of a tree of tiles.
fn tiles_settings(
    args: &Args,
    receipt: &Receipt,
    line: fn() -> clap::Command,
    place: impl Fn(&str) -> PathBuf,
) -> Result<(tiles::Args, TilesConfig)> {
    let old = |e: &dyn std::fmt::Display| not_known(args, e);
    let found = typed_again(args, (receipt, "tiles"), line, place)?;
    let typed = tiles::Args::from_arg_matches(&found).map_err(|e| old(&e))?;
    let config = typed.config().map_err(|e| old(&e))?;
    let config = TilesConfig {
        memory_bytes: memory_budget(args.memory),
        threads: super::arguments::threads(args.threads),
        ..config
    };
    Ok((typed, config))
}

/// The error of a receipt whose options this version has not.
fn not_known(args: &Args, e: &dyn std::fmt::Display) -> Error {
    Error::bad_input(&args.receipt, format!("options: not of this version: {e}"))
}

/// The command of a receipt, with its options and paths.
fn typed_again(
    args: &Args,
    (receipt, command): (&Receipt, &str),
    line: fn() -> clap::Command,
    place: impl Fn(&str) -> PathBuf,
) -> Result<clap::ArgMatches> {
    if let Some(option) = receipt.options.iter().find(|option| !is_kept(option)) {
        let what = format!("options: '{option}' is not one that receipts have");
        return Err(Error::bad_input(&args.receipt, what));
    }
    let mut words: Vec<OsString> = vec!["stonecut".into(), command.into()];
    words.extend(receipt.options.iter().map(OsString::from));
    words.extend(args.temp_dir.iter().map(|dir| {
        let mut word = OsString::from("--temp-dir=");
        word.push(dir);
        word
    }));
    words.push("--".into());
    for given in &receipt.input.given {
        words.push(match given.strip_prefix('@') {
            Some(list) if !place(given).exists() => {
                let mut word = OsString::from("@");
                word.push(place(list));
                word
            }
            _ => place(given).into(),
        });
    }
    words.push(place(&receipt.output).into());
    let found = line().try_get_matches_from(&words);
    let found = found.map_err(|e| not_known(args, &super::arguments::usage(&e)))?;
    let own = found.subcommand_matches(command).cloned();
    own.ok_or_else(|| not_known(args, &"not of a run"))
}

/// Takes the receipt of a tree of the files again, and compares.
fn check_tree(
    (receipt, recorded): (&Receipt, &ReceiptTree),
    config: &TilesConfig,
    hashes: &mut Hashes,
    progress: &Progress,
    checked: &mut Checked,
) -> Result<()> {
    progress.begin("tiles", 2, 2, 0);
    let mut taken = tree_receipt::take(config, receipt.input.given.clone(), hashes, progress)?;
    // Compared before.
    taken.tree.files = recorded.files.clone();
    let out = &mut checked.mismatches;
    out.extend(taken.faults.iter().map(|fault| format!("tree: {fault}")));
    differences(&json(&receipt.outputs)?, &serde_json::json!([]), "outputs", out);
    differences(&json(&receipt.input)?, &json(&taken.input)?, "input", out);
    differences(&json(recorded)?, &json(&taken.tree)?, "tree", out);
    differences(&json(&receipt.coordinates)?, &json(&taken.coordinates)?, "coordinates", out);
    Ok(())
}

/// Takes the receipt of the files again, and compares.
fn prove(
    receipt: &Receipt,
    config: &Config,
    hashes: &mut Hashes,
    progress: &Progress,
    checked: &mut Checked,
) -> Result<()> {
    progress.begin("measure", 2, 2, 0);
    let tolerance = receipt.outputs.first().map_or(0.0, |output| output.distance.tolerance);
    if !(LEAST_TOLERANCE..1.0).contains(&tolerance) {
        let what = "outputs: distance: tolerance: not above 0 and below 1, nothing can be proven";
        checked.mismatches.push(what.to_owned());
        return Ok(());
    }
    let mut taken = take(config, receipt.input.given.clone(), tolerance, hashes, progress)?;
    for ((recorded, found), path) in
        receipt.outputs.iter().zip(&mut taken.outputs).zip(config.outputs())
    {
        let (recorded, found) = (&recorded.distance, &mut found.distance);
        let mut finer = tolerance;
        for _ in 0..MOST_FINER {
            if is_within(recorded, found) || !overlap(recorded, found) {
                break;
            }
            finer = (finer / 10.0).max(LEAST_TOLERANCE);
            let pair = MeasuredPair::open(config, path)?;
            *found = ProvenInterval { tolerance, ..enclose(&pair, config, finer, progress)?.0 };
        }
        checked.distances.push(found.clone());
        if is_within(recorded, found) {
            (found.lower, found.upper) = (recorded.lower, recorded.upper);
        }
    }
    let out = &mut checked.mismatches;
    differences(&json(&receipt.input)?, &json(&taken.input)?, "input", out);
    differences(&json(&receipt.outputs)?, &json(&taken.outputs)?, "outputs", out);
    differences(&json(&receipt.coordinates)?, &json(&taken.coordinates)?, "coordinates", out);
    Ok(())
}

/// Returns whether an interval proves another one.
fn is_within(recorded: &ProvenInterval, found: &ProvenInterval) -> bool {
    recorded.lower <= found.lower && found.upper <= recorded.upper
}

fn overlap(a: &ProvenInterval, b: &ProvenInterval) -> bool {
    a.lower <= b.upper && b.lower <= a.upper
}

/// Does the run again in a folder that goes afterwards, and compares what came out.
fn run_again(
    args: &Args,
    receipt: &Receipt,
    hashes: &Hashes,
    (progress, line): Means,
    checked: &mut Checked,
) -> Result<()> {
    let of_input = |name: &&String| {
        receipt.input.beside.contains_key(*name) || receipt.input.files.contains_key(*name)
    };
    if let Some(name) = receipt.outputs.iter().flat_map(|o| o.files.keys()).find(of_input) {
        return Err(Error::Usage(format!(
            "--again: the output names {name}, a file of the input, by the way from its own folder, so that no other folder gives \
             the same bytes; leave --again out"
        )));
    }
    let output = hashes.place(&receipt.output);
    let name = output.file_name().unwrap_or_default();
    let temp_dir = args.temp_dir.as_deref().unwrap_or(folder_of(&output));
    // Without the marks of a chain, which stand for its levels in the whole path.
    let folder = temp_dir.join(format!(".stonecut-again-{}", std::process::id()));
    if !Disk::default().own_dir(&folder)? {
        let what = format!("{}: is in the way of --again; remove it", folder.display());
        return Err(Error::Usage(what));
    }
    progress.owe(&folder);
    let place = |path: &str| match path == receipt.output {
        true => folder.join(name),
        false => hashes.place(path),
    };
    let compared = match &receipt.tree {
        Some(tree) => tiles_settings(args, receipt, line, place)
            .and_then(|typed| compare_trees((receipt, tree), typed, progress)),
        None => settings(args, receipt, line, place).and_then(|mut config| {
            if let Some(progressive) = &mut config.progressive {
                progressive.path = folder.join("progressive.pm");
            }
            compare_runs(receipt, &config, progress)
        }),
    };
    progress.settle(&folder);
    checked.again = true;
    checked.mismatches.extend(compared?);
    Ok(())
}

fn compare_trees(
    (receipt, tree): (&Receipt, &ReceiptTree),
    (typed, config): (tiles::Args, TilesConfig),
    progress: &Progress,
) -> Result<Vec<String>> {
    progress.take_losses();
    let (prepared, config, _) = typed.prepare(config)?;
    let report = make_tiles(prepared, &config, progress)?;
    let mut out = Vec::new();
    differences(&json(&receipt.settings)?, &json(&report.settings)?, "settings", &mut out);
    differences(&json(&receipt.losses)?, &json(&report.losses)?, "losses", &mut out);
    let outcome = tree_receipt::outcome_of(&report);
    differences(&json(&receipt.outcome)?, &json(&outcome)?, "outcome", &mut out);
    let mut made = std::collections::BTreeMap::new();
    for path in tree_receipt::files_below(&config.output, &|_| true)? {
        let name = path.strip_prefix(&config.output).unwrap_or(&path).display().to_string();
        made.insert(name, of_file(&path, progress)?);
    }
    let within = format!("{}/", receipt.output);
    let name = |name: &String| name.strip_prefix(&within).unwrap_or(name).to_owned();
    let recorded: std::collections::BTreeMap<_, _> =
        tree.files.iter().map(|(path, file)| (name(path), file)).collect();
    differences(&json(&recorded)?, &json(&made)?, "run again", &mut out);
    Ok(out)
}

fn compare_runs(receipt: &Receipt, config: &Config, progress: &Progress) -> Result<Vec<String>> {
    progress.take_losses();
    let report = run_job(prepare(config, progress)?, config, progress)?;
    let report = report.ok_or_else(|| Error::Internal("a whole run has no report".to_owned()))?;
    let mut out = Vec::new();
    differences(&json(&receipt.settings)?, &json(&report.settings)?, "settings", &mut out);
    differences(&json(&receipt.losses)?, &json(&report.losses)?, "losses", &mut out);
    let outcome = outcome_of(&report);
    differences(&json(&receipt.outcome)?, &json(&outcome)?, "outcome", &mut out);
    for (recorded, path) in receipt.outputs.iter().zip(config.outputs()) {
        let beside = folder_of(Path::new(&recorded.path)).to_path_buf();
        for (name, file) in &recorded.files {
            let name = Path::new(name);
            let name = name.strip_prefix(&beside).unwrap_or(name);
            let found = of_file(&folder_of(path).join(name), progress)?;
            let at = format!("run again: {}", name.display());
            differences(&json(file)?, &json(&found)?, &at, &mut out);
        }
    }
    Ok(out)
}
