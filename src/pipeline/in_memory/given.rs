//! Arrays of a caller in the same process: read once and checked on the way; and measurements between such meshes.
//!
//! For bindings to other languages, which name the arrays as their callers do.

use crate::error::{Error, Result};
use crate::measure::{self, Options};
use crate::mesh::{Mesh, topology_counts};
use crate::system::progress::Progress;
use serde_json::{Value, json};

/// Copies positions and checks that they are finite and few enough; `name` is that of the argument.
///
/// Errors: `BadInput` with the row; `NoMemory` where the system gives none.
pub fn positions<T: Copy>(
    name: &str,
    rows: impl ExactSizeIterator<Item = [T; 3]>,
    widen: impl Fn(T) -> f64,
) -> Result<Vec<[f64; 3]>> {
    let n = rows.len();
    if n > u32::MAX as usize {
        let what = format!("{n} are too many for one mesh in memory: simplify it as a file");
        return Err(Error::bad_input(name, what));
    }
    let mut out = room(name, n)?;
    for (row, point) in rows.enumerate() {
        let point = point.map(&widen);
        if let Some(axis) = point.iter().position(|x| !x.is_finite()) {
            let (axis, value) = (["x", "y", "z"][axis], point[axis]);
            let what = format!("row {row}: {axis} is {value}; remove the vertex");
            return Err(Error::bad_input(name, what));
        }
        out.push(point);
    }
    Ok(out)
}

/// Copies triangles and checks that every index is below the number of vertices; `widen` makes negative ones huge.
///
/// Errors: as of `positions`.
pub fn triangles<T: Copy + std::fmt::Display>(
    name: &str,
    rows: impl ExactSizeIterator<Item = [T; 3]>,
    n_vertices: usize,
    widen: impl Fn(T) -> u64,
) -> Result<Vec<[u32; 3]>> {
    let mut out = room(name, rows.len())?;
    for (row, given) in rows.enumerate() {
        let triangle = given.map(&widen);
        if let Some(corner) = triangle.iter().position(|&v| v >= n_vertices as u64) {
            let what = format!(
                "row {row}: index {} is not one of the {n_vertices} points (counted from 0)",
                given[corner]
            );
            return Err(Error::bad_input(name, what));
        }
        out.push(triangle.map(|v| v as u32));
    }
    Ok(out)
}

/// An empty list with room for `n` elements.
fn room<T>(name: &str, n: usize) -> Result<Vec<T>> {
    let mut out = Vec::new();
    out.try_reserve_exact(n)
        .map_err(|e| Error::NoMemory(format!("{name}: no room for a copy of its {n} rows: {e}")))?;
    Ok(out)
}

/// Measures how far two meshes in memory deviate; the report has the keys of `measure`.
pub fn measure(meshes: [&Mesh; 2], options: &Options, progress: &Progress) -> Result<Value> {
    progress.begin("measure", 1, 1, meshes[0].triangles.len() as u64);
    refuse_flat(meshes)?;
    let deviation = measure::two_sided(meshes[0], meshes[1], options, progress)?;
    let mut report = serde_json::to_value(&deviation)
        .map_err(|e| Error::Internal(format!("the report cannot be written as JSON: {e}")))?;
    for (name, mesh) in ["original", "simplified"].into_iter().zip(meshes) {
        let topology = topology_counts::of_triangles(mesh.positions.len(), &mesh.triangles);
        let (vertices, triangles) = (topology.vertices, topology.triangles);
        report[name] =
            json!({ "vertices": vertices, "triangles": triangles, "topology": topology });
    }
    report["seed"] = options.seed.into();
    Ok(report)
}

/// Refuses surfaces without area, as the command does: there is nothing to take a mean over.
fn refuse_flat(meshes: [&Mesh; 2]) -> Result<()> {
    let named = ["original", "simplified"].into_iter().zip(meshes);
    let flat = named.zip(measure::are_flat(meshes)).find(|(_, is_flat)| *is_flat);
    let Some(((name, mesh), _)) = flat else { return Ok(()) };
    let what = format!(
        "its {} triangles have no area, so no mean deviation exists: every one of them is a point or a line; \
         check points and faces",
        mesh.triangles.len()
    );
    Err(Error::bad_input(name, what))
}
