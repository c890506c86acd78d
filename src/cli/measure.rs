//! `stonecut measure`: its arguments, its table, its report.

use crate::error::{Error, Result};
use crate::measure::load::{self, Loaded};
use crate::measure::{self, Deviation, Options, Region, Side, TriangleSizes};
use crate::ply::MeshSource;
use crate::progress::Progress;
use crate::topology::Topology;
use crate::units;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Measures how far a simplified mesh deviates from its original
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The original mesh
    original: PathBuf,
    /// The simplified mesh
    simplified: PathBuf,
    /// Samples on each surface
    #[arg(long, value_name = "N", default_value = "1M", value_parser = units::parse_count)]
    samples: u64,
    /// Chooses among equally good sets of samples
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Memory to use [default: 75 % of what there is]
    #[arg(long, value_name = "SIZE")]
    memory: Option<String>,
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Writes all numbers as JSON
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Prints all numbers as JSON instead of the table
    #[arg(long)]
    json: bool,
    /// Counts samples near the vertices of this mesh apart (to look for seams)
    #[arg(long, value_name = "FILE.ply", requires = "within")]
    near: Option<PathBuf>,
    /// What is near, in input units
    #[arg(long, value_name = "D", requires = "near")]
    within: Option<f64>,
}

/// What is known of one of the two files.
#[derive(serde::Serialize)]
struct FileReport {
    path: PathBuf,
    bytes: u64,
    vertices: u64,
    triangles: u64,
    topology: Topology,
}

/// The JSON report.
#[derive(serde::Serialize)]
struct Report {
    version: &'static str,
    original: FileReport,
    simplified: FileReport,
    #[serde(flatten)]
    deviation: Deviation,
    #[serde(skip_serializing_if = "Option::is_none")]
    triangle_sizes: Option<TriangleSizes>,
    seed: u64,
    seconds: f64,
    peak_memory_bytes: u64,
}

/// Runs the command; the table or the JSON goes to standard output.
pub fn run(args: &Args, progress: &Progress) -> Result<()> {
    let begin = std::time::Instant::now();
    let threads = args.threads.unwrap_or_else(crate::memory::cores).max(1);
    let sources = [MeshSource::open(&args.original)?, MeshSource::open(&args.simplified)?];
    let [original, simplified] =
        [load::load(&sources[0], threads, progress)?, load::load(&sources[1], threads, progress)?];
    let region = match (&args.near, args.within) {
        (Some(path), Some(within)) => Some(region(path, within, threads, progress)?),
        _ => None,
    };
    let triangle_sizes = region.as_ref().map(|r| TriangleSizes::of(&simplified.mesh, r));
    let colours = original.colours.zip(simplified.colours).map(|(a, b)| [a, b]);
    let options = Options { samples: args.samples, seed: args.seed, threads, colours, region };
    let deviation = measure::two_sided(&original.mesh, &simplified.mesh, &options, progress)?;
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        original: file_report(&sources[0], &original),
        simplified: file_report(&sources[1], &simplified),
        deviation,
        triangle_sizes,
        seed: args.seed,
        seconds: begin.elapsed().as_secs_f64(),
        peak_memory_bytes: crate::memory::peak_bytes(),
    };
    let json = serde_json::to_string_pretty(&report)
        .map_err(|e| Error::Usage(format!("the report cannot be written as JSON: {e}")))?;
    if let Some(path) = &args.report {
        std::fs::write(path, &json).map_err(|e| Error::io(path, "cannot write the report", e))?;
    }
    let mut out = std::io::stdout().lock();
    let printed =
        if args.json { writeln!(out, "{json}") } else { write!(out, "{}", table(&report)) };
    printed.map_err(|e| Error::io("standard output", "cannot write", e))
}

fn region(path: &Path, within: f64, threads: usize, progress: &Progress) -> Result<Region> {
    if !(within >= 0.0 && within.is_finite()) {
        return Err(Error::Usage(format!("--within {within} is no distance")));
    }
    let places = load::load(&MeshSource::open(path)?, threads, progress)?;
    Ok(Region::around_points(&places.mesh.positions, within))
}

fn file_report(source: &MeshSource, loaded: &Loaded) -> FileReport {
    FileReport {
        path: source.path().to_path_buf(),
        bytes: source.file_bytes(),
        vertices: source.n_vertices(),
        triangles: loaded.mesh.triangles.len() as u64 + loaded.n_degenerate,
        topology: load::topology_of(loaded),
    }
}

fn table(report: &Report) -> String {
    let mut text = String::new();
    let mut line = |cells: [&str; 3]| {
        text.push_str(format!("{:<22}{:>16}{:>16}", cells[0], cells[1], cells[2]).trim_end());
        text.push('\n');
    };
    let files = [&report.original, &report.simplified];
    let sides = [&report.deviation.forward, &report.deviation.backward];
    line(["", "original", "simplified"]);
    let mut pair = |name: &str, values: [String; 2]| line([name, &values[0], &values[1]]);
    pair("triangles", files.map(|f| units::show_count(f.triangles)));
    pair("vertices", files.map(|f| units::show_count(f.vertices)));
    let mut count = |name: &str, pick: fn(&Topology) -> i64| {
        pair(name, files.map(|f| pick(&f.topology).to_string()));
    };
    count("components", |t| t.components as i64);
    count("Euler characteristic", |t| t.euler_characteristic);
    count("boundary edges", |t| t.boundary_edges as i64);
    count("non-manifold edges", |t| t.non_manifold_edges as i64);
    count("inconsistent edges", |t| t.inconsistent_edges as i64);
    count("duplicate triangles", |t| t.duplicate_triangles as i64);
    count("degenerate triangles", |t| t.degenerate_triangles as i64);
    pair("", [String::new(), String::new()]);
    pair("distance", ["to simplified".into(), "to original".into()]);
    let number =
        |value: f64| if value.is_finite() { format!("{value:.6e}") } else { "no surface".into() };
    let mut row = |name: &str, pick: &dyn Fn(&Side) -> Option<f64>| {
        let values = sides.map(pick);
        if values.iter().any(Option::is_some) {
            pair(name, values.map(|v| v.map_or("-".to_owned(), number)));
        }
    };
    row("mean", &|s| Some(s.distance.mean));
    row("rms", &|s| Some(s.distance.rms));
    row("99.9 %", &|s| Some(s.distance.p999));
    row("max", &|s| Some(s.distance.max));
    row("normals, mean degrees", &|s| s.normal_degrees);
    row("colour, mean delta E", &|s| s.colour_delta_e);
    for (name, pick) in [("near", near as fn(&Side) -> Option<&measure::Spread>), ("far", far)] {
        row(&format!("{name}: mean"), &|s| pick(s).map(|d| d.mean));
        row(&format!("{name}: rms"), &|s| pick(s).map(|d| d.rms));
        row(&format!("{name}: max"), &|s| pick(s).map(|d| d.max));
    }
    pair("samples", sides.map(|s| units::show_count(s.distance.samples)));
    pair("vertices checked", sides.map(|s| units::show_count(s.vertices)));
    let deviation = &report.deviation;
    text.push_str(&format!(
        "\nrms both ways {} = {} of the diagonal {:.6e}\n",
        number(deviation.rms),
        number(deviation.relative_rms),
        deviation.diagonal
    ));
    if let Some(sizes) = &report.triangle_sizes {
        text.push_str(&format!(
            "mean area of simplified triangles: near {:.6e} ({}), far {:.6e} ({})\n",
            sizes.near_mean_area, sizes.near_triangles, sizes.far_mean_area, sizes.far_triangles
        ));
    }
    text
}

fn near(side: &Side) -> Option<&measure::Spread> {
    side.near.as_ref()
}

fn far(side: &Side) -> Option<&measure::Spread> {
    side.far.as_ref()
}
