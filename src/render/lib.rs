//! Pictures of meshes without a window or a GPU, of meshes larger than memory too.
//!
//! `render_mesh` and `render_source` are the ways in. A camera is aimed (`camera`), faces stream past the
//! vertices (`scene`, `vertices`) into a frame of samples (`raster`), which is then lit (`shade`) and
//! becomes a `Picture`. Nothing here simplifies or measures.

pub mod texture;

mod camera;
mod draw;
mod frames;
mod legend;
mod picture;
mod quadrics;
mod raster;
mod sample;
mod scene;
mod shade;
mod shots;
mod skin;
mod turn;
mod vector;
mod vertices;
mod view;

pub use legend::top_of;
pub use picture::{Letters, Picture, text_width};
pub use shots::{Shot, aims_around, has_images, has_looks, hold_images, least_bytes, shots};
pub use view::{Aim, Coloring, Direction, Lighting, Resources, Scale, Sphere, View};

use draw::{aim, draw, free_bytes};
use scene::{InMemory, OnDisk};
use stonecut_io::ply::MeshSource;
use stonecut_mesh::Mesh;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;
use view::per_pixel;

/// Refuses a picture that the memory does not hold, before anything is read for it, its images left out of account; names the memory
/// and the size that do.
pub fn hold(view: &View, resources: Resources) -> Result<()> {
    free_bytes(view, 0, resources).map(drop)
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
    let free = free_bytes(view, 0, resources)?;
    let drawn = draw(&scene, view, (None, &overlay), (resources, free), progress)?;
    drawn.picture(view.lighting, threads, progress)
}

/// A picture of a mesh on disk, in bounded memory: faces stream by, vertices are held as far as they fit.
///
/// Images that are missing or damaged are noted in `progress`; their materials' colours stand for them.
///
/// Errors: unreadable or broken files; shuffled meshes whose vertices do not fit into memory.
pub fn render_source(
    source: &MeshSource,
    view: &View,
    resources: Resources,
    progress: &Progress,
) -> Result<Picture> {
    let mut found = None;
    let views = std::slice::from_ref(view);
    shots(source, views, resources, progress, |_, shot| {
        found = Some(shot.picture);
        Ok(())
    })?;
    let mut picture = found.ok_or_else(|| Error::Internal("a view has no picture".to_owned()))?;
    if let Some(scale) = &view.scale {
        legend::draw(scale, &mut picture);
    }
    Ok(picture)
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
    aim(&OnDisk::plain(source), view, per_pixel(view)?, resources, progress).map(Aim)
}
