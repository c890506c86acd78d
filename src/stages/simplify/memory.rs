//! The memory of a cell, or of the finish, from loading to what is left of it: for the plan and for the stages.
//!
//! Measured over a statue, chest CT, a noisy volume, an interior, both forms of a split scan and soups of loose
//! triangles (docs/design/out-of-core.md, "Memory of a cell"). Nothing here allocates.

use stonecut_kernel::{self as kernel, Fit};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellStore, CellTally, VertexLayout, load_bytes};

/// Memory of the kernel on a dirty scan beyond `kernel::peak_bytes`, in bytes a triangle.
const DIRT_BYTES: u64 = 8;

/// Memory of a fitted triangle besides its samples, in bytes; and with its relief.
const FITTED_BYTES: u64 = 140;
const FITTED_WITH_RELIEF: u64 = 170;

/// Memory in bytes that a cell takes while it is loaded, simplified and encoded; `share` of its triangles should be
/// left.
pub fn cell_bytes(store: &CellStore, cell: CellId, share: f64) -> u64 {
    // Detailed cells keep more than others.
    let left = (2.0 * share).min(1.0);
    let tally = store.info().cells[cell];
    let is_first = !store.info().has_channels;
    work_bytes(store.rows(cell), tally, left, store.layout())
        + if is_first { 0 } else { later_bytes(store.layout(), tally.triangles) }
        + round_fit_bytes(store.layout(), tally.triangles, share, is_first)
}

/// Memory in bytes that is added after the first round: what a bound knows of the original then.
pub fn later_bytes(layout: &VertexLayout, n_triangles: u64) -> u64 {
    if layout.has_reach { kernel::extremes_bytes(n_triangles) } else { 0 }
}

/// Memory in bytes for loading `rows`, simplifying what of them is not left out, and encoding a share `left` of it.
pub fn work_bytes(rows: CellTally, tally: CellTally, left: f64, layout: &VertexLayout) -> u64 {
    let kept = tally.vertices * kept_bytes(layout);
    let left = CellTally {
        vertices: (tally.vertices as f64 * left) as u64,
        triangles: (tally.triangles as f64 * left) as u64,
    };
    let kernel = kept + kernel_bytes(tally, layout);
    let taking_over = kept + plain_bytes(left, layout);
    load_bytes(rows, layout).max(kernel).max(taking_over).max(result_bytes(left, layout))
        + if layout.has_origins { origin_bytes(layout) * tally.vertices } else { 0 }
}

/// Memory for the origin of a vertex, in bytes: followed by the kernel, then a row.
fn origin_bytes(layout: &VertexLayout) -> u64 {
    4 + 2 * layout.ids.bytes as u64
}

/// Memory in bytes for a result and its encoded form, side by side when it is written or read.
pub fn result_bytes(tally: CellTally, layout: &VertexLayout) -> u64 {
    let triangle = layout.survivor_triangle_bytes() as u64;
    let encoded = tally.vertices * (9 + layout.row_bytes(true)) as u64 + triangle * tally.triangles;
    plain_bytes(tally, layout) + encoded
}

/// Memory in bytes for a result.
fn plain_bytes(tally: CellTally, layout: &VertexLayout) -> u64 {
    let mesh = 24 + 4 * layout.n_channels() as u64;
    let triangle = layout.survivor_triangle_bytes() as u64;
    tally.vertices * (kept_bytes(layout) + mesh) + triangle * tally.triangles
}

/// Bytes that stay with a vertex while the kernel has its mesh: id, mark and record.
fn kept_bytes(layout: &VertexLayout) -> u64 {
    8 + 1 + layout.schema.record_bytes() as u64
}

/// Memory that the fit adds: its samples, and a share for each triangle of the result.
pub fn fit_bytes(fit: Fit, n_triangles: u64, target: u64) -> u64 {
    match kernel::fit_bytes(fit, n_triangles, target) {
        0 => 0,
        samples => samples + FITTED_BYTES * target.min(n_triangles),
    }
}

/// Memory that the fit adds to a cell in a round that should leave a `share` of it: nothing if no relief is kept.
pub fn round_fit_bytes(layout: &VertexLayout, n_triangles: u64, share: f64, is_first: bool) -> u64 {
    if !layout.has_relief {
        return 0;
    }
    // Detailed cells keep more than others.
    let left = (2.0 * share).min(1.0) * n_triangles as f64;
    kernel::round_fit_bytes(n_triangles, is_first) + (FITTED_WITH_RELIEF as f64 * left) as u64
}

/// Memory in bytes that the kernel takes for a mesh, the mesh it is given included.
fn kernel_bytes(tally: CellTally, layout: &VertexLayout) -> u64 {
    let CellTally { vertices, triangles } = tally;
    let n_channels = layout.n_channels();
    let wedges = match layout.codec.has_seams(&layout.schema) {
        true => kernel::wedge_bytes(vertices, triangles, n_channels),
        false => 0,
    };
    kernel::peak_bytes(vertices, triangles, n_channels)
        + DIRT_BYTES * triangles
        + mend_bytes(vertices, triangles)
        + kernel::attribute_bytes(vertices, layout.n_weighted())
        + wedges
        + if layout.has_reach { kernel::bound_bytes(vertices, triangles) } else { 0 }
        + if layout.is_watched { kernel::crossing_bytes(triangles) } else { 0 }
}

/// Memory that mending adds: it grows with the boundaries, of which a mesh has about as many vertices as it has beyond one
/// for two triangles.
///
/// Measured, in bytes for each of these vertices: 535 where the charts of a scan were welded and 0.07 of them come to
/// a triangle, 385 as the same scan is published (0.46), 155 where every second triangle is loose (1.5), 121 where all
/// are (2.5). Few long boundaries cost more a vertex than many short ones.
fn mend_bytes(n_vertices: u64, n_triangles: u64) -> u64 {
    let excess = n_vertices.saturating_sub(n_triangles / 2);
    (560 * excess).min(160 * n_triangles + 60 * excess)
}
