//! Normals of the result from its own triangles, the same on both sides of every seam.
//!
//! A vertex's normal is the sum of its triangles' normals, weighted by area: slivers, whose normals mean
//! little, are left out. Vertices in one place share their normal, so that no texture seam shows in the
//! shading. A place without any area gets zeros.

use std::collections::HashMap;
use stonecut_mesh::vec3;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{SurvivorPack, Survivors};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;

/// A position, bit for bit but for the sign of zeros.
type Key = [u64; 3];
type Sums = HashMap<Key, [f64; 3]>;

/// Sums over all cells where several cells meet.
pub(super) struct Recomputed {
    shared: Sums,
}

impl Recomputed {
    /// Reads a result of several cells twice. Memory: one cell, and 48 bytes per shared vertex.
    pub(super) fn new(result: &SurvivorPack, run: &StageContext) -> Result<Recomputed> {
        let n_cells = result.info().cells.len();
        let mut shared = Sums::new();
        if n_cells > 1 {
            for cell in CellId::first(n_cells) {
                let part = result.load(cell)?;
                let marked = part.mesh.positions.iter().zip(&part.shared).filter(|(_, s)| **s);
                shared.extend(marked.map(|(&p, _)| (vec3::place_bits(p), [0.0; 3])));
            }
            for cell in CellId::first(n_cells) {
                run.progress.check()?;
                let part = result.load(cell)?;
                each_corner(&part, |place, weighted| {
                    if let Some(sum) = shared.get_mut(&place) {
                        *sum = vec3::add(*sum, weighted);
                    }
                });
            }
        }
        Ok(Recomputed { shared })
    }

    /// A unit normal for each vertex of a cell.
    pub(super) fn of(&self, part: &Survivors) -> Vec<[f64; 3]> {
        let mut sums = Sums::with_capacity(part.mesh.positions.len());
        each_corner(part, |place, weighted| {
            let sum = sums.entry(place).or_default();
            *sum = vec3::add(*sum, weighted);
        });
        let normal = |&position: &[f64; 3]| {
            let place = vec3::place_bits(position);
            let sum = self.shared.get(&place).or_else(|| sums.get(&place));
            sum.copied().and_then(unit).unwrap_or_default()
        };
        part.mesh.positions.iter().map(normal).collect()
    }
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    // By the largest component first, so that no square is lost.
    let most = v.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    let v = v.map(|x| x / most);
    let length = vec3::length_sq(v).sqrt();
    (most > 0.0 && length.is_finite()).then(|| v.map(|x| x / length))
}

/// Calls `each` with place and weighted normal of every corner of a triangle with an area.
fn each_corner(part: &Survivors, mut each: impl FnMut(Key, [f64; 3])) {
    for t in 0..part.mesh.triangles.len() {
        let corners = part.mesh.corners(t);
        let weighted = vec3::normal(corners);
        if weighted.iter().all(|x| x.is_finite()) {
            corners.iter().for_each(|&corner| each(vec3::place_bits(corner), weighted));
        }
    }
}
