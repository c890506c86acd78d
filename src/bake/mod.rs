//! A new texture for a result: charts of the result's own, filled from the nearest places of the original.
//!
//! The result was simplified as if there were no charts, so nothing of the input's texture coordinates is left. Here it
//! gets charts and pages (`charts`), every texel that a chart covers becomes a few points of the result (`texels`),
//! each point finds the nearest place of the original (`original`, cell by cell, out of core) and the colour that the
//! original's own materials and images have there (`paint`, `images`), and pages become images (`pages`). Bytes depend on
//! the two meshes, the images and the options: not on threads, memory or the order of work. Does not write meshes.

mod charts;
mod directions;
mod grid;
mod nearest;
mod normals;
mod original;
mod pages;
mod projected;
mod settings;
mod texels;
mod tiles;
mod vertex_colours;

use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::measure::load;
use crate::mesh::Mesh;
use crate::system::units::show_bytes;
pub use crate::texture::Finish;
use crate::texture::{ImageCache, Palette, Purpose};
use charts::Charts;
use nearest::CellCache;
use original::Original;
pub use pages::Page;
use pages::{Canvas, PageKind};
use serde::{Deserialize, Serialize};
use settings::NormalReport;
pub use settings::{BakeReport, Corner, Means, NormalSource, Options, TANGENT_BYTES};
use std::path::{Path, PathBuf};
use texels::Canvases;
pub use tiles::{Photographs, TilePainter, TilePicture, TilesNeed, check_tiles};
pub use vertex_colours::{Coloured, colour_properties, colour_vertices, has_only_images};

/// Finished pages, and the texture coordinates of the result's corners in a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Baked {
    /// Pages in order; empty where the original has no colours.
    pub pages: Vec<Page>,
    /// Normal maps of the pages; empty where none are wanted.
    #[serde(default)]
    pub normals: Vec<Page>,
    /// Tangents of the result's corners, beside normal maps: records of `TANGENT_BYTES`, one a triangle.
    #[serde(default)]
    pub tangents: Option<PathBuf>,
    /// Records of `Corner::BYTES` bytes, one a triangle in the order of the result.
    pub corners: PathBuf,
    /// Look of the pages besides their images.
    pub finish: Finish,
    /// True if the pages show the colours of vertices: no image of the original does.
    #[serde(default)]
    pub holds_vertex_colours: bool,
    /// For people and for the report.
    pub report: BakeReport,
}

/// Shares of the memory: cells of the original, decoded images, points under way.
const CELL_SHARE: u64 = 3;
const IMAGE_SHARE: u64 = 3;
/// The rest is for cells and images while they are read.
const POINT_SHARE: u64 = 10;

/// Gives the result `shape` a texture from `original`; files get names that begin with `name` in the folder `place`.
///
/// `original` is the input as it was opened, texture coordinates at its corners; `shape` has no degenerate faces.
/// Memory: the result with its charts (about 100 bytes a triangle, 1 KiB a triangle of a block of at most 200,000), one
/// cell of the original, one decoded image, and points under way. Disk: the original in cells with texture coordinates
/// (about 40 bytes a triangle, three times that for a while), 4 bytes a texel, and the pages.
///
/// Errors: a budget that does not hold these, by name; an original without anything to bake.
pub fn bake(
    shape: &MeshSource,
    original: MeshSource,
    options: &Options,
    (place, name): (&Path, &str),
    means: Means,
) -> Result<Baked> {
    let progress = means.progress;
    let n_triangles = shape.n_triangles();
    let taken = load::bytes_in_memory(shape)
        + Charts::bytes(n_triangles)
        + if options.normals { FRAME_BYTES * n_triangles } else { 0 };
    let free_bytes = free_bytes(n_triangles, taken, means.memory_bytes)?;
    let loaded = load::load(shape, means.threads, progress)?;
    let mut mesh = loaded.mesh;
    let normals = match loaded.colours.and_then(|carried| carried.normal) {
        Some(channels) if options.normals => normals_of(&mesh, channels),
        None if options.normals => {
            return Err(Error::Internal("a result has no normals for its map".to_owned()));
        }
        _ => Vec::new(),
    };
    (mesh.channels, mesh.n_channels) = (Vec::new(), 0);
    if mesh.triangles.len() as u64 != shape.n_face_rows() {
        return Err(Error::Internal("a result has degenerate faces".to_owned()));
    }
    progress.count_from_zero(original.n_triangles());
    let palette = Palette::new(
        original.materials().map(|all| &**all),
        free_bytes / IMAGE_SHARE,
        Purpose::Bake,
    )?;
    let original =
        Original::cut(original, &palette, options, Means { memory_bytes: free_bytes, ..means })?;
    let free_bytes = free_bytes.saturating_sub(original.border_bytes());
    let (largest, share) = (original.largest_cell_bytes(), free_bytes / CELL_SHARE);
    if largest > share {
        return Err(Error::NoMemory(format!(
            "a cell of the input takes {} with its texture coordinates, the budget has {} for it: give more --memory, \
             smaller --cell-triangles, or choose --texture keep",
            show_bytes(largest),
            show_bytes(share)
        )));
    }
    let density = original.density(options);
    let mut charts = Charts::make(&mesh, density, options, means)?;
    if options.normals {
        charts.add_tangents(&mesh, &normals);
    }
    let mut notes = original.notes(&palette);
    progress.count_from_zero(mesh.triangles.len() as u64);
    let empty = || Canvas::new(&charts.pages, means.temp_dir, means.disk);
    let canvas = |is_wanted: bool| is_wanted.then(empty).transpose();
    let mut canvases =
        Canvases { colours: canvas(original.has_looks())?, normals: canvas(options.normals)? };
    let cache = ImageCache::new(&palette, free_bytes / IMAGE_SHARE);
    let seen = texels::fill(
        &texels::Scene {
            mesh: &mesh,
            charts: &charts,
            normals: &normals,
            original: &original,
            palette: &palette,
            images: &cache,
            side: texels::points_of_side(density.of_images, charts.texels_per_unit),
            batch_bytes: free_bytes / POINT_SHARE,
            threads: means.threads,
            progress,
        },
        &mut CellCache::new(free_bytes / CELL_SHARE),
        &mut canvases,
    )?;
    canvases.count();
    notes.extend(cache.notes());
    let kind = match palette.is_photographic() && !seen.has_alpha {
        true => PageKind::Jpeg,
        false => PageKind::Png,
    };
    let corners = place.join(format!("{name}-corners.part"));
    charts.write(&corners, means.disk)?;
    let tangents = options.normals.then(|| place.join(format!("{name}-tangents.part")));
    if let Some(path) = &tangents {
        charts.write_tangents(path, means.disk)?;
    }
    let source = original.normal_source();
    let holds_vertex_colours = original.has_colours() && !palette.has_images();
    drop((original, cache));
    let finish = |canvas: Option<Canvas>, kind: PageKind, name: &str| match canvas {
        Some(canvas) => canvas.finish(kind, (place, name), means),
        None => Ok((Vec::new(), 0)),
    };
    let (pages, of_colours) = finish(canvases.colours, kind, name)?;
    let (maps, of_normals) =
        finish(canvases.normals, PageKind::Directions, &format!("{name}-normals"))?;
    let bytes_of = |pages: &[Page]| pages.iter().map(|page| page.bytes).sum();
    let sizes = charts.pages.iter();
    let report = BakeReport {
        charts: charts.n_charts,
        pages: charts.pages.len() as u64,
        page_size: options.page_size,
        texels: sizes.map(|[width, height]| u64::from(*width) * u64::from(*height)).sum(),
        covered_texels: of_colours.max(of_normals),
        texel_density: charts.texels_per_unit,
        original_texel_density: density.of_images,
        bytes: bytes_of(&pages),
        normals: source.map(|source| NormalReport {
            source,
            mean_degrees: seen.mean_degrees(),
            bytes: bytes_of(&maps),
        }),
        notes,
    };
    let finish = palette.finish(seen.has_alpha);
    Ok(Baked { pages, normals: maps, tangents, corners, finish, holds_vertex_colours, report })
}

/// Normals of a result's vertices.
fn normals_of(mesh: &Mesh, channels: [usize; 3]) -> Vec<[f32; 3]> {
    let of = |v: u32| channels.map(|channel| mesh.channels_of(v)[channel]);
    (0..mesh.positions.len() as u32).map(of).collect()
}

/// Bytes of a triangle for tangents while they are found, and for the normals of half a vertex.
const FRAME_BYTES: u64 = 36;

/// Memory without which nothing can be baked: a cell of the original, an image, points under way.
const LEAST_WORK_BYTES: u64 = 48 << 20;

/// Bytes of a triangle of a result in memory, with half a vertex that carries colours.
const SHAPE_BYTES: u64 = 36;

fn free_bytes(n_triangles: u64, taken: u64, memory_bytes: u64) -> Result<u64> {
    let free = memory_bytes.checked_sub(taken).filter(|free| *free >= LEAST_WORK_BYTES);
    free.ok_or_else(|| {
        Error::NoMemory(format!(
            "a new texture for {n_triangles} triangles takes {} of memory, {} are left for it: give more --memory, ask \
             for fewer triangles, or choose --texture keep",
            show_bytes(taken + LEAST_WORK_BYTES),
            show_bytes(memory_bytes)
        ))
    })
}

/// Fails where a bake of a result of `n_triangles` would fail for want of memory, before any work is done; returns the
/// disk that it will take beside the result, in bytes.
pub fn check(
    original: &MeshSource,
    n_triangles: u64,
    options: &Options,
    memory_bytes: u64,
) -> Result<u64> {
    let mut taken = SHAPE_BYTES * n_triangles + Charts::bytes(n_triangles);
    if options.normals {
        taken += (FRAME_BYTES + 6) * n_triangles;
        taken += border_bytes(original.n_triangles(), options.cell_triangles);
    }
    let free = free_bytes(n_triangles, taken, memory_bytes)?;
    let palette =
        Palette::new(original.materials().map(|all| &**all), free / IMAGE_SHARE, Purpose::Bake)?;
    let maps = if options.normals { MAP_BYTES * original.n_triangles() } else { 0 };
    Ok(CORNER_BYTES * original.n_corners() + PAGE_BYTES * palette.n_pixels() + maps)
}

/// Bytes for the places that cells of an original share, about: the rim of a square patch of a cell's triangles.
fn border_bytes(n_triangles: u64, cell_triangles: u64) -> u64 {
    let n_cells = n_triangles.div_ceil(cell_triangles.max(1));
    let rim = 4.0 * (0.5 * cell_triangles as f64).sqrt();
    if n_cells > 1 { (n_cells as f64 * rim) as u64 * normals::BORDER_BYTES } else { 0 }
}

/// Bytes on disk for a corner of the original: sorted to part vertices along charts, then in cells.
const CORNER_BYTES: u64 = 80;

/// Bytes on disk for a pixel of the original's images: a page is rarely more than half full, and becomes an image.
const PAGE_BYTES: u64 = 12;

/// Bytes on disk of normal maps for a triangle of the original: two texels, as where there are no images.
const MAP_BYTES: u64 = 16;

/// True if the original has texture coordinates and an image that can be used.
pub fn has_images(original: &MeshSource) -> bool {
    let palette = Palette::new(original.materials().map(|all| &**all), u64::MAX, Purpose::Bake);
    original.has_corner_texture() && palette.is_ok_and(|palette| palette.has_images())
}

/// True if the original has anything that can be baked.
pub fn has_looks(original: &MeshSource) -> bool {
    original.has_corner_texture() || crate::measure::ColourChannels::of(original.schema()).is_some()
}
