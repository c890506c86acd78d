//! Borders of tiles: within a level neighbours have the same edges, and across levels what groups have in common.
//!
//! Vertices are known by their numbers in the input, so sheets that touch are told apart; places are whole steps of the
//! lattice, so equal means equal.

use super::found::TilesetCheck;
use super::rules::Tree;
use std::collections::{BTreeMap, HashMap};
use stonecut_io::TileMesh;
use stonecut_io::tileset::TileBorder;
use stonecut_mesh::global_vertex::GlobalVertex;

/// A place in steps of the tile's level.
type Node = [i32; 3];

/// An edge between two vertices that other tiles may have: their numbers, the lower one first, and their places.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Edge {
    ids: [GlobalVertex; 2],
    places: [Node; 2],
}

/// The border of a tile.
#[derive(Clone, Debug, Default)]
pub(super) struct Border {
    /// Edges of one triangle whose ends other tiles may have; of three or more at edges that are not manifold.
    pub(super) edges: Vec<Edge>,
    /// Other edges with such ends, by the numbers of these.
    pub(super) inner: Vec<[GlobalVertex; 2]>,
    /// Edges of one triangle that no other tile can have.
    pub(super) open: u64,
}

/// The edges that one triangle of a tile has; the error says what is wrong with the numbers of its vertices.
pub(super) fn border(mesh: &TileMesh, numbers: &TileBorder) -> Result<Border, String> {
    let mut ids = vec![None; mesh.positions.len()];
    // Vertices of several charts are the first one with their number.
    let mut first: HashMap<GlobalVertex, u32> = HashMap::with_capacity(numbers.len());
    let mut same: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for &(at, id) in numbers {
        let Some(place) = ids.get_mut(at as usize) else {
            return Err(format!("a number is given to vertex {at} of {}", mesh.positions.len()));
        };
        *place = Some(id);
        let one = *first.entry(id).or_insert(at);
        if mesh.positions[one as usize] != mesh.positions[at as usize] {
            return Err(format!("its vertices {one} and {at} are one and lie apart"));
        }
        same[at as usize] = one;
    }
    let mut edges: Vec<[u32; 2]> = Vec::with_capacity(3 * mesh.triangles.len());
    for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|v| same[v as usize])) {
        edges.extend([[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]));
    }
    edges.sort_unstable();
    let mut out = Border::default();
    for run in edges.chunk_by(|a, b| a == b) {
        let [a, b] = run[0];
        match (ids[a as usize], ids[b as usize]) {
            (Some(i), Some(j)) if run.len() % 2 == 0 => out.inner.push([i.min(j), i.max(j)]),
            _ if run.len() % 2 == 0 => {}
            (Some(i), Some(j)) => {
                let (first, last) = if i < j { ((i, a), (j, b)) } else { ((j, b), (i, a)) };
                let places = [first, last].map(|(_, v)| mesh.positions[v as usize]);
                out.edges.push(Edge { ids: [first.0, last.0], places });
            }
            _ => out.open += 1,
        }
    }
    Ok(out)
}

/// The edges on the borders of the tiles of a level.
pub(super) struct Borders {
    level: u32,
    /// Edges with their tiles, sorted once all are there.
    edges: Vec<(Edge, u32)>,
    /// Other edges whose ends several tiles have; sorted with `edges`.
    inner: Vec<[GlobalVertex; 2]>,
    /// Edges that no other tile has.
    open: u64,
}

/// Distance of two places along an axis, in steps.
fn off(a: &[Node; 2], b: &[Node; 2]) -> i32 {
    let off = |i: usize, k: usize| (a[i][k].saturating_sub(b[i][k])).saturating_abs();
    (0..6).map(|i| off(i / 3, i % 3)).max().unwrap_or(0)
}

impl Borders {
    pub(super) fn new(level: u32) -> Borders {
        Borders { level, edges: Vec::new(), inner: Vec::new(), open: 0 }
    }

    pub(super) fn add(&mut self, tile: u32, border: Border) {
        self.edges.extend(border.edges.into_iter().map(|edge| (edge, tile)));
        self.inner.extend(border.inner);
        self.open += border.open;
    }

    /// True if a tile of the level has an edge between two vertices, at its border or not.
    fn has(&self, ids: [GlobalVertex; 2]) -> bool {
        self.edges.binary_search_by_key(&ids, |(edge, _)| edge.ids).is_ok()
            || self.inner.binary_search(&ids).is_ok()
    }

    fn runs(&self) -> impl Iterator<Item = &[(Edge, u32)]> {
        self.edges.chunk_by(|a, b| a.0.ids == b.0.ids)
    }

    /// Finds gaps between tiles of the level: an edge that lies elsewhere in another tile. Returns the number of edges that
    /// no other tile has: the boundary of the mesh.
    pub(super) fn within(&mut self, tree: &Tree, found: &mut TilesetCheck) -> u64 {
        self.edges.sort_unstable();
        self.inner.sort_unstable();
        let step = tree.step * f64::from(self.level).exp2();
        let (mut boundary, mut shared) = (self.open, 0);
        // The largest gap of each pair of tiles.
        let mut gaps: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        for run in self.runs() {
            if run.len() == 1 {
                boundary += 1;
                continue;
            }
            shared += 1;
            let (edge, tile) = run[0];
            for (other, neighbour) in &run[1..] {
                let gap = off(&edge.places, &other.places);
                if gap > 0 {
                    let most = gaps.entry((tile, *neighbour)).or_default();
                    *most = gap.max(*most);
                }
            }
        }
        found.shared_edges += shared;
        for ((tile, neighbour), steps) in gaps {
            let gap = f64::from(steps) * step;
            found.gap_within = found.gap_within.max(gap);
            let [a, b] = [tile, neighbour].map(|t| tree.tiles[t as usize].name());
            found.fault(|| format!("{a} and {b}, tiles of one level, are {gap:e} apart"));
        }
        boundary
    }

    /// The edges that tiles of different groups have in common, with their tiles.
    fn seams(&self, group: impl Fn(u32) -> Option<u32>) -> Vec<(Edge, u32)> {
        let is_seam = |run: &&[(Edge, u32)]| run.iter().any(|e| group(e.1) != group(run[0].1));
        self.runs().filter(is_seam).flatten().copied().collect()
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
        for (of, other, all, words) in [
            (&fine, &coarse, coarser, "its coarser version"),
            (&coarse, &fine, finer, "its finer version"),
        ] {
            for (edge, tile) in of {
                let same = other.binary_search_by_key(&edge.ids, |(edge, _)| edge.ids);
                let Ok(same) = same else {
                    // Where more than two triangles meet, one level may count it to the border and the other one not.
                    if all.has(edge.ids) {
                        continue;
                    }
                    let name = tree.tiles[*tile as usize].name();
                    found.fault(|| {
                        format!(
                            "{name}: {words} has no edge at {:?} steps, where groups meet",
                            edge.places[0]
                        )
                    });
                    continue;
                };
                let (finer, coarser) = match std::ptr::eq(of, &fine) {
                    true => (edge.places, other[same].0.places),
                    false => (other[same].0.places, edge.places),
                };
                let doubled = coarser.map(|p| p.map(|x| x.saturating_mul(2)));
                // A step of the level above the coarser one is four of the finer one.
                let gap = f64::from(off(&finer, &doubled)) / 4.0;
                found.gap_across_steps = found.gap_across_steps.max(gap);
                if gap > MOST_ACROSS {
                    let name = tree.tiles[*tile as usize].name();
                    found.fault(|| format!("{name}: {words} is {gap} steps away at an edge"));
                }
            }
        }
    }
}

/// Steps of the level above both by which tiles of neighbouring levels may be apart, along an axis: what rounding makes.
const MOST_ACROSS: f64 = 0.5;
