//! A job in units that any number of machines work on; the same stages as in one process, the same bytes.
//!
//! `freeze` decides everything once and writes it down, `work` does one unit, any number of times, anywhere. Units of one
//! phase depend on earlier phases alone; what a phase hands on stands in the records of its units (`store/job/units`). Who
//! starts the units, where and in which order, is up to an engine outside of this program.
//!
//! docs/design/cluster.md, docs/cluster.md.

mod kind;
mod parts;
mod phases;
mod rounds;
mod standing;
mod task;

pub use crate::store::job::units::{Frozen, Unit};
pub use standing::{Standing, standing};
pub use task::Task;

use super::plan::Plan;
use super::prepare;
use super::run_report::RunReport;
use crate::config::{Config, Method, Texture};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::stages::partition::is_local;
use crate::stages::simplify::pilot_cells;
use crate::stages::stitch::{NextStep, next_step};
use crate::store::job::fingerprint::{job_identity, marks_now};
use crate::store::job::units::{Phase, Record, UnitJob};
use crate::system::disk::Disk;
use crate::system::parallel::guarded;
use crate::system::pending_file::Seen;
use crate::system::program;
use crate::system::progress::Progress;
use kind::Kind;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Duration;
use xxhash_rust::xxh3::xxh3_64;

/// Units of the phase `simplify` for each unit that was asked for, so that they can be shared out evenly: at most this
/// many, as long as each has this number of cells. A cell takes 0.06 s, a unit 0.03 s to begin and to end.
const PIECES: u32 = 4;
const CELLS_OF_A_PIECE: u32 = 8;

/// The most units that may be asked for.
pub const MOST_UNITS: u32 = 2000;

/// Triangles of the input for each part of the partition: five phases more, each with 0.1 s to begin and to end, pay only if
/// a part is 0.7 s of work.
const TRIANGLES_OF_A_PART: u64 = 16_000_000;

/// The most parts where faces use vertices from everywhere: each part looks up all vertices then.
const PARTS_IN_NO_ORDER: u32 = 4;

/// Pieces that a job is cut into.
#[derive(Clone, Copy, Debug)]
pub struct Pieces {
    /// About as many as there are machines.
    pub units: u32,
    /// Parts of the partition, if that is not left to the program.
    pub parts: Option<u32>,
}

/// Decides everything about a job and writes it down; nothing is done yet. Called again with the same words it changes
/// nothing.
///
/// `words` are those of the command, given in the folder `here`; `config.job_folder` is the folder of units.
pub fn freeze(
    folder: &Path,
    said: (Vec<String>, PathBuf),
    config: &Config,
    pieces: Pieces,
    disk: &Disk,
) -> Result<Frozen> {
    freeze_with(folder, (said, None), config, pieces, disk)
}

/// The same, with the file for the report as it was found.
pub fn freeze_with(
    folder: &Path,
    ((words, here), report): ((Vec<String>, PathBuf), Option<Seen>),
    config: &Config,
    pieces: Pieces,
    disk: &Disk,
) -> Result<Frozen> {
    refuse(config)?;
    let prepared = prepare(config)?;
    let plan = &prepared.plan;
    let cut = cut(n_parts(&prepared.source, pieces)?, &planned_rounds(plan, config, pieces.units));
    let phase = |(i, (name, units, share)): (usize, &(String, u32, f64))| Phase {
        name: name.clone(),
        units: *units,
        after: cut[..i].last().map(|(before, ..)| before.clone()).into_iter().collect(),
        memory: plan.needed_memory_bytes,
        seconds: plan.seconds * config.threads.get() as f64 * share / f64::from(*units),
    };
    let frozen = Frozen {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        program: program::checksum()?,
        program_mark: program::mark(),
        words,
        folder: here,
        settings: settings_checksum(config),
        identity: job_identity(&prepared.source, &prepared.marks, config),
        triangles: plan.triangles_in,
        phases: cut.iter().enumerate().map(phase).collect(),
        report,
    };
    UnitJob::new(folder, disk, Duration::ZERO).freeze(&frozen)?;
    Ok(frozen)
}

/// A round that is done in units.
#[derive(Clone, Copy, Debug)]
struct PlannedRound {
    /// Units of its pilot, and of its batches.
    pilot: u32,
    batches: u32,
    /// True if a total is to be met, which takes a trial.
    is_exact: bool,
}

/// All phases with their units, and the share of the time that each takes.
fn cut(parts: u32, rounds: &[PlannedRound]) -> Vec<(String, u32, f64)> {
    let of_parts = [
        ("scan", parts, 0.01),
        ("tree", 1, 0.01),
        ("scatter", parts, 0.12),
        ("share", parts, 0.01),
    ];
    let of_parts = of_parts.into_iter().filter(|_| parts > 1);
    let partition = ("partition", 1, if parts > 1 { 0.01 } else { 0.15 });
    let named = |(name, units, share): (&str, u32, f64)| (name.to_owned(), units, share);
    let of_round = |(number, round): (u32, &PlannedRound)| {
        let batches = if number == 0 { 0.6 } else { 0.06 };
        let phases = [
            (Kind::Recut, u32::from(number > 0), 0.02),
            (Kind::Pilot, round.pilot, 0.04),
            (Kind::Trial, if round.is_exact { round.batches } else { 0 }, batches),
            (Kind::Batch, round.batches, batches),
        ];
        let phases = phases.into_iter().filter(|(_, units, _)| *units > 0);
        phases.map(move |(kind, units, share)| (kind.of_round(number), units, share))
    };
    let last = [("finish", 1, 0.06), ("rest", 1, 0.01)];
    let first = of_parts.chain(std::iter::once(partition)).map(named);
    let rounds = (0..).zip(rounds).flat_map(of_round);
    first.chain(rounds).chain(last.map(named)).collect()
}

/// The rounds, as far as they can be told from counts. Later ones have a unit for a cell, at most as many as were asked for;
/// with one unit they are left to `finish`.
fn planned_rounds(plan: &Plan, config: &Config, units: u32) -> Vec<PlannedRound> {
    let (mut now, mut rounds) = (plan.triangles_in, Vec::new());
    let most = if units == 1 { 1 } else { u32::MAX };
    for round in 0..most {
        let step = next_step(now, plan.target, config.cell_triangles, round);
        let (goal, is_exact) = match step {
            NextStep::Round(goal) => (goal, false),
            NextStep::ExactRound => (plan.target, true),
            NextStep::Finish | NextStep::Done => break,
        };
        let cells = match round {
            0 => plan.cells,
            _ => now.div_ceil(config.cell_triangles).min(u64::from(u32::MAX)) as u32,
        };
        let batches = match round {
            // As many for each of the units that were asked for.
            0 => units * (cells / CELLS_OF_A_PIECE / units).clamp(1, PIECES),
            _ => cells.min(units),
        };
        let pilot = (pilot_cells(cells as usize).len() as u32).min(units);
        rounds.push(PlannedRound { pilot, batches, is_exact });
        now = goal.min(now);
    }
    rounds
}

/// The number of parts of the partition. What has to be unpacked, converted or scanned first is not cut: each part would do all of that.
fn n_parts(source: &MeshSource, pieces: Pieces) -> Result<u32> {
    if !source.is_read_in_place() {
        return Ok(1);
    }
    let most = if is_local(source)? { pieces.units } else { pieces.units.min(PARTS_IN_NO_ORDER) };
    let enough = source.n_triangles() / TRIANGLES_OF_A_PART;
    Ok(pieces.parts.unwrap_or_else(|| enough.clamp(1, u64::from(most)) as u32))
}

/// Checksum of all settings but those of a machine.
fn settings_checksum(config: &Config) -> String {
    let config = Config { memory_bytes: 0, threads: NonZeroUsize::MIN, ..config.clone() };
    format!("{:016x}", xxh3_64(format!("{config:?}").as_bytes()))
}

/// Refuses what needs several runs, or leaves files that no unit has a place for.
fn refuse(config: &Config) -> Result<()> {
    let refused = [
        (config.method != Method::Collapse, "--method"),
        (config.kernel.bound.is_some(), "--max-error"),
        (config.job.until.is_some(), "--until"),
        (config.job.restart, "--restart"),
        (config.job.keep_temp, "--keep-temp"),
        (config.texture == Texture::Bake, "--texture bake"),
        (config.bake.normals, "--bake-normals"),
        (config.progressive.is_some(), "--progressive"),
        (config.map.is_some(), "--map"),
        (config.checks.seams.is_some(), "--seams"),
        (config.optimize.is_some(), "--optimize"),
        (config.pairs, "--pairs"),
        (config.input == Path::new("-"), "standard input"),
        (config.output == Path::new("-"), "standard output"),
    ];
    match refused.iter().find(|(is_asked, _)| *is_asked) {
        Some((_, name)) => Err(Error::Usage(format!(
            "{name} is not for a job in units; run 'stonecut simplify' on one machine"
        ))),
        None => Ok(()),
    }
}

/// Outcome of `work`.
#[derive(Debug)]
pub enum Done {
    /// The unit was done before, or another process was faster.
    Before,
    /// It is done now. The last unit has the report of the run.
    Now(Option<Box<RunReport>>),
}

/// Does one unit. `config.job_folder` is the folder of units.
///
/// Errors: those of the stages; `StateMismatch` for another program than that of the plan, or another input; `Usage`
/// for a unit that the plan does not have; `Io` if an earlier phase is not over.
pub fn work(task: &Task, config: &Config, disk: &Disk, progress: &Progress) -> Result<Done> {
    let Task { folder, frozen, unit, patience, mends } = task;
    let program = match program::mark() {
        Some(mark) if frozen.program_mark.as_ref() == Some(&mark) => frozen.program.clone(),
        _ => program::checksum()?,
    };
    frozen.check_program(folder, env!("CARGO_PKG_VERSION"), &program)?;
    if frozen.phase(&unit.phase).is_none_or(|phase| unit.index >= phase.units) {
        let phases = frozen.phases.iter().map(|p| format!("{}/0 to {}", p.name, p.units - 1));
        let known = phases.collect::<Vec<_>>().join(", ");
        return Err(Error::Usage(format!("the plan has no unit {unit}: {known}")));
    }
    let job = UnitJob::new(folder, disk, *patience);
    match job.record(unit) {
        Ok(Some(record)) if !mends || phases::is_whole(&job, frozen, &record)? => {
            // The last one may have been killed after it had published its record.
            if phases::is_last(unit) {
                job.clear()?;
            }
            return Ok(Done::Before);
        }
        Ok(Some(_)) => job.withdraw(unit)?,
        Err(Error::Corrupt { .. }) if *mends => job.withdraw(unit)?,
        // Half a record that somebody writes now, or that a death has left there.
        Err(Error::Corrupt { .. }) | Ok(None) => {}
        Err(error) => return Err(error),
    }
    check_input(folder, frozen, config)?;
    check_memory(frozen, unit, config)?;
    let outcome = guarded(|| attempt(&job, task, config, progress));
    match outcome {
        Ok(done) => Ok(done),
        // Another attempt has won, and what this one was reading may be gone.
        Err(_) if job.record(unit).is_ok_and(|record| record.is_some()) => Ok(Done::Before),
        Err(error) => Err(job.explain(error, frozen)),
    }
}

fn attempt(job: &UnitJob, task: &Task, config: &Config, progress: &Progress) -> Result<Done> {
    let (began, processor) = (program::now(), program::processor_seconds());
    let disk = job.disk();
    let (read, written) = (disk.bytes_read(), disk.bytes_written());
    let attempt = job.attempt(task.unit);
    let (found, report) = phases::run(job, &attempt, task, config, progress)?;
    let record = Record {
        span: [began, program::now()],
        processor_seconds: program::processor_seconds() - processor,
        bytes_read: disk.bytes_read() - read,
        bytes_written: disk.bytes_written() - written,
        peak_memory_bytes: crate::system::memory::peak_bytes(),
        ..found
    };
    if !attempt.publish(record)? {
        return Ok(Done::Before);
    }
    if phases::is_last(task.unit) {
        job.clear()?;
    }
    Ok(Done::Now(report.map(Box::new)))
}

/// Refuses an input that is not the one that was planned for.
fn check_input(folder: &Path, frozen: &Frozen, config: &Config) -> Result<()> {
    let planned = &frozen.identity.input_marks;
    let differs = |(name, value): (&String, &String)| {
        let before = planned.get(name).filter(|before| *before != value)?;
        Some(format!("{name} {value} instead of {before}"))
    };
    let marks = marks_now(&config.input, planned)?;
    let differences: Vec<String> = marks.iter().filter_map(differs).collect();
    if differences.is_empty() {
        return Ok(());
    }
    Err(Error::StateMismatch {
        path: folder.into(),
        what: format!(
            "{} is not the input that was planned ({}); plan again in another folder",
            config.input.display(),
            differences.join(", ")
        ),
    })
}

/// Refuses a worker that is too small.
fn check_memory(frozen: &Frozen, unit: &Unit, config: &Config) -> Result<()> {
    use crate::system::units::show_bytes;
    let needed = frozen.phase(&unit.phase).map_or(0, |phase| phase.memory);
    if config.memory_bytes >= needed {
        return Ok(());
    }
    Err(Error::NoMemory(format!(
        "{unit} needs {} of memory, this worker has {}; give it at least --memory {}MiB, or plan again with smaller \
         --cell-triangles",
        show_bytes(needed),
        show_bytes(config.memory_bytes),
        needed.div_ceil(1 << 20)
    )))
}
