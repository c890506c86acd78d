//! Joins all cells in memory, by id, and simplifies the whole to the exact target.

use std::collections::BTreeMap;
use stonecut_kernel::{self as kernel, Fit, History, Options, Stop};
use stonecut_mesh::Mesh;
use stonecut_mesh::attribute_weights::ChannelSample;
use stonecut_mesh::vec3::Vec3;
use stonecut_progressive::{self as progressive, Original};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    CellTally, IdMap, SurvivorInfo, SurvivorWriter, Survivors, VertexLayout,
};
use stonecut_store::config::Normals;
use stonecut_store::shape::Shape;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::Place;

/// The cells that are joined.
pub struct Parts<'a> {
    /// Vertices and triangles of each.
    pub cells: &'a [CellTally],
    /// Their row layout.
    pub layout: &'a VertexLayout,
    /// Loads one of them.
    pub load: &'a dyn Fn(CellId) -> Result<Survivors>,
}

/// File in the job folder that a progressive mesh is in until the result is written.
pub const PROGRESSIVE: &str = "result.pm";

/// Channels weigh in a record as on the way to this part of the triangles, whatever the target.
const RECORDED_WEIGHTS: u64 = 16;

/// Contents of a progressive mesh of the finish besides its steps.
pub struct Recording<'a> {
    /// Comments of the input.
    pub comments: &'a [String],
    /// `obj_info` of the input.
    pub obj_infos: &'a [String],
    /// Settings of the run.
    pub settings: &'a BTreeMap<String, String>,
    /// Fate of normals: kept or dropped.
    pub normals: Normals,
    /// Bits of coordinates and other floats; `None`: bit by bit.
    pub bits: Option<u32>,
}

/// Joins the survivors and collapses (with `options.weights`, or those that the joined mesh asks for) until
/// exactly the target is met; the result goes to the pack `name`, as one cell. With a `recording` the steps back go to the
/// file `PROGRESSIVE`, and nothing is fitted.
pub fn finish(
    parts: Parts,
    name: &str,
    target: u64,
    options: &Options,
    recording: Option<&Recording>,
    run: &StageContext,
) -> Result<SurvivorInfo> {
    let layout = parts.layout;
    let joined = join(&parts, run)?;
    let n_triangles = joined.mesh.triangles.len() as u64;
    run.progress.check()?;
    let mut options = Options { stop: Stop::Triangles(target), estimate: true, ..options.clone() };
    if options.weights.is_empty() && layout.n_weighted() > 0 {
        // No round was before that. What is recorded must not depend on the target.
        let target = if recording.is_some() { n_triangles / RECORDED_WEIGHTS } else { target };
        let channel_kinds = layout.codec.channel_kinds(&layout.schema);
        let mut sample = ChannelSample::default();
        sample.add(&joined.mesh, &channel_kinds);
        options.weights = sample.lengths(&layout.weights, &channel_kinds, n_triangles, target);
    }
    if recording.is_some() {
        (options.record, options.fit) = (true, Fit::Off);
    }
    let Survivors { ids, records, mesh, statistics, .. } = joined;
    let shared = vec![false; ids.len()];
    let mut locked = shared.clone();
    layout.mark_locked(&records, &mut locked);
    let mut simplified = kernel::simplify_mesh(mesh, &locked, &options);
    let history = simplified.history.take();
    let mut result = Survivors::new(&ids, &shared, &records, simplified, layout);
    // The result is encoded next, which takes as much again.
    drop((ids, locked, shared));
    result.statistics.dropped = statistics.dropped;
    if let Some(recording) = recording {
        let history = history.ok_or_else(|| {
            Error::Usage(
                "--progressive: the mesh has attribute seams, which are not recorded".to_owned(),
            )
        })?;
        record(recording, &history, &records, layout, run)?;
    }
    drop(records);
    run.progress.add(n_triangles);
    let path = run.job.path(name);
    run.disk().remove(&path)?;
    let name = run.job.name(name);
    let mut writer = SurvivorWriter::open(run.disk(), run.job.folder(), &name, layout)?;
    writer.append(CellId(0), &result)?;
    writer.finish(run.disk(), run.job.folder(), 0..1)
}

/// Writes the progressive mesh.
fn record(
    recording: &Recording,
    history: &History,
    records: &[u8],
    layout: &VertexLayout,
    run: &StageContext,
) -> Result<()> {
    let shape = Shape::new(&layout.schema, 0, recording.normals, false);
    let n = layout.schema.record_bytes();
    let encode = |source: u32, place: Vec3, channels: &[f32], out: &mut Vec<u8>| {
        let mut record = Vec::with_capacity(n);
        let own = &records[source as usize * n..(source as usize + 1) * n];
        layout.codec.encode(place, channels, own, &mut record);
        shape.put(&record, None, 0.0, out);
    };
    let original = Original {
        schema: &shape.schema,
        encode: &encode,
        comments: recording.comments,
        obj_infos: recording.obj_infos,
        settings: recording.settings,
        bits: recording.bits,
    };
    let place = Place { path: run.job.path(PROGRESSIVE), disk: run.disk().clone(), replace: true };
    let check = || run.progress.check();
    let written = progressive::write(place, history, original, &check)?;
    let of = |bytes: u64| 8.0 * bytes as f64 / written.vertices.max(1) as f64;
    run.progress.note(format!(
        "progressive mesh: {} steps to {} triangles; bits a vertex: {:.1} connectivity, {:.1} order, {:.1} values",
        written.steps,
        written.finest,
        of(written.spent.connectivity),
        of(written.spent.order),
        of(written.spent.values)
    ));
    Ok(())
}

/// All cells as one mesh; a vertex that several cells hold becomes one again.
fn join(parts: &Parts, run: &StageContext) -> Result<Survivors> {
    if parts.cells.len() == 1 {
        return (parts.load)(CellId(0));
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
            ..Mesh::default()
        },
        ..Survivors::default()
    };
    let mut local = Vec::new();
    for cell in CellId::first(parts.cells.len()) {
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
        out.mesh.extremes.extend_from_slice(&part.mesh.extremes);
    }
    Ok(out)
}
