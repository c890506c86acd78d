//! The time that a run will take, stage by stage: rates of a reference machine, and a piece of the input that is simplified
//! on this one.
//!
//! A rate holds for clean surfaces without attributes. Surfaces with steps and noise take two to four times as long, and
//! machines differ; both show when a block of the input goes through the kernel before the run.

use super::ledger::Course;
use super::piece::{PIECE, piece};
use super::steps::FinishPlan;
use crate::config::Config;
use crate::io::OutputKind;
use crate::io::ply::MeshSource;
use crate::kernel::{self, Fit, Options, Stop};
use crate::measure;
use crate::pipeline::fit;
use crate::stages::simplify::pilot_cells;
use crate::system::progress::StageSeconds;
use std::time::Instant;

/// Seconds for a million triangles on one core: of passes over a mesh, which gain nothing from a second one.
const PARTITION: f64 = 0.033;
const REPARTITION: f64 = 0.062;
const COMPONENTS: f64 = 0.028;
const MAP: f64 = 0.097;
/// Of the output: PLY, OBJ, GLB, STL.
const WRITE: [f64; 4] = [0.06, 0.23, 0.1, 0.12];
/// Of cells, for each million of triangles that they have and that go: in the first round and in later ones.
const CELLS: [[f64; 2]; 2] = [[0.154, 0.109], [0.23, 0.165]];
/// Of cells that a pilot takes down.
const PILOT: f64 = 0.2;
/// Of a finish, likewise, then of each million that a fit moves, and of a record of every step.
const FINISH: [f64; 2] = [0.2, 0.18];
const FIT: f64 = 2.0;
const RECORD: f64 = 2.2;
/// Of the points of the original that `--optimize` moves a result towards, and of a sweep over them.
const POINTS: f64 = 0.5;
const SWEEP: f64 = 3.5;
/// Of pairs, for each million triangles of the result.
const PAIRS: f64 = 20.0;
/// Times as long where vertices carry colours or others that have a weight.
const WITH_PROPERTIES: f64 = 1.9;
/// Times as long where charts have seams, their way to vertices included.
const WITH_SEAMS: f64 = 8.0;
/// Times as long under `--no-self-intersections`.
const APART: f64 = 2.8;
/// Times as long within a bound on the error (docs/results/bound.md).
const BOUNDED: f64 = 10.0;

/// Shorter runs are not worth a piece that is simplified before.
const SAMPLE_FROM: f64 = 0.5;
/// A piece lies in the caches and takes this share of a triangle's time in a large mesh.
const IN_CACHES: f64 = 0.77;
/// Share of its triangles that the piece is brought to.
const SAMPLE_RATIO: f64 = 0.1;
/// More than this share of it is the surface and not the machine, and says nothing of what is not the kernel's work.
const MOST_MACHINE: f64 = 1.5;
/// The piece says at most that much.
const PACES: std::ops::RangeInclusive<f64> = 0.3..=8.0;

/// The stages of a run with their seconds, without a bake.
pub(super) fn of_run(course: &Course, source: &MeshSource, config: &Config) -> Vec<StageSeconds> {
    let million = |triangles: u64| triangles as f64 * 1e-6;
    let threads = measure::plan::cores_of(config.threads.get());
    let times = times(source, config);
    let mut stages = vec![("partition", PARTITION * million(course.triangles_in))];
    if config.min_component.is_some() {
        stages.push(("components", COMPONENTS * million(course.triangles_in)));
    }
    for (round, (before, after)) in course.steps().enumerate() {
        if round > 0 {
            stages.push(("repartition", REPARTITION * million(before)));
        }
        let cell = config.cell_triangles.min(before);
        let pilot = pilot_cells((before / cell.max(1)) as usize).len() as u64 * cell;
        let [own, gone] = CELLS[usize::from(round > 0)];
        let mut seconds = own * million(before) + gone * million(before.saturating_sub(after));
        // A total that is met exactly takes a trial of all cells.
        let is_exact = course.finishes[0].is_none() && round + 1 == course.rounds.len();
        seconds *= if is_exact { 2.0 } else { 1.0 };
        seconds += PILOT * million(pilot);
        stages.push((if round == 0 { "simplify" } else { "round" }, times * seconds / threads));
    }
    for (finish, &target) in course.finishes.iter().zip(&course.targets) {
        let target = target.min(course.triangles_in);
        if let Some(finish) = finish {
            stages.push(("finish", times * of_finish(finish, course, config)));
        }
        let rate = match config.format.kind_of(&config.output) {
            OutputKind::Ply => WRITE[0],
            OutputKind::Obj => WRITE[1],
            OutputKind::Glb => WRITE[2],
            OutputKind::Stl => WRITE[3],
        };
        stages.push(("write", rate * million(target)));
    }
    if config.map.is_some() {
        stages.insert(stages.len() - 1, ("map", MAP * million(course.triangles_in)));
    }
    if config.checks.verify {
        let triangles = [course.triangles_in, course.targets[0]];
        let samples = measure::Options::default().samples;
        stages.extend(measure::plan::stages(triangles, samples, config.threads.get()));
    }
    let [input, output] = [course.triangles_in, course.targets[0]].map(million);
    if let Some(sweeps) = config.optimize {
        let write = stages.last().copied();
        stages.push(("points", POINTS * input));
        stages.push(("optimize", SWEEP * input * f64::from(sweeps)));
        stages.extend(write);
    }
    if config.pairs {
        let shape = stages.clone();
        stages.push(("pairs", PAIRS * output));
        stages.extend(shape);
    }
    stages
}

/// Fits the seconds of a run that takes a while to this surface and this machine.
pub(super) fn refine(stages: &mut [StageSeconds], source: &MeshSource) {
    let all: f64 = stages.iter().map(|(_, seconds)| seconds).sum();
    let pace = if all > SAMPLE_FROM { pace(source) } else { None };
    for (name, seconds) in stages {
        let is_kernel = ["simplify", "round", "finish", "pairs"].contains(name);
        let pace = pace.unwrap_or(1.0);
        *seconds *= if is_kernel { pace } else { pace.min(MOST_MACHINE) };
    }
}

fn of_finish(finish: &FinishPlan, course: &Course, config: &Config) -> f64 {
    let before = finish.before as f64 * 1e-6;
    let after = finish.after.min(finish.before) as f64 * 1e-6;
    let [own, gone] = FINISH;
    let seconds = own * before + gone * (before - after);
    let is_fitted = fit::decided(config, course.triangles_in, finish.after) == Fit::On;
    seconds
        + if is_fitted { FIT * after } else { 0.0 }
        + if config.progressive.is_some() { RECORD * before } else { 0.0 }
}

/// Times as long as a clean surface without attributes.
fn times(source: &MeshSource, config: &Config) -> f64 {
    let schema = source.schema();
    let mut times = match (schema.codec().has_seams(schema), schema.properties.is_empty()) {
        (true, _) => WITH_SEAMS,
        (false, false) => WITH_PROPERTIES,
        (false, true) => 1.0,
    };
    if config.kernel.no_self_intersections {
        times *= APART;
    }
    if config.kernel.bound.is_some() {
        times *= BOUNDED;
    }
    times
}

/// Times as long as on the reference machine a piece of the input takes, by its shape alone. `None` where it says nothing.
fn pace(source: &MeshSource) -> Option<f64> {
    let mesh = piece(source, source.n_face_blocks() / 2, PIECE)?;
    let n = mesh.triangles.len() as f64;
    let stop = Stop::Triangles((n * SAMPLE_RATIO) as u64);
    let options = Options { stop, fit: Fit::Off, ..Options::default() };
    let locked = vec![false; mesh.positions.len()];
    let began = Instant::now();
    kernel::simplify_mesh(mesh, &locked, &options);
    let [own, gone] = FINISH;
    let expected = IN_CACHES * (own + gone * (1.0 - SAMPLE_RATIO)) * n * 1e-6;
    Some((began.elapsed().as_secs_f64() / expected).clamp(*PACES.start(), *PACES.end()))
}
