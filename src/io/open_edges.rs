//! Vertices at open edges, of meshes of any size.
//!
//! Hashes of the edges around a vertex are combined by exclusive or. An edge of two triangles cancels itself, so what is
//! left is that of edges with an odd number of triangles. A vertex with open edges escapes with a probability of 2^-32.

use crate::ply::MeshSource;
use stonecut_system::error::Result;

/// Calls `each` with every vertex at an open edge, ascending; faces are read once for each `memory_bytes` / 4 vertices.
pub(crate) fn each_open(
    source: &MeshSource,
    memory_bytes: usize,
    mut each: impl FnMut(u64) -> Result<()>,
) -> Result<()> {
    let n_vertices = source.n_vertices();
    let at_once = (memory_bytes as u64 / 4).max(1 << 20);
    let mut first = 0;
    while first < n_vertices {
        let end = (first + at_once).min(n_vertices);
        let mut sums = vec![0u32; (end - first) as usize];
        each_edge(source, |edge, hash| {
            for v in edge.into_iter().filter(|v| (first..end).contains(v)) {
                sums[(v - first) as usize] ^= hash;
            }
        })?;
        for (i, _) in sums.iter().enumerate().filter(|(_, sum)| **sum != 0) {
            each(first + i as u64)?;
        }
        first = end;
    }
    Ok(())
}

/// Those of some vertices, sorted, that are at open edges.
pub(crate) fn open_among(source: &MeshSource, ids: &[u64]) -> Result<Vec<u64>> {
    // A bit for the last digits of each: 1 MiB, however many vertices there are.
    let mut may_be_one = vec![0u64; 1 << 17];
    let place = |v: u64| ((v / 64) as usize & ((1 << 17) - 1), 1 << (v % 64));
    for (word, bit) in ids.iter().map(|&v| place(v)) {
        may_be_one[word] |= bit;
    }
    let mut sums = vec![0u32; ids.len()];
    each_edge(source, |edge, hash| {
        for v in edge {
            let (word, bit) = place(v);
            if may_be_one[word] & bit != 0
                && let Ok(place) = ids.binary_search(&v)
            {
                sums[place] ^= hash;
            }
        }
    })?;
    Ok(ids.iter().zip(&sums).filter(|(_, sum)| **sum != 0).map(|(&v, _)| v).collect())
}

/// Calls `each` with the edges of every triangle, and a hash that does not depend on their sense.
pub(crate) fn each_edge(source: &MeshSource, mut each: impl FnMut([u64; 2], u32)) -> Result<()> {
    source.each_face_block(|block| {
        for &[a, b, c] in &block.triangles {
            for edge in [[a, b], [b, c], [c, a]] {
                each(edge, hash(edge[0], edge[1]));
            }
        }
        Ok(())
    })
}

/// A hash of an edge that does not depend on its sense.
pub(crate) fn hash(a: u64, b: u64) -> u32 {
    let (low, high) = (a.min(b), a.max(b));
    // Odd factors of splitmix64: all bits of the product's upper half are mixed.
    let mixed = (low ^ high.rotate_left(32)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ mixed >> 29).wrapping_mul(0x94d0_49bb_1331_11eb);
    (mixed >> 32) as u32
}
