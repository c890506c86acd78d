//! Synthetic scans of any size: closed-form, seeded, streamed.
//!
//! `write_ply` is the way in for files, `mesh` for tests. A `Surface` says what vertex and face number i
//! are; `write` turns it into a file; `shuffle` puts into random order what cannot be computed in one.
//! Nothing here simplifies, measures or reads a mesh.

mod noise;
mod permutation;
mod sculpture;
mod statue;
mod surface;
mod terrain;
mod write;

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::progress::Progress;
use std::path::Path;
use surface::{InOrder, Indexed, Shuffled, Surface};
use write::{Layout, Unfinished};

/// The synthetic meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Fractal height field with scan noise; open boundary.
    Terrain,
    /// A stone head with creases and fine chisel marks; closed, genus 0.
    Statue,
}

impl std::str::FromStr for Kind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "terrain" => Ok(Kind::Terrain),
            "statue" => Ok(Kind::Statue),
            _ => Err(format!(
                "'{text}' is no kind of mesh; there are terrain, statue, gyroid and scans"
            )),
        }
    }
}

/// What to make; every value is final.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Which mesh.
    pub kind: Kind,
    /// At least so many triangles; each kind documents how many more it may get.
    pub n_triangles: u64,
    /// Another seed gives another mesh of the same kind and size.
    pub seed: u64,
    /// Random instead of natural order of vertices, faces and corners.
    pub shuffle: bool,
    /// With `red green blue`; `scans` always has them.
    pub color: bool,
    /// With texture coordinates `s t`.
    pub uv: bool,
}

/// How large the finished mesh is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Number of vertices.
    pub n_vertices: u64,
    /// Number of triangles.
    pub n_triangles: u64,
}

/// Writes a synthetic mesh as binary little-endian PLY.
///
/// Runs on the current rayon pool; its bytes depend on `settings` alone. The file appears by rename.
/// Errors: an existing `path` without `force`, more than 2^32 vertices, whatever the system refuses.
pub fn write_ply(
    path: &Path,
    settings: &Settings,
    force: bool,
    progress: &Progress,
) -> Result<Counts> {
    check(settings)?;
    let mut file = Unfinished::create(path, force)?;
    let surface = surface(settings);
    let counts = Counts { n_vertices: surface.n_vertices(), n_triangles: surface.n_faces() };
    progress.begin("synth", 1, 1, counts.n_triangles);
    let layout = layout(settings, counts.n_vertices);
    let comments = [format!(
        "stonecut {} synth {:?} --triangles {} --seed {}{}",
        env!("CARGO_PKG_VERSION"),
        settings.kind,
        settings.n_triangles,
        settings.seed,
        if settings.shuffle { " --shuffle" } else { "" },
    )
    .to_lowercase()];
    let header = layout.header(counts.n_vertices, counts.n_triangles, &comments);
    file.write(header.as_bytes())?;
    write::vertices(&*surface, layout, progress, |bytes| file.write(&bytes))?;
    write::faces(&*surface, progress, |bytes| file.write(&bytes))?;
    file.finish()?;
    Ok(counts)
}

/// The same mesh in memory, for tests and small demonstrations; colours are three channels in [0, 255],
/// texture coordinates two more.
///
/// Errors: settings that `write_ply` refuses.
pub fn mesh(settings: &Settings) -> Result<Mesh> {
    check(settings)?;
    let surface = surface(settings);
    let layout = layout(settings, surface.n_vertices());
    let mut mesh = Mesh {
        n_channels: if layout.color { 3 } else { 0 } + if layout.uv { 2 } else { 0 },
        ..Mesh::default()
    };
    let mut vertices = Vec::new();
    for block in 0..surface.n_vertex_blocks() {
        vertices.clear();
        surface.vertices(block, &mut vertices);
        for vertex in &vertices {
            mesh.positions.push(vertex.position.map(f64::from));
            if layout.color {
                mesh.channels.extend(vertex.color.map(f32::from));
            }
            if layout.uv {
                mesh.channels.extend(vertex.uv);
            }
        }
    }
    let mut faces = Vec::new();
    for block in 0..surface.n_face_blocks() {
        faces.clear();
        surface.faces(block, &mut faces);
        mesh.triangles.extend(faces.iter().map(|face| face.map(|id| id as u32)));
    }
    Ok(mesh)
}

fn surface(settings: &Settings) -> Box<dyn Surface> {
    let Settings { n_triangles, seed, .. } = *settings;
    let color = settings.color;
    match settings.kind {
        Kind::Terrain => ordered(terrain::Terrain::new(n_triangles, seed, color), settings),
        Kind::Statue => ordered(statue::Statue::new(n_triangles, seed, color), settings),
    }
}

fn ordered(surface: impl Indexed + 'static, settings: &Settings) -> Box<dyn Surface> {
    if settings.shuffle {
        Box::new(Shuffled::new(surface, settings.seed))
    } else {
        Box::new(InOrder(surface))
    }
}

fn layout(settings: &Settings, n_vertices: u64) -> Layout {
    Layout { color: settings.color, uv: settings.uv, unsigned: n_vertices > 1 << 31 }
}

fn check(settings: &Settings) -> Result<()> {
    const MOST: u64 = 7_000_000_000;
    if settings.n_triangles == 0 || settings.n_triangles > MOST {
        let asked = settings.n_triangles;
        return Err(Error::Usage(format!(
            "--triangles {asked}: a synthetic mesh has 1 to {MOST} triangles (its vertices are numbered \
             in 32 bits)"
        )));
    }
    Ok(())
}
