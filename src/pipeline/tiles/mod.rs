//! The program of `tiles`: from a mesh larger than memory to a tree of tiles.
//!
//! Partition into the groups of the first round; then round after round: write the tiles of the level below, simplify
//! every group, regroup what is left, until one group holds all. Tiles of textured scans then get their pages. Every step is sealed in the job folder, the
//! folder of the tree gets its name when everything in it is durable.
//!
//! docs/design/tiles.md.

mod config;
mod losses;
mod pending;
mod plan;
pub mod report;
mod rounds;
mod textures;
mod viewer;
mod world;

use config::NAMED;
pub use config::{Finest, TILE_TRIANGLES, TileTexture, TilesConfig};
pub use plan::{PreparedTiles, TilesPlan, prepare_tiles};

use super::concluded::{abandon, is_final};
use super::run_report::InputReport;
use super::sealed_stages::SealedStages;
use super::steps::faults;
use crate::bake::{Coloured, Means, colour_vertices};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::io::tileset::{FILE_NAME, OWN_PAGES, TileTree, TreeFiles, write_tilesets};
use crate::io::{TileScalar, degrees_remark, find3};
use crate::kernel;
use crate::mesh::codec::ChannelKind;
use crate::mesh::record::VertexSchema;
use crate::stages::partition::{Partition, partition_into_groups};
use crate::stages::tiles;
use crate::store::cells::{Dropped, GroupGrid, Lattice};
use crate::store::job::fingerprint::unchanged;
use crate::store::job::{Identity, Job, OVER};
use crate::store::stage_context::StageContext;
use crate::system::disk::Disk;
use crate::system::json_keys::SCHEMA_VERSION;
use crate::system::losses::Loss;
use crate::system::memory::peak_bytes;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
use losses::all_losses;
use plan::{Hidden, gets_colours, layout};
use report::{FolderReport, TilesReport, level_reports};
use rounds::Stages;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Writes the tree of tiles of `config.input` to `config.output`.
pub fn make_tiles(
    prepared: PreparedTiles,
    config: &TilesConfig,
    progress: &Progress,
) -> Result<TilesReport> {
    make_tiles_on(&Disk::default(), prepared, config, progress)
}

/// The same through a given disk, so that a test can make it fail. A panic on the way becomes an error.
pub fn make_tiles_on(
    disk: &Disk,
    prepared: PreparedTiles,
    config: &TilesConfig,
    progress: &Progress,
) -> Result<TilesReport> {
    guarded(|| run(disk, prepared, config, progress))
}

fn run(
    disk: &Disk,
    prepared: PreparedTiles,
    config: &TilesConfig,
    progress: &Progress,
) -> Result<TilesReport> {
    let started = Instant::now();
    let PreparedTiles { source, plan, textured, marks, staging } = prepared;
    disk.adopt(staging.held_bytes());
    if config.memory_bytes < 2 * plan.needed_memory_bytes {
        crate::system::memory::keep_nothing_back();
    }
    let schema = layout(&source, textured).schema;
    let (scalars, lost) = tiles::carried_scalars(&schema);
    let identity = identity(&source, (config, textured), &marks, scalars.len());
    let pending = config.pending_output();
    if let Some(report) = concluded(config, &identity, &pending, disk)? {
        return Ok(report);
    }
    let job = Job::open(&config.job_folder, disk, &identity, config.restart)?;
    super::post(&job, &config.output, source.n_triangles(), progress);
    // Runs with other job folders may have the same output.
    let _held = pending::open(&job, &pending, disk, job.outcome::<u64>(NAMED)?)?;
    let run = StageContext {
        job: &job,
        progress,
        threads: config.threads.get(),
        memory_bytes: plan.usable_memory_bytes,
        checkpoint_every: config.checkpoint_every,
    };
    let n = source.n_triangles();
    let shapes = pending.join(pending::SHAPES);
    let mut stages = Stages {
        stages: SealedStages::new(run, 2 * plan.levels),
        run,
        config,
        pending: &pending,
        tiles_folder: if textured { &shapes } else { &pending },
        input_triangles: n,
        layout: layout(&source, textured),
        hidden: Hidden::new(config, n),
        kernel: kernel_options(&plan::schema(&source, textured)),
        dropped: Dropped::default(),
    };
    let (partition, grid) = match cut(&mut stages, &source, textured, &marks) {
        Ok(cut) => cut,
        Err(error) => return Err(give_up(&job, &pending, error)),
    };
    let (world, mut of_world) = match world::world(config, &partition.bounds, &source) {
        Ok(world) => world,
        Err(error) => return Err(give_up(&job, &pending, error)),
    };
    of_world.extend(degrees_remark(&source, &partition.bounds).map(Loss::whole));
    let coloured = job.outcome::<Coloured>(COLOURED)?;
    if coloured.is_some() {
        disk.remove(&job.path(COLOURED_FILE))?;
    }
    let (mut hidden, mut top) = match stages.rounds(&partition, &grid) {
        Ok(made) => made,
        Err(error) => return Err(give_up(&job, &pending, error)),
    };
    let mut rounds = hidden.split_off(stages.hidden.rounds as usize);
    let frame = textures::Frame { origin: grid.lattice.origin, scalars: &scalars };
    let pages = match textured {
        true => Some(textures::paint(&mut stages, &marks, (&mut rounds, &mut top), frame)?),
        false => None,
    };
    stages.stages.begin("write", 1);
    let step = grid.lattice.step_of(stages.hidden.rounds);
    let lattice = Lattice { step, ..grid.lattice };
    let levels = tiles::TreeLevels {
        lattice,
        rounds: &rounds,
        hidden: &hidden,
        top: &top,
        pixels: config.pixels,
    };
    let (tiles, deviations) = tiles::tree(&levels);
    let root = tiles.iter().rposition(|tile| tile.level as usize == rounds.len()).unwrap_or(0);
    let leaves = tiles.iter().filter(|tile| tile.level == 0);
    let leaf_triangles = leaves.map(|tile| tile.triangles).sum();
    let extras = about(
        &source,
        config,
        About {
            input_triangles: partition.store.triangles - stages.dropped.duplicate_faces,
            n_levels: rounds.len() + 1,
            lattice,
            finest: (!hidden.is_empty()).then_some((leaf_triangles, deviations[0])),
            texels_per_unit: pages.as_ref().map(|pages| pages.texels_per_unit),
            has_normals: find3(&schema, ["nx", "ny", "nz"]).is_some(),
            scalars: &scalars,
        },
    );
    let tree = TileTree {
        root: root as u32,
        transform: placed(&world, grid.lattice.origin, config.is_z_up),
        is_z_up: config.is_z_up,
        extras: json!({ "stonecut": extras }),
        tiles,
    };
    let (n_sets, set_bytes) = write_tilesets(&tree, &pending, disk)?;
    disk.disown(set_bytes);
    let viewer_bytes = if config.viewer { viewer::write_viewer(&pending, disk)? } else { 0 };
    disk.sync_all_below(&pending)?;
    let set = pending.join(FILE_NAME);
    let text = std::fs::read(&set).map_err(|e| Error::reading(&set, "cannot read", e))?;
    let n_triangles = source.n_triangles();
    let (seconds, rate) = stages.stages.seconds(started, n_triangles);
    let level_reports = level_reports(&rounds, &top, &deviations, config.tile_triangles);
    let losses =
        all_losses(&source, (coloured, of_world), (&lost, rounds.first()), pages.as_ref())?;
    progress.lose_all(&losses);
    let losses = progress.losses();
    let report = TilesReport {
        schema_version: SCHEMA_VERSION,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        input: InputReport {
            faults: faults(&source, &partition, stages.dropped),
            ..InputReport::new(&config.input, &source, partition.bounds)
        },
        inputs: source.parts().to_vec(),
        settings: config.settings(),
        output: FolderReport {
            path: config.output.display().to_string(),
            bytes: level_reports.iter().map(|level| level.bytes).sum::<u64>()
                + set_bytes
                + viewer_bytes,
        },
        tiles: level_reports.iter().map(|level| level.tiles).sum(),
        tilesets: n_sets,
        stuck: level_reports.iter().map(|level| level.stuck).sum(),
        levels: level_reports,
        seconds,
        triangles_per_second: rate,
        peak_memory_bytes: peak_bytes(),
        peak_temp_bytes: stages.stages.peak_temp_bytes().max(staging.peak_bytes()),
        stages: stages.stages.reports,
        notes: losses.lines(),
        losses,
        texture: pages,
    };
    refuse_appeared(config)?;
    // From here on the job may be over.
    job.record(NAMED, &xxh3_64(&text))?;
    job.record(OVER, &report)?;
    pending::finish(&pending, disk)?;
    disk.replace_folder(&pending, &config.output, &pending::check_tree, &|folder| {
        pending::remove_tree(folder, disk)
    })?;
    if !config.keep_temp {
        job.remove()?;
    }
    Ok(report)
}

/// Identity of a job of tiles: its input and all that changes its bytes.
fn identity(
    source: &MeshSource,
    (config, textured): (&TilesConfig, bool),
    marks: &BTreeMap<String, String>,
    n_scalars: usize,
) -> Identity {
    let mut input_marks = marks.clone();
    input_marks.insert("vertices".to_owned(), source.n_vertices().to_string());
    input_marks.insert("faces".to_owned(), source.n_face_rows().to_string());
    let input = std::path::absolute(&*config.input).unwrap_or_else(|_| config.input.to_path_buf());
    let mut settings = config.settings();
    if let Some(code) = world::system_of(config, source) {
        settings.insert("crs".to_owned(), code);
    }
    if n_scalars > 0 {
        // Builds that do not carry them cannot go on with the job, nor this one with theirs.
        settings.insert("attributes".to_owned(), n_scalars.to_string());
    }
    if gets_colours(source, textured) {
        settings.insert("colours".to_owned(), "images".to_owned());
    }
    if textured {
        settings.insert("texture".to_owned(), "bake".to_owned());
    }
    Identity { input: input.display().to_string(), input_marks, settings }
}

/// The report of a job that has ended, if its tree is there; fails if another tree stands in its place.
fn concluded(
    config: &TilesConfig,
    identity: &Identity,
    pending: &Path,
    disk: &Disk,
) -> Result<Option<TilesReport>> {
    let is_named = plan::is_named(config);
    if config.restart || !(is_named || plan::is_lost(config)) {
        return Ok(None);
    }
    let report: Option<TilesReport> = Job::concluded(&config.job_folder, disk, identity)?;
    if is_named && report.is_none() {
        plan::refuse_to_replace(&config.output, config.force)?;
        return Ok(None);
    }
    // Of the tree that was replaced, or of one that was taken away since: then the job begins again.
    pending::remove(pending, disk)?;
    Ok(report.filter(|_| is_named))
}

/// Cuts the input into the groups of the first round, as a stage; fails where there is nothing to cut.
fn cut(
    stages: &mut Stages,
    source: &MeshSource,
    textured: bool,
    marks: &BTreeMap<String, String>,
) -> Result<(Partition, GroupGrid)> {
    let (config, n) = (stages.config, source.n_triangles());
    let count = |cut: &(Partition, GroupGrid)| cut.0.store.triangles;
    let cut = stages.stages.stage(("partition", "partition"), n, count, |run| {
        let outcome = guarded(|| cut_into_groups(source, (config, textured), run));
        unchanged(&config.input, marks, outcome)
    })?;
    let held = cut.0.bounds.hold("'tiles'", [0.0, 1e100]);
    held.map_err(|what| Error::bad_input(&config.input, what))?;
    if cut.0.store.triangles == 0 {
        let what = "no triangle has three different corners: there is nothing to cut into tiles";
        return Err(Error::bad_input(&config.input, what));
    }
    stages.check_step(&cut.0.store, &cut.1.lattice)?;
    Ok(cut)
}

/// Facts of a tree besides its input and settings.
struct About<'a> {
    input_triangles: u64,
    n_levels: usize,
    lattice: Lattice,
    /// Triangles and deviation of the leaves, where finer rounds are hidden.
    finest: Option<(u64, f64)>,
    texels_per_unit: Option<f64>,
    has_normals: bool,
    scalars: &'a [TileScalar],
}

/// The `extras` of a tree, for those who read it again (docs/design/tiles.md).
fn about(source: &MeshSource, config: &TilesConfig, of: About) -> serde_json::Value {
    let mut about = json!({
        "input_triangles": of.input_triangles,
        "levels": of.n_levels,
        "step": of.lattice.step, "pixels": config.pixels, "up": if config.is_z_up { "z" } else { "y" },
        "origin": of.lattice.origin,
    });
    if let Some(code) = world::system_of(config, source) {
        about["crs"] = json!(code);
    }
    if let Some(offset) = source.offset() {
        about["offset"] = json!(offset);
    }
    if let Some((triangles, deviation)) = of.finest {
        about["finest_triangles"] = triangles.into();
        about["finest_deviation"] = deviation.into();
    }
    if let Some(texels) = of.texels_per_unit {
        about["texels_per_unit"] = texels.into();
    }
    if config.viewer {
        about[OWN_PAGES] = TreeFiles::page_list(&viewer::FILES);
    }
    if of.has_normals {
        about["normals"] = "given".into();
    }
    if !of.scalars.is_empty() {
        about["scalars"] = json!(of.scalars);
    }
    about
}

/// The error of a run; what it has made goes if the same command would fail again.
fn give_up(job: &Job, pending: &Path, error: Error) -> Error {
    if is_final(&error) {
        let _ = pending::remove(pending, job.disk());
    }
    abandon(job, error)
}

/// Cuts the input into the groups of the first round; where it has images or materials and no colours, a copy with colours out of them.
fn cut_into_groups(
    source: &MeshSource,
    (config, textured): (&TilesConfig, bool),
    run: &StageContext,
) -> Result<(Partition, GroupGrid)> {
    let base = Hidden::new(config, source.n_triangles()).base_triangles;
    if !gets_colours(source, textured) {
        return partition_into_groups(source, base, run);
    }
    let path = run.job.path(COLOURED_FILE);
    let coloured = run.job.sealed(COLOURED, || colour_vertices(source, &path, Means::from(run)))?;
    let copy = MeshSource::open(&path)?;
    let (mut partition, grid) = partition_into_groups(&copy, base, run)?;
    partition.degenerate_faces += coloured.degenerate_faces;
    partition.bad_faces += coloured.bad_faces;
    Ok((partition, grid))
}

/// The copy of the input with colours instead of images and materials, and what it is recorded as.
const COLOURED_FILE: &str = "input.coloured";
const COLOURED: &str = "coloured";

/// Refuses to replace what took the name of the output while the run was under way.
fn refuse_appeared(config: &TilesConfig) -> Result<()> {
    let output = config.output.display();
    plan::refuse_to_replace(&config.output, config.force).map_err(|error| match error {
        Error::Usage(_) if !config.force => Error::Usage(format!(
            "{output} has appeared during the run; give --force to replace it"
        )),
        other => other,
    })
}

/// Texture coordinates and regions mean nothing outside of their chart.
fn kernel_options(schema: &VertexSchema) -> kernel::Options {
    let kinds = schema.kernel_codec(&[]).channel_kinds(schema);
    let is_confined = |kind: &ChannelKind| *kind == ChannelKind::Texture;
    kernel::Options {
        fit: kernel::Fit::Off,
        follow: true,
        confined: kinds.iter().map(is_confined).collect(),
        ..kernel::Options::default()
    }
}

/// The transform of the tree: from its middle to the frame of the mesh, from there to the world.
fn placed(world: &[f64; 16], origin: [f64; 3], is_z_up: bool) -> [f64; 16] {
    let [x, y, z] = if is_z_up { origin } else { [origin[0], -origin[2], origin[1]] };
    let mut out = *world;
    for k in 0..3 {
        out[12 + k] = world[k] * x + world[4 + k] * y + world[8 + k] * z + world[12 + k];
    }
    out
}
