//! `stonecut tiles`: a tree of tiles from a mesh of any size.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::inputs::InOut;
use super::outcome::{say_faults, stage_line, write_json};
use super::placing::{TypedMoves, TypedTransform, Up, numbers, parse_transform};
use super::receipt::{self, TypedReceipt};
use super::session::{Command, Session};
use super::tree_receipt::{self, TilesRun};
use crate::bake::BasisCoding;
use crate::error::{Offers, Result};
use crate::io::Weld;
use crate::io::globe::{Crs, east_north_up, east_north_up_of};
use crate::io::sidecars::Georeference;
use crate::mesh::placing::Degrees;
use crate::pipeline::tiles::report::TilesReport;
use crate::pipeline::tiles::{
    Finest, PreparedTiles, TILE_TRIANGLES, TileTexture, TilesConfig, make_tiles, prepare_tiles,
};
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::Seen;
use crate::system::units::{parse_count, parse_ratio, show_bytes, show_count, show_outward};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Cuts a mesh of any size into tiles at all levels of detail (OGC 3D Tiles 1.1)
///
/// For viewers that load what the camera sees, as fine as it sees it. Tiles of neighbouring levels meet without
/// cracks, and the errors that decide between levels are measured. The same command continues after an
/// interruption, whatever it was.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    // Its own lines are its documentation.
    #[command(flatten)]
    #[allow(missing_docs)]
    pub paths: InOut,
    /// Triangles of a tile, about.
    #[arg(long, value_name = "N", value_parser = parse_tile, default_value_t = TILE_TRIANGLES)]
    tile_triangles: u64,
    /// Pixels by which the picture may deviate from the full mesh in a viewer with its defaults (16 pixels).
    #[arg(long, value_name = "P", value_parser = parse_pixels, default_value_t = 1.0)]
    pixels: f64,
    /// Finest level that is kept, as a share of the triangles (10%) or their number (4M); finer ones are not written
    /// [default: the input].
    #[arg(long, value_name = "R", value_parser = parse_finest)]
    finest: Option<Finest>,
    /// Compression of tiles.
    #[arg(long, value_enum, value_name = "HOW", default_value = "meshopt")]
    compress: Compress,
    /// Look of tiles of a scan with images [default: bake where there are images, otherwise colors].
    #[arg(long, value_enum, value_name = "HOW")]
    texture: Option<TypedLook>,
    /// Pages of textured tiles as KTX2 [default: JPEG, or PNG where images of the input are].
    #[arg(long, value_enum, value_name = "HOW")]
    textures: Option<TypedCoding>,
    /// Axis of the mesh that points upwards [default: y for glTF and GLB files, z for all others].
    #[arg(long, value_enum, value_name = "AXIS")]
    up: Option<Up>,
    #[command(flatten)]
    moves: TypedMoves,
    /// Place on the earth of the mesh's origin: latitude and longitude in degrees, height above the ellipsoid in
    /// metres (WGS 84); x is east, y north.
    #[arg(long, value_name = "LAT,LON,HEIGHT", value_parser = parse_geo, conflicts_with = "transform", allow_hyphen_values = true)]
    geo: Option<Geo>,
    /// Transform from the mesh (z upwards) to the world: 16 numbers, column by column, joined by commas.
    #[arg(long, value_name = "M16", value_parser = parse_transform, allow_hyphen_values = true)]
    transform: Option<TypedTransform>,
    /// Coordinate reference system of the mesh, which puts the tree on the earth: EPSG:32633, or EPSG:2263+6360 with the unit of
    /// heights; x is east, heights are taken as above the ellipsoid. An offset that a file beside the mesh names is added [default: what such a file says; none: nothing].
    #[arg(long, value_name = "CODE", value_parser = parse_crs, conflicts_with_all = ["geo", "transform"])]
    crs: Option<TypedCrs>,
    /// Write a page that shows the tiles in a browser (index.html; `stonecut serve OUTPUT` offers it).
    #[arg(long)]
    viewer: bool,
    /// Memory budget, everything included: 512MiB, 4GiB, 50% [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Worker threads [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Folder in which the job folder is made [default: beside OUTPUT].
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Keep the job folder after success.
    #[arg(long)]
    keep_temp: bool,
    /// Replace OUTPUT if it is a folder of tiles that stonecut has written.
    #[arg(long)]
    force: bool,
    /// Throw away what an earlier run left and start over.
    #[arg(long)]
    restart: bool,
    /// Drop and count broken faces and vertices instead of failing.
    #[arg(long)]
    skip_bad: bool,
    /// Copies of vertices that become one before everything else: auto (copies within rounding, where a sample shows that
    /// there are some), off, or a distance in input units.
    #[arg(long, value_name = "WHAT", default_value = "auto")]
    weld: Weld,
    /// Print the plan and stop.
    #[arg(long)]
    dry_run: bool,
    /// Write a report in JSON.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    pub(super) receipt: TypedReceipt,
}

/// The choices of `--compress`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Compress {
    /// EXT_meshopt_compression: a third of the size.
    Meshopt,
    /// Plain numbers, for viewers that know no compression.
    None,
}

/// The choices of `--texture`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedLook {
    /// An image for each tile, as fine as its level.
    Bake,
    /// Colours of vertices out of the images.
    Colors,
}

/// The choices of `--textures`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedCoding {
    /// UASTC with Zstandard: a byte a texel in the file and in the graphics card.
    Ktx2,
    /// ETC1S: smaller and coarser than JPEG.
    Etc1s,
}

/// A place on the earth: latitude, longitude, height.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Geo([f64; 3]);

fn parse_tile(text: &str) -> std::result::Result<u64, String> {
    match parse_count(text)? {
        n @ 500..=1_000_000 => Ok(n),
        n => Err(format!("{n} triangles are not a tile for a viewer; give 500 to 1M")),
    }
}

fn parse_pixels(text: &str) -> std::result::Result<f64, String> {
    let pixels = text.parse().ok().filter(|x: &f64| (0.01..=1000.0).contains(x));
    pixels.ok_or_else(|| "a number of pixels from 0.01 to 1000".to_owned())
}

/// A share ends in a percent sign or is at most 1, as for `simplify --ratio`.
fn parse_finest(text: &str) -> std::result::Result<Finest, String> {
    let is_share = text.ends_with('%') || text.parse().is_ok_and(|x: f64| x <= 1.0);
    if is_share {
        return parse_ratio(text).map(Finest::Ratio);
    }
    match parse_count(text)? {
        n @ 500.. => Ok(Finest::Triangles(n)),
        n => Err(format!("a finest level of {n} triangles; give 500 or more, or a share as 10%")),
    }
}

fn parse_geo(text: &str) -> std::result::Result<Geo, String> {
    let fits = |[lat, lon, _]: &[f64; 3]| lat.abs() <= 90.0 && lon.abs() <= 360.0;
    let place = numbers::<3>(text).filter(fits).map(Geo);
    place.ok_or_else(|| "latitude, longitude and height: 47.3769,8.5417,408".to_owned())
}

/// The choice of `--crs`.
#[derive(Clone, Debug, PartialEq)]
enum TypedCrs {
    None,
    Code(String),
}

fn parse_crs(text: &str) -> std::result::Result<TypedCrs, String> {
    if text == "none" {
        return Ok(TypedCrs::None);
    }
    Crs::of(text).map(|crs| TypedCrs::Code(crs.name()))
}

/// Takes the system that was typed or that the mesh names; a line for people if there is one.
fn take_place(
    found: Option<Georeference>,
    typed: Option<&TypedCrs>,
    config: &mut TilesConfig,
) -> Option<String> {
    let found = found.filter(|_| typed != Some(&TypedCrs::None));
    if let Some(TypedCrs::Code(code)) = typed {
        config.crs = Some(code.clone());
        // Degrees that have become metres are told with the losses.
        let found = found.filter(|found| !found.crs.starts_with("ENU:"));
        return found.map(|found| format!("place     {code}, with {}", found.words()));
    }
    let found = found?;
    if found.crs.is_empty() {
        return Some(format!("place     {}; --crs puts the tree on the earth", found.words()));
    }
    match Crs::of(&found.crs) {
        Ok(crs) => config.crs = Some(crs.name()),
        Err(_) if east_north_up_of(&found.crs).is_some() => config.crs = Some(found.crs.clone()),
        Err(what) => return Some(format!("place     not used: {what}")),
    }
    Some(format!("place     {}; --crs none leaves it out", found.words()))
}

impl Args {
    /// The system that was typed; none with a transform.
    fn typed_crs(&self) -> Option<&TypedCrs> {
        let is_placed = self.geo.is_some() || self.transform.is_some();
        if is_placed { Some(&TypedCrs::None) } else { self.crs.as_ref() }
    }

    /// Turns the options that were typed into decided settings.
    pub(super) fn config(&self) -> Result<TilesConfig> {
        let default = TilesConfig::new(&self.paths.input, &self.paths.output);
        let transform = match (self.geo, self.transform) {
            (Some(Geo(place)), _) => east_north_up(place),
            (None, Some(TypedTransform(matrix))) => matrix,
            (None, None) => default.transform,
        };
        let mut placing = self.moves.of_tiles(self.up)?;
        let is_y_up = self.up.map(|up| up == Up::Y);
        placing.degrees = match self.typed_crs() {
            Some(TypedCrs::None) => Degrees::Kept,
            Some(TypedCrs::Code(code)) => Degrees::Metres { system: Some(code.clone()), is_y_up },
            None => Degrees::Metres { system: None, is_y_up },
        };
        Ok(TilesConfig {
            tile_triangles: self.tile_triangles,
            finest: self.finest.unwrap_or_default(),
            texture: match self.texture {
                None => TileTexture::Auto,
                Some(TypedLook::Bake) => TileTexture::Bake,
                Some(TypedLook::Colors) => TileTexture::Colors,
            },
            coding: self.textures.map(|typed| match typed {
                TypedCoding::Ktx2 => BasisCoding::Uastc,
                TypedCoding::Etc1s => BasisCoding::Etc1s,
            }),
            pixels: self.pixels,
            packs: self.compress == Compress::Meshopt,
            is_z_up: self.up != Some(Up::Y),
            placing,
            transform,
            viewer: self.viewer,
            memory_bytes: memory_budget(self.memory),
            threads: super::arguments::threads(self.threads),
            job_folder: super::arguments::job_folder(&self.paths.output, self.temp_dir.as_deref())?,
            keep_temp: self.keep_temp,
            force: self.force,
            restart: self.restart,
            skip_bad: self.skip_bad,
            weld: self.weld,
            ..default
        })
    }

    /// Opens the input and plans the run, at the place that was typed or that the mesh names; with a line on that.
    pub(super) fn prepare(
        &self,
        mut config: TilesConfig,
    ) -> Result<(PreparedTiles, TilesConfig, Option<String>)> {
        let typed = self.typed_crs();
        let prepared = prepare_tiles(&config)?;
        let place = take_place(prepared.source.georeference(), typed, &mut config);
        // glTF has y upwards by its standard.
        let is_gltf = prepared.source.file_format() == "glTF";
        config.is_z_up &= self.up.is_some() || !is_gltf;
        config.placing = config.placing.settled(is_gltf);
        Ok((prepared, config, place))
    }
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        let job_folder =
            super::arguments::job_folder(&self.paths.output, self.temp_dir.as_deref())?;
        let paths = self.paths.input.add_to(Paths::new(self.force), "INPUT")?;
        Ok(self
            .receipt
            .add_to(paths, [&self.paths.input, &self.paths.output])?
            .with(Role::OutputFolder, "OUTPUT", &self.paths.output)
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref())
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref())
            .with(Role::JobFolder, "the job folder", job_folder))
    }

    fn offers(&self) -> Offers {
        Offers { resumes: true, temp_dir: true }
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        make(self, session)
    }
}

fn make(args: &Args, session: &mut Session) -> Result<CommandEnd> {
    let progress = session.progress;
    let report_to = args.report.as_deref().map(Seen::new);
    let receipt = args.receipt.begin()?;
    let config = args.config()?;
    super::arguments::warn_of_limit(args.memory, session.log);
    let files = config.input.files();
    let (prepared, config, place) = session.watch_reading(files, || args.prepare(config))?;
    let log = &mut *session.log;
    log.plan(prepared.plan.lines(&config), &prepared.plan);
    progress.expect(prepared.plan.stage_seconds());
    place.into_iter().for_each(|line| log.say(line));
    if args.up.is_none() && !config.is_z_up {
        log.say("up        y, as glTF has it (--up z otherwise)");
    }
    if args.dry_run {
        if let Some(to) = &report_to {
            let report = serde_json::json!({
                "schema_version": crate::system::json_keys::SCHEMA_VERSION,
                "version": env!("CARGO_PKG_VERSION"),
                "is_finished": false, "dry_run": true,
                "input": { "path": config.input }, "output": { "path": config.output },
                "settings": config.settings(), "plan": prepared.plan, "losses": [],
            });
            write_json(to, &report)?;
        }
        return CommandEnd::whole(&prepared.plan);
    }
    let marks = prepared.marks.clone();
    let report = session.watch(|| make_tiles(prepared, &config, progress))?;
    tell(&report, config.coding, session);
    if let Some(to) = &report_to {
        write_json(to, &report)?;
    }
    if let Some(receipt) = &receipt {
        let (output, line) = (args.paths.output.as_path(), session.line);
        let typed = receipt::Typed { output, line, is_program: session.prints };
        let run = TilesRun { config: &config, report: &report, marks };
        session.watch(|| tree_receipt::write(receipt, typed, run, progress))?;
    }
    CommandEnd::of(&report, report.is_short())
}

fn tell(report: &TilesReport, coding: Option<BasisCoding>, session: &mut Session) {
    let (talk, log) = (session.talk, &mut *session.log);
    if log.summary(report) {
        return;
    }
    if talk.verbose {
        report.stages.iter().for_each(|stage| log.say(stage_line(stage)));
    }
    for level in report.levels.iter().rev() {
        log.say(format!(
            "level {:2}  {:>6} tiles  {:>8} triangles  {:>10}  {}",
            level.level,
            level.tiles,
            show_count(level.triangles),
            show_bytes(level.bytes),
            match level.groups {
                0 if level.error_max == 0.0 => "the input".to_owned(),
                _ => format!("at most {} from it", show_outward(level.error_max, 1, 3)),
            }
        ));
    }
    log.say(format!(
        "{}: {} tiles, {} files of JSON, {} in {:.1} s ({} triangles/s), peak {} memory, {} temporary",
        report.output.path,
        report.tiles,
        report.tilesets,
        show_bytes(report.output.bytes),
        report.seconds,
        show_count(report.triangles_per_second as u64),
        show_bytes(report.peak_memory_bytes),
        show_bytes(report.peak_temp_bytes)
    ));
    if let Some(pages) = &report.texture {
        log.say(format!(
            "  textures  {} charts, {} texels of which {} show the surface, {} of {}; {:.4} texels per unit of length on level 0",
            show_count(pages.charts),
            show_count(pages.texels),
            show_count(pages.covered_texels),
            show_bytes(pages.bytes),
            if coding.is_some() { "KTX2" } else { "JPEG or PNG" },
            pages.texels_per_unit
        ));
    }
    for note in report.input.weld.iter().flat_map(|weld| &weld.notes) {
        log.say(format!("  {note}"));
    }
    say_faults(&report.input, log);
    if report.stuck > 0 {
        let groups: u64 = report.levels.iter().map(|level| level.groups).sum();
        log.say_reason(format!(
            "{} of {groups} groups of tiles kept nearly all of their triangles: their coarser levels are larger than they should be",
            report.stuck
        ));
    }
}
