//! `stonecut synth`: makes a synthetic scan.

use super::answer::CommandEnd;
use super::log::Said;
use super::session::{Command, Session};
use crate::error::Result;
use crate::io::OutputFormat;
use crate::synth::{self, Kind, Settings, Writing};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::{parse_count, show_bytes, show_count};
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Makes a synthetic scan of any size: closed-form, the same for the same seed.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Kind of mesh: terrain, statue, gyroid, scans, volume or rooms.
    pub kind: Kind,
    /// The file to write.
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
    /// PLY names them in its comments (texcoord and texnumber at faces), OBJ by a material library; STL and GLB
    /// carry no textures and get none.
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub pages: Option<u64>,
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
        self.format.check(&self.output)?;
        Ok(Paths::new(self.force).with(Role::Output, "OUTPUT", &self.output))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let made = make(self, session.progress)?;
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
                ", no images: this format carries no textures".to_owned(),
            0 => String::new(),
            1 => ", 1 image".to_owned(),
            n => format!(", {n} images"),
        },
    );
}

fn make(args: &Args, progress: &Progress) -> Result<synth::Counts> {
    let settings = Settings {
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
    };
    let threads = super::arguments::threads(args.threads).get();
    let writing = Writing { threads, force: args.force, format: args.format };
    synth::write_ply(&args.output, &settings, writing, progress)
}
