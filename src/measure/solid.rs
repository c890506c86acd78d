//! Counts where a file is not closed, not manifold or passes through itself, as a slicer sees it: vertices in one place are one.
//!
//! For what `simplify` was asked to leave closed, turned one way and free of self-intersections. A file that does not fit into
//! memory is counted through cells by its indices, without loops and vertices where sheets touch. Changes nothing.

use crate::check;
use crate::intersections;
use crate::load;
use crate::temp_store::Cutting;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::outward::turn_outward;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::place_bits;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Bytes a triangle that counting takes besides the mesh.
const BYTES: u64 = 160;

/// Faults of a result that was to be solid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Solid {
    /// Edges of one triangle, but those of holes that were larger than asked for.
    pub open_edges: u64,
    /// Loops of such edges; absent where the file was counted through cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open_loops: Option<u64>,
    /// Holes that are larger than those that were to be filled; likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub larger_holes: Option<u64>,
    /// Edges of three triangles or more.
    pub non_manifold_edges: u64,
    /// Vertices in whose place several sheets touch; absent where the file was counted through cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub touching_vertices: Option<u64>,
    /// Edges whose two triangles disagree about the side that is outside.
    pub inconsistent_edges: u64,
    /// Closed components that are inside out; absent where the file was counted through cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bodies_inside_out: Option<u64>,
    /// Pairs of triangles that meet beside a common corner or edge.
    pub self_intersections: u64,
    /// True if all that was asked for is so.
    pub met: bool,
}

/// Counts in a file; holes are open edges if their box has at most the diagonal `largest`.
pub fn look(
    source: &MeshSource,
    largest: f64,
    cutting: Cutting,
    progress: &Progress,
) -> Result<Solid> {
    let (n, threads, memory_bytes) = (source.n_triangles(), cutting.threads, cutting.memory_bytes);
    let needed = load::bytes_in_memory(source).saturating_add(BYTES.saturating_mul(n));
    if needed > memory_bytes / 2 || u32::try_from(3 * n.max(source.n_vertices())).is_err() {
        let found = check::check(source, cutting, true, progress)?;
        let pairs = found.intersections.unwrap_or_default().self_intersections;
        return Ok(Solid {
            open_edges: if largest.is_finite() { 0 } else { found.topology.boundary_edges },
            non_manifold_edges: found.topology.non_manifold_edges,
            inconsistent_edges: found.topology.inconsistent_edges,
            self_intersections: pairs,
            ..Solid::default()
        });
    }
    progress.begin("check", 1, 1, n);
    let loaded = load::load(source, threads, progress)?;
    let pairs = intersections::in_memory(&loaded.mesh, threads, progress)?.self_intersections;
    Ok(Solid { self_intersections: pairs, ..of_mesh(loaded.mesh, largest) })
}

/// Counts all but pairs that meet.
fn of_mesh(mut mesh: Mesh, largest: f64) -> Solid {
    let n = mesh.positions.len();
    let place = |v: u32| place_bits(mesh.positions[v as usize]);
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_unstable_by_key(|&v| (place(v), v));
    let mut first = vec![0; n];
    for same in order.chunk_by(|&a, &b| place(a) == place(b)) {
        same.iter().for_each(|&v| first[v as usize] = same[0]);
    }
    mesh.triangles.iter_mut().for_each(|t| *t = t.map(|v| first[v as usize]));
    mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    // Each side with its corners, the lesser vertex first.
    let mut sides: Vec<([u32; 2], [u32; 2])> = Vec::with_capacity(3 * mesh.triangles.len());
    for (t, corners) in mesh.triangles.iter().enumerate() {
        for (i, k) in [(0, 1), (1, 2), (2, 0)] {
            let (i, k) = if corners[i] < corners[k] { (i, k) } else { (k, i) };
            sides.push(([corners[i], corners[k]], [i, k].map(|i| (3 * t + i) as u32)));
        }
    }
    sides.sort_unstable();
    let (mut fans, mut loops) = (Union::new(3 * mesh.triangles.len()), Union::new(n));
    let (mut open, mut inconsistent_edges, mut non_manifold_edges) = (Vec::new(), 0, 0);
    let is_forwards = |[i, k]: [u32; 2]| (k + 3 - i) % 3 == 1;
    for edge in sides.chunk_by(|a, b| a.0 == b.0) {
        for (_, corners) in &edge[1..] {
            (0..2).for_each(|end| fans.join(edge[0].1[end], corners[end]));
        }
        match *edge {
            [([a, b], _)] => {
                loops.join(a, b);
                open.push([a, b]);
            }
            [(_, a), (_, b)] => {
                inconsistent_edges += u64::from(is_forwards(a) == is_forwards(b));
            }
            _ => non_manifold_edges += 1,
        }
    }
    let corners = mesh.triangles.iter().flatten().zip(fans.into_roots());
    let mut corners: Vec<(u32, u32)> = corners.map(|(&v, root)| (v, root)).collect();
    corners.sort_unstable();
    corners.dedup();
    let touching = corners.chunk_by(|a, b| a.0 == b.0).filter(|fans| fans.len() > 1).count();
    let roots = loops.into_roots();
    open.sort_unstable_by_key(|&[a, _]| roots[a as usize]);
    let (mut open_edges, mut open_loops, mut larger_holes) = (0, 0, 0);
    for edges in open.chunk_by(|a, b| roots[a[0] as usize] == roots[b[0] as usize]) {
        let mut bounds = Bounds::EMPTY;
        edges.iter().flatten().for_each(|&v| bounds.add(mesh.positions[v as usize]));
        if bounds.diagonal() > largest {
            larger_holes += 1;
        } else {
            open_edges += edges.len() as u64;
            open_loops += 1;
        }
    }
    Solid {
        open_edges,
        open_loops: Some(open_loops),
        larger_holes: Some(larger_holes),
        non_manifold_edges,
        touching_vertices: Some(touching as u64),
        inconsistent_edges,
        bodies_inside_out: Some(turn_outward(&mut mesh).1),
        ..Solid::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_in_one_place_are_one() {
        // Two tetrahedra that share an edge by place, and a third one that touches them in a corner.
        let tetrahedron = |at: [[f64; 3]; 4], first: u32| {
            let triangles = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
            (at, triangles.map(|t: [u32; 3]| t.map(|v| v + first)))
        };
        let [o, x, y, z] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let parts = [
            tetrahedron([o, x, y, z], 0),
            tetrahedron([o, [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], z], 4),
            tetrahedron([z, [1.0, 0.0, 2.0], [0.0, 1.0, 2.0], [0.0, 0.0, 3.0]], 8),
        ];
        let mut mesh = Mesh::new(
            parts.iter().flat_map(|part| part.0).collect(),
            parts.iter().flat_map(|part| part.1).collect(),
        );
        let found = of_mesh(mesh.clone(), f64::INFINITY);
        assert_eq!((found.open_edges, found.non_manifold_edges), (0, 1));
        assert_eq!((found.touching_vertices, found.open_loops), (Some(1), Some(0)));
        assert_eq!(found.bodies_inside_out, Some(0));
        let mut turned = mesh.clone();
        turned.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        assert!(of_mesh(turned, f64::INFINITY).bodies_inside_out > Some(0));
        mesh.triangles.pop();
        let found = of_mesh(mesh.clone(), 10.0);
        assert_eq!((found.open_edges, found.open_loops), (3, Some(1)));
        let found = of_mesh(mesh, 0.5);
        assert_eq!((found.open_edges, found.larger_holes), (0, Some(1)));
    }
}
