//! A new texture for a result: charts of the result's own, filled from the nearest places of the original.
//!
//! The result was simplified as if there were no charts, so nothing of the input's texture coordinates is left. Here it
//! gets charts and pages (`charts`), every texel that a chart covers becomes a few points of the result (`texels`),
//! each point finds the nearest place of the original (`original`, cell by cell, out of core) and the colour that the
//! original's own materials and images have there (`paint`, `images`), and pages become images (`pages`). Bytes depend on
//! the two meshes, the images and the options: not on threads, memory or the order of work. Does not write meshes.

mod candidates;
mod cells;
mod charts;
mod density;
mod directions;
mod flatten;
mod grid;
mod growth;
mod horizon;
mod nearest;
mod need;
mod normals;
mod original;
mod outline;
mod overlaps;
mod packing;
mod page_kind;
mod pages;
mod patches;
mod projected;
mod same;
mod sectors;
mod settings;
mod sheets;
mod side;
mod spots;
mod texels;
mod tiles;
mod vertex_colours;

pub use cells::{PagedTile, surface};
use charts::Charts;
use directions::STRAIGHT_PIXEL;
use nearest::CellCache;
pub use need::{BakeNeed, check, has_images, has_looks, has_normal_maps};
use need::{CANVAS_SHARE, CELL_SHARE, FRAME_BYTES, IMAGE_SHARE, POINT_SHARE};
use need::{free_bytes, least_work_bytes};
use original::Original;
use page_kind::PageKind;
pub use page_kind::{Page, PagePart, Sheet, SheetPages};
use pages::Canvas;
use serde::{Deserialize, Serialize};
use settings::NormalReport;
pub use settings::{BakeReport, Corner, MapReport, Means, NormalSource, Options, TANGENT_BYTES};
use sheets::Canvases;
use std::path::{Path, PathBuf};
use stonecut_io::materials::MapKind;
use stonecut_io::ply::MeshSource;
use stonecut_measure::load;
use stonecut_mesh::Mesh;
pub use stonecut_render::texture::{BasisCoding, Finish, ImageFaults, WantedMaps};
use stonecut_render::texture::{ImageCache, SEEN, SURFACE};
use stonecut_system::error::{Error, Result};
use stonecut_system::memory::BASE_BYTES;
use stonecut_system::units::{memory_word, show_bytes};
pub use tiles::{
    IN_TEXTURE, Photographs, TilePainter, TilePicture, TilesNeed, check_tiles, least_for_tiles,
};
pub use vertex_colours::{
    Coloured, colour_vertices, coloured_schema, colours_vertices, least_for_colours,
};

/// Work of filling a texel, in that of making it a part of an image.
const FILL_WEIGHT: u64 = 8;

/// Finished pages, and the texture coordinates of the result's corners in a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Baked {
    /// Pages in order; empty where the original has no colours.
    pub pages: Vec<Page>,
    /// Normal maps of the pages; empty where none are wanted.
    #[serde(default)]
    pub normals: Vec<Page>,
    /// Pages besides these, in the same places.
    #[serde(default)]
    pub maps: Vec<SheetPages>,
    /// Tangents of the result's corners, beside normal maps: records of `TANGENT_BYTES`, one a triangle.
    #[serde(default)]
    pub tangents: Option<PathBuf>,
    /// Records of `Corner::BYTES` bytes, one a triangle in the order of the result.
    pub corners: PathBuf,
    /// Parts of pages as these records number them; each is a material.
    pub parts: Vec<PagePart>,
    /// Look of the pages besides their images.
    pub finish: Finish,
    /// True if the pages show all colours of vertices: no image of the original is seen through them.
    #[serde(default)]
    pub holds_vertex_colours: bool,
    /// For people and for the report.
    pub report: BakeReport,
}

/// Gives the result `shape` a texture from `original`; files get names that begin with `name` in the folder `place`.
///
/// `original` is the input as it was opened, texture coordinates at its corners; `shape` has no degenerate faces.
/// Memory: the result with its charts (about 100 bytes a triangle, 1 KiB a triangle of a block of at most 200,000), one
/// cell of the original, one decoded image, points under way, and the texels of pages where they are a small share.
/// Disk: the original in cells with texture coordinates (about 40 bytes a triangle, three times that for a while), 4 bytes
/// a texel, and the pages.
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
    let palette = options.settled_palette(&original, means.memory_bytes / IMAGE_SHARE);
    let least = least_work_bytes(&palette, options.coding, options.page_texels());
    let free_bytes = free_bytes(n_triangles, (taken, least), means.memory_bytes)?;
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
    // Cutting the original is an eighth of the work, about; what is left is told once there are charts.
    progress.count_from_zero(8 * original.n_triangles());
    let mut original =
        Original::cut(original, &palette, options, Means { memory_bytes: free_bytes, ..means })?;
    if options.colours_multiply {
        original.leave_tints();
    }
    let free_bytes = free_bytes.saturating_sub(original.border_bytes());
    let (largest, share) = (original.largest_cell_bytes(), free_bytes / CELL_SHARE);
    if largest > share {
        return Err(Error::NoMemory(format!(
            "a cell of the input takes {} with its texture coordinates, the budget has {} for it: give --memory {}, \
             smaller --cell-triangles, or choose --texture keep",
            show_bytes(largest),
            show_bytes(share),
            memory_word(BASE_BYTES + taken + original.border_bytes() + CELL_SHARE * largest)
        )));
    }
    let density = original.density(options);
    progress.count_from_zero(mesh.triangles.len() as u64);
    let mut charts = Charts::make(&mesh, density, options, means)?;
    if options.normals {
        charts.add_tangents(&mesh, &normals);
    }
    let mut losses = original.losses(&palette);
    // Texels are counted twice: when they are filled, and when their page is made an image, which is a fraction of the work.
    let n_filled = FILL_WEIGHT * charts.n_covered();
    let (has_emission, has_surface) = (palette.has_emission(), palette.has_surface());
    let wanted = [original.has_looks(), options.normals, has_emission, has_surface];
    let is_apart = has_surface && !options.beside.occlusion;
    let n_images = wanted.into_iter().chain([is_apart]).map(u64::from).sum::<u64>();
    progress.count_from_zero(n_filled + n_images * charts.n_texels());
    let most_bytes = free_bytes / CANVAS_SHARE;
    let empty = || Canvas::new(&charts.pages, means.temp_dir, means.disk, most_bytes);
    let canvas = |is_wanted: bool| is_wanted.then(empty).transpose();
    let mut canvases = Canvases {
        colours: canvas(original.has_looks())?,
        normals: canvas(options.normals)?,
        emission: canvas(has_emission)?,
        surface: canvas(has_surface)?,
    };
    // Directions have two points for a side at least: what they leave out shows as noise in highlights.
    let side = density::points_of_side(density.of_images, charts.texels_per_unit)
        .max(1 + u32::from(options.normals));
    let mut cache = ImageCache::new(&palette, free_bytes / IMAGE_SHARE);
    cache.halve(|image| original.halvings(image, f64::from(side) * charts.texels_per_unit));
    let seen = texels::fill(
        &spots::Scene {
            mesh: &mesh,
            charts: &charts,
            normals: &normals,
            original: &original,
            palette: &palette,
            images: &cache,
            side,
            looks: 1,
            same_within: None,
            batch_bytes: free_bytes / POINT_SHARE,
            threads: means.threads,
            progress,
            counted: n_filled,
        },
        &mut CellCache::new(free_bytes / CELL_SHARE),
        &mut canvases,
    )?;
    canvases.count();
    losses.merge(&cache.losses());
    let coding = options.coding;
    let colours_in =
        |kinds: &[MapKind]| PageKind::of_colours(coding, palette.is_photographic(kinds));
    let mut look = palette.finish(seen.has_alpha, !seen.blends.is_empty());
    if has_emission && !seen.has_colour && !seen.has_alpha {
        // A page of black would hide that nothing but the light is seen.
        (canvases.colours, look.base) = (None, [0.0, 0.0, 0.0, 1.0]);
    }
    // Of PLY, materials are images.
    let all_blend = look.base[3] < 1.0 || !options.beside.surface;
    let blends = if all_blend { &[] } else { &seen.blends[..] };
    let (parts, numbers) = charts.parts(blends, look.blends);
    let corners = place.join(format!("{name}-corners.part"));
    charts.write(&numbers, &corners, means.disk)?;
    let tangents = options.normals.then(|| place.join(format!("{name}-tangents.part")));
    if let Some(path) = &tangents {
        charts.write_tangents(path, means.disk)?;
    }
    let source = original.normal_source();
    let holds_vertex_colours = original.gives_all_colours();
    drop((original, cache));
    let largest = charts.pages.iter().map(|&[w, h]| u64::from(w) * u64::from(h)).max();
    let coders = Means { memory_bytes: free_bytes, ..means };
    let means = Means { threads: coders.coding(coding, largest.unwrap_or(0)).threads, ..means };
    let finish = |canvas: Option<Canvas>, rest: Option<[u8; 4]>, kinds: &[(PageKind, &str)]| {
        let named = |(kind, end): &(PageKind, &str)| (*kind, format!("{name}{end}"));
        let kinds: Vec<_> = kinds.iter().map(named).collect();
        match canvas {
            Some(canvas) => canvas.finish(&kinds, rest, place, means),
            None => Ok((vec![Vec::new(); kinds.len()], 0)),
        }
    };
    let colours = [(colours_in(&SEEN), "")];
    let (mut pages, of_colours) = finish(canvases.colours, None, &colours)?;
    let pages = pages.pop().unwrap_or_default();
    let directions =
        PageKind::of_numbers(coding, palette.is_photographic(&[MapKind::Normal]), None);
    let directions = [(directions, "-normals")];
    let (mut normal_maps, of_normals) =
        finish(canvases.normals, Some(STRAIGHT_PIXEL), &directions)?;
    let normal_maps = normal_maps.pop().unwrap_or_default();
    let sheets: &[Sheet] = match (options.beside.occlusion, palette.has_occlusion()) {
        (true, true) => &[Sheet::ShadedSurface],
        (true, false) => &[Sheet::Surface],
        (false, _) => &[Sheet::Roughness, Sheet::Metallic],
    };
    let is_photographic = palette.is_photographic(&SURFACE);
    let kind_of = |sheet: &Sheet| {
        (PageKind::of_numbers(coding, is_photographic, sheet.channel()), sheet.suffix())
    };
    let kinds: Vec<_> = sheets.iter().map(kind_of).collect();
    let (surface, _) = finish(canvases.surface, None, &kinds)?;
    let light = [(colours_in(&[MapKind::Emissive]), Sheet::Emission.suffix())];
    let (emission, of_light) = finish(canvases.emission, None, &light)?;
    let maps =
        sheets.iter().copied().zip(surface).chain([Sheet::Emission].into_iter().zip(emission));
    let maps = maps.filter(|(_, pages)| !pages.is_empty());
    let maps: Vec<SheetPages> = maps.map(|(sheet, pages)| SheetPages { sheet, pages }).collect();
    let bytes_of = |pages: &[Page]| pages.iter().map(|page| page.bytes).sum();
    let report = BakeReport {
        charts: charts.n_charts,
        pages: charts.pages.len() as u64,
        page_size: options.page_size,
        texels: charts.n_texels(),
        covered_texels: of_colours.max(of_normals).max(of_light),
        texel_density: charts.texels_per_unit,
        original_texel_density: density.of_images,
        bytes: bytes_of(&pages),
        maps: maps.iter().map(|map| map.report(bytes_of(&map.pages))).collect(),
        normals: source.map(|source| NormalReport {
            source,
            mean_degrees: seen.mean_degrees(),
            bytes: bytes_of(&normal_maps),
        }),
        notes: losses.lines(),
        losses,
    };
    Ok(Baked {
        pages,
        normals: normal_maps,
        maps,
        tangents,
        corners,
        parts,
        finish: look,
        holds_vertex_colours,
        report,
    })
}

/// Normals of a result's vertices.
fn normals_of(mesh: &Mesh, channels: [usize; 3]) -> Vec<[f32; 3]> {
    let of = |v: u32| channels.map(|channel| mesh.channels_of(v)[channel]);
    (0..mesh.positions.len() as u32).map(of).collect()
}
