//! Connected components of a graph that may be larger than memory: edges become stars around the least node.
//!
//! Two kinds of pass alternate, each a sort of the edges and a look at every node's neighbours in order: all
//! larger neighbours of a node go to its least neighbour, then it and all its smaller ones. When neither pass
//! changes an edge, every node has an edge to the least of its component and no other. It knows only numbers.
//!
//! Source: Kiveris et al. 2014, "Connected Components in MapReduce and Beyond" (docs/references.md).

use stonecut_io::{ExternalSort, halves, whole};
use stonecut_system::error::Result;

/// Edges on their way through a sort.
pub(super) type Edges = ExternalSort<4>;

/// The record of an edge.
pub(super) fn edge(from: u64, to: u64) -> [u32; 4] {
    let ([a, b], [c, d]) = (halves(from), halves(to));
    [a, b, c, d]
}

/// Calls `each` with every edge once, in order of the first node, then of the second.
pub(super) fn each_edge(edges: Edges, mut each: impl FnMut(u64, u64) -> Result<()>) -> Result<()> {
    let mut last = None;
    edges.drain(|record| {
        if last == Some(record) {
            return Ok(());
        }
        last = Some(record);
        let [a, b, c, d] = record;
        each(whole(a, b), whole(c, d))
    })
}

/// Turns edges, in any direction, into pairs of a node and the least node of its component; least nodes stand
/// in no pair as the first. Memory: two sorts of `new`.
pub(super) fn stars(
    edges: Edges,
    new: impl Fn() -> Edges,
    check: impl Fn() -> Result<()>,
) -> Result<Edges> {
    let mut edges = edges;
    loop {
        let mut both = new();
        each_edge(edges, |a, b| {
            check()?;
            if a != b {
                both.push(edge(a, b))?;
                both.push(edge(b, a))?;
            }
            Ok(())
        })?;
        let (falling, large) = large_star(both, new())?;
        let (stars, small) = small_star(falling, new())?;
        edges = stars;
        if !large && !small {
            return Ok(edges);
        }
        check()?;
    }
}

/// From edges in both directions: every larger neighbour of a node gets an edge to the least one, or to the
/// node. True if that changed any.
fn large_star(both: Edges, mut out: Edges) -> Result<(Edges, bool)> {
    let (mut node, mut least, mut is_changed) = (None, 0, false);
    each_edge(both, |from, to| {
        if node != Some(from) {
            node = Some(from);
            least = from.min(to);
        }
        if to > from {
            is_changed |= least != from;
            out.push(edge(to, least))?;
        }
        Ok(())
    })?;
    Ok((out, is_changed))
}

/// From edges to smaller nodes: a node and all its smaller neighbours get edges to the least of them.
fn small_star(falling: Edges, mut out: Edges) -> Result<(Edges, bool)> {
    let (mut node, mut least, mut is_changed) = (None, 0, false);
    each_edge(falling, |from, to| {
        if node != Some(from) {
            node = Some(from);
            least = to;
            return out.push(edge(from, least));
        }
        is_changed = true;
        out.push(edge(to, least))
    })?;
    Ok((out, is_changed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::union_find::Union;

    fn check(n: u32, edges: &[(u32, u32)]) {
        let new = || Edges::new(&std::env::temp_dir(), 0);
        let mut sort = new();
        let mut union = Union::new(n as usize);
        for &(a, b) in edges {
            sort.push(edge(u64::from(a) << 20, u64::from(b) << 20)).unwrap();
            union.join(a, b);
        }
        let roots = union.into_roots();
        let mut expected: Vec<(u64, u64)> = (0..n)
            .filter(|&v| roots[v as usize] != v)
            .map(|v| (u64::from(v) << 20, u64::from(roots[v as usize]) << 20))
            .collect();
        expected.sort_unstable();
        let mut found = Vec::new();
        each_edge(stars(sort, new, || Ok(())).unwrap(), |a, b| {
            found.push((a, b));
            Ok(())
        })
        .unwrap();
        assert_eq!(found, expected);
    }

    #[test]
    fn every_node_finds_the_least_of_its_component() {
        check(5, &[]);
        check(5, &[(3, 3), (4, 2), (2, 4), (4, 3)]);
        // A chain in bad order, longer than one run of a sort, and a ring.
        let chain: Vec<_> = (0..5000).map(|i| (i * 1237 % 5003, (i + 1) * 1237 % 5003)).collect();
        check(5003, &chain);
        let ring: Vec<_> = (0..3000).map(|i| (i, (i + 1) % 3000)).collect();
        check(3000, &ring);
        // Random graphs from nearly nothing to one component.
        let mut state = 7u32;
        let mut random = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % n
        };
        for n_edges in [300, 900, 1100, 3000] {
            let edges: Vec<_> = (0..n_edges).map(|_| (random(2000), random(2000))).collect();
            check(2000, &edges);
        }
    }
}
