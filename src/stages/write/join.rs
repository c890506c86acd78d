//! One number for what lies in one place: vertices that were split along texture seams are joined again.
//!
//! Over all cells, by three sorts on disk: by place, by the first vertex of each place, by vertex. So the
//! joined vertices keep the order of the first of each place, and memory does not grow with the result.

use super::numbering::{FirstUses, own_vertices};
use stonecut_io::ply::raw::{RawFile, Spool};
use stonecut_io::{ExternalSort, halves, whole};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::SurvivorPack;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;

/// Numbers are kept in 8 bytes each.
const NUMBER_BYTES: usize = 8;

/// Memory for one of two sorts that live at a time, each of which takes its share twice.
pub fn sort_memory_bytes(run: &StageContext) -> usize {
    (run.memory_bytes / 16).clamp(1 << 20, 64 << 20) as usize
}

/// For each vertex the number of the one that stands for its place.
pub(super) struct Joined {
    numbers: RawFile,
    /// Number of places.
    pub(super) n_vertices: u64,
}

impl Joined {
    /// Joins the vertices of all cells. Disk: 32, 16 and 16 bytes a vertex for sorting, 8 to stay.
    pub(super) fn new(
        result: &SurvivorPack,
        uses: &FirstUses,
        run: &StageContext,
    ) -> Result<Joined> {
        let folder = run.job.folder();
        let memory = sort_memory_bytes(run);
        let schema = &result.layout().schema;
        let record_bytes = schema.record_bytes();
        let mut by_place = ExternalSort::<8>::new(folder, memory);
        let mut number = 0;
        for cell in CellId::first(result.info().cells.len()) {
            run.progress.check()?;
            let part = result.load(cell)?;
            for vertex in own_vertices(&part, cell, uses) {
                let record = &part.records[vertex * record_bytes..(vertex + 1) * record_bytes];
                // Adding 0 makes -0 and 0 the same place.
                let [x, y, z] = schema.position(record).map(|x| halves((x + 0.0).to_bits()));
                let n = halves(number);
                by_place.push([x[0], x[1], y[0], y[1], z[0], z[1], n[0], n[1]])?;
                number += 1;
            }
        }
        let mut by_first = ExternalSort::<4>::new(folder, memory);
        let mut last = None;
        by_place.drain(|[x0, x1, y0, y1, z0, z1, high, low]| {
            let place = [x0, x1, y0, y1, z0, z1];
            let first = match last {
                Some((known, first)) if known == place => first,
                _ => [high, low],
            };
            last = Some((place, first));
            by_first.push([first[0], first[1], high, low])
        })?;
        let mut by_vertex = ExternalSort::<4>::new(folder, memory);
        let (mut n_vertices, mut last) = (0u64, None);
        by_first.drain(|[first_high, first_low, high, low]| {
            if last != Some([first_high, first_low]) {
                last = Some([first_high, first_low]);
                n_vertices += 1;
            }
            let [new_high, new_low] = halves(n_vertices - 1);
            by_vertex.push([high, low, new_high, new_low])
        })?;
        let mut numbers = Spool::new(folder);
        by_vertex.drain(|[_, _, high, low]| numbers.write(&whole(high, low).to_le_bytes()))?;
        Ok(Joined { numbers: numbers.finish(folder)?, n_vertices })
    }

    /// Returns the numbers that stand for `n` vertices from number `first`.
    pub(super) fn numbers(&self, first: u64, n: usize) -> Result<Vec<u64>> {
        let mut bytes = vec![0; n * NUMBER_BYTES];
        self.numbers.read_exact_at(&mut bytes, first * NUMBER_BYTES as u64)?;
        Ok(bytes.as_chunks().0.iter().map(|&number| u64::from_le_bytes(number)).collect())
    }
}
