//! `stonecut refine`: a mesh of any count out of a progressive mesh.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::outcome::write_json;
use super::placing::numbers;
use super::session::{Command, Session};
use crate::error::Result;
use crate::io::OutputFormat;
use crate::pipeline::refine::{RefineConfig, Shown, Wanted, refine, show};
use crate::progressive::View;
use crate::report::{Slider, slider_html};
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::{Place, Seen, write_whole};
use crate::system::units::{parse_count, show_bytes};
use std::path::{Path, PathBuf};

/// Makes a mesh of any number of triangles out of a progressive mesh
///
/// Reads only what that number needs. Of a file without --progressive-bits the result is, byte for byte, that of 'simplify
/// --progressive' with this number of triangles.
#[derive(Clone, Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("fineness").required(true).args(["triangles", "view", "page"]))]
pub struct Args {
    /// A file that 'stonecut simplify --progressive' has written.
    input: PathBuf,
    /// A file ending in .ply, .stl, .obj or .glb.
    #[arg(required_unless_present = "page", conflicts_with = "page")]
    output: Option<PathBuf>,
    /// Write a page instead that shows the mesh in a browser, with a slider over its triangles; whole by itself, with positions
    /// of 16 bits.
    #[arg(long, value_name = "OUT.html")]
    page: Option<PathBuf>,
    /// Number of triangles at most. Beyond the finest mesh of the file, that one; below its coarsest, that one, with exit
    /// code 3.
    #[arg(long, value_name = "N", value_parser = parse_count)]
    triangles: Option<u64>,
    /// The mesh for an eye: fine where it sees an error, most of all at silhouettes; coarse outside of its picture and where the
    /// surface faces away. Place of the eye, a place in the middle of the picture, its upright angle in degrees.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z,FOV", value_parser = parse_view, allow_hyphen_values = true)]
    view: Option<Eye>,
    /// With --view: largest error, in pixels.
    #[arg(long, value_name = "E", value_parser = super::arguments::parse_length, default_value_t = 1.0, requires = "view")]
    pixels: f64,
    /// With --view: height of the picture in pixels.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20), default_value_t = 1080, requires = "view")]
    height: u32,
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
    #[arg(long, value_name = "FILE", conflicts_with = "page")]
    report: Option<PathBuf>,
}

/// Places of an eye and of the middle of its picture, and the picture's upright angle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Eye([f64; 7]);

fn parse_view(text: &str) -> std::result::Result<Eye, String> {
    match numbers::<7>(text) {
        Some(view) if view[..3] == view[3..6] => {
            Err("the eye and the place that it looks at are the same".to_owned())
        }
        Some(view) if view[6] > 0.0 && view[6] < 180.0 => Ok(Eye(view)),
        _ => Err(
            "seven numbers: the eye, a place that it looks at, an angle above 0 and below 180: \
                  0,-5,2,0,0,0,45"
                .to_owned(),
        ),
    }
}

impl Args {
    fn wanted(&self) -> Wanted {
        match (self.triangles, self.view) {
            (None, Some(Eye([x, y, z, to_x, to_y, to_z, degrees]))) => Wanted::View(View {
                eye: [x, y, z],
                target: [to_x, to_y, to_z],
                degrees,
                pixels: self.pixels,
                height: f64::from(self.height),
            }),
            (n, _) => Wanted::Triangles(n.unwrap_or(u64::MAX)),
        }
    }
}

/// Writes the page with the slider.
fn write_page(args: &Args, page: &Path, session: &mut Session) -> Result<CommandEnd> {
    super::arguments::warn_of_limit(args.memory, session.log);
    let (memory_bytes, progress) = (memory_budget(args.memory), session.progress);
    let Shown { triangles, slides } =
        session.watch(|| show(&args.input, memory_bytes, progress))?;
    let title = args.input.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let text = slider_html(&title, &Slider { triangles, slides });
    let place = Place { replace: args.force, ..Place::from(page) };
    write_whole(place, text.as_bytes())?;
    session.log.say(format!(
        "{}: {} to {} triangles, {}",
        page.display(),
        triangles[0],
        triangles[1],
        show_bytes(text.len() as u64)
    ));
    Ok(CommandEnd::plain())
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        if let Some(output) = &self.output {
            self.format.check(output)?;
        }
        if let Some(page) = &self.page {
            super::arguments::require_ending("--page", page, &["html", "htm"])?;
        }
        Ok(Paths::new(self.force)
            .with(Role::Input, "INPUT", &self.input)
            .with_option(Role::Output, "OUTPUT", self.output.as_ref())
            .with_option(Role::Output, "--page", self.page.as_ref())
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref()))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        match (&self.output, &self.page) {
            (Some(output), _) => write_mesh(self, output, session),
            (None, Some(page)) => write_page(self, page, session),
            (None, None) => unreachable!("one of both is required"),
        }
    }
}

fn write_mesh(args: &Args, output: &Path, session: &mut Session) -> Result<CommandEnd> {
    let progress = session.progress;
    let report_to = args.report.as_deref().map(Seen::new);
    super::arguments::warn_of_limit(args.memory, session.log);
    let config = RefineConfig {
        input: args.input.clone(),
        output: output.to_path_buf(),
        format: args.format,
        wanted: args.wanted(),
        force: args.force,
        memory_bytes: memory_budget(args.memory),
    };
    let done = session.watch(|| refine(&config, progress))?;
    let log = &mut *session.log;
    log.say(format!(
        "{}: {} triangles, {} vertices, {}, from {} of the progressive mesh",
        config.output.display(),
        done.output.triangles,
        done.output.vertices,
        show_bytes(done.output.bytes),
        show_bytes(done.input.bytes_read)
    ));
    if let Some(view) = done.view {
        log.say(format!(
            "of {} steps the eye sees {}; {} were taken, with those that they depend on",
            view.steps, view.seen, view.taken
        ));
    }
    let target = done.target.unwrap_or(done.output.triangles);
    if target > done.input.finest {
        log.say(format!(
            "the file has no finer mesh than this one of {} triangles",
            done.input.finest
        ));
    }
    if let Some(to) = &report_to {
        write_json(to, &done)?;
    }
    if !done.target_met {
        log.say_reason(format!(
            "{} triangles were asked for; the coarsest mesh of the file has {}",
            target, done.input.coarsest
        ));
    }
    CommandEnd::of(&done, !done.target_met)
}
