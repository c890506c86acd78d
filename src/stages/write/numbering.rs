//! Numbers the vertices of the output: a vertex that several cells hold is written by the first of them.

use std::collections::HashMap;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{SurvivorPack, Survivors};
use stonecut_system::error::Result;

/// Appends the record of a vertex.
pub(super) fn encode(result: &SurvivorPack, part: &Survivors, vertex: usize, out: &mut Vec<u8>) {
    let layout = result.layout();
    let record_bytes = layout.schema.record_bytes();
    let record = &part.records[vertex * record_bytes..(vertex + 1) * record_bytes];
    let channels = part.mesh.channels_of(vertex as u32);
    layout.codec.encode(part.mesh.positions[vertex], channels, record, out);
}

/// Memory in bytes for shared vertices, each counted once: a table of rows of 24 bytes and a mark, hardly half full, and
/// half as large again while it grows.
pub fn shared_bytes(n_shared: u64) -> u64 {
    86 * n_shared
}

/// For every shared vertex, the first cell that holds it and its number.
pub(super) struct FirstUses {
    pub(super) shared: HashMap<GlobalVertex, (CellId, u64)>,
    pub(super) n_vertices: u64,
}

pub(super) fn index_vertices(result: &SurvivorPack) -> Result<FirstUses> {
    let mut uses = FirstUses { shared: HashMap::new(), n_vertices: 0 };
    for cell in CellId::first(result.info().cells.len()) {
        let part = result.load(cell)?;
        for (&id, &shared) in part.ids.iter().zip(&part.shared) {
            if shared {
                let mut is_new = false;
                uses.shared.entry(id).or_insert_with(|| {
                    is_new = true;
                    (cell, uses.n_vertices)
                });
                uses.n_vertices += u64::from(is_new);
            } else {
                uses.n_vertices += 1;
            }
        }
    }
    Ok(uses)
}

/// The vertices of a cell that no earlier cell holds, in order: they have consecutive numbers.
pub(super) fn own_vertices(part: &Survivors, cell: CellId, uses: &FirstUses) -> Vec<usize> {
    let is_own =
        |v: &usize| !part.shared[*v] || uses.shared.get(&part.ids[*v]).is_none_or(|u| u.0 == cell);
    (0..part.ids.len()).filter(is_own).collect()
}
