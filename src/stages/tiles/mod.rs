//! The tiles of a tree: written group by group, beside the simplification of each.
//!
//! A round loads a group of eight boxes of its level with the mesh of the level below. Its tiles are written as they
//! come in, then it is simplified, and what is left is put in the order of the boxes of the round's own level. Decides
//! nothing about the order of rounds, and does not know the JSON of a tree.
//!
//! docs/design/tiles.md.

mod boxes;
mod mesh;
mod scalars;
mod textured;
mod tree;

use boxes::Boxes;
use mesh::{Part, Whole};
pub use scalars::carried_scalars;
use std::path::Path;
use stonecut_io::tileset::{TileBorder, encode_borders};
use stonecut_io::{TileForm, encode_tile};
use stonecut_mesh::Mesh;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    BoxKey, CellMesh, GroupRecord, Lattice, Survivors, TileRecord, VertexLayout, group_of,
    parent_of,
};
use stonecut_system::disk::Disk;
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::both;
pub use textured::{Places, Shape, encode_with_page, read_shapes};
pub use tree::{TreeLevels, tree};
use xxhash_rust::xxh3::xxh3_64;

/// Groups whose tiles lie in one folder: at most 64 tiles each, fewer than 1,000 files together.
const GROUPS_PER_FOLDER: usize = 15;

/// Memory for the tiles of a group and for measuring it at the same time, in bytes for each of its triangles.
pub const BYTES_PER_TRIANGLE: u64 = 95;

/// A round of groups whose tiles are written.
pub struct TileRound<'a> {
    /// The lattice of the tree.
    pub lattice: Lattice,
    /// The round, from 1: it writes tiles of the level below.
    pub round: u32,
    /// The round that leaves the finest level that is written; 0 if that is the input.
    pub finest: u32,
    /// The group of each cell.
    pub groups: &'a [BoxKey],
    /// The boxes of the level below in each cell with their triangles, in the order in which a cell is loaded; none in
    /// the first round.
    pub parts: Option<&'a [Vec<(BoxKey, u64)>]>,
    /// True if there is a thread to spare: a round of one group.
    pub has_spare_thread: bool,
    /// True if all that is left becomes one tile.
    pub is_last: bool,
    /// Triangles of a full tile.
    pub tile_triangles: u64,
    /// The folder of the tree.
    pub folder: &'a Path,
    /// True if tiles are the output, false if they are shapes that get pages later.
    pub is_output: bool,
    /// True if tiles are packed.
    pub packs: bool,
    /// True if z points upwards in the mesh.
    pub is_z_up: bool,
    /// The mesh, for messages.
    pub input: &'a Path,
    /// Rows of vertices.
    pub layout: &'a VertexLayout,
    /// The disk that is written through.
    pub disk: &'a Disk,
    /// Measures how far a mesh and its simplified version are apart, at most; given where each vertex of the mesh went.
    pub deviation: &'a (dyn Fn(&Mesh, &Mesh, &[u32]) -> f64 + Sync),
}

/// Steps along the longest side of a tile, at most: floats hold whole numbers up to here.
const MOST_STEPS: f64 = (1 << 24) as f64;

/// Path of a tile in its tree: number `n` of those that `cell` holds; `level` counts from the finest that is written.
pub fn tile_path(level: u32, cell: CellId, n: usize) -> String {
    format!("tiles/{level}/{}/{cell}-{n}.glb", cell.index() / GROUPS_PER_FOLDER)
}

/// Path of the numbers of the vertices that the tiles of a cell have in common with others.
pub fn border_name(level: u32, cell: CellId) -> String {
    format!("tiles/{level}/{}/{cell}.ids", cell.index() / GROUPS_PER_FOLDER)
}

/// True for vertices that more than one tile has: those of several boxes and those of several cells.
fn common(triangles: &[[u32; 3]], boxes: &Boxes, shared: &[bool]) -> Vec<bool> {
    let mut common = shared.to_vec();
    let mut first = vec![u32::MAX; shared.len()];
    let mut rest = &boxes.order[..];
    for (n, (_, count)) in (0u32..).zip(&boxes.counts) {
        let (own, others) = rest.split_at(*count as usize);
        rest = others;
        for &v in own.iter().flat_map(|&t| &triangles[t as usize]) {
            let first = &mut first[v as usize];
            match *first {
                u32::MAX => *first = n,
                other => common[v as usize] |= other != n,
            }
        }
    }
    common
}

impl TileRound<'_> {
    /// Writes the tiles of a cell, measures what became of it, and puts that in the order of its boxes.
    pub fn look(&self, cell: CellId, before: &CellMesh, left: &mut Survivors) -> Result<()> {
        let group = self.groups[cell];
        let mesh = &before.mesh;
        let is_written = self.round > self.finest;
        let boxes = match self.parts {
            _ if !is_written => Boxes::default(),
            None => boxes::of_leaves(mesh, &self.lattice, group, self.tile_triangles),
            Some(parts) => {
                let n: u64 = parts[cell].iter().map(|(_, n)| n).sum();
                if n != mesh.triangles.len() as u64 {
                    return Err(Error::Internal(format!(
                        "cell {cell} of round {} has {} triangles, its boxes {n}",
                        self.round,
                        mesh.triangles.len()
                    )));
                }
                Boxes { counts: joined(&parts[cell]), order: sorted_order(&parts[cell]) }
            }
        };
        let write = || match is_written {
            true => {
                let own = (&before.ids[..], &before.shared[..]);
                let whole = Whole::new(mesh, &before.records, own, self.layout);
                self.write(cell, self.round - 1, &whole, &boxes)
            }
            false => Ok(Default::default()),
        };
        let measure = || match left.mesh.triangles.is_empty() || mesh.triangles.is_empty() {
            true => diagonal(mesh),
            false => (self.deviation)(mesh, &left.mesh, &left.followed),
        };
        let ((tiles, borders), deviation) = both(self.has_spare_thread, write, || Ok(measure()))?;
        let parts = match self.is_last {
            true => Boxes {
                counts: vec![(group, left.mesh.triangles.len() as u64)],
                order: (0..left.mesh.triangles.len() as u32).collect(),
            },
            false => {
                boxes::of_parts(&left.mesh, &self.lattice, (self.round, group), self.tile_triangles)
            }
        };
        let old = std::mem::take(&mut left.mesh.triangles);
        left.mesh.triangles = parts.order.iter().map(|&t| old[t as usize]).collect();
        left.statistics.groups = vec![GroupRecord {
            group,
            tiles,
            borders,
            parts: parts.counts,
            deviation,
            triangles: [mesh.triangles.len() as u64, old.len() as u64],
        }];
        Ok(())
    }

    /// Writes the tile at the top of the tree: all that the last round has left.
    pub fn write_root(&self, left: &Survivors) -> Result<TileRecord> {
        let n = left.mesh.triangles.len() as u32;
        let boxes = Boxes { counts: vec![([0; 3], u64::from(n))], order: (0..n).collect() };
        let shared = vec![false; left.ids.len()];
        let whole = Whole::new(&left.mesh, &left.records, (&left.ids, &shared), self.layout);
        let (tiles, _) = self.write(CellId(0), self.round, &whole, &boxes)?;
        tiles.into_iter().next().ok_or_else(|| Error::Internal("no tile was written".to_owned()))
    }

    /// True if all tiles that were written with a cell are still there as they were.
    pub fn is_whole(&self, cell: CellId, left: &Survivors) -> bool {
        let [record] = &left.statistics.groups[..] else { return false };
        if self.round <= self.finest {
            return true;
        }
        let level = self.round - 1 - self.finest;
        let is_there = |name: String, checksum: u64| {
            std::fs::read(self.folder.join(name)).is_ok_and(|bytes| xxh3_64(&bytes) == checksum)
        };
        let mut tiles = record.tiles.iter().enumerate();
        is_there(border_name(level, cell), record.borders.0)
            && tiles.all(|(n, tile)| is_there(tile_path(level, cell, n), tile.checksum))
    }

    fn write(
        &self,
        cell: CellId,
        level: u32,
        whole: &Whole,
        boxes: &Boxes,
    ) -> Result<(Vec<TileRecord>, (u64, u64))> {
        let step = self.lattice.step_of(level);
        // Files count from the finest level that is written.
        let name = level - self.finest;
        let scalars = &whole.columns.scalars;
        let form = TileForm { step, packs: self.packs, is_z_up: self.is_z_up, scalars, page: None };
        let mut local = vec![u32::MAX; whole.mesh.positions.len()];
        let mut tiles = Vec::with_capacity(boxes.counts.len());
        let common = common(&whole.mesh.triangles, boxes, whole.shared);
        let mut borders: Vec<TileBorder> = Vec::with_capacity(boxes.counts.len());
        let mut rest = &boxes.order[..];
        for (n, &(key, n_triangles)) in boxes.counts.iter().enumerate() {
            let (own, others) = rest.split_at(n_triangles as usize);
            rest = others;
            let triangles = own.iter().map(|&t| t as usize);
            let Part { mesh, used, inexact } =
                whole.tile(triangles, &self.lattice, level, &mut local);
            let fold = |start: i32, pick: fn(i32, i32) -> i32| {
                let bounds = mesh
                    .positions
                    .iter()
                    .fold([start; 3], |b, p| [0, 1, 2].map(|k| pick(b[k], p[k])));
                bounds.map(|x| f64::from(x) * step)
            };
            let (low, high) = (fold(i32::MAX, i32::min), fold(i32::MIN, i32::max));
            let span = (0..3).map(|k| (high[k] - low[k]) / step).fold(0.0, f64::max);
            if span > MOST_STEPS {
                return Err(Error::bad_input(
                    self.input,
                    format!(
                        "one tile would be {:.3e} wide, with places to {step:.3e}, which its numbers cannot hold: some parts of the mesh lie \
                         too far from the others. Remove those first (stonecut simplify --min-component 100 --ratio 100%); nothing was written",
                        span * step
                    ),
                ));
            }
            let vertices = mesh.positions.len() as u64;
            let by_box = if name > 0 { boxes::bounds_by_box(&mesh) } else { Vec::new() };
            let (bytes, order) = encode_tile(mesh, form);
            let old = order.iter().map(|&v| used[v as usize] as usize);
            let numbered = (0u32..).zip(old).filter(|&(_, v)| common[v]);
            borders.push(numbered.map(|(at, v)| (at, whole.ids[v])).collect());
            self.put(&self.folder.join(tile_path(name, cell, n)), &bytes)?;
            tiles.push(TileRecord {
                key,
                triangles: n_triangles,
                vertices,
                inexact,
                bytes: bytes.len() as u64,
                checksum: xxh3_64(&bytes),
                texel: 0.0,
                low,
                high,
                by_box,
            });
        }
        let bytes = encode_borders(&borders);
        self.put(&self.folder.join(border_name(name, cell)), &bytes)?;
        Ok((tiles, (xxh3_64(&bytes), bytes.len() as u64)))
    }

    fn put(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        put_file(self.disk, path, bytes)?;
        if self.is_output {
            self.disk.disown(bytes.len() as u64);
        }
        Ok(())
    }
}

/// Writes a file and makes its folder if need be; it is not durable yet.
pub fn put_file(disk: &Disk, path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = stonecut_system::disk::folder_of(path);
    if !folder.is_dir() {
        disk.create_dir(folder)?;
    }
    disk.create(path)?.append(bytes)
}

/// The new cell of each triangle of a cell that was put in the order of its boxes: that of the group of the next round
/// that the box lies in. `groups` are sorted.
pub fn next_cells(parts: &[(BoxKey, u64)], groups: &[BoxKey]) -> Vec<CellId> {
    let mut out = Vec::new();
    for &(key, n) in parts {
        let group = group_of(parent_of(key));
        let place = groups.binary_search(&group).expect("made of all boxes");
        out.resize(out.len() + n as usize, CellId::at(place));
    }
    out
}

/// The groups of the next round, sorted, and for each of them its boxes in the order in which `next_cells` brings them.
pub fn next_groups(records: &[GroupRecord]) -> (Vec<BoxKey>, Vec<Vec<(BoxKey, u64)>>) {
    let all = || records.iter().flat_map(|record| &record.parts);
    let mut groups: Vec<BoxKey> = all().map(|(key, _)| group_of(parent_of(*key))).collect();
    groups.sort_unstable();
    groups.dedup();
    let mut parts = vec![Vec::new(); groups.len()];
    for &(key, n) in all() {
        let group = group_of(parent_of(key));
        let cell = groups.binary_search(&group).expect("made of all boxes");
        parts[cell].push((key, n));
    }
    (groups, parts)
}

/// Numbers of triangles, box by box; boxes come in any order, one perhaps in several parts.
fn sorted_order(parts: &[(BoxKey, u64)]) -> Vec<u32> {
    let mut first = 0u32;
    let mut runs: Vec<(BoxKey, u32, u32)> = Vec::with_capacity(parts.len());
    for &(key, n) in parts {
        runs.push((key, first, n as u32));
        first += n as u32;
    }
    runs.sort_unstable();
    runs.iter().flat_map(|&(_, first, n)| first..first + n).collect()
}

fn joined(parts: &[(BoxKey, u64)]) -> Vec<(BoxKey, u64)> {
    let mut sorted = parts.to_vec();
    sorted.sort_unstable();
    let sum = |run: &[(BoxKey, u64)]| (run[0].0, run.iter().map(|(_, n)| n).sum());
    sorted.chunk_by(|a, b| a.0 == b.0).map(sum).collect()
}

/// Diagonal of the bounding box.
fn diagonal(mesh: &Mesh) -> f64 {
    stonecut_mesh::bounds::Bounds::around(&mesh.positions).or_origin().diagonal()
}
