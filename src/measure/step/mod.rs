//! The distance between a mesh and its simplified version, at most: for the steps between levels of detail.
//!
//! Every vertex of the mesh knows the vertex of the version that it went into, so each triangle is laid onto the triangles
//! around one of those, and the distance is found where it is largest (`star`, `covered`). Triangles that lie over none of them, and
//! those that seem farthest, are looked at one by one (`forward`). Back, from the version to the mesh, every triangle is looked
//! at that the mesh does not cover within that distance (`back`).
//!
//! docs/design/tiles.md, "Errors".

mod across;
mod around;
mod back;
mod below;
mod covered;
mod exact;
mod foot;
mod forward;
mod largest;
mod patches;
mod star;
mod within;

use around::{Around, Forward, NONE};
use covered::Covered;
use exact::Exact;
use largest::{Largest, ROUNDING};
use patches::Patches;
use stonecut_mesh::Mesh;

/// The distance from `fine` to `coarse`, at most, or back, whichever is larger.
///
/// `followed`: for each vertex of `fine` the vertex of `coarse` that it went into, or `u32::MAX`; empty if nothing is known.
/// The bound exceeds the largest distance found by at most the factor `slack`, above 1, but for needles and hubs; the nearer to 1,
/// the longer it takes.
/// Both have triangles. Memory: 70 bytes for each triangle of `fine`; 150 where many feet are not found nearby.
pub fn deviation(fine: &Mesh, coarse: &Mesh, followed: &[u32], slack: f64) -> f64 {
    let hints = hints(fine, coarse, followed);
    let size = coarse.positions.iter().flatten().fold(0.0f64, |size, x| size.max(x.abs()));
    let rounding_sq = (size * ROUNDING) * (size * ROUNDING);
    let slack_sq = slack * slack;
    let mut largest =
        Largest { certain_sq: 0.0, bound_sq: 0.0, slack_sq, rounding_sq, most_pieces: usize::MAX };
    let around = Around::vertices(coarse);
    let patches = Patches::new(fine, &hints, coarse.positions.len());
    let forward = Forward { fine, coarse, around: &around };
    let covered = Covered::find(&forward, &patches, &hints);
    forward.triangles(&hints, &covered, &mut largest, &mut Exact::new(coarse));
    drop(covered);
    back::triangles(&forward, &patches, &hints, &mut largest);
    // Shares of triangles are known to some 2^-46 (`below`).
    largest.bound_sq.sqrt() + size * ROUNDING
}

/// A vertex of `coarse` near each vertex of `fine`, where one is known: its own, or that of a neighbour.
fn hints(fine: &Mesh, coarse: &Mesh, followed: &[u32]) -> Vec<u32> {
    let (n, n_coarse) = (fine.positions.len(), coarse.positions.len());
    let mut hints = match followed.len() == n {
        true => followed.to_vec(),
        // Nothing was done.
        false if n == n_coarse => (0..n as u32).collect(),
        false => vec![NONE; n],
    };
    hints.iter_mut().filter(|hint| **hint as usize >= n_coarse).for_each(|hint| *hint = NONE);
    if hints.contains(&NONE) {
        for t in &fine.triangles {
            let known = t.iter().map(|&v| hints[v as usize]).find(|&hint| hint != NONE);
            if let Some(known) = known {
                for &v in t {
                    if hints[v as usize] == NONE {
                        hints[v as usize] = known;
                    }
                }
            }
        }
    }
    hints
}

#[cfg(test)]
mod tests;
