//! The pass over the faces: each triangle goes into the sums of the cells of its corners, and stays if these are three.
//!
//! Blocks of the file are summed by themselves, on any thread, and merged in the order of the file, so that no sum of
//! floats depends on threads or memory.

use super::grid::CubeGrid;
use crate::key_table::KeyTable;
use crate::positions::{Held, Positions};
use crate::sums::{CellSums, Term};
use stonecut_io::ply::{FaceBlock, MeshSource};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// The outcome of a pass.
pub(super) struct Clustered {
    /// Occupied cells, in the order in which triangles came to them.
    pub(super) cells: KeyTable<u64>,
    /// Sums of each cell.
    pub(super) sums: Vec<CellSums>,
    /// Triangles between three cells.
    pub(super) triangles: TriangleSet,
    /// Triangles that lay in one or two cells.
    pub(super) n_collapsed: u64,
    /// Triangles between three cells, repeated ones included.
    pub(super) n_between: u64,
    /// Faces of the file without three different corners.
    pub(super) n_degenerate: u64,
    /// Broken faces that were dropped on request.
    pub(super) n_bad: u64,
}

impl Clustered {
    /// Memory for `n_cells` cells and twice as many triangles, in bytes.
    pub(super) fn bytes(n_cells: u64) -> u64 {
        let cells = KeyTable::<u64>::bytes(n_cells) + n_cells * size_of::<CellSums>() as u64;
        cells + TriangleSet::bytes(2 * n_cells)
    }
}

/// Triangles by their corners in any order; orientations are counted against each other.
#[derive(Default)]
pub(super) struct TriangleSet {
    table: KeyTable<[u32; 3]>,
    /// Triangles of even minus those of odd order of their corners.
    net: Vec<i32>,
}

impl TriangleSet {
    fn with_room(n: usize) -> Self {
        TriangleSet { table: KeyTable::with_room(n), net: Vec::with_capacity(n) }
    }

    fn bytes(n: u64) -> u64 {
        KeyTable::<[u32; 3]>::bytes(n) + 4 * n
    }

    /// Adds `net` triangles in this order of corners.
    #[inline]
    fn add(&mut self, [a, b, c]: [u32; 3], net: i32) {
        let (a, b, net) = if a > b { (b, a, -net) } else { (a, b, net) };
        let (b, c, net) = if b > c { (c, b, -net) } else { (b, c, net) };
        let (a, b, net) = if a > b { (b, a, -net) } else { (a, b, net) };
        let number = self.table.number([a, b, c]) as usize;
        match self.net.get_mut(number) {
            Some(sum) => *sum = sum.wrapping_add(net),
            None => self.net.push(net),
        }
    }

    fn clear(&mut self) {
        self.table.clear();
        self.net.clear();
    }

    fn iter(&self) -> impl Iterator<Item = ([u32; 3], i32)> + '_ {
        self.table.keys().iter().copied().zip(self.net.iter().copied())
    }

    /// Number of triangles.
    pub(super) fn len(&self) -> usize {
        self.net.len()
    }

    /// Every triangle once, in the orientation of most of those that fell on it; either, where both are equal. And which
    /// those are, and the number of fins, which are left out.
    ///
    /// A fin is a triangle with a front and a back that hangs by one edge on an unfolded one: the surface was folded there,
    /// and nothing is lost without it. Folded triangles that hang together are a thin sheet, one alone is a speck: they stay.
    pub(super) fn without_fins(&self) -> (Vec<[u32; 3]>, Vec<u32>, u64) {
        let edges = |[a, b, c]: [u32; 3]| {
            [(a, b), (b, c), (a, c)].map(|(low, high)| u64::from(low) | u64::from(high) << 32)
        };
        // The edges of folded triangles, and the triangles at each.
        let mut folded = KeyTable::<u64>::default();
        let mut n_users = Vec::new();
        for (corners, _) in self.iter().filter(|(_, net)| *net == 0) {
            edges(corners).into_iter().for_each(|edge| _ = folded.number(edge));
        }
        // Of each edge all triangles, and those that are not folded.
        n_users.resize(folded.keys().len(), (0u32, 0u32));
        for (corners, net) in self.iter() {
            for edge in edges(corners) {
                if let Some(number) = folded.find(edge) {
                    let (all, unfolded) = &mut n_users[number as usize];
                    *all += 1;
                    *unfolded += u32::from(net != 0);
                }
            }
        }
        let users = |edge: u64| folded.find(edge).map_or((0, 0), |number| n_users[number as usize]);
        let mut n_fins = 0;
        let mut kept = Vec::with_capacity(self.len());
        let mut two_sided = Vec::new();
        for ([a, b, c], net) in self.iter() {
            let of_edges = edges([a, b, c]).map(users);
            let n_free = of_edges.iter().filter(|(all, _)| *all == 1).count();
            let is_fin =
                net == 0 && n_free == 2 && of_edges.iter().any(|(_, unfolded)| *unfolded > 0);
            if is_fin {
                n_fins += 1;
                continue;
            }
            if net == 0 {
                two_sided.push(kept.len() as u32);
            }
            kept.push(if net < 0 { [a, c, b] } else { [a, b, c] });
        }
        (kept, two_sided, n_fins)
    }

    /// Triangles on which as many fell in one orientation as in the other: folded sheets.
    pub(super) fn n_folded(&self) -> u64 {
        self.net.iter().filter(|&&net| net == 0).count() as u64
    }
}

/// The sums of one block of faces.
struct Batch {
    faces: FaceBlock,
    held: Held,
    cells: KeyTable<u64>,
    sums: Vec<CellSums>,
    triangles: TriangleSet,
    n_collapsed: u64,
    n_between: u64,
    last: (u64, u32),
}

impl Default for Batch {
    fn default() -> Self {
        Batch {
            faces: FaceBlock::default(),
            held: Held::default(),
            cells: KeyTable::default(),
            sums: Vec::new(),
            triangles: TriangleSet::default(),
            n_collapsed: 0,
            n_between: 0,
            last: (u64::MAX, 0),
        }
    }
}

/// Memory of a block of faces on its way, in bytes, where blocks have `cells` cells.
pub(super) fn batch_bytes(rows: u64, face_bytes: u64, cells: u64) -> u64 {
    rows * (24 + face_bytes) + Clustered::bytes(cells)
}

impl Batch {
    fn clear(&mut self) {
        self.cells.clear();
        self.sums.clear();
        self.triangles.clear();
        (self.n_collapsed, self.n_between) = (0, 0);
        self.last = (u64::MAX, 0);
    }

    /// The number of a cell within the block.
    #[inline(always)]
    fn cell(&mut self, key: u64) -> u32 {
        if self.last.0 == key {
            return self.last.1;
        }
        let number = self.cells.number(key);
        if number as usize == self.sums.len() {
            self.sums.push(CellSums::default());
        }
        self.last = (key, number);
        number
    }

    #[inline(always)]
    fn add(&mut self, places: [[f64; 3]; 3]) {
        let keys = places.map(CubeGrid::key);
        let term = Term::new(places);
        if keys[0] == keys[1] && keys[1] == keys[2] {
            let cell = self.cell(keys[0]);
            self.sums[cell as usize].add_whole(&term, CubeGrid::centre(keys[0]));
            self.n_collapsed += 1;
            return;
        }
        let mut cells = [0; 3];
        for k in 0..3 {
            cells[k] = self.cell(keys[k]);
            let is_first = !keys[..k].contains(&keys[k]);
            if is_first {
                let inside = keys.map(|key| key == keys[k]);
                self.sums[cells[k] as usize].add_part(&term, CubeGrid::centre(keys[k]), inside);
            }
        }
        if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
            self.n_collapsed += 1;
        } else {
            self.n_between += 1;
            self.triangles.add(cells, 1);
        }
    }
}

/// Passes over all faces; room is made for `n_cells` cells first.
pub(super) fn pass(
    source: &MeshSource,
    positions: &Positions,
    grid: &CubeGrid,
    n_cells: usize,
    threads: usize,
    progress: &Progress,
) -> Result<Clustered> {
    let mut done = Clustered {
        cells: KeyTable::with_room(n_cells),
        sums: Vec::with_capacity(n_cells),
        triangles: TriangleSet::with_room(2 * n_cells),
        n_collapsed: 0,
        n_between: 0,
        n_degenerate: 0,
        n_bad: 0,
    };
    let mut numbers = Vec::new();
    in_order(
        source.n_face_blocks(),
        threads,
        progress,
        |index, batch: &mut Batch| {
            batch.clear();
            let mut faces = std::mem::take(&mut batch.faces);
            let mut held = std::mem::take(&mut batch.held);
            source.read_faces(index, &mut faces)?;
            for &[a, b, c] in &faces.triangles {
                let a = grid.place(positions.get(&mut held, a)?);
                let b = grid.place(positions.get(&mut held, b)?);
                let c = grid.place(positions.get(&mut held, c)?);
                batch.add([a, b, c]);
            }
            (batch.faces, batch.held) = (faces, held);
            Ok(())
        },
        |_, batch| {
            numbers.clear();
            for (&key, sums) in batch.cells.keys().iter().zip(&batch.sums) {
                let number = done.cells.number(key);
                match done.sums.get_mut(number as usize) {
                    Some(all) => all.merge(sums),
                    None => done.sums.push(*sums),
                }
                numbers.push(number);
            }
            for (corners, net) in batch.triangles.iter() {
                done.triangles.add(corners.map(|cell| numbers[cell as usize]), net);
            }
            done.n_collapsed += batch.n_collapsed;
            done.n_between += batch.n_between;
            done.n_degenerate += batch.faces.n_degenerate;
            done.n_bad += batch.faces.n_bad;
            progress.add(batch.n_collapsed + batch.n_between);
            Ok(())
        },
    )?;
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::TriangleSet;

    #[test]
    fn a_triangle_has_the_orientation_of_most() {
        let mut set = TriangleSet::default();
        set.add([5, 2, 9], 1);
        set.add([9, 5, 2], 1);
        set.add([2, 5, 9], 1);
        // A fin on the edge 2, 9; and two folded triangles that hang together.
        set.add([2, 9, 4], 1);
        set.add([9, 2, 4], 1);
        for sheet in [[10, 11, 12], [12, 11, 13]] {
            set.add(sheet, 1);
            set.add([sheet[1], sheet[0], sheet[2]], 1);
        }
        set.add([10, 11, 14], 1);
        set.add([12, 13, 14], 1);
        // A speck.
        set.add([20, 21, 22], 1);
        set.add([21, 20, 22], 1);
        // 5, 2, 9 is odd: the cycle 2, 9, 5.
        let kept =
            vec![[2, 9, 5], [10, 11, 12], [11, 12, 13], [10, 11, 14], [12, 13, 14], [20, 21, 22]];
        assert_eq!(set.without_fins(), (kept, vec![1, 2, 5], 1));
        assert_eq!((set.len(), set.n_folded()), (7, 4));
    }
}
