//! Simplifies a file of any size, with progress.
//!
//!     cargo run --release --example simplify_file -- scan.ply small.ply 1%

#![allow(clippy::print_stdout, clippy::print_stderr)] // A program may print.

use stonecut::Simplify;
use stonecut::system::units::parse_ratio;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, share] = words.as_slice() else {
        eprintln!("give an input, an output and a share: scan.ply small.ply 1%");
        std::process::exit(2);
    };
    std::process::exit(simplify(input, output, share));
}

/// Gives the exit code that the command would have.
pub fn simplify(input: &str, output: &str, share: &str) -> i32 {
    let Ok(ratio) = parse_ratio(share) else { return 2 };
    let outcome = Simplify::new(input, output)
        .ratio(ratio)
        .force()
        .on_progress(|p| {
            eprint!("\r{} {:.0} %, {:.0} s left ", p.stage, 100.0 * p.fraction, p.seconds_left)
        })
        .run();
    match outcome {
        Ok(report) => {
            println!("\n{} triangles in {}", report.output.triangles, report.output.path);
            if report.is_short() { 3 } else { 0 }
        }
        Err(error) => {
            eprintln!("\n{error}");
            if let Some(remedy) = error.remedy() {
                eprintln!("{remedy}");
            }
            i32::from(error.exit_code())
        }
    }
}
