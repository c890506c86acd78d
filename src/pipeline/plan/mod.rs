//! The plan before the work: cells, rounds, memory, disk. Refuses what cannot succeed, by name.

pub(super) mod disk;
mod ledger;
pub(super) mod output;
mod piece;
mod seconds;
mod steps;

use crate::bake::BakeNeed;
use crate::config::{Config, Target};
use crate::error::{Error, Remedy, Result};
use crate::io::ply::MeshSource;
use crate::kernel::MAX_SPECK;
use crate::mesh::face_properties::FacePropertyPlan;
use crate::system::memory::BASE_BYTES;
use crate::system::paths::existing_parent;
use crate::system::progress::StageSeconds;
use crate::system::units::{show_bytes, show_count, show_length};
use ledger::Course;
pub(super) use ledger::MANIFEST_BYTES;
use output::output;
use std::num::NonZeroUsize;
use std::path::Path;

/// Steps in which the least budget is looked for; each comes nearer by a factor of about six.
const MOST_STEPS: usize = 16;

/// Temporary bytes for each corner, and for each byte of the input, where what faces carry
/// goes to vertices: two sorts, and the staged mesh beside its parts.
const SPLIT_CORNER_BYTES: u64 = 44;
const SPLIT_FILE_COPIES: u64 = 2;

/// Forecast of a run: its steps, memory and disk use.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Plan {
    /// Triangles of the input.
    pub triangles_in: u64,
    /// Triangles wanted; of a chain, in its finest level.
    pub target: u64,
    /// Triangles wanted in the further levels of a chain, falling.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub coarser: Vec<u64>,
    /// Cells of the first round.
    pub cells: u32,
    /// Triangles aimed at after each round; the finish is not a round.
    pub rounds: Vec<u64>,
    /// True if one in-core finish meets the target exactly.
    pub finish: bool,
    /// Stages of the run, each with a bar of progress.
    #[serde(skip)]
    pub n_stages: u32,
    /// Memory the stages may share, in bytes.
    pub usable_memory_bytes: u64,
    /// Memory that the most demanding stage needs at least, in bytes.
    pub needed_memory_bytes: u64,
    /// Peak bytes in the job folder.
    pub temp_bytes: u64,
    /// Bytes of the output.
    pub output_bytes: u64,
    /// Bytes kept in the output's folder while it is written, besides the output.
    pub spool_bytes: u64,
    /// Peak bytes where job folder and output share a disk.
    pub together_bytes: u64,
    /// Expected seconds.
    pub seconds: f64,
    /// The same of each stage in turn.
    #[serde(skip)]
    pub stage_seconds: Vec<StageSeconds>,
    /// A new texture, if there is one.
    #[serde(skip)]
    pub bake: Option<BakeNeed>,
}

impl Plan {
    /// Plans a run; fails with `NoMemory` where the budget cannot hold one cell, the finish or the tables.
    pub fn new(source: &MeshSource, config: &Config) -> Result<Plan> {
        let course = Course::new(source, config)?;
        let usable = config.memory_bytes.saturating_sub(BASE_BYTES);
        let shares = course.shares(usable);
        let stages = course.stages(&shares);
        let works = stages[1..].iter().map(|stage| stage.memory_bytes).max().unwrap_or(0);
        let tables = stages[0].memory_bytes;
        // Tables take more of a larger budget; the least budget is the one that they fill.
        let mut least = works.max(tables);
        for _ in 0..MOST_STEPS {
            let filled = works.max(course.shares(least).least_bytes);
            if filled == least {
                break;
            }
            least = filled;
        }
        let needed = least + BASE_BYTES;
        if works.max(tables) > usable {
            return Err(too_little(config, needed, works > tables, usable, works));
        }
        let (triangles_in, target) = (course.triangles_in, course.targets[0]);
        let written = target.min(triangles_in);
        let (mut output_bytes, spool_bytes) =
            output(source, config, course.vertices(written), written)?;
        // Finer levels are there while coarser ones are made.
        let mut earlier_bytes = 0;
        for &target in &course.targets[1..] {
            let (bytes, _) = output(source, config, course.vertices(target), target)?;
            earlier_bytes = output_bytes;
            output_bytes += bytes;
        }
        let held = course.held(&shares, output_bytes);
        let held: u64 = held.iter().map(|row| row.temp_bytes as u64).sum();
        let most = stages.iter().map(|stage| stage.temp_bytes as u64).max().unwrap_or(0);
        let writing = stages.last().map_or(0, |stage| stage.temp_bytes as u64);
        let temp_bytes = most + held;
        let together_bytes =
            (temp_bytes + earlier_bytes).max(writing + output_bytes + spool_bytes + held);
        let n_rounds = course.rounds.len() as u32;
        // Partition, perhaps components, every round, every recut between rounds, finishes, and a file for each level.
        let n_stages = 1
            + u32::from(config.min_component.is_some())
            + u32::from(config.map.is_some())
            + n_rounds
            + n_rounds.saturating_sub(1)
            + course.finishes.iter().flatten().count() as u32
            + course.targets.len() as u32;
        let stage_seconds = seconds::of_run(&course, source, config);
        Ok(Plan {
            triangles_in,
            target,
            coarser: course.targets[1..].to_vec(),
            cells: course.cells,
            finish: course.finishes[0].is_some(),
            n_stages,
            usable_memory_bytes: usable,
            needed_memory_bytes: needed,
            temp_bytes,
            output_bytes,
            spool_bytes,
            together_bytes,
            seconds: stage_seconds.iter().map(|(_, seconds)| seconds).sum(),
            stage_seconds,
            bake: None,
            rounds: course.rounds,
        })
    }

    /// Fits what is told of seconds and of a result within a bound to a piece of the input, which is simplified for that. What is
    /// refused does not depend on it, so it is for those who show the plan: not for each trial or unit of a job.
    pub fn refine(&mut self, source: &MeshSource, config: &Config) -> Result<()> {
        seconds::refine(&mut self.stage_seconds, source);
        self.seconds = self.stage_seconds.iter().map(|(_, seconds)| seconds).sum();
        if let Some(share) = piece::share_within_bound(source, config) {
            let within = ((share * self.triangles_in as f64) as u64).max(self.target);
            let bytes = |triangles: u64| -> Result<u64> {
                let per_triangle = source.n_vertices() as f64 / self.triangles_in.max(1) as f64;
                let vertices = (triangles as f64 * per_triangle) as u64;
                Ok(output(source, config, vertices, triangles)?.0)
            };
            let [planned, expected] = [self.target, within].map(|n| n.min(self.triangles_in));
            let (before, after) = (bytes(planned)?, bytes(expected)?);
            self.add_output_bytes(after.saturating_sub(before));
            // The result of a trial lies in the job folder as rows and as a file.
            let course = Course::new(source, config)?;
            let more = course.survivors(expected).saturating_sub(course.planned_survivors());
            self.temp_bytes += more + after;
            self.together_bytes += more;
        }
        Ok(())
    }

    /// Adds what the output holds beside its mesh, or in files beside it.
    pub fn add_output_bytes(&mut self, bytes: u64) {
        self.output_bytes += bytes;
        self.together_bytes += bytes;
    }

    /// Adds a progressive mesh of the finish, for records of this many bytes. Measured: 10.2 bytes a triangle on the dragon (records
    /// of 12 bytes), 11 on a statue, 14.5 on the legion with colours (15).
    pub fn add_progressive(&mut self, record_bytes: usize) {
        let before = self.rounds.last().copied().unwrap_or(self.triangles_in);
        let bytes = before * (7 * record_bytes as u64).saturating_sub(21) / 6;
        self.temp_bytes += bytes;
        self.output_bytes += bytes;
        self.together_bytes += bytes;
    }

    /// Adds a new texture for every level.
    pub fn add_bake(&mut self, need: BakeNeed, threads: NonZeroUsize) {
        let n_levels = 1 + self.coarser.len() as u64;
        // The shape lies in the job folder before it is written with its pages.
        let bytes = need.temp_bytes + need.page_bytes + self.output_bytes;
        self.output_bytes += n_levels * need.page_bytes;
        self.temp_bytes += bytes;
        self.together_bytes += bytes + n_levels * need.page_bytes;
        self.needed_memory_bytes =
            self.needed_memory_bytes.max(need.least_memory_bytes + BASE_BYTES);
        let seconds = need.cpu_seconds / threads.get() as f64;
        self.seconds += n_levels as f64 * seconds;
        self.stage_seconds.extend((0..n_levels).map(|_| ("bake", seconds)));
        self.n_stages += n_levels as u32;
        self.bake = Some(need);
    }

    /// Fails where output or temporary data would not fit, or their folders do not take files.
    pub fn check_disk(&self, config: &Config) -> Result<()> {
        let output_bytes = self.output_bytes + self.spool_bytes;
        disk::check_space(
            (&config.output, &config.job_folder),
            self.temp_bytes,
            output_bytes,
            self.together_bytes,
            config.job.min_free_bytes,
        )
    }

    fn target_line(&self, config: &Config) -> String {
        if !self.coarser.is_empty() {
            let counts: Vec<String> = std::iter::once(&self.target)
                .chain(&self.coarser)
                .map(|&n| show_count(n))
                .collect();
            return format!("targets  {} triangles, a file each", counts.join(", "));
        }
        let triangles = show_count(self.target);
        let within = config.kernel.bound.map(|bound| show_length(bound.distance));
        match (&config.target, within) {
            (Target::MaxError(bound), _) => {
                format!("target   as few triangles as a distance of {} allows", show_length(*bound))
            }
            (_, Some(bound)) => {
                format!("target   {triangles} triangles, or as few as a distance of {bound} allows")
            }
            // With one queue for every count a component that vanishes may be the last step.
            (_, None) if config.progressive.is_some() => {
                format!("target   {triangles} triangles, at most {MAX_SPECK} below")
            }
            (_, None) if self.target >= self.triangles_in => {
                "target   all triangles: the input has no more than were asked for".to_owned()
            }
            (_, None) if self.finish => format!("target   {triangles} triangles, or one less"),
            (_, None) => format!("target   {triangles} triangles, at most 0.5 % below"),
        }
    }

    /// The plan for people, one fact a line.
    pub fn lines(&self, config: &Config) -> Vec<String> {
        let rounds: Vec<String> = self.rounds.iter().map(|&n| show_count(n)).collect();
        let way = match (rounds.as_slice(), self.finish) {
            ([], _) => "joined at once and brought to the target".to_owned(),
            (rounds, false) => format!("brought to {} triangles", rounds.join(", ")),
            (rounds, true) => {
                format!("brought to {} triangles, then joined", rounds.join(", "))
            }
        };
        let mut lines = vec![
            format!("input    {} triangles", show_count(self.triangles_in)),
            self.target_line(config),
            format!(
                "cells    {} of about {} triangles, {way}",
                self.cells,
                show_count(config.cell_triangles)
            ),
        ];
        if let Some(bake) = &self.bake {
            lines.push(format!(
                "texture  about {} texels out of {} images, {} of pages; takes about {} of memory",
                show_count(bake.n_texels),
                bake.n_images,
                show_bytes(bake.page_bytes),
                show_bytes(bake.memory_bytes + BASE_BYTES)
            ));
        }
        lines.extend(price_lines(
            [config.memory_bytes, self.needed_memory_bytes],
            config.threads,
            [self.temp_bytes, self.output_bytes],
            &config.job_folder,
            self.seconds,
        ));
        lines
    }
}

/// The lines of a plan that tell its price: memory (`budget`, `needed`), disk (`temporary`, `output`; all in bytes), time.
pub(super) fn price_lines(
    [budget, needed]: [u64; 2],
    threads: NonZeroUsize,
    [temporary, output]: [u64; 2],
    job_folder: &Path,
    seconds: f64,
) -> [String; 3] {
    [
        format!(
            "memory   budget {}, at least {} needed; {threads} threads",
            show_bytes(budget),
            show_bytes(needed)
        ),
        format!(
            "disk     about {} temporary in {}, {} output",
            show_bytes(temporary),
            job_folder.display(),
            show_bytes(output)
        ),
        format!("time     about {:.0} s", seconds.max(1.0)),
    ]
}

/// Fails where the disk cannot hold what it takes to move what faces carry to vertices, which happens before
/// everything else; sources without any need nothing.
pub fn check_split(source: &MeshSource, carry: &FacePropertyPlan, config: &Config) -> Result<()> {
    if !carry.is_moved() {
        return Ok(());
    }
    // Nameless files lie beside the job folder.
    let folder = existing_parent(&config.job_folder);
    let corner_bytes = SPLIT_CORNER_BYTES + 4 * carry.vertex_properties().len() as u64;
    let bytes = corner_bytes * source.n_corners() + SPLIT_FILE_COPIES * source.file_bytes();
    let stat = rustix::fs::statvfs(folder)
        .map_err(|e| Error::reading(folder, "cannot ask for free space", e.into()))?;
    let free = stat.f_bavail * stat.f_frsize;
    if bytes <= free {
        return Ok(());
    }
    Err(Error::NoSpace {
        path: folder.into(),
        what: format!(
            "splitting the mesh along the seams of what its faces carry needs {} here, {} are free; give it \
             up with --drop-texture and --drop-faces",
            show_bytes(bytes),
            show_bytes(free)
        ),
        remedy: Remedy::MakeSpace,
    })
}

fn too_little(
    config: &Config,
    needed: u64,
    cells_at_fault: bool,
    usable: u64,
    works: u64,
) -> Error {
    let budget = show_bytes(config.memory_bytes);
    // Rounded up: what is advised has to be enough.
    let least = format!("{}MiB", needed.div_ceil(1 << 20));
    let fits =
        (config.cell_triangles as f64 * usable as f64 / works.max(1) as f64) as u64 / 1000 * 1000;
    let remedy = match cells_at_fault && usable > 0 && fits >= 10_000 {
        true => format!("--cell-triangles {fits} would fit, or give --memory {least}"),
        false => format!("give at least --memory {least}"),
    };
    Error::NoMemory(format!(
        "the budget of {budget} is too small, {} are needed: {remedy}",
        show_bytes(needed)
    ))
}
