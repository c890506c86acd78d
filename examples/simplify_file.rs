//! Simplifies a file of any size, with progress.
//!
//!     cargo run --release --example simplify_file -- scan.ply small.ply 1%

#![allow(clippy::print_stdout, clippy::print_stderr)] // A program may print.

use std::time::Duration;
use stonecut::config::{Config, Target};
use stonecut::pipeline;
use stonecut::system::progress::Progress;
use stonecut::system::units::parse_ratio;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, share] = arguments.as_slice() else {
        return Err("give an input, an output and a share: scan.ply small.ply 1%".into());
    };
    // Everything else has the defaults of the command; set what should differ.
    let mut config = Config::new(input, output, Target::Ratio(parse_ratio(share)?));
    config.job.force = true;

    // Reads the header, counts, and plans; nothing has been written yet.
    let prepared = pipeline::prepare(&config)?;

    // Stages only count. A thread looks at the counters as often as it likes.
    let progress = Progress::default();
    let report = std::thread::scope(|scope| {
        let run = scope.spawn(|| pipeline::simplify(prepared, &progress));
        while !run.is_finished() {
            let (stage, done) = progress.read();
            eprint!("\r{} {} of {} triangles   ", stage.name, done, stage.total);
            std::thread::sleep(Duration::from_millis(100));
        }
        run.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })?;
    if let Some(report) = report {
        eprintln!();
        println!("{} triangles in {}", report.output.triangles, report.output.path);
    }
    Ok(())
}
