//! The same program for meshes in memory: arrays in, arrays out, cells in memory instead of files.
//!
//! Up to four cells' worth of triangles the kernel meets the target in one call. Beyond that the mesh is cut into
//! cells, which are simplified in parallel and joined, round by round as `stages::stitch` decides, until one call
//! can finish. Nothing is read or written, nothing can be resumed. `attributes` turns arrays of vertices into the
//! kernel's channels and back.

pub mod attributes;
pub mod given;
mod map;
mod models;
mod regions;
mod rounds;
mod weld;
mod whole;

use crate::config::{Config, Method, Target};
use crate::error::{Error, Result};
use crate::kernel::{self, FitStatistics, Options, QualityCurve, Statistics, Stop};
use crate::mesh::Mesh;
use crate::mesh::attribute_weights::ChannelSample;
use crate::mesh::bounds::Bounds;
use crate::mesh::codec::ChannelKind;
use crate::mesh::global_vertex::GlobalVertex;
use crate::pipeline::run_report::{QualityReport, StopReason};
use crate::stages::partition::CutMesh;
use crate::stages::stitch::{self, NextStep};
use crate::store::cells::CellMesh;
use crate::system::progress::Progress;
use crate::system::units::show_bytes;
use attributes::Attributes;
pub use map::GONE;
use map::RowMap;
use models::RowModels;
use regions::FaceRegions;
use rounds::Means;
use serde::Serialize;
use std::collections::BTreeMap;
use weld::{Welded, weld};
use whole::{Left, WholeMesh};

/// A mesh in memory, and what its vertices carry.
#[derive(Debug, Default)]
pub struct Input<'a> {
    /// One position a vertex, all finite, in input units.
    pub positions: Vec<[f64; 3]>,
    /// Corners, all below the number of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Attributes of the vertices.
    pub attributes: Attributes<'a>,
    /// Labels of the triangles, whose borders are kept; none, or one for each.
    pub labels: Vec<u32>,
}

/// The simplified mesh.
#[derive(Debug, Default)]
pub struct Output {
    /// Vertices that triangles use, in ascending order of `source`.
    pub positions: Vec<[f64; 3]>,
    /// Corners.
    pub triangles: Vec<[u32; 3]>,
    /// The input vertex that survived as each vertex, or that a new one is a copy of.
    pub source: Vec<u32>,
    /// Records of the vertices, as `Attributes::encode` makes them; empty without attributes.
    pub records: Vec<u8>,
    /// Labels of the triangles; none, or one for each.
    pub labels: Vec<u32>,
    /// For each vertex of the input the vertex that it became, or `GONE`; empty unless `config.map` asks for it.
    pub map: Vec<u32>,
    /// Report of the run.
    pub report: Report,
}

/// Report of a run in memory; keys as in the report of `simplify` (docs/report.md).
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The input.
    pub input: Counts,
    /// The output.
    pub output: Counts,
    /// Every setting that changes the result.
    pub settings: BTreeMap<String, String>,
    /// Cells of the first round; 1 where one call of the kernel did it all.
    pub cells: u32,
    /// Rounds over all cells; the finish is not one.
    pub rounds: u32,
    /// Vertices on seams of the first round.
    pub shared_vertices: u64,
    /// Refused collapses by reason.
    pub rejects: BTreeMap<String, u64>,
    /// Repairs and changes of the topology, by kind.
    pub changes: BTreeMap<String, u64>,
    /// Outcome of moving the vertices to fit the original.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<FitStatistics>,
    /// Estimate of how well the result stands for the input.
    pub quality: QualityReport,
    /// Triangles wanted.
    pub target: u64,
    /// True if the output has at most `target` triangles.
    pub target_met: bool,
    /// Reason why collapsing ended, in words.
    pub stop_reason: String,
}

/// Size of a mesh, and what was left out of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Vertices that became one with a copy before everything else (`--weld`).
    #[serde(skip_serializing_if = "is_zero")]
    pub joined_vertices: u64,
    /// Faults found, by name; what has them was left out.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub faults: BTreeMap<String, u64>,
}

fn is_zero(n: &u64) -> bool {
    *n == 0
}

/// Simplifies a mesh in memory to `config.target`; what `config` says about files is ignored.
///
/// Memory beyond the input's own arrays: 5 bytes a triangle, and what the kernel takes for the cells at work or
/// for the finish. Errors: `Usage` for a bound on the error, a ratio below one triangle and weights of what is not
/// there; `BadInput` without triangles; `Empty` if nothing is left; `NoMemory` beyond `config.memory_bytes`;
/// `Interrupted` after a wish of `progress`, or `config.kernel.interrupt`, to stop.
pub fn simplify(input: Input, config: &Config, progress: &Progress) -> Result<Output> {
    let Input { positions, triangles, mut attributes, labels } = input;
    attributes.find_patches(&triangles);
    let n_vertices = positions.len() as u64;
    let given = config.map.is_some().then(|| positions.clone());
    let mut welded = weld(positions, triangles, config)?;
    let rows = given.map(|given| RowMap::new(given, &welded));
    if rows.is_some()
        && (!labels.is_empty() || attributes.channel_kinds().contains(&ChannelKind::Texture))
    {
        let what = "--map: labels of faces and texture coordinates split vertices; leave them out";
        return Err(Error::Usage(what.to_owned()));
    }
    let joined_vertices = n_vertices - welded.positions.len() as u64;
    if !labels.is_empty() {
        attributes.set_regions(FaceRegions::part(&mut welded, &labels, n_vertices as usize)?);
    }
    let Welded { positions, triangles, ids, .. } = welded;
    let mut run = MemoryRun::new(&positions, &triangles, &attributes, config, progress)?;
    run.map = rows;
    run.report.input.vertices = n_vertices;
    run.report.input.joined_vertices = joined_vertices;
    let mut mesh = Mesh::new(positions, triangles);
    run.drop_degenerate(&mut mesh);
    if mesh.triangles.is_empty() {
        let what = "none of the faces is a triangle with three different corners";
        return Err(Error::bad_input("faces", what));
    }
    attributes.decode(&mut mesh, &ids, (config.threads.get(), progress))?;
    run.weigh(&mesh, &attributes);
    let whole = run.reach(WholeMesh { ids, mesh })?;
    if whole.mesh.triangles.is_empty() {
        let what = format!(
            "no triangle is left at a target of {}; ask for more, or look at the input with info",
            run.report.target
        );
        return Err(Error::Empty { path: "faces".into(), what });
    }
    let (whole, source) = run.models.by_model(whole);
    let records = attributes.encode(&whole.mesh, &source);
    let map = run.map.take().map_or(Vec::new(), |rows| rows.ended(&whole.ids));
    let report = run.report(&whole.mesh);
    let Mesh { positions, triangles, .. } = whole.mesh;
    let mut output =
        Output { positions, triangles, source, records, report, map, labels: Vec::new() };
    if let Some(regions) = attributes.regions() {
        join(&mut output, &whole.ids, regions, &attributes);
    }
    Ok(output)
}

/// Joins the vertices that were parted by labels.
fn join(output: &mut Output, ids: &[u32], regions: &FaceRegions, attributes: &Attributes) {
    let vertices = (&output.positions[..], ids);
    let triangles = std::mem::take(&mut output.triangles);
    let joined = regions.join(
        vertices,
        &output.source,
        triangles,
        &output.records,
        &attributes.chart_bytes(),
    );
    let bytes = attributes.record_bytes();
    let kept = || joined.vertices.iter().map(|&v| v as usize);
    let records = kept().flat_map(|v| output.records[v * bytes..][..bytes].iter().copied());
    output.records = records.collect();
    output.positions = kept().map(|v| output.positions[v]).collect();
    output.source = kept().map(|v| regions.row(output.source[v])).collect();
    output.report.output.vertices = output.positions.len() as u64;
    (output.triangles, output.labels) = (joined.triangles, joined.labels);
}

/// A run under way.
struct MemoryRun<'a> {
    config: &'a Config,
    options: Options,
    means: Means<'a>,
    quality: QualityCurve,
    /// If a map is asked for.
    map: Option<RowMap>,
    models: RowModels,
    report: Report,
}

impl<'a> MemoryRun<'a> {
    fn new(
        positions: &[[f64; 3]],
        triangles: &[[u32; 3]],
        attributes: &Attributes,
        config: &'a Config,
        progress: &'a Progress,
    ) -> Result<MemoryRun<'a>> {
        let (n_vertices, n_triangles) = (positions.len() as u64, triangles.len() as u64);
        if n_triangles == 0 {
            return Err(Error::bad_input("faces", "there are none: there is nothing to simplify"));
        }
        if matches!(config.target, Target::MaxError(_)) {
            let what = "--max-error takes files: use simplify_file";
            return Err(Error::Usage(what.to_owned()));
        }
        if config.method != Method::Collapse {
            let what = format!("--method {} takes files: use simplify_file", config.method.name());
            return Err(Error::Usage(what));
        }
        config.target.check(n_triangles)?;
        config.attributes.weights.check(attributes.channel_kinds()).map_err(Error::Usage)?;
        let target = config.target.triangles(n_triangles);
        let kernel = &config.kernel;
        // The number of a texture's image, as a property of PLY files names it.
        let image = ChannelKind::Scalar("texnumber".to_owned());
        let confined = |m: &ChannelKind| {
            [ChannelKind::Texture, ChannelKind::Region, image.clone()].contains(m)
        };
        let kinds = attributes.channel_kinds();
        let options = Options {
            confined: kinds.iter().map(confined).collect(),
            region: kinds.iter().position(|k| *k == ChannelKind::Region),
            label: kinds.iter().position(|k| *k == ChannelKind::Label),
            seam_share: config.attributes.weights.seam_share(),
            fit: kernel.fit.decided(n_triangles, target),
            close: config
                .close
                .map_or(0.0, |size| size.length(Bounds::around(positions).diagonal())),
            follow: config.map.is_some(),
            ..kernel.clone()
        };
        let counts = Counts { vertices: n_vertices, triangles: n_triangles, ..Counts::default() };
        let report = Report {
            input: counts,
            settings: config.settings(),
            target,
            cells: 1,
            ..Report::default()
        };
        let memory_bytes = room(n_vertices, n_triangles, attributes.channel_kinds().len(), config)?;
        let means = Means { threads: config.threads.get(), memory_bytes, progress };
        let quality = QualityCurve::default();
        Ok(MemoryRun {
            config,
            options,
            means,
            quality,
            map: None,
            models: RowModels::default(),
            report,
        })
    }

    fn drop_degenerate(&mut self, mesh: &mut Mesh) {
        let before = mesh.triangles.len();
        mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        self.fault("degenerate_faces", (before - mesh.triangles.len()) as u64);
    }

    fn fault(&mut self, name: &str, n: u64) {
        *self.report.input.faults.entry(name.to_owned()).or_default() += n;
    }

    /// Finds what a difference of 1 in each channel is worth.
    fn weigh(&mut self, mesh: &Mesh, attributes: &Attributes) {
        let channel_kinds = attributes.channel_kinds();
        let weights = self.config.attributes.weights.of_channels(channel_kinds);
        if weights.iter().any(|&weight| weight > 0.0) {
            let mut sample = ChannelSample::default();
            sample.add(mesh, channel_kinds);
            let n = mesh.triangles.len() as u64;
            self.options.weights = sample.lengths(&weights, channel_kinds, n, self.report.target);
        }
    }

    /// Goes round by round to the target.
    fn reach(&mut self, mut whole: WholeMesh) -> Result<WholeMesh> {
        let (target, size) = (self.report.target, self.config.cell_triangles);
        loop {
            let now = whole.mesh.triangles.len() as u64;
            let rounds = self.report.rounds;
            match stitch::next_step(now, target, size, rounds) {
                NextStep::Round(goal) if now > target && !finishes(now, size, rounds) => {
                    whole = self.round(whole, goal)?;
                }
                NextStep::Done => return Ok(whole),
                NextStep::Finish | NextStep::ExactRound | NextStep::Round(_) => {
                    return self.finish(whole);
                }
            }
        }
    }

    fn round(&mut self, whole: WholeMesh, goal: u64) -> Result<WholeMesh> {
        let (means, size, round) = (self.means, self.config.cell_triangles, self.report.rounds);
        let now = whole.mesh.triangles.len() as u64;
        means.progress.begin("simplify", round + 1, self.n_stages(now), now);
        let cut = CutMesh::new(&whole.mesh, size, round, means.threads, means.progress)?;
        if round == 0 {
            self.report.cells = cut.n_cells() as u32;
            self.report.shared_vertices = cut.n_shared;
        }
        let goal = stitch::within_reach(goal, now, cut.n_shared);
        let options = Options { fit: kernel::Fit::Off, ..self.options.clone() };
        let left = rounds::round(&whole, &cut, goal, (&options, round == 0), means)?;
        drop(cut);
        if left.iter().any(|cell| cell.simplified.statistics.interrupted) {
            return Err(Error::Interrupted { signal: 2 });
        }
        let mut end = kernel::Quality::default();
        for cell in &left {
            self.count(&cell.simplified.statistics);
            end.add(&cell.simplified.statistics.quality.unwrap_or_default());
        }
        if let Some(map) = &mut self.map {
            map.follow(&left);
        }
        drop(whole);
        self.models.follow(&left);
        let joined = WholeMesh::join(left);
        self.quality.add_round(&[], end, joined.mesh.triangles.len() as u64);
        self.report.rounds += 1;
        Ok(joined)
    }

    /// Meets the target in one call of the kernel.
    fn finish(&mut self, whole: WholeMesh) -> Result<WholeMesh> {
        let now = whole.mesh.triangles.len() as u64;
        let progress = self.means.progress;
        let number = self.report.rounds + 1;
        progress.begin("finish", number, number.max(self.n_stages(now)), now);
        let WholeMesh { ids, mesh } = whole;
        let mut cell = CellMesh {
            shared: vec![false; ids.len()],
            ids: ids.into_iter().map(GlobalVertex::in_memory).collect(),
            mesh,
            ..CellMesh::default()
        };
        if self.report.rounds == 0 {
            cell.order_by_lowest_id();
            let dropped = cell.tidy(0);
            self.fault("duplicate_faces", dropped.duplicate_faces);
            self.fault("back_faces", dropped.back_faces);
            self.fault("unreferenced_vertices", dropped.unreferenced_vertices);
        }
        let left = rounds::simplify(cell, Stop::Triangles(self.report.target), &self.options);
        progress.check()?;
        if left.simplified.statistics.interrupted {
            return Err(Error::Interrupted { signal: 2 });
        }
        progress.add(now);
        if let Some(map) = &mut self.map {
            map.follow([&left]);
        }
        self.models.follow([&left]);
        let Left { ids, simplified } = left;
        let statistics = &simplified.statistics;
        self.count(statistics);
        self.report.fit = statistics.fit;
        let quality = statistics.quality.unwrap_or_default();
        self.quality.add_round(&statistics.curve, quality, simplified.mesh.triangles.len() as u64);
        let source = simplified.source.iter().map(|&v| ids[v as usize].narrow()).collect();
        Ok(WholeMesh { ids: source, mesh: simplified.mesh }.in_order(|id| id))
    }

    fn count(&mut self, statistics: &Statistics) {
        for (sums, counts) in [
            (&mut self.report.rejects, &statistics.rejects),
            (&mut self.report.changes, &statistics.changes),
        ] {
            for &(name, n) in counts {
                *sums.entry(name.to_owned()).or_default() += n;
            }
        }
    }

    /// Stages that the run will have, as far as can be seen from `now` triangles.
    fn n_stages(&self, mut now: u64) -> u32 {
        let mut rounds = self.report.rounds;
        let (target, size) = (self.report.target, self.config.cell_triangles);
        while let NextStep::Round(goal) = stitch::next_step(now, target, size, rounds) {
            if goal >= now || finishes(now, size, rounds) {
                break;
            }
            (now, rounds) = (goal, rounds + 1);
        }
        rounds + 1
    }

    fn report(mut self, mesh: &Mesh) -> Report {
        let n = mesh.triangles.len() as u64;
        let (vertices, triangles) = (mesh.positions.len() as u64, n);
        self.report.output = Counts { vertices, triangles, ..Counts::default() };
        self.report.quality = self.quality.judge(self.report.input.triangles);
        self.report.target_met = n <= self.report.target;
        let reason = StopReason::of(self.report.target_met, self.report.quality.bearable);
        self.report.stop_reason = reason.to_string();
        self.report
    }
}

/// After the first round one call of the kernel takes this many cells' worth of triangles, and so four times as many
/// as where cells lie on disk: half the processor time of another round and a smaller finish (a statue of 4 million
/// triangles to 10 %: docs/results/python.md), at 102 bytes a triangle.
const FINISH_CELLS: u64 = 16;

/// True if one call of the kernel ends the run.
fn finishes(now: u64, cell_triangles: u64, rounds_done: u32) -> bool {
    rounds_done > 0 && now <= cell_triangles.saturating_mul(FINISH_CELLS)
}

/// Memory for cells at work. Refuses what cannot fit: the kernel on as much as it is given in one call.
fn room(n_vertices: u64, n_triangles: u64, n_channels: usize, config: &Config) -> Result<u64> {
    let target = config.target.triangles(n_triangles);
    // As the rounds leave it: about four times the target, at most twice where that is beyond the limit.
    let left = (target.saturating_mul(5)).min(config.cell_triangles.saturating_mul(FINISH_CELLS));
    let limit = config.cell_triangles.saturating_mul(stitch::FINISH_CELLS);
    let at_once = n_triangles.min(left.max(limit).max(target.saturating_mul(2)));
    let vertices_at_once = (n_vertices as f64 * at_once as f64 / n_triangles as f64) as u64;
    let kernel = kernel::peak_bytes(vertices_at_once, at_once, n_channels)
        + kernel::fit_bytes(config.kernel.fit.decided(n_triangles, target), at_once, target);
    let tables = 5 * n_triangles + n_vertices * (5 + 4 * n_channels as u64);
    let needed = tables + kernel;
    if needed > config.memory_bytes {
        return Err(Error::NoMemory(format!(
            "about {} are needed beside the arrays, more than the {} that this process may take; write the mesh to \
             a file and use simplify_file, which works in any memory",
            show_bytes(needed),
            show_bytes(config.memory_bytes)
        )));
    }
    if at_once > kernel::MAX_TRIANGLES || vertices_at_once > kernel::MAX_VERTICES {
        return Err(Error::Usage(format!(
            "{at_once} triangles are too many for one mesh in memory; write the mesh to a file and use simplify_file"
        )));
    }
    Ok(config.memory_bytes - tables)
}
