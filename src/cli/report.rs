//! `stonecut report`: a page for people from the JSON of a run.

use super::{Log, memory_budget, parse_memory};
use crate::error::{Error, Result};
use crate::plan::folder_of;
use crate::progress::Progress;
use crate::render::Resources;
use crate::report::{self, Material};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Makes one self-contained HTML page from the JSON of `simplify --report` or `measure --report`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The JSON of the run.
    report: PathBuf,
    /// Where the page appears.
    #[arg(short, long, value_name = "FILE.html")]
    output: PathBuf,
    /// The JSON of `measure --report`, to show the error of a simplification.
    #[arg(long, value_name = "FILE.json")]
    measured: Option<PathBuf>,
    /// Replace the page if it exists.
    #[arg(long)]
    force: bool,
    /// Memory for the pictures [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Threads to use [default: all cores].
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Writes the page.
pub fn run(args: &Args, progress: &Progress, log: &mut Log) -> Result<()> {
    if args.output.exists() && !args.force {
        let what = format!("{} exists; --force replaces it", args.output.display());
        return Err(Error::Usage(what));
    }
    let material = Material {
        report: read(&args.report)?,
        measured: args.measured.as_deref().map(read).transpose()?,
        temp_dir: folder_of(&args.output).to_path_buf(),
        resources: Resources {
            memory_bytes: memory_budget(args.memory),
            threads: args.threads.unwrap_or_else(crate::memory::cores).max(1),
        },
    };
    let page = report::html(&material, progress)?;
    crate::disk::Disk::default().write_whole(&args.output, page.as_bytes())?;
    log.say(format!("{}: {} bytes", args.output.display(), page.len()));
    Ok(())
}

fn read(path: &Path) -> Result<Value> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, "cannot read", e))?;
    serde_json::from_str(&text).map_err(|e| Error::bad_input(path, format!("no JSON report: {e}")))
}
