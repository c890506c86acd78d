//! The kernel beside meshoptimizer, in memory, on one thread: nanoseconds an input triangle by size and share kept.
//!
//! `cargo bench -p stonecut-bench`. Every call is timed whole; inputs are cloned outside. Here and not beside
//! benches/kernel.rs, so that the program's own tests build no C++.

#![allow(clippy::unwrap_used)] // A bench has nobody to report to.

use divan::Bencher;
use divan::counter::ItemsCount;
use meshopt::{SimplifyOptions, VertexDataAdapter};
use stonecut::Mesh;
use stonecut::kernel::{Options, Stop, simplify_mesh};
use stonecut::synth::{self, Kind, Settings};

/// Triangles asked for, and the share to keep.
const CASES: [(u64, f64); 4] =
    [(262_144, 0.1), (262_144, 0.01), (1_048_576, 0.1), (1_048_576, 0.01)];

fn main() {
    divan::main();
}

fn statue(n_triangles: u64) -> Mesh {
    synth::mesh(&Settings::new(Kind::Statue, n_triangles)).unwrap()
}

#[divan::bench(args = CASES, sample_count = 5, sample_size = 1)]
fn kernel(bencher: Bencher, (n_triangles, share): (u64, f64)) {
    let mesh = statue(n_triangles);
    let locked = vec![false; mesh.positions.len()];
    let target = (mesh.triangles.len() as f64 * share) as u64;
    let options = Options { stop: Stop::Triangles(target), ..Options::default() };
    bencher
        .counter(ItemsCount::new(mesh.triangles.len()))
        .with_inputs(|| mesh.clone())
        .bench_local_values(|mesh| simplify_mesh(mesh, &locked, &options));
}

/// Positions in single precision and corner indices, as meshoptimizer takes them.
fn arrays(mesh: &Mesh) -> (Vec<[f32; 3]>, Vec<u32>) {
    let positions = mesh.positions.iter().map(|p| p.map(|x| x as f32)).collect();
    (positions, mesh.triangles.iter().flatten().copied().collect())
}

#[divan::bench(args = CASES, sample_count = 5, sample_size = 1)]
fn meshopt(bencher: Bencher, (n_triangles, share): (u64, f64)) {
    let mesh = statue(n_triangles);
    let (positions, indices) = arrays(&mesh);
    let target = 3 * (mesh.triangles.len() as f64 * share) as usize;
    let bytes = bytemuck::cast_slice(&positions);
    bencher.counter(ItemsCount::new(mesh.triangles.len())).bench_local(|| {
        let vertices = VertexDataAdapter::new(bytes, 12, 0).unwrap();
        meshopt::simplify(&indices, &vertices, target, f32::MAX, SimplifyOptions::None, None)
    });
}

#[divan::bench(args = CASES, sample_count = 5, sample_size = 1)]
fn meshopt_update(bencher: Bencher, (n_triangles, share): (u64, f64)) {
    let mesh = statue(n_triangles);
    let target = 3 * (mesh.triangles.len() as f64 * share) as usize;
    bencher
        .counter(ItemsCount::new(mesh.triangles.len()))
        .with_inputs(|| arrays(&mesh))
        .bench_local_values(|(mut positions, mut indices)| {
            let none = SimplifyOptions::None;
            meshopt::simplify_with_update(
                &mut indices,
                &mut positions,
                &mut [],
                &[],
                0,
                None,
                target,
                f32::MAX,
                none,
                None,
            )
        });
}
