//! Speed of the kernel: nanoseconds an input triangle, by target, by cell size and by part of the work.
//!
//! `cargo bench --bench kernel`. The whole call is timed, ordering included; the input is cloned outside. The
//! comparison with other simplifiers is `bench kernel-tables` (tools/bench): they need a C++ compiler, which
//! whoever builds and tests stonecut should not.

#![allow(clippy::unwrap_used)] // A bench has nobody to report to.

use divan::Bencher;
use divan::counter::ItemsCount;
use stonecut::Mesh;
use stonecut::kernel::{Fit, Options, Stop, simplify_mesh};

fn main() {
    divan::main();
}

/// A rough height field of about `n_triangles` triangles.
fn terrain(n_triangles: usize) -> Mesh {
    let n = ((n_triangles / 2) as f64).sqrt() as usize;
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
            let octave = |k: i32| {
                let f = 5.0 * 1.9f64.powi(k);
                0.1 * 0.45f64.powi(k)
                    * (f * x + 1.7 * f64::from(k)).sin()
                    * (f * y - f * x / 3.0).cos()
            };
            mesh.positions.push([x, y, (0..9).map(octave).sum()]);
        }
    }
    let at = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    for i in 0..n {
        for j in 0..n {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

fn simplify(bencher: Bencher, n_triangles: usize, share: f64, fit: Fit) {
    let mesh = terrain(n_triangles);
    let target = (mesh.triangles.len() as f64 * share) as u64;
    until(bencher, mesh, Stop::Triangles(target), fit);
}

fn until(bencher: Bencher, mesh: Mesh, stop: Stop, fit: Fit) {
    let locked = vec![false; mesh.positions.len()];
    let options = Options { stop, fit, ..Options::default() };
    bencher
        .counter(ItemsCount::new(mesh.triangles.len()))
        .with_inputs(|| mesh.clone())
        .bench_local_values(|mesh| simplify_mesh(mesh, &locked, &options));
}

#[divan::bench(args = [65_536, 262_144, 1_048_576, 2_097_152], sample_count = 5, sample_size = 1)]
fn to_ten_percent(bencher: Bencher, n_triangles: usize) {
    simplify(bencher, n_triangles, 0.1, Fit::Off);
}

#[divan::bench(args = [65_536, 262_144, 1_048_576, 2_097_152], sample_count = 5, sample_size = 1)]
fn to_one_percent(bencher: Bencher, n_triangles: usize) {
    simplify(bencher, n_triangles, 0.01, Fit::Off);
}

/// The fit's time is what this takes more than `to_one_percent`.
#[divan::bench(args = [262_144, 1_048_576], sample_count = 5, sample_size = 1)]
fn to_one_percent_and_fit(bencher: Bencher, n_triangles: usize) {
    simplify(bencher, n_triangles, 0.01, Fit::On);
}

/// Ordering, building and taking apart again, without a single collapse.
#[divan::bench(args = [262_144, 1_048_576], sample_count = 5, sample_size = 1)]
fn ordering_and_building(bencher: Bencher, n_triangles: usize) {
    let stop = Stop::Costs(Vec::new());
    until(bencher, terrain(n_triangles), stop, Fit::Off);
}

/// The same and every edge's cost once; next to nothing is cheap enough to collapse. What is left of
/// `to_ten_percent` is collapsing.
#[divan::bench(args = [262_144, 1_048_576], sample_count = 5, sample_size = 1)]
fn and_evaluating_every_edge(bencher: Bencher, n_triangles: usize) {
    let levels = vec![f64::MIN_POSITIVE];
    until(bencher, terrain(n_triangles), Stop::Costs(levels), Fit::Off);
}
