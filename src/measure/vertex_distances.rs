//! Distances of the vertices of a simplified mesh to the original, of any size. For `simplify --error-field`.

use crate::compare::{Request, cut, parts, taken_bytes, usable_bytes};
use crate::load;
use crate::tree::Tree;
use crate::{Parts, distances};
use stonecut_io::ply::raw::{RawFile, Spool};
use stonecut_io::ply::{BLOCK_ROWS, MeshSource};
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;
use stonecut_system::units::{memory_word, show_bytes};

/// Memory that a search takes for each of its points.
const POINT_BYTES: u64 = 300;

/// Measures every vertex: distances in input units, 8 bytes each, in the order of the vertices.
///
/// Memory: the original with its tree, or one cell of it, and the points of a part of the vertices. Errors: those of reading;
/// `NoMemory` where not even one cell fits.
pub fn vertex_distances(request: &Request, progress: &Progress) -> Result<RawFile> {
    let usable = usable_bytes(request);
    let (threads, original) = (request.options.threads, request.original);
    let whole = load::bytes_in_memory(original) + Tree::bytes(original.n_triangles());
    if whole + POINT_BYTES * BLOCK_ROWS <= usable {
        let mesh = load::load(original, threads, progress)?.mesh;
        return to_parts(request, &Parts::in_memory(&mesh, None), usable - whole, progress);
    }
    let cells = cut(original, request, usable, progress)?;
    let target = parts(&cells, original);
    let largest = (0..target.n_parts())
        .map(|part| target.bytes(part) + Tree::bytes(target.n_triangles(part)))
        .max()
        .unwrap_or(0);
    let least = largest + POINT_BYTES * BLOCK_ROWS.min(request.simplified.n_vertices());
    if least > usable {
        return Err(Error::NoMemory(format!(
            "the budget of {} does not hold the largest cell and the vertices whose distance is measured, which need {} in \
             all; give --memory {} or a smaller --cell-triangles",
            show_bytes(request.memory_bytes),
            show_bytes(least + taken_bytes(request)),
            memory_word(least + taken_bytes(request))
        )));
    }
    to_parts(request, &target, usable - largest, progress)
}

/// As many vertices at a time as half of the free memory has points.
fn to_parts(
    request: &Request,
    target: &Parts,
    free_bytes: u64,
    progress: &Progress,
) -> Result<RawFile> {
    let source: &MeshSource = request.simplified;
    let most = (free_bytes / 2 / POINT_BYTES).max(BLOCK_ROWS);
    let mut spool = Spool::new(&request.temp_dir);
    let mut points = Vec::new();
    let mut left = source.n_vertices();
    let settle = |points: &mut Vec<_>, spool: &mut Spool| {
        let memory = request.memory_bytes - taken_bytes(request);
        let found = distances(points, target, request.options.threads, memory, progress)?;
        points.clear();
        spool.write(&found.iter().flat_map(|distance| distance.to_le_bytes()).collect::<Vec<_>>())
    };
    source.each_vertex_block(|block| {
        let schema = source.schema();
        let records = block.records.chunks_exact(schema.record_bytes());
        left -= records.len() as u64;
        points.extend(records.map(|record| schema.position(record)));
        let is_full = points.len() as u64 + BLOCK_ROWS > most;
        if is_full || left == 0 { settle(&mut points, &mut spool) } else { Ok(()) }
    })?;
    spool.finish(source.path())
}
