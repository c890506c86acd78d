//! How good a result is: `stonecut measure`, and the triangles that face against the original.

use crate::peers::Places;
use crate::record::Quality;
use crate::{Outcome, meshes};
use serde::Deserialize;
use std::path::Path;
use std::process::Command;
use stonecut::measure::tree::{Nearest, Tree};
use stonecut::measure::triangle::area_normal;
use stonecut::mesh::topology_counts::Topology;

/// Originals with more triangles are not asked for facing: the tree takes 150 bytes a triangle.
const MAX_FACING_TRIANGLES: u64 = 20_000_000;

/// What is read of the JSON of `stonecut measure`.
#[derive(Deserialize)]
struct Measured {
    original: File,
    simplified: File,
    forward: Side,
    backward: Side,
    rms: f64,
    diagonal: f64,
}

#[derive(Deserialize)]
struct File {
    topology: Topology,
}

#[derive(Deserialize)]
struct Side {
    rms: f64,
    p999: f64,
    max: f64,
}

/// How to measure.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Samples a side.
    pub samples: u64,
    /// Memory for `stonecut measure`.
    pub memory_bytes: u64,
    /// Whether to ask for facing.
    pub facing: bool,
}

/// Measures one result against its original.
pub fn judge(
    places: &Places,
    original: &Path,
    result: &Path,
    options: Options,
) -> Outcome<Quality> {
    let output = Command::new(&places.stonecut)
        .arg("measure")
        .args([original, result])
        .args(["--json", "-q", "--samples", &options.samples.to_string()])
        .args(["--memory", &options.memory_bytes.to_string()])
        .output()?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(format!("measure {}: {}", result.display(), said.trim()).into());
    }
    let measured: Measured = serde_json::from_slice(&output.stdout)?;
    let before = measured.original.topology;
    let facing_against = if options.facing && before.triangles <= MAX_FACING_TRIANGLES {
        let output = Command::new(&places.bench).arg("facing").args([original, result]).output()?;
        String::from_utf8_lossy(&output.stdout).trim().parse().ok()
    } else {
        None
    };
    Ok(Quality {
        before,
        after: measured.simplified.topology,
        samples: options.samples,
        rms: measured.rms,
        rms_forward: measured.forward.rms,
        p999: measured.forward.p999.max(measured.backward.p999),
        max: measured.forward.max.max(measured.backward.max),
        diagonal: measured.diagonal,
        facing_against,
    })
}

/// How many triangles of the result have a normal against that of the original triangle nearest to their
/// centroid. On thin walls the nearest triangle may be the other side's: compare tools, not absolutes.
pub fn facing_against(original: &Path, result: &Path) -> Outcome<u64> {
    let (original, result) = (meshes::read_any(original)?, meshes::read_any(result)?);
    let tree = Tree::build(original.triangles.len(), |i| original.corners(i));
    let mut nearest = Nearest::NONE;
    let mut n_against = 0;
    for i in 0..result.triangles.len() {
        let corners = result.corners(i);
        let centroid = [0, 1, 2].map(|k| (corners[0][k] + corners[1][k] + corners[2][k]) / 3.0);
        let guess = match nearest.is_found() {
            true => tree.guess(centroid, nearest.slot),
            false => Nearest::NONE,
        };
        nearest = tree.nearest(centroid, guess);
        if nearest.is_found() {
            let there = area_normal(tree.corners(nearest.slot));
            let here = area_normal(&corners);
            let along: f64 = here.iter().zip(there).map(|(a, b)| a * b).sum();
            n_against += u64::from(along < 0.0);
        }
    }
    Ok(n_against)
}
