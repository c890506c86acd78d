//! `bench scaling`: stonecut alone on growing synthetic meshes at a fixed budget.

use crate::Outcome;
use crate::bench::{self, Input, Settings};
use crate::compare::Record;
use crate::page::{count, mib, number, spread, table};
use crate::plot;
use crate::record::{Machine, Row};
use std::fmt::Write;
use std::path::Path;
use stonecut::system::units::{parse_count, show_bytes};

/// What to run.
#[derive(Clone, Debug)]
pub struct Request {
    /// Kinds of synthetic meshes.
    pub kinds: Vec<String>,
    /// Sizes as typed: 1M, 4M.
    pub sizes: Vec<String>,
    /// Numbers of threads.
    pub threads: Vec<u64>,
    /// Share of the input to keep.
    pub ratio: f64,
    /// Also with vertices and faces in random order.
    pub shuffled: bool,
    /// Do not measure the error of inputs above this many triangles.
    pub measure_up_to: u64,
}

/// Disk in bytes that a synthetic mesh and its run take, a triangle: 19 of PLY, 24 of temporary data, a
/// result, and something to spare. Shuffling takes a sorted copy more while the mesh is made.
const DISK_PER_TRIANGLE: u64 = 48;

/// Runs everything; the record is written after every mesh. What the disk cannot hold is a row that says so.
pub fn run(request: &Request, settings: &Settings, out: &Path) -> Outcome<Record> {
    std::fs::create_dir_all(out)?;
    std::fs::create_dir_all(&settings.work)?;
    let mut record = Record { machine: Machine::here(), rows: Vec::new() };
    let orders: &[&str] = if request.shuffled { &["", ":shuffled"] } else { &[""] };
    for kind in &request.kinds {
        for size in &request.sizes {
            for order in orders {
                let spec = format!("{kind}:{size}{order}");
                let n = parse_count(size)?;
                let need = n * DISK_PER_TRIANGLE;
                let free = free_bytes(&settings.work)?;
                if need > free {
                    let trouble = format!(
                        "not run: {} of disk needed, {} free",
                        show_bytes(need),
                        show_bytes(free)
                    );
                    let mesh = spec.replace(':', "_");
                    let peer = "stonecut".to_owned();
                    record.rows.push(Row {
                        mesh,
                        peer,
                        triangles_in: n,
                        trouble,
                        ..Row::default()
                    });
                    continue;
                }
                let input = Input::get(&spec, false, settings)?;
                let target = (input.n_triangles as f64 * request.ratio) as u64;
                let judged = n <= request.measure_up_to;
                record.rows.extend(bench::thread_rows(
                    &input,
                    target,
                    &request.threads,
                    settings,
                    judged,
                )?);
                std::fs::write(out.join("scaling.json"), serde_json::to_string_pretty(&record)?)?;
                input.remove();
            }
        }
    }
    Ok(record)
}

/// Free bytes of the file system that holds `folder`.
pub fn free_bytes(folder: &Path) -> Outcome<u64> {
    let output =
        std::process::Command::new("df").args(["-B1", "--output=avail"]).arg(folder).output()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok(text.split_whitespace().last().unwrap_or_default().parse()?)
}

/// Seconds of a stage by name, over the good runs.
fn stage(row: &Row, name: &str) -> Option<f64> {
    let of = |run: &crate::record::Run| {
        run.stages.iter().filter(|(n, _)| n == name).map(|(_, s)| s).sum::<f64>()
    };
    row.spread(of).map(|s| s.median)
}

/// Writes `scaling.md` and its plots.
pub fn write_page(record: &Record, out: &Path) -> Outcome<()> {
    let mut page =
        format!("# Scaling\n\n`{}`\n\n{}\n\n", record.machine.command, record.machine.words());
    let headers = [
        "mesh",
        "triangles",
        "threads",
        "wall s",
        "ns/tri",
        "M tri/s",
        "CPU s",
        "partition %",
        "simplify %",
        "stitch %",
        "write %",
        "peak RSS MiB",
        "cgroup MiB",
        "temp B/tri",
        "out",
        "RMS / diagonal",
        "non-manifold",
        "components",
        "Euler",
    ];
    let rows: Vec<Vec<String>> = record.rows.iter().map(|row| cells(row, headers.len())).collect();
    page += &table(&headers, &rows);
    page += &threads_table(record);
    plots(record, out)?;
    for name in ["scaling-time", "scaling-memory", "scaling-temp", "scaling-stages"] {
        let _ = write!(page, "\n![{name}]({name}.svg)\n");
    }
    std::fs::write(out.join("scaling.md"), page)?;
    Ok(())
}

fn cells(row: &Row, n_columns: usize) -> Vec<String> {
    let mut cells = vec![row.mesh.clone(), count(row.triangles_in), row.threads.to_string()];
    if !row.trouble.is_empty() {
        cells.push(row.trouble.clone());
        cells.resize(n_columns, String::new());
        return cells;
    }
    let n = row.triangles_in as f64;
    let wall = row.spread(|run| run.usage.wall);
    let median = wall.map(|s| s.median);
    let share = |name: &str| {
        let total: f64 = ["partition", "simplify", "stitch", "write"]
            .iter()
            .filter_map(|name| stage(row, name))
            .sum();
        number(stage(row, name).map(|s| 100.0 * s / total))
    };
    cells.extend([
        spread(wall),
        number(median.map(|s| s / n * 1e9)),
        number(median.map(|s| n / s / 1e6)),
        spread(row.spread(|run| run.usage.user + run.usage.system)),
        share("partition"),
        share("simplify"),
        share("stitch"),
        share("write"),
        mib(row.spread(|run| run.usage.rss_bytes as f64).map(|s| s.max)),
        mib(row.spread(|run| run.usage.cgroup_bytes.unwrap_or(0) as f64).map(|s| s.max)),
        number(row.spread(|run| run.usage.temp_bytes as f64 / n).map(|s| s.max)),
    ]);
    match &row.quality {
        Some(q) => cells.extend([
            count(q.after.triangles),
            format!("{:.3e}", q.rms / q.diagonal),
            count(q.after.non_manifold_edges),
            count(q.after.components),
            q.after.euler_characteristic.to_string(),
        ]),
        None => cells.resize(n_columns, "-".to_owned()),
    }
    cells
}

/// What more threads bring, stage by stage.
fn threads_table(record: &Record) -> String {
    let mut rows = Vec::new();
    for one in record.rows.iter().filter(|row| row.threads == 1) {
        for many in record.rows.iter().filter(|r| r.mesh == one.mesh && r.threads > 1) {
            let ratio = |name: &str| match (stage(one, name), stage(many, name)) {
                (Some(a), Some(b)) if b > 0.0 => number(Some(a / b)),
                _ => "-".to_owned(),
            };
            let whole = match (one.triangles_per_second(), many.triangles_per_second()) {
                (Some(a), Some(b)) => number(Some(b / a)),
                _ => "-".to_owned(),
            };
            let mut cells = vec![one.mesh.clone(), many.threads.to_string(), whole];
            cells.extend(["partition", "simplify", "stitch", "write"].map(ratio));
            rows.push(cells);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let headers = ["mesh", "threads", "all", "partition", "simplify", "stitch", "write"];
    format!("\n## Times as fast as with one thread\n\n{}", table(&headers, &rows))
}

fn plots(record: &Record, out: &Path) -> Outcome<()> {
    let series = |y: &dyn Fn(&Row) -> Option<f64>| {
        let mut all: Vec<plot::Series> = Vec::new();
        for row in &record.rows {
            let kind = row.mesh.split('_').next().unwrap_or_default();
            let order = if row.mesh.ends_with("_shuffled") { " shuffled" } else { "" };
            let name = format!("{kind}{order}, {} threads", row.threads);
            let Some(y) = y(row) else { continue };
            let point = (row.triangles_in as f64, y);
            match all.iter_mut().find(|(known, _)| *known == name) {
                Some((_, points)) => points.push(point),
                None => all.push((name, vec![point])),
            }
        }
        all
    };
    let time = series(&|row| Some(1e9 / row.triangles_per_second()?));
    let title = "Time, end to end";
    plot::lines(&out.join("scaling-time.svg"), title, "triangles", "ns a triangle", &time)?;
    let rss = |row: &Row| Some(row.spread(|r| r.usage.rss_bytes as f64)?.max / f64::from(1 << 20));
    let title = "Peak resident memory";
    plot::lines(&out.join("scaling-memory.svg"), title, "triangles", "MiB", &series(&rss))?;
    let temp = series(&|row| {
        Some(row.spread(|run| run.usage.temp_bytes as f64)?.max / row.triangles_in as f64)
    });
    let title = "Peak temporary disk";
    plot::lines(&out.join("scaling-temp.svg"), title, "triangles", "bytes a triangle", &temp)?;
    let most = record.rows.iter().map(|row| row.threads).max();
    let bars: Vec<plot::Bar> = record
        .rows
        .iter()
        .filter(|row| Some(row.threads) == most && row.trouble.is_empty())
        .map(|row| {
            let names = ["partition", "simplify", "stitch", "write"];
            let n = row.triangles_in as f64;
            let parts = names
                .iter()
                .filter_map(|name| Some(((*name).to_owned(), stage(row, name)? / n * 1e9)));
            (row.mesh.clone(), parts.collect())
        })
        .collect();
    plot::bars(&out.join("scaling-stages.svg"), "Time by stage", "ns a triangle", &bars)
}
