//! The plan before the work: cells, rounds, memory, disk. Refuses what cannot succeed, by name.

pub(super) mod disk;
pub(super) mod output;
mod seconds;
mod steps;

use crate::bake::BakeNeed;
use crate::config::{Config, Normals, Target};
use crate::error::{Error, Remedy, Result};
use crate::io::ply::MeshSource;
use crate::kernel::{MAX_SPECK, history_bytes};
use crate::mesh::face_properties::FacePropertyPlan;
use crate::pipeline::fit;
use crate::pipeline::kernel_side::layout;
use crate::stages::components;
use crate::stages::partition::{self, Shares, Sizes};
use crate::stages::simplify::{
    FREED_AT_A_TIME, fit_bytes, frees_sources, later_bytes, result_bytes, round_fit_bytes,
    work_bytes,
};
use crate::stages::write;
use crate::store::cells::{CellTally, plan_cells};
use crate::system::memory::BASE_BYTES;
use crate::system::paths::existing_parent;
use crate::system::units::{show_bytes, show_count, show_length};
use output::output;
use std::num::NonZeroUsize;
use std::path::Path;
use steps::{Finish, check_chain, rounds_of_chain, rounds_within_bound};

/// Safety factor: largest accepted cell relative to the planned size.
const UNEVEN: f64 = 1.25;

/// Temporary bytes for each vertex of an output whose corners get texture coordinates.
const JOIN_BYTES: f64 = 72.0;

/// Steps in which the least budget is looked for; each comes nearer by a factor of about six.
const MOST_STEPS: usize = 16;

/// Manifest, lock and what file systems add.
pub(super) const MANIFEST_BYTES: u64 = 64 << 10;

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
    /// A new texture, if there is one.
    #[serde(skip)]
    pub bake: Option<BakeNeed>,
}

impl Plan {
    /// Plans a run; fails with `NoMemory` where the budget cannot hold one cell, the finish or the tables.
    pub fn new(source: &MeshSource, config: &Config) -> Result<Plan> {
        let triangles_in = source.n_triangles();
        source.require_faces()?;
        let targets: Vec<u64> = config.targets().map(|t| t.triangles(triangles_in)).collect();
        check_chain(&targets)?;
        let target = targets[0];
        let attributes = &config.attributes;
        let layout = layout(source.schema(), (source.n_vertices(), triangles_in), config);
        let cells = plan_cells(triangles_in, config.cell_triangles);
        let is_bound_only = matches!(config.target, Target::MaxError(_));
        let (rounds, finishes) = match is_bound_only {
            true => rounds_within_bound(triangles_in, config.cell_triangles),
            false => rounds_of_chain(triangles_in, &targets, config.cell_triangles),
        };
        let has_finish = finishes[0].is_some();
        let vertices_per_triangle = source.n_vertices() as f64 / triangles_in.max(1) as f64;
        let tally_of = |triangles: u64| {
            let vertices = (triangles as f64 * vertices_per_triangle.clamp(0.5, 3.0)) as u64;
            CellTally { vertices, triangles }
        };
        let stage_bytes = |triangles: u64, left: f64| {
            let tally = tally_of(triangles);
            work_bytes(tally, tally, left, &layout)
        };
        let cell = ((config.cell_triangles as f64 * UNEVEN) as u64).min(triangles_in);
        let threads = config.threads.get();
        let usable = config.memory_bytes.saturating_sub(BASE_BYTES);
        let store = partition::store_bytes(source.n_vertices(), triangles_in, &layout);
        let sizes = Sizes {
            n_vertices: source.n_vertices(),
            n_cells: cells,
            store_bytes: store,
            layout: &layout,
        };
        let shares = Shares::new(sizes, threads, usable);
        let tables = shares.least_bytes;
        // The result is one cell after a finish; otherwise cells that share vertices.
        let writing_bytes = match has_finish {
            false => {
                let n_cells = target.div_ceil(config.cell_triangles).max(1);
                let shared = disk::shared_vertices(target, n_cells as f64);
                let tables = match attributes.normals {
                    Normals::Recompute => 2,
                    Normals::Keep | Normals::Drop => 1,
                };
                result_bytes(tally_of(cell.min(target)), &layout)
                    + tables * write::shared_bytes(shared as u64)
            }
            true => result_bytes(tally_of(target.min(triangles_in)), &layout),
        };
        let finish_bytes = |finish: &Finish| {
            let left = match is_bound_only {
                true => 1.0,
                false => (finish.after as f64 / finish.before.max(1) as f64).min(1.0),
            };
            let fit = fit::decided(config, triangles_in, finish.after);
            let record = match config.progressive {
                Some(_) => {
                    let tally = tally_of(finish.before);
                    history_bytes(tally.vertices, tally.triangles, layout.n_channels())
                }
                None => 0,
            };
            let later = if rounds.is_empty() { 0 } else { later_bytes(&layout, finish.before) };
            stage_bytes(finish.before, left)
                + later
                + fit_bytes(fit, finish.before, finish.after)
                + record
        };
        let befores = std::iter::once(&triangles_in).chain(&rounds);
        let fitting = befores.zip(&rounds).enumerate().map(|(round, (&before, &after))| {
            round_fit_bytes(&layout, cell, after as f64 / before.max(1) as f64, round == 0)
        });
        // A detailed cell may keep nearly all it has.
        let later = if rounds.len() > 1 { later_bytes(&layout, cell) } else { 0 };
        let cell_bytes = stage_bytes(cell, 1.0) + later + fitting.max().unwrap_or(0);
        let works = (finishes.iter().flatten().map(finish_bytes))
            .fold(cell_bytes.max(writing_bytes), u64::max);
        // Tables take more of a larger budget; the least budget is the one that they fill.
        let mut least = works.max(tables);
        for _ in 0..MOST_STEPS {
            let filled = works.max(Shares::new(sizes, threads, least).least_bytes);
            if filled == least {
                break;
            }
            least = filled;
        }
        let needed = least + BASE_BYTES;
        if works.max(tables) > usable {
            return Err(too_little(config, needed, works > tables, usable, works));
        }
        let job = disk::Job {
            layout: &layout,
            vertices_per_triangle,
            cell_triangles: config.cell_triangles,
            buffer_bytes: shares.buffer_bytes,
            table_file_bytes: shares.table_file_bytes,
            threads: threads as u64,
            freed_at_a_time: FREED_AT_A_TIME,
        };
        let steps: Vec<disk::Round> = std::iter::once(&triangles_in)
            .chain(&rounds)
            .zip(&rounds)
            .map(|(&before, &after)| disk::Round {
                before,
                after,
                frees: frees_sources(before, after),
            })
            .collect();
        let finishes_at =
            finishes.iter().flatten().next().map(|finish| finish.after.min(triangles_in));
        let (most, result) = job.peak(triangles_in, &steps, finishes_at);
        let output_triangles = target.min(triangles_in);
        let output_vertices = (output_triangles as f64 * vertices_per_triangle) as u64;
        // What putting texture coordinates back to corners sorts.
        let joining = match source.carried() {
            Some(carry) if carry.is_moved() => output_vertices as f64 * JOIN_BYTES,
            _ => 0.0,
        };
        // While components are joined: a sheet has four such vertices for each root of a cell's triangles.
        let links = match config.min_component {
            Some(_) => {
                let root = (config.cell_triangles.min(triangles_in) as f64).sqrt();
                4.0 * root * f64::from(cells) * components::LINK_BYTES as f64
            }
            None => 0.0,
        };
        // What `--max-error` measures against is a copy of the input's geometry.
        let kept = match (config.min_component, config.target) {
            (Some(_), Target::MaxError(_)) => {
                13 * triangles_in + layout.schema.record_bytes() as u64 * source.n_vertices()
            }
            _ => 0,
        };
        let (mut output_bytes, spool_bytes) =
            output(source, config, output_vertices, output_triangles)?;
        // Finer levels are there while coarser ones are made.
        let mut earlier_bytes = 0;
        for &target in &targets[1..] {
            let vertices = (target as f64 * vertices_per_triangle) as u64;
            let (bytes, _) = output(source, config, vertices, target)?;
            earlier_bytes = output_bytes;
            output_bytes += bytes;
        }
        // The next attempt at a bound begins from it.
        let first_round = match (layout.has_reach, rounds.first()) {
            (true, Some(&after)) => job.survivors(after) as u64,
            (true, None) => job.store(triangles_in, false) as u64,
            (false, _) => 0,
        };
        let verifying = if config.verify { 3 * output_bytes } else { 0 };
        let beside = kept + first_round + verifying + MANIFEST_BYTES;
        let writing = (result + joining) as u64;
        let most = most.max(job.store(triangles_in, false) + links);
        let temp_bytes = (most as u64).max(writing) + beside;
        let together_bytes =
            (temp_bytes + earlier_bytes).max(writing + output_bytes + spool_bytes + beside);
        let n_rounds = rounds.len() as u32;
        // Partition, perhaps components, every round, every recut between rounds, finishes, and a file for each level.
        let n_stages = 1
            + u32::from(config.min_component.is_some())
            + n_rounds
            + n_rounds.saturating_sub(1)
            + finishes.iter().flatten().count() as u32
            + targets.len() as u32;
        Ok(Plan {
            triangles_in,
            target,
            coarser: targets[1..].to_vec(),
            cells,
            finish: has_finish,
            n_stages,
            usable_memory_bytes: usable,
            needed_memory_bytes: needed,
            temp_bytes,
            output_bytes,
            spool_bytes,
            together_bytes,
            seconds: seconds::of_run(source, config, triangles_in),
            bake: None,
            rounds,
        })
    }

    /// Adds what the output holds beside its mesh, or in files beside it.
    pub fn add_output_bytes(&mut self, bytes: u64) {
        self.output_bytes += bytes;
        self.together_bytes += bytes;
    }

    /// Adds a progressive mesh of the finish, for records of this many bytes. Measured: 10 bytes a triangle on the dragon (records of
    /// 12 bytes), 14 on the legion with colours (15).
    pub fn add_progressive(&mut self, record_bytes: usize) {
        let before = self.rounds.last().copied().unwrap_or(self.triangles_in);
        let bytes = before * (8 + record_bytes as u64 / 2);
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
        self.seconds += n_levels as f64 * need.cpu_seconds / threads.get() as f64;
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
    let remedy = if cells_at_fault && usable > 0 {
        let fits =
            (config.cell_triangles as f64 * usable as f64 / works as f64) as u64 / 1000 * 1000;
        if fits >= 10_000 {
            format!("--cell-triangles {fits} would fit, or give --memory {}", least)
        } else {
            format!("give at least --memory {}", least)
        }
    } else {
        format!("give at least --memory {}", least)
    };
    Error::NoMemory(format!(
        "the budget of {budget} is too small, {} are needed: {remedy}",
        show_bytes(needed)
    ))
}
