//! Tells edges at which sheets meet along a curve from noise.

use crate::union_find::Union;

/// Edges that hang together are curves if there are at least this many of them, and as many more for each loose end, or
/// more than `MANY` of them. On scans such edges are fins of one or two triangles and the edges of doubled patches: of 1,236 groups
/// in dragon_res2 the largest have 42, 17 and 8 edges, with 12, 7 and 5 loose ends.
const FEW: usize = 8;
/// Edges that hang together are curves if they are more than this.
pub const MANY: usize = 48;

/// Returns whether this number of connected edges of three or more triangles, with this number of loose ends, makes curves, not noise.
pub fn are_curves(n_edges: usize, n_loose: usize) -> bool {
    n_edges > MANY || n_edges >= FEW * (1 + n_loose)
}

/// True if three or more of the triangles meet along a curve. It may go on at vertices of which not all triangles are known.
pub(crate) fn meet_along_curves(triangles: &[[u32; 3]], is_known: impl Fn(u32) -> bool) -> bool {
    let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(sides).collect();
    edges.iter_mut().for_each(|edge| edge.sort_unstable());
    edges.sort_unstable();
    let several = edges.chunk_by(|a, b| a == b).filter(|same| same.len() > 2);
    let edges: Vec<[u32; 2]> = several.map(|same| same[0]).collect();
    let mut vertices: Vec<u32> = edges.iter().flatten().copied().collect();
    vertices.sort_unstable();
    let n_ends =
        |v: u32| vertices.partition_point(|&w| w <= v) - vertices.partition_point(|&w| w < v);
    let number = |v: u32| vertices.partition_point(|&w| w < v) as u32;
    let mut groups = Union::new(vertices.len());
    edges.iter().for_each(|&[a, b]| groups.join(number(a), number(b)));
    let root = groups.into_roots();
    let mut counts = vec![(0, 0); vertices.len()];
    for &[a, b] in &edges {
        let (n_edges, n_loose) = &mut counts[root[number(a) as usize] as usize];
        *n_edges += 1;
        *n_loose += [a, b].iter().filter(|&&v| is_known(v) && n_ends(v) == 1).count();
    }
    counts.into_iter().any(|(n_edges, n_loose)| are_curves(n_edges, n_loose))
}
