//! Origins: for each vertex of a cell before its simplification the one that it became, beside the survivors of the cell.
//!
//! Rows of two ids, only where a map of vertices was asked for (`VertexLayout::has_origins`). A vertex that became none, since
//! its component vanished, has no row.

use super::cell_store::VertexLayout;
use std::collections::HashMap;
use std::hash::Hash;
use stonecut_mesh::global_vertex::GlobalVertex;

/// Number of a vertex that became none.
const GONE: u32 = u32::MAX;

/// The rows of a cell of which all stays, if the layout has any.
pub(super) fn of_all(ids: &[GlobalVertex], layout: &VertexLayout) -> Vec<u8> {
    let mut rows = Vec::new();
    for &id in ids.iter().filter(|_| layout.has_origins) {
        layout.ids.push(id, &mut rows);
        layout.ids.push(id, &mut rows);
    }
    rows
}

/// Leads vertices that became none to what another one in the same `place` became: copies are joined before the kernel follows
/// anything, and only one of them is followed.
pub fn lead_copies<P: Eq + Hash>(followed: &mut [u32], place: impl Fn(usize) -> P) {
    let lost: Vec<usize> = (0..followed.len()).filter(|&v| followed[v] == GONE).collect();
    let mut found: HashMap<P, u32> = lost.iter().map(|&v| (place(v), GONE)).collect();
    if found.is_empty() {
        return;
    }
    for (v, &to) in followed.iter().enumerate() {
        if let Some(known) = found.get_mut(&place(v)).filter(|known| **known == GONE) {
            *known = to;
        }
    }
    for v in lost {
        followed[v] = found.get(&place(v)).copied().unwrap_or(GONE);
    }
}

/// The rows of a cell of vertices `ids` with these `records`, `followed` to those that are `left`, if the layout has any.
pub(super) fn of(
    (ids, records): (&[GlobalVertex], &[u8]),
    followed: &mut [u32],
    left: &[GlobalVertex],
    layout: &VertexLayout,
) -> Vec<u8> {
    if !layout.has_origins {
        return Vec::new();
    }
    let (record_bytes, position_bytes) =
        (layout.schema.record_bytes(), layout.schema.position_bytes());
    lead_copies(followed, |v| &records[v * record_bytes..][..position_bytes]);
    let mut rows = Vec::with_capacity(2 * layout.ids.bytes * ids.len());
    for (&id, &mut to) in ids.iter().zip(followed) {
        if let Some(&kept) = left.get(to as usize) {
            layout.ids.push(id, &mut rows);
            layout.ids.push(kept, &mut rows);
        }
    }
    rows
}

/// Reads rows: each vertex that became one, and that one.
pub(super) fn read(rows: &[u8], layout: &VertexLayout) -> Vec<[GlobalVertex; 2]> {
    let n = layout.ids.bytes;
    rows.chunks_exact(2 * n).map(|row| [layout.ids.read(row), layout.ids.read(&row[n..])]).collect()
}
