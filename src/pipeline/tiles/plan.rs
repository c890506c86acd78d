//! Opens the input of `tiles`, checks it against what was asked for, and plans the run; nothing is written yet.

use super::config::{Finest, NAMED, TileTexture, TilesConfig};
use super::pending::{check_tree, checksum};
use crate::bake::{
    BasisCoding, TilesNeed, check_tiles, coloured_schema, colours_vertices, has_images,
    least_for_colours, least_for_tiles,
};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::io::{StageOptions, WeldOptions, survey_labels};
use crate::kernel::two_digits_up;
use crate::mesh::record::VertexSchema;
use crate::pipeline::plan::disk::check_space;
use crate::pipeline::plan::price_lines;
use crate::stages::partition::{Shares, Sizes, store_bytes};
use crate::stages::simplify::work_bytes;
use crate::stages::tiles::{BYTES_PER_TRIANGLE, carried_scalars};
use crate::store::cells::{CellTally, VertexLayout, plan_cells};
use crate::store::job::fingerprint::{input_marks, marks_beside, unchanged};
use crate::store::job::view;
use crate::system::disk::{Disk, folder_of, is_empty};
use crate::system::memory::BASE_BYTES;
use crate::system::progress::StageSeconds;
use crate::system::units::{memory_word, show_bytes, show_count};
use std::collections::BTreeMap;
use std::path::Path;

/// Boxes of the finest level in a group that a sheet passes through.
const TILES_OF_GROUP: u64 = 16;

/// The largest group that is planned for, in groups that a sheet passes through.
const UNEVEN: f64 = 1.5;
/// Groups were seen to have up to 2.3 times as many; a size that is named for `--memory` is enough for these.
const UNEVEN_AT_WORST: f64 = 2.5;

/// Tiles for each that would be full: terrains, statues, sponges and overlapping scans of 0.3 to 2 million triangles have 1.2 to 1.9.
const TILES_PER_FULL: f64 = 1.65;
/// The tile at the top, and the boxes around its middle that a surface passes through.
const FEWEST_TILES: f64 = 8.0;

/// A round whose one group has at most this many tiles' triangles is the last.
pub(super) const LAST: u64 = 8;

/// Share of its triangles that a round leaves.
const LEFT: f64 = 0.25;

/// The rounds on the way to the finest level that is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hidden {
    /// Rounds that write no tiles; 0 if the input is the finest level.
    pub(super) rounds: u32,
    /// Share of its triangles that each of them leaves.
    left: f64,
    /// Triangles in a box of the input, so that those of the finest level are tiles.
    pub(super) base_triangles: u64,
    tile_triangles: u64,
}

impl Hidden {
    pub(super) fn new(config: &TilesConfig, triangles_in: u64) -> Hidden {
        let tile_triangles = config.tile_triangles;
        let ratio = match config.finest {
            Finest::Input => 1.0,
            Finest::Ratio(ratio) => ratio,
            Finest::Triangles(n) => n as f64 / triangles_in.max(1) as f64,
        };
        if ratio >= 1.0 {
            return Hidden {
                rounds: 0,
                left: LEFT,
                base_triangles: tile_triangles,
                tile_triangles,
            };
        }
        // The fewest rounds that leave a quarter or more; a little less is a quarter, too.
        let rounds = (ratio.ln() / LEFT.ln() - 1e-9).ceil().clamp(1.0, 16.0);
        let left = ratio.powf(1.0 / rounds);
        let base = tile_triangles as f64 / (4.0 * left).powf(rounds);
        Hidden { rounds: rounds as u32, left, base_triangles: base.max(1.0) as u64, tile_triangles }
    }

    /// Share of its triangles that a round leaves, from 1.
    pub(super) fn left(&self, round: u32) -> f64 {
        if round <= self.rounds { self.left } else { LEFT }
    }

    /// Triangles of a full box in the mesh that a round begins with.
    pub(super) fn tile_triangles(&self, round: u32) -> u64 {
        if round <= self.rounds { self.base_triangles } else { self.tile_triangles }
    }
}

/// Bytes of output for each triangle of a tile, packed and not.
const OUTPUT_BYTES: [u64; 2] = [7, 16];

/// Those of bare tiles, packed: 3.9 (terrain), 4.1 (statue), 4.4 (dragon).
const BARE_BYTES: f64 = 4.2;

/// Bytes of the page of a tile for each of its triangles, about: 30 texels, packed as JPEG.
const PAGE_BYTES: f64 = 12.0;

/// Bytes of a triangle in the copy of the input that has colours instead of images.
const FACE_BYTES: u64 = 13;

/// Processor seconds for a triangle, for the expected time only (statue of 4 M 1.75e-6).
const SECONDS_PER_TRIANGLE: f64 = 2.0e-6;
/// The same where vertices have properties (the legion with colours 4.6e-6, not welded 5.9e-6).
const SECONDS_WITH_PROPERTIES: f64 = 5e-6;
/// The same where corners have texture coordinates (`synth rooms` 6.4e-6, the legion 8e-6 with its OBJ file read).
const SECONDS_WITH_TEXTURE: f64 = 7e-6;
/// Processor seconds of pages: for a triangle of the tiles (staged, cut, put into charts), and for a pixel of the images.
const PAGE_SECONDS: [f64; 2] = [5e-6, 0.65e-6];

/// Share of the time that the partition takes, and that of a round of the one before it.
const PARTITION_SHARE: f64 = 0.05;
const ROUND_SHARE: f64 = 0.45;

/// Forecast of a run.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TilesPlan {
    /// Triangles of the input.
    pub triangles_in: u64,
    /// Levels of detail, about.
    pub levels: u32,
    /// Tiles of all levels, about.
    pub tiles: u64,
    /// Memory the stages may share, in bytes.
    pub usable_memory_bytes: u64,
    /// Memory that the most demanding stage needs at least, in bytes.
    pub needed_memory_bytes: u64,
    /// Peak bytes in the job folder.
    pub temp_bytes: u64,
    /// Bytes of the output.
    pub output_bytes: u64,
    /// Expected seconds.
    pub seconds: f64,
}

/// An input that has been opened and planned for; nothing has been written yet.
#[derive(Debug)]
pub struct PreparedTiles {
    /// The open input.
    pub source: MeshSource,
    /// Plan of the run.
    pub plan: TilesPlan,
    /// True if tiles get pages.
    pub textured: bool,
    /// Fingerprint of the input, taken before it was opened.
    pub marks: BTreeMap<String, String>,
    /// The account of what the open input has on disk.
    pub staging: Disk,
}

/// Opens the input and plans the run.
pub fn prepare_tiles(config: &TilesConfig) -> Result<PreparedTiles> {
    // The run finds out by itself whether the tree is its own.
    if config.restart || !is_named(config) {
        refuse_to_replace(&config.output, config.force)?;
    }
    let mut marks = input_marks(&config.input)?;
    let read = config.read_options();
    let staging = Disk::default();
    let disk = staging.clone();
    let stage = StageOptions { read, disk, ..StageOptions::new(folder_of(&config.job_folder)) };
    let mut stage = stage.within(config.memory_bytes);
    stage.threads = config.threads;
    let (how, exact_above) = (config.weld, config.tile_triangles);
    stage.weld = Some(WeldOptions { how, exact_above, labels: Vec::new(), keeps_numbers: false });
    let source = MeshSource::open_staged(&config.input, &stage).and_then(|mut source| {
        survey_labels(&mut source, &[])?;
        Ok(source)
    });
    let source = unchanged(&config.input, &marks, source)?;
    marks.extend(marks_beside(&source));
    let textured = is_textured(&source, config)?;
    let staged = staging.held_bytes();
    let plan = TilesPlan::new(&source, config, (textured, &staging))?;
    // What is staged lies there already.
    let (temp, output) = (plan.temp_bytes - staged, plan.output_bytes);
    check_space((&config.output, &config.job_folder), temp, output, temp + output, 0)?;
    Ok(PreparedTiles { source, plan, textured, marks, staging })
}

/// True if the tree that is there is that of the job in the job folder, which was stopped before that was gone.
pub(super) fn is_named(config: &TilesConfig) -> bool {
    named(config).is_some_and(|named| checksum(&config.output) == Some(named))
}

/// True if the tree of the job in the job folder has had its name, and is neither there nor where it grew.
pub(super) fn is_lost(config: &TilesConfig) -> bool {
    named(config).is_some_and(|named| {
        [&config.output, &config.pending_output()]
            .iter()
            .all(|folder| checksum(folder) != Some(named))
    })
}

/// The checksum that a job has recorded when its tree was whole.
fn named(config: &TilesConfig) -> Option<u64> {
    view(&config.job_folder).ok()?.outcomes.get(NAMED)?.as_u64()
}

/// Refuses a folder that exists; with `force` only one that is not a tree of this program, or holds anything else.
pub(super) fn refuse_to_replace(output: &Path, force: bool) -> Result<()> {
    let Ok(meta) = std::fs::symlink_metadata(output) else { return Ok(()) };
    let shown = output.display();
    if !meta.is_dir() {
        return Err(Error::Usage(format!("{shown} is not a folder; give the name of a new one")));
    }
    if is_empty(output) {
        return Ok(());
    }
    if !force {
        return Err(Error::Usage(format!("{shown} exists; give --force to replace it")));
    }
    check_tree(output)
}

impl TilesPlan {
    /// `staging` has the account of what the open source has on disk.
    fn new(
        source: &MeshSource,
        config: &TilesConfig,
        (textured, staging): (bool, &Disk),
    ) -> Result<TilesPlan> {
        let triangles_in = source.n_triangles();
        source.require_faces()?;
        let layout = layout(source, textured);
        let per_triangle = source.n_vertices() as f64 / triangles_in as f64;
        let hidden = Hidden::new(config, triangles_in);
        let group = TILES_OF_GROUP * config.tile_triangles;
        let most_of = |uneven: f64| ((group as f64 * uneven) as u64).min(triangles_in);
        let work_of = |triangles: u64| {
            let vertices = (triangles as f64 * per_triangle.clamp(0.5, 3.0)) as u64;
            let tally = CellTally { vertices, triangles };
            work_bytes(tally, tally, 1.0, &layout) + BYTES_PER_TRIANGLE * triangles
        };
        let most = most_of(UNEVEN);
        let work = work_of(most);
        let usable = config.memory_bytes.saturating_sub(BASE_BYTES);
        let store = store_bytes(source.n_vertices(), triangles_in, &layout);
        let n_cells = plan_cells(triangles_in, TILES_OF_GROUP * hidden.base_triangles);
        let sizes =
            Sizes { n_vertices: source.n_vertices(), n_cells, store_bytes: store, layout: &layout };
        let tables = Shares::new(sizes, config.threads.get(), usable).least_bytes;
        let looks_of = |most| match gets_colours(source, textured) {
            true => least_for_colours(source),
            false if textured => least_for_tiles(source, most),
            false => 0,
        };
        let looks = looks_of(most);
        let needed = work.max(tables).max(looks) + BASE_BYTES;
        if needed > usable + BASE_BYTES {
            let worst = most_of(UNEVEN_AT_WORST);
            let named = needed.max(BASE_BYTES + work_of(worst).max(looks_of(worst)));
            return Err(too_little(config, named));
        }
        let finest = triangles_in as f64 * hidden.left.powi(hidden.rounds as i32);
        let tile = config.tile_triangles as f64;
        let (mut levels, mut left, mut all) = (2, finest, finest);
        while left > LAST as f64 * tile {
            left *= LEFT;
            all += left;
            levels += 1;
        }
        all += (LEFT * left).min(tile);
        // Later rounds carry ids and channels with every vertex.
        let row = (9 + layout.row_bytes(true)) as f64 * per_triangle.clamp(0.5, 3.0) + 12.0;
        let coloured = match gets_colours(source, textured) {
            true => {
                source.n_vertices() * schema(source, textured).record_bytes() as u64
                    + FACE_BYTES * triangles_in
            }
            false => 0,
        };
        let shapes = if textured {
            (OUTPUT_BYTES[usize::from(!config.packs)] as f64 * all) as u64
        } else {
            0
        };
        let staged = staging.held_bytes();
        let pages = match textured {
            true => check_tiles(source, most, (usable, staged))?,
            false => TilesNeed::default(),
        };
        let is_bare = config.packs && !textured && source.schema().properties.is_empty();
        let of_shape = match is_bare {
            true => BARE_BYTES,
            false => OUTPUT_BYTES[usize::from(!config.packs)] as f64,
        };
        let output = (of_shape + scalar_bytes(&layout.schema) * per_triangle.clamp(0.5, 3.0)) * all;
        let of_triangle = match (source.has_corner_texture(), source.schema().properties.is_empty())
        {
            (true, _) => SECONDS_WITH_TEXTURE,
            (false, false) => SECONDS_WITH_PROPERTIES,
            (false, true) => SECONDS_PER_TRIANGLE,
        };
        let mut seconds = of_triangle * triangles_in as f64;
        if textured {
            seconds += PAGE_SECONDS[0] * all + PAGE_SECONDS[1] * pages.pixels as f64;
        }
        Ok(TilesPlan {
            triangles_in,
            levels,
            tiles: (TILES_PER_FULL * all / tile).ceil().max(FEWEST_TILES) as u64,
            usable_memory_bytes: usable,
            needed_memory_bytes: needed,
            // The cells are gone when the input is staged for pages, once more.
            temp_bytes: (store + coloured + (triangles_in as f64 * hidden.left(1) * row) as u64)
                .max(pages.temp_bytes)
                .max(if textured { staging.peak_bytes() } else { 0 })
                + shapes
                + staged,
            output_bytes: output as u64 + if textured { (PAGE_BYTES * all) as u64 } else { 0 },
            seconds: seconds / config.threads.get() as f64,
        })
    }

    /// The seconds of the stages of the shape.
    pub fn stage_seconds(&self) -> Vec<StageSeconds> {
        let shares = || (0..self.levels as i32).map(|round| ROUND_SHARE.powi(round));
        let all: f64 = shares().sum();
        let mut stages = vec![("partition", PARTITION_SHARE * self.seconds)];
        stages.extend(shares().enumerate().map(|(round, share)| {
            let seconds = (1.0 - PARTITION_SHARE) * self.seconds * share / all;
            (if round == 0 { "simplify" } else { "round" }, seconds)
        }));
        stages
    }

    /// The plan for people, one fact a line.
    pub fn lines(&self, config: &TilesConfig) -> Vec<String> {
        let mut lines = vec![
            format!("input    {} triangles", show_count(self.triangles_in)),
            format!(
                "tiles    about {} of about {} triangles each, in about {} levels",
                show_count(two_digits_up(self.tiles as f64)),
                show_count(config.tile_triangles),
                self.levels
            ),
        ];
        lines.extend(price_lines(
            [config.memory_bytes, self.needed_memory_bytes],
            config.threads,
            [self.temp_bytes, self.output_bytes],
            &config.job_folder,
            self.seconds,
        ));
        lines
    }
}

/// Fails for want of memory; `needed` would do.
pub(super) fn too_little(config: &TilesConfig, needed: u64) -> Error {
    Error::NoMemory(format!(
        "a group of tiles needs {} of memory, the budget is {}; give --memory {} or fewer --tile-triangles than {}",
        show_bytes(needed),
        show_bytes(config.memory_bytes),
        memory_word(needed),
        config.tile_triangles
    ))
}

/// Bytes of a vertex of a tile for properties that it carries as attributes; packed ones may have fewer.
fn scalar_bytes(schema: &VertexSchema) -> f64 {
    (4 * carried_scalars(schema).0.len()) as f64
}

/// True if tiles get pages. Errors: pages were asked for, and the input has none that could be made.
fn is_textured(source: &MeshSource, config: &TilesConfig) -> Result<bool> {
    let has_pages = config.texture != TileTexture::Colors && has_images(source);
    let found = [
        (!has_pages, "no pages are made of this input"),
        (config.viewer, "the viewer shows JPEG and PNG only; leave --viewer out"),
        (!BasisCoding::IS_MADE, "this build makes no KTX2 (feature 'ktx2')"),
    ];
    let obstacle = found.into_iter().find(|(is_so, _)| *is_so && config.coding.is_some());
    if let Some((_, what)) = obstacle {
        return Err(Error::Usage(format!("--textures: {what}")));
    }
    match config.texture {
        TileTexture::Colors => Ok(false),
        TileTexture::Auto => Ok(has_images(source)),
        TileTexture::Bake if has_images(source) => Ok(true),
        TileTexture::Bake => Err(Error::Usage(format!(
            "--texture bake: {} has no texture coordinates at the corners of faces, or no image that can be used",
            source.path().display()
        ))),
    }
}

/// True if vertices get colours out of images or materials.
pub(super) fn gets_colours(source: &MeshSource, textured: bool) -> bool {
    !textured && colours_vertices(source)
}

/// Properties of the vertices that are cut into tiles: those of the input, and the colours that they get from its images and materials.
pub(super) fn schema(source: &MeshSource, textured: bool) -> VertexSchema {
    if gets_colours(source, textured) {
        return coloured_schema(source);
    }
    source.schema().clone()
}

/// Rows of vertices of a run.
pub(super) fn layout(source: &MeshSource, textured: bool) -> VertexLayout {
    let weights = crate::mesh::attribute_weights::Weights::default();
    VertexLayout::for_kernel(&schema(source, textured), source.n_vertices(), &[], &weights)
}
