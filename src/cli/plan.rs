//! `stonecut plan`: a job for many machines, decided and written down; the graph of its units for whoever starts them.

use super::answer::CommandEnd;
use super::session::{Command, Session};
use super::simplify;
use crate::config::{Config, Level, Texture};
use crate::error::{Error, Result};
use crate::pipeline::units::{MOST_UNITS, Pieces, freeze_with};
use crate::store::job::units::{Frozen, Phase, UnitJob};
use crate::system::disk::Disk;
use crate::system::paths::Paths;
use crate::system::pending_file::Seen;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Plans a job for many machines and prints its units as JSON; nothing is simplified yet.
///
/// All machines see JOBDIR, INPUT and the folder of OUTPUT under the same paths. Each unit is one command, `stonecut work
/// JOBDIR PHASE/INDEX`; units of one phase may run at once. The same command given again prints the same plan.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder of the job; made where it is missing.
    folder: PathBuf,
    #[command(flatten)]
    simplify: simplify::Args,
    /// Pieces to cut the work into; about as many as there are machines.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_UNITS)))]
    units: u32,
    /// Parts of the partition, each a unit in three of its phases [default: one for 16 M triangles, at most --units].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_UNITS)))]
    parts: Option<u32>,
    /// Print a script for Slurm instead, with these options for every sbatch: '-p compute -c 32 --mem 60G'.
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    slurm: Option<String>,
    /// The words that were typed.
    #[arg(skip)]
    pub(super) words: Vec<String>,
}

/// The most elements of a job array of Slurm, unless it was set up otherwise (`MaxArraySize`).
const ARRAY: u32 = 1000;

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        self.simplify.paths_in(&self.job().units_folder())
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        if self.simplify.is_plan_only() || self.simplify.has_temp_dir() {
            let what =
                "--dry-run and --temp-dir are not for a job in units; JOBDIR says where it lies";
            return Err(Error::Usage(what.to_owned()));
        }
        if let Some(option) = self.simplify.receipt.given() {
            let what = format!("{option} is not for a job in units; run 'stonecut simplify'");
            return Err(Error::Usage(what));
        }
        if let Some(option) = self.simplify.page_option() {
            return Err(Error::Usage(format!(
                "{option} is for a new texture, which a job in units does not make; run 'stonecut simplify' on one machine"
            )));
        }
        let here = std::env::current_dir().map_err(|e| Error::reading(".", "cannot find", e))?;
        let folder = std::path::absolute(&self.folder).unwrap_or_else(|_| self.folder.clone());
        let config = self.config(&folder, &here)?;
        let pieces = Pieces { units: self.units, parts: self.parts };
        let report = self.report(&here).as_deref().map(Seen::new);
        let said = ((self.words.clone(), here), report);
        let frozen = freeze_with(&folder, said, &config, pieces, &Disk::default())?;
        for phase in &frozen.phases {
            session.log.say(format!("{:10} {} units", phase.name, phase.units));
        }
        let text = match &self.slurm {
            Some(options) => slurm(&folder, &frozen, options),
            None => graph(&folder, &frozen),
        };
        std::io::stdout().write_all(text.as_bytes()).map_err(Error::stdout)?;
        Ok(CommandEnd::plain())
    }
}

impl Args {
    /// The paths as `work` has them: those that were typed in `folder`, and the folder of the job.
    pub(super) fn paths_of_work(&self, job_folder: &Path, folder: &Path) -> Result<Paths> {
        let units = UnitJob::new(job_folder, &Disk::default(), Duration::ZERO).units_folder();
        let units = std::path::absolute(&units).unwrap_or(units);
        let mut simplify = self.simplify.clone();
        simplify.paths.input = simplify.paths.input.typed_in(folder);
        simplify.paths_in(&units).map(|paths| paths.typed_in(folder))
    }

    fn job(&self) -> UnitJob {
        UnitJob::new(&self.folder, &Disk::default(), Duration::ZERO)
    }

    /// The settings; paths as they were typed in `folder`.
    pub(super) fn config(&self, job_folder: &Path, folder: &Path) -> Result<Config> {
        let config = self.simplify.config()?;
        let here = |level: &Level| Level { output: folder.join(&level.output), ..level.clone() };
        let levels = config.coarser.iter().map(here).collect();
        Ok(Config {
            // A new texture is not for a job in units.
            texture: match config.texture {
                Texture::Auto => Texture::Keep,
                other => other,
            },
            input: config.input.typed_in(folder),
            output: if_not_stream(folder, &config.output),
            textures_beside: folder.join(&config.textures_beside),
            coarser: levels,
            job_folder: UnitJob::new(job_folder, &Disk::default(), Duration::ZERO).units_folder(),
            ..config
        })
    }

    /// The file for the report, if one was asked for.
    pub(super) fn report(&self, folder: &Path) -> Option<PathBuf> {
        self.simplify.report.as_ref().map(|path| folder.join(path))
    }
}

fn if_not_stream(folder: &Path, path: &Path) -> PathBuf {
    if path == Path::new("-") { path.to_path_buf() } else { folder.join(path) }
}

fn graph(folder: &Path, frozen: &Frozen) -> String {
    let json = serde_json::json!({
        "format": 1, "version": frozen.version, "job": folder, "triangles": frozen.triangles,
        "phases": frozen.phases,
    });
    format!("{json:#}\n")
}

/// A chain of job arrays, each of which waits for the one before.
fn slurm(folder: &Path, frozen: &Frozen, options: &str) -> String {
    let program = std::env::current_exe().unwrap_or_else(|_| "stonecut".into());
    let words = [program.as_path(), Path::new("work"), folder].map(quoted).join(" ");
    let mut text = "#!/bin/sh\nset -e\nAFTER=\n".to_owned();
    for Phase { name, units, .. } in &frozen.phases {
        text += "JOBS=\n";
        for first in (0..*units).step_by(ARRAY as usize) {
            let last = (units - first).min(ARRAY) - 1;
            let wrapped =
                format!("exec {words} {name}/$((SLURM_ARRAY_TASK_ID + {first})) --retry 5,10");
            text += &format!(
                "JOBS=$JOBS:$(sbatch --parsable --requeue --kill-on-invalid-dep=yes $AFTER {options} \
                 -J stonecut-{name} -a 0-{last} --wrap {})\n",
                quoted(Path::new(&wrapped))
            );
        }
        text += "AFTER=\"-d afterok$JOBS\"\n";
    }
    text + "echo \"last job: ${JOBS#:}\"\n"
}

/// A word for a shell.
fn quoted(word: &Path) -> String {
    let word = word.to_string_lossy();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=".contains(c);
    match word.chars().all(is_plain) {
        true => word.into_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}
