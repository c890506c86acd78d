//! Counts in the cells of a store on disk: each cell with itself, and with the cells behind it that it touches.
//!
//! A pair of triangles is looked at in the cell of lower number, against triangles of the other cell that touch its box.
//! Triangles that are large against their cell would blow that box up; they are taken out of the cells and held, batch
//! by batch, against all cells. No more than two cells a thread are in memory.

use super::boxes::Boxes;
use super::{Marks, Numbers, SelfIntersections, Soup, Tally};
use crate::Unit;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellStore, CellTally, load_bytes};
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::{Weighted, largest_first};
use stonecut_system::progress::Progress;
use stonecut_system::units::show_bytes;

/// A triangle that leaves the box of its cell's own corners by this share of the box's longest side is large.
const LARGE: f64 = 0.5;

/// Share of the memory that a batch of large triangles may take.
const LARGE_SHARE: u64 = 4;

/// Fewest large triangles in a batch.
const LEAST_LARGE: u64 = 256;

/// Most of the memory that one bit for every triangle may take: one part in this many.
const MARK_SHARE: u64 = 4;

/// Bytes that a large triangle takes in a batch: corners, three indices, number, box.
fn large_bytes() -> u64 {
    72 + 12 + 8 + Boxes::bytes(1)
}

/// Bytes a triangle that two cells of a job take, at half a vertex a triangle and a record of 40 bytes.
pub fn job_bytes() -> u64 {
    2 * (12 + 80 + Boxes::bytes(1))
}

/// Triangles of a cell, as one pass over all cells has found them.
#[derive(Clone, Copy)]
struct Look {
    /// Triangles within this box are not large.
    frame: Bounds,
    /// The box of those that are not.
    hull: Bounds,
    n_large: u64,
    n_flat: u64,
}

impl Look {
    const NONE: Look = Look { frame: Bounds::EMPTY, hull: Bounds::EMPTY, n_large: 0, n_flat: 0 };

    fn is_large(&self, bounds: &Bounds) -> bool {
        (0..3).any(|k| bounds.low[k] < self.frame.low[k] || bounds.high[k] > self.frame.high[k])
    }
}

/// Work on a store.
struct Work<'a> {
    store: &'a CellStore,
    unit: Unit,
    /// Number of the first triangle of every cell.
    firsts: Vec<u64>,
    looks: Vec<Look>,
    marks: Marks,
    threads: usize,
    memory_bytes: u64,
    progress: &'a Progress,
}

/// Counts in all cells of a store, which hold a mesh within `bounds`.
///
/// Memory: two cells a thread, large triangles in batches, and a bit a triangle; `NoMemory` where the budget does not
/// hold the bits.
pub fn in_store(
    store: &CellStore,
    bounds: &Bounds,
    threads: usize,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<SelfIntersections> {
    let mut n = 0;
    let first = |cell: &CellTally| {
        n += cell.triangles;
        n - cell.triangles
    };
    let firsts: Vec<u64> = store.info().cells.iter().map(first).collect();
    let mark_bytes = n / 8 + 8;
    if mark_bytes > memory_bytes / MARK_SHARE {
        return Err(Error::NoMemory(format!(
            "{n} triangles need {} for a bit each; give more --memory, or leave out --self-intersections",
            show_bytes(MARK_SHARE * mark_bytes)
        )));
    }
    let mut work = Work {
        store,
        unit: Unit::around(bounds),
        firsts,
        looks: vec![Look::NONE; store.n_cells()],
        marks: Marks::new(n),
        threads,
        memory_bytes: memory_bytes - mark_bytes,
        progress,
    };
    work.look()?;
    let mut tally = work.cells()?;
    tally.add(work.large()?);
    let n_flat = work.looks.iter().map(|look| look.n_flat).sum();
    Ok(tally.finish(&work.marks, n_flat))
}

impl Work<'_> {
    /// The places and triangles of a cell, and the ids of its vertices.
    fn load(&self, cell: CellId) -> Result<(Mesh, Vec<GlobalVertex>)> {
        let loaded = self.store.load(cell)?;
        let mut mesh = Mesh::new(loaded.mesh.positions, loaded.mesh.triangles);
        self.unit.turn(&mut mesh);
        Ok((mesh, loaded.ids))
    }

    fn n_triangles(&self, cell: CellId) -> u64 {
        self.store.info().cells[cell].triangles
    }

    /// Bytes of a cell and of the tree over its triangles.
    fn bytes(&self, cell: CellId) -> u64 {
        let tally = self.store.info().cells[cell];
        load_bytes(tally, self.store.layout()) + Boxes::bytes(tally.triangles)
    }

    /// Runs `work` on some cells, in parallel within what is left of the memory.
    fn for_each(
        &self,
        cells: impl Iterator<Item = CellId>,
        bytes: impl Fn(CellId) -> u64,
        taken_bytes: u64,
        work: impl Fn(CellId) -> Result<()> + Sync,
    ) -> Result<()> {
        let jobs = cells.map(|cell| Weighted { item: cell.index(), bytes: bytes(cell) }).collect();
        let left = self.memory_bytes.saturating_sub(taken_bytes);
        let soon = |item| self.store.expect(CellId::at(item));
        let work = |item| work(CellId::at(item));
        largest_first(jobs, self.threads, left, self.progress, soon, work)
    }

    /// Looks at every cell once.
    fn look(&mut self) -> Result<()> {
        let looks = Mutex::new(vec![Look::NONE; self.store.n_cells()]);
        let look = |cell: CellId| {
            let (mesh, ids) = self.load(cell)?;
            // A triangle is in the cell of its corner of lowest id, so these corners are within the cell.
            let mut own = Bounds::EMPTY;
            for t in &mesh.triangles {
                let lowest = t.iter().min_by_key(|&&v| ids[v as usize]).unwrap_or(&t[0]);
                own.add(mesh.positions[*lowest as usize]);
            }
            let margin = LARGE * own.side();
            let frame =
                Bounds { low: own.low.map(|x| x - margin), high: own.high.map(|x| x + margin) };
            let mut look = Look { frame, ..Look::NONE };
            for i in 0..mesh.triangles.len() {
                let corners = mesh.corners(i);
                let bounds = Bounds::around(&corners);
                if super::meeting::is_flat(&corners) {
                    look.n_flat += 1;
                } else if look.is_large(&bounds) {
                    look.n_large += 1;
                } else {
                    look.hull = look.hull.joined(&bounds);
                }
            }
            looks.lock().unwrap_or_else(PoisonError::into_inner)[cell] = look;
            self.progress.add(mesh.triangles.len() as u64);
            Ok(())
        };
        self.for_each(CellId::first(self.store.n_cells()), |cell| self.bytes(cell), 0, look)?;
        self.looks = looks.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(())
    }

    /// The cells behind `cell` that touch it.
    fn neighbours(&self, cell: CellId) -> impl Iterator<Item = CellId> {
        let hull = &self.looks[cell].hull;
        let behind = (cell.index() + 1..self.looks.len()).map(CellId::at);
        behind.filter(move |&other| hull.touches(&self.looks[other].hull))
    }

    /// Counts among the triangles that are not large.
    fn cells(&self) -> Result<Tally> {
        let sum = Mutex::new(Tally::default());
        let bytes = |cell| {
            let guests = self.neighbours(cell).map(|other| self.bytes(other)).max().unwrap_or(0);
            self.bytes(cell) + guests
        };
        self.for_each(CellId::first(self.store.n_cells()), bytes, 0, |cell| {
            let mut tally = Tally::default();
            let own = self.soup(cell, |_, bounds| !self.looks[cell].is_large(bounds))?;
            own.count_all(&self.marks, &mut tally, self.progress)?;
            for other in self.neighbours(cell) {
                let look = &self.looks[other];
                let hull = &own.hull();
                let near = |_, bounds: &Bounds| bounds.touches(hull) && !look.is_large(bounds);
                let guests = self.soup(other, near)?;
                own.count_with(&guests, &self.marks, &mut tally, self.progress)?;
            }
            sum.lock().unwrap_or_else(PoisonError::into_inner).add(tally);
            self.progress.add(self.n_triangles(cell));
            Ok(())
        })?;
        Ok(sum.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// The wanted triangles of a cell.
    fn soup(
        &self,
        cell: CellId,
        is_wanted: impl Fn(usize, &Bounds) -> bool,
    ) -> Result<Soup<'static>> {
        let (mesh, _) = self.load(cell)?;
        let numbers = Numbers::From(self.firsts[cell]);
        Ok(Soup::of(Cow::Owned(mesh), numbers, is_wanted, self.progress)?.0)
    }

    /// Counts the pairs in which at least one triangle is large.
    fn large(&self) -> Result<Tally> {
        let mut tally = Tally::default();
        let n: u64 = self.looks.iter().map(|look| look.n_large).sum();
        let step = (self.memory_bytes / LARGE_SHARE / large_bytes()).max(LEAST_LARGE);
        let mut first = 0;
        while first < n {
            let batch = first..(first + step).min(n);
            first = batch.end;
            let large = self.batch(batch.clone())?;
            large.count_all(&self.marks, &mut tally, self.progress)?;
            tally.add(self.against_cells(&large, batch)?);
        }
        Ok(tally)
    }

    /// Large triangles are numbered cell by cell: the number of the first one of each cell.
    fn large_firsts(&self) -> Vec<u64> {
        let mut n = 0;
        let first = |look: &Look| {
            n += look.n_large;
            n - look.n_large
        };
        self.looks.iter().map(first).collect()
    }

    /// The large triangles of a range of numbers.
    fn batch(&self, range: Range<u64>) -> Result<Soup<'static>> {
        let (mut mesh, mut numbers) = (Mesh::default(), Vec::new());
        for (cell, first) in CellId::first(self.looks.len()).zip(self.large_firsts()) {
            let look = &self.looks[cell];
            if first >= range.end || first + look.n_large <= range.start {
                continue;
            }
            let (loaded, _) = self.load(cell)?;
            let large = (0..loaded.triangles.len()).filter(|&i| self.is_large(cell, &loaded, i));
            for (i, _) in large.zip(first..).filter(|(_, number)| range.contains(number)) {
                let at = mesh.positions.len() as u32;
                mesh.positions.extend(loaded.corners(i));
                mesh.triangles.push([at, at + 1, at + 2]);
                numbers.push(self.firsts[cell] + i as u64);
            }
        }
        Ok(Soup::of(Cow::Owned(mesh), Numbers::List(numbers), |_, _| true, self.progress)?.0)
    }

    fn is_large(&self, cell: CellId, mesh: &Mesh, i: usize) -> bool {
        let corners = mesh.corners(i);
        self.looks[cell].is_large(&Bounds::around(&corners)) && !super::meeting::is_flat(&corners)
    }

    /// Counts the pairs of a large triangle of a batch and one of a cell: one that is not large, or one of a later
    /// batch.
    fn against_cells(&self, large: &Soup, batch: Range<u64>) -> Result<Tally> {
        let sum = Mutex::new(Tally::default());
        let firsts = self.large_firsts();
        let has_later = |cell: CellId| firsts[cell] + self.looks[cell].n_large > batch.end;
        let hull = &large.hull();
        let is_near = |&cell: &CellId| has_later(cell) || self.looks[cell].hull.touches(hull);
        let cells = CellId::first(self.store.n_cells()).filter(is_near);
        let taken = large_bytes() * (batch.end - batch.start);
        self.for_each(
            cells,
            |cell| self.bytes(cell),
            taken,
            |cell| {
                let (mesh, _) = self.load(cell)?;
                let is_large =
                    |i: &usize| self.looks[cell].is_large(&Bounds::around(&mesh.corners(*i)));
                // Those of this batch and of earlier ones are done.
                let is_done = |i: usize| self.is_large(cell, &mesh, i);
                let n_done = batch.end.saturating_sub(firsts[cell]) as usize;
                let done_until = (0..mesh.triangles.len()).filter(|&i| is_done(i)).nth(n_done);
                let done_until = done_until.unwrap_or(usize::MAX);
                let wanted = |i: usize, bounds: &Bounds| {
                    bounds.touches(hull) && (i >= done_until || !is_large(&i))
                };
                let numbers = Numbers::From(self.firsts[cell]);
                let (near, _) = Soup::of(Cow::Borrowed(&mesh), numbers, wanted, self.progress)?;
                let mut tally = Tally::default();
                large.count_with(&near, &self.marks, &mut tally, self.progress)?;
                sum.lock().unwrap_or_else(PoisonError::into_inner).add(tally);
                Ok(())
            },
        )?;
        Ok(sum.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}
