//! The grid before the work: the cell size for a wanted count of triangles, from passes over the vertices alone.
//!
//! Occupied cells become vertices, and a surface has about two triangles a vertex. Cells are counted by sketches, first
//! for a ladder of nested grids, then for three grids near the one that the ladder names.

use super::distinct::Distinct;
use super::grid::CubeGrid;
use std::sync::{Mutex, PoisonError};
use stonecut_io::ply::{MeshSource, VertexBlock};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Triangles for each vertex of a surface.
const TRIANGLES_PER_VERTEX: f64 = 2.0;

/// The first pass aims at this share of the target, which is a maximum.
pub(super) const AIM: f64 = 0.97;

/// Most rungs of the ladder; the finest grid has 2^20 cells along the longest side.
const MOST_RUNGS: usize = 20;
/// Rungs beyond those that an even sheet needs, for meshes that are thin lines in their box.
const SPARE_RUNGS: usize = 5;

/// Vertices of each wanted cell that the ladder looks at, on average, and the largest step between those that it looks at:
/// it only says where to count.
const LADDER_SAMPLES: f64 = 32.0;
const MOST_STEP: f64 = 16.0;

/// Cell sizes that are counted near the one that the ladder names.
const NEAR: [f64; 3] = [0.92, 1.0, 1.08];

/// Wanted size of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// At most this many triangles.
    Triangles(u64),
    /// Cells of this length, in input units.
    CellSize(f64),
}

/// Facts found before the work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survey {
    /// The box of all vertices.
    pub bounds: Bounds,
    /// The chosen grid.
    pub grid: CubeGrid,
    /// Occupied cells, about.
    pub cells: f64,
    /// Rate at which occupied cells grow as the cell size shrinks: 2 for a sheet.
    pub dimension: f64,
}

impl Survey {
    /// Expected triangles of the result.
    pub fn triangles(&self) -> f64 {
        TRIANGLES_PER_VERTEX * self.cells
    }
}

/// Chooses the grid. Reads all vertices two to four times.
///
/// Errors: `Usage` for a cell size that is too small for the box; `BadInput` for a mesh without extent.
pub fn survey(
    source: &MeshSource,
    wanted: Wanted,
    threads: usize,
    progress: &Progress,
) -> Result<Survey> {
    let passes = Passes { source, threads, progress };
    let bounds = passes.bounds()?;
    let extent = sub(bounds.high, bounds.low).into_iter().fold(0.0, f64::max);
    if !(extent > 0.0 && extent.is_finite()) {
        let what =
            "all vertices lie in one place: there is no surface to simplify; nothing was written";
        return Err(Error::bad_input(source.path(), what));
    }
    let grid = |cell_size: f64| CubeGrid::around(&bounds, cell_size);
    let aim = match wanted {
        Wanted::CellSize(cell_size) => {
            let diagonal = length_sq(sub(bounds.high, bounds.low)).sqrt();
            let Some(grid) = grid(cell_size) else {
                return Err(Error::Usage(format!(
                    "--grid {cell_size} is too small for a mesh of {extent} units: more than 2,097,151 cells on an axis; \
                     its diagonal is {diagonal}"
                )));
            };
            let [cells] = passes.cells([grid])?;
            return Ok(Survey { bounds, grid, cells, dimension: 2.0 });
        }
        Wanted::Triangles(n) => (AIM * n as f64 / TRIANGLES_PER_VERTEX).max(1.0),
    };
    let n_rungs = ((aim.log2() / 2.0).ceil() as usize + SPARE_RUNGS).min(MOST_RUNGS);
    let step = (source.n_vertices() as f64 / (LADDER_SAMPLES * aim)).clamp(1.0, MOST_STEP) as usize;
    let counts = passes.ladder(&bounds, extent, n_rungs, step)?;
    let named = |rung: usize, share: f64| extent / (rung as f64 + share).exp2();
    let above = counts.iter().position(|&count| count > aim).unwrap_or(n_rungs);
    let (cell_size, dimension) = match above {
        0 => (extent, 2.0),
        // Even the finest grid has fewer cells: nearly every vertex has its own.
        _ if above == n_rungs => (named(n_rungs - 1, 0.0), 2.0),
        _ => {
            let (low, high) = (counts[above - 1].max(1.0), counts[above]);
            let dimension = (high / low).log2().clamp(0.5, 3.0);
            (named(above - 1, (aim / low).log2() / (high / low).log2()), dimension)
        }
    };
    let near = NEAR.map(|factor| factor * cell_size);
    let grids = near.map(grid);
    let [Some(a), Some(b), Some(c)] = grids else {
        return Err(Error::bad_input(source.path(), "its box is too large for a grid"));
    };
    let cells = passes.cells([a, b, c])?;
    // Between the two whose counts enclose the aim; beyond them along the same line.
    let i = usize::from(cells[1] > aim);
    let rise = (cells[i] / cells[i + 1]).ln();
    let share = if rise > 1e-6 { (cells[i] / aim).ln() / rise } else { 0.5 };
    let share = share.clamp(-2.0, 3.0);
    let chosen = near[i] * (near[i + 1] / near[i]).powf(share);
    let cells = (cells[i].ln() - share * rise).exp();
    let Some(grid) = grid(chosen) else {
        return Err(Error::bad_input(source.path(), "its box is too large for a grid"));
    };
    Ok(Survey { bounds, grid, cells, dimension })
}

/// Passes over the vertices.
struct Passes<'a> {
    source: &'a MeshSource,
    threads: usize,
    progress: &'a Progress,
}

impl Passes<'_> {
    /// Calls `each` with every block of records, on any thread.
    fn blocks<T: Default + Send>(
        &self,
        each: impl Fn(&[u8], &mut T) + Sync,
        mut done: impl FnMut(&mut T),
    ) -> Result<()> {
        let n_blocks = self.source.n_vertex_blocks();
        in_order(
            n_blocks,
            self.threads,
            self.progress,
            |index, (block, out): &mut (VertexBlock, T)| {
                self.source.read_vertices(index, block)?;
                each(&block.records, out);
                Ok(())
            },
            |_, (_, out)| {
                done(out);
                Ok(())
            },
        )
    }

    fn bounds(&self) -> Result<Bounds> {
        let schema = self.source.schema();
        let record_bytes = schema.record_bytes();
        let mut all = Bounds::EMPTY;
        self.blocks(
            |records, bounds: &mut Option<Bounds>| {
                let mut found = Bounds::EMPTY;
                for record in records.chunks_exact(record_bytes) {
                    found.add(schema.position(record));
                }
                *bounds = Some(found);
            },
            |bounds| {
                if let Some(found) = bounds.filter(|found| !found.is_empty()) {
                    all.add(found.low);
                    all.add(found.high);
                }
            },
        )?;
        Ok(all)
    }

    /// Occupied cells of each grid.
    fn cells<const N: usize>(&self, grids: [CubeGrid; N]) -> Result<[f64; N]> {
        let schema = self.source.schema();
        let record_bytes = schema.record_bytes();
        let pool = SketchPool::new(N);
        self.blocks(
            |records, (): &mut ()| {
                let mut sketches = pool.take();
                let mut last = [u64::MAX; N];
                for record in records.chunks_exact(record_bytes) {
                    let position = schema.position(record);
                    for (k, grid) in grids.iter().enumerate() {
                        let key = CubeGrid::key(grid.place(position));
                        if key != last[k] {
                            last[k] = key;
                            sketches[k].add(key);
                        }
                    }
                }
                pool.put(sketches);
            },
            |()| {},
        )?;
        let counts = pool.counts();
        Ok(std::array::from_fn(|k| counts[k]))
    }

    /// Cells of `n_rungs` grids that hold one of every `step` vertices; each has sides half as long as the one before, the first
    /// is one cell or a few.
    fn ladder(
        &self,
        bounds: &Bounds,
        extent: f64,
        n_rungs: usize,
        step: usize,
    ) -> Result<Vec<f64>> {
        let schema = self.source.schema();
        let record_bytes = schema.record_bytes();
        let finest = extent / ((n_rungs - 1) as f64).exp2();
        let Some(grid) = CubeGrid::around(bounds, finest) else { return Ok(vec![0.0; n_rungs]) };
        let pool = SketchPool::new(n_rungs);
        self.blocks(
            |records, (): &mut ()| {
                let mut sketches = pool.take();
                let mut last = [u64::MAX; MOST_RUNGS];
                for record in records.chunks_exact(record_bytes).step_by(step) {
                    let mut key = CubeGrid::key(grid.place(schema.position(record)));
                    // Where a cell is the last one, so are all that hold it.
                    for rung in (0..n_rungs).rev() {
                        if key == last[rung] {
                            break;
                        }
                        last[rung] = key;
                        sketches[rung].add(key);
                        key = CubeGrid::parent(key);
                    }
                }
                pool.put(sketches);
            },
            |()| {},
        )?;
        Ok(pool.counts())
    }
}

/// Sketches that threads take and put back; there are as many sets as threads at most.
struct SketchPool {
    n: usize,
    free: Mutex<Vec<Vec<Distinct>>>,
}

impl SketchPool {
    fn new(n: usize) -> Self {
        SketchPool { n, free: Mutex::default() }
    }

    fn take(&self) -> Vec<Distinct> {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        free.unwrap_or_else(|| vec![Distinct::default(); self.n])
    }

    fn put(&self, sketches: Vec<Distinct>) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(sketches);
    }

    /// The count of each sketch, over all sets.
    fn counts(self) -> Vec<f64> {
        let sets = self.free.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut all = vec![Distinct::default(); self.n];
        for set in &sets {
            all.iter_mut().zip(set).for_each(|(all, part)| all.merge(part));
        }
        all.iter().map(Distinct::count).collect()
    }
}
