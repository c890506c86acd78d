//! Reading speed on one thread: `cargo bench --bench formats -- FILE...`, bytes of the file a second.
//!
//! Files come from the page cache (each is read once before the clock starts). Prints the median of five.

#![allow(clippy::unwrap_used)] // A bench has nobody to report to.

use std::time::Instant;
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};

/// Seconds to open, to read all vertices, to read all faces.
fn read(path: &std::path::Path) -> stonecut::Result<[f64; 3]> {
    let start = Instant::now();
    let source = MeshSource::open(path)?;
    let opened = start.elapsed().as_secs_f64();
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    let start = Instant::now();
    for i in 0..source.n_vertex_blocks() {
        source.read_vertices(i, &mut vertices)?;
        std::hint::black_box(&vertices.records);
    }
    let read_vertices = start.elapsed().as_secs_f64();
    let start = Instant::now();
    for i in 0..source.n_face_blocks() {
        source.read_faces(i, &mut faces)?;
        std::hint::black_box(&faces.triangles);
    }
    Ok([opened, read_vertices, start.elapsed().as_secs_f64()])
}

#[allow(clippy::print_stdout)]
fn main() -> stonecut::Result<()> {
    for path in std::env::args().skip(1).filter(|a| !a.starts_with("--")) {
        let path = std::path::PathBuf::from(path);
        let bytes = std::fs::metadata(&path).map_or(0, |m| m.len()) as f64;
        read(&path)?;
        let mut runs = Vec::new();
        for _ in 0..5 {
            runs.push(read(&path)?);
        }
        runs.sort_by(|a, b| a.iter().sum::<f64>().total_cmp(&b.iter().sum()));
        let [open, vertices, faces] = runs[2];
        println!(
            "{}: {:.0} MB/s; open {open:.3} s, vertices {vertices:.3} s, faces {faces:.3} s",
            path.display(),
            bytes / 1e6 / (open + vertices + faces)
        );
    }
    Ok(())
}
