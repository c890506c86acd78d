//! Pages of tiles: charts by projection, texels from the nearest places of the input, an image in memory for each tile.
//!
//! The input is staged once for the finest tiles; coarser ones are filled from the pages of finer ones. Tiles are given some at a time; what they get depends neither on what is given
//! together with them, nor on memory or threads. Writes no tiles.

use super::cells::{self, PagedTile};
use super::charts::Charts;
use super::nearest::CellCache;
use super::need::{
    CANVAS_SHARE, CELL_SHARE, IMAGE_SHARE, POINT_SHARE, least_work_bytes, staging_bytes,
};
use super::original::Original;
use super::page_kind::PageKind;
use super::pages::Canvas;
use super::projected::{Projected, project};
use super::settings::{Means, NONE, Options};
use super::sheets::Canvases;
use super::spots::Scene;
use super::texels;
use stonecut_io::TilePage;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::Mesh;
use stonecut_mesh::oklab::linear_of_srgb;
use stonecut_render::texture::{
    BasisCoding, Finish, ImageCache, ImageFaults, Palette, Purpose, SEEN, WantedMaps,
};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Ledger, Loss, LossKind};
use stonecut_system::parallel::in_order;
use stonecut_system::units::show_bytes;

/// The place of colours that pages hold.
pub const IN_TEXTURE: &str = "in the new texture, no longer at the vertices";

/// Texels of a side of a page at most: what every graphics card takes.
const MOST_SIDE: u32 = 4096;

/// Triangles of a cell of the input.
const CELL_TRIANGLES: u64 = 65_536;

/// Bytes of a triangle of the tiles that are given together.
const TILE_BYTES: u64 = 400;

/// The input with its images, staged for looking up.
pub struct Photographs {
    original: Original,
    palette: Palette,
    /// For cells, images and points.
    free_bytes: u64,
    texels_per_unit: f64,
}

/// A tile's page and the places of its triangles on it.
#[derive(Clone, Debug, Default)]
pub struct TilePicture {
    /// For each triangle its chart; `TilePicture::NO_CHART` without an area.
    pub chart: Vec<u32>,
    /// For each triangle its corners on the page, from 0 to 1, from the upper left corner.
    pub corners: Vec<[[f32; 2]; 3]>,
    /// The file of the image.
    pub image: Vec<u8>,
    /// Its type, as the web names it.
    pub mime: &'static str,
    /// Charts.
    pub n_charts: u64,
    /// Texels of the page.
    pub texels: u64,
    /// Texels that show the surface.
    pub covered_texels: u64,
    /// Texels per unit of length.
    pub texels_per_unit: f64,
    /// Look besides the image.
    finish: Option<Finish>,
}

impl TilePicture {
    /// The chart of triangles without an area.
    pub const NO_CHART: u32 = NONE;

    /// The page as a tile holds it.
    pub fn page(&self) -> TilePage<'_> {
        let finish = self.finish.as_ref();
        let [r, g, b, opacity] = finish.map_or([1.0; 4], |finish| finish.base);
        let light = |shown: f32| linear_of_srgb(f64::from(shown.clamp(0.0, 1.0))) as f32;
        let share = |x: Option<f32>, other: f32| x.unwrap_or(other).clamp(0.0, 1.0);
        TilePage {
            image: &self.image,
            mime: self.mime,
            factor: [light(r), light(g), light(b), opacity.clamp(0.0, 1.0)],
            mask: finish.and_then(|finish| finish.mask),
            blends: finish.is_some_and(|finish| finish.blends),
            unlit: finish.is_some_and(|finish| finish.unlit),
            metallic: share(finish.and_then(|finish| finish.metallic), 0.0),
            roughness: share(finish.and_then(|finish| finish.roughness), 1.0),
        }
    }
}

/// Memory without which tiles that are given together get no pages, beside `BASE_BYTES`; `n_triangles` is their number.
pub fn least_for_tiles(source: &MeshSource, n_triangles: u64) -> u64 {
    let images =
        Palette::new(source.materials().map(|all| &**all), Purpose::Bake(WantedMaps::default()));
    TILE_BYTES * n_triangles + least_work_bytes(&images, None, 0)
}

/// Fails where pages of tiles would fail for want of memory; `n_triangles` is the number of triangles of the tiles that are
/// given together, `staged_bytes` those that the open source itself has on disk.
pub fn check_tiles(
    source: &MeshSource,
    n_triangles: u64,
    (memory_bytes, staged_bytes): (u64, u64),
) -> Result<TilesNeed> {
    let images =
        Palette::new(source.materials().map(|all| &**all), Purpose::Bake(WantedMaps::default()));
    let free = free_bytes(n_triangles, &images, memory_bytes)?;
    let pixels = images.n_pixels();
    // Vertices are parted along charts: two sorts, of which either stays in memory where that suffices.
    let sort_bytes = |bytes: u64| {
        let bytes = bytes * source.n_corners();
        if bytes > staging_bytes(free) / 3 { bytes } else { 0 }
    };
    // The number of the material goes with a corner where there are several.
    let has_numbers = source.materials().is_some_and(|all| all.list.len() > 1);
    let sorts = [if has_numbers { 32 } else { 28 }, 16].map(sort_bytes);
    let n_vertices = PARTED * source.n_vertices() as f64;
    let vertices = (n_vertices * (source.schema().record_bytes() as f64 + 12.0)) as u64;
    let faces = 13 * source.n_triangles();
    let cells = (CELL_ROWS * (vertices + faces) as f64) as u64;
    let sorting = (sorts[0] + sorts[1] + vertices).max(sorts[1] + vertices + vertices.max(faces));
    let cutting = vertices + faces + cells;
    // Pages of some tiles while they are filled.
    let share = (n_triangles as f64 / source.n_triangles().max(1) as f64).min(1.0);
    let pages = (4.0 * share * pixels as f64) as u64;
    Ok(TilesNeed { temp_bytes: (staged_bytes + sorting.max(cutting)).max(cells + pages), pixels })
}

/// Needs of the pages of tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TilesNeed {
    /// Bytes on disk for the time being.
    pub temp_bytes: u64,
    /// Pixels of the images.
    pub pixels: u64,
}

/// Vertices after they are parted along charts, for those before (an estimate, on the safe side).
const PARTED: f64 = 1.25;

/// Bytes of cells for those of the mesh that is cut, about.
const CELL_ROWS: f64 = 1.1;

fn free_bytes(n_triangles: u64, images: &Palette, memory_bytes: u64) -> Result<u64> {
    let (taken, least) = (TILE_BYTES * n_triangles, least_work_bytes(images, None, 0));
    let free = memory_bytes.checked_sub(taken).filter(|free| *free >= least);
    free.ok_or_else(|| {
        Error::NoMemory(format!(
            "textures of tiles take {} of memory, {} are left for them: give more --memory, fewer --tile-triangles, or \
             --texture colors",
            show_bytes(taken + least),
            show_bytes(memory_bytes)
        ))
    })
}

impl Photographs {
    /// Stages the input; `n_triangles` as for `check_tiles`.
    ///
    /// Disk: about 40 bytes a triangle of the input, six times that for a while.
    pub fn stage(source: MeshSource, n_triangles: u64, means: Means) -> Result<Photographs> {
        let palette = Palette::settled(
            source.materials().map(|all| &**all),
            Purpose::Bake(WantedMaps::default()),
            means.memory_bytes / IMAGE_SHARE,
        );
        let free_bytes = free_bytes(n_triangles, &palette, means.memory_bytes)?;
        let options = Options {
            page_size: MOST_SIDE,
            most_pages: None,
            cell_triangles: CELL_TRIANGLES,
            normals: false,
            beside: WantedMaps::default(),
            coding: None,
            colours_multiply: false,
        };
        let within = Means { memory_bytes: free_bytes, ..means };
        let original = Original::cut(source, &palette, &options, within)?;
        let (largest, share) = (original.largest_cell_bytes(), free_bytes / CELL_SHARE);
        if largest > share {
            return Err(Error::NoMemory(format!(
                "a cell of the input takes {} with its texture coordinates, the budget has {} for it: give more --memory, \
                 or --texture colors",
                show_bytes(largest),
                show_bytes(share)
            )));
        }
        let texels_per_unit = original.density(&options).wanted;
        Ok(Photographs { original, palette, free_bytes, texels_per_unit })
    }

    /// Texels per unit of length of the input's images.
    pub fn texels_per_unit(&self) -> f64 {
        self.texels_per_unit
    }

    /// A painter of tiles, with caches for cells and images.
    pub fn painter<'a>(&'a self, coding: Option<BasisCoding>, means: Means<'a>) -> TilePainter<'a> {
        let shares = self.free_bytes / IMAGE_SHARE + self.free_bytes / CELL_SHARE;
        // Pages of finer tiles may be larger than the input's images; cells give way to them.
        let for_images = (self.free_bytes / IMAGE_SHARE).max(self.palette.largest_bytes());
        TilePainter {
            coding,
            from: self,
            looks: &self.palette,
            images: ImageCache::new(&self.palette, for_images),
            cells: CellCache::new(shares.saturating_sub(for_images)),
            means,
        }
    }
}

/// Makes pages of tiles one after the other.
pub struct TilePainter<'a> {
    /// Of KTX2 files, instead of JPEG and PNG.
    coding: Option<BasisCoding>,
    from: &'a Photographs,
    /// Materials of the input.
    looks: &'a Palette,
    images: ImageCache<'a>,
    cells: CellCache,
    means: Means<'a>,
}

impl TilePainter<'_> {
    /// Gives up cells and images: coarser levels need their memory.
    pub fn clear(&mut self) {
        self.cells = CellCache::new(self.from.free_bytes / CELL_SHARE);
        self.images.clear();
    }

    /// Faults of the input's images up to now.
    pub fn faults(&self) -> ImageFaults {
        self.images.faults()
    }

    /// Goes on where another run has stopped.
    pub fn resume(&mut self, faults: ImageFaults) {
        self.images.resume(faults);
    }

    /// Missing, damaged and lost parts up to now.
    pub fn losses(&self) -> Ledger {
        let mut losses = self.from.original.losses(&self.from.palette);
        losses.merge(&self.images.losses());
        if self.from.original.tints_images {
            let loss = |what: &str, why: &str| Loss::new(LossKind::Colors, what, why);
            losses.lose(match self.from.original.is_seen_through {
                true => loss("colours of vertices", IN_TEXTURE).notice(),
                false => {
                    loss("colours of vertices under images", "not carried by tiles with images")
                }
            });
        }
        losses
    }

    /// Makes a page for each tile, of `texels_per_unit` or less, out of those of finer tiles, without a look at the input.
    ///
    /// `finer` are all tiles on which a nearest place may be.
    pub fn paint_from(
        &self,
        finer: Vec<PagedTile>,
        tiles: &[Mesh],
        texels_per_unit: f64,
    ) -> Result<Vec<TilePicture>> {
        let palette = cells::palette(&finer);
        let original = Original::of_tiles(finer);
        let Photographs { free_bytes, texels_per_unit: finest, .. } = *self.from;
        let from = Photographs { original, palette, free_bytes, texels_per_unit: finest };
        let mut painter =
            TilePainter { looks: self.looks, ..from.painter(self.coding, self.means) };
        let pictures = painter.paint(tiles, (texels_per_unit, 2), None)?;
        match painter.losses().lines().into_iter().next() {
            None => Ok(pictures),
            Some(line) => Err(Error::corrupt(self.means.temp_dir, line)),
        }
    }

    /// Makes a page for each tile, of `texels_per_unit` or less, with `side` x `side` looks into images a texel.
    ///
    /// `same_within` is how far corners of triangles may be from those of the input that they are, if they are its own.
    pub fn paint(
        &mut self,
        tiles: &[Mesh],
        (texels_per_unit, side): (f64, u32),
        same_within: Option<f64>,
    ) -> Result<Vec<TilePicture>> {
        let Means { threads, progress, .. } = self.means;
        let n = f64::from(side) * texels_per_unit;
        self.images.halve(|image| self.from.original.halvings(image, n));
        let mut pages: Vec<Projected> = Vec::with_capacity(tiles.len());
        in_order(
            tiles.len() as u64,
            threads,
            progress,
            |i, page: &mut Projected| {
                *page = project(&tiles[i as usize], texels_per_unit, MOST_SIDE);
                Ok(())
            },
            |_, page| {
                pages.push(std::mem::take(page));
                Ok(())
            },
        )?;
        let (mesh, charts) = (joined(tiles), joined_charts(&pages));
        let Means { temp_dir, disk, .. } = self.means;
        let most_bytes = self.from.free_bytes / CANVAS_SHARE;
        let colours = Some(Canvas::new(&charts.pages, temp_dir, disk, most_bytes)?);
        let mut canvases = Canvases { colours, ..Canvases::default() };
        let scene = Scene {
            mesh: &mesh,
            charts: &charts,
            normals: &[],
            original: &self.from.original,
            palette: &self.from.palette,
            images: &self.images,
            side: 1,
            looks: side,
            same_within,
            batch_bytes: self.from.free_bytes / POINT_SHARE,
            threads,
            progress,
            counted: mesh.triangles.len() as u64,
        };
        texels::fill(&scene, &mut self.cells, &mut canvases)?;
        drop((charts, mesh));
        canvases.count();
        let kind = PageKind::of_colours(self.coding, self.looks.is_photographic(&SEEN));
        let largest = pages.iter().map(|page| u64::from(page.size[0]) * u64::from(page.size[1]));
        let coders = Means { memory_bytes: self.from.free_bytes / IMAGE_SHARE, ..self.means };
        let coders = coders.coding(self.coding, largest.max().unwrap_or(0));
        let has_mask = self.looks.common_mask().is_some();
        let mut out = Vec::with_capacity(pages.len());
        let canvas = &canvases.colours;
        let kind_of = |page| canvas.as_ref().map_or(kind, |canvas| canvas.kind_of(page, kind));
        let has_alpha = |page| canvas.as_ref().is_some_and(|canvas| canvas.has_alpha(page));
        in_order(
            pages.len() as u64,
            coders.threads,
            progress,
            |i, file: &mut (Vec<u8>, u64)| {
                if let Some(canvas) = canvas {
                    *file = canvas.image(i as usize, kind)?;
                }
                Ok(())
            },
            |i, (image, covered_texels)| {
                let page = std::mem::take(&mut pages[i as usize]);
                let [width, height] = page.size;
                let clear = has_alpha(i as usize);
                let on_page = |[x, y]: [f32; 2]| [x / width as f32, y / height as f32];
                out.push(TilePicture {
                    corners: page.corners.iter().map(|t| t.map(on_page)).collect(),
                    chart: page.chart,
                    image: std::mem::take(image),
                    mime: kind_of(i as usize).mime(),
                    n_charts: u64::from(page.n_charts),
                    texels: u64::from(width) * u64::from(height),
                    covered_texels: *covered_texels,
                    texels_per_unit: page.texels_per_unit,
                    finish: Some(self.looks.finish(clear, clear && !has_mask)),
                });
                Ok(())
            },
        )?;
        Ok(out)
    }
}

fn joined(tiles: &[Mesh]) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for tile in tiles {
        let first = positions.len() as u32;
        positions.extend_from_slice(&tile.positions);
        triangles.extend(tile.triangles.iter().map(|t| t.map(|v| first + v)));
    }
    Mesh::new(positions, triangles)
}

fn joined_charts(pages: &[Projected]) -> Charts {
    let mut out = Charts {
        pages: Vec::new(),
        page: Vec::new(),
        chart: Vec::new(),
        corners: Vec::new(),
        n_charts: 0,
        texels_per_unit: 0.0,
        densities: Vec::new(),
        tangents: Vec::new(),
    };
    for (number, page) in (0u32..).zip(pages) {
        let first = out.n_charts as u32;
        out.pages.push(page.size);
        out.densities.push(page.texels_per_unit);
        out.page.resize(out.page.len() + page.chart.len(), number);
        out.chart.extend(page.chart.iter().map(|&c| if c == NONE { NONE } else { first + c }));
        out.corners.extend_from_slice(&page.corners);
        out.n_charts += u64::from(page.n_charts);
    }
    out
}
