//! `stonecut info`: what a mesh file holds and, with `--check`, whether it is sound.

use super::answer::CommandEnd;
use super::session::{Command, Session};
use crate::error::{Error, Offers, Result};
use crate::io::ply::{MeshSource, PartReport, ReadOptions};
use crate::io::sidecars::LIES_AT;
use crate::io::{InputPaths, NameUse, OBJECT, StageOptions};
use crate::measure::check::{self, COUNT_BYTES, Checked};
use crate::measure::intersections::{self, SelfIntersections};
use crate::measure::labelled_regions::{LabelledRegions, RegionLimits, regions};
use crate::measure::load;
use crate::measure::tileset::{TilesetCheck, check_tileset, is_tileset};
use crate::mesh::topology_counts::Topology;
use crate::stages::components::{Below, below_list, sizes_in_memory};
use crate::system::json_keys::SCHEMA_VERSION;
use crate::system::losses::{Loss, LossKind};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::terminal::{shown, table as table_of};
use crate::system::units;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Exit code for a tree of tiles that breaks its rules: bad input.
const EXIT_FAULTS: u8 = 4;

/// Shows what a mesh file or a folder of tiles holds, and whether it is sound
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The mesh file; several, a folder of meshes or a list (@list.txt) are looked at as the one mesh that they become. Or
    /// a folder of tiles: then its rules, its files and the gaps between tiles are checked
    #[arg(required = true)]
    file: Vec<PathBuf>,
    /// Reads everything and counts connectivity and faults
    #[arg(long)]
    check: bool,
    /// With --check, also counts pairs of triangles that pass through or lie on each other
    #[arg(long, requires = "check")]
    self_intersections: bool,
    /// Prints JSON
    #[arg(long)]
    json: bool,
    /// Memory for --check; a larger mesh is cut into cells on disk [default: 75 % of the tightest limit]
    #[arg(long, value_name = "SIZE", value_parser = super::arguments::parse_memory)]
    memory: Option<u64>,
    /// Folder for those cells [default: the working folder]
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

/// The JSON of `info`; docs/report.md describes the keys.
#[derive(serde::Serialize)]
struct InfoReport {
    /// `SCHEMA_VERSION`.
    schema_version: u32,
    /// Version of the program.
    version: &'static str,
    /// As given.
    path: PathBuf,
    /// Files that became this mesh, if it was made of several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    inputs: Vec<PartReport>,
    /// Vertices of theirs that became one with another.
    #[serde(skip_serializing_if = "Option::is_none")]
    joined: Option<u64>,
    /// Length of the file.
    bytes: u64,
    /// Encoding, as `Encoding::name` gives it.
    format: &'static str,
    /// Format of the file, as `MeshSource::file_format` gives it.
    file_format: &'static str,
    /// Names of the materials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    materials: Vec<String>,
    /// Names of objects and groups, or of nodes and meshes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    names: Vec<String>,
    /// Names of the images of the materials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    images: Vec<String>,
    /// Width and height of each; null where it cannot be read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    image_pixels: Vec<Option<[u32; 2]>>,
    /// Those of them that are not there or cannot be read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    missing_images: Vec<String>,
    /// Lines on what is odd or was found elsewhere.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
    /// Rows of the element `face`; a polygon of n corners becomes n - 2 triangles.
    faces: u64,
    /// Bits of a coordinate: 32 or 64.
    coordinate_bits: usize,
    /// Properties of vertices besides the position, in the order of the file.
    properties: Vec<String>,
    /// Scalar properties of faces that are carried.
    face_properties: Vec<String>,
    /// Properties of faces that are not.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    dropped_face_properties: Vec<String>,
    /// Vertices by the header; with `--check` counted, in `check`.
    #[serde(skip_serializing_if = "Option::is_none")]
    vertices: Option<u64>,
    /// Triangles likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    triangles: Option<u64>,
    /// Connectivity; only with `--check`.
    #[serde(flatten)]
    check: Option<Topology>,
    /// Triangles without area; only with `--check`.
    #[serde(skip_serializing_if = "Option::is_none")]
    collinear_triangles: Option<u64>,
    /// Pairs of triangles that meet where they should not; only with `--self-intersections`.
    #[serde(flatten)]
    intersections: Option<SelfIntersections>,
    /// Components by size; only with `--check`.
    #[serde(skip_serializing_if = "Option::is_none")]
    component_sizes: Option<SizesReport>,
    /// Regions of faces with labels; only with `--check`.
    #[serde(skip_serializing_if = "Option::is_none")]
    regions: Option<LabelledRegions>,
}

/// Components by size, as `--min-component` counts them: vertices in one place are connected.
#[derive(serde::Serialize)]
struct SizesReport {
    found: u64,
    largest: u64,
    below: Vec<Below>,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        let paths = match self.tileset() {
            Some(folder) => Paths::default().with(Role::InputFolder, "FILE", folder),
            None => self.input().add_to(Paths::default(), "FILE")?,
        };
        Ok(paths.with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref()))
    }

    fn offers(&self) -> Offers {
        Offers { resumes: false, temp_dir: true }
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        if let Some(folder) = self.tileset() {
            return tiles(self, folder, session);
        }
        let (source, report, list) = look(self, session.progress)?;
        let done = CommandEnd::whole(&report)?;
        session.print(&if self.json { json(&report)? } else { table(&source, &report, list) })?;
        Ok(done)
    }
}

impl Args {
    /// The tree of tiles that is looked at, if it is one.
    fn tileset(&self) -> Option<&Path> {
        let [one] = self.file.as_slice() else { return None };
        is_tileset(one).then_some(one.as_path())
    }

    fn input(&self) -> InputPaths {
        InputPaths::from(self.file.clone()).within(self.memory)
    }

    fn temp_dir(&self) -> &Path {
        self.temp_dir.as_deref().unwrap_or(Path::new("."))
    }
}

/// Looks at a folder of tiles. Without `--check` it is read all the same: what it holds is known no sooner.
fn look_at_tiles(args: &Args, folder: &Path, progress: &Progress) -> Result<TilesetCheck> {
    if args.self_intersections {
        let what = "--self-intersections is for mesh files, and FILE is a folder of tiles; name one of its tiles";
        return Err(Error::Usage(what.to_owned()));
    }
    let threads = super::arguments::threads(args.threads).get();
    check_tileset(folder, (super::arguments::memory_budget(args.memory), threads), progress)
}

fn tiles(args: &Args, folder: &Path, session: &mut Session) -> Result<CommandEnd> {
    let found = look_at_tiles(args, folder, session.progress)?;
    let text = if args.json {
        json(&found)?
    } else {
        let rows = [
            ("folder", folder.display().to_string()),
            ("tiles", found.tiles.to_string()),
            ("files of JSON", found.tilesets.to_string()),
            ("levels", found.levels.to_string()),
            ("triangles", found.triangles.to_string()),
            ("of all levels", found.triangles_of_all_levels.to_string()),
            ("groups", found.groups.to_string()),
            ("shared edges", found.shared_edges.to_string()),
            ("boundary edges", found.boundary_edges.to_string()),
            ("gap within a level", found.gap_within.to_string()),
            ("gap across levels", format!("{} steps", found.gap_across_steps)),
            ("faults", found.n_faults.to_string()),
        ];
        let faults = found.faults.iter().map(|fault| format!("  {}\n", shown(fault)));
        table_of(rows) + &faults.collect::<String>()
    };
    session.print(&text)?;
    let code = if found.n_faults > 0 { EXIT_FAULTS } else { 0 };
    Ok(CommandEnd { code, ..CommandEnd::whole(&found)? })
}

fn json(report: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string_pretty(report)
        .map(|json| json + "\n")
        .map_err(|e| Error::Usage(format!("the answer cannot be written as JSON: {e}")))
}

/// Looks at the file; the last part of the answer is a line about sizes of components.
fn look(args: &Args, progress: &Progress) -> Result<(MeshSource, InfoReport, Option<String>)> {
    let threads = super::arguments::threads(args.threads).get();
    // With `--check` all of it is wanted; without, only its counts.
    let stage = super::arguments::staging(args.temp_dir(), args.memory);
    let read = ReadOptions { names: NameUse::Carried, ..stage.read.clone() };
    let stage = StageOptions { only_looks: !args.check, read, ..stage };
    let source = MeshSource::open_staged(args.input(), &stage)?;
    let found = match args.check {
        true => Some(count(args, &source, threads, progress)?),
        false => None,
    };
    let (check, collinear_triangles) =
        found.as_ref().map(|found| (found.topology, found.collinear_triangles)).unzip();
    let (sizes, intersections) =
        found.map_or((None, None), |found| (Some(found.sizes), found.intersections));
    let limits = RegionLimits {
        temp_dir: args.temp_dir(),
        memory_bytes: super::arguments::memory_budget(args.memory),
    };
    let regions = if args.check { regions(&source, limits, progress)? } else { None };
    let list = sizes.as_ref().map(below_list);
    let schema = source.schema();
    let materials = source.materials();
    // Of opening alone, no other loss is one of precision.
    let is_of_place = |loss: &&Loss| loss.kind == LossKind::Precision;
    let report = InfoReport {
        schema_version: SCHEMA_VERSION,
        version: env!("CARGO_PKG_VERSION"),
        path: args.input().to_path_buf(),
        inputs: source.parts().to_vec(),
        joined: source.weld().filter(|_| !source.parts().is_empty()).map(|weld| weld.joined),
        bytes: source.given_bytes(),
        format: source.encoding().name(),
        file_format: source.file_format(),
        materials: materials.map_or_else(Vec::new, |m| m.names()),
        names: source.names(),
        images: materials.map_or_else(Vec::new, |m| m.image_names(false)),
        image_pixels: materials.map_or_else(Vec::new, |m| m.image_pixels()),
        missing_images: materials.map_or_else(Vec::new, |m| m.image_names(true)),
        notes: source
            .georeference()
            .filter(|_| !source.notes().iter().any(|note| note.what.starts_with(LIES_AT)))
            .map(|found| format!("{LIES_AT}{}", found.words()))
            .into_iter()
            .chain(source.notes().iter().map(ToString::to_string))
            .chain(source.losses().entries().iter().filter(is_of_place).map(ToString::to_string))
            .chain(materials.iter().flat_map(|m| m.losses.lines()))
            .collect(),
        faces: source.n_face_rows(),
        coordinate_bits: 8 * schema.coordinate.bytes(),
        properties: schema.properties.iter().map(|p| p.name.clone()).collect(),
        face_properties: source
            .face_properties()
            .into_iter()
            .map(|p| p.name)
            .filter(|name| source.file_format() == "PLY" || name != OBJECT)
            .collect(),
        dropped_face_properties: source.dropped_face_properties(),
        // With `--check` the counts are among the others.
        vertices: check.is_none().then(|| source.n_vertices()),
        triangles: check.is_none().then(|| source.n_triangles()),
        check,
        collinear_triangles,
        intersections,
        component_sizes: sizes.map(|s| SizesReport {
            found: s.found,
            largest: s.largest,
            below: s.below,
        }),
        regions,
    };
    Ok((source, report, list))
}

fn count(args: &Args, source: &MeshSource, threads: usize, progress: &Progress) -> Result<Checked> {
    let has_intersections = args.self_intersections;
    let budget = super::arguments::memory_budget(args.memory);
    let n = source.n_triangles();
    // One after the other, so the larger counts.
    let boxes_bytes = if has_intersections { intersections::bytes(n) } else { 0 };
    let whole = load::bytes_in_memory(source).saturating_add(boxes_bytes.max(COUNT_BYTES * n));
    if whole > budget / 2 || u32::try_from(source.n_vertices()).is_err() {
        let cutting = check::cutting(args.temp_dir(), threads, budget * 3 / 4, has_intersections);
        return check::check(source, cutting, has_intersections, progress);
    }
    let loaded = load::load(source, threads, progress)?;
    let mut found = Checked {
        topology: load::topology_of(&loaded),
        collinear_triangles: loaded.n_degenerate + check::count_flat(&loaded.mesh),
        sizes: sizes_in_memory(&loaded.mesh),
        intersections: None,
    };
    if has_intersections {
        progress.begin("self-intersections", 1, 1, n);
        let intersections = intersections::in_memory(&loaded.mesh, threads, progress)?;
        found.intersections = Some(intersections);
    }
    Ok(found)
}

/// Names of objects that the table shows.
const SHOWN_NAMES: usize = 8;

/// Regions that the table shows.
const SHOWN_REGIONS: usize = 10;

/// Names of missing images that the table shows.
const SHOWN_IMAGES: usize = 5;

/// Sizes of the images with the number of each, in the order in which they come up.
fn pixels(images: &[Option<[u32; 2]>]) -> Option<String> {
    let mut sizes: Vec<([u32; 2], usize)> = Vec::new();
    for size in images.iter().flatten() {
        match sizes.iter_mut().find(|(known, _)| known == size) {
            Some((_, n)) => *n += 1,
            None => sizes.push((*size, 1)),
        }
    }
    let shown = |([width, height], n): &([u32; 2], usize)| match n {
        1 => format!("{width} x {height}"),
        n => format!("{n} of {width} x {height}"),
    };
    let rest = if sizes.len() > SHOWN_IMAGES { ", ..." } else { "" };
    let list: Vec<String> = sizes.iter().take(SHOWN_IMAGES).map(shown).collect();
    (!list.is_empty()).then(|| list.join(", ") + rest)
}

fn table(source: &MeshSource, report: &InfoReport, below: Option<String>) -> String {
    let mut rows = vec![
        ("file", report.path.display().to_string()),
        ("size", units::show_bytes(report.bytes)),
        (
            "format",
            match report.file_format {
                "PLY" => format!("PLY, {}", report.format),
                other => other.to_owned(),
            },
        ),
        ("vertices", source.n_vertices().to_string()),
        ("faces", report.faces.to_string()),
        ("coordinates", format!("{} bits", report.coordinate_bits)),
        ("properties", report.properties.join(" ")),
    ];
    for (name, list) in [
        ("properties of faces", &report.face_properties),
        ("not carried", &report.dropped_face_properties),
    ] {
        if !list.is_empty() {
            rows.push((name, list.join(" ")));
        }
    }
    if !report.materials.is_empty() {
        rows.push(("materials", report.materials.len().to_string()));
    }
    if !report.names.is_empty() {
        let shown = report.names.iter().take(SHOWN_NAMES).map(String::as_str);
        let rest = if report.names.len() > SHOWN_NAMES { ", ..." } else { "" };
        let list = shown.collect::<Vec<_>>().join(", ");
        rows.push(("objects", format!("{}: {}{rest}", report.names.len(), list)));
    }
    if !report.images.is_empty() {
        let (n, missing) = (report.images.len(), &report.missing_images);
        let shown: Vec<&str> = missing.iter().map(String::as_str).take(SHOWN_IMAGES).collect();
        rows.push((
            "images",
            match missing.len() {
                0 => format!("{n}, all there"),
                k if k <= SHOWN_IMAGES => format!("{n}, {k} not there: {}", shown.join(", ")),
                k => format!("{n}, {k} not there: {} ...", shown.join(", ")),
            },
        ));
    }
    if let Some(pixels) = pixels(&report.image_pixels) {
        rows.push(("pixels", pixels));
    }
    if let Some(weld) = source.weld().filter(|_| !report.inputs.is_empty()) {
        rows.insert(1, ("files", report.inputs.len().to_string()));
        rows.extend(weld.notes.iter().map(|note| ("joined", note.clone())));
    }
    rows.extend(report.notes.iter().map(|note| ("note", note.clone())));
    if let Some(n) = report.triangles {
        rows.insert(5, ("triangles", n.to_string()));
    }
    if let Some(t) = &report.check {
        rows.extend([
            ("triangles", t.triangles.to_string()),
            ("components", t.components.to_string()),
            ("Euler characteristic", t.euler_characteristic.to_string()),
            ("boundary edges", t.boundary_edges.to_string()),
            ("non-manifold edges", t.non_manifold_edges.to_string()),
            ("inconsistent edges", t.inconsistent_edges.to_string()),
            ("junction edges", t.junction_edges.to_string()),
            ("junction points", t.junction_points.to_string()),
            ("degenerate triangles", t.degenerate_triangles.to_string()),
            ("duplicate triangles", t.duplicate_triangles.to_string()),
            ("unreferenced vertices", t.unreferenced_vertices.to_string()),
        ]);
    }
    rows.extend(report.collinear_triangles.map(|n| ("without area", n.to_string())));
    if let Some(found) = &report.intersections {
        rows.extend([
            ("self-intersections", format!("{} pairs of triangles", found.self_intersections)),
            ("overlaps among them", found.coplanar_overlaps.to_string()),
            ("triangles in them", found.self_intersecting_triangles.to_string()),
        ]);
    }
    if let (Some(sizes), Some(below)) = (&report.component_sizes, below) {
        rows.extend([
            ("components by place", sizes.found.to_string()),
            ("largest", format!("{} triangles", sizes.largest)),
            ("fewer triangles than", below),
        ]);
    }
    if let Some(found) = &report.regions {
        rows.push(("regions", format!("{} by {}", found.found, found.properties.join(" and "))));
        rows.push(("open edges of theirs", found.open_edges.to_string()));
        let shown = found.largest.iter().take(SHOWN_REGIONS).map(|region| {
            let open = match region.open_edges {
                0 => "closed".to_owned(),
                n => format!("{n} open edges"),
            };
            let (label, triangles) = (region.label, region.triangles);
            ("region", format!("{label}: volume {}, {triangles} triangles, {open}", region.volume))
        });
        rows.extend(shown);
        if found.found > SHOWN_REGIONS as u64 {
            rows.push(("region", "...".to_owned()));
        }
    }
    table_of(rows)
}
