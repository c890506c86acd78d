//! Cuts a mesh in memory into cells, as the partition stage cuts a file.
//!
//! The same rules: a kd-tree over a hashed sample, a triangle goes to the cell of its corner of lowest index, and a
//! vertex that a triangle of another cell uses is shared. The mesh stays where it is; a cell is copied out of it when
//! its turn comes.
//!
//! docs/algorithm.md, section 10.

use super::scan::chosen;
use std::ops::Range;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellMesh, CellTree, TurnedFrame, n_samples, plan_cells};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_blocks;
use stonecut_system::progress::Progress;

/// Vertices worked on at a time by one thread.
const BLOCK: usize = 1 << 16;

/// A mesh cut into cells. Memory: 4 bytes a triangle, 1 a vertex; 4 a vertex more while it is made.
pub struct CutMesh {
    /// Triangles, cell by cell; within a cell in the order of the mesh.
    order: Vec<u32>,
    /// First place of each cell in `order`, and the end.
    starts: Vec<usize>,
    /// True if cells share the vertex.
    shared: Vec<bool>,
    /// Vertices that cells share.
    pub n_shared: u64,
}

impl CutMesh {
    /// Cuts `mesh` into cells of about `cell_triangles` triangles, in the frame of a round.
    pub fn new(
        mesh: &Mesh,
        cell_triangles: u64,
        round: u32,
        threads: usize,
        progress: &Progress,
    ) -> Result<CutMesh> {
        let cell_of = cells_of_vertices(mesh, cell_triangles, round, threads, progress)?;
        let n_cells = cell_of.iter().max().map_or(1, |last| last.index() + 1);
        let mut shared = vec![false; mesh.positions.len()];
        let mut starts = vec![0; n_cells + 1];
        let home = |t: &[u32; 3]| cell_of[t[0].min(t[1]).min(t[2]) as usize];
        for t in &mesh.triangles {
            let cell = home(t);
            starts[cell.index() + 1] += 1;
            for &v in t {
                shared[v as usize] |= cell_of[v as usize] != cell;
            }
        }
        for cell in 0..n_cells {
            starts[cell + 1] += starts[cell];
        }
        let mut next = starts.clone();
        let mut order = vec![0u32; mesh.triangles.len()];
        for (i, t) in (0u32..).zip(&mesh.triangles) {
            let place = &mut next[home(t)];
            order[*place] = i;
            *place += 1;
        }
        let n_shared = shared.iter().filter(|&&shared| shared).count() as u64;
        Ok(CutMesh { order, starts, shared, n_shared })
    }

    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.starts.len() - 1
    }

    fn range(&self, cell: CellId) -> Range<usize> {
        self.starts[cell]..self.starts[cell.index() + 1]
    }

    /// Triangles of a cell.
    pub fn n_triangles(&self, cell: CellId) -> u64 {
        self.range(cell).len() as u64
    }

    /// Copies one cell out of the mesh that was cut, whose vertices are these vertices of the input. Its vertices are in the
    /// order of the mesh. Without repeated triangles if `tidies`.
    pub fn load(&self, mesh: &Mesh, ids: &[u32], cell: CellId, tidies: bool) -> CellMesh {
        let rows = &self.order[self.range(cell)];
        let corners = || rows.iter().flat_map(|&t| mesh.triangles[t as usize]);
        let ranks = CellRanks::of(corners);
        let vertices: Vec<u32> = ranks.ids().collect();
        let mut out = CellMesh {
            ids: vertices.iter().map(|&v| GlobalVertex::in_memory(ids[v as usize])).collect(),
            records: Vec::new(),
            shared: vertices.iter().map(|&v| self.shared[v as usize]).collect(),
            mesh: Mesh {
                positions: vertices.iter().map(|&v| mesh.positions[v as usize]).collect(),
                channels: Vec::with_capacity(vertices.len() * mesh.n_channels),
                n_channels: mesh.n_channels,
                triangles: rows
                    .iter()
                    .map(|&t| mesh.triangles[t as usize].map(|v| ranks.rank(v)))
                    .collect(),
                relief: rows.iter().filter_map(|&t| mesh.relief.get(t as usize).copied()).collect(),
                ..Mesh::default()
            },
            ..CellMesh::default()
        };
        if mesh.n_channels > 0 {
            vertices.iter().for_each(|&v| out.mesh.channels.extend_from_slice(mesh.channels_of(v)));
        }
        if tidies {
            out.order_by_lowest_id();
            out.dropped = out.tidy(0);
        }
        out
    }
}

fn cells_of_vertices(
    mesh: &Mesh,
    cell_triangles: u64,
    round: u32,
    threads: usize,
    progress: &Progress,
) -> Result<Vec<CellId>> {
    let n_vertices = mesh.positions.len() as u64;
    let n_cells = plan_cells(mesh.triangles.len() as u64, cell_triangles);
    let stretch = (n_vertices / n_samples(n_vertices, n_cells)).max(1);
    let samples: Vec<[f64; 3]> = (0..n_vertices.div_ceil(stretch))
        .filter_map(|i| mesh.positions.get(chosen(i, stretch) as usize).copied())
        .collect();
    let bounds = Bounds::around(&mesh.positions).or_origin();
    let tree = CellTree::build(TurnedFrame::new(round, bounds), &samples, n_cells);
    let mut cell_of = Vec::with_capacity(mesh.positions.len());
    let blocks = (mesh.positions.len(), BLOCK);
    in_blocks(blocks, (threads, progress), &mut cell_of, |some, out| {
        let mut finder = tree.finder();
        out.extend(mesh.positions[some].iter().map(|&p| finder.cell_of(p)));
        Ok(())
    })?;
    Ok(cell_of)
}

/// A set of numbers with the rank of each: a bit for every number between the least and the greatest.
struct CellRanks {
    first: u32,
    words: Vec<u64>,
    /// Members before each word.
    before: Vec<u32>,
}

impl CellRanks {
    fn of<I: Iterator<Item = u32>>(members: impl Fn() -> I) -> CellRanks {
        let (first, last) =
            members().fold((u32::MAX, 0), |(low, high), v| (low.min(v), high.max(v)));
        let n_words = if first > last { 0 } else { ((last - first) / 64 + 1) as usize };
        let mut words = vec![0u64; n_words];
        for v in members() {
            words[((v - first) / 64) as usize] |= 1 << ((v - first) % 64);
        }
        let before = words.iter().scan(0, |n, word| {
            *n += word.count_ones();
            Some(*n - word.count_ones())
        });
        let before = before.collect();
        CellRanks { first, words, before }
    }

    fn rank(&self, v: u32) -> u32 {
        let (word, bit) = (((v - self.first) / 64) as usize, (v - self.first) % 64);
        self.before[word] + (self.words[word] & ((1 << bit) - 1)).count_ones()
    }

    fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        let is_in = |bit: &u32, word: u64| word >> bit & 1 == 1;
        (0u32..).zip(&self.words).flat_map(move |(at, &word)| {
            let members = (0..64).filter(move |bit| is_in(bit, word));
            members.map(move |bit| self.first + 64 * at + bit)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_count_the_members_before() {
        let members = [130u32, 7, 8, 70, 7, 71, 4_000];
        let ranks = CellRanks::of(|| members.into_iter());
        assert_eq!(ranks.ids().collect::<Vec<_>>(), [7, 8, 70, 71, 130, 4_000]);
        assert_eq!([7, 8, 70, 71, 130, 4_000].map(|v| ranks.rank(v)), [0, 1, 2, 3, 4, 5]);
        assert_eq!(CellRanks::of(std::iter::empty).ids().count(), 0);
    }

    /// A flat sheet of 20 by 20 quads in four cells or more.
    #[test]
    fn every_triangle_is_in_one_cell_and_what_two_cells_use_is_shared() {
        let n = 20u32;
        let place = |i: u32| [f64::from(i % (n + 1)), f64::from(i / (n + 1)), 0.0];
        let quad = |q: u32| {
            let a = q / n * (n + 1) + q % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        let positions: Vec<[f64; 3]> = (0..(n + 1) * (n + 1)).map(place).collect();
        let mut mesh = Mesh::new(positions, (0..n * n).flat_map(quad).collect());
        mesh.n_channels = 1;
        mesh.channels = (0..(n + 1) * (n + 1)).map(|v| v as f32).collect();
        let n_vertices = mesh.positions.len();
        let ids: Vec<u32> = (0..n_vertices as u32).collect();
        let progress = Progress::default();
        for threads in [1, 3] {
            let cut = CutMesh::new(&mesh, 200, 0, threads, &progress).expect("nothing stops it");
            assert!(cut.n_cells() >= 4);
            let mut users = vec![0; n_vertices];
            let mut found = Vec::new();
            for cell in CellId::first(cut.n_cells()) {
                let loaded = cut.load(&mesh, &ids, cell, true);
                assert_eq!(loaded.mesh.triangles.len() as u64, cut.n_triangles(cell));
                for (v, &id) in loaded.ids.iter().enumerate() {
                    let id = id.narrow() as usize;
                    users[id] += 1;
                    assert_eq!(loaded.mesh.positions[v], mesh.positions[id]);
                    assert_eq!(loaded.mesh.channels[v], id as f32);
                }
                let named = |t: &[u32; 3]| t.map(|v| loaded.ids[v as usize].narrow());
                found.extend(loaded.mesh.triangles.iter().map(named));
            }
            found.sort_unstable();
            let mut expected = mesh.triangles.clone();
            expected.sort_unstable();
            assert_eq!(found, expected);
            assert!((0..n_vertices).all(|v| users[v] < 2 || cut.shared[v]));
            assert_eq!(cut.n_shared, cut.shared.iter().filter(|&&s| s).count() as u64);
        }
    }
}
