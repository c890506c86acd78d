//! Memory, threads and interruptions change no byte; the plan of the disk is right; a budget stays within the limit.

#![allow(clippy::print_stdout)] // Figures for whoever looks.

use crate::common::expect;
use std::num::NonZeroUsize;
use std::path::Path;
use std::time::Duration;
use stonecut::config::CHECKPOINT_EVERY;
use stonecut::config::{Config, DEFAULT_CELL_TRIANGLES, JobOptions, Target};
use stonecut::kernel::Fit;
use stonecut::pipeline;
use stonecut::pipeline::plan::Plan;
use stonecut::system::disk::Disk;
use stonecut::system::progress::Progress;

fn config(folder: &Path, ratio: f64) -> Config {
    Config {
        memory_bytes: 4 << 30,
        threads: NonZeroUsize::new(2).unwrap(),
        cell_triangles: DEFAULT_CELL_TRIANGLES,
        job: JobOptions { force: true, restart: true, ..JobOptions::default() },
        ..crate::common::config(folder, Target::Ratio(ratio))
    }
}

/// Simplifies with so much memory for the stages, however little the plan would refuse.
fn with_memory(config: &Config, usable_bytes: u64) -> (Plan, u64) {
    let disk = Disk::default();
    let mut prepared = pipeline::prepare(config).unwrap();
    prepared.plan.usable_memory_bytes = usable_bytes;
    let plan = prepared.plan.clone();
    pipeline::simplify_on(&disk, prepared, &Progress::default()).unwrap();
    (plan, disk.peak_bytes())
}

/// A bumpy sheet of 2 n^2 triangles with texture coordinates at corners, a chart for every 20 x 20 quads.
fn write_charts(path: &Path, n: usize) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\n\
         property list uchar float texcoord\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    )
    .into_bytes();
    for v in 0..(n + 1) * (n + 1) {
        let (x, y) = ((v / (n + 1)) as f32 / n as f32, (v % (n + 1)) as f32 / n as f32);
        let z = 0.1 * (9.0 * x).sin() * (7.0 * y).cos() + 0.01 * (61.0 * x * y).sin();
        [x, y, z].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    // A chart has a 20th of the width and height of the atlas, and uses 3/4 of it.
    let place = |at: usize, quad: usize| {
        let chart = quad / 20;
        (chart as f32 + 0.125 + 0.0375 * (at - 20 * chart) as f32) / 20.0
    };
    for quad in 0..n * n {
        let (i, j) = (quad / n, quad % n);
        for corners in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
            let corners = corners.map(|(k, l)| (i + k, j + l));
            bytes.push(3);
            corners
                .iter()
                .for_each(|(k, l)| bytes.extend(((k * (n + 1) + l) as i32).to_le_bytes()));
            bytes.push(6);
            for (k, l) in corners {
                bytes.extend(place(k, i).to_le_bytes());
                bytes.extend(place(l, j).to_le_bytes());
            }
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// Memory for the stages, on both sides of every threshold that depends on it:
///
/// | threshold | below | above |
/// |---|---|---|
/// | table of cells packed, in a file or in windows (`partition::Shares::table_bytes`) | 1 KiB, 14 MiB | 64 MiB, 1 GiB |
/// | fewer reading threads (`Shares::threads`) | 1 KiB to 14 MiB | 64 MiB, 1 GiB |
/// | chunks of 4 KiB, of a share, of 256 KiB (`cells::Scatter`), also in `recut` and `split` | 1 KiB, 14 MiB | 1 GiB |
/// | pairs of vertex and foreign cell noted and sorted on disk (`partition::halo`) | 1 KiB | 64 MiB |
/// | sorting of old seams (`stitch::recut`) and of places (`write::join`) | 1 KiB | 1 GiB |
/// | cells at a time (`parallel::largest_first`) | 1 KiB: one | 1 GiB: all |
const BUDGETS: [u64; 4] = [1 << 10, 14 << 20, 64 << 20, 1 << 30];

#[test]
fn no_budget_thread_or_checkpoint_changes_a_byte() {
    // Kind of scan, triangles, ratio and cell size: a round and the finish; several rounds, the last exact; halos
    // that exceed their memory; vertices joined along a texture's seams.
    let jobs = [
        ("statue in.ply --shuffle", "400k", 0.01, 20_000),
        ("statue in.ply --shuffle", "300k", 0.4, 10_000),
        ("statue in.ply --shuffle", "300k", 0.02, 1_000),
        ("charts", "", 0.3, 20_000),
    ];
    for (kind, triangles, ratio, cell_triangles) in jobs {
        let folder = tempfile::tempdir().unwrap();
        match kind {
            "charts" => write_charts(&folder.path().join("in.ply"), 380),
            _ => drop(expect(folder.path(), &format!("synth {kind} --triangles {triangles}"), 0)),
        }
        let base = Config { cell_triangles, ..config(folder.path(), ratio) };
        with_memory(&base, 1 << 30);
        let reference = std::fs::read(&base.output).unwrap();
        for (budget, threads) in BUDGETS.into_iter().zip([3, 1, 2, 1]) {
            let every = if threads == 3 { Duration::ZERO } else { CHECKPOINT_EVERY };
            let threads = NonZeroUsize::new(threads).unwrap();
            with_memory(&Config { threads, checkpoint_every: every, ..base.clone() }, budget);
            let found = std::fs::read(&base.output).unwrap();
            assert!(found == reference, "{kind} to {ratio} with {budget} bytes, {threads} threads");
        }
    }
}

#[test]
fn the_plan_of_the_disk_is_right_for_every_format() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 150k", 0);
    let formats = [
        ("ply", ""),
        ("stl", ""),
        ("obj", ""),
        ("glb", ""),
        ("ply", "ascii,double"),
        ("ply", "ascii"),
    ];
    for (extension, format) in formats {
        for (ratio, fit, cell_triangles) in [
            (0.6, Fit::Off, 25_000),
            (0.6, Fit::On, 25_000),
            (0.01, Fit::On, 25_000),
            (0.5, Fit::Off, 10_000),
        ] {
            let mut config = config(folder.path(), ratio);
            config.output = folder.path().join("out").with_extension(extension);
            config.format = format.parse().unwrap();
            config.kernel.fit = fit;
            config.cell_triangles = cell_triangles;
            let (plan, peak) = with_memory(&config, 1 << 30);
            let what = format!("{extension} {format} {ratio} {fit:?}");
            let output = std::fs::metadata(&config.output).unwrap().len();
            near(plan.output_bytes, output, &format!("{what}: output"));
            // The disk counts job folder and output together, but not what has no name.
            near(
                plan.together_bytes - plan.spool_bytes.min(plan.together_bytes - plan.temp_bytes),
                peak,
                &format!("{what}: peak"),
            );
        }
    }
}

fn near(planned: u64, found: u64, what: &str) {
    let ratio = planned as f64 / found as f64;
    println!("{what}: planned {planned}, found {found}, ratio {ratio:.3}");
    assert!((0.9..=1.1).contains(&ratio), "{what}: planned {planned}, found {found}");
}

/// A budget above the limit of the machine is cut down to what the limit leaves, and said so.
#[test]
fn a_budget_above_the_limit_is_taken_down() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 5k", 0);
    let said = expect(folder.path(), "simplify in.ply out.ply --ratio 10% --memory 1000TiB", 0);
    assert!(said.contains("warning: --memory"), "{said}");
    let said = expect(folder.path(), "simplify in.ply out2.ply --ratio 10% --memory 90MiB", 0);
    assert!(!said.contains("warning"), "{said}");
}
