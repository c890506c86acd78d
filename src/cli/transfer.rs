//! `stonecut transfer`: values of vertices carried over by a map.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory, require_ending};
use super::session::{Command, Session};
use crate::error::Result;
use crate::pipeline::transfer::{Merge, Towards, Transfer, transfer};
use crate::system::disk::{Disk, folder_of};
use crate::system::paths::{Paths, Role};
use crate::system::pending_file::Place;
use crate::system::units::show_count;
use std::path::PathBuf;

/// Carries values of vertices over to a simplified mesh, or back, by the map of 'simplify --map'
///
/// Arrays of NumPy (.npy) in and out, with a row for each vertex: labels, weights, temperatures. A vertex of the result gets the
/// mean of those that became it, or the most frequent value; where none became it, that of the nearest vertex of the input.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// A file that 'stonecut simplify --map' has written.
    map: PathBuf,
    /// Values, a row for each vertex: floats or integers.
    values: PathBuf,
    /// The array to write, of the same type.
    #[arg(short, long, value_name = "OUT.npy")]
    output: PathBuf,
    /// The mesh that gets values: the result, or the input, where each vertex gets the value of the one that it became.
    #[arg(long, value_enum, value_name = "MESH", default_value = "result")]
    to: TypedTowards,
    /// The value of several: mean, or majority for labels [default: mean of floats, majority of integers].
    #[arg(long, value_enum, value_name = "HOW")]
    by: Option<TypedMerge>,
    /// Memory budget [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Folder for sorting [default: beside OUT.npy].
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Replace OUT.npy if it exists.
    #[arg(long)]
    force: bool,
}

/// The choices of `--to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedTowards {
    /// The simplified mesh.
    Result,
    /// The mesh that it was made from.
    Input,
}

/// The choices of `--by`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedMerge {
    /// The mean.
    Mean,
    /// The most frequent value.
    Majority,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        require_ending("-o", &self.output, &["npy"])?;
        Ok(Paths::new(self.force)
            .with(Role::InputFile, "MAP", &self.map)
            .with(Role::InputFile, "VALUES", &self.values)
            .with(Role::Output, "-o", &self.output)
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref()))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let how = Transfer {
            map: self.map.clone(),
            values: self.values.clone(),
            towards: match self.to {
                TypedTowards::Result => Towards::Result,
                TypedTowards::Input => Towards::Input,
            },
            merge: self.by.map(|by| match by {
                TypedMerge::Mean => Merge::Mean,
                TypedMerge::Majority => Merge::Majority,
            }),
            memory_bytes: memory_budget(self.memory),
            temp_dir: match &self.temp_dir {
                Some(folder) => folder.clone(),
                None => folder_of(&self.output).to_path_buf(),
            },
        };
        let (path, disk) = (self.output.clone(), Disk::default());
        let place = Place { path, disk, replace: self.force };
        let progress = session.progress;
        let done = session.watch(|| transfer(&how, place, progress))?;
        session.log.say(format!(
            "{}: {} rows, {} of them without a value",
            self.output.display(),
            show_count(done.rows),
            show_count(done.unknown)
        ));
        CommandEnd::whole(&done)
    }
}
