//! The passes over the faces: triangles go to their cells, and the corners that lie elsewhere are noted.

use super::cell_table::CellTable;
use super::checkpoint::{Pass, ResumePoint};
use super::halo::{Gathering, Halo};
use super::passes::{Passes, at_window};
use super::sorted::Sorted;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{PackWriter, Scatter};
use stonecut_store::pack_format::ChunkKind;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;

impl<'a> Passes<'a> {
    /// Sends every triangle to the cell of its corner of lowest index; finds the corners that lie elsewhere.
    ///
    /// While the table holds all vertices that takes one pass over the faces. Otherwise each window takes a
    /// pass for the triangles whose lowest corner it knows, and the cells tell afterwards what they miss.
    pub(super) fn triangles(
        &mut self,
        table: CellTable<'a>,
        foreign: &mut Gathering<'_>,
        pack: &mut PackWriter,
    ) -> Result<()> {
        let mut scatter = self.buffers(ChunkKind::Triangles);
        let n_vertices = self.source.n_vertices();
        let is_whole = table.first == 0 && table.len() >= n_vertices;
        let mut table = table;
        loop {
            let found = is_whole.then_some(&mut *foreign);
            self.triangles_of(&table, found, &mut scatter, pack)?;
            let next = table.first + table.len();
            if next >= n_vertices {
                break;
            }
            drop(table);
            table = self.window(next, n_vertices - next)?;
            self.place = at_window(&table);
        }
        drop(table);
        scatter.finish(pack)?;
        if !is_whole {
            self.missing(foreign, pack)?;
        }
        self.place = ResumePoint {
            pass: Pass::Shared,
            dropped: self.place.dropped,
            ..ResumePoint::default()
        };
        if self.checkpoints.is_due() {
            foreign.note(pack)?;
            self.checkpoints.seal(self.place, pack)?;
        }
        Ok(())
    }

    /// `foreign` and what has been noted in the pack.
    pub(super) fn halo(&self, foreign: Gathering<'_>, pack: &mut PackWriter) -> Result<Halo> {
        let is_noted = pack.chunks().iter().any(|chunk| chunk.kind == ChunkKind::Foreign);
        let reader = match is_noted {
            true => Some(pack.reader(self.run.disk(), self.tally.len())?),
            false => None,
        };
        let noted = reader.as_ref().map(|reader| (reader, CellId(0)));
        foreign.finish(noted, self.run.job.folder())
    }

    /// Sends the triangles whose lowest corner lies in `table` to their cells. `foreign`, which is given if the
    /// table is the whole one, takes the corners that lie in another cell.
    ///
    /// The lowest, not the first: repeats of a triangle begin anywhere, and must meet in one cell.
    fn triangles_of(
        &mut self,
        table: &CellTable,
        mut foreign: Option<&mut Gathering<'_>>,
        scatter: &mut Scatter,
        pack: &mut PackWriter,
    ) -> Result<()> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let n_cells = self.tree.n_cells();
        let row_bytes = 3 * ids.bytes;
        let start = self.place;
        let mut dropped = start.dropped;
        let blocks = self.blocks.faces.clone();
        let first_block = blocks.start + start.block;
        let (tally, checkpoints) = (&mut self.tally, &mut self.checkpoints);
        in_order(
            blocks.end - first_block,
            self.shares.threads,
            run.progress,
            |index, out: &mut Sorted| {
                let mut faces = std::mem::take(&mut out.faces);
                source.read_faces(first_block + index, &mut faces)?;
                out.cells.clear();
                out.foreign.clear();
                let mut cells = table.reader();
                faces.triangles.retain(|corners| {
                    let lowest = corners[0].min(corners[1]).min(corners[2]);
                    let Some(owner) = cells.get(lowest) else { return false };
                    out.cells.push(owner);
                    for &corner in corners.iter() {
                        if corner != lowest && cells.get(corner).is_some_and(|cell| cell != owner) {
                            out.foreign.push((GlobalVertex(corner), owner));
                        }
                    }
                    true
                });
                cells.finish()?;
                table.trim();
                out.foreign.sort_unstable();
                out.foreign.dedup();
                out.sort(n_cells, row_bytes, |i, row| {
                    for (k, id) in faces.triangles[i].iter().enumerate() {
                        let place = &mut row[k * ids.bytes..(k + 1) * ids.bytes];
                        place.copy_from_slice(&id.to_le_bytes()[..ids.bytes]);
                    }
                });
                out.faces = faces;
                Ok(())
            },
            |index, sorted| {
                dropped.degenerate += sorted.faces.n_degenerate;
                dropped.bad += sorted.faces.n_bad;
                for &(cell, n_rows) in &sorted.runs {
                    tally[cell].triangles += u64::from(n_rows);
                }
                if let Some(foreign) = foreign.as_deref_mut() {
                    foreign.add(&mut sorted.foreign, pack)?;
                }
                run.progress.add(sorted.cells.len() as u64 / 2);
                sorted.push_runs(row_bytes, scatter, pack)?;
                if checkpoints.is_due() {
                    scatter.flush(pack)?;
                    if let Some(foreign) = foreign.as_deref_mut() {
                        foreign.note(pack)?;
                    }
                    let block = start.block + index + 1;
                    checkpoints.seal(ResumePoint { block, dropped, ..start }, pack)?;
                }
                Ok(())
            },
        )?;
        self.place.dropped = dropped;
        Ok(())
    }
}
