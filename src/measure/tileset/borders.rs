//! Borders of tiles: within a level neighbours have the same edges, and across levels what groups have in common.
//!
//! All places are whole steps of the lattice, so equal means equal.

use super::found::TilesetCheck;
use super::rules::Tree;
use crate::io::TileMesh;
use std::collections::HashMap;

/// A place in steps of the tile's level.
pub(super) type Node = [i32; 3];

/// An edge, its lower end first.
pub(super) type Edge = [Node; 2];

/// Unmatched edges of two tiles that come so near, in steps, are taken for a crack.
const NEAR: i32 = 4;

/// The edges that one triangle of a tile has.
pub(super) fn boundary(mesh: &TileMesh) -> Vec<Edge> {
    let mut edges: Vec<Edge> = Vec::with_capacity(3 * mesh.triangles.len());
    for t in &mesh.triangles {
        let p = t.map(|v| mesh.positions[v as usize]);
        edges.extend([[p[0], p[1]], [p[1], p[2]], [p[2], p[0]]].map(|[a, b]| [a.min(b), a.max(b)]));
    }
    edges.sort_unstable();
    let single = edges.chunk_by(|a, b| a == b).filter(|run| run.len() % 2 == 1);
    // An edge that the lattice has made a point is left out.
    single.map(|run| run[0]).filter(|[a, b]| a != b).collect()
}

/// The edges on the borders of the tiles of a level.
pub(super) struct Borders {
    level: u32,
    /// Edges with their tiles, sorted once all are there.
    edges: Vec<(Edge, u32)>,
}

impl Borders {
    pub(super) fn new(level: u32) -> Borders {
        Borders { level, edges: Vec::new() }
    }

    pub(super) fn add(&mut self, tile: u32, edges: Vec<Edge>) {
        self.edges.extend(edges.into_iter().map(|edge| (edge, tile)));
    }

    /// Finds gaps between tiles of the level: edges that only one tile has, close to those of another one.
    pub(super) fn within(&mut self, tree: &Tree, found: &mut TilesetCheck) {
        self.edges.sort_unstable();
        // Ends of unmatched edges by cubes of twice the distance that counts as near.
        let cube = |p: Node| p.map(|x| x.div_euclid(2 * NEAR));
        let mut ends: HashMap<Node, Vec<(Node, u32)>> = HashMap::new();
        for run in self.edges.chunk_by(|a, b| a.0 == b.0) {
            if run.len() > 1 {
                found.shared_edges += 1;
                continue;
            }
            found.boundary_edges += u64::from(self.level == 0);
            let (edge, tile) = run[0];
            for end in edge {
                ends.entry(cube(end)).or_default().push((end, tile));
            }
        }
        let step = tree.step * f64::from(self.level).exp2();
        let mut cracks: Vec<(f64, u32, u32)> = Vec::new();
        for (key, list) in &ends {
            let around = (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
            let near: Vec<&(Node, u32)> = around
                .filter_map(|off| ends.get(&[0, 1, 2].map(|k| key[k] + off[k])))
                .flatten()
                .collect();
            for (end, tile) in list {
                // Where the boundary of the mesh goes from tile to tile both have its vertex.
                let others = || near.iter().filter(|(_, other)| other != tile);
                if others().any(|(other, _)| other == end) {
                    continue;
                }
                let gap = |p: &Node| (0..3).map(|k| i64::from(p[k] - end[k]).pow(2)).sum::<i64>();
                let nearest = others().map(|(p, other)| (gap(p), *other)).min();
                if let Some((gap_sq, other)) = nearest
                    && gap_sq <= i64::from(NEAR).pow(2)
                {
                    cracks.push(((gap_sq as f64).sqrt() * step, *tile, other));
                }
            }
        }
        cracks.sort_by(|a, b| (a.1, a.2).cmp(&(b.1, b.2)).then(b.0.total_cmp(&a.0)));
        cracks.dedup_by_key(|crack| (crack.1, crack.2));
        for (gap, tile, other) in cracks {
            found.gap_within = found.gap_within.max(gap);
            let [a, b] = [tile, other].map(|t| tree.tiles[t as usize].name());
            found.fault(|| format!("{a} and {b}, tiles of one level, are {gap:e} apart"));
        }
    }

    /// The edges that tiles of different groups have in common, with one of the tiles.
    fn seams(&self, group: impl Fn(u32) -> Option<u32>) -> Vec<(Edge, u32)> {
        let runs = self.edges.chunk_by(|a, b| a.0 == b.0);
        let is_seam = |run: &&[(Edge, u32)]| run.iter().any(|e| group(e.1) != group(run[0].1));
        runs.filter(is_seam).map(|run| run[0]).collect()
    }

    /// Holds the borders of groups as the finer level has them against those of the coarser level.
    pub(super) fn across(
        finer: &Borders,
        coarser: &Borders,
        tree: &Tree,
        found: &mut TilesetCheck,
    ) {
        let fine = finer.seams(|tile| tree.writer_of(tile));
        let coarse = coarser.seams(|tile| tree.tiles[tile as usize].group);
        let doubled: Vec<(Edge, u32)> =
            coarse.iter().map(|(edge, tile)| (edge.map(|p| p.map(|x| 2 * x)), *tile)).collect();
        for (of, other, words) in
            [(&fine, &doubled, "its coarser version"), (&doubled, &fine, "its finer version")]
        {
            let known = Known::new(other);
            for (edge, tile) in of {
                let gap = known.gap(edge);
                let name = || tree.tiles[*tile as usize].name().to_owned();
                match gap {
                    // A step of the level above the coarser one is four of the finer one.
                    Some(gap) => {
                        found.gap_across_steps = found.gap_across_steps.max(f64::from(gap) / 4.0);
                    }
                    None => found.fault(|| {
                        format!(
                            "{}: {words} has no edge at {:?} steps, where groups meet",
                            name(),
                            edge[0]
                        )
                    }),
                }
            }
        }
    }
}

/// Edges to be found again.
struct Known {
    edges: std::collections::HashSet<Edge>,
    nodes: std::collections::HashSet<Node>,
}

/// Steps of the finer level within which a vertex may lie elsewhere: it may be on the lattice of a coarser level.
const MOVED: i32 = 2;

impl Known {
    fn new(edges: &[(Edge, u32)]) -> Known {
        Known {
            edges: edges.iter().map(|(edge, _)| *edge).collect(),
            nodes: edges.iter().flat_map(|(edge, _)| *edge).collect(),
        }
    }

    /// Gap to the same edge along an axis, in steps of the finer level; none if there is no such edge.
    fn gap(&self, edge: &Edge) -> Option<i32> {
        if self.edges.contains(edge) {
            return Some(0);
        }
        let candidates = edge.map(|node| self.near(node));
        let off = |a: &Node, b: &Node| (0..3).map(|k| (a[k] - b[k]).abs()).max().unwrap_or(0);
        let mut least: Option<i32> = None;
        for a in &candidates[0] {
            for b in &candidates[1] {
                // An edge may have become a point.
                if a == b || self.edges.contains(&[*a.min(b), *a.max(b)]) {
                    let gap = off(a, &edge[0]).max(off(b, &edge[1]));
                    least = Some(least.map_or(gap, |known| known.min(gap)));
                }
            }
        }
        least
    }

    /// Nodes near a place.
    fn near(&self, node: Node) -> Vec<Node> {
        let mut out = Vec::new();
        for x in -MOVED..=MOVED {
            for y in -MOVED..=MOVED {
                for z in -MOVED..=MOVED {
                    let place = [node[0] + x, node[1] + y, node[2] + z];
                    if self.nodes.contains(&place) {
                        out.push(place);
                    }
                }
            }
        }
        out
    }
}
