//! `bench billion`: one connected mesh of a billion triangles, inside a memory cgroup, as one page.

use crate::Outcome;
use crate::child::{self, Ending, Job};
use crate::judge::{self, judge};
use crate::page::{count, mib, number, table};
use crate::peers::Places;
use crate::record::{Machine, Quality};
use crate::scaling::free_bytes;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use stonecut::pipeline::run_report::RunReport;
use stonecut::system::units::{show_bytes, show_count};

/// What to run.
#[derive(Clone, Debug)]
pub struct Request {
    /// Programs.
    pub places: Places,
    /// Kind of synthetic mesh.
    pub kind: String,
    /// Triangles wanted.
    pub n_triangles: u64,
    /// Targets, one run each.
    pub targets: Vec<u64>,
    /// Given to `--memory`.
    pub memory_bytes: u64,
    /// Limit of the cgroup.
    pub limit_bytes: u64,
    /// Given to `--threads`; `None`: its default.
    pub threads: Option<u64>,
    /// Scratch space.
    pub work: PathBuf,
    /// Samples a side for the error; 0: the error is not measured.
    pub samples: u64,
    /// Whether the input stays.
    pub keep: bool,
}

/// Bytes a triangle of the input, and of its copy in cells.
const INPUT_BYTES: u64 = 19;
const TEMP_BYTES: u64 = 22;
/// Bytes a triangle of the target: the result, and 4.2 times as many survivors beside the cells.
const OUTPUT_BYTES: u64 = 120;

/// Makes the mesh, runs all targets, writes the page.
pub fn run(request: &Request, page_path: &Path) -> Outcome<()> {
    if !child::can_limit() {
        return Err("no memory cgroup can be made here: run as root".into());
    }
    std::fs::create_dir_all(&request.work)?;
    let machine = Machine::here();
    let (n_triangles, remark) = fitting(request)?;
    eprintln!("bench: {remark}");
    let input = request.work.join(format!(
        "{}_{}.ply",
        request.kind,
        show_count(n_triangles).replace(' ', "")
    ));
    let begin = std::time::Instant::now();
    let made = std::process::Command::new(&request.places.stonecut)
        .args(["synth", &request.kind])
        .arg(&input)
        .args(["--force", "--progress", "plain", "--triangles", &n_triangles.to_string()])
        .status()?;
    if !made.success() {
        return Err("the mesh could not be made".into());
    }
    let bytes = std::fs::metadata(&input)?.len();
    let mut page = format!(
        "# {} of {} triangles in {}\n\n`{}`\n\n{}\n\n{remark}\n\nThe input: `stonecut synth {} IN --triangles {n_triangles}`, \
         {} in {} s.\n",
        request.kind,
        show_count(n_triangles),
        show_bytes(request.memory_bytes),
        machine.command,
        machine.words(),
        request.kind,
        show_bytes(bytes),
        number(Some(begin.elapsed().as_secs_f64())),
    );
    for &target in &request.targets {
        page += &one_target(request, &input, target)?;
        let report = request.work.join(format!("to-{target}.json"));
        if report.is_file() {
            // Beside the page, for `bench forecast`.
            let text = std::fs::read_to_string(&report)?;
            let kept = page_path.with_extension(format!("{target}.json"));
            std::fs::write(kept, without_places(&text, request))?;
        }
        // After every target: a run that fails later leaves what there is.
        std::fs::write(page_path, without_places(&page, request))?;
    }
    if !request.keep {
        std::fs::remove_file(&input)?;
    }
    Ok(())
}

/// Names for where this machine keeps its files.
fn without_places(page: &str, request: &Request) -> String {
    page.replace(&request.places.stonecut.display().to_string(), "stonecut")
        .replace(&request.work.display().to_string(), "WORK")
}

/// The wanted size, or the largest that the disk holds, and a sentence about it.
fn fitting(request: &Request) -> Outcome<(u64, String)> {
    let free = free_bytes(&request.work)?;
    let results = OUTPUT_BYTES * request.targets.iter().max().unwrap_or(&0);
    let need = |n: u64| n * (INPUT_BYTES + TEMP_BYTES) + results;
    let wanted = request.n_triangles;
    if need(wanted) <= free {
        let sentence = format!(
            "Disk: at most {} needed, {} free.",
            show_bytes(need(wanted)),
            show_bytes(free)
        );
        return Ok((wanted, sentence));
    }
    let n = free.saturating_sub(results) / (INPUT_BYTES + TEMP_BYTES) / 1_000_000 * 1_000_000;
    if n == 0 {
        return Err(format!("{} of disk is too little", show_bytes(free)).into());
    }
    let sentence = format!(
        "Disk: {} triangles need {}, {} are free; the largest that fits is {} triangles.",
        count(wanted),
        show_bytes(need(wanted)),
        show_bytes(free),
        count(n)
    );
    Ok((n, sentence))
}

fn one_target(request: &Request, input: &Path, target: u64) -> Outcome<String> {
    let folder = request.work.join(format!("to-{target}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder)?;
    let (output, report) = (folder.join("out.ply"), folder.join("report.json"));
    let mut command: Vec<String> = [
        &request.places.stonecut.display().to_string(),
        "simplify",
        &input.display().to_string(),
        &output.display().to_string(),
        "--triangles",
        &target.to_string(),
        "--memory",
        &request.memory_bytes.to_string(),
        "--progress",
        "plain",
        "--report",
        &report.display().to_string(),
    ]
    .map(str::to_owned)
    .to_vec();
    command
        .extend(request.threads.into_iter().flat_map(|n| ["--threads".to_owned(), n.to_string()]));
    eprintln!("bench: to {}", show_count(target));
    let (usage, _, log) = child::run(&Job {
        command: command.clone(),
        folder: &folder,
        outputs: vec![output.clone(), report.clone()],
        seconds: 24 * 3600,
        memory_bytes: Some(request.limit_bytes),
    })?;
    let mut page = format!("\n## To {} triangles\n\n`{}`\n\n", count(target), command.join(" "));
    let json = std::fs::read_to_string(&report).unwrap_or_default();
    if !json.is_empty() {
        std::fs::write(request.work.join(format!("to-{target}.json")), &json)?;
    }
    let ended = match &usage.ending {
        Ending::Exit(0) => "finished".to_owned(),
        other => other.words(),
    };
    let mut facts = vec![
        ("ended", ended),
        (
            "wall, user, system s",
            [usage.wall, usage.user, usage.system].map(|s| number(Some(s))).join(", "),
        ),
        ("limit of the cgroup", show_bytes(request.limit_bytes)),
        (
            "peak of the cgroup, page cache included",
            mib(usage.cgroup_bytes.map(|b| b as f64)) + " MiB",
        ),
        ("peak resident", mib(Some(usage.rss_bytes as f64)) + " MiB"),
        ("read, by calls", mib(Some(usage.read_bytes as f64)) + " MiB"),
        ("read, from disk", mib(Some(usage.disk_read_bytes as f64)) + " MiB"),
        ("written", mib(Some(usage.written_bytes as f64)) + " MiB"),
    ];
    let parsed: Option<RunReport> = serde_json::from_str(&json).ok();
    if let Some(report) = &parsed {
        let n = report.input.triangles as f64;
        facts.extend([
            ("million input triangles/s", number(Some(n / usage.wall / 1e6))),
            ("ns a triangle", number(Some(usage.wall / n * 1e9))),
            (
                "peak temporary disk",
                format!("{} B/triangle", number(Some(report.peak_temp_bytes as f64 / n))),
            ),
            ("triangles out", count(report.output.triangles)),
        ]);
    }
    if output.is_file() && request.samples > 0 {
        let options = judge::Options {
            samples: request.samples,
            memory_bytes: request.memory_bytes,
            facing: false,
        };
        facts.extend(quality_facts(&judge(&request.places, input, &output, options)?));
    }
    let rows: Vec<Vec<String>> =
        facts.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect();
    page += &table(&["", ""], &rows);
    if let Some(report) = &parsed {
        page += "\n";
        page += &stage_table(report);
    }
    let _ = write!(
        page,
        "\n<details><summary>The report</summary>\n\n```json\n{json}\n```\n</details>\n\n\
         <details><summary>The log</summary>\n\n```\n{}\n```\n</details>\n",
        log.trim_end()
    );
    let _ = std::fs::remove_dir_all(&folder);
    Ok(page)
}

fn quality_facts(q: &Quality) -> Vec<(&'static str, String)> {
    vec![
        ("RMS / diagonal, both ways", format!("{:.3e}", q.rms / q.diagonal)),
        ("p99.9 / diagonal", format!("{:.3e}", q.p999 / q.diagonal)),
        ("max / diagonal", format!("{:.3e}", q.max / q.diagonal)),
        ("components", format!("{} -> {}", q.before.components, q.after.components)),
        (
            "Euler characteristic",
            format!("{} -> {}", q.before.euler_characteristic, q.after.euler_characteristic),
        ),
        (
            "non-manifold edges",
            format!("{} -> {}", q.before.non_manifold_edges, q.after.non_manifold_edges),
        ),
        ("open edges", format!("{} -> {}", q.before.boundary_edges, q.after.boundary_edges)),
    ]
}

fn stage_table(report: &RunReport) -> String {
    let n = report.input.triangles as f64;
    let total: f64 = report.stages.iter().map(|stage| stage.seconds).sum();
    let rows: Vec<Vec<String>> = report
        .stages
        .iter()
        .map(|stage| {
            vec![
                stage.name.clone(),
                number(Some(stage.seconds)),
                number(Some(100.0 * stage.seconds / total)),
                number(Some(stage.seconds / n * 1e9)),
                count(stage.triangles_in),
                count(stage.triangles_out),
                mib(Some(stage.bytes_read as f64)),
                mib(Some(stage.bytes_written as f64)),
            ]
        })
        .collect();
    let headers = [
        "stage",
        "s",
        "%",
        "ns an input triangle",
        "triangles in",
        "out",
        "read MiB",
        "written MiB",
    ];
    table(&headers, &rows)
}
