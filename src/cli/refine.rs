//! `stonecut refine`: a mesh of any count out of a progressive mesh.

use super::arguments::{memory_budget, parse_memory};
use super::display::watch;
use super::log::{EXIT_SHORT, Log, Talk};
use super::outcome::write_json;
use crate::error::Result;
use crate::io::OutputFormat;
use crate::pipeline::refine::{RefineConfig, refine};
use crate::system::paths::{Kind, Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::{parse_count, show_bytes};
use std::path::PathBuf;

/// Makes a mesh of any number of triangles out of a progressive mesh
///
/// Reads only what that number needs. Of a file without --progressive-bits the result is, byte for byte, that of 'simplify
/// --progressive' with this number of triangles.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// A file that 'stonecut simplify --progressive' has written.
    input: PathBuf,
    /// A file ending in .ply, .stl, .obj or .glb.
    output: PathBuf,
    /// Number of triangles at most. Beyond the finest mesh of the file, that one; below its coarsest, that one, with exit
    /// code 3.
    #[arg(long, value_name = "N", value_parser = parse_count)]
    triangles: u64,
    /// Words joined by commas: ascii, binary_little_endian or binary_big_endian; float or double coordinates; int or
    /// uint indices; ply, stl, obj or glb.
    #[arg(long, value_name = "FORMAT", default_value = "")]
    format: OutputFormat,
    /// Memory budget, everything included: 512MiB, 4GiB, 50% [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Replace OUTPUT if it exists.
    #[arg(long)]
    force: bool,
    /// Write a report in JSON.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl Args {
    pub(super) fn paths(&self) -> Result<Paths> {
        self.format.check(&self.output)?;
        Ok(Paths::new(self.force)
            .with(Role::Input, "INPUT", &self.input)
            .with(Role::Output, "OUTPUT", &self.output)
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref()))
    }
}

/// Runs the command and gives its exit code.
pub fn run(args: &Args, talk: &Talk, progress: &Progress, log: &mut Log) -> Result<u8> {
    super::arguments::warn_of_limit(args.memory, log);
    let config = RefineConfig {
        input: args.input.clone(),
        output: args.output.clone(),
        format: args.format,
        triangles: args.triangles,
        force: args.force,
        memory_bytes: memory_budget(args.memory),
    };
    let done = watch(talk, progress, log, || refine(&config, progress))?;
    log.say(format!(
        "{}: {} triangles, {} vertices, {}, from {} of the progressive mesh",
        config.output.display(),
        done.triangles,
        done.vertices,
        show_bytes(done.bytes_written),
        show_bytes(done.bytes_read)
    ));
    if done.target > done.finest {
        log.say(format!("the file has no finer mesh than this one of {} triangles", done.finest));
    }
    if let Some(path) = &args.report {
        write_json(path, &done)?;
    }
    if !done.target_met {
        log.say(format!(
            "{} triangles were asked for; the coarsest mesh of the file has {}",
            done.target, done.coarsest
        ));
        return Ok(EXIT_SHORT);
    }
    Ok(0)
}
