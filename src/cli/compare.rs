//! `stonecut compare`: methods side by side on one page.
//!
//! Each method is a run of this program in a process by itself, so that its peak memory is its own.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory, require_ending, threads};
use super::log::Log;
use super::measure::parse_samples;
use super::method::MethodName;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::io::ply::Place;
use crate::render::Resources;
use crate::report::{Absent, Contender, comparison_html, hold, hold_pictures};
use crate::store::job::is_in_job;
use crate::system::disk::{Disk, folder_of, is_empty, open_input, read_own};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::{parse_count, parse_ratio};
use clap::ValueEnum;
use serde_json::Value;
use std::ffi::OsString;
use std::io::Read;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{self, Stdio};
use std::time::Duration;

/// Time between two looks at a run and at the wish to stop.
const LOOK: Duration = Duration::from_millis(50);

/// Simplifies a mesh by several methods to one count, and sets them side by side on one self-contained HTML page: pictures,
/// error, time, memory, angles, topology.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Methods joined by commas: collapse,cluster,decimate,retile.
    #[arg(value_enum, value_name = "METHOD,...", value_delimiter = ',', required = true)]
    methods: Vec<MethodName>,
    /// The mesh to simplify.
    input: PathBuf,
    /// Triangles wanted, at most: 20000, 500k, 4M.
    #[arg(long, value_name = "N", value_parser = parse_count, required_unless_present = "ratio")]
    triangles: Option<u64>,
    /// Share of the input's triangles: 1% or 0.01.
    #[arg(long, value_name = "R", value_parser = parse_ratio, conflicts_with = "triangles")]
    ratio: Option<f64>,
    /// File that the page is written to.
    #[arg(short, long, value_name = "FILE.html")]
    output: PathBuf,
    /// Samples on each surface for the distances.
    #[arg(long, value_name = "N", value_parser = parse_samples, default_value = "1M")]
    samples: u64,
    /// Replace the page if it exists.
    #[arg(long)]
    force: bool,
    /// Memory budget of each run [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Threads of each run [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        require_ending("--output", &self.output, &["html", "htm"])?;
        Ok(Paths::new(self.force)
            .with(Role::InputFile, "INPUT", &self.input)
            .with(Role::Output, "--output", &self.output)
            .with(Role::JobFolder, "the folder of the results", self.folder()))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        make(self, session.progress, session.log).map(|()| CommandEnd::plain())
    }
}

impl Args {
    /// Memory and threads for the page.
    fn resources(&self) -> Resources {
        let threads = threads(self.threads).get();
        Resources { memory_bytes: memory_budget(self.memory), threads }
    }

    /// The folder of the results while they are needed.
    fn folder(&self) -> PathBuf {
        let mut name = self.output.file_name().unwrap_or_default().to_owned();
        name.push(".stonecut-compare");
        folder_of(&self.output).join(name)
    }
}

/// Makes the page.
fn make(args: &Args, progress: &Progress, log: &mut Log) -> Result<()> {
    let pictures = args.resources();
    // The page would fail over its pictures after all the work.
    let of_images = super::arguments::open_mesh(&args.input, folder_of(&args.output), args.memory)
        .and_then(|source| hold_pictures([&source], pictures));
    Error::first_of([hold(pictures), of_images])?;
    let folder = args.folder();
    let disk = Disk::default();
    if !disk.own_dir(&folder)? && !is_empty(&folder) {
        // Of a run that was killed: it has left its mark.
        if read_own(&folder.join(MARK), 0).is_err() {
            return Err(Error::Usage(format!(
                "{} is there, and not of an earlier run of stonecut; move it elsewhere, or name another page",
                folder.display()
            )));
        }
        remove(&folder, &disk)?;
        disk.own_dir(&folder)?;
    }
    disk.create(&folder.join(MARK))?;
    let page = page(args, &folder, progress, log);
    // Results can be made again: they go whatever happened.
    let _ = remove(&folder, &disk);
    let page = page?;
    let place = Place { replace: args.force, ..Place::from(&args.output) };
    crate::system::pending_file::write_whole(place, page.as_bytes())?;
    log.say(format!("{}: {} bytes", args.output.display(), page.len()));
    Ok(())
}

/// Empty file that tells a folder of results from a folder of others.
const MARK: &str = ".stonecut-compare";

/// Removes the folder of the results, but not what others have put there.
fn remove(folder: &Path, disk: &Disk) -> Result<()> {
    disk.remove_own(folder, &is_result, &|path| u8::from(path == Path::new(MARK)))
}

/// Returns whether a path in the folder is that of a result, of its job, or of a measurement.
fn is_result(path: &Path, is_folder: bool) -> bool {
    let Some(first) = path.iter().next().and_then(|part| part.to_str()) else { return false };
    let is_mesh = |name: &str| {
        let method = name.trim_start_matches('.').split(['.', '-']).next().unwrap_or_default();
        MethodName::value_variants().iter().any(|known| known.name() == method)
    };
    let below: PathBuf = path.iter().skip(1).collect();
    match below.as_os_str().is_empty() {
        true if is_folder => {
            is_mesh(first) && first.ends_with(".stonecut-job") || is_in_job(path, true)
        }
        true => first == MARK || is_mesh(first),
        false if first.ends_with(".stonecut-job") => is_mesh(first) && is_in_job(&below, is_folder),
        false => is_in_job(path, is_folder),
    }
}

fn page(args: &Args, folder: &Path, progress: &Progress, log: &mut Log) -> Result<String> {
    let mut contenders: Vec<Contender> = Vec::new();
    let mut absent: Vec<Absent> = Vec::new();
    let mut first_refusal = None;
    for (at, method) in args.methods.iter().enumerate() {
        if args.methods[..at].contains(method) {
            continue;
        }
        let name = method.name().to_owned();
        match contender(args, *method, folder, progress) {
            Ok(Contender { name, mesh, run, measured }) => {
                log.say(format!(
                    "{name}: {} triangles in {:.1} s, RMS {:.4e}",
                    run["output"]["triangles"],
                    run["seconds"].as_f64().unwrap_or(0.0),
                    measured["rms"].as_f64().unwrap_or(0.0)
                ));
                contenders.push(Contender { name, mesh, run, measured });
            }
            // What a method cannot do is a finding about it, not the end of the page.
            Err(refusal @ (Error::Usage(_) | Error::BadInput { .. } | Error::NoMemory(_))) => {
                log.say(format!("no result. {refusal}"));
                absent.push(Absent { name, reason: refusal.to_string() });
                first_refusal.get_or_insert(refusal);
            }
            Err(other) => return Err(other),
        }
    }
    if let (true, Some(refusal)) = (contenders.is_empty(), first_refusal) {
        return Err(refusal);
    }
    comparison_html(&args.input, (&contenders, &absent), folder, args.resources(), progress)
}

/// The words for memory and threads.
fn resources(args: &Args) -> Vec<OsString> {
    let memory = args.memory.map(|bytes| format!("--memory={bytes}"));
    let threads = args.threads.map(|n| format!("--threads={n}"));
    memory.into_iter().chain(threads).map(OsString::from).collect()
}

/// Runs `simplify` and `measure`; a target that is not met is shown on the page.
fn contender(
    args: &Args,
    method: MethodName,
    folder: &Path,
    progress: &Progress,
) -> Result<Contender> {
    let name = method.name().to_owned();
    let mesh = folder.join(format!("{name}.ply"));
    let report = folder.join(format!("{name}.json"));
    let target = match (args.triangles, args.ratio) {
        (_, Some(ratio)) => format!("--ratio={ratio}"),
        (count, None) => format!("--triangles={}", count.unwrap_or(1)),
    };
    let mut words: Vec<OsString> = vec!["simplify".into(), args.input.clone().into()];
    words.extend([mesh.clone().into(), target.into(), "--report".into(), report.clone().into()]);
    // Other methods give texture and faces up anyway, and the page is about shapes.
    let others = ["--method", &name, "--force", "--drop-texture", "--drop-faces"];
    words.extend(others.map(OsString::from));
    let what = format!("--method {name}");
    let said = run_apart(args, &what, words, progress)?;
    if !report.exists() {
        return Err(Error::bad_input(&args.input, said));
    }
    let measurement = folder.join(format!("{name}-measured.json"));
    let words = ["measure".into(), args.input.clone().into(), mesh.clone().into()];
    let samples = [format!("--samples={}", args.samples).into(), "--report".into()];
    let words = words.into_iter().chain(samples).chain([measurement.clone().into()]).collect();
    run_apart(args, &format!("{what}, its result measured"), words, progress)?;
    Ok(Contender { name, mesh, run: read(&report)?, measured: read(&measurement)? })
}

/// Runs this program in a process by itself, for `what`. Returns what it said.
fn run_apart(args: &Args, what: &str, words: Vec<OsString>, progress: &Progress) -> Result<String> {
    let program = std::env::current_exe()
        .map_err(|e| Error::Internal(format!("this program cannot find itself: {e}")))?;
    let failed = |e| Error::io(&program, "cannot run", e);
    let mut child = process::Command::new(&program)
        .args(words)
        .args(resources(args))
        .arg("--quiet")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    let status = loop {
        if let Err(stopped) = progress.check() {
            let _ = child.kill();
            let _ = child.wait();
            return Err(stopped);
        }
        match child.try_wait().map_err(failed)? {
            Some(status) => break status,
            None => std::thread::sleep(LOOK),
        }
    };
    let mut said = String::new();
    if let Some(mut pipe) = child.stderr.take() {
        let _ = pipe.read_to_string(&mut said);
    }
    let said = format!("{what}: {}", said.trim().trim_start_matches("stonecut: "));
    match status.code() {
        Some(0 | 3) => Ok(said),
        Some(2) => Err(Error::Usage(said)),
        Some(4) => Err(Error::bad_input(&args.input, said)),
        Some(6) => Err(Error::NoMemory(said)),
        _ => Err(Error::Internal(format!("{said} ({status})"))),
    }
}

fn read(path: &Path) -> Result<Value> {
    let mut text = String::new();
    let unreadable =
        |e: &dyn std::fmt::Display| Error::bad_input(path, format!("not a JSON report: {e}"));
    open_input(path)?.read_to_string(&mut text).map_err(|e| unreadable(&e))?;
    serde_json::from_str(&text).map_err(|e| unreadable(&e))
}
