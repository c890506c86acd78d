//! Shows where the cells were: the vertices on the first round's seams, as a point set.
//!
//! For tests and for doubters; the result does not depend on it.

use crate::error::Result;
use crate::io::ply::{OutputHeader, PlyWriter};
use crate::mesh::global_vertex::GlobalVertex;
use crate::mesh::record::VertexSchema;
use crate::store::cell_id::CellId;
use crate::store::cells::CellStore;
use crate::store::stage_context::StageContext;
use crate::system::pending_file::Seen;

/// Writes the shared vertices of all cells; memory: 32 bytes per shared vertex.
pub fn write(store: &CellStore, to: &Seen, run: &StageContext) -> Result<()> {
    let mut points: Vec<(GlobalVertex, [f64; 3])> = Vec::new();
    for cell in CellId::first(store.n_cells()) {
        run.progress.check()?;
        let mesh = store.load(cell)?;
        let shared = (0..mesh.ids.len()).filter(|&v| mesh.shared[v]);
        points.extend(shared.map(|v| (mesh.ids[v], mesh.mesh.positions[v])));
    }
    points.sort_unstable_by_key(|point| point.0);
    points.dedup_by_key(|point| point.0);
    let coordinate = store.layout().schema.coordinate;
    let schema = VertexSchema { coordinate, properties: Vec::new() };
    let mut records = Vec::with_capacity(points.len() * schema.record_bytes());
    points.iter().for_each(|point| schema.encode_position(point.1, &mut records));
    let mut header = OutputHeader::new(schema, points.len() as u64, 0);
    header.settings = crate::system::paths::SEAMS_SETTINGS.to_owned();
    let mut writer = PlyWriter::create(to.place(run.disk()), header)?;
    writer.write_vertices(&records)?;
    writer.finish()?;
    Ok(())
}
