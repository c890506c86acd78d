//! Origins: for each vertex of a cell before its simplification the one that it became, beside the survivors of the cell.
//!
//! Rows of two ids, only where a map of vertices was asked for (`VertexLayout::has_origins`). A vertex that became none, since
//! its component vanished, has no row.

use super::cell_store::VertexLayout;
use std::collections::HashMap;
use stonecut_mesh::global_vertex::GlobalVertex;

/// Number of a vertex that became none.
const GONE: u32 = u32::MAX;

/// The rows of a cell of which all stays.
pub(super) fn of_all(ids: &[GlobalVertex], layout: &VertexLayout) -> Vec<u8> {
    let mut rows = Vec::with_capacity(2 * layout.ids.bytes * ids.len());
    for &id in ids {
        layout.ids.push(id, &mut rows);
        layout.ids.push(id, &mut rows);
    }
    rows
}

/// The rows of a cell of vertices `ids` with these `records`, `followed` to those that are `left`.
///
/// Copies in one place are joined before the kernel follows anything: where only one of them was followed, the others became
/// the same.
pub(super) fn of(
    (ids, records): (&[GlobalVertex], &[u8]),
    followed: &[u32],
    left: &[GlobalVertex],
    layout: &VertexLayout,
) -> Vec<u8> {
    let place = |v: usize| {
        let start = v * layout.schema.record_bytes();
        &records[start..start + layout.schema.position_bytes()]
    };
    let mut lost: HashMap<&[u8], u32> = HashMap::new();
    for (v, _) in followed.iter().enumerate().filter(|(_, to)| **to == GONE) {
        lost.insert(place(v), GONE);
    }
    let searched = if lost.is_empty() { &[][..] } else { followed };
    for (v, &to) in searched.iter().enumerate() {
        if let Some(known) = lost.get_mut(place(v)).filter(|known| **known == GONE) {
            *known = to;
        }
    }
    let mut rows = Vec::with_capacity(2 * layout.ids.bytes * ids.len());
    for (v, (&id, &to)) in ids.iter().zip(followed).enumerate() {
        let to = if to == GONE { lost.get(place(v)).copied().unwrap_or(GONE) } else { to };
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
