//! The ledger of a run: a row for each stage, with the memory that it needs and what lies in the job folder meanwhile.
//!
//! Stages follow each other: the plan is the most of all rows, and what stays through the run on top.

use super::disk::{Job, Round, shared_vertices};
use super::steps::{FinishPlan, check_chain, rounds_of_chain, rounds_within_bound};
use crate::config::{Config, Normals, Target};
use crate::error::Result;
use crate::io::ply::MeshSource;
use crate::kernel::history_bytes;
use crate::pipeline::fit;
use crate::pipeline::kernel_side::layout;
use crate::stages::components;
use crate::stages::partition::{self, Shares, Sizes};
use crate::stages::simplify::{
    FREED_AT_A_TIME, fit_bytes, frees_sources, later_bytes, result_bytes, round_fit_bytes,
    work_bytes,
};
use crate::stages::write;
use crate::store::cells::{CellTally, VertexLayout, plan_cells, survivor_bytes};

/// Safety factor: largest accepted cell relative to the planned size.
const UNEVEN: f64 = 1.25;

/// Temporary bytes for each vertex of an output whose corners get texture coordinates.
const JOIN_BYTES: f64 = 72.0;

/// Manifest, lock and what file systems add.
pub(in crate::pipeline) const MANIFEST_BYTES: u64 = 64 << 10;

/// Price of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StageCost {
    /// The stage, or what lies in the job folder through the run.
    pub(super) what: &'static str,
    /// Memory that it needs at least, in bytes.
    pub(super) memory_bytes: u64,
    /// The most that lies in the job folder while it runs, in bytes.
    pub(super) temp_bytes: f64,
}

/// The way from an input to its results, in counts.
pub(super) struct Course<'a> {
    source: &'a MeshSource,
    config: &'a Config,
    pub(super) triangles_in: u64,
    /// Triangles wanted in each level, falling.
    pub(super) targets: Vec<u64>,
    /// Triangles aimed at after each round.
    pub(super) rounds: Vec<u64>,
    /// The finish of each level, if it has one.
    pub(super) finishes: Vec<Option<FinishPlan>>,
    /// Cells of the first round.
    pub(super) cells: u32,
    layout: VertexLayout,
    vertices_per_triangle: f64,
}

impl<'a> Course<'a> {
    pub(super) fn new(source: &'a MeshSource, config: &'a Config) -> Result<Course<'a>> {
        source.require_faces()?;
        let triangles_in = source.n_triangles();
        let targets: Vec<u64> = config.targets().map(|t| t.triangles(triangles_in)).collect();
        check_chain(&targets)?;
        let (rounds, finishes) = match config.target {
            Target::MaxError(_) => rounds_within_bound(triangles_in, config.cell_triangles),
            _ => rounds_of_chain(triangles_in, &targets, config.cell_triangles),
        };
        Ok(Course {
            source,
            config,
            triangles_in,
            targets,
            rounds,
            finishes,
            cells: plan_cells(triangles_in, config.cell_triangles),
            layout: layout(source.schema(), (source.n_vertices(), triangles_in), config),
            vertices_per_triangle: source.n_vertices() as f64 / triangles_in.max(1) as f64,
        })
    }

    /// Vertices of this many triangles of a result.
    pub(super) fn vertices(&self, triangles: u64) -> u64 {
        (triangles as f64 * self.vertices_per_triangle) as u64
    }

    fn tally(&self, triangles: u64) -> CellTally {
        let vertices = (triangles as f64 * self.vertices_per_triangle.clamp(0.5, 3.0)) as u64;
        CellTally { vertices, triangles }
    }

    fn work_bytes(&self, triangles: u64, left: f64) -> u64 {
        let tally = self.tally(triangles);
        work_bytes(tally, tally, left, &self.layout)
    }

    /// Triangles of the largest cell that is accepted.
    fn cell(&self) -> u64 {
        ((self.config.cell_triangles as f64 * UNEVEN) as u64).min(self.triangles_in)
    }

    /// Triangles before and after each round.
    pub(super) fn steps(&self) -> impl Iterator<Item = (u64, u64)> {
        let befores = std::iter::once(&self.triangles_in).chain(&self.rounds);
        befores.zip(&self.rounds).map(|(&before, &after)| (before, after))
    }

    /// The memory of the partition, of this many bytes: tables take more of a larger budget.
    pub(super) fn shares(&self, memory_bytes: u64) -> Shares {
        let n_vertices = self.source.n_vertices();
        let sizes = Sizes {
            n_vertices,
            n_cells: self.cells,
            store_bytes: partition::store_bytes(n_vertices, self.triangles_in, &self.layout),
            layout: &self.layout,
        };
        Shares::new(sizes, self.config.threads.get(), memory_bytes)
    }

    /// Memory of the rounds: a detailed cell may keep nearly all it has.
    fn round_bytes(&self) -> u64 {
        let (cell, layout) = (self.cell(), &self.layout);
        let fitting = self.steps().enumerate().map(|(round, (before, after))| {
            round_fit_bytes(layout, cell, after as f64 / before.max(1) as f64, round == 0)
        });
        let later = if self.rounds.len() > 1 { later_bytes(layout, cell) } else { 0 };
        self.work_bytes(cell, 1.0) + later + fitting.max().unwrap_or(0)
    }

    /// Memory of a finish.
    fn finish_bytes(&self, finish: &FinishPlan) -> u64 {
        let FinishPlan { before, after } = *finish;
        let left = match self.config.target {
            Target::MaxError(_) => 1.0,
            _ => (after as f64 / before.max(1) as f64).min(1.0),
        };
        let fit = fit::decided(self.config, self.triangles_in, after);
        let record = match self.config.progressive {
            Some(_) => {
                let tally = self.tally(before);
                history_bytes(tally.vertices, tally.triangles, self.layout.n_channels())
            }
            None => 0,
        };
        let later = if self.rounds.is_empty() { 0 } else { later_bytes(&self.layout, before) };
        self.work_bytes(before, left) + later + fit_bytes(fit, before, after) + record
    }

    /// Memory of the writer. The result is one cell after a finish; otherwise cells that share vertices.
    fn writing_bytes(&self) -> u64 {
        let target = self.targets[0];
        if self.finishes[0].is_some() {
            return result_bytes(self.tally(target.min(self.triangles_in)), &self.layout);
        }
        let n_cells = target.div_ceil(self.config.cell_triangles).max(1);
        let shared = shared_vertices(target, n_cells as f64);
        let tables = match self.config.attributes.normals {
            Normals::Recompute => 2,
            Normals::Keep | Normals::Drop => 1,
        };
        result_bytes(self.tally(self.cell().min(target)), &self.layout)
            + tables * write::shared_bytes(shared as u64)
    }

    /// Bytes of this many triangles of a result in the job folder.
    pub(super) fn survivors(&self, triangles: u64) -> u64 {
        survivor_bytes(self.tally(triangles), &self.layout)
    }

    /// The same of the result that the rows of stages are planned with.
    pub(super) fn planned_survivors(&self) -> u64 {
        let finish = self.finishes.iter().flatten().next();
        finish.map_or(0, |finish| self.survivors(finish.after.min(self.triangles_in)))
    }

    /// Use of the job folder.
    fn job(&self, shares: &Shares) -> Job<'_> {
        Job {
            layout: &self.layout,
            vertices_per_triangle: self.vertices_per_triangle,
            cell_triangles: self.config.cell_triangles,
            buffer_bytes: shares.buffer_bytes,
            table_file_bytes: shares.table_file_bytes,
            threads: self.config.threads.get() as u64,
            freed_at_a_time: FREED_AT_A_TIME,
        }
    }

    /// The rows of all stages, in turn; the last one is the writer's.
    pub(super) fn stages(&self, shares: &Shares) -> Vec<StageCost> {
        let row = |what, memory_bytes, temp_bytes| StageCost { what, memory_bytes, temp_bytes };
        let job = self.job(shares);
        let frees = |(before, after)| Round { before, after, frees: frees_sources(before, after) };
        let rounds: Vec<Round> = self.steps().map(frees).collect();
        let first = self.finishes.iter().flatten().next();
        let finishes_at = first.map(|finish| finish.after.min(self.triangles_in));
        let (most, result) = job.peak(self.triangles_in, &rounds, finishes_at);
        // While components are joined: a sheet has four such vertices for each root of a cell's triangles.
        let links = match self.config.min_component {
            Some(_) => {
                let root = (self.config.cell_triangles.min(self.triangles_in) as f64).sqrt();
                4.0 * root * f64::from(self.cells) * components::LINK_BYTES as f64
            }
            None => 0.0,
        };
        // What putting texture coordinates back to corners sorts.
        let joining = match self.source.carried() {
            Some(carry) if carry.is_moved() => {
                self.vertices(self.targets[0].min(self.triangles_in)) as f64 * JOIN_BYTES
            }
            _ => 0.0,
        };
        let finish = self.finishes.iter().flatten().map(|finish| self.finish_bytes(finish)).max();
        vec![
            row("partition", shares.least_bytes, 0.0),
            row("components", 0, job.store(self.triangles_in, false) + links),
            row("simplify", self.round_bytes(), most),
            row("finish", finish.unwrap_or(0), 0.0),
            row("write", self.writing_bytes(), result + joining),
        ]
    }

    /// Rows of what lies in the job folder through the run; `output_bytes` are those of all outputs.
    pub(super) fn held(&self, shares: &Shares, output_bytes: u64) -> Vec<StageCost> {
        let row = |what, bytes: u64| StageCost { what, memory_bytes: 0, temp_bytes: bytes as f64 };
        let job = self.job(shares);
        let mut rows = vec![row("manifest", MANIFEST_BYTES)];
        // What `--max-error` measures against is a copy of the input's geometry.
        if let (Some(_), Target::MaxError(_)) = (self.config.min_component, self.config.target) {
            let record_bytes = self.layout.schema.record_bytes() as u64;
            rows.push(row(
                "kept",
                13 * self.triangles_in + record_bytes * self.source.n_vertices(),
            ));
        }
        // The next attempt at a bound begins from it; what is left of one round lies there in any case.
        if let (true, [first, _, ..]) = (self.layout.has_reach, self.rounds.as_slice()) {
            rows.push(row("first round", job.survivors(*first) as u64));
        }
        // What later rounds have left in the attempt before: about as much as the result.
        if matches!(self.config.target, Target::MaxError(_)) && !self.rounds.is_empty() {
            rows.push(row("earlier attempt", self.planned_survivors()));
        }
        // Origins of all rounds and the finish, and what they have left; then the map, and sorts for it.
        if self.config.map.is_some() {
            let finish = self.finishes.iter().flatten().map(|finish| finish.before);
            let befores = self.steps().map(|(before, _)| before).chain(finish);
            let origins = 2 * self.layout.ids.bytes as u64 + write::MAP_DISK_BYTES;
            let left: f64 = self.rounds.iter().map(|&after| job.survivors(after)).sum();
            let passed: u64 = befores.map(|before| origins * self.tally(before).vertices).sum();
            rows.push(row("map", left as u64 + passed));
        }
        if self.config.checks.verify {
            rows.push(row("verify", 3 * output_bytes));
        }
        rows
    }
}
