//! `stonecut extract`: a mesh from a tree of tiles, as fine as is asked for, finer in a box.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_length, parse_memory};
use super::placing::numbers;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::io::OutputFormat;
use crate::pipeline::extract::{ExtractConfig, Wanted, extract};
use crate::system::paths::{Paths, Role};
use crate::system::units::{parse_count, show_bytes, show_count, show_outward};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Extracts one mesh from a folder of tiles, as fine as is asked for, finer in a box
///
/// Reads only the tiles that it needs. What was closed is closed: coarse and fine parts meet in common vertices.
#[derive(Clone, Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("fineness").required(true).args(["max_error", "triangles"]))]
pub struct Args {
    /// A folder that 'stonecut tiles' has written.
    tiles: PathBuf,
    /// A file ending in .ply, .stl, .obj or .glb.
    output: PathBuf,
    /// Largest distance from the mesh that was cut into tiles, in its units; 0 gives that mesh.
    #[arg(long, value_name = "E", value_parser = parse_length)]
    max_error: Option<f64>,
    /// Number of triangles.
    #[arg(long, value_name = "N", value_parser = parse_wanted)]
    triangles: Option<u64>,
    /// A box, in units of the mesh, that is finer than the rest; --triangles leaves its content alone.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = parse_box, allow_hyphen_values = true, requires = "max_error_inside")]
    inside: Option<BoxCorners>,
    /// Largest distance from the mesh in that box, at most --max-error.
    #[arg(long, value_name = "E", value_parser = parse_length, requires = "inside")]
    max_error_inside: Option<f64>,
    /// Words joined by commas: ascii, binary_little_endian or binary_big_endian; float or double coordinates; int or
    /// uint indices; ply, stl, obj or glb.
    #[arg(long, value_name = "FORMAT", default_value = "")]
    format: OutputFormat,
    /// Memory budget, everything included: 512MiB, 4GiB, 50% [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Worker threads [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
}

/// The lower and the upper corner of a box.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BoxCorners([[f64; 3]; 2]);

fn parse_wanted(text: &str) -> std::result::Result<u64, String> {
    match parse_count(text)? {
        0 => Err("a mesh has at least one triangle".to_owned()),
        n => Ok(n),
    }
}

fn parse_box(text: &str) -> std::result::Result<BoxCorners, String> {
    let Some([a, b, c, d, e, f]) = numbers::<6>(text) else {
        return Err("six numbers, the lower corner first: -1,-1,0,1,1,2".to_owned());
    };
    let (low, high) = ([a, b, c], [d, e, f]);
    match (0..3).all(|k| low[k] <= high[k]) {
        true => Ok(BoxCorners([low, high])),
        false => Err("the lower corner comes first: no number may exceed its partner".to_owned()),
    }
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        self.format.check(&self.output)?;
        Ok(Paths::new(self.force).with(Role::InputFolder, "TILES", &self.tiles).with(
            Role::Output,
            "OUTPUT",
            &self.output,
        ))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let progress = session.progress;
        let config = self.config();
        if let (Wanted::MaxError(outside), Some((_, inside))) = (config.wanted, config.inside)
            && inside > outside
        {
            return Err(Error::Usage(format!(
                "--max-error-inside {inside} is above --max-error {outside}: the box can only be finer than the rest"
            )));
        }
        super::arguments::warn_of_limit(self.memory, session.log);
        let done = session.watch(|| extract(&config, progress))?;
        let log = &mut *session.log;
        log.say(format!(
        "{}: {} triangles, {} vertices, {}, from {} tiles of {} triangles at most {} from the input",
        config.output.display(),
        done.triangles,
        done.vertices,
        show_bytes(done.bytes),
        done.tiles,
        show_count(done.cut_triangles),
        show_outward(done.deviation, 1, 3)
    ));
        if !done.reached {
            log.say_reason("the number of triangles was not met: what lies in the box stays, or no edge is left that may be collapsed".to_owned());
            return CommandEnd::of(&done, true);
        }
        if done.is_coarser {
            log.say_reason(format!(
            "the finest tiles are up to {:.3e} from the input, more than was asked for: positions in tiles are rounded, or the tree was made with --finest",
            done.deviation
        ));
            return CommandEnd::of(&done, true);
        }
        CommandEnd::whole(&done)
    }
}

impl Args {
    fn config(&self) -> ExtractConfig {
        let wanted = match (self.max_error, self.triangles) {
            (_, Some(n)) => Wanted::Triangles(n),
            (error, None) => Wanted::MaxError(error.unwrap_or(0.0)),
        };
        ExtractConfig {
            tiles: self.tiles.clone(),
            output: self.output.clone(),
            format: self.format,
            wanted,
            inside: self.inside.zip(self.max_error_inside).map(|(BoxCorners(c), most)| (c, most)),
            memory_bytes: memory_budget(self.memory),
            threads: super::arguments::threads(self.threads),
        }
    }
}
