//! A new texture for a result: charts of the result's own, filled from the nearest places of the original.
//!
//! The result was simplified as if there were no charts, so nothing of the input's texture coordinates is left. Here it
//! gets charts and pages (`charts`), every texel that a chart covers becomes a few points of the result (`texels`),
//! each point finds the nearest place of the original (`original`, cell by cell, out of core) and the colour that the
//! original's own materials and images have there (`paint`, `images`), and pages become images (`pages`). Bytes depend on
//! the two meshes, the images and the options: not on threads, memory or the order of work. Does not write meshes.

mod charts;
mod nearest;
mod original;
mod pages;
mod settings;
mod texels;

use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::measure::load;
use crate::system::units::show_bytes;
pub use crate::texture::Finish;
use crate::texture::{ImageCache, Palette, Purpose};
use charts::Charts;
use original::Original;
use pages::Canvas;
pub use pages::Page;
use pages::PageKind;
use serde::{Deserialize, Serialize};
pub use settings::{BakeReport, Corner, Means, Options};
use std::path::{Path, PathBuf};

/// Finished pages, and the texture coordinates of the result's corners in a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Baked {
    /// Pages in order.
    pub pages: Vec<Page>,
    /// Records of `Corner::BYTES` bytes, one a triangle in the order of the result.
    pub corners: PathBuf,
    /// Look of the pages besides their images.
    pub finish: Finish,
    /// For people and for the report.
    pub report: BakeReport,
}

/// Shares of the memory: cells of the original, decoded images, points under way.
const CELL_SHARE: u64 = 3;
const IMAGE_SHARE: u64 = 3;

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
    let taken = load::bytes_in_memory(shape) + Charts::bytes(shape.n_triangles());
    let free_bytes = free_bytes(shape.n_triangles(), taken, means.memory_bytes)?;
    let mut mesh = load::load(shape, means.threads, progress)?.mesh;
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
    let original = Original::cut(
        original,
        &palette,
        options.cell_triangles,
        Means { memory_bytes: free_bytes, ..means },
    )?;
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
    let charts = Charts::make(&mesh, density, options, means)?;
    let mut notes = original.notes(&palette);
    progress.count_from_zero(mesh.triangles.len() as u64);
    let mut canvas = Canvas::new(&charts.pages, means.temp_dir)?;
    let cache = ImageCache::new(&palette, free_bytes / IMAGE_SHARE);
    let seen = texels::fill(
        &texels::Scene {
            mesh: &mesh,
            charts: &charts,
            original: &original,
            palette: &palette,
            images: &cache,
            cell_bytes: free_bytes / CELL_SHARE,
            batch_bytes: free_bytes / 4,
            threads: means.threads,
            progress,
        },
        &mut canvas,
    )?;
    notes.extend(cache.notes());
    let kind = match palette.is_photographic() && !seen.has_alpha {
        true => PageKind::Jpeg,
        false => PageKind::Png,
    };
    let corners = place.join(format!("{name}-corners.part"));
    charts.write(&corners, means.disk)?;
    drop((original, cache));
    let (pages, covered_texels) = canvas.finish(kind, (place, name), means)?;
    let report = BakeReport {
        charts: charts.n_charts,
        pages: pages.len() as u64,
        page_size: options.page_size,
        texels: pages.iter().map(|page| u64::from(page.width) * u64::from(page.height)).sum(),
        covered_texels,
        texel_density: charts.texels_per_unit,
        original_texel_density: density.of_images,
        bytes: pages.iter().map(|page| page.bytes).sum(),
        notes,
    };
    Ok(Baked { pages, corners, finish: palette.finish(seen.has_alpha), report })
}

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
pub fn check(original: &MeshSource, n_triangles: u64, memory_bytes: u64) -> Result<u64> {
    let taken = SHAPE_BYTES * n_triangles + Charts::bytes(n_triangles);
    let free = free_bytes(n_triangles, taken, memory_bytes)?;
    let palette =
        Palette::new(original.materials().map(|all| &**all), free / IMAGE_SHARE, Purpose::Bake)?;
    Ok(CORNER_BYTES * original.n_corners() + PAGE_BYTES * palette.n_pixels())
}

/// Bytes on disk for a corner of the original: sorted to part vertices along charts, then in cells.
const CORNER_BYTES: u64 = 80;

/// Bytes on disk for a pixel of the original's images: a page is rarely more than half full, and becomes an image.
const PAGE_BYTES: u64 = 12;

/// Tells if the original has texture coordinates and an image that can be used.
pub fn has_images(original: &MeshSource) -> bool {
    let palette = Palette::new(original.materials().map(|all| &**all), u64::MAX, Purpose::Bake);
    original.has_corner_texture() && palette.is_ok_and(|palette| palette.has_images())
}

/// Tells if the original has anything that can be baked.
pub fn has_looks(original: &MeshSource) -> bool {
    original.has_corner_texture() || crate::measure::ColourChannels::of(original.schema()).is_some()
}
