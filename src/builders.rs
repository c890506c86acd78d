//! Runs from file to file for Rust programs: `Simplify`, `Measure` and `Tiles`, with the defaults of the commands.
//!
//! A builder fills the settings that the program itself works with, checks its paths as a command does, and runs the same code. It does
//! not print, listens to no signal and never exits. Meshes in memory go through `pipeline::in_memory`.

use crate::cli::{arguments, job};
use crate::config::{Config, Target};
use crate::error::{Error, Result};
use crate::io::InputPaths;
use crate::io::StageOptions;
use crate::io::ply::MeshSource;
use crate::kernel::Bound;
use crate::measure::compare::{self, CELL_TRIANGLES, Request};
use crate::measure::solid::Solid;
use crate::measure::{self, Certify};
use crate::pipeline::has_begun_to_write;
use crate::pipeline::run_report::RunReport;
use crate::pipeline::tiles::report::TilesReport;
use crate::pipeline::tiles::{Finest, TilesConfig, make_tiles, prepare_tiles};
use crate::system::disk::folder_of;
use crate::system::memory::{budget_bytes, limit_bytes, resident_bytes};
use crate::system::pace::Pace;
use crate::system::parallel::guarded;
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time between two calls of a function that follows a run.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Stack of the thread that works while the caller follows it: as large as that of a main thread.
const STACK_BYTES: usize = 8 << 20;

/// A run at one moment, for the function that was given to `on_progress`.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Name of the stage: `partition`, `simplify`, `finish`, ...
    pub stage: &'a str,
    /// Its number, from 1.
    pub number: u32,
    /// Number of stages.
    pub stages: u32,
    /// Share of the run that is done, 0 to 1; an estimate that never falls.
    pub fraction: f64,
    /// Seconds since the run began.
    pub seconds: f64,
    /// Seconds left of the run; an estimate.
    pub seconds_left: f64,
    /// Resident memory of the process, in bytes.
    pub memory_bytes: u64,
    progress: &'a Progress,
}

impl Moment<'_> {
    /// Asks the run to stop: it ends with `Error::Interrupted` at its next safe point, and the same run continues from there.
    pub fn stop(&self) {
        self.progress.request_stop(2);
    }
}

/// A function that follows a run.
pub type Follower<'a> = Box<dyn FnMut(&Moment) + 'a>;

/// Runs `work`, in another thread if there is a function to follow it from this one; a panic in it is an error as in `guarded`.
pub fn followed<T: Send>(
    follower: Option<Follower>,
    work: impl FnOnce(&Progress) -> Result<T> + Send,
) -> Result<T> {
    let progress = &Progress::default();
    let Some(mut follower) = follower else { return guarded(|| work(progress)) };
    let caller = std::thread::current();
    let job = move || {
        let outcome = guarded(|| work(progress));
        caller.unpark();
        outcome
    };
    std::thread::scope(|scope| {
        let builder = std::thread::Builder::new().stack_size(STACK_BYTES);
        let worker = builder
            .spawn_scoped(scope, job)
            .map_err(|e| Error::NoMemory(format!("cannot start a thread: {e}")))?;
        let mut pace = None;
        while !worker.is_finished() {
            std::thread::park_timeout(LOOK_EVERY);
            let (stage, done) = progress.read();
            if stage.name.is_empty() {
                continue;
            }
            let pace = pace.get_or_insert_with(|| Pace::expecting(progress.expected()));
            let (figures, _) = pace.update(stage.clone(), done);
            follower(&Moment {
                stage: stage.name,
                number: stage.number,
                stages: stage.n_stages,
                fraction: figures.fraction,
                seconds: figures.seconds,
                seconds_left: figures.seconds_left,
                memory_bytes: resident_bytes(),
                progress,
            });
        }
        worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Simplifies a mesh file of any size.
///
/// The same run continues where an earlier one was interrupted.
///
/// ```no_run
/// # fn main() -> stonecut::Result<()> {
/// let report = stonecut::Simplify::new("scan.ply", "small.ply")
///     .ratio(0.01)
///     .memory(4 << 30)
///     .on_progress(|p| if p.seconds_left > 3600.0 { p.stop() })
///     .run()?;
/// assert!(report.target_met && report.output.triangles > 0);
/// # Ok(())
/// # }
/// ```
pub struct Simplify<'a> {
    config: Config,
    count: Option<Target>,
    temp_dir: Option<PathBuf>,
    follower: Option<Follower<'a>>,
}

impl<'a> Simplify<'a> {
    /// A run with the defaults of the command; formats are known by contents and by the ending of `output`.
    pub fn new(input: impl Into<InputPaths>, output: impl Into<PathBuf>) -> Self {
        let config = Config::new(input, output, Target::Ratio(1.0));
        Simplify { config, count: None, temp_dir: None, follower: None }
    }

    /// At most this many triangles.
    pub fn triangles(mut self, count: u64) -> Self {
        self.count = Some(Target::Triangles(count));
        self
    }

    /// This share of the input's triangles: 0.01 for 1 %.
    pub fn ratio(mut self, ratio: f64) -> Self {
        self.count = Some(Target::Ratio(ratio));
        self
    }

    /// No farther than this from the input, in input units, proven; with a count, whichever ends the run first.
    pub fn max_error(mut self, distance: f64) -> Self {
        self.config.kernel.bound = Some(Bound { distance, channel: None, patience: 1.0 });
        self
    }

    /// Memory budget in bytes, everything included [default: 75 % of the tightest limit in force].
    pub fn memory(mut self, bytes: u64) -> Self {
        self.config.memory_bytes = budget_bytes(Some(bytes), limit_bytes());
        self
    }

    /// Worker threads [default: the cores this process may use]; the result does not depend on them.
    pub fn threads(mut self, n: NonZeroUsize) -> Self {
        self.config.threads = arguments::threads(Some(n));
        self
    }

    /// Folder in which the job folder is made [default: beside the output].
    pub fn temp_dir(mut self, folder: impl Into<PathBuf>) -> Self {
        self.temp_dir = Some(folder.into());
        self
    }

    /// Replaces the output if it exists.
    pub fn force(mut self) -> Self {
        self.config.job.force = true;
        self
    }

    /// Measures the result at the end, and encloses its distance from the input (`Report::hausdorff`).
    pub fn verify(mut self) -> Self {
        self.config.checks.verify = true;
        self
    }

    /// Changes any other setting. Unlike on the command line, settings that do not go together are not always refused.
    pub fn with(mut self, change: impl FnOnce(&mut Config)) -> Self {
        change(&mut self.config);
        self
    }

    /// Calls `follower` in this thread, about ten times a second, while the run works in another one.
    pub fn on_progress(mut self, follower: impl FnMut(&Moment) + 'a) -> Self {
        self.follower = Some(Box::new(follower));
        self
    }

    /// The settings of the run.
    fn config(&self) -> Result<Config> {
        let mut config = self.config.clone();
        config.target = match (self.count, config.kernel.bound) {
            (Some(count), _) => count,
            (None, Some(bound)) => Target::MaxError(bound.distance),
            (None, None) => {
                let what = "no target: call triangles, ratio or max_error";
                return Err(Error::Usage(what.to_owned()));
            }
        };
        if config.job.until.is_some() {
            let what = "a run that ends early has no report: leave job.until out";
            return Err(Error::Usage(what.to_owned()));
        }
        config.format.check(&config.output)?;
        config.job_folder = arguments::job_folder(&config.output, self.temp_dir.as_deref())?;
        let may_be_ours =
            !config.job.restart && has_begun_to_write(&config.job_folder, &config.output);
        let paths = Paths::new(config.job.force || may_be_ours);
        let paths = config.input.add_to(paths, "the input")?;
        let paths = config
            .outputs()
            .fold(paths, |paths, output| paths.with(Role::Output, "the output", output));
        check(paths, self.temp_dir.as_ref(), &config.job_folder)?;
        Ok(config)
    }

    /// Runs it to its end. `Report::is_short` says whether the result is all that was asked for.
    ///
    /// Errors: `Error::exit_code` gives the class, `Error::remedy` what helps.
    pub fn run(self) -> Result<RunReport> {
        let config = self.config()?;
        let report = followed(self.follower, |progress| {
            let ready = job::prepare(&config, progress)?;
            progress.expect(ready.expected());
            job::run_job(ready, &config, progress)
        })?;
        report.ok_or_else(|| Error::Internal("a whole run has no report".to_owned()))
    }
}

/// Measures how far two mesh files of any size are apart, both ways.
///
/// ```no_run
/// # fn main() -> stonecut::Result<()> {
/// let report = stonecut::Measure::new("scan.ply", "small.ply").certify(0.01).run()?;
/// assert!(report.deviation.relative_rms < 0.001);
/// # Ok(())
/// # }
/// ```
pub struct Measure<'a> {
    paths: [PathBuf; 2],
    options: measure::Options,
    memory_bytes: u64,
    temp_dir: Option<PathBuf>,
    follower: Option<Follower<'a>>,
}

impl<'a> Measure<'a> {
    /// A measurement with the defaults of the command: a million samples on each surface.
    pub fn new(original: impl Into<PathBuf>, simplified: impl Into<PathBuf>) -> Self {
        Measure {
            paths: [original.into(), simplified.into()],
            options: measure::Options::default(),
            memory_bytes: budget_bytes(None, limit_bytes()),
            temp_dir: None,
            follower: None,
        }
    }

    /// Samples on each surface.
    pub fn samples(mut self, n: u64) -> Self {
        self.options.samples = n.max(1);
        self
    }

    /// Also encloses the largest distance in a proven interval of this width, relative to its upper end.
    pub fn certify(mut self, tolerance: f64) -> Self {
        self.options.certify = Some(Certify { tolerance, bound: None });
        self
    }

    /// Memory budget in bytes, everything included.
    pub fn memory(mut self, bytes: u64) -> Self {
        self.memory_bytes = budget_bytes(Some(bytes), limit_bytes());
        self
    }

    /// Worker threads; the numbers do not depend on them.
    pub fn threads(mut self, n: NonZeroUsize) -> Self {
        self.options.threads = arguments::threads(Some(n)).get();
        self
    }

    /// Folder for cells, if the meshes exceed the memory [default: beside the simplified mesh].
    pub fn temp_dir(mut self, folder: impl Into<PathBuf>) -> Self {
        self.temp_dir = Some(folder.into());
        self
    }

    /// Calls `follower` in this thread, about ten times a second.
    pub fn on_progress(mut self, follower: impl FnMut(&Moment) + 'a) -> Self {
        self.follower = Some(Box::new(follower));
        self
    }

    /// Measures.
    pub fn run(self) -> Result<compare::Report> {
        let began = std::time::Instant::now();
        let Measure { paths: [original, simplified], options, memory_bytes, temp_dir, follower } =
            self;
        let tolerance = options.certify.map(|certify| certify.tolerance);
        if tolerance.is_some_and(|t| !(measure::LEAST_TOLERANCE..1.0).contains(&t)) {
            return Err(Error::Usage("a tolerance is above 0 and below 1".to_owned()));
        }
        Paths::new(false)
            .with(Role::Input, "the original", &original)
            .with(Role::Input, "the simplified mesh", &simplified)
            .with_option(Role::TempDir, "temp_dir", temp_dir.as_ref())
            .check()?;
        let temp_dir = temp_dir.unwrap_or_else(|| folder_of(&simplified).to_path_buf());
        followed(follower, |progress| {
            let stage = StageOptions::new(&temp_dir).within(memory_bytes);
            let request = Request {
                original: &MeshSource::open_staged(&original, &stage)?,
                simplified: &MeshSource::open_staged(&simplified, &stage)?,
                options,
                memory_bytes,
                cell_triangles: CELL_TRIANGLES,
                temp_dir,
                heat: false,
            };
            let found = compare::compare(&request, progress)?;
            Ok(compare::Report::new(&request, &found, began.elapsed().as_secs_f64()))
        })
    }
}

/// Cuts a mesh file of any size into tiles at all levels of detail (OGC 3D Tiles 1.1).
///
/// ```no_run
/// # fn main() -> stonecut::Result<()> {
/// let report = stonecut::Tiles::new("scan.obj", "tiles").finest_ratio(0.1).run()?;
/// assert!(report.tiles > 0);
/// # Ok(())
/// # }
/// ```
pub struct Tiles<'a> {
    config: TilesConfig,
    temp_dir: Option<PathBuf>,
    follower: Option<Follower<'a>>,
}

impl<'a> Tiles<'a> {
    /// A run with the defaults of the command; `folder` appears when the tiles in it are complete.
    pub fn new(input: impl Into<InputPaths>, folder: impl Into<PathBuf>) -> Self {
        let config = TilesConfig::new(input, folder);
        Tiles { config, temp_dir: None, follower: None }
    }

    /// Finest level that is kept, as a share of the input's triangles [default: the input itself].
    pub fn finest_ratio(mut self, ratio: f64) -> Self {
        self.config.finest = Finest::Ratio(ratio);
        self
    }

    /// Finest level that is kept, as a number of triangles.
    pub fn finest_triangles(mut self, count: u64) -> Self {
        self.config.finest = Finest::Triangles(count);
        self
    }

    /// Memory budget in bytes, everything included.
    pub fn memory(mut self, bytes: u64) -> Self {
        self.config.memory_bytes = budget_bytes(Some(bytes), limit_bytes());
        self
    }

    /// Worker threads; the result does not depend on them.
    pub fn threads(mut self, n: NonZeroUsize) -> Self {
        self.config.threads = arguments::threads(Some(n));
        self
    }

    /// Folder in which the job folder is made [default: beside the output].
    pub fn temp_dir(mut self, folder: impl Into<PathBuf>) -> Self {
        self.temp_dir = Some(folder.into());
        self
    }

    /// Replaces the output if it is a folder of tiles that stonecut has written.
    pub fn force(mut self) -> Self {
        self.config.force = true;
        self
    }

    /// Changes any other setting.
    pub fn with(mut self, change: impl FnOnce(&mut TilesConfig)) -> Self {
        change(&mut self.config);
        self
    }

    /// Calls `follower` in this thread, about ten times a second.
    pub fn on_progress(mut self, follower: impl FnMut(&Moment) + 'a) -> Self {
        self.follower = Some(Box::new(follower));
        self
    }

    /// Cuts the tiles. Files of glTF have y upwards, all others z, unless `is_z_up` was set to false.
    pub fn run(self) -> Result<TilesReport> {
        let Tiles { mut config, temp_dir, follower } = self;
        config.job_folder = arguments::job_folder(&config.output, temp_dir.as_deref())?;
        let paths = config.input.add_to(Paths::new(config.force), "the input")?.with(
            Role::OutputFolder,
            "the output",
            &config.output,
        );
        check(paths, temp_dir.as_ref(), &config.job_folder)?;
        followed(follower, |progress| {
            let prepared = prepare_tiles(&config)?;
            config.is_z_up &= prepared.source.file_format() != "glTF";
            make_tiles(prepared, &config, progress)
        })
    }
}

/// Refuses paths that clash or cannot be used, before anything is written.
fn check(paths: Paths, temp_dir: Option<&PathBuf>, job_folder: &Path) -> Result<()> {
    paths
        .with_option(Role::TempDir, "temp_dir", temp_dir)
        .with(Role::JobFolder, "the job folder", job_folder)
        .check()
}

impl RunReport {
    /// True if the result is not all that was asked for: exit code 3 of the command.
    pub fn is_short(&self) -> bool {
        let is_solid = |solid: &Option<Solid>| solid.is_none_or(|solid| solid.met);
        let unbearable = self.levels.iter().any(|level| !level.quality.bearable);
        let lacks_images = self.textures.as_ref().is_some_and(|textures| textures.lacks_images);
        !self.target_met
            || !self.quality.bearable
            || unbearable
            || lacks_images
            || !is_solid(&self.solid)
            || !self.levels.iter().all(|level| is_solid(&level.solid))
            || self.opened_region_edges > 0
            || self.regions_off_volume > 0
            || self.input.lost_rows() > 0
            || self.losses.has_whole()
    }
}
