//! Memory of the kernel, as measured; the stages plan with it.

use crate::cost::attribute_lanes;
use crate::cost::attributes::MAX_WEIGHTED;
use crate::fit;
use crate::options::Fit;
use stonecut_mesh::extremes::Extremes;

/// Peak memory of `simplify_mesh` in bytes, the mesh it is given included.
///
/// Measured: 60 to 63 bytes a triangle beyond the input, 70 on dirty scans (docs/results/kernel.md); surfaces with exact planes
/// take 4 more. What
/// mending adds is up to the caller, who knows the input.
pub fn peak_bytes(n_vertices: u64, n_triangles: u64, n_channels: usize) -> u64 {
    102 * n_triangles + n_vertices * (24 + 8 * n_channels as u64)
}

/// Returns the memory that the fit adds to `peak_bytes`: its samples. The rest of its memory takes the place of what
/// the collapses have freed by then.
pub fn fit_bytes(fit: Fit, n_triangles: u64, target: u64) -> u64 {
    if fit.applies(n_triangles, target) { fit::samples::bytes(n_triangles, target) } else { 0 }
}

/// Returns the memory that the samples of a fit add in the first round, or in a later one, whose mesh has relief.
pub fn round_fit_bytes(n_triangles: u64, is_first: bool) -> u64 {
    fit::samples::round_bytes(n_triangles, is_first)
}

/// Returns the memory that a bound adds to `peak_bytes`: its witnesses, the input's triangles, which are around a vertex,
/// what was refused and what was done.
pub fn bound_bytes(n_vertices: u64, n_triangles: u64) -> u64 {
    41 * n_vertices + 50 * n_triangles
}

/// Returns the memory that the points of the original add to `bound_bytes` in rounds after the first: as they are given, and
/// as witnesses.
pub fn extremes_bytes(n_triangles: u64) -> u64 {
    // Beside a point 3 of the 5 bytes a vertex, of which there is about one for two triangles.
    (size_of::<Extremes>() + 40 * Extremes::MOST + 3) as u64 * n_triangles
}

/// Returns the memory that watching for self-intersections adds to `peak_bytes`: the boxes of all triangles.
pub fn crossing_bytes(n_triangles: u64) -> u64 {
    28 * n_triangles
}

/// Returns the memory that a record of all steps, and writing them, adds to `peak_bytes`. Measured: 63 bytes a triangle on the
/// dragon to 1 %.
pub fn history_bytes(n_vertices: u64, n_triangles: u64, n_channels: usize) -> u64 {
    58 * n_triangles + n_vertices * (12 + 8 * n_channels as u64)
}

/// Returns the memory that weighted channels add to `peak_bytes`.
pub fn attribute_bytes(n_vertices: u64, n_weighted: usize) -> u64 {
    match n_weighted {
        0 => 0,
        n => {
            n_vertices
                * 32
                * attribute_lanes::numbers(n.min(MAX_WEIGHTED)).div_ceil(8).max(2) as u64
        }
    }
}

/// Returns the memory that attribute seams add to `peak_bytes`: a wedge for each corner, values for each vertex.
pub fn wedge_bytes(n_vertices: u64, n_triangles: u64, n_channels: usize) -> u64 {
    12 * n_triangles + n_vertices * (9 + 4 * n_channels as u64)
}
