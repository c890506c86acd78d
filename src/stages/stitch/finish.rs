//! Joins all cells in memory, by id, and simplifies the whole to the exact target.

use crate::error::Result;
use crate::kernel::{self, Options, Stop};
use crate::mesh::Mesh;
use crate::mesh::attribute_weights::ChannelSample;
use crate::store::cells::{
    CellTally, IdMap, SurvivorInfo, SurvivorWriter, Survivors, VertexLayout,
};
use crate::store::stage_context::StageContext;

/// The cells that are joined.
pub struct Parts<'a> {
    /// Vertices and triangles of each.
    pub cells: &'a [CellTally],
    /// Their row layout.
    pub layout: &'a VertexLayout,
    /// Loads one of them.
    pub load: &'a dyn Fn(usize) -> Result<Survivors>,
}

/// Joins the survivors and collapses (with `options.weights`, or those that the joined mesh asks for) until
/// exactly the target is met; the result goes to the pack `name`, as one cell.
pub fn finish(
    parts: Parts,
    name: &str,
    target: u64,
    options: &Options,
    run: &StageContext,
) -> Result<SurvivorInfo> {
    let layout = parts.layout;
    let joined = join(&parts, run)?;
    let n_triangles = joined.mesh.triangles.len() as u64;
    run.progress.check()?;
    let mut options = Options { stop: Stop::Triangles(target), estimate: true, ..options.clone() };
    if options.weights.is_empty() && layout.n_weighted() > 0 {
        // No round was before that.
        let channel_kinds = layout.codec.channel_kinds(&layout.schema);
        let mut sample = ChannelSample::default();
        sample.add(&joined.mesh, &channel_kinds);
        options.weights = sample.lengths(&layout.weights, &channel_kinds, n_triangles, target);
    }
    let Survivors { ids, records, mesh, statistics, .. } = joined;
    let locked = vec![false; ids.len()];
    let simplified = kernel::simplify_mesh(mesh, &locked, &options);
    let mut result = Survivors::new(&ids, &locked, &records, simplified, layout);
    // The result is encoded next, which takes as much again.
    drop((ids, locked, records));
    result.statistics.dropped = statistics.dropped;
    run.progress.add(n_triangles);
    let path = run.job.path(name);
    run.disk().remove(&path)?;
    let name = run.job.name(name);
    let mut writer = SurvivorWriter::open(run.disk(), run.job.folder(), &name, layout)?;
    writer.append(0, &result)?;
    writer.finish(run.disk(), run.job.folder(), 0..1)
}

/// All cells as one mesh; a vertex that several cells hold becomes one again.
fn join(parts: &Parts, run: &StageContext) -> Result<Survivors> {
    if parts.cells.len() == 1 {
        return (parts.load)(0);
    }
    let layout = parts.layout;
    let n_vertices: u64 = parts.cells.iter().map(|cell| cell.vertices).sum();
    let n_triangles: u64 = parts.cells.iter().map(|cell| cell.triangles).sum();
    let (record_bytes, n_channels) = (layout.schema.record_bytes(), layout.n_channels());
    let mut map = IdMap::with_capacity(n_vertices as usize);
    let mut out = Survivors {
        ids: Vec::with_capacity(n_vertices as usize),
        records: Vec::with_capacity(n_vertices as usize * record_bytes),
        mesh: Mesh {
            positions: Vec::with_capacity(n_vertices as usize),
            channels: Vec::with_capacity(n_vertices as usize * n_channels),
            n_channels,
            triangles: Vec::with_capacity(n_triangles as usize),
            relief: Vec::new(),
        },
        ..Survivors::default()
    };
    let mut local = Vec::new();
    for cell in 0..parts.cells.len() {
        run.progress.check()?;
        let part = (parts.load)(cell)?;
        out.statistics.dropped += part.statistics.dropped;
        local.clear();
        for (vertex, &id) in part.ids.iter().enumerate() {
            let (index, is_new) = map.insert(id, &mut out.ids);
            if is_new {
                out.records.extend_from_slice(
                    &part.records[vertex * record_bytes..(vertex + 1) * record_bytes],
                );
                out.mesh.positions.push(part.mesh.positions[vertex]);
                out.mesh.channels.extend_from_slice(part.mesh.channels_of(vertex as u32));
            }
            if let (false, Some(at)) = (is_new, layout.reach_channel()) {
                let reach = &mut out.mesh.channels[index as usize * n_channels + at];
                *reach = reach.max(part.mesh.channels_of(vertex as u32)[at]);
            }
            local.push(index);
        }
        out.mesh.triangles.extend(part.mesh.triangles.iter().map(|t| t.map(|v| local[v as usize])));
        out.mesh.relief.extend_from_slice(&part.mesh.relief);
    }
    Ok(out)
}
