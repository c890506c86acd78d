//! The program of `extract`: a mesh from a tree of tiles, as fine as is asked for, finer in a box.
//!
//! A cut through the groups of the tree is one mesh without gaps; a number of triangles is met from the smallest cut that has
//! as many, by the kernel. Everything happens in memory: a cut that does not fit is refused before a tile is read.
//!
//! docs/design/tiles.md, "Extract".

mod tree;
mod weld;

use crate::error::{Error, Result};
use crate::io::ply::OutputHeader;
use crate::io::sidecars::lost_axes;
use crate::io::{MeshSink, OutputFormat, OutputKind};
use crate::kernel::{self, Fit, Options, Stop};
use crate::mesh::bounds::Bounds;
use crate::mesh::property::{Property, Scalar};
use crate::mesh::record::VertexSchema;
use crate::system::losses::{Ledger, Loss, LossKind};
use crate::system::memory::BASE_BYTES;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
use crate::system::units::{memory_word, show_bytes, show_count};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use tree::{Allowed, Tree, TreeCut};
use weld::{COLOURS, JoinedTiles, Rows, VERTICES_PER_TRIANGLE};

/// Fineness of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// The largest distance from the input, in its units.
    MaxError(f64),
    /// Number of triangles.
    Triangles(u64),
}

/// A run of `extract`.
#[derive(Clone, Debug)]
pub struct ExtractConfig {
    /// The folder of the tree.
    pub tiles: PathBuf,
    /// The mesh.
    pub output: PathBuf,
    /// Its format.
    pub format: OutputFormat,
    /// Fineness, outside of the box if there is one.
    pub wanted: Wanted,
    /// A box, its lower and its upper corner, and the largest distance from the input in it; in units of the input.
    pub inside: Option<([[f64; 3]; 2], f64)>,
    /// Memory budget in bytes.
    pub memory_bytes: u64,
    /// Worker threads.
    pub threads: NonZeroUsize,
}

/// Outcome of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Extracted {
    /// Vertices of the mesh.
    pub vertices: u64,
    /// Its triangles.
    pub triangles: u64,
    /// Tiles that it was made of.
    pub tiles: u64,
    /// Triangles that they had together.
    pub cut_triangles: u64,
    /// The largest distance of the tiles from the input, at most, in input units.
    pub deviation: f64,
    /// True if the number of triangles was met, or none was asked for.
    pub reached: bool,
    /// True if the finest tiles of the tree are farther from the input than was asked for.
    pub is_coarser: bool,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Vertices that are written at a time.
const BLOCK: usize = 65_536;

/// Extracts a mesh.
///
/// Memory: 70 bytes a triangle of the cut, 130 where a number of triangles is to be met; properties of vertices add to
/// that. Errors: `BadInput` for what is not
/// a tree of this program, `NoMemory` if the cut does not fit into the budget, `Usage` for a box without a tile.
pub fn extract(config: &ExtractConfig, progress: &Progress) -> Result<Extracted> {
    guarded(|| run(config, progress))
}

fn run(config: &ExtractConfig, progress: &Progress) -> Result<Extracted> {
    let tree = Tree::read(&config.tiles)?;
    let inside = config.inside.map(|([low, high], most)| {
        let local = |p: [f64; 3]| [0, 1, 2].map(|k| p[k] - tree.origin[k]);
        (Bounds { low: local(low), high: local(high) }, most)
    });
    if let (Some((bounds, _)), Some((corners, _))) = (&inside, config.inside) {
        tree.require_touched(bounds, corners).map_err(Error::Usage)?;
    }
    let (cut, target) = choose(&tree, config.wanted, inside)?;
    if cut.tiles.is_empty() {
        return Err(Error::bad_input(&config.tiles, "has no tile with triangles"));
    }
    let rows = Rows::new(&tree.scalars);
    check_memory(config, (&tree, &rows), (&cut, target), inside)?;
    progress.begin("extract", 1, 1 + u32::from(target.is_some()), cut.triangles);
    let memory_bytes = config.memory_bytes.saturating_sub(BASE_BYTES);
    let threads = config.threads.get();
    let mut joined =
        weld::join(&config.tiles, (&tree, &cut), &rows, threads, memory_bytes, progress)?;
    let mut reached = true;
    if let Some(target) = target {
        progress.begin("finish", 2, 2, joined.mesh.triangles.len() as u64);
        progress.check()?;
        let fine = config.inside.map(|(corners, _)| corners);
        (joined, reached) = finish(joined, &rows, target, fine);
    }
    progress.check()?;
    let (bytes, losses) = write(config, &joined, &rows, &tree)?;
    progress.lose_all(&losses);
    if tree.has_normals {
        let loss = Loss::new(LossKind::Normals, "normals", "not carried from tiles").notice();
        progress.lose(loss.remedy("programs compute them from the surface"));
    }
    Ok(Extracted {
        vertices: joined.mesh.positions.len() as u64,
        triangles: joined.mesh.triangles.len() as u64,
        tiles: cut.tiles.len() as u64,
        cut_triangles: cut.triangles,
        deviation: cut.deviation,
        reached,
        is_coarser: matches!(config.wanted, Wanted::MaxError(_)) && cut.is_coarser,
        bytes,
    })
}

/// The cut, and the number of triangles that it is brought down to.
fn choose(
    tree: &Tree,
    wanted: Wanted,
    inside: Option<(Bounds, f64)>,
) -> Result<(TreeCut, Option<u64>)> {
    let n = match wanted {
        Wanted::MaxError(outside) => return Ok((tree.cut(&Allowed { outside, inside }), None)),
        Wanted::Triangles(n) => n,
    };
    // Of the distances that groups have, the largest that leaves enough triangles; all finest tiles if none does.
    let distances = tree.deviations();
    let with = |outside: f64| tree.cut(&Allowed { outside, inside });
    let coarsest = with(f64::INFINITY);
    let too_few = distances.partition_point(|&outside| with(outside).triangles < n);
    let cut = match distances.get(too_few) {
        _ if coarsest.triangles >= n => coarsest,
        Some(&outside) => with(outside),
        None => with(-1.0),
    };
    let target = (cut.triangles > n).then_some(n);
    Ok((cut, target))
}

/// Refuses a cut that does not fit, and names the fineness that does.
fn check_memory(
    config: &ExtractConfig,
    (tree, rows): (&Tree, &Rows),
    (cut, target): (&TreeCut, Option<u64>),
    inside: Option<(Bounds, f64)>,
) -> Result<()> {
    let needed = |triangles: u64| {
        let vertices = (triangles as f64 * VERTICES_PER_TRIANGLE) as u64;
        let joined = weld::join_bytes(vertices, triangles, rows);
        let kernel = kernel::peak_bytes(vertices, triangles, COLOURS + rows.codec.n_channels())
            + 2 * vertices * rows.row_bytes() as u64;
        BASE_BYTES + if target.is_some() { joined.max(kernel) } else { joined }
    };
    let bytes = needed(cut.triangles);
    if bytes <= config.memory_bytes && cut.triangles <= kernel::MAX_TRIANGLES {
        return Ok(());
    }
    let with = |outside: f64| tree.cut(&Allowed { outside, inside }).triangles;
    let fits = |outside: &&f64| needed(with(**outside)) <= config.memory_bytes;
    let distances = tree.deviations();
    let advice = match distances.iter().rev().find(fits) {
        Some(outside) => format!(
            "; --max-error {outside:.4} gives {} triangles, which fit",
            show_count(with(*outside))
        ),
        None => String::new(),
    };
    Err(Error::NoMemory(format!(
        "a cut of {} triangles needs {} of memory, the budget is {}; give --memory {}{advice}",
        show_count(cut.triangles),
        show_bytes(bytes),
        show_bytes(config.memory_bytes),
        memory_word(bytes),
    )))
}

/// Meets a number of triangles; what lies in the box stays. True if it was met.
fn finish(
    joined: JoinedTiles,
    rows: &Rows,
    target: u64,
    inside: Option<[[f64; 3]; 2]>,
) -> (JoinedTiles, bool) {
    let JoinedTiles { mesh, has_colours, mut records } = joined;
    let is_inside = |p: &[f64; 3]| {
        inside.is_some_and(|[low, high]| (0..3).all(|k| low[k] <= p[k] && p[k] <= high[k]))
    };
    let locked: Vec<bool> = mesh.positions.iter().map(is_inside).collect();
    let options = Options { stop: Stop::Triangles(target), fit: Fit::Off, ..Options::default() };
    let done = kernel::simplify_mesh(mesh, &locked, &options);
    let reached = done.statistics.reached || done.mesh.triangles.len() as u64 <= target;
    let n = rows.row_bytes();
    if n > 0 {
        let row = |v: u32| v as usize * n..(v as usize + 1) * n;
        let made = (0..).zip(&done.source).map(|(to, &from)| (to, from, done.models.of(from)));
        let made = made.filter(|(_, from, like)| from != like);
        let made: Vec<(u32, Vec<u8>)> =
            made.map(|(to, _, like)| (to, records[row(like)].to_vec())).collect();
        // In ascending order, so that a row is read before another is written over it.
        for (to, &from) in done.source.iter().enumerate() {
            records.copy_within(row(from), to * n);
        }
        made.iter().for_each(|(to, values)| records[row(*to)].copy_from_slice(values));
        records.truncate(done.source.len() * n);
    }
    (JoinedTiles { mesh: done.mesh, has_colours, records }, reached)
}

/// Writes the mesh; returns the bytes of the file, and what it has no place for.
fn write(
    config: &ExtractConfig,
    joined: &JoinedTiles,
    rows: &Rows,
    tree: &Tree,
) -> Result<(u64, Ledger)> {
    let JoinedTiles { mesh, has_colours, records: old } = joined;
    let largest = mesh.positions.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs()));
    // Floats where they hold half a step of the lattice.
    let fits = largest * f64::from(f32::EPSILON) <= tree.step;
    let mut properties = Vec::new();
    if *has_colours {
        properties = ["red", "green", "blue"].map(|name| Property::new(name, Scalar::U8)).to_vec();
    }
    let n_colours = properties.len();
    properties.extend(rows.schema.properties.iter().cloned());
    let coordinate = if fits { Scalar::F32 } else { Scalar::F64 };
    let schema = VertexSchema { coordinate, properties };
    let (n_vertices, n_faces) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let mut header = OutputHeader::new(schema.clone(), n_vertices, n_faces);
    header.settings = "extract".to_owned();
    header.comments.clone_from(&tree.comments);
    let mut sink = MeshSink::create(config.output.as_path(), header, config.format)?;
    let (mut records, mut row) = (Vec::new(), Vec::new());
    let (unused, n) = (rows.schema.position_bytes(), rows.row_bytes());
    for first in (0..mesh.positions.len()).step_by(BLOCK) {
        records.clear();
        for v in first..(first + BLOCK).min(mesh.positions.len()) {
            schema.encode_position(mesh.positions[v], &mut records);
            let (colours, others) = mesh.channels_of(v as u32).split_at(n_colours);
            records.extend(colours.iter().map(|&x| stored(x)));
            if n > 0 {
                row.clear();
                rows.codec.encode([0.0; 3], others, &old[v * n..(v + 1) * n], &mut row);
                records.extend_from_slice(&row[unused..]);
            }
        }
        sink.write_vertices(&records)?;
    }
    sink.write_faces_u32(&mesh.triangles)?;
    let mut losses = sink.losses();
    let is_glb = config.format.kind_of(&config.output) == OutputKind::Glb;
    let lost = lost_axes(&tree.comments, tree.is_y_up, is_glb);
    lost.into_iter().for_each(|loss| losses.lose(loss));
    Ok((sink.finish()?, losses))
}

/// A colour component of linear light as one of sRGB (IEC 61966-2-1).
fn stored(linear: f32) -> u8 {
    let x = f64::from(linear).clamp(0.0, 1.0);
    let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (y * 255.0).round() as u8
}
