//! Stage between partition and the first round: finds the components of the mesh, and which of them are too
//! small to stay.
//!
//! Each cell finds its pieces by itself (`found`, parallel); pieces that touch other cells are joined by the
//! places of shared vertices (`join`, `stars`), with sorts that keep to the memory budget whatever the mesh is
//! like. The outcome is a store that leaves small components out when it loads a cell: no later stage knows
//! of them. Connected means by vertices or by places; it never looks at edges.

mod found;
mod join;
mod sizes;
mod stars;

pub use sizes::{Below, ComponentSizes, Least, below_list, sizes_in_memory};

use found::{FOUND_NAME, Found};
use join::VERDICTS_NAME;
use serde::{Deserialize, Serialize};
use std::sync::Mutex;
use std::time::Instant;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    CellStore, PackFile, PackWriter, Pieces, StoreInfo, half_written, load_bytes,
};
use stonecut_store::pack_format::ChunkKind;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;
use stonecut_system::parallel::{Weighted, largest_first};

/// Bytes a vertex for pieces and their sizes, besides the loaded cell: number, table of places, and a piece of
/// its own at worst; and for its link, listed and encoded.
const PIECE_BYTES: u64 = 72 + 60;

/// Sizes of the components, and the store without those that are too small.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Components {
    /// Sizes of the components, and what was left out.
    pub sizes: ComponentSizes,
    /// The same cells, without the small components.
    pub store: StoreInfo,
}

/// Bytes that the stage writes for each shared vertex of a cell: its place in a pack, and in a sort.
pub const LINK_BYTES: u64 = 64;

/// Finds the components of all cells together and leaves out those below `least`.
///
/// Memory: cells as the budget holds them, then sorts within it. Disk: `LINK_BYTES` for each vertex that a cell
/// shares, 120 bytes for each piece that touches another cell. An interrupted run keeps the cells it has seen.
pub fn find(store: &CellStore, least: Least, run: &StageContext) -> Result<Components> {
    let mut pack = see_cells(store, least, run)?;
    let found = pack.reader(run.disk(), store.n_cells())?;
    let joined = join::join(&found, store, least, run)?;
    let mut info = StoreInfo { cells: joined.cells, ..store.info().clone() };
    info.triangles = info.cells.iter().map(|cell| cell.triangles).sum();
    if joined.pack_bytes > 0 {
        let pack = run.job.name(VERDICTS_NAME);
        info.verdicts = Some(PackFile { pack, pack_bytes: joined.pack_bytes });
    }
    Ok(Components { sizes: joined.sizes, store: info })
}

/// Removes what only `find` needs, once its outcome is sealed.
pub fn tidy_up(run: &StageContext) -> Result<()> {
    run.disk().remove(&run.job.path(FOUND_NAME))
}

struct Output {
    pack: PackWriter,
    synced_at: Instant,
}

/// Notes what each cell knows by itself, but for those that an earlier run has noted.
fn see_cells(store: &CellStore, least: Least, run: &StageContext) -> Result<PackWriter> {
    let path = run.job.path(FOUND_NAME);
    let pack = match path.exists() {
        true => PackWriter::reopen(run.disk(), &path)?,
        false => PackWriter::create(run.disk(), &path)?,
    };
    run.disk().sync_folder_of(&path)?;
    let mut is_done = vec![false; store.n_cells()];
    for chunk in pack.chunks() {
        if let Some(done) = is_done.get_mut(chunk.cell.index()) {
            *done = true;
            run.progress.add(store.info().cells[chunk.cell].triangles);
        }
    }
    let jobs = (0..store.n_cells())
        .filter(|&cell| !is_done[cell])
        .map(|item| {
            let tally = store.info().cells[item];
            let bytes = load_bytes(tally, store.layout()) + PIECE_BYTES * tally.vertices;
            Weighted { item, bytes }
        })
        .collect();
    let output = Mutex::new(Output { pack, synced_at: Instant::now() });
    let announce = |item| store.expect(CellId::at(item));
    let outcome =
        largest_first(jobs, run.threads, run.memory_bytes, run.progress, announce, |item| {
            let cell = CellId::at(item);
            let mesh = store.load(cell)?;
            let pieces = Pieces::find(&mesh.mesh);
            let note = Found::new(&mesh, &pieces, store.is_part(cell), least).encode();
            drop(mesh);
            let mut output = output.lock().map_err(half_written)?;
            output.pack.append(cell, ChunkKind::Found, &note)?;
            output.pack.flush()?;
            if output.synced_at.elapsed() >= run.checkpoint_every {
                output.pack.sync()?;
                output.synced_at = Instant::now();
            }
            run.progress.add(store.info().cells[cell].triangles);
            Ok(())
        });
    let mut output = match output.into_inner() {
        Ok(output) => output,
        Err(poisoned) => return Err(outcome.err().unwrap_or_else(|| half_written(poisoned))),
    };
    let synced = output.pack.sync();
    outcome.and(synced)?;
    Ok(output.pack)
}
