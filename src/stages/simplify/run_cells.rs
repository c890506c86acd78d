//! Runs the kernel on the cells of a round, largest first, and appends what is left of them to a pack.
//!
//! Synced every so often, so that an interrupted round goes on with the cells that it lacks.

use super::memory::cell_bytes;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use stonecut_kernel::{self as kernel, Options, Simplified, Stop};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellMesh, CellStore, SurvivorInfo, SurvivorWriter, Survivors};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};
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

/// The kernel on one cell; gives back what identifies its vertices (the cell without its mesh), too.
pub(super) fn kernel_run(
    mut cell: CellMesh,
    stop: Stop,
    options: &Options,
) -> (CellMesh, Simplified) {
    let options = Options { stop, ..options.clone() };
    let mesh = std::mem::take(&mut cell.mesh);
    let simplified = kernel::simplify_mesh(mesh, &cell.shared, &options);
    (cell, simplified)
}

pub(super) fn drain(cell: CellMesh, stop: Stop, options: &Options, store: &CellStore) -> Survivors {
    let options = Options { estimate: true, ..options.clone() };
    let (cell, simplified) = kernel_run(cell, stop, &options);
    survivors(&cell, simplified, store)
}

/// Encodes the kernel's result for a cell.
pub(super) fn survivors(cell: &CellMesh, simplified: Simplified, store: &CellStore) -> Survivors {
    let mut left =
        Survivors::new(&cell.ids, &cell.shared, &cell.records, simplified, store.layout());
    left.statistics.dropped = cell.dropped;
    left
}

/// Runs `work` on some cells, largest first, as many at once as the memory holds; `work` takes `more` bytes for each triangle of a
/// cell besides.
pub(super) fn for_cells(
    (store, goal): (&CellStore, Goal),
    cells: impl Iterator<Item = CellId>,
    more: u64,
    run: &StageContext,
    work: impl Fn(CellId) -> Result<()> + Sync,
) -> Result<()> {
    let share = goal.triangles as f64 / store.info().triangles.max(1) as f64;
    let bytes = |cell| cell_bytes(store, cell, share) + more * store.info().cells[cell].triangles;
    let jobs = cells.map(|cell| Weighted { item: cell.index(), bytes: bytes(cell) }).collect();
    let announce = |item| store.expect(CellId::at(item));
    let work = |item| work(CellId::at(item));
    largest_first(jobs, run.threads, run.memory_bytes, run.progress, announce, work)
}

/// Runs `work` on some cells without writing anything; outcomes in cell order.
pub(super) fn run_all<T: Send + Clone + Default>(
    (store, goal): (&CellStore, Goal),
    cells: Range<usize>,
    run: &StageContext,
    work: impl Fn(CellId, CellMesh) -> T + Sync,
) -> Result<Vec<T>> {
    let outcomes = Mutex::new(vec![T::default(); cells.len()]);
    for_cells((store, goal), cells.clone().map(CellId::at), 0, run, |cell| {
        let outcome = work(cell, store.load_tidy(cell)?);
        let place = cell.index() - cells.start;
        outcomes.lock().unwrap_or_else(PoisonError::into_inner)[place] = outcome;
        Ok(())
    })?;
    Ok(outcomes.into_inner().unwrap_or_else(PoisonError::into_inner))
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

/// Runs `work` on the cells that are not yet in the round's pack of survivors, and seals the pack.
pub(super) fn run_cells(
    store: &CellStore,
    goal: Goal,
    run: &StageContext,
    work: impl Fn(CellId, CellMesh) -> Survivors + Sync,
) -> Result<SurvivorInfo> {
    run_cells_loading(store, goal, run, |index| Ok(work(index, store.load_tidy(index)?)))
}

/// The same where `work` loads the cell, if it needs to.
pub(super) fn run_cells_loading(
    store: &CellStore,
    goal: Goal,
    run: &StageContext,
    work: impl Fn(CellId) -> Result<Survivors> + Sync,
) -> Result<SurvivorInfo> {
    let frees = frees_sources(store.info().triangles, goal.triangles)
        && store.info().packs.iter().all(|file| run.job.owns(&file.pack));
    run_cells_with((store, goal), (frees, None), run, work)
}

/// The same with work beside: sources stay until the round is over.
pub(super) fn run_cells_beside(
    store: &CellStore,
    goal: Goal,
    beside: Beside,
    run: &StageContext,
    work: impl Fn(CellId, CellMesh) -> Survivors + Sync,
) -> Result<SurvivorInfo> {
    run_cells_with((store, goal), (false, Some(beside)), run, |index| {
        let cell = store.load_tidy(index)?;
        let before = cell.clone();
        let mut left = work(index, cell);
        (beside.look)(index, before, &mut left)?;
        Ok(left)
    })
}

/// `frees`: sources are given back to the file system. Of the cells that are in the pack, those are run again for which
/// the work `beside` is not whole.
fn run_cells_with(
    (store, goal): (&CellStore, Goal),
    (frees, beside): (bool, Option<Beside>),
    run: &StageContext,
    work: impl Fn(CellId) -> Result<Survivors> + Sync,
) -> Result<SurvivorInfo> {
    let name = run.job.name(&format!("round-{}.survivors", goal.round));
    let mut writer = SurvivorWriter::open(run.disk(), run.job.folder(), &name, store.layout())?;
    // Sources are freed as soon as the data is synced, so the name must be durable before that.
    run.disk().sync_folder_of(&run.job.folder().join(&name))?;
    let mut is_done = vec![false; store.n_cells()];
    let finished = writer.finished();
    let earlier = match (&beside, finished.is_empty()) {
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
    let more = beside.map_or(0, |beside| beside.bytes_per_triangle);
    let outcome = for_cells((store, goal), left, more, run, |cell| {
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

/// A panic within `append` may have left half a chunk: nothing may follow it, and no source be freed for it.
fn half_written<T>(_: PoisonError<T>) -> Error {
    Error::Internal("another worker fell while it wrote".to_owned())
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
