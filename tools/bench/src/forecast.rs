//! `bench forecast`: what sizes beyond this machine would take, from reports of runs that were made here.
//!
//! Every stage is linear in the input at a fixed share of triangles to keep: each passes over its data a
//! fixed number of times, in cells of a fixed size. So a stage's seconds and bytes a triangle are taken from
//! the largest run, and the check that they are steady is the table of all runs. docs/scaling.md argues and
//! has the result.

use crate::Outcome;
use crate::page::{number, table};
use std::fmt::Write;
use std::path::PathBuf;
use stonecut::pipeline::run_report::RunReport;
use stonecut::system::units::{show_bytes, show_count};

/// Bytes of a position in single precision; there are half as many vertices as triangles.
const POSITION_BYTES: f64 = 12.0;
/// Chunk headers, shared rows and blocks of the file system on top of bare rows, as in the program's own plan.
const PACK_OVERHEAD: f64 = 1.06;
/// Triangles in a cell, the program's default.
const CELL_TRIANGLES: u64 = stonecut::config::DEFAULT_CELL_TRIANGLES;
/// Memory of one cell at work, in bytes a triangle: the kernel's peak and the cell as it was loaded.
const CELL_BYTES: f64 = 102.0 + 12.0 + 60.0;

/// The machine to plan for.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Its cores.
    pub cores: u64,
    /// Cores that the reports were made with.
    pub measured_cores: u64,
    /// Its memory; a table of cells beyond half of it costs further passes over the faces.
    pub memory_bytes: u64,
    /// Bytes a second that its disks move, reading and writing at once.
    pub bytes_per_second: f64,
}

/// Bytes of an index: PLY's and the cells' 4 reach to 2^32 vertices.
fn index_bytes(n_triangles: u64) -> f64 {
    if n_triangles / 2 <= u64::from(u32::MAX) { 4.0 } else { 8.0 }
}

fn input_bytes(n_triangles: u64) -> f64 {
    let index = index_bytes(n_triangles);
    n_triangles as f64 * (POSITION_BYTES / 2.0 + 1.0 + 3.0 * index)
}

fn temp_bytes(n_triangles: u64) -> f64 {
    let index = index_bytes(n_triangles);
    n_triangles as f64 * ((POSITION_BYTES + index) / 2.0 + 3.0 * index) * PACK_OVERHEAD
}

/// The measured table and one table a size.
pub fn tables(reports: &[PathBuf], sizes: &[u64], machine: Machine) -> Outcome<String> {
    let mut runs: Vec<RunReport> = Vec::new();
    for path in reports {
        runs.push(serde_json::from_str(&std::fs::read_to_string(path)?)?);
    }
    runs.sort_by_key(|run| run.input.triangles);
    let largest = runs.last().ok_or("no reports")?;
    let mut text = String::from("Measured, core-nanoseconds and bytes an input triangle:\n\n");
    text += &measured(&runs, machine.measured_cores);
    let _ = write!(
        text,
        "\n{} cores of the same kind, {} of memory, disks that move {} GB/s; every stage as in the largest run:\n\n",
        machine.cores,
        show_bytes(machine.memory_bytes),
        number(Some(machine.bytes_per_second / 1e9))
    );
    let headers = [
        "triangles",
        "input TB",
        "temp TB",
        "partition min",
        "simplify min",
        "stitch min",
        "write min",
        "all min",
        "TB moved",
        "memory at work GiB",
        "table of cells GiB",
        "passes over faces",
        "chunk KiB",
    ];
    let rows: Vec<Vec<String>> = sizes.iter().map(|&n| forecast(largest, n, machine)).collect();
    text += &table(&headers, &rows);
    Ok(text)
}

/// Wall seconds and bytes moved of a stage; a stage that did not run counts nothing.
fn stage(run: &RunReport, name: &str) -> (f64, f64) {
    run.stages.iter().filter(|stage| stage.part() == name).fold((0.0, 0.0), |(s, b), stage| {
        (s + stage.seconds, b + (stage.bytes_read + stage.bytes_written) as f64)
    })
}

const STAGES: [&str; 4] = ["partition", "simplify", "stitch", "write"];

fn measured(runs: &[RunReport], cores: u64) -> String {
    let rows: Vec<Vec<String>> = runs
        .iter()
        .map(|run| {
            let n = run.input.triangles as f64;
            let mut cells = vec![show_count(run.input.triangles)];
            for name in STAGES {
                let (seconds, bytes) = stage(run, name);
                cells.push(number(Some(seconds * cores as f64 / n * 1e9)));
                cells.push(number(Some(bytes / n)));
            }
            cells.push(number(Some(run.peak_temp_bytes as f64 / n)));
            cells
        })
        .collect();
    let headers = [
        "triangles",
        "partition ns",
        "B",
        "simplify ns",
        "B",
        "stitch ns",
        "B",
        "write ns",
        "B",
        "temp B",
    ];
    table(&headers, &rows)
}

fn forecast(run: &RunReport, n: u64, machine: Machine) -> Vec<String> {
    let scale = n as f64 / run.input.triangles as f64;
    let faster = machine.cores as f64 / machine.measured_cores as f64;
    // Wider indices move more bytes.
    let wider = temp_bytes(n) / temp_bytes(run.input.triangles) / scale;
    let n_cells = n.div_ceil(CELL_TRIANGLES).min(u64::from(u32::MAX)) as u32;
    // As src/stages/partition/cell_table.rs and src/store/cells/scatter.rs have it.
    let tables = (n / 2) as f64 * if n_cells <= 1 << 16 { 2.0 } else { 4.0 };
    let chunk = (machine.memory_bytes as f64 / 6.0 / f64::from(n_cells)).clamp(4096.0, 262_144.0);
    let passes = (tables / (machine.memory_bytes as f64 / 2.0)).ceil().max(1.0);
    let gib = |bytes: f64| number(Some(bytes / f64::from(1 << 30)));
    let bytes = |name: &str| {
        // Every further window reads positions and faces again.
        let again = if name == "partition" { (passes - 1.0) * input_bytes(n) } else { 0.0 };
        stage(run, name).1 * scale * wider + again
    };
    let computing = |name: &str| stage(run, name).0 * scale / faster;
    let moving = |name: &str| bytes(name) / machine.bytes_per_second;
    let seconds = |name: &str| computing(name).max(moving(name));
    let minutes = |seconds: f64| number(Some(seconds / 60.0));
    let bound = |name: &str| {
        let by = if moving(name) > computing(name) { "disk" } else { "cores" };
        format!("{} ({by})", minutes(seconds(name)))
    };
    let all: f64 = STAGES.iter().map(|name| seconds(name)).sum();
    let mut cells = vec![
        show_count(n),
        number(Some(input_bytes(n) / 1e12)),
        number(Some(temp_bytes(n) / 1e12)),
    ];
    cells.extend(STAGES.map(bound));
    cells.push(minutes(all));
    cells.extend([
        number(Some(STAGES.iter().map(|name| bytes(name)).sum::<f64>() / 1e12)),
        gib(CELL_TRIANGLES as f64 * CELL_BYTES * machine.cores as f64),
        gib(tables),
        format!("{passes}"),
        format!("{:.0}", chunk / 1024.0),
    ]);
    cells
}
