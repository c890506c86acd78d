//! A round over cells: runs the kernel on them, largest first, and appends what is left of them to a pack.
//!
//! Synced every so often, so that an interrupted round goes on with the cells that it lacks.

use super::memory::cell_bytes;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use stonecut_kernel::{self as kernel, Options, Simplified, Stop};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    CellMesh, CellStore, SurvivorInfo, SurvivorWriter, Survivors, half_written,
};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;
use stonecut_system::parallel::{Weighted, largest_first};

/// Part of the store that is synced at a time where sources are given back, so that sources and survivors
/// never lie side by side.
pub const FREED_AT_A_TIME: u64 = 16;

/// Sources are kept until the round is over if it leaves less than one triangle in this many.
const KEEP_SOURCES: u64 = 16;

/// Goal of one round of simplification.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// 0 for the first round.
    pub round: u32,
    /// Triangles wanted in all cells together; met within some percent.
    pub triangles: u64,
}

/// True if a round gives the source of a cell back to the file system as soon as the cell is done: where the
/// simplified cells take more space, so that store and survivors would not fit side by side into what the job promises.
/// Thousands of holes in a file cost time otherwise well spent.
pub fn frees_sources(triangles_in: u64, goal_triangles: u64) -> bool {
    goal_triangles > triangles_in / KEEP_SOURCES
}

/// Work that is done with every cell beside its simplification, on files that are not the job's.
#[derive(Clone, Copy)]
pub struct Beside<'a> {
    /// Memory that it takes, in bytes for each triangle of the cell.
    pub bytes_per_triangle: u64,
    /// True if all that an earlier run did for a cell is still there; it is done again if not.
    pub is_whole: &'a (dyn Fn(CellId, &Survivors) -> Result<bool> + Sync),
    /// Looks at a cell as it was loaded and at what is left of it, and may put the latter into another order.
    pub look: &'a (dyn Fn(CellId, CellMesh, &mut Survivors) -> Result<()> + Sync),
}

/// A round over the cells of a store.
#[derive(Clone, Copy)]
pub struct CellRun<'a> {
    /// The cells.
    pub store: &'a CellStore,
    /// Goal of the round.
    pub goal: Goal,
    /// Options of the kernel.
    pub options: &'a Options,
    /// Work beside the simplification; sources of cells then stay until the round is over.
    pub beside: Option<Beside<'a>>,
    /// The job, its threads and its memory.
    pub context: &'a StageContext<'a>,
}

impl CellRun<'_> {
    /// Share of the triangles that the round is to leave.
    pub(super) fn share(&self) -> f64 {
        self.goal.triangles as f64 / self.store.info().triangles.max(1) as f64
    }

    /// The options of the round: its cells are fitted where the job ends with a fit, and tell the next round of the original.
    pub(super) fn fitted(&self) -> Options {
        let is_fitted = self.goal.round > 0 || self.options.fits_first_round;
        let keeps_relief = is_fitted && self.store.layout().has_relief;
        let expected_share = if is_fitted { self.share() } else { 0.0 };
        Options { expected_share, keeps_relief, ..self.options.clone() }
    }

    /// The options of the kernel for a cell that is simplified until `stop`.
    pub(super) fn until(&self, stop: Stop) -> Options {
        Options { stop, estimate: true, ..self.options.clone() }
    }

    /// Simplifies a cell until `stop`.
    pub(super) fn drain(&self, mut cell: CellMesh, stop: Stop) -> Survivors {
        let mesh = std::mem::take(&mut cell.mesh);
        let simplified = kernel::simplify_mesh(mesh, &cell.shared, &self.until(stop));
        self.survivors(&cell, simplified)
    }

    /// Encodes the kernel's result for a cell.
    pub(super) fn survivors(&self, cell: &CellMesh, simplified: Simplified) -> Survivors {
        let layout = self.store.layout();
        let mut left = Survivors::new(&cell.ids, &cell.shared, &cell.records, simplified, layout);
        left.statistics.dropped = cell.dropped;
        left
    }

    /// Runs `work` on some cells, largest first, as many at once as the memory holds.
    pub(super) fn for_each(
        &self,
        cells: impl Iterator<Item = CellId>,
        work: impl Fn(CellId) -> Result<()> + Sync,
    ) -> Result<()> {
        let CellRun { store, beside, context, .. } = self;
        let more = beside.map_or(0, |beside| beside.bytes_per_triangle);
        let share = self.share();
        let weighted = |cell: CellId| Weighted {
            item: cell.index(),
            bytes: cell_bytes(store, cell, share) + more * store.info().cells[cell].triangles,
        };
        let jobs = cells.map(weighted).collect();
        let announce = |item| store.expect(CellId::at(item));
        let work = |item| work(CellId::at(item));
        let StageContext { threads, memory_bytes, progress, .. } = **context;
        largest_first(jobs, threads, memory_bytes, progress, announce, work)
    }

    /// Runs `work` on some cells without writing anything; outcomes in cell order.
    pub(super) fn outcomes<T: Send + Clone + Default>(
        &self,
        cells: Range<usize>,
        work: impl Fn(CellId, CellMesh) -> T + Sync,
    ) -> Result<Vec<T>> {
        let outcomes = Mutex::new(vec![T::default(); cells.len()]);
        self.for_each(cells.clone().map(CellId::at), |cell| {
            let outcome = work(cell, self.store.load_tidy(cell)?);
            let place = cell.index() - cells.start;
            outcomes.lock().unwrap_or_else(PoisonError::into_inner)[place] = outcome;
            Ok(())
        })?;
        Ok(outcomes.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs `work` on the cells that are not yet in the round's pack of survivors, and seals the pack. Of the cells that are
    /// in it, those are run again for which the work beside is not whole.
    pub(super) fn write(
        &self,
        work: impl Fn(CellId) -> Result<Survivors> + Sync,
    ) -> Result<SurvivorInfo> {
        let CellRun { store, goal, beside, context: run, .. } = self;
        let frees = beside.is_none()
            && frees_sources(store.info().triangles, goal.triangles)
            && store.info().packs.iter().all(|file| run.job.owns(&file.pack));
        let name = run.job.name(&format!("round-{}.survivors", goal.round));
        let mut writer = SurvivorWriter::open(run.disk(), run.job.folder(), &name, store.layout())?;
        // Sources are freed as soon as the data is synced, so the name must be durable before that.
        run.disk().sync_folder_of(&run.job.folder().join(&name))?;
        let mut is_done = vec![false; store.n_cells()];
        let finished = writer.finished();
        let earlier = match (beside, finished.is_empty()) {
            (Some(beside), false) => Some((beside, writer.reader(run.disk(), store.n_cells())?)),
            _ => None,
        };
        for cell in finished {
            let is_whole = || match &earlier {
                Some((beside, pack)) => (beside.is_whole)(cell, &pack.load(cell)?),
                None => Ok(true),
            };
            if let Some(done) = is_done.get_mut(cell.index())
                && !*done
                && is_whole()?
            {
                *done = true;
                run.progress.add(store.info().cells[cell].triangles);
            }
        }
        let synced_at = Instant::now();
        let (unsynced, synced_bytes) = (Vec::new(), writer.length());
        let output = Mutex::new(Output { writer, frees, unsynced, synced_bytes, synced_at });
        let freed_bytes = store.info().pack_bytes() / FREED_AT_A_TIME;
        let left = CellId::first(store.n_cells()).filter(|&cell| !is_done[cell]);
        let outcome = self.for_each(left, |cell| {
            let survivors = work(cell)?;
            // Before the lock: others wait for nothing but the file.
            let encoded = survivors.encode(store.layout());
            let mut output = output.lock().map_err(half_written)?;
            output.writer.append_encoded(cell, &survivors, &encoded)?;
            output.unsynced.push(cell);
            run.progress.add(store.info().cells[cell].triangles);
            let is_much = output.writer.length() - output.synced_bytes >= freed_bytes;
            if output.synced_at.elapsed() >= run.checkpoint_every || (frees && is_much) {
                output.sync(store)?;
            }
            Ok(())
        });
        let mut output = match output.into_inner() {
            Ok(output) => output,
            // The panic that poisoned it is the outcome.
            Err(poisoned) => return Err(outcome.err().unwrap_or_else(|| half_written(poisoned))),
        };
        // Also after a failure or a signal: what is done stays done.
        let synced = output.sync(store);
        outcome.and(synced)?;
        output.writer.finish(run.disk(), run.job.folder(), 0..store.n_cells())
    }
}

struct Output {
    writer: SurvivorWriter,
    /// True if sources of cells are given back to the file system.
    frees: bool,
    /// Cells appended since the last sync; their sources are still needed.
    unsynced: Vec<CellId>,
    /// Length of the pack at the last sync.
    synced_bytes: u64,
    synced_at: Instant,
}

impl Output {
    /// Makes finished cells durable, then frees what they came from if that is worth it.
    fn sync(&mut self, store: &CellStore) -> Result<()> {
        self.writer.sync()?;
        for cell in self.unsynced.drain(..) {
            if self.frees {
                store.free(cell)?;
            }
        }
        self.synced_bytes = self.writer.length();
        self.synced_at = Instant::now();
        Ok(())
    }
}
