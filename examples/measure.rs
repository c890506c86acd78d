//! Measures how far two meshes in memory are apart.
//!
//!     cargo run --release --example measure

#![allow(clippy::print_stdout, clippy::print_stderr)] // A program may print.

use stonecut::measure::{Options, two_sided};
use stonecut::system::progress::Progress;
use stonecut::{Mesh, kernel, simplify_mesh};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A wavy sheet, and the same with a tenth of the triangles.
    let n = 101u32;
    let place = |i: u32| (f64::from(i % n), f64::from(i / n));
    let positions =
        (0..n * n).map(place).map(|(x, y)| [x, y, (x * 0.2).sin() + (y * 0.2).cos()]).collect();
    let cells = (0..(n - 1) * (n - 1)).map(|i| i % (n - 1) + i / (n - 1) * n);
    let triangles = cells.flat_map(|v| [[v, v + 1, v + n + 1], [v, v + n + 1, v + n]]).collect();
    let original = Mesh::new(positions, triangles);

    let stop = kernel::Stop::Triangles(original.triangles.len() as u64 / 10);
    let options = kernel::Options { stop, ..kernel::Options::default() };
    let free = vec![false; original.positions.len()];
    let simplified = simplify_mesh(original.clone(), &free, &options).mesh;

    let deviation = two_sided(&original, &simplified, &Options::default(), &Progress::default())?;
    println!("{} of {} triangles", simplified.triangles.len(), original.triangles.len());
    println!(
        "rms {:.3e}, farthest {:.3e}",
        deviation.rms,
        deviation.forward.distance.max.max(deviation.backward.distance.max)
    );
    Ok(())
}
