//! A new texture for a result: charts of the result's own, filled from the nearest places of the original.
//!
//! The result was simplified as if there were no charts, so nothing of the input's texture coordinates is left. Here it
//! gets charts and pages (`charts`), every texel that a chart covers becomes a few points of the result (`texels`),
//! each point finds the nearest place of the original (`original`, cell by cell, out of core) and the colour that the
//! original's own materials and images have there (`paint`, `images`), and pages become images (`pages`). Bytes depend on
//! the two meshes, the images and the options: not on threads, memory or the order of work. Does not write meshes.

mod charts;
mod images;
mod original;
mod pages;
mod paint;
mod texels;

use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::measure::load;
use crate::system::disk::Disk;
use crate::system::progress::Progress;
use crate::system::units::show_bytes;
use charts::Charts;
use images::ImageCache;
use original::Original;
use pages::Canvas;
pub use pages::{Page, PageKind};
pub use paint::Finish;
use paint::Palette;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings of a bake that change its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Side of a page in texels.
    pub page_size: u32,
    /// Pages at most; as many as the original's texel density takes if `None`.
    pub most_pages: Option<u32>,
    /// Triangles per cell of the original.
    pub cell_triangles: u64,
}

/// Memory and places of a bake.
#[derive(Clone, Copy, Debug)]
pub struct Means<'a> {
    /// Memory for everything, in bytes.
    pub memory_bytes: u64,
    /// Worker threads.
    pub threads: usize,
    /// Folder for temporary data without names.
    pub temp_dir: &'a Path,
    /// The disk that pages are written through.
    pub disk: &'a Disk,
    /// Counts triangles of the result; asks to stop.
    pub progress: &'a Progress,
}

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

/// Findings of a bake.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BakeReport {
    /// Charts of the result.
    pub charts: u64,
    /// Pages.
    pub pages: u64,
    /// Side of a page in texels; pages that are not full are smaller.
    pub page_size: u32,
    /// Texels of all pages.
    pub texels: u64,
    /// Texels that show the surface.
    pub covered_texels: u64,
    /// Texels per input unit of length.
    pub texel_density: f64,
    /// The same of the original's images, by area; absent where it has none.
    pub original_texel_density: Option<f64>,
    /// Bytes of the pages' files.
    pub bytes: u64,
    /// Missing, damaged and lost parts, a line each.
    pub notes: Vec<String>,
}

/// Page and texture coordinates of a triangle of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Number of the page.
    pub page: u32,
    /// Coordinates of the three corners, from 0 to 1, v upwards.
    pub uv: [[f32; 2]; 3],
}

impl Corner {
    /// Bytes of a record.
    pub const BYTES: usize = 28;

    /// Reads a record.
    pub fn read(bytes: &[u8; Self::BYTES]) -> Corner {
        let words = bytes.as_chunks::<4>().0;
        let float = |i: usize| f32::from_le_bytes(words[1 + i]);
        Corner {
            page: u32::from_le_bytes(words[0]),
            uv: [0, 2, 4].map(|i| [float(i), float(i + 1)]),
        }
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.page.to_le_bytes());
        self.uv.as_flattened().iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
    }
}

/// Shares of the memory: cells of the original, decoded images, points under way.
const CELL_SHARE: u64 = 3;
const IMAGE_SHARE: u64 = 3;

/// Gives the result `shape` a texture from `original`; files get names that begin with `name` in the folder `place`.
///
/// `original` is the input as it was opened, texture coordinates at its corners; `shape` has no degenerate faces.
/// Memory: the result with its charts (about 100 bytes a triangle, 1.5 KiB a triangle of a block of at most 200,000), one
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
    let palette = Palette::new(original.materials().map(|all| &**all), free_bytes / IMAGE_SHARE)?;
    let original = Original::cut(original, &palette, options.cell_triangles, Means {
        memory_bytes: free_bytes,
        ..means
    })?;
    let density = original.density(options);
    let charts = Charts::make(&mesh, density, options, means)?;
    let mut notes = original.notes(&palette);
    let mut canvas = Canvas::new(&charts.pages, means.temp_dir)?;
    let cache = ImageCache::new(&palette, free_bytes / IMAGE_SHARE);
    let seen = texels::fill(&texels::Scene {
        mesh: &mesh,
        charts: &charts,
        original: &original,
        palette: &palette,
        images: &cache,
        cell_bytes: free_bytes / CELL_SHARE,
        batch_bytes: free_bytes / 4,
        threads: means.threads,
        progress,
    }, &mut canvas)?;
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
    let palette = Palette::new(original.materials().map(|all| &**all), free / IMAGE_SHARE)?;
    Ok(CORNER_BYTES * original.n_corners() + PAGE_BYTES * palette.n_pixels())
}

/// Bytes on disk for a corner of the original: sorted to part vertices along charts, then in cells.
const CORNER_BYTES: u64 = 80;

/// Bytes on disk for a pixel of the original's images: a page is rarely more than half full, and becomes an image.
const PAGE_BYTES: u64 = 12;

/// Tells if the original has texture coordinates and an image that can be used.
pub fn has_images(original: &MeshSource) -> bool {
    let palette = Palette::new(original.materials().map(|all| &**all), u64::MAX);
    original.has_corner_texture() && palette.is_ok_and(|palette| palette.has_images())
}

/// Tells if the original has anything that can be baked.
pub fn has_looks(original: &MeshSource) -> bool {
    original.has_corner_texture() || crate::measure::ColourChannels::of(original.schema()).is_some()
}
