//! `stonecut work`: one unit of a job for many machines.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::outcome::{close, tell, write_report};
use super::plan;
use super::session::{Command, Session};
use crate::config::Config;
use crate::error::{Error, Offers, Result};
use crate::pipeline::units::{Done as Work, Task, work};
use crate::store::job::units::{Frozen, Unit, UnitJob};
use crate::system::disk::Disk;
use crate::system::paths::{Paths, Role};
use crate::system::pending_file::Seen;
use crate::system::program::end_with_parent;
use crate::system::progress::Progress;
use clap::FromArgMatches;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Does one unit of a job that `stonecut plan` has made.
///
/// Any number of times, on any machine, also at once: the first to end counts, and all give the same bytes. Exits with 0
/// if the unit is done, whoever did it.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder of the job.
    folder: PathBuf,
    /// The unit: PHASE/INDEX, as simplify/17.
    unit: Unit,
    /// Memory budget of this worker, everything included [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Worker threads [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// End at once when the process that started this one ends.
    #[arg(long)]
    with_parent: bool,
    /// Exit codes, joined by commas, after which the unit is tried again, three times at most: 5,10.
    #[arg(long, value_name = "CODES", value_delimiter = ',')]
    retry: Vec<u8>,
    /// Seconds before the first of these; each further pause is three times as long.
    #[arg(long, value_name = "SECONDS", default_value_t = 10)]
    retry_after: u64,
    /// Seconds during which files of earlier phases are looked for again: file systems of networks show them late.
    #[arg(long, value_name = "SECONDS", default_value_t = 90)]
    wait: u64,
    /// Check the files of a unit that is done, and do it again if they are damaged.
    #[arg(long)]
    mend: bool,
}

/// A unit that fails is tried this often again.
const RETRIES: u32 = 3;

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        Ok(Paths::default().with(Role::InputFolder, "JOBDIR", &self.folder))
    }

    fn offers(&self) -> Offers {
        Offers { resumes: true, temp_dir: false }
    }

    /// Scripts wait for the unit, whatever its mesh has lost.
    fn ignores_losses(&self) -> bool {
        true
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        work_on(self, session).map(|()| CommandEnd::plain())
    }
}

/// Does the unit, again after failures that may pass, and says so.
fn work_on(args: &Args, session: &mut Session) -> Result<()> {
    if args.with_parent {
        end_with_parent()?;
    }
    let mut pause = Duration::from_secs(args.retry_after);
    let mut retries = 0;
    loop {
        match attempt(args, session) {
            Err(error) if retries < RETRIES && args.retry.contains(&error.exit_code()) => {
                retries += 1;
                session.log.say(format!(
                    "{error}; once more in {} s ({retries} of {RETRIES})",
                    pause.as_secs()
                ));
                sleep(pause, session.progress)?;
                pause *= 3;
            }
            outcome => return outcome,
        }
    }
}

fn sleep(pause: Duration, progress: &Progress) -> Result<()> {
    let start = Instant::now();
    while start.elapsed() < pause {
        progress.check()?;
        std::thread::sleep(Duration::from_millis(100).min(pause));
    }
    Ok(())
}

fn attempt(args: &Args, session: &mut Session) -> Result<()> {
    let progress = session.progress;
    let (disk, patience) = (Disk::default(), Duration::from_secs(args.wait));
    let job = UnitJob::new(&args.folder, &disk, patience);
    job.check_own()?;
    let frozen = session.watch(|| job.frozen(progress))?;
    let (config, report) = settings(args, &frozen, session.line)?;
    let task = Task {
        folder: &args.folder,
        frozen: &frozen,
        unit: &args.unit,
        patience,
        mends: args.mend,
    };
    match session.watch(|| work(&task, &config, &disk, progress))? {
        Work::Before => session.log.say(format!("{}: done before", args.unit)),
        Work::Now(None) => session.log.say(format!("{}: done", args.unit)),
        Work::Now(Some(mut done)) => {
            close(&mut done, &config, progress);
            tell(&done, session.talk, session.log);
            if report.is_some() {
                let to =
                    frozen.report.clone().filter(|seen| Some(seen.path()) == report.as_deref());
                let to = to.or_else(|| report.as_deref().map(Seen::absent));
                to.iter().try_for_each(|to| write_report(to, &done))?;
            }
        }
    }
    Ok(())
}

/// The settings of the plan, with the memory and threads of this worker; and the file for the report.
fn settings(
    args: &Args,
    frozen: &Frozen,
    line: fn() -> clap::Command,
) -> Result<(Config, Option<PathBuf>)> {
    let found = line().try_get_matches_from(&frozen.words).ok();
    let plan = found.as_ref().and_then(|found| found.subcommand_matches("plan"));
    let plan = plan.and_then(|plan| plan::Args::from_arg_matches(plan).ok());
    let plan = plan.ok_or_else(|| Error::StateMismatch {
        path: args.folder.clone(),
        what: "the command in its plan is not one of this version".to_owned(),
    })?;
    // The record may have been edited, and the disk has changed since.
    plan.paths_of_work(&args.folder, &frozen.folder)?.check()?;
    let config = plan.config(&args.folder, &frozen.folder)?;
    let config = Config {
        memory_bytes: memory_budget(args.memory),
        threads: super::arguments::threads(args.threads),
        ..config
    };
    Ok((config, plan.report(&frozen.folder)))
}
