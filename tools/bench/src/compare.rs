//! `bench compare` and `bench kernel-tables`: tools side by side, as JSON, Markdown and plots.

use crate::Outcome;
use crate::bench::{self, Input, Settings};
use crate::page::{cost_table, count, extra_bytes, number, quality_table, table};
use crate::peers::Peer;
use crate::plot;
use crate::record::{Machine, Row};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::Path;

/// All that was measured.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Record {
    /// Where and how.
    pub machine: Machine,
    /// One row a mesh, target and tool.
    pub rows: Vec<Row>,
}

/// Which tools on which meshes to which shares.
#[derive(Clone, Debug)]
pub struct Request {
    /// Files, or KIND:TRIANGLES.
    pub meshes: Vec<String>,
    /// Shares of the input's triangles.
    pub ratios: Vec<f64>,
    /// The tools.
    pub peers: Vec<Peer>,
}

/// Runs everything; writes `compare.json` after every mesh, so that a stopped session keeps its results.
pub fn run(request: &Request, settings: &Settings, out: &Path) -> Outcome<Record> {
    std::fs::create_dir_all(out)?;
    let mut record = Record { machine: Machine::here(), rows: Vec::new() };
    for spec in &request.meshes {
        let input = Input::get(spec, true, settings)?;
        for ratio in &request.ratios {
            let target = (input.n_triangles as f64 * ratio) as u64;
            record.rows.extend(bench::rows(&input, target, &request.peers, settings)?);
            std::fs::write(out.join("compare.json"), serde_json::to_string_pretty(&record)?)?;
        }
        input.remove();
    }
    Ok(record)
}

/// Writes `compare.md` and its plots.
pub fn write_page(record: &Record, out: &Path) -> Outcome<()> {
    let mut page = format!(
        "# Side by side\n\n`{}`\n\n{}\n{ABOUT}",
        record.machine.command,
        record.machine.words()
    );
    plots(record, out)?;
    for name in ["throughput", "memory", "stages"] {
        if out.join(format!("{name}.svg")).is_file() {
            let _ = write!(page, "\n![{name}]({name}.svg)\n");
        }
    }
    for mesh in meshes(record) {
        let rows: Vec<&Row> = record.rows.iter().filter(|row| row.mesh == mesh).collect();
        let n = rows.first().map_or(0, |row| row.triangles_in);
        let _ = write!(page, "\n## {mesh}: {} triangles\n\n", count(n));
        let _ = write!(page, "{}\n{}", cost_table(&rows), quality_table(&rows));
        let plot = format!("error-{mesh}.svg");
        if out.join(&plot).is_file() {
            let _ = write!(page, "\n![error]({plot})\n");
        }
    }
    std::fs::write(out.join("compare.md"), page)?;
    Ok(())
}

const ABOUT: &str = "
Each run is a process of its own; tools take turns. Wall, user and system time are of the whole process, reading and
writing included (stonecut: PLY; the others: raw arrays, which cost next to nothing). *Alone* is the simplification
by itself: input triangles per second of CPU time of all its threads. Medians; in brackets the least and the largest.
*B/tri beyond input*: peak memory beyond the raw arrays, the tool's own structures included. Rows marked \\* were run
in an earlier session. *Facing against*: result triangles whose normal opposes that of the original triangle nearest
to their centroid. RMS is two-sided; p99.9 and max are the larger of the two directions.
docs/design/bench.md has the definitions.
";

fn meshes(record: &Record) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for row in &record.rows {
        if !names.contains(&row.mesh.as_str()) {
            names.push(&row.mesh);
        }
    }
    names
}

/// Points of every tool, ascending in x.
fn series(rows: &[&Row], point: impl Fn(&Row) -> Option<(f64, f64)>) -> Vec<plot::Series> {
    let mut all: Vec<plot::Series> = Vec::new();
    for row in rows {
        let Some(point) = point(row) else { continue };
        match all.iter_mut().find(|(name, _)| *name == row.peer) {
            Some((_, points)) => points.push(point),
            None => all.push((row.peer.clone(), vec![point])),
        }
    }
    for (_, points) in &mut all {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    all
}

fn plots(record: &Record, out: &Path) -> Outcome<()> {
    // Sizes are compared at the first ratio alone, or every size would have several points.
    let share = |row: &Row| row.target as f64 / row.triangles_in.max(1) as f64;
    let first = record.rows.first().map_or(0.0, share);
    let rows: Vec<&Row> =
        record.rows.iter().filter(|row| (share(row) / first - 1.0).abs() < 0.05).collect();
    let size = |row: &Row| row.triangles_in as f64;
    let speed = series(&rows, |row| Some((size(row), row.triangles_per_second()? / 1e6)));
    let title = "Throughput, end to end";
    plot::lines(&out.join("throughput.svg"), title, "triangles", "M triangles/s", &speed)?;
    let memory = series(&rows, |row| {
        let peak = row.spread(|run| run.usage.rss_bytes as f64)?.median;
        Some((size(row), peak / f64::from(1 << 20)))
    });
    plot::lines(&out.join("memory.svg"), "Peak resident memory", "triangles", "MiB", &memory)?;
    let bars: Vec<plot::Bar> = record
        .rows
        .iter()
        .filter(|row| row.peer == "stonecut")
        .filter_map(|row| {
            let stages = &row.good().next()?.stages;
            let label = format!("{} {:.3}%", row.mesh, 100.0 * share(row));
            let n = row.triangles_in as f64;
            Some((label, stages.iter().map(|(s, t)| (s.clone(), t / n * 1e9)).collect()))
        })
        .collect();
    plot::bars(&out.join("stages.svg"), "stonecut: time by stage", "ns a triangle", &bars)?;
    for mesh in meshes(record) {
        let rows: Vec<&Row> = record.rows.iter().filter(|row| row.mesh == mesh).collect();
        let error = series(&rows, |row| {
            Some((row.quality.as_ref()?.after.triangles as f64, row.relative_rms()?))
        });
        let path = out.join(format!("error-{mesh}.svg"));
        plot::lines(&path, &format!("{mesh}: error"), "triangles", "RMS / diagonal", &error)?;
    }
    Ok(())
}

/// Writes `kernel-tables.md`: one kernel against everything else, as ratios.
pub fn write_kernel_page(record: &Record, own: &str, out: &Path) -> Outcome<()> {
    let mut page = format!(
        "# The kernel against its peers\n\n`{}`\n\n{}\n",
        record.machine.command,
        record.machine.words()
    );
    let mut others: Vec<&str> = Vec::new();
    for row in record.rows.iter().filter(|row| row.peer != own && row.peer != "stonecut") {
        if !others.contains(&row.peer.as_str()) {
            others.push(&row.peer);
        }
    }
    for own in [own, "kernel-fit"] {
        if own_rows(record, own).next().is_some() {
            page += &error_ratios(record, own, &others);
        }
    }
    page += "\n## Speed: million input triangles per second and core, the simplification alone\n\n";
    page += &absolute(record, own, &others, |row| {
        number(row.core_seconds().map(|s| row.triangles_in as f64 / s.median / 1e6))
    });
    page += "\n## Memory: bytes an input triangle beyond the input arrays, at the peak\n\n";
    page += &absolute(record, own, &others, |row| number(extra_bytes(row)));
    page += "\n## Triangles facing against the original\n\n";
    page += &absolute(record, own, &others, |row| {
        let n = row.quality.as_ref().and_then(|q| q.facing_against);
        n.map_or_else(|| "-".to_owned(), count)
    });
    page += "\n## Non-manifold edges, components, Euler characteristic, open edges\n\n";
    page += &topology(record, own, &others);
    std::fs::write(out.join("kernel-tables.md"), page)?;
    Ok(())
}

fn error_ratios(record: &Record, own: &str, others: &[&str]) -> String {
    let others: Vec<&str> = others.iter().copied().filter(|peer| *peer != own).collect();
    let heading = format!(
        "\n## Error: `{own}` / peer, as RMS, p99.9, max\n\nBelow 1 ours is better. In brackets: the peer's \
         triangles where they differ from ours by more than 1 %.\n\n"
    );
    let ratios = matrix(record, own, &others, |mine, peer| {
        let (Some(a), Some(b)) = (&mine.quality, &peer.quality) else {
            return peer.trouble.clone();
        };
        let ratio = |x: f64, y: f64| format!("{:.3}", x / y);
        let (n, m) = (a.after.triangles as f64, b.after.triangles as f64);
        let remark = if (m / n - 1.0).abs() > 0.01 {
            format!(" ({})", count(b.after.triangles))
        } else {
            String::new()
        };
        let three = [ratio(a.rms, b.rms), ratio(a.p999, b.p999), ratio(a.max, b.max)];
        format!("{}{remark}", three.join(", "))
    });
    heading + &ratios
}

fn own_rows<'a>(record: &'a Record, own: &'a str) -> impl Iterator<Item = &'a Row> {
    record.rows.iter().filter(move |row| row.peer == own)
}

fn of<'a>(record: &'a Record, mine: &Row, peer: &str) -> Option<&'a Row> {
    record
        .rows
        .iter()
        .find(|row| row.mesh == mine.mesh && row.target == mine.target && row.peer == peer)
}

fn share(row: &Row) -> String {
    format!(
        "{} %",
        number(Some((1e4 * row.target as f64 / row.triangles_in as f64).round() / 100.0))
    )
}

/// Own RMS, then a cell for each of the others.
fn matrix(
    record: &Record,
    own: &str,
    others: &[&str],
    cell: impl Fn(&Row, &Row) -> String,
) -> String {
    let headers: Vec<&str> =
        ["mesh", "target", "RMS / diagonal"].into_iter().chain(others.iter().copied()).collect();
    let rows: Vec<Vec<String>> = own_rows(record, own)
        .map(|mine| {
            let rms = mine.relative_rms().map_or(mine.trouble.clone(), |v| format!("{v:.3e}"));
            let mut cells = vec![mine.mesh.clone(), share(mine), rms];
            cells.extend(others.iter().map(|peer| {
                of(record, mine, peer).map_or_else(String::new, |row| cell(mine, row))
            }));
            cells
        })
        .collect();
    table(&headers, &rows)
}

/// A cell for the kernel and for each of the others.
fn absolute(record: &Record, own: &str, others: &[&str], cell: impl Fn(&Row) -> String) -> String {
    let headers: Vec<&str> =
        ["mesh", "target", own].into_iter().chain(others.iter().copied()).collect();
    let show = |row: &Row| if row.trouble.is_empty() { cell(row) } else { row.trouble.clone() };
    let rows: Vec<Vec<String>> = own_rows(record, own)
        .map(|mine| {
            let mut cells = vec![mine.mesh.clone(), share(mine), show(mine)];
            cells.extend(others.iter().map(|p| of(record, mine, p).map_or_else(String::new, show)));
            cells
        })
        .collect();
    table(&headers, &rows)
}

fn topology(record: &Record, own: &str, others: &[&str]) -> String {
    let headers: Vec<&str> =
        ["mesh", "target", "before", own].into_iter().chain(others.iter().copied()).collect();
    let words = |t: &stonecut::mesh::topology_counts::Topology| {
        let four = [t.non_manifold_edges, t.components].map(count).join(", ");
        format!("{four}, {}, {}", t.euler_characteristic, count(t.boundary_edges))
    };
    let after =
        |row: &Row| row.quality.as_ref().map_or_else(|| row.trouble.clone(), |q| words(&q.after));
    let rows: Vec<Vec<String>> = own_rows(record, own)
        .map(|mine| {
            let before = mine.quality.as_ref().map_or_else(String::new, |q| words(&q.before));
            let mut cells = vec![mine.mesh.clone(), share(mine), before, after(mine)];
            cells
                .extend(others.iter().map(|p| of(record, mine, p).map_or_else(String::new, after)));
            cells
        })
        .collect();
    table(&headers, &rows)
}
