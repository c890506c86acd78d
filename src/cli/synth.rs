//! `stonecut synth`: makes a synthetic scan.

use super::answer::CommandEnd;
use super::log::Said;
use super::session::{Command, Session};
use crate::error::Result;
use crate::io::{OutputFormat, OutputKind};
use crate::synth::{self, Cut, Kind, Rounding, Settings, Writing};
use crate::system::paths::{Paths, Role};
use crate::system::units::{parse_count, parse_ratio, show_bytes, show_count};
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Makes a synthetic scan of any size: closed-form, the same for the same seed.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Kind of mesh: terrain, statue, gyroid, scans, volume, rooms or foam.
    pub kind: Kind,
    /// The file to write; with --tiles, a folder that is not there yet.
    pub output: PathBuf,
    /// Least number of triangles: 20000, 500k, 4M, 1.5G.
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub triangles: u64,
    /// Another seed gives another mesh.
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Vertices, faces and corners in random order.
    #[arg(long)]
    pub shuffle: bool,
    /// With vertex colours (scans and rooms always have them).
    #[arg(long)]
    pub color: bool,
    /// With texture coordinates s, t.
    #[arg(long)]
    pub uv: bool,
    /// terrain, statue, volume: factor of the scanner's noise, from 0 (a clean surface) to 4.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub noise: f64,
    /// volume: whole voxel values, which meet the level exactly: triangles of no area, coinciding vertices.
    #[arg(long)]
    pub integer: bool,
    /// terrain: water at a height of exactly 0 instead of ground below it.
    #[arg(long)]
    pub sea: bool,
    /// rooms: largest number of texture images, written beside OUTPUT [default: one for 25k triangles, at most 1000].
    ///
    /// PLY names them in its comments (texcoord and texnumber at faces), OBJ by a material library; STL and GLB get
    /// none.
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub pages: Option<u64>,
    /// Cut the scan into about N files of equal size in the folder OUTPUT, each with its own copies of vertices on borders, as
    /// photogrammetry programs write them; --format says of which kind [default: ply].
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub tiles: Option<u64>,
    /// Round the coordinates of tiles to this many digits after the point, or to a step (0.005), each tile counting from another
    /// place.
    #[arg(long, value_name = "DIGITS|STEP", requires = "tiles")]
    pub round: Option<Rounding>,
    /// Split edges on borders in one of the two tiles.
    #[arg(long, requires = "tiles")]
    pub t_junctions: bool,
    /// Let tiles reach into their neighbours by a share of their sides: 2%.
    #[arg(long, value_name = "M", value_parser = parse_ratio, requires = "tiles")]
    pub overlap: Option<f64>,
    /// Words joined by commas: ascii, binary_little_endian or binary_big_endian; float or double; int or
    /// uint; ply, stl, obj or glb [default: by OUTPUT's name, binary].
    #[arg(long, value_name = "FORMAT", default_value = "")]
    pub format: OutputFormat,
    /// Overwrite an existing file.
    #[arg(long)]
    pub force: bool,
    /// Threads to use [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        if self.tiles.is_some() {
            tile_format(self.format).check(&self.output)?;
            return Ok(Paths::new(self.force).with(Role::OutputFolder, "OUTPUT", &self.output));
        }
        self.format.check(&self.output)?;
        Ok(Paths::new(self.force).with(Role::Output, "OUTPUT", &self.output))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        if let Some(n_tiles) = self.tiles {
            return make_tiles(self, n_tiles, session);
        }
        let made =
            synth::write_ply(&self.output, &settings(self), writing(self), session.progress)?;
        say(self, &made, &mut Said(session.log));
        CommandEnd::whole(&serde_json::json!({
            "output": {
                "path": self.output, "vertices": made.n_vertices, "triangles": made.n_triangles,
                "images": made.n_images,
            },
        }))
    }
}

fn say(args: &Args, counts: &synth::Counts, log: &mut Said) {
    let bytes = std::fs::metadata(&args.output).map_or(0, |file| file.len());
    // A closed standard error is not a reason to fail: the mesh is there.
    let _ = writeln!(
        log,
        "{}: {} triangles ({}), {} vertices, {}{}",
        args.output.display(),
        counts.n_triangles,
        show_count(counts.n_triangles),
        counts.n_vertices,
        show_bytes(bytes),
        match counts.n_images {
            0 if args.kind == Kind::Rooms =>
                ", no images: synth writes them beside PLY and OBJ".to_owned(),
            0 => String::new(),
            1 => ", 1 image".to_owned(),
            n => format!(", {n} images"),
        },
    );
}

/// The format of tiles, whose folder has a name without an ending.
fn tile_format(format: OutputFormat) -> OutputFormat {
    OutputFormat { kind: format.kind.or(Some(OutputKind::Ply)), ..format }
}

fn make_tiles(args: &Args, n_tiles: u64, session: &mut Session) -> Result<CommandEnd> {
    let cut = Cut {
        n_tiles,
        rounding: args.round,
        t_junctions: args.t_junctions,
        overlap: args.overlap.unwrap_or(0.0),
    };
    let writing = Writing { format: tile_format(args.format), ..writing(args) };
    let made = synth::write_tiles(&args.output, &settings(args), &cut, writing, session.progress)?;
    let mut more = String::new();
    if made.n_images > 0 {
        more = format!(", {} images", made.n_images);
    }
    if made.n_split > 0 {
        more += &format!(", {} edges split in one of two tiles", made.n_split);
    }
    session.log.say(format!(
        "{}: {} tiles with {} triangles ({}), {} vertices{more}",
        args.output.display(),
        made.n_tiles,
        made.n_triangles,
        show_count(made.n_triangles),
        made.n_vertices,
    ));
    CommandEnd::whole(&serde_json::json!({
        "output": {
            "path": args.output, "vertices": made.n_vertices, "triangles": made.n_triangles,
            "images": made.n_images, "tiles": made.n_tiles, "split_edges": made.n_split,
        },
    }))
}

fn writing(args: &Args) -> Writing {
    let threads = super::arguments::threads(args.threads).get();
    Writing { threads, force: args.force, format: args.format }
}

fn settings(args: &Args) -> Settings {
    Settings {
        kind: args.kind,
        n_triangles: args.triangles,
        seed: args.seed,
        shuffle: args.shuffle,
        color: args.color,
        uv: args.uv,
        noise: args.noise,
        integer: args.integer,
        sea: args.sea,
        pages: args.pages,
    }
}
