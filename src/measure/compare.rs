//! The program behind `stonecut measure`: two mesh files, and how far they are apart.
//!
//! Meshes that fit into the memory budget are read and measured there. A larger original, and if need be
//! the simplified mesh too, is first cut into cells by the partition stage; the numbers are the same.

use crate::appearance::Appearance;
use crate::deviation::Deviation;
use crate::heatmap;
use crate::load;
use crate::temp_store::{Cutting, Scratch};
use crate::tree::Tree;
use crate::{
    self as measure, Carried, Certificate, Measured, Options, Parts, Region, TriangleSizes, Unit,
    Verdict,
};
use std::path::PathBuf;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::topology_counts::Topology;
use stonecut_stages::partition;
use stonecut_store::cells::{CellTally, VertexLayout, load_bytes, plan_cells};
use stonecut_store::config::DEFAULT_CELL_TRIANGLES;
use stonecut_system::error::{Error, Result};
use stonecut_system::json_keys::SCHEMA_VERSION;
use stonecut_system::losses::Ledger;
use stonecut_system::memory::BASE_BYTES;
use stonecut_system::pending_file::Seen;
use stonecut_system::progress::Progress;
use stonecut_system::units::{memory_word, show_bytes, show_length};

/// Two meshes to be compared, and the means.
#[derive(Debug)]
pub struct Request<'a> {
    /// The original.
    pub original: &'a MeshSource,
    /// The simplified mesh.
    pub simplified: &'a MeshSource,
    /// Options of the measurement. Colours are found by themselves.
    pub options: Options,
    /// Memory budget, everything included.
    pub memory_bytes: u64,
    /// Triangles per cell where cells are needed.
    pub cell_triangles: u64,
    /// The folder in which cells are kept for the time being, if they are needed.
    pub temp_dir: PathBuf,
    /// Also measure the distance of every vertex of the simplified mesh to the original.
    pub heat: bool,
}

/// The outcome.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// Deviation and connectivity.
    pub measured: Measured,
    /// Cells that the original was cut into; 0 if it was measured in memory.
    pub cells: u64,
    /// Peak bytes of temporary files.
    pub temp_bytes: u64,
    /// Distance of every vertex of the simplified mesh to the original in input units, if asked for.
    pub heat: Vec<f64>,
}

/// Size and connectivity of one of the two files.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FileReport {
    /// As given.
    pub path: PathBuf,
    /// Length of the file.
    pub bytes: u64,
    /// All vertices, used or not.
    pub vertices: u64,
    /// All triangles, degenerate ones included.
    pub triangles: u64,
    /// Connectivity.
    pub topology: Topology,
}

/// The JSON of `measure --report` and of `simplify --verify`; the keys are a contract, described in docs/report.md.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Report {
    /// `SCHEMA_VERSION`.
    pub schema_version: u32,
    /// Version of the program.
    pub version: &'static str,
    /// The first file.
    pub original: FileReport,
    /// The second file.
    pub simplified: FileReport,
    /// Distances both ways; its keys stand beside those of the report.
    #[serde(flatten)]
    pub deviation: Deviation,
    /// The Hausdorff distance enclosed; only with `--certify` and `simplify --verify`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hausdorff: Option<Certificate>,
    /// Likeness of pictures; only with `--appearance`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub appearance: Option<Appearance>,
    /// Areas of triangles near and far from the points of `--near`; only with that option.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub triangle_sizes: Option<TriangleSizes>,
    /// Seed of the samples; the same seed gives the same numbers.
    pub seed: u64,
    /// Cells that the original was cut into; 0 if it was measured in memory.
    pub cells: u64,
    /// Wall time.
    pub seconds: f64,
    /// Peak resident memory of the process, in bytes.
    pub peak_memory_bytes: u64,
    /// Most bytes that temporary files had at one time.
    pub peak_temp_bytes: u64,
    /// Looks that pictures are without; only with `--appearance`.
    pub losses: Ledger,
}

impl Report {
    /// The report of a comparison that took `seconds`.
    pub fn new(request: &Request, comparison: &Comparison, seconds: f64) -> Report {
        let file = |source: &MeshSource, topology: Topology| FileReport {
            path: source.path().to_path_buf(),
            bytes: source.file_bytes(),
            vertices: topology.vertices,
            triangles: topology.triangles,
            topology,
        };
        let measured = &comparison.measured;
        Report {
            schema_version: SCHEMA_VERSION,
            version: env!("CARGO_PKG_VERSION"),
            original: file(request.original, measured.original),
            simplified: file(request.simplified, measured.simplified),
            deviation: measured.deviation.clone(),
            hausdorff: measured.certificate.clone(),
            appearance: None,
            triangle_sizes: None,
            seed: request.options.seed,
            cells: comparison.cells,
            seconds,
            peak_memory_bytes: stonecut_system::memory::peak_bytes(),
            peak_temp_bytes: comparison.temp_bytes,
            losses: Ledger::default(),
        }
    }
}

/// The default cell size.
pub const CELL_TRIANGLES: u64 = DEFAULT_CELL_TRIANGLES;

/// Bytes of the budget that are taken before a mesh is read: those of the program and of the region.
pub(crate) fn taken_bytes(request: &Request) -> u64 {
    BASE_BYTES + request.options.region.as_ref().map_or(0, Region::bytes)
}

/// Bytes of the budget that are left for meshes.
pub(crate) fn usable_bytes(request: &Request) -> u64 {
    request.memory_bytes.saturating_sub(taken_bytes(request))
}

pub(crate) fn whole_bytes(request: &Request) -> u64 {
    let has_region = request.options.region.is_some();
    let sources = [request.original, request.simplified];
    // A certificate takes the trees over both at once.
    let n = sources.map(MeshSource::n_triangles);
    let second = if request.options.certify.is_some() { Tree::bytes(n[0].min(n[1])) } else { 0 };
    bytes_as_whole(sources, request.options.samples, has_region) + second
}

/// Memory that comparing two meshes as a whole takes, beside what is taken already.
fn bytes_as_whole(sources: [&MeshSource; 2], samples: u64, has_region: bool) -> u64 {
    let meshes = sources.map(load::bytes_in_memory);
    let largest = sources[0].n_triangles().max(sources[1].n_triangles());
    // With a region, distances are kept by their side of it as well.
    let value_bytes = if has_region { 32 } else { 24 };
    meshes[0] + meshes[1] + Tree::bytes(largest).max(60 * largest) + value_bytes * samples
}

/// Refuses a region around the vertices of `places` that does not fit beside what is measured, with a size that is enough.
pub fn hold_region(
    sources: [&MeshSource; 2],
    (places, samples): (&MeshSource, u64),
    memory_bytes: u64,
) -> Result<()> {
    let beside = Region::beside_bytes(sources[1].n_vertices());
    let region = Region::needed_bytes(places.n_vertices());
    if BASE_BYTES + region + beside <= memory_bytes {
        return Ok(());
    }
    let whole = bytes_as_whole(sources, samples, true);
    Err(Error::NoMemory(format!(
        "the budget of {} does not hold the {} vertices of {} (--near) beside those of {}, which need {} in all; give \
         --memory {}, or a mesh of fewer vertices to --near",
        show_bytes(memory_bytes),
        places.n_vertices(),
        places.path().display(),
        sources[1].path().display(),
        show_bytes(BASE_BYTES + region + beside),
        memory_word(BASE_BYTES + region + beside.max(whole))
    )))
}

/// A size for `--memory` with which nothing of this request is refused, `needed` being what was refused just now: enough for
/// both meshes as a whole or, where that is less, for the largest of their cells, twice over.
fn enough(request: &Request, needed: u64) -> String {
    let in_cells = |source: &MeshSource| {
        let n = request.cell_triangles.min(source.n_triangles());
        let layout = VertexLayout::new(source.schema(), source.n_vertices());
        let tally = CellTally { triangles: n, vertices: n };
        3 * (load_bytes(tally, &layout) + Tree::bytes(n))
    };
    let in_cells = in_cells(request.original).max(in_cells(request.simplified))
        + 24 * request.options.samples
        + 2 * needed;
    let most = whole_bytes(request).min(in_cells).max(needed);
    memory_word(most + taken_bytes(request))
}

/// Memory of the simplified mesh as a whole.
pub(crate) fn simplified_bytes(request: &Request) -> u64 {
    load::bytes_in_memory(request.simplified) + Tree::bytes(request.simplified.n_triangles())
}

/// Compares two meshes within the memory budget, from which the region of the options is taken, too.
///
/// Errors: those of reading; `NoMemory` where not even one cell fits the budget.
pub fn compare(request: &Request, progress: &Progress) -> Result<Comparison> {
    if whole_bytes(request) <= usable_bytes(request) {
        let comparison = in_memory(request, progress)?;
        refuse_flat(request, &comparison)?;
        return Ok(comparison);
    }
    compare_in_cells(request, progress)
}

/// Finds out if two meshes are within `bound` (input units) of each other, both ways, without sampling: stops as soon
/// as that is certain.
///
/// Memory and errors: those of `compare`.
pub fn within(request: &Request, bound: f64, progress: &Progress) -> Result<Verdict> {
    let usable = usable_bytes(request);
    let threads = request.options.threads;
    let meshes = [request.original, request.simplified].map(load::bytes_in_memory);
    let largest = request.original.n_triangles().max(request.simplified.n_triangles());
    let load = |source: &MeshSource| load::load(source, threads, progress).map(|mesh| mesh.mesh);
    let second_bytes = simplified_bytes(request);
    progress.begin("measure", 1, 3, largest);
    if meshes[0] + meshes[1] + Tree::bytes(largest) <= usable {
        let both = [load(request.original)?, load(request.simplified)?];
        let [first, second] = both.each_ref().map(|mesh| Parts::in_memory(mesh, None));
        return measure::within(&first, &second, bound, (threads, usable), progress);
    }
    let original = cut(request.original, request, usable, progress)?;
    let first = parts(&original, request.original);
    if second_bytes <= usable / 3 {
        let simplified = load(request.simplified)?;
        let second = Parts::in_memory(&simplified, None);
        let left = usable - second_bytes;
        return measure::within(&first, &second, bound, (threads, left), progress);
    }
    let simplified = cut(request.simplified, request, usable, progress)?;
    let second = parts(&simplified, request.simplified);
    measure::within(&first, &second, bound, (threads, usable), progress)
}

/// Refuses surfaces without area: there is nothing to take a mean over.
fn refuse_flat(request: &Request, comparison: &Comparison) -> Result<()> {
    let sources = [request.original, request.simplified];
    let flat = sources.iter().zip(comparison.measured.is_flat).find(|(_, is_flat)| *is_flat);
    let Some((source, _)) = flat else { return Ok(()) };
    let what = format!(
        "its {} triangles have no area, so no mean deviation exists: every one of them is a point or a line; \
         check the file with 'stonecut info --check'",
        source.n_triangles()
    );
    Err(Error::bad_input(source.path(), what))
}

/// The options with what the two files say about colours.
fn options(request: &Request) -> Options {
    let colours = Carried::of(request.original.schema())
        .zip(Carried::of(request.simplified.schema()))
        .map(|(a, b)| [a, b]);
    Options { colours, ..request.options.clone() }
}

/// Compares two meshes by way of cells, even if they would fit into memory; the numbers are the same.
pub fn compare_in_cells(request: &Request, progress: &Progress) -> Result<Comparison> {
    let usable = usable_bytes(request);
    let original = cut(request.original, request, usable, progress)?;
    let comparison = with_original(request, &original, options(request), usable, progress)?;
    refuse_flat(request, &comparison)?;
    Ok(comparison)
}

fn in_memory(request: &Request, progress: &Progress) -> Result<Comparison> {
    let options = options(request);
    let n_triangles = [request.original, request.simplified].map(MeshSource::n_triangles);
    progress.begin("load", 1, 2, n_triangles.iter().sum());
    let load = |source: &MeshSource, n: u64| {
        let loaded = load::load(source, options.threads, progress)?;
        progress.add(n);
        Ok::<_, Error>(loaded)
    };
    let mut original = load(request.original, n_triangles[0])?;
    let mut simplified = load(request.simplified, n_triangles[1])?;
    progress.begin("measure", 2, 2, n_triangles[0]);
    let threads = options.threads;
    let bounds = [&original, &simplified].map(|loaded| Bounds::of(&loaded.mesh));
    say_apart(&bounds, progress);
    let unit = Unit::around(&bounds[0].joined(&bounds[1]));
    for loaded in [&mut original, &mut simplified] {
        unit.turn(&mut loaded.mesh);
    }
    let options =
        Options { region: options.region.as_ref().map(|region| region.in_unit(unit)), ..options };
    let options =
        Options { certify: options.certify.map(|certify| certify.in_unit(unit)), ..options };
    let meshes = [&original.mesh, &simplified.mesh];
    let (deviation, certificate) = measure::measured_and_enclosed(meshes, &options, progress)?;
    let certificate = certificate.map(|certificate| certificate.back(unit));
    let heat = if request.heat {
        let other = Parts::in_memory(&original.mesh, None);
        let points = &simplified.mesh.positions;
        let distances = measure::distances(points, &other, threads, u64::MAX, progress)?;
        distances.into_iter().map(|distance| unit.back(distance)).collect()
    } else {
        Vec::new()
    };
    let deviation = unit.deviation(deviation);
    let mut measured = Measured { deviation, certificate, ..Measured::default() };
    if !options.distances_only {
        measured.is_flat = measure::are_flat(meshes);
        measured.original = load::topology_of(&original);
        measured.simplified = load::topology_of(&simplified);
    }
    Ok(Comparison { measured, heat, ..Comparison::default() })
}

/// Says that two meshes lie farther apart than they are across: their nearest places take long to find, and mean little.
fn say_apart([a, b]: &[Bounds; 2], progress: &Progress) {
    let (gap, across) = (a.gap_sq(b).sqrt(), a.diagonal().max(b.diagonal()));
    if gap > across {
        progress.note(format!(
            "the meshes lie {} apart and are {} across at most: is one of them without its offset, or in other units?",
            show_length(gap),
            show_length(across)
        ));
    }
}

/// The original is in cells; the simplified mesh is read whole if a third of the memory holds it.
fn with_original(
    request: &Request,
    original: &Scratch,
    options: Options,
    usable: u64,
    progress: &Progress,
) -> Result<Comparison> {
    let first = parts(original, request.original);
    let temp_bytes = original.store().info().pack_bytes();
    let degenerate = original.partition().degenerate_faces;
    let whole = simplified_bytes(request);
    if whole <= usable / 3 {
        let simplified = load::load(request.simplified, options.threads, progress)?;
        let second = Parts::in_memory(&simplified.mesh, simplified.colours);
        let mut comparison = run(request, &first, &second, &options, usable - whole, progress)?;
        add_degenerate(&mut comparison, degenerate, simplified.n_degenerate);
        if request.heat {
            let (points, memory) = (&simplified.mesh.positions, usable - whole);
            comparison.heat =
                measure::distances(points, &first, options.threads, memory, progress)?;
        }
        comparison.temp_bytes = temp_bytes;
        return Ok(comparison);
    }
    if request.heat {
        return Err(Error::NoMemory(format!(
            "the simplified mesh needs {} to be coloured; give --memory {}, or measure without --heatmap",
            show_bytes(3 * whole),
            enough(request, 3 * whole)
        )));
    }
    let cells = cut(request.simplified, request, usable, progress)?;
    let second = parts(&cells, request.simplified);
    let mut comparison = run(request, &first, &second, &options, usable, progress)?;
    add_degenerate(&mut comparison, degenerate, cells.partition().degenerate_faces);
    comparison.temp_bytes = temp_bytes + cells.store().info().pack_bytes();
    Ok(comparison)
}

fn run(
    request: &Request,
    original: &Parts,
    simplified: &Parts,
    options: &Options,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<Comparison> {
    // Every cell is loaded for the survey, for its samples and for its tree; the first two are counted.
    progress.begin("measure", 2, 2, 2 * request.original.n_triangles());
    let largest = (0..original.n_parts())
        .map(|part| original.bytes(part) + Tree::bytes(original.n_triangles(part)))
        .max()
        .unwrap_or(0);
    if largest > memory_bytes {
        return Err(Error::NoMemory(format!(
            "the budget of {} does not hold the largest cell, which needs {} in all; give --memory {} or a smaller --cell-triangles",
            show_bytes(request.memory_bytes),
            show_bytes(largest + taken_bytes(request)),
            enough(request, largest)
        )));
    }
    let values = 2 * 8 * options.samples;
    if values > memory_bytes {
        return Err(Error::NoMemory(format!(
            "{} samples a side need {}; give --memory {} or fewer --samples",
            options.samples,
            show_bytes(values),
            enough(request, values)
        )));
    }
    let measured = measure::two_sided_parts(original, simplified, options, memory_bytes, progress)?;
    Ok(Comparison { measured, cells: original.n_parts() as u64, ..Comparison::default() })
}

/// Writes the original, of any size, coloured by its distance to the simplified mesh, which must fit.
pub fn heatmap_of_original(request: &Request, to: &Seen, progress: &Progress) -> Result<()> {
    let usable = usable_bytes(request);
    let needed = simplified_bytes(request);
    if needed > usable {
        return Err(Error::NoMemory(format!(
            "the simplified mesh needs {} to colour the original by; give --memory {}",
            show_bytes(needed + taken_bytes(request)),
            enough(request, needed)
        )));
    }
    let threads = request.options.threads;
    let mut mesh = load::load(request.simplified, threads, progress)?.mesh;
    let unit = Unit::around(&Bounds::of(&mesh));
    unit.turn(&mut mesh);
    let tree = Tree::build_until(mesh.triangles.len(), |i| mesh.corners(i), progress)?;
    drop(mesh);
    let places = (to, request.temp_dir.as_path());
    heatmap::write_streamed(request.original, (&tree, unit), places, threads, progress)
}

/// Partitioning leaves out faces with repeated corners; they count as triangles all the same.
fn add_degenerate(comparison: &mut Comparison, original: u64, simplified: u64) {
    let measured = &mut comparison.measured;
    for (topology, n) in
        [(&mut measured.original, original), (&mut measured.simplified, simplified)]
    {
        topology.triangles += n;
        topology.degenerate_triangles += n;
    }
}

pub(crate) fn cut(
    source: &MeshSource,
    request: &Request,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<Scratch> {
    let (cell_triangles, threads) = (request.cell_triangles, request.options.threads);
    let n_cells = plan_cells(source.n_triangles(), cell_triangles);
    let n_vertices = source.n_vertices();
    let layout = VertexLayout::new(source.schema(), n_vertices);
    let store_bytes = partition::store_bytes(n_vertices, source.n_triangles(), &layout);
    let sizes = partition::Sizes { n_vertices, n_cells, store_bytes, layout: &layout };
    let needed = partition::Shares::new(sizes, threads, memory_bytes).least_bytes;
    if needed > memory_bytes {
        return Err(Error::NoMemory(format!(
            "cutting {} into cells needs {}; give --memory {}",
            source.path().display(),
            show_bytes(needed + taken_bytes(request)),
            enough(request, needed)
        )));
    }
    progress.begin("partition", 1, 2, source.n_triangles());
    let temp_dir = &request.temp_dir;
    let cutting = Cutting { cell_triangles, temp_dir, threads, memory_bytes, disk: None };
    Scratch::cut(source, cutting, progress)
}

pub(crate) fn parts<'a>(cells: &'a Scratch, source: &MeshSource) -> Parts<'a> {
    Parts::in_cells(cells.store(), source.n_vertices(), cells.partition().bounds)
}
