//! `stonecut render`: a picture of a mesh.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::placing::numbers;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::io::InputPaths;
use crate::io::ply::{MeshSource, Place};
use crate::measure::load::load_with;
use crate::render::{
    Coloring, Direction, Lighting, Picture, Resources, Scale, Sphere, View, aim_source, has_images,
    hold, hold_images, render_mesh, render_source, top_of,
};
use crate::system::disk::folder_of;
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::{memory_word, show_bytes, show_count};
use serde_json::json;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Renders a mesh of any size into a PNG picture, without a window or a GPU.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The mesh; several are shown side by side, all seen by the camera of the first. The files of a folder or a list
    /// (@list.txt) are one mesh.
    #[arg(required = true)]
    pub mesh: Vec<PathBuf>,
    /// The PNG file to write.
    #[arg(short, long, value_name = "PNG")]
    pub output: PathBuf,
    /// Lines above a picture; once for each mesh.
    #[arg(long, value_name = "TEXT")]
    pub caption: Vec<String>,
    /// With several meshes: each seen by its own camera.
    #[arg(long)]
    pub own_camera: bool,
    /// Pixels of each picture.
    #[arg(long, value_name = "WxH", default_value = "1200x900", value_parser = parse_size)]
    pub size: (u32, u32),
    /// From where: auto, a direction x,y,z towards the viewer, or front, back, left, right, top, bottom with z up (front looks
    /// along y; in glTF y is up, and front looks along -z).
    #[arg(long, value_name = "DIR", default_value = "auto", value_parser = parse_direction,
          allow_hyphen_values = true)]
    pub view: Direction,
    /// A close-up of a sphere: its middle x,y,z and its radius r.
    #[arg(long, value_name = "x,y,z,r", value_parser = parse_sphere, allow_hyphen_values = true)]
    pub zoom: Option<Sphere>,
    /// With the edges of triangles.
    #[arg(long)]
    pub edges: bool,
    /// Facet by facet instead of smooth across edges.
    #[arg(long)]
    pub flat: bool,
    /// Paint: materials with their images, vertex colours, or plain clay [default: texture where a mesh has images,
    /// otherwise plain].
    #[arg(long, value_name = "PAINT", value_parser = ["texture", "vertex", "plain"])]
    pub color: Option<String>,
    /// Paint by a number that the vertices carry, with a legend: 'error' for what 'simplify --error-field' wrote
    /// (a distance in the mesh's units), or any other property of vertices; several meshes share one scale.
    /// 'texture' is the same as --color texture.
    #[arg(long, value_name = "PROPERTY", conflicts_with_all = ["color", "quadrics"])]
    pub color_by: Option<String>,
    /// Without lamps and shade: every surface shows its own colour, before plain grey.
    #[arg(long)]
    pub unlit: bool,
    /// Upper end of the scale of --color-by [default: what 99.9 % of the vertices do not exceed].
    #[arg(long, value_name = "VALUE", requires = "color_by", value_parser = parse_scale_end)]
    pub scale_to: Option<f64>,
    /// Draw the error quadrics of the N most important vertices as ellipsoids (reads the mesh into
    /// memory).
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub quadrics: usize,
    /// Memory to use: 4GiB or 50% [default: 75 % of what this process may use].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    pub memory: Option<u64>,
    /// Threads to use [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Overwrite an existing picture.
    #[arg(long)]
    pub force: bool,
}

/// The word of `--color-by` that is not a property.
const TEXTURE: &str = "texture";

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        let inputs = |mesh: &PathBuf| InputPaths::from(mesh).within(self.memory);
        let add = |paths, mesh: &PathBuf| inputs(mesh).add_to(paths, "MESH");
        self.output_paths(self.mesh.iter().try_fold(Paths::new(self.force), add)?)
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let progress = session.progress;
        let (picture, n_triangles) = picture(self, progress)?;
        progress.check()?;
        write(self, &picture)?;
        session.warn_of_notes();
        session.log.say(format!(
            "{}: {}x{} pixels, {} triangles",
            self.output.display(),
            picture.width,
            picture.height,
            show_count(n_triangles)
        ));
        CommandEnd::whole(
            &json!({ "output": { "path": self.output }, "losses": progress.losses() }),
        )
    }
}

impl Args {
    /// The same with these in place of the meshes.
    pub(super) fn output_paths(&self, paths: Paths) -> Result<Paths> {
        super::arguments::require_ending("--output", &self.output, &["png"])?;
        Ok(paths.with(Role::Output, "--output", &self.output))
    }
}

/// Writes the picture where that was asked for.
pub(super) fn write(args: &Args, picture: &Picture) -> Result<()> {
    let place = Place { replace: args.force, ..Place::from(&args.output) };
    crate::system::pending_file::write_whole(place, &picture.to_png()?)
}

impl Args {
    /// The view that was typed.
    pub(super) fn view(&self) -> View {
        View {
            width: self.size.0,
            height: self.size.1,
            direction: self.view,
            zoom: self.zoom,
            edges: self.edges,
            smooth: !self.flat,
            coloring: match self.color.as_deref() {
                Some("vertex") => Coloring::Vertex { channel: 0 },
                Some("texture") => Coloring::Texture,
                _ if self.color_by.as_deref() == Some(TEXTURE) => Coloring::Texture,
                _ => Coloring::Plain,
            },
            lighting: if self.unlit { Lighting::Unlit } else { Lighting::Studio },
            scale: None,
            n_quadrics: self.quadrics,
            aim: None,
        }
    }
}

/// The picture of all meshes side by side, and the number of their triangles.
pub(super) fn picture(args: &Args, progress: &Progress) -> Result<(Picture, u64)> {
    let mut view = args.view();
    let memory_bytes = memory_budget(args.memory);
    let threads = super::arguments::threads(args.threads).get();
    let resources = Resources { memory_bytes, threads };
    let held = hold(&view, resources);
    let temp_dir = match args.output == Path::new("-") {
        true => Path::new("."),
        false => folder_of(&args.output),
    };
    if held.is_err() {
        // Images may want more; what is named has to do.
        let of_images = args.mesh.iter().map(|path| {
            let source = super::arguments::open_mesh(path, temp_dir, args.memory)?;
            hold_images(
                &source,
                &View { coloring: coloring(args, &source), ..view.clone() },
                resources,
            )
        });
        return Err(Error::first_of(std::iter::once(held).chain(of_images))
            .expect_err("the first is an error"));
    }
    if let Some(property) = args.color_by.as_ref().filter(|property| *property != TEXTURE) {
        let mut top = 0f64;
        for path in &args.mesh {
            let source = super::arguments::open_mesh(path, temp_dir, args.memory)?;
            top = top.max(top_of(&source, property, progress)?);
        }
        let top = args.scale_to.unwrap_or(top);
        view.scale = Some(Scale { property: property.clone(), top });
    }
    let mut pictures = Vec::new();
    let mut n_triangles = 0;
    for path in &args.mesh {
        let source = super::arguments::open_mesh(path, temp_dir, args.memory)?;
        source.refuse_output(&args.output)?;
        n_triangles += source.n_triangles();
        view.direction = of_format(args.view, &source);
        if args.mesh.len() > 1 && !args.own_camera && view.aim.is_none() {
            view.aim = Some(aim_source(&source, &view, resources, progress)?);
        }
        view.coloring = coloring(args, &source);
        if args.quadrics > 0 {
            hold_whole(&source, memory_bytes)?;
        }
        pictures.push(if args.quadrics > 0 {
            render_mesh(
                &load_with(&source, None, threads, progress)?.mesh,
                &view,
                threads,
                progress,
            )?
        } else {
            render_source(&source, &view, resources, progress)?
        });
    }
    let captions = args.caption.iter().map(String::as_str).chain(std::iter::repeat(""));
    let parts: Vec<(&Picture, &str)> = pictures.iter().zip(captions).collect();
    Ok((Picture::side_by_side(&parts), n_triangles))
}

/// The paint of a mesh: what was typed, or that of its images.
fn coloring(args: &Args, source: &MeshSource) -> Coloring {
    let is_free = args.color.is_none() && args.color_by.is_none();
    let is_textured = args.quadrics == 0 && has_images(source);
    if is_free && is_textured { Coloring::Texture } else { args.view().coloring }
}

/// Bytes of a vertex and of a triangle of a mesh in memory, with the quadrics of its vertices and the picture's own copies.
const QUADRIC_BYTES: [u64; 2] = [24 + 80 + 24 + 24, 12 + 12];

/// Refuses a mesh that the memory does not hold as a whole.
fn hold_whole(source: &MeshSource, memory_bytes: u64) -> Result<()> {
    let [vertex, triangle] = QUADRIC_BYTES;
    let needed = (500 << 20) + vertex * source.n_vertices() + triangle * source.n_triangles();
    if needed <= memory_bytes {
        return match u32::try_from(source.n_vertices()) {
            Ok(_) => Ok(()),
            Err(_) => {
                Err(Error::Usage("--quadrics: a mesh of fewer than 2^32 vertices".to_owned()))
            }
        };
    }
    Err(Error::NoMemory(format!(
        "--quadrics: {} takes {} in memory; give --memory {}, or leave them out",
        source.path().display(),
        show_bytes(needed),
        memory_word(needed)
    )))
}

fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let complaint = || format!("invalid size '{text}': write 1200x900");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(complaint)?;
    let number = |text: &str| text.trim().parse::<u32>().map_err(|_| complaint());
    Ok((number(width)?, number(height)?))
}

fn parse_direction(text: &str) -> Result<Direction, String> {
    let complaint = || {
        format!("invalid view '{text}': write auto, front, back, left, right, top, bottom or x,y,z")
    };
    let side = |from| Direction::Upright { from, up: [0.0, 0.0, 1.0] };
    Ok(match text {
        "auto" => Direction::Auto,
        "front" => side([0.0, -1.0, 0.0]),
        "back" => side([0.0, 1.0, 0.0]),
        "left" => side([-1.0, 0.0, 0.0]),
        "right" => side([1.0, 0.0, 0.0]),
        "top" => side([0.0, 0.0, 1.0]),
        "bottom" => side([0.0, 0.0, -1.0]),
        _ => {
            let numbers = numbers::<3>(text).ok_or_else(complaint)?;
            if numbers == [0.0; 3] {
                return Err(complaint());
            }
            Direction::From(numbers)
        }
    })
}

/// A side by name as the format of the file has its axes: in glTF y is up, and the front faces along z.
fn of_format(direction: Direction, source: &MeshSource) -> Direction {
    let turned = |[x, y, z]: [f64; 3]| [x, z, -y];
    match direction {
        Direction::Upright { from, up } if source.file_format() == "glTF" => {
            Direction::Upright { from: turned(from), up: turned(up) }
        }
        other => other,
    }
}

fn parse_sphere(text: &str) -> Result<Sphere, String> {
    match numbers::<4>(text) {
        Some([x, y, z, radius]) if radius > 0.0 => Ok(Sphere { centre: [x, y, z], radius }),
        _ => Err(format!("invalid sphere '{text}': write x,y,z,r with a radius r above 0")),
    }
}

fn parse_scale_end(text: &str) -> Result<f64, String> {
    let end = text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
    end.ok_or_else(|| format!("'{text}' is not the end of a scale; write a number above 0"))
}
