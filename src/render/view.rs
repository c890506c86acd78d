//! Settings of a rendering: camera, paint, limits.

use super::camera::Camera;
use super::sample::SAMPLE_BYTES;
use stonecut_system::error::{Error, Result};

/// Limit in bytes of the samples of a frame; beyond it each pixel gets fewer.
const FRAME_BYTES: usize = 400 << 20;

/// The camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Direction {
    /// Chosen by the shape of the mesh, or across the surface for a close-up.
    #[default]
    Auto,
    /// From the mesh towards the viewer, in object space; any length.
    From([f64; 3]),
    /// The same, with the direction that is up in the picture.
    Upright {
        /// From the mesh towards the viewer.
        from: [f64; 3],
        /// Upwards.
        up: [f64; 3],
    },
}

/// A place of interest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Its middle, in object space.
    pub centre: [f64; 3],
    /// Its radius in input units; it just fills the picture.
    pub radius: f64,
}

/// Paint of a surface.
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
    /// The materials of a file: their images and colours. Where there are none: the vertices' own colours, or clay.
    Texture,
}

/// Light on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lighting {
    /// Lamps, sky and shade.
    #[default]
    Studio,
    /// None: every surface shows its own colour, both sides alike, before a plain grey (128 of 255).
    Unlit,
}

/// A number that vertices carry, and its colours: viridis from 0 to `top`.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// The name of the property of vertices, `error` for instance.
    pub property: String,
    /// The value at the end of the scale.
    pub top: f64,
}

/// Settings of a picture.
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
    /// The light.
    pub lighting: Lighting,
    /// Painted by a number of the vertices instead, with a legend; only of a file.
    pub scale: Option<Scale>,
    /// Draws the error quadrics of this many vertices; only of a mesh in memory.
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
            lighting: Lighting::Studio,
            scale: None,
            n_quadrics: 0,
            aim: None,
        }
    }
}

/// A camera in its place, so that several pictures can be taken from there.
#[derive(Clone, Debug)]
pub struct Aim(pub(super) Camera);

/// Resources that rendering may use.
#[derive(Clone, Copy, Debug)]
pub struct Resources {
    /// Memory in bytes, for vertices and picture together; at least some 100 MB are taken anyway.
    pub memory_bytes: u64,
    /// Threads.
    pub threads: usize,
}

/// Samples along each side of a pixel.
pub(super) fn per_pixel(view: &View) -> Result<usize> {
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
