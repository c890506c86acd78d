//! `stonecut report`: a page for people from the JSON of a run.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory, require_ending, threads};
use super::log::Log;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::io::ply::Place;
use crate::pipeline::refine::{Shown, show};
use crate::render::Resources;
use crate::report::{self, Material, Slider};
use crate::system::disk::{folder_of, open_input, read_regular};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::{memory_word, show_bytes};
use serde_json::Value;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Makes one self-contained HTML page from the JSON of `simplify --report` or `measure --report`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The JSON of the run.
    report: PathBuf,
    /// File that the page is written to.
    #[arg(short, long, value_name = "FILE.html")]
    output: PathBuf,
    /// The JSON of `measure --report`, to show the error of a simplification.
    #[arg(long, value_name = "FILE.json")]
    measured: Option<PathBuf>,
    /// The progressive mesh of the run (`simplify --progressive`): the page shows it in place of the result, with a slider over
    /// its triangles.
    #[arg(long, value_name = "FILE.pm")]
    progressive: Option<PathBuf>,
    /// Replace the page if it exists.
    #[arg(long)]
    force: bool,
    /// Memory for the pictures [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Threads to use [default: all cores].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        require_ending("--output", &self.output, &["html", "htm"])?;
        Ok(Paths::new(self.force)
            .with(Role::InputFile, "REPORT", &self.report)
            .with_option(Role::InputFile, "--measured", self.measured.as_ref())
            .with_option(Role::InputFile, "--progressive", self.progressive.as_ref())
            .with(Role::Output, "--output", &self.output))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        write_page(self, session.progress, session.log).map(|()| CommandEnd::plain())
    }
}

fn write_page(args: &Args, progress: &Progress, log: &mut Log) -> Result<()> {
    let memory_bytes = memory_budget(args.memory);
    let resources = Resources { memory_bytes, threads: threads(args.threads).get() };
    let progressive = match &args.progressive {
        Some(path) => {
            let shown = show(path, memory_bytes, progress);
            let Shown { triangles, slides } = shown.map_err(|e| or_of_pictures(e, resources))?;
            Some(Slider { triangles, slides })
        }
        None => None,
    };
    let material = Material {
        progressive,
        report: read(&args.report, memory_bytes).map_err(|e| or_of_pictures(e, resources))?,
        measured: args.measured.as_deref().map(|path| read(path, memory_bytes)).transpose()?,
        temp_dir: folder_of(&args.output).to_path_buf(),
        resources,
    };
    let page = report::html(&material, progress)?;
    let place = Place { replace: args.force, ..Place::from(&args.output) };
    crate::system::pending_file::write_whole(place, page.as_bytes())?;
    log.say(format!("{}: {} bytes", args.output.display(), page.len()));
    Ok(())
}

/// The same error, or the one of the pictures where these want more memory.
fn or_of_pictures(error: Error, resources: Resources) -> Error {
    Error::first_of([Err(error), report::hold(resources)]).expect_err("the first is an error")
}

/// Bytes of an object of JSON in memory, and of any other value with its key and its share of a list, at most.
const OBJECT_BYTES: u64 = 704;
const VALUE_BYTES: u64 = 160;

/// The share of the memory that a report may take.
const SHARE: u64 = 4;

/// Reads a report whose JSON takes at most a share of the memory.
fn read(path: &Path, memory_bytes: u64) -> Result<Value> {
    let bad = |e: std::io::Error| Error::bad_input(path, format!("not a JSON report: {e}"));
    let too_large = |needed: u64| {
        Error::NoMemory(format!(
            "{}: as a report it takes up to {} of memory, a {SHARE}th of the budget of {} is for it: give --memory {}",
            path.display(),
            show_bytes(needed),
            show_bytes(memory_bytes),
            memory_word(SHARE * needed)
        ))
    };
    let most = memory_bytes / SHARE;
    let n_bytes = open_input(path)?.metadata().map_err(bad)?.len();
    if n_bytes > most {
        // What its values come to is not known before it is read.
        return Err(too_large(n_bytes.saturating_mul(16)));
    }
    let text = read_regular(path, most).map_err(bad)?;
    let count = |marks: &[u8]| text.iter().filter(|byte| marks.contains(byte)).count() as u64;
    let needed = n_bytes + OBJECT_BYTES * count(b"{") + VALUE_BYTES * count(b",[");
    if needed > most {
        return Err(too_large(needed));
    }
    let report: Value = serde_json::from_slice(&text).map_err(|e| {
        let what = match e.is_eof() {
            true => "not a report: its JSON is cut off, is the run still going on? Give".to_owned(),
            false => format!("not a report: no JSON (line {}); give", e.line()),
        };
        Error::bad_input(path, format!("{what} what simplify or measure wrote with --report"))
    })?;
    let is_report = ["input", "original"].iter().any(|key| report.get(key).is_some());
    match is_report {
        true => Ok(report),
        false => Err(Error::bad_input(
            path,
            "not a report: it names neither an input nor an original; give what simplify or measure wrote with --report",
        )),
    }
}
