//! Measures how far a simplified file is from its original, and proves an interval around the largest distance.
//!
//!     cargo run --release --example measure -- scan.ply small.ply

#![allow(clippy::print_stdout)] // A program may print.

use stonecut::Measure;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [original, simplified] = words.as_slice() else {
        return Err("give the original and the simplified mesh: scan.ply small.ply".into());
    };
    measure(original, simplified)
}

/// Prints both numbers.
pub fn measure(original: &str, simplified: &str) -> Result<(), Box<dyn std::error::Error>> {
    let report = Measure::new(original, simplified).samples(100_000).certify(0.05).run()?;
    println!(
        "rms {:.3e}, {:.2e} of the diagonal",
        report.deviation.rms, report.deviation.relative_rms
    );
    if let Some(proven) = report.hausdorff {
        println!("farthest from {:.3e} to {:.3e}", proven.lower, proven.upper);
    }
    Ok(())
}
