//! Splits cells that came out far larger than planned, so that memory holds whatever the mesh is like.
//!
//! Cells are cut by the position of one corner, so triangles around one vertex, or all in one point, end in
//! one cell. Such a cell is cut again by ids, which tell apart what positions do not; neighbours in a scan have
//! near ids. The parts are written behind everything else; the rows they come from are forgotten.

use super::cell_store::{CellTally, StoreInfo, VertexLayout};
use super::pack::{Pack, PackWriter};
use super::scatter::Scatter;
use crate::cell_id::CellId;
use crate::pack_format::{ChunkKind, IdWidth};
use crate::stage_context::StageContext;
use std::collections::BTreeMap;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_mesh::vec3::place_bits;
use stonecut_system::error::Result;

/// A cell of this many times the planned triangles is split. Even scans stay within 1.25, uneven ones below this.
const OVERFULL: u64 = 2;

/// Keys that are looked at to find where to cut; parts then agree within some percent.
const SAMPLES: usize = 1 << 16;

/// Vertices whose users are gathered at a time, 16 bytes for each use. Not a share of the memory budget: the
/// order of rows, and so the result, must not depend on that.
const WINDOW_VERTICES: u64 = 1 << 20;

/// Share of the memory budget for each set of scatter buffers.
const BUFFER_SHARE: u64 = 16;

/// Splits what is overfull in a store whose rows have all been written to its packs and then to `pack`, for round `round`.
///
/// Every cell holds all vertices its triangles use, before and after. Wedges of one place that come into different cells are
/// marked as shared there. Memory: buffers within the budget and some 60 MB. Reads an overfull cell once for each million of
/// its vertices, and once more where there are attribute seams.
pub fn split_overfull(
    mut info: StoreInfo,
    pack: &mut PackWriter,
    layout: &VertexLayout,
    planned_triangles: u64,
    round: u32,
    run: &StageContext,
) -> Result<StoreInfo> {
    let limit = planned_triangles.saturating_mul(OVERFULL);
    let is_overfull = |cell: &CellId| info.cells[*cell].triangles > limit;
    let overfull: Vec<CellId> = CellId::first(info.cells.len()).filter(is_overfull).collect();
    if overfull.is_empty() {
        return Ok(info);
    }
    info.split_at = pack.length();
    info.first_part = CellId::at(info.cells.len());
    let source = pack.reader_behind(run.disk(), &info.packs, info.cells.len())?;
    for &cell in &overfull {
        let old = Old { source: &source, cell, layout, info: &info };
        let cuts = old.cuts(planned_triangles, round, run)?;
        // The first part keeps the cell's number; the others come behind all cells.
        let n_cells = info.cells.len();
        let parts: Vec<CellId> =
            std::iter::once(cell).chain((n_cells..n_cells + cuts.len()).map(CellId::at)).collect();
        let tally = old.write_parts(&cuts, &parts, pack, run)?;
        info.cells.resize(n_cells + cuts.len(), CellTally::default());
        for (&part, rows) in parts.iter().zip(tally) {
            info.cells[part] = rows;
        }
        pack.flush()?;
    }
    info.split = overfull;
    Ok(info)
}

/// Key that identifies a triangle: the sum of its ids and the lowest of them. Repeats of a triangle are not
/// told apart: they must meet in one cell.
type Key = (u64, GlobalVertex);

/// Spreads keys over all numbers, whatever step they come in.
fn hash((sum, lowest): Key) -> u64 {
    let mixed = (sum ^ lowest.0.rotate_left(32)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed ^ mixed >> 32).wrapping_mul(0xD6E8_FEB8_6659_FD93)
}

/// The window of a number among `n`.
fn window_of(number: u64, n: u64) -> u64 {
    ((number.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) * n) >> 32
}

/// A cell that is split.
struct Old<'a> {
    source: &'a Pack,
    cell: CellId,
    layout: &'a VertexLayout,
    info: &'a StoreInfo,
}

impl Old<'_> {
    /// Calls `look` for every row of one kind.
    fn each_row(
        &self,
        kind: ChunkKind,
        run: &StageContext,
        mut look: impl FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let ids = self.layout.ids.bytes;
        let row_bytes = match kind {
            ChunkKind::Vertices => ids + self.layout.row_bytes(self.info.has_channels),
            ChunkKind::Triangles => self.layout.triangle_row_bytes(self.info.has_channels),
            _ => ids,
        };
        let mut payload = Vec::new();
        for chunk in self.source.chunks_of(self.cell).iter().filter(|chunk| chunk.kind == kind) {
            run.progress.check()?;
            self.source.read(chunk, &mut payload)?;
            payload.chunks_exact(row_bytes).try_for_each(&mut look)?;
        }
        Ok(())
    }

    fn each_triangle(
        &self,
        run: &StageContext,
        mut look: impl FnMut(Key, &[u8]) -> Result<()>,
    ) -> Result<()> {
        self.each_row(ChunkKind::Triangles, run, |row| {
            let ids = corners(row, self.layout.ids);
            look((ids.iter().map(|id| id.0).sum(), ids[0].min(ids[1]).min(ids[2])), row)
        })
    }

    /// The keys at which parts begin, without the first. Odd rounds begin with half a part, so that the
    /// seams of one round lie inside the parts of the next.
    fn cuts(&self, planned_triangles: u64, round: u32, run: &StageContext) -> Result<Vec<Key>> {
        let n_triangles = self.info.cells[self.cell].triangles;
        // The keys of lowest hash, each with its number of triangles: the same for any order of the rows.
        let mut lowest: BTreeMap<(u64, Key), u64> = BTreeMap::new();
        self.each_triangle(run, |key, _| {
            let hashed = (hash(key), key);
            let is_full = lowest.len() == SAMPLES;
            if is_full && lowest.last_key_value().is_some_and(|(highest, _)| *highest < hashed) {
                return Ok(());
            }
            *lowest.entry(hashed).or_default() += 1;
            if lowest.len() > SAMPLES {
                lowest.pop_last();
            }
            Ok(())
        })?;
        let mut keys: Vec<(Key, u64)> = lowest.into_iter().map(|((_, key), n)| (key, n)).collect();
        keys.sort_unstable();
        // Behind each key the triangles of the sample up to it.
        let mut n_sampled = 0;
        for (_, n) in &mut keys {
            n_sampled += *n;
            *n = n_sampled;
        }
        let n_parts = n_triangles.div_ceil(planned_triangles.max(1));
        let half = u64::from(round % 2);
        let mut cuts: Vec<Key> = (1..=n_parts)
            .map(|part| {
                let share = u128::from(2 * part - half) * u128::from(n_sampled);
                (share / u128::from(2 * n_parts)) as u64
            })
            .filter_map(|at| keys.get(keys.partition_point(|&(_, up_to)| up_to <= at)))
            .map(|&(key, _)| key)
            .collect();
        cuts.dedup();
        Ok(cuts)
    }

    /// Writes the parts under the numbers of their cells; gives back their rows.
    fn write_parts(
        &self,
        cuts: &[Key],
        cells: &[CellId],
        pack: &mut PackWriter,
        run: &StageContext,
    ) -> Result<Vec<CellTally>> {
        let part_of = |key: Key| cuts.partition_point(|cut| *cut <= key);
        let ids = self.layout.ids;
        let n_cells = cells.iter().max().map_or(0, |last| last.0 + 1);
        let buffers = |kind| Scatter::new(kind, n_cells, run.memory_bytes / BUFFER_SHARE);
        let mut vertices = buffers(ChunkKind::Vertices);
        let mut triangles = buffers(ChunkKind::Triangles);
        let mut marks = buffers(ChunkKind::SharedIds);
        let mut tally = vec![CellTally::default(); cells.len()];
        self.each_triangle(run, |key, row| {
            let part = part_of(key);
            tally[part].triangles += 1;
            triangles.push(pack, cells[part], row)
        })?;
        triangles.finish(pack)?;
        let torn = self.torn(&part_of, run)?;
        let n_windows = self.n_windows();
        for window in 0..n_windows {
            // By a hash, so that windows are even whatever ids the cell holds.
            let is_in = |id: GlobalVertex| window_of(id.0, n_windows) == window;
            let users = self.users(&part_of, &is_in, run)?;
            let mut marked: Vec<GlobalVertex> = Vec::new();
            self.each_row(ChunkKind::SharedIds, run, |row| {
                let id = ids.read(row);
                if is_in(id) {
                    marked.push(id);
                }
                Ok(())
            })?;
            marked.sort_unstable();
            self.each_row(ChunkKind::Vertices, run, |row| {
                let id = ids.read(row);
                if !is_in(id) {
                    return Ok(());
                }
                let from = users.partition_point(|user| user.0 < id);
                let n = users[from..].iter().take_while(|user| user.0 == id).count();
                let is_shared =
                    n > 1 || marked.binary_search(&id).is_ok() || torn.binary_search(&id).is_ok();
                for &(_, part) in &users[from..from + n] {
                    tally[part as usize].vertices += 1;
                    vertices.push(pack, cells[part as usize], row)?;
                    if is_shared {
                        marks.push(pack, cells[part as usize], &row[..ids.bytes])?;
                    }
                }
                Ok(())
            })?;
        }
        vertices.finish(pack)?;
        marks.finish(pack)?;
        Ok(tally)
    }

    fn n_windows(&self) -> u64 {
        self.info.cells[self.cell].vertices.div_ceil(WINDOW_VERTICES).max(1)
    }

    /// Vertices that share their place with others which another part uses, sorted.
    ///
    /// Such wedges move together while one cell holds them. Apart they stay where they are, or the place would tear.
    fn torn(
        &self,
        part_of: &impl Fn(Key) -> usize,
        run: &StageContext,
    ) -> Result<Vec<GlobalVertex>> {
        let layout = self.layout;
        let mut torn = Vec::new();
        if !layout.codec.has_seams(&layout.schema) {
            return Ok(torn);
        }
        let n_windows = self.n_windows();
        for window in 0..n_windows {
            // By place: all wedges of one are in one window.
            let mut placed: Vec<([u64; 3], GlobalVertex)> = Vec::new();
            self.each_row(ChunkKind::Vertices, run, |row| {
                let place = place_bits(layout.schema.position(&row[layout.ids.bytes..]));
                let mixed = place
                    .iter()
                    .fold(0u64, |sum, bits| sum.rotate_left(21) ^ hash((*bits, GlobalVertex(0))));
                if window_of(mixed, n_windows) == window {
                    placed.push((place, layout.ids.read(row)));
                }
                Ok(())
            })?;
            placed.sort_unstable();
            placed.dedup();
            let mut group_of: Vec<(GlobalVertex, u32)> = Vec::new();
            let groups = placed.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1);
            for (number, group) in groups.enumerate() {
                group_of.extend(group.iter().map(|&(_, id)| (id, number as u32)));
            }
            drop(placed);
            group_of.sort_unstable();
            let group = |id: GlobalVertex| {
                let at = group_of.binary_search_by_key(&id, |entry| entry.0).ok()?;
                Some(group_of[at].1 as usize)
            };
            // The part that uses each group, or that there are several.
            let mut user: Vec<Option<usize>> = vec![None; group_of.len()];
            let mut is_torn = vec![false; group_of.len()];
            self.each_triangle(run, |key, row| {
                let part = part_of(key);
                for group in corners(row, layout.ids).into_iter().filter_map(group) {
                    is_torn[group] |= *user[group].get_or_insert(part) != part;
                }
                Ok(())
            })?;
            torn.extend(
                group_of.iter().filter(|(_, group)| is_torn[*group as usize]).map(|(id, _)| *id),
            );
        }
        torn.sort_unstable();
        Ok(torn)
    }

    /// Every vertex of a window with every part that uses it, sorted.
    fn users(
        &self,
        part_of: &impl Fn(Key) -> usize,
        is_in: &impl Fn(GlobalVertex) -> bool,
        run: &StageContext,
    ) -> Result<Vec<(GlobalVertex, u32)>> {
        let mut users: Vec<(GlobalVertex, u32)> = Vec::new();
        let mut sorted_up_to = 0;
        self.each_triangle(run, |key, row| {
            for id in corners(row, self.layout.ids) {
                if is_in(id) {
                    users.push((id, part_of(key) as u32));
                }
            }
            // The same vertex comes with every triangle around it.
            if users.len() > 2 * sorted_up_to + 500_000 {
                users.sort_unstable();
                users.dedup();
                sorted_up_to = users.len();
            }
            Ok(())
        })?;
        users.sort_unstable();
        users.dedup();
        Ok(users)
    }
}

fn corners(row: &[u8], ids: IdWidth) -> [GlobalVertex; 3] {
    [0, 1, 2].map(|k| ids.read(&row[k * ids.bytes..]))
}
