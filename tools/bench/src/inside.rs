//! Peers that are libraries of Rust: each run is a process of the harness itself.
//!
//! `bench peer NAME IN.raw OUT.raw TRIANGLES` reads, simplifies on one thread, writes, and prints what the
//! simplification alone took, as the drivers in `tools/bench/peers` do.

#[path = "../../../tests/kernel/reference/mod.rs"]
mod reference;

use crate::{Outcome, meshes};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;
use stonecut::Mesh;
use stonecut::kernel::{self, Fit, Options, Stop, Topology};

/// What a driver prints: the simplification alone, without reading and writing.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Inner {
    /// Wall time.
    pub seconds: f64,
    /// CPU time of all threads, user and system.
    pub cpu_seconds: f64,
    /// Peak memory beyond what was resident before, the input mesh not included.
    pub extra_bytes: i64,
}

/// Simplifies one raw mesh by the named library.
pub fn run(name: &str, input: &Path, output: &Path, target: u64) -> Outcome<Inner> {
    let mesh = meshes::read_raw(input)?;
    let (result, inner) = match name {
        "kernel" | "kernel-fit" | "kernel-keep" | "reference" => own(name, mesh, target),
        "meshopt" | "meshopt-update" => meshopt(name == "meshopt-update", &mesh, target),
        _ => return Err(format!("no library is named {name}").into()),
    };
    meshes::write_raw(output, &result)?;
    Ok(inner)
}

fn own(name: &str, mesh: Mesh, target: u64) -> (Mesh, Inner) {
    let locked = vec![false; mesh.positions.len()];
    let topology = if name == "kernel-keep" { Topology::Keep } else { Topology::Error };
    let fit = if name == "kernel-fit" { Fit::On } else { Fit::Off };
    let stop = Stop::Triangles(target);
    let options = Options { stop, topology, fit, ..Options::default() };
    let (result, inner) = timed(|| match name {
        "reference" => reference::simplify_mesh(mesh, &locked, &options),
        _ => kernel::simplify_mesh(mesh, &locked, &options),
    });
    (result.mesh, inner)
}

/// Positions go about the middle first, where single precision is at its best.
fn meshopt(update: bool, mesh: &Mesh, target: u64) -> (Mesh, Inner) {
    let (low, high) = meshes::bounds(mesh);
    let origin = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
    let mut positions: Vec<[f32; 3]> =
        mesh.positions.iter().map(|p| [0, 1, 2].map(|k| (p[k] - origin[k]) as f32)).collect();
    let mut indices: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    let n_indices = 3 * target as usize;
    let (left, inner) = if update {
        let (n, inner) = timed(|| {
            meshopt::simplify_with_update(
                &mut indices,
                &mut positions,
                &mut [],
                &[],
                0,
                None,
                n_indices,
                f32::MAX,
                SimplifyOptions::None,
                None,
            )
        });
        indices.truncate(n);
        (indices, inner)
    } else {
        timed(|| {
            let bytes = bytemuck::cast_slice(&positions);
            VertexDataAdapter::new(bytes, 12, 0).map_or_else(
                |_| Vec::new(),
                |vertices| {
                    meshopt::simplify(
                        &indices,
                        &vertices,
                        n_indices,
                        f32::MAX,
                        SimplifyOptions::None,
                        None,
                    )
                },
            )
        })
    };
    let mut place = vec![u32::MAX; positions.len()];
    let mut out = Mesh::default();
    for corners in left.chunks_exact(3) {
        let triangle = [corners[0], corners[1], corners[2]].map(|v| {
            let place = &mut place[v as usize];
            if *place == u32::MAX {
                *place = out.positions.len() as u32;
                let p = positions[v as usize];
                out.positions.push([0, 1, 2].map(|k| f64::from(p[k]) + origin[k]));
            }
            *place
        });
        out.triangles.push(triangle);
    }
    (out, inner)
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, Inner) {
    // Resets the peak of this process; where that is not allowed, the peak of reading may show.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    let before = stonecut::system::memory::resident_bytes();
    let (begin, cpu) = (Instant::now(), cpu_seconds());
    let result = work();
    let inner = Inner {
        seconds: begin.elapsed().as_secs_f64(),
        cpu_seconds: cpu_seconds() - cpu,
        extra_bytes: stonecut::system::memory::peak_bytes() as i64 - before as i64,
    };
    (result, inner)
}

/// CPU time of this process so far.
fn cpu_seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid place for the answer; the call has no other effect.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
