//! The map of `--map`: for each vertex of the input the vertex of the result that it became, and back the nearest of these.
//!
//! Every round has left the origins of its survivors (`SurvivorPack::origins`). They are composed from the result backwards: a
//! table of ids with their numbers in the result, sorted by id, is joined with the origins of the round before, sorted by what
//! became of them. So memory does not grow with the input: two sorts live at a time, on disk where they must.

use super::join::sort_memory_bytes;
use super::numbering::{index_vertices, own_vertices};
use std::collections::HashMap;
use stonecut_io::NumberRecords;
use stonecut_io::ply::raw::{RawFile, Spool};
use stonecut_io::ply::{MeshSource, Place, VertexRecords};
use stonecut_io::{ExternalSort, halves, npy, whole};
use stonecut_mesh::vec3::{Vec3, length_sq, sub};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::SurvivorPack;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;
use stonecut_system::pending_file::PendingFile;

/// File in the job folder that the map is in until the result is written.
pub const MAP: &str = "result.map";

/// Rows that are read at a time.
const ROWS_AT_ONCE: usize = 1 << 12;

/// Bytes of a vertex of the result in memory while the nearest of the input is found: place, distance, number, and the name of a
/// copy.
const NEAREST_BYTES: u64 = 40 + 40;

/// Most bytes on disk for each vertex of the input: two sorts, a table and the map.
pub const MAP_DISK_BYTES: u64 = 56;

/// Stands for no vertex.
const NONE: i64 = -1;

/// Counts of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct MapCounts {
    /// Vertices of the input.
    pub input: u64,
    /// Those of them that became none.
    pub gone: u64,
    /// Vertices of the result.
    pub result: u64,
    /// Those of them that none became: corners of caps, and of sheets that were taken apart.
    pub new: u64,
}

/// Writes the map of a result, the last of `packs`, from the origins of all rounds, in their order.
///
/// Two arrays of NumPy one behind the other, 8 bytes an element: for each vertex of the input, in its order, the vertex of the
/// result, or -1; and for each vertex of the result the nearest of those that became it. Where none did, those that became its
/// neighbours count, and -1 is for what has none of these either.
pub fn write_map(
    packs: &[SurvivorPack],
    source: &MeshSource,
    place: Place,
    run: &StageContext,
) -> Result<MapCounts> {
    let tables = MapTables { run };
    let (mut known, positions) = tables.numbers(packs)?;
    for pack in packs.iter().rev() {
        let mut by_target = tables.sort();
        for cell in CellId::first(pack.info().cells.len()) {
            run.progress.check()?;
            for [from, to] in pack.origins(cell)? {
                push(&mut by_target, to.0, from.0)?;
            }
        }
        known = tables.behind(&known, by_target)?;
    }
    // Of the copies of a vertex that were joined before, each became what it did.
    let joined = known;
    let known = match source.joined_numbers() {
        None => None,
        Some(numbers) => {
            let mut by_target = tables.sort();
            each_number(numbers, |from, to| push(&mut by_target, to, from))?;
            Some(tables.behind(&joined, by_target)?)
        }
    };
    let n_input = source.joined_numbers().map_or(source.n_vertices(), |file| file.len() / 4);
    let n_result = positions.len() / 24;
    let mut counts = MapCounts { input: n_input, result: n_result, ..MapCounts::default() };
    let mut file = PendingFile::create(place)?;
    file.write(&npy::header("<i8", &[n_input]))?;
    let mut next = 0;
    let mut skip_to = |file: &mut PendingFile, to: u64| {
        counts.gone += to - next;
        (next..to).try_for_each(|_| file.write(&NONE.to_le_bytes()))?;
        next = to + 1;
        Ok(())
    };
    each_row(known.as_ref().unwrap_or(&joined), |from, number| {
        skip_to(&mut file, from)?;
        file.write(&number.to_le_bytes())
    })?;
    skip_to(&mut file, n_input)?;
    file.write(&npy::header("<i8", &[n_result]))?;
    let window = (run.memory_bytes / 4 / NEAREST_BYTES).max(1 << 16);
    for start in (0..n_result).step_by(window as usize) {
        let mut nearest = NearestOrigins::new(&positions, start..n_result.min(start + window))?;
        nearest.look(&joined, None, source, run)?;
        if let Some(result) = packs.last().filter(|_| nearest.n_new() > 0) {
            counts.new += nearest.n_new();
            let around = tables.around(result, &nearest)?;
            nearest.look(&joined, Some(&around), source, run)?;
        }
        if let Some(numbers) = source.joined_numbers() {
            nearest.name_copies(numbers)?;
        }
        for (_, _, vertex) in &nearest.rows {
            file.write(&vertex.to_le_bytes())?;
        }
    }
    file.finish()?;
    Ok(counts)
}

/// Adds a row of two numbers to a sort by the first.
fn push(sort: &mut ExternalSort<4>, by: u64, value: u64) -> Result<()> {
    let ([a, b], [c, d]) = (halves(by), halves(value));
    sort.push([a, b, c, d])
}

/// Makes tables: rows of an id and a number of the result, sorted by id.
struct MapTables<'a> {
    run: &'a StageContext<'a>,
}

impl MapTables<'_> {
    fn sort(&self) -> ExternalSort<4> {
        let sort = ExternalSort::new(self.run.job.folder(), sort_memory_bytes(self.run));
        sort.counted(self.run.disk())
    }

    fn spool(&self) -> Spool {
        Spool::new(self.run.job.folder()).counted(self.run.disk())
    }

    /// The rows of a sort as a table; of several with one id the first.
    fn table(&self, sort: ExternalSort<4>) -> Result<RawFile> {
        let (mut out, mut last) = (self.spool(), None);
        sort.drain(|[a, b, c, d]| {
            if last.replace([a, b]) != Some([a, b]) {
                out.write(&whole(a, b).to_le_bytes())?;
                out.write(&whole(c, d).to_le_bytes())?;
            }
            Ok(())
        })?;
        out.finish(self.run.job.folder())
    }

    /// The numbers of the result's vertices, and their places in the order of these, 24 bytes each.
    fn numbers(&self, packs: &[SurvivorPack]) -> Result<(RawFile, RawFile)> {
        let (mut by_id, mut positions, mut number) = (self.sort(), self.spool(), 0);
        if let Some(result) = packs.last() {
            let uses = index_vertices(result)?;
            for cell in CellId::first(result.info().cells.len()) {
                self.run.progress.check()?;
                let part = result.load(cell)?;
                for vertex in own_vertices(&part, cell, &uses) {
                    push(&mut by_id, part.ids[vertex].0, number)?;
                    let place = part.mesh.positions[vertex].map(f64::to_le_bytes);
                    positions.write(place.as_flattened())?;
                    number += 1;
                }
            }
        }
        Ok((self.table(by_id)?, positions.finish(self.run.job.folder())?))
    }

    /// The neighbours of vertices that none became, each with those of these that it is a neighbour of.
    fn around(
        &self,
        result: &SurvivorPack,
        nearest: &NearestOrigins,
    ) -> Result<HashMap<u64, Vec<u64>>> {
        let (uses, mut next) = (index_vertices(result)?, 0);
        let mut around: HashMap<u64, Vec<u64>> = HashMap::new();
        for cell in CellId::first(result.info().cells.len()) {
            self.run.progress.check()?;
            let part = result.load(cell)?;
            let number_of = |id| uses.shared.get(id).map_or(0, |known| known.1);
            let mut numbers: Vec<u64> = part.ids.iter().map(number_of).collect();
            for vertex in own_vertices(&part, cell, &uses) {
                numbers[vertex] = next;
                next += 1;
            }
            for t in &part.mesh.triangles {
                let corners = t.map(|v| numbers[v as usize]);
                for new in corners.into_iter().filter(|&corner| nearest.is_new(corner)) {
                    for other in corners.into_iter().filter(|&corner| !nearest.is_new(corner)) {
                        let known = around.entry(other).or_default();
                        if !known.contains(&new) {
                            known.push(new);
                        }
                    }
                }
            }
        }
        Ok(around)
    }

    /// The table one step farther back: `by_target` has vertices by what became of them, and `known` the numbers of these.
    fn behind(&self, known: &RawFile, by_target: ExternalSort<4>) -> Result<RawFile> {
        let (mut by_id, mut rows) = (self.sort(), NumberRecords::<2, _>::new(known)?);
        by_target.drain(|[t0, t1, f0, f1]| {
            let target = whole(t0, t1);
            while rows.next().is_some_and(|[id, _]| id < target) {
                rows.pass()?;
            }
            match rows.next() {
                Some([id, number]) if id == target => push(&mut by_id, whole(f0, f1), number),
                _ => Ok(()),
            }
        })?;
        self.table(by_id)
    }
}

/// Calls `each` with all rows of a table.
fn each_row(table: &RawFile, mut each: impl FnMut(u64, u64) -> Result<()>) -> Result<()> {
    NumberRecords::new(table)?.each(|[id, number]| each(id, number))
}

/// Calls `each` with all vertices before copies were joined, and their numbers afterwards.
fn each_number(numbers: &RawFile, mut each: impl FnMut(u64, u64) -> Result<()>) -> Result<()> {
    let mut from = 0..;
    numbers.each_piece(0..numbers.len(), 4 * ROWS_AT_ONCE, |bytes| {
        let rows = bytes.as_chunks().0.iter().zip(&mut from);
        rows.into_iter().try_for_each(|(&to, from)| each(from, u64::from(u32::from_le_bytes(to))))
    })
}

/// Some vertices of the result, each with the nearest of those that became it.
struct NearestOrigins {
    start: u64,
    /// Place, squared distance of the nearest, and its number in the input.
    rows: Vec<(Vec3, f64, i64)>,
}

impl NearestOrigins {
    fn new(positions: &RawFile, range: std::ops::Range<u64>) -> Result<NearestOrigins> {
        let mut rows = Vec::new();
        rows.reserve_exact((range.end - range.start) as usize);
        positions.each_piece(24 * range.start..24 * range.end, 24 * ROWS_AT_ONCE, |bytes| {
            let places = bytes.as_chunks::<8>().0.as_chunks::<3>().0.iter();
            let place = |at: &[[u8; 8]; 3]| (at.map(f64::from_le_bytes), f64::INFINITY, NONE);
            rows.extend(places.map(place));
            Ok(())
        })?;
        Ok(NearestOrigins { start: range.start, rows })
    }

    fn row(&mut self, number: u64) -> Option<&mut (Vec3, f64, i64)> {
        let at = number.checked_sub(self.start)?;
        self.rows.get_mut(at as usize)
    }

    /// Returns whether no vertex of the input was found.
    fn is_new(&self, number: u64) -> bool {
        let at = number.checked_sub(self.start);
        at.and_then(|at| self.rows.get(at as usize)).is_some_and(|row| row.2 == NONE)
    }

    fn n_new(&self) -> u64 {
        self.rows.iter().filter(|row| row.2 == NONE).count() as u64
    }

    /// Looks at all vertices of the mesh, for the one that each became, or for those that this one is `around`; of equally near
    /// ones the first counts.
    fn look(
        &mut self,
        table: &RawFile,
        around: Option<&HashMap<u64, Vec<u64>>>,
        source: &MeshSource,
        run: &StageContext,
    ) -> Result<()> {
        let mut records = VertexRecords::new(source);
        each_row(table, |vertex, number| {
            let own = [number];
            let looked_for = match around {
                None => &own[..],
                Some(around) => around.get(&number).map_or(&[][..], Vec::as_slice),
            };
            for &number in looked_for {
                let Some((place, least, nearest)) = self.row(number) else { continue };
                if !records.has(vertex) {
                    run.progress.check()?;
                }
                let away = length_sq(sub(records.position(vertex)?, *place));
                if away < *least {
                    (*least, *nearest) = (away, vertex as i64);
                }
            }
            Ok(())
        })
    }

    /// Names the first copy of each nearest vertex where copies were joined before.
    fn name_copies(&mut self, numbers: &RawFile) -> Result<()> {
        let mut named: HashMap<i64, i64> = HashMap::with_capacity(self.rows.len());
        named.extend(self.rows.iter().map(|row| (row.2, NONE)));
        each_number(numbers, |copy, vertex| {
            if let Some(name) = named.get_mut(&(vertex as i64)).filter(|name| **name == NONE) {
                *name = copy as i64;
            }
            Ok(())
        })?;
        for (_, _, vertex) in &mut self.rows {
            *vertex = named.get(vertex).copied().unwrap_or(NONE);
        }
        Ok(())
    }
}
