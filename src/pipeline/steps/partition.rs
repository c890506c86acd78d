//! The first step: the input becomes cells on disk, and what no result can come from is refused.

use super::{Ended, Left, RunStep, SimplifyRun};
use crate::config::{Config, MinComponent, Target, Texture, Until};
use crate::error::{Error, Result};
use crate::io::degrees_remark;
use crate::io::ply::{OutputHeader, PlyWriter};
use crate::mesh::bounds::Bounds;
use crate::mesh::global_vertex::GlobalVertex;
use crate::mesh::record::VertexSchema;
use crate::pipeline::concluded::abandon;
use crate::pipeline::prepare::Prepared;
use crate::stages::components::{self, ComponentSizes, Components};
use crate::stages::partition::{self, Partition};
use crate::store::cell_id::CellId;
use crate::store::cells::{CellStore, StoreInfo, VertexLayout};
use crate::store::job::fingerprint::unchanged;
use crate::store::stage_context::StageContext;
use crate::system::parallel::guarded;
use crate::system::pending_file::Seen;

impl SimplifyRun<'_> {
    /// Cuts the input into cells, and takes what is to be known of them before they are simplified.
    pub(in crate::pipeline) fn partition(&mut self) -> Result<RunStep> {
        let cut = self.cut();
        self.partition = self.hold(cut)?;
        let diagonal = self.partition.bounds.diagonal();
        self.kernel.close = self.config.close.map_or(0.0, |size| size.length(diagonal));
        self.kernel.crumbs = self.config.min_component.map_or(0.0, |min| min.length(diagonal));
        let source = &self.prepared.source;
        let in_degrees = degrees_remark(source, &self.partition.bounds);
        let remarks = source.remarks()?.into_iter().chain(in_degrees);
        remarks.for_each(|remark| self.run.progress.lose(remark));
        if self.config.job.until == Some(Until::Partition) {
            return Ok(RunStep::End(Ended::Early));
        }
        let sizes = hold_sizes(self.config, &self.partition.bounds);
        self.hold(sizes)?;
        let store = match self.config.min_component {
            Some(min) => self.drop_components(min)?,
            None => self.partition.store.clone(),
        };
        if !self.has_area(&store)? {
            return self.hold(Err(no_area(self.config, store.triangles)));
        }
        self.write_seams(&store)?;
        self.begin_level(0, Left::Cells(store))
    }

    /// Ends a job that nothing can continue.
    pub(super) fn hold<T>(&self, outcome: Result<T>) -> Result<T> {
        outcome.map_err(|error| abandon(self.run.job, error))
    }

    fn cut(&mut self) -> Result<Partition> {
        let (config, Prepared { source, marks, .. }) = (self.config, &self.prepared);
        let (size, n) = (self.config.cell_triangles, source.n_triangles());
        let partition = self.stages.stage(
            ("partition", "partition"),
            n,
            |p: &Partition| p.store.triangles,
            |run| {
                // Nothing reads the input after this.
                let outcome = guarded(|| {
                    let mut partition = partition::partition(source, size, run)?;
                    if config.needs_size() {
                        partition
                            .narrow(VertexLayout::new(source.schema(), source.n_vertices()), run)?;
                    }
                    Ok(partition)
                });
                unchanged(&config.input, marks, outcome)
            },
        )?;
        if let Some(report) = self.stages.reports.last_mut() {
            report.bytes_read += source.file_bytes();
        }
        self.shared_by_round.push(partition.store.shared_vertices);
        if partition.store.triangles == 0 {
            let what = format!(
                "all of its {} faces are degenerate: no triangle has three different corners",
                source.n_face_rows()
            );
            return Err(Error::bad_input(&config.input, what));
        }
        Ok(partition)
    }

    /// Finds the components and leaves out what is too small.
    fn drop_components(&mut self, min: MinComponent) -> Result<StoreInfo> {
        let partition = &self.partition;
        let least = components::Least::of(min, partition.bounds.diagonal());
        let (info, layout) = (partition.store.clone(), self.layout.clone());
        let found = self.stages.stage(
            ("components", "components"),
            partition.store.triangles,
            |c: &Components| c.store.triangles,
            |run| {
                let store = CellStore::open(run.disk(), run.job.folder(), info, layout)?;
                components::find(&store, least, run)
            },
        )?;
        components::tidy_up(&self.run)?;
        let sizes = &found.sizes;
        self.run.progress.note(format!(
            "components {}, {} are dropped; of fewer triangles than {}",
            sizes.found,
            sizes.dropped,
            components::below_list(sizes)
        ));
        if found.store.triangles == 0 {
            return self.hold(Err(nothing_left(self.config, sizes)));
        }
        self.component_sizes = Some(found.sizes);
        Ok(found.store)
    }

    /// True if the input has an area; found once, since stores are removed on the way.
    fn has_area(&self, info: &StoreInfo) -> Result<bool> {
        let run = self.run;
        run.job.sealed("has area", || self.store(info.clone())?.has_area(run.progress))
    }

    /// Writes the vertices on seams, if that was asked for; the cells go with the first round.
    fn write_seams(&self, store: &StoreInfo) -> Result<()> {
        let Some(seen) = &self.seams else { return Ok(()) };
        let name = format!("seams {}", seen.path().display());
        if self.run.job.outcome::<()>(&name)?.is_none() || !seen.path().exists() {
            write_seam_points(&self.store(store.clone())?, seen, &self.run)?;
            self.run.job.record(&name, &())?;
        }
        Ok(())
    }
}

/// Refuses sizes that what was asked for cannot reckon with: texels, charts and boxes of crossings are floats, and bounds take fourth
/// powers of lengths.
fn hold_sizes(config: &Config, bounds: &Bounds) -> Result<()> {
    let kernel = &config.kernel;
    let hold = |what: &str, sizes| {
        bounds.hold(what, sizes).map_err(|what| Error::bad_input(&config.input, what))
    };
    if config.texture == Texture::Bake || config.bake.normals {
        hold("a new texture or normal map", [1e-36, 1e36])?;
    }
    if config.close.is_some() {
        hold("--close", [0.0, 1e36])?;
    }
    if kernel.no_self_intersections {
        hold("--no-self-intersections", [0.0, 1e36])?;
    }
    if kernel.bound.is_some() || matches!(config.target, Target::MaxError(_)) {
        hold("--max-error", [0.0, 1e50])?;
    }
    Ok(())
}

fn no_area(config: &Config, triangles: u64) -> Error {
    let what = format!(
        "all of its {triangles} triangles have no area beyond the rounding of their coordinates: their corners lie in one place \
         or on one line within it; nothing was written"
    );
    Error::bad_input(&config.input, what)
}

/// An empty result is never a success.
fn nothing_left(config: &Config, sizes: &ComponentSizes) -> Error {
    let min = config.min_component.map_or_else(String::new, |min| min.to_string());
    let what = format!(
        "--min-component {min} would drop all {} components, the largest of {} triangles; give a smaller value; \
         nothing was written",
        sizes.found, sizes.largest
    );
    Error::Empty { path: config.output.clone(), what }
}

/// Shows where the cells were: writes the vertices that they share as a point set, for tests and for doubters.
/// Memory: 32 bytes per shared vertex.
fn write_seam_points(store: &CellStore, to: &Seen, run: &StageContext) -> Result<()> {
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
    header.settings = crate::system::first_bytes::SEAMS_SETTINGS.to_owned();
    let mut writer = PlyWriter::create(to.place(run.disk()), header)?;
    writer.write_vertices(&records)?;
    writer.finish()?;
    Ok(())
}
