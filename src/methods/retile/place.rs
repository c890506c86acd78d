//! The vertex of each cluster: the point nearest to the planes of its triangles, from their middle.

use super::clusters::{Clusters, NONE};
use super::refine::Surface;
use crate::sums::{CellSums, Term};
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, normal, scale, sub};

/// Singular values below this share of the largest one count as 0: a vertex is not to slide along a surface that is only
/// a little bent, since that costs angles and gains next to nothing.
const LEAST_SINGULAR: f64 = 0.05;

/// Places the vertices of all clusters, and those of triangles that would turn over at the middle of their clusters.
pub(super) fn place(surface: &Surface, clusters: &Clusters, dual: &[[u32; 3]]) -> Vec<Vec3> {
    let n = clusters.len();
    let mut area = vec![0.0; n];
    let mut facing = vec![[0.0; 3]; n];
    for t in &surface.triangles {
        let weighted = normal(t.map(|v| surface.positions[v as usize]));
        for owner in t.map(|v| clusters.owner[v as usize]).into_iter().filter(|o| *o != NONE) {
            area[owner as usize] += length_sq(weighted).sqrt() / 6.0;
            facing[owner as usize] = add(facing[owner as usize], weighted);
        }
    }
    let centroids: Vec<Vec3> = (0..n as u32).map(|c| clusters.centroid(c)).collect();
    let radius: Vec<f64> = area
        .iter()
        .map(|area| (area / std::f64::consts::PI).sqrt())
        .map(|radius| if radius > 0.0 { radius } else { 1.0 })
        .collect();
    let mut sums = vec![CellSums::default(); n];
    for t in &surface.triangles {
        let owners = t.map(|v| clusters.owner[v as usize]);
        for k in 0..3 {
            let owner = owners[k];
            if owner == NONE || owners[..k].contains(&owner) {
                continue;
            }
            let c = owner as usize;
            let local =
                |v: u32| scale(sub(surface.positions[v as usize], centroids[c]), 1.0 / radius[c]);
            let term = Term::new(t.map(local));
            let inside = owners.map(|other| other == owner);
            match inside {
                [true, true, true] => sums[c].add_whole(&term, [0.0; 3]),
                _ => sums[c].add_part(&term, [0.0; 3], inside),
            }
        }
    }
    let placed = |c: usize| add(centroids[c], scale(sums[c].point(LEAST_SINGULAR), radius[c]));
    let mut places: Vec<Vec3> = (0..n).map(placed).collect();
    for t in dual {
        let across = normal(t.map(|c| places[c as usize]));
        let up = t.iter().fold([0.0; 3], |sum, &c| add(sum, facing[c as usize]));
        if dot(across, up) <= 0.0 {
            t.iter().for_each(|&c| places[c as usize] = centroids[c as usize]);
        }
    }
    places
}
