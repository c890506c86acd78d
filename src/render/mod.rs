//! Pictures of meshes without a window or a GPU, of meshes larger than memory too.
//!
//! `render_mesh` and `render_source` are the ways in. A camera is aimed (`camera`), faces stream past the
//! vertices (`scene`, `vertices`) into a frame of samples (`raster`), which is then lit (`shade`) and
//! becomes a `Picture`. Nothing here simplifies or measures.

mod camera;
mod draw;
mod picture;
mod quadrics;
mod raster;
mod scene;
mod shade;
mod vector;
mod vertices;

pub use picture::{Letters, Picture, text_width};

use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::mesh::Mesh;
use crate::system::progress::Progress;
use camera::Camera;
use draw::{aim, render};
use raster::SAMPLE_BYTES;
use scene::{InMemory, OnDisk};

/// Samples of a frame may take so many bytes; beyond that each pixel gets fewer.
const FRAME_BYTES: usize = 400 << 20;

/// Where a picture is taken from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Direction {
    /// Chosen by the shape of the mesh, or across the surface for a close-up.
    #[default]
    Auto,
    /// From the mesh towards the viewer, in object space; any length.
    From([f64; 3]),
}

/// A place of interest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Its middle, in object space.
    pub centre: [f64; 3],
    /// Its radius in input units; it just fills the picture.
    pub radius: f64,
}

/// What a surface is painted with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coloring {
    /// Light clay.
    #[default]
    Plain,
    /// The vertices' own colours: of a file its properties red, green, blue; of a mesh in memory the
    /// three channels from `channel` on, in [0, 255]. Clay where there are none.
    Vertex {
        /// First of three channels.
        channel: usize,
    },
}

/// What a picture shows and how.
#[derive(Clone, Debug)]
pub struct View {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// From where.
    pub direction: Direction,
    /// A close-up; without, the whole mesh.
    pub zoom: Option<Sphere>,
    /// With the edges of triangles.
    pub edges: bool,
    /// Shaded smoothly across edges; otherwise facet by facet.
    pub smooth: bool,
    /// The paint.
    pub coloring: Coloring,
    /// Draws the error quadrics of so many vertices; only of a mesh in memory.
    pub n_quadrics: usize,
    /// The camera of another picture, from `aim_mesh` or `aim_source`; overrides direction and zoom.
    pub aim: Option<Aim>,
}

impl Default for View {
    fn default() -> Self {
        View {
            width: 1200,
            height: 900,
            direction: Direction::Auto,
            zoom: None,
            edges: false,
            smooth: true,
            coloring: Coloring::Plain,
            n_quadrics: 0,
            aim: None,
        }
    }
}

/// A camera in its place, so that several pictures can be taken from there.
#[derive(Clone, Debug)]
pub struct Aim(Camera);

/// What rendering may use.
#[derive(Clone, Copy, Debug)]
pub struct Resources {
    /// Memory in bytes, for vertices and picture together; at least some 100 MB are taken anyway.
    pub memory_bytes: u64,
    /// Threads.
    pub threads: usize,
}

/// A picture of a mesh in memory.
///
/// Errors: a size of 0 or above 16384, colour channels that are not there, a requested stop.
pub fn render_mesh(
    mesh: &Mesh,
    view: &View,
    threads: usize,
    progress: &Progress,
) -> Result<Picture> {
    let color = match view.coloring {
        Coloring::Vertex { channel } if channel + 3 <= mesh.n_channels => Some(channel),
        _ => None,
    };
    let resources = Resources { memory_bytes: u64::MAX, threads };
    let scene = InMemory { mesh, color };
    let overlay = quadrics::ellipsoids(mesh, view.n_quadrics);
    render(&scene, view, &overlay, resources, progress)
}

/// A picture of a mesh on disk, in bounded memory: faces stream by, vertices are held as far as they fit.
///
/// Errors: unreadable or broken files; shuffled meshes whose vertices do not fit into memory.
pub fn render_source(
    source: &MeshSource,
    view: &View,
    resources: Resources,
    progress: &Progress,
) -> Result<Picture> {
    let scene = OnDisk::new(source, view.coloring != Coloring::Plain);
    render(&scene, view, &[], resources, progress)
}

/// The camera that `view` gives a mesh; put it into the `aim` of other views.
pub fn aim_mesh(mesh: &Mesh, view: &View, threads: usize, progress: &Progress) -> Result<Aim> {
    let resources = Resources { memory_bytes: u64::MAX, threads };
    aim(&InMemory { mesh, color: None }, view, per_pixel(view)?, resources, progress).map(Aim)
}

/// The camera that `view` gives a file; put it into the `aim` of other views.
pub fn aim_source(
    source: &MeshSource,
    view: &View,
    resources: Resources,
    progress: &Progress,
) -> Result<Aim> {
    aim(&OnDisk::new(source, false), view, per_pixel(view)?, resources, progress).map(Aim)
}

/// Samples along each side of a pixel.
fn per_pixel(view: &View) -> Result<usize> {
    const LARGEST: u32 = 16_384;
    let (width, height) = (view.width, view.height);
    if width == 0 || height == 0 || width > LARGEST || height > LARGEST {
        return Err(Error::Usage(format!(
            "a picture of {width}x{height} pixels: each side must be 1 to {LARGEST}"
        )));
    }
    let pixels = width as usize * height as usize;
    Ok((1..=3).rev().find(|n| pixels * n * n * SAMPLE_BYTES <= FRAME_BYTES).unwrap_or(1))
}
