//! Needs of a bake, told before any work: memory, disk, texels, seconds.
//!
//! Texels are estimated from texture coordinates of some blocks of faces. Constants were measured (docs/results/textures.md).

use super::charts::Charts;
use super::normals;
use super::settings::{Options, work_bytes};
use stonecut_io::materials::MapKind;
use stonecut_io::ply::{FaceBlock, FaceLooks, MeshSource};
use stonecut_render::texture::{BasisCoding, Paint, Palette, Purpose, SEEN, SURFACE, WantedMaps};
use stonecut_system::error::{Error, Result};
use stonecut_system::memory::BASE_BYTES;
use stonecut_system::units::{memory_word, show_bytes};

/// Shares of the memory: cells of the original, decoded images, points under way.
pub(super) const CELL_SHARE: u64 = 3;
pub(super) const IMAGE_SHARE: u64 = 3;
/// Texels of pages that stay in memory, for colours and for directions; larger ones go to disk.
pub(super) const CANVAS_SHARE: u64 = 12;
/// The rest is for cells and images while they are read.
pub(super) const POINT_SHARE: u64 = 10;

/// Bytes of a triangle for tangents while they are found, and for the normals of half a vertex.
pub(super) const FRAME_BYTES: u64 = 36;

/// Bytes of a triangle of the original for tangents, and while they are found.
pub(super) const FRAME_WORK_BYTES: u64 = 324;

/// Memory without which nothing can be baked: a cell of the original, an image, points under way.
const LEAST_WORK_BYTES: u64 = 48 << 20;

/// The same where images are larger, or KTX2 files of `texels` are made.
pub(super) fn least_work_bytes(palette: &Palette, coding: Option<BasisCoding>, texels: u64) -> u64 {
    let of_images = LEAST_WORK_BYTES.max(IMAGE_SHARE * palette.largest_bytes());
    of_images.max(work_bytes(coding, texels))
}

/// Bytes of a triangle of a result in memory, with half a vertex that carries colours.
const SHAPE_BYTES: u64 = 36;

/// Bytes on disk for a triangle and a vertex of the original: in cells, and while vertices are parted along charts.
const CUT_BYTES: [u64; 2] = [6, 20];
const STAGED_BYTES: [u64; 2] = [33, 24];
/// Vertices for a triangle where charts part them, at least.
const PARTED_VERTICES: f64 = 0.6;
/// Bytes for a triangle in the first sort, and those of its runs on disk that add to the most at any time.
const SORT_BYTES: u64 = 96;
const SORT_RUN_BYTES: u64 = 20;
/// A staged mesh of fewer bytes stays in memory.
const STAGED_IN_MEMORY: u64 = 16 << 20;

/// Bytes of a triangle of the original in a cell with its tree, about.
pub(super) const CELL_BYTES: u64 = 260;

/// Bytes of the points of a batch where all cells and images stay in memory.
const BATCH_BYTES: u64 = 64 << 20;

/// Texels of pages for a texel that shows the surface.
const PAGE_TEXELS: f64 = 1.45;

/// Texels for a triangle of an original without images: two for the side of a mean triangle.
const PLAIN_TEXELS: f64 = 2.0;

/// Bytes of a page's file for a texel of it.
const JPEG_BYTES: f64 = 0.18;
const PNG_BYTES: f64 = 1.1;
/// The same of directions, as maps of the input have them and as the shape alone.
const NORMAL_BYTES: [f64; 2] = [1.25, 0.7];
/// The same of KTX2 as UASTC and as ETC1S, smaller sizes included, and processor seconds to make them.
const CODED_BYTES: [f64; 2] = [1.1, 0.13];
const CODING_SECONDS: [f64; 2] = [0.3e-6, 1.8e-6];

/// Bytes of a texel while pages are filled.
const BYTES_PER_TEXEL: f64 = 4.0;

/// Share of an image's memory that its own size takes, without the halves of it.
const WITHOUT_HALVES: f64 = 0.75;

/// Blocks of faces whose coordinates are looked at.
const MOST_BLOCKS: u64 = 8;

/// Seconds of one core of a busy machine.
const SECONDS_PER_TEXEL: f64 = 0.085e-6;
/// The same for 2 x 2 points, and for directions.
const SECONDS_PER_FINER_TEXEL: f64 = 0.43e-6;
const SECONDS_PER_DIRECTION: f64 = 0.43e-6;
const SECONDS_PER_PAGE_TEXEL: f64 = 60e-9;
/// Images that are decoded small take less, but a quarter of it.
const SECONDS_PER_PIXEL: f64 = 15e-9;
const LEAST_PIXEL_SHARE: f64 = 0.25;
const SECONDS_PER_TRIANGLE: f64 = 8e-6;
/// Of the original: its normals, and frames for its normal maps.
const SECONDS_PER_NORMAL_TRIANGLE: f64 = 4.4e-6;
const SECONDS_PER_FRAME_TRIANGLE: f64 = 3.9e-6;
/// Of normal maps, besides those of each image: they are PNG mostly.
const SECONDS_PER_NORMAL_PIXEL: f64 = 33e-9;
const SECONDS_PER_CHART_TRIANGLE: f64 = 4e-6;

/// Memory for the sorts of staging.
pub(super) fn staging_bytes(memory_bytes: u64) -> u64 {
    (memory_bytes / 2).max(3 << 20)
}

/// Needs of a bake.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BakeNeed {
    /// Bytes on disk for the time being.
    pub temp_bytes: u64,
    /// Bytes of the pages' files, about.
    pub page_bytes: u64,
    /// Texels that show the surface, about.
    pub n_texels: u64,
    /// Images that are decoded.
    pub n_images: u64,
    /// Memory without which it cannot be done, in bytes.
    pub least_memory_bytes: u64,
    /// Memory that it takes of the budget, about.
    pub memory_bytes: u64,
    /// Seconds of one core, about.
    pub cpu_seconds: f64,
}

/// Memory that is left for the work; fails if it is too little.
///
/// `least` is needed beside what is `taken`; `memory_bytes` is the budget without `BASE_BYTES`.
pub(super) fn free_bytes(
    n_triangles: u64,
    (taken, least): (u64, u64),
    memory_bytes: u64,
) -> Result<u64> {
    let free = memory_bytes.checked_sub(taken).filter(|free| *free >= least);
    free.ok_or_else(|| {
        Error::NoMemory(format!(
            "a new texture for {n_triangles} triangles takes {} of memory, {} are left for it: give --memory {}, ask \
             for fewer triangles, or choose --texture keep",
            show_bytes(taken + least),
            show_bytes(memory_bytes),
            memory_word(BASE_BYTES + taken + least)
        ))
    })
}

/// Fails where a bake of a result of `n_triangles` would fail for want of memory, before any work is done; returns what it
/// needs beside the result.
pub fn check(
    original: &MeshSource,
    n_triangles: u64,
    options: &Options,
    memory_bytes: u64,
) -> Result<BakeNeed> {
    let mut taken = SHAPE_BYTES * n_triangles + Charts::bytes(n_triangles);
    if options.normals {
        taken += (FRAME_BYTES + 6) * n_triangles;
        taken += border_bytes(original.n_triangles(), options.cell_triangles);
    }
    let palette = options.palette(original);
    let images = palette.decoded_bytes();
    let least = least_work_bytes(&palette, options.coding, options.page_texels());
    let free = free_bytes(n_triangles, (taken, least), memory_bytes)?;
    let Texels { n: n_texels, n_wanted } = texels(original, &palette, options)?;
    let n_in = original.n_triangles();
    let has_maps = options.normals && palette.has_normal_maps();
    let bytes_of = |kinds: &[MapKind], png: f64| match options.coding {
        Some(coding) => CODED_BYTES[coding as usize],
        None if palette.is_photographic(kinds) => JPEG_BYTES,
        None => png,
    };
    let of_normals = NORMAL_BYTES[usize::from(!has_maps)];
    let canvases = [
        (has_looks(original), bytes_of(&SEEN, PNG_BYTES)),
        (options.normals, bytes_of(&[MapKind::Normal], of_normals)),
        (palette.has_emission(), bytes_of(&[MapKind::Emissive], PNG_BYTES)),
        (palette.has_surface(), bytes_of(&SURFACE, PNG_BYTES)),
    ];
    let canvases: Vec<f64> =
        canvases.into_iter().filter(|(is_made, _)| *is_made).map(|(_, bytes)| bytes).collect();
    let n_canvases = canvases.len() as u64;
    let on_page = PAGE_TEXELS * n_texels;
    let on_pages = on_page * n_canvases as f64;
    let coding_seconds = options.coding.map_or(0.0, |coding| CODING_SECONDS[coding as usize]);
    let cells = CELL_BYTES * n_in;
    // Pages that are as dense as the images need no halves of these; far fewer texels need halves alone, two points a side.
    let halvings = (0.5 * (n_wanted / n_texels).log2() - 1.0).round().clamp(0.0, 3.0);
    let share = match n_wanted > n_texels {
        true if palette.is_photographic(&SEEN) => 0.25f64.powf(halvings),
        true => 1.0,
        false => WITHOUT_HALVES,
    };
    let decoded = (share * images.iter().sum::<u64>() as f64) as u64;
    let canvas = (BYTES_PER_TEXEL * on_pages / n_canvases.max(1) as f64) as u64;
    let is_held = canvas <= free / CANVAS_SHARE;
    let on_disk = if is_held { 0 } else { n_canvases * canvas };
    let work = (free / CELL_SHARE).min(cells)
        + (free / IMAGE_SHARE).min(decoded)
        + (free / POINT_SHARE).min(BATCH_BYTES)
        + if is_held { n_canvases * canvas } else { 0 };
    // As `points_of_side` has it: where pages are coarser than the images, and for directions.
    let is_finer = options.normals || (n_wanted / n_texels).sqrt() > super::density::MOST_APART[0];
    let mut cpu_seconds = SECONDS_PER_TEXEL * n_texels
        + (SECONDS_PER_PAGE_TEXEL + coding_seconds) * on_pages
        + SECONDS_PER_PIXEL * share.sqrt().max(LEAST_PIXEL_SHARE) * palette.n_pixels() as f64
        + SECONDS_PER_TRIANGLE * n_in as f64
        + SECONDS_PER_CHART_TRIANGLE * n_triangles as f64;
    cpu_seconds += if is_finer { SECONDS_PER_FINER_TEXEL * n_texels } else { 0.0 };
    if options.normals {
        cpu_seconds += SECONDS_PER_DIRECTION * n_texels + SECONDS_PER_NORMAL_TRIANGLE * n_in as f64;
    }
    if has_maps {
        cpu_seconds += SECONDS_PER_FRAME_TRIANGLE * n_in as f64
            + SECONDS_PER_NORMAL_PIXEL * palette.n_plain_pixels() as f64;
    }
    Ok(BakeNeed {
        temp_bytes: original_bytes(original, memory_bytes) + on_disk,
        page_bytes: (canvases.iter().sum::<f64>() * on_page) as u64,
        n_texels: n_texels as u64,
        n_images: images.len() as u64,
        least_memory_bytes: taken + least,
        memory_bytes: taken + work,
        cpu_seconds,
    })
}

/// Bytes on disk for the original, about: in cells, and while its vertices are parted along charts.
fn original_bytes(original: &MeshSource, memory_bytes: u64) -> u64 {
    let n = original.n_triangles();
    let n_vertices = original.n_vertices().max((PARTED_VERTICES * n as f64) as u64);
    let of = |[triangle, vertex]: [u64; 2]| triangle * n + vertex * n_vertices;
    let memory = staging_bytes(memory_bytes);
    let mut bytes = of(CUT_BYTES);
    if original.has_corner_texture() {
        let staged = of(STAGED_BYTES);
        bytes += if staged > STAGED_IN_MEMORY.min(memory / 16) { staged } else { 0 };
        bytes += if SORT_BYTES * n > memory / 3 { SORT_RUN_BYTES * n } else { 0 };
    }
    bytes
}

/// Texels of a surface on its pages.
struct Texels {
    n: f64,
    /// Those of pages that hold all that the images have.
    n_wanted: f64,
}

/// Texels of the surface, about: those that coordinates reach in the images, as far as pages hold them.
fn texels(original: &MeshSource, palette: &Palette, options: &Options) -> Result<Texels> {
    let n_blocks = original.n_face_blocks();
    let mut n = PLAIN_TEXELS * original.n_triangles() as f64;
    if palette.has_images() && n_blocks > 0 {
        let every = n_blocks.div_ceil(MOST_BLOCKS);
        let (mut block, mut looks) = (FaceBlock::default(), FaceLooks::default());
        let (mut n_seen, mut reached) = (0, 0.0);
        for index in (0..n_blocks).step_by(every as usize) {
            original.read_faces_with_looks(index, &mut block, &mut looks)?;
            n_seen += looks.texture.len();
            for (uv, &material) in looks.texture.iter().zip(&looks.materials) {
                let paint = palette.paints.get(material as usize);
                let Some(map) = paint.and_then(Paint::densest) else { continue };
                let texels = map.texels_per_coordinate.powi(2) * super::grid::area(uv);
                reached += if texels.is_finite() { texels } else { 0.0 };
            }
        }
        let all = original.n_triangles() as f64 * reached / n_seen.max(1) as f64;
        n = all.min(super::density::MOST_TEXELS * palette.n_pixels() as f64);
    }
    let room = options.most_pages.map_or(f64::INFINITY, |most| {
        f64::from(most) * f64::from(options.page_size).powi(2) / PAGE_TEXELS
    });
    Ok(Texels { n: n.min(room), n_wanted: n })
}

/// Bytes for the places that cells of an original share, about: the rim of a square patch of a cell's triangles.
fn border_bytes(n_triangles: u64, cell_triangles: u64) -> u64 {
    let n_cells = n_triangles.div_ceil(cell_triangles.max(1));
    let rim = 4.0 * (0.5 * cell_triangles as f64).sqrt();
    if n_cells > 1 { (n_cells as f64 * rim) as u64 * normals::BORDER_BYTES } else { 0 }
}

/// True if the original has texture coordinates and an image that can be used.
pub fn has_images(original: &MeshSource) -> bool {
    let purpose = Purpose::Bake(WantedMaps::default());
    let palette = Palette::new(original.materials().map(|all| &**all), purpose);
    original.has_corner_texture() && palette.has_images()
}

/// True if the original has a normal map that can be used.
pub fn has_normal_maps(original: &MeshSource) -> bool {
    let palette = Palette::new(original.materials().map(|all| &**all), Purpose::Relief);
    original.has_corner_texture() && palette.has_normal_maps()
}

/// True if the original has anything that can be baked.
pub fn has_looks(original: &MeshSource) -> bool {
    original.has_corner_texture()
        || stonecut_measure::ColourChannels::of(original.schema()).is_some()
}
