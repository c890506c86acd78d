//! `stonecut status`: what a job folder holds.

use super::answer::CommandEnd;
use super::arguments::job_folder;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::pipeline::units::{Standing, standing};
use crate::store::job::units::UnitJob;
use crate::store::job::{has_manifest, look, view};
use crate::system::disk::{Disk, note_of};
use crate::system::json_keys::{SCHEMA_VERSION, add_old_names};
use crate::system::pace::MOST_DONE;
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::terminal::shown;
use crate::system::units::{show_bytes, show_count};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Shows what a job folder belongs to and which stages, or units of `plan`, are done.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The job folder: OUTPUT.stonecut-job by default, JOBDIR of `plan`; or OUTPUT.
    folder: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Show the job until it is over, or its run ends.
    #[arg(long)]
    follow: bool,
}

/// Time between two looks at a job that is followed.
const LOOK_EVERY: Duration = Duration::from_secs(1);

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        let folder = self.place()?;
        match folder.exists() {
            true => Ok(Paths::default().with(Role::InputFolder, "JOBDIR", &folder)),
            false => Ok(Paths::default()),
        }
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let args = Args { folder: self.place()?, ..*self };
        match UnitJob::is_in(&args.folder) || has_manifest(&args.folder) {
            true => show(&args, session.progress),
            false => show_finished(&args),
        }
        .map(|()| CommandEnd::plain())
    }
}

impl Args {
    /// The job folder, also where the output was typed.
    fn place(&self) -> Result<PathBuf> {
        if UnitJob::is_in(&self.folder) || has_manifest(&self.folder) {
            return Ok(self.folder.clone());
        }
        let is_output =
            |job: &PathBuf| job.is_dir() || self.folder.is_file() || stands(&self.folder);
        let of_output = job_folder(&self.folder, None).ok().filter(is_output);
        Ok(of_output.unwrap_or_else(|| self.folder.clone()))
    }
}

/// Returns whether the output of a job stands.
fn stands(output: &Path) -> bool {
    note_of(output).is_some() || output.join("tileset.json").is_file()
}

/// Prints that a job is over, whose folder went with its end.
///
/// Errors: `BadInput` where nothing says that there was one.
fn show_finished(args: &Args) -> Result<()> {
    let name = args.folder.to_string_lossy().into_owned();
    let output = name.strip_suffix(".stonecut-job").filter(|output| stands(Path::new(output)));
    let Some(output) = output else {
        let what = "there is no such job: simplify and tiles have OUTPUT.stonecut-job while they run and after they were \
                    stopped (with --temp-dir OUTPUT-HASH.stonecut-job there), and 'stonecut plan JOBDIR' makes one for many machines";
        return Err(Error::bad_input(&args.folder, what));
    };
    say(&match args.json {
        true => format!(
            "{:#}\n",
            serde_json::json!({
                "schema_version": SCHEMA_VERSION, "version": env!("CARGO_PKG_VERSION"),
                "is_running": false, "is_over": true, "output": output,
            })
        ),
        false => {
            format!("output  {}\nfinished; its job folder was removed at the end\n", shown(output))
        }
    })
}

/// A stage that is done, in words; `None` for what is only noted on the way.
fn in_words(stage: &str) -> Option<(u32, String)> {
    let (name, number) = stage.split_once(' ').unwrap_or((stage, ""));
    let (place, words) = match (name, number.parse::<u32>()) {
        ("partition", _) if number.is_empty() => (0, "input cut into cells"),
        ("components", _) => (1, "components found"),
        ("round", Ok(0)) => (2, "cells simplified"),
        ("round", Ok(n)) => return Some((2 + n, format!("cells simplified in round {n}"))),
        ("finish", _) => (u32::MAX - 1, "cells joined and brought to the target"),
        ("writing", _) => (u32::MAX, "result begun to be written"),
        _ => return None,
    };
    Some((place, words.to_owned()))
}

/// Prints the status on standard output.
fn show(args: &Args, progress: &Progress) -> Result<()> {
    if UnitJob::is_in(&args.folder) {
        return units(args, progress);
    }
    let state = view(&args.folder)?;
    let run = Running::of(&args.folder);
    if args.follow && run.is_running {
        return follow(args, run, progress);
    }
    let done: Vec<&String> = state.outcomes.keys().collect();
    let text = if args.json {
        let mut settings = state.identity.settings.clone();
        let mut marks = state.identity.input_marks.clone();
        add_old_names(&mut settings);
        add_old_names(&mut marks);
        let mut json = serde_json::json!({
            "schema_version": SCHEMA_VERSION,
            "version": env!("CARGO_PKG_VERSION"),
            "input": state.identity.input,
            "input_fingerprint": state.identity.input_marks,
            "input_marks": marks,
            "settings": settings,
            "stages_done": done,
            "outcomes": state.outcomes,
            "vertices": number(&state.identity.input_marks, "vertices"),
            "faces": number(&state.identity.input_marks, "faces"),
            "input_bytes": number(&state.identity.input_marks, "bytes"),
        });
        if let (Value::Object(all), Value::Object(own)) = (&mut json, run.facts()) {
            all.extend(own);
        }
        format!("{json:#}\n")
    } else {
        let mut text = format!("input   {}\n", shown(&state.identity.input));
        for (name, value) in &state.identity.settings {
            text += &format!("{:15} {}\n", shown(name), shown(&value.to_string()));
        }
        let mut words: Vec<_> = done.iter().filter_map(|name| in_words(name)).collect();
        words.sort();
        let words: Vec<String> = words.into_iter().map(|(_, words)| words).collect();
        text += &match words.as_slice() {
            [] => "done    nothing that lasts\n".to_owned(),
            words => format!("done    {}\n", words.join(", ")),
        };
        if let Some(output) = run.board["output"].as_str() {
            text += &format!("output  {output}\n");
        }
        let is_written = state.outcomes.contains_key("writing");
        let output =
            run.board["output"].as_str().filter(|output| is_written && stands(Path::new(output)));
        text += &match (run.is_running, output) {
            (true, _) => format!("running {}\n", run.line()),
            (false, Some(_)) => "finished; the job folder was kept\n".to_owned(),
            (false, None) => "stopped; continue by running the same command again\n".to_owned(),
        };
        text
    };
    say(&text)
}

fn number(marks: &BTreeMap<String, String>, name: &str) -> Option<u64> {
    marks.get(name)?.parse().ok()
}

/// The process that works on a job, or did last.
#[derive(PartialEq)]
struct Running {
    is_running: bool,
    host: Option<String>,
    process: Option<u64>,
    /// Progress that it has posted.
    board: Value,
}

impl Running {
    fn of(folder: &Path) -> Running {
        let (is_running, text) = look(folder).unwrap_or_default();
        let mut lines = text.lines();
        let (host, process) = lines.next().map_or((None, None), |line| {
            let host = line.strip_prefix("host ").and_then(|rest| rest.split(',').next());
            let process = line.rsplit_once("process ").and_then(|(_, id)| id.parse().ok());
            (host.map(str::to_owned), process)
        });
        // A line that is being written is read the next time.
        let board = lines.next().and_then(|line| serde_json::from_str(line).ok());
        Running { is_running, host, process, board: board.unwrap_or_default() }
    }

    /// Share of the expected seconds that is over.
    fn share(&self) -> Option<f64> {
        let count = |key: &str| self.board[key].as_u64();
        let (total, done) = (count("units")?, count("units_done")?);
        let stages: Vec<(String, f64)> =
            serde_json::from_value(self.board["expected"].clone()).ok()?;
        let own = done.min(total) as f64 / total.max(1) as f64;
        share_of(&stages, self.board["stage"].as_str()?, count("stage_number")?, own)
    }

    fn percent(&self) -> Option<f64> {
        self.share().map(|share| (1000.0 * share).round() / 10.0)
    }

    /// Seconds left of a run at work, if the rest goes as what is done.
    fn seconds_left(&self) -> Option<f64> {
        let (share, seconds) = (self.share()?, self.board["seconds"].as_f64()?);
        (self.is_running && share > 0.0).then(|| (seconds * (1.0 - share) / share).ceil())
    }

    /// The same as facts of JSON.
    fn facts(&self) -> Value {
        serde_json::json!({
            "is_running": self.is_running, "host": self.host, "process": self.process,
            "output": self.board["output"], "percent": self.percent(), "seconds_left": self.seconds_left(),
            "stage": self.board["stage"], "stage_number": self.board["stage_number"],
            "stages": self.board["stages"],
        })
    }

    fn line(&self) -> String {
        let mut process = self.process.map_or_else(String::new, |n| format!("process {n}"));
        if let Some(host) = &self.host {
            process += &format!(" on {}", shown(host));
        }
        let left = self.seconds_left().map_or_else(String::new, |left| format!("{left} s left  "));
        let (stage, of) = (&self.board["stage"], &self.board["stages"]);
        match (self.percent(), stage.as_str()) {
            (Some(percent), Some(stage)) => {
                format!(
                    "{percent:3.0} %  {stage} {}/{of}  {left}{process}",
                    self.board["stage_number"]
                )
            }
            _ => process,
        }
    }
}

/// Share of the expected seconds of `stages` that is over, where `own` of the stage of this name and number is done. Stages
/// that were planned may not have come.
fn share_of(stages: &[(String, f64)], name: &str, number: u64, own: f64) -> Option<f64> {
    let places = (0..stages.len()).filter(|&at| stages[at].0 == name);
    let at = places.min_by_key(|&at| (at as u64 + 1).abs_diff(number))?;
    let seconds = |stages: &[(String, f64)]| stages.iter().map(|(_, s)| s).sum::<f64>();
    let over = seconds(&stages[..at]) + own * stages[at].1;
    Some((over / seconds(stages).max(1e-9)).min(MOST_DONE))
}

/// Shows a run until it ends.
fn follow(args: &Args, mut run: Running, progress: &Progress) -> Result<()> {
    while run.is_running {
        say(&match args.json {
            true => {
                format!("{}\n", run.facts())
            }
            false => format!("{}\n", run.line()),
        })?;
        let last = run;
        loop {
            progress.check()?;
            std::thread::sleep(LOOK_EVERY);
            run = Running::of(&args.folder);
            if run != last {
                break;
            }
        }
    }
    let is_over = !args.folder.exists();
    say(&match (args.json, is_over) {
        (true, _) => {
            format!("{}\n", serde_json::json!({ "is_running": false, "is_over": is_over }))
        }
        (false, true) => "done\n".to_owned(),
        (false, false) => "stopped; continue by running the same command again\n".to_owned(),
    })
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
