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
use stonecut::partition;
use stonecut::summary::RunReport;
use stonecut::units::show_count;

/// Bytes a triangle of an input PLY with single-precision positions: 12 for half a vertex, 13 for the face.
const INPUT_BYTES: f64 = 19.0;
/// Triangles in a cell, the program's default.
const CELL_TRIANGLES: u64 = stonecut::config::DEFAULT_CELL_TRIANGLES;
/// Memory of one cell at work, in bytes a triangle: the kernel's peak and the cell as it was loaded.
const CELL_BYTES: f64 = 102.0 + 12.0 + 60.0;
/// More memory than this for the table of cells is not assumed; what exceeds it costs further passes.
const BUDGET_BYTES: u64 = 64 << 30;

/// The measured table and one table a size.
pub fn tables(
    reports: &[PathBuf],
    sizes: &[u64],
    cores: u64,
    measured_cores: u64,
) -> Outcome<String> {
    let mut runs: Vec<RunReport> = Vec::new();
    for path in reports {
        runs.push(serde_json::from_str(&std::fs::read_to_string(path)?)?);
    }
    runs.sort_by_key(|run| run.input.triangles);
    let largest = runs.last().ok_or("no reports")?;
    let mut text = String::from("Measured, core-nanoseconds and bytes an input triangle:\n\n");
    text += &measured(&runs, measured_cores);
    let _ = write!(
        text,
        "\nOn {cores} cores of the same kind, every stage at the speed of the largest run:\n\n"
    );
    let headers = [
        "triangles",
        "input TB",
        "temp TB",
        "partition h",
        "simplify h",
        "stitch h",
        "write h",
        "all h",
        "GB/s in partition",
        "GB/s in simplify",
        "memory at work GiB",
        "table of cells GiB",
        "passes over faces",
    ];
    let rows: Vec<Vec<String>> =
        sizes.iter().map(|&n| forecast(largest, n, cores, measured_cores)).collect();
    text += &table(&headers, &rows);
    Ok(text)
}

/// Wall seconds and bytes moved of a stage; a stage that did not run counts nothing.
fn stage(run: &RunReport, name: &str) -> (f64, f64) {
    run.stages.iter().filter(|stage| stage.name == name).fold((0.0, 0.0), |(s, b), stage| {
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

fn forecast(run: &RunReport, n: u64, cores: u64, measured_cores: u64) -> Vec<String> {
    let scale = n as f64 / run.input.triangles as f64;
    let faster = cores as f64 / measured_cores as f64;
    let seconds = |name: &str| stage(run, name).0 * scale / faster;
    let hours = |seconds: f64| number(Some(seconds / 3600.0));
    let rate = |name: &str| {
        let (_, bytes) = stage(run, name);
        number(Some(bytes * scale / seconds(name) / 1e9))
    };
    let n_cells = n.div_ceil(CELL_TRIANGLES).min(u64::from(u32::MAX)) as u32;
    let n_vertices = n / 2;
    let tables = partition::memory_bytes(n_vertices, n_cells, cores as usize, u64::MAX / 4) as f64;
    let passes = (tables / (BUDGET_BYTES as f64 / 2.0)).ceil().max(1.0);
    let gib = |bytes: f64| number(Some(bytes / f64::from(1 << 30)));
    let all: f64 = STAGES.iter().map(|name| seconds(name)).sum();
    let mut cells = vec![
        show_count(n),
        number(Some(n as f64 * INPUT_BYTES / 1e12)),
        number(Some(run.peak_temp_bytes as f64 * scale / 1e12)),
    ];
    cells.extend(STAGES.map(|name| hours(seconds(name))));
    cells.push(hours(all));
    cells.extend([
        rate("partition"),
        rate("simplify"),
        gib(CELL_TRIANGLES as f64 * CELL_BYTES * cores as f64),
        gib(tables),
        number(Some(passes)),
    ]);
    cells
}
