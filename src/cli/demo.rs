//! `stonecut demo`: the whole way on a synthetic scan, for a first impression.

use super::{Log, Talk, simplify};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::synth;
use std::path::PathBuf;

/// Makes a synthetic scan, simplifies it out of core, and says where everything lies.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where to put the demo's files.
    #[arg(default_value = "stonecut-demo")]
    folder: PathBuf,
}

/// Triangles of the demo's scan.
const TRIANGLES: u64 = 4_000_000;

/// Runs the demo.
pub fn run(args: &Args, talk: &Talk, progress: &Progress, log: &mut Log) -> Result<u8> {
    std::fs::create_dir_all(&args.folder)
        .map_err(|e| Error::io(&args.folder, "cannot create", e))?;
    let scan = args.folder.join("statue.ply");
    log.say(format!("making a synthetic scan of {TRIANGLES} triangles: {}", scan.display()));
    let settings = synth::Settings {
        kind: synth::Kind::Statue,
        n_triangles: TRIANGLES,
        seed: 1,
        shuffle: false,
        color: false,
        uv: false,
    };
    let writing = synth::Writing { threads: crate::memory::cores(), force: true };
    synth::write_ply(&scan, &settings, writing, progress)?;
    let output = args.folder.join("statue-1-percent.ply");
    simplify::run(&simplify::Args::with_ratio(scan, output, 0.01), talk, progress, log)
}
