//! Finds the vertices that triangles of a cell use and the cell does not hold, where no table holds all cells.

use super::halo::{Foreign, Gathering};
use super::passes::Passes;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{IdMap, Pack, PackWriter};
use stonecut_store::pack_format::ChunkKind;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;

/// Vertices of a cell that are looked up at a time to find what it misses, 24 bytes each; cells denser than
/// planned may hold any number.
const OWN_ROWS: usize = 1 << 20;

/// Rows of missing vertices after which repeats among them are dropped.
const MISSING_ROWS: usize = 250_000;

impl Passes<'_> {
    /// Adds the vertices that triangles of each cell use and the cell does not hold.
    ///
    /// Memory: 24 bytes for each of `OWN_ROWS` vertices, and some MiB of missing ones, a thread.
    pub(super) fn missing(&self, foreign: &mut Gathering<'_>, pack: &mut PackWriter) -> Result<()> {
        let run = self.run;
        let n_cells = self.tally.len();
        let reader = pack.reader(run.disk(), n_cells)?;
        in_order(
            n_cells as u64,
            self.shares.threads,
            run.progress,
            |cell, out: &mut Vec<Foreign>| {
                out.clear();
                self.missing_of(&reader, CellId::at(cell as usize), out)
            },
            |_, found| foreign.add(found, pack),
        )
    }

    /// Adds what one cell misses, sorted: a stretch of that cell's vertices at a time, which come in ascending order.
    fn missing_of(&self, reader: &Pack, cell: CellId, out: &mut Vec<Foreign>) -> Result<()> {
        let ids = self.layout.ids;
        let row_bytes = ids.bytes + self.layout.schema.record_bytes();
        let chunks = |kind| reader.chunks_of(cell).iter().filter(move |chunk| chunk.kind == kind);
        let n_own = self.tally[cell].vertices as usize;
        let mut payload = Vec::new();
        let mut sorted_up_to = 0;
        // Ids below it were looked up in an earlier stretch.
        let mut from = GlobalVertex(0);
        for stretch in 0..n_own.div_ceil(OWN_ROWS).max(1) {
            let rows = stretch * OWN_ROWS..(stretch + 1) * OWN_ROWS;
            let mut map = IdMap::with_capacity(n_own.min(OWN_ROWS));
            let mut own: Vec<GlobalVertex> = Vec::with_capacity(n_own.min(OWN_ROWS));
            let mut at = 0;
            for chunk in chunks(ChunkKind::Vertices) {
                let n = chunk.bytes as usize / row_bytes;
                if at < rows.end && rows.start < at + n {
                    reader.read(chunk, &mut payload)?;
                    let found = (at..).zip(payload.chunks_exact(row_bytes));
                    for (_, row) in found.filter(|(i, _)| rows.contains(i)) {
                        map.insert(ids.read(row), &mut own);
                    }
                }
                at += n;
            }
            let is_last = rows.end >= n_own;
            let end = own.last().filter(|_| !is_last);
            let end = end.map_or(GlobalVertex(u64::MAX), |last| GlobalVertex(last.0 + 1));
            for chunk in chunks(ChunkKind::Triangles) {
                self.run.progress.check()?;
                reader.read(chunk, &mut payload)?;
                for corner in payload.chunks_exact(ids.bytes) {
                    let id = ids.read(corner);
                    if (from..end).contains(&id) && map.get(id, &own).is_none() {
                        out.push((id, cell));
                    }
                }
                if out.len() > 2 * sorted_up_to + MISSING_ROWS {
                    out.sort_unstable();
                    out.dedup();
                    sorted_up_to = out.len();
                }
            }
            from = end;
        }
        out.sort_unstable();
        out.dedup();
        Ok(())
    }
}
