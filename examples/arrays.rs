//! Simplifies a mesh that is in memory: arrays in, arrays out, through cells in parallel.
//!
//!     cargo run --release --example arrays

#![allow(clippy::print_stdout, clippy::print_stderr)] // A program may print.

use stonecut::in_memory::{self, Input};
use stonecut::{Config, Progress, Target};

/// Simplifies a sheet and prints what is left.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A hilly sheet of 2 * 300 * 300 triangles.
    let n = 301u32;
    let height = |x: f64, y: f64| (x * 0.05).sin() * (y * 0.03).cos() * 8.0;
    let at = |i: u32| (f64::from(i % n), f64::from(i / n));
    let positions = (0..n * n).map(at).map(|(x, y)| [x, y, height(x, y)]).collect();
    let corner = |x: u32, y: u32| y * n + x;
    let squares = (0..n - 1).flat_map(|y| (0..n - 1).map(move |x| (x, y)));
    let triangles = squares
        .flat_map(|(x, y)| {
            let [a, b] = [corner(x, y), corner(x + 1, y)];
            let [c, d] = [corner(x + 1, y + 1), corner(x, y + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();

    // Paths of a run in memory are never used.
    let config = Config::new("arrays", "arrays", Target::Triangles(5000));
    let input = Input { positions, triangles, ..Input::default() };
    let output = in_memory::simplify(input, &config, &Progress::default())?;
    println!("{} triangles, {} vertices", output.triangles.len(), output.positions.len());
    // `source` has the vertex of the input that survived as each vertex.
    println!("the first vertex was number {}", output.source[0]);
    Ok(())
}
