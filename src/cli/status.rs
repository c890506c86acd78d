//! `stonecut status`: what a job folder holds.

use super::terminal::shown;
use crate::error::{Error, Result};
use crate::pipeline::units::{Standing, standing};
use crate::store::job::units::UnitJob;
use crate::store::job::view;
use crate::system::disk::Disk;
use crate::system::json_keys::{SCHEMA_VERSION, add_old_names};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::{show_bytes, show_count};
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::Duration;

/// Shows what a job folder belongs to and which stages, or units of `plan`, are done.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The job folder: OUTPUT.stonecut-job by default, JOBDIR of `plan`.
    folder: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Show a job of `plan` until it is over.
    #[arg(long)]
    follow: bool,
}

/// Time between two looks at a job that is followed.
const LOOK_EVERY: Duration = Duration::from_secs(1);

impl Args {
    pub(super) fn paths(&self) -> Paths {
        Paths::default().with(Role::InputFolder, "JOBDIR", &self.folder)
    }
}

/// Prints the status on standard output.
pub fn run(args: &Args, progress: &Progress) -> Result<()> {
    if UnitJob::is_in(&args.folder) {
        return units(args, progress);
    }
    if args.follow {
        let folder = args.folder.display();
        return Err(Error::Usage(format!("--follow: {folder} is not a job of 'stonecut plan'")));
    }
    let state = view(&args.folder)?;
    let done: Vec<&String> = state.outcomes.keys().collect();
    let text = if args.json {
        let mut settings = state.identity.settings.clone();
        let mut marks = state.identity.input_marks.clone();
        add_old_names(&mut settings);
        add_old_names(&mut marks);
        let json = serde_json::json!({
            "schema_version": SCHEMA_VERSION,
            "version": env!("CARGO_PKG_VERSION"),
            "input": state.identity.input,
            "input_fingerprint": state.identity.input_marks,
            "input_marks": marks,
            "settings": settings,
            "stages_done": done,
            "outcomes": state.outcomes,
        });
        format!("{json:#}\n")
    } else {
        let mut text = format!("input   {}\n", shown(&state.identity.input));
        for (name, value) in &state.identity.settings {
            text += &format!("{:15} {}\n", shown(name), shown(&value.to_string()));
        }
        text += &match done.as_slice() {
            [] => "done    nothing yet\n".to_owned(),
            names => {
                let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
                format!("done    {}\n", shown(&names.join(", ")))
            }
        };
        text + "continue by running the same command again\n"
    };
    say(&text)
}

fn say(text: &str) -> Result<()> {
    let mut out = std::io::stdout();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(Error::stdout)
}

/// Prints the standing of a job in units, once or until it is over.
fn units(args: &Args, progress: &Progress) -> Result<()> {
    let job = UnitJob::new(&args.folder, &Disk::default(), Duration::ZERO);
    let mut known = BTreeMap::new();
    let mut last = None;
    loop {
        let now = standing(&job, &mut known, progress)?;
        let json = || serde_json::to_value(&now).expect("plain data");
        if !args.follow {
            return say(&if args.json { format!("{:#}\n", json()) } else { table(&now) });
        }
        if last.as_ref() != Some(&now) {
            let is_last = now.is_over;
            say(&match (args.json, std::io::stdout().is_terminal()) {
                (true, _) => format!("{}\n", json()),
                (false, true) if !is_last => format!("\r\x1b[K{}", line(&now)),
                (false, true) => format!("\r\x1b[K{}", table(&now)),
                (false, false) => format!("{}\n", line(&now)),
            })?;
        }
        if now.is_over {
            return Ok(());
        }
        last = Some(now);
        progress.check()?;
        std::thread::sleep(LOOK_EVERY);
    }
}

/// One line: the share that is done and the phase at work.
fn line(now: &Standing) -> String {
    let at_work = now.phases.iter().find(|phase| phase.done < phase.units);
    let place = at_work.map_or_else(
        || "done".to_owned(),
        |phase| format!("{} {}/{}", phase.name, phase.done, phase.units),
    );
    format!("{:3.0} %  {place}  {:.0} s", 100.0 * now.share, now.seconds)
}

/// A table of the phases.
fn table(now: &Standing) -> String {
    let mut text =
        format!("input   {}, {} triangles\n", shown(&now.input), show_count(now.triangles));
    for phase in &now.phases {
        text += &format!("{:10} {:5} of {:5} units", phase.name, phase.done, phase.units);
        if phase.done > 0 {
            text += &format!(
                "  {:8.1} s, {:8.1} s of processors, {} read, {} written, peak {}",
                phase.seconds,
                phase.processor_seconds,
                show_bytes(phase.bytes_read),
                show_bytes(phase.bytes_written),
                show_bytes(phase.peak_memory_bytes)
            );
        }
        text.push('\n');
    }
    text += &format!("{}\n", line(now));
    if let Some(reason) = now.report.as_ref().and_then(|report| report["stop_reason"].as_str()) {
        text += &format!("output stands: {}\n", shown(reason));
    }
    text
}
