//! The report of a run, from what its stages have counted.

use super::SimplifyRun;
use crate::io::ply::MeshSource;
use crate::pipeline::run_report::{
    BoundReport, FaceReport, InputReport, LevelReport, OutputReport, RunReport, SeamReport,
    StopReason,
};
use crate::stages::partition::Partition;
use crate::stages::write::Written;
use crate::store::cells::Dropped;
use crate::system::json_keys::SCHEMA_VERSION;
use std::collections::BTreeMap;

impl SimplifyRun<'_> {
    /// Report of the level at work.
    pub(super) fn level_report(&self, written: Written) -> LevelReport {
        let met = self.is_bound_only || written.triangles <= self.target;
        let by_bound = self.is_bound_only || (!met && self.config.kernel.bound.is_some());
        let quality = self.quality.judge(self.prepared.source.n_triangles());
        LevelReport {
            path: self.output().display().to_string(),
            vertices: written.vertices,
            triangles: written.triangles,
            bytes: written.bytes,
            target: if self.is_bound_only { written.triangles } else { self.target },
            target_met: met,
            stop_reason: match (by_bound, &self.config.lock) {
                (true, _) => StopReason::WithinBound,
                (false, Some(_)) if !met => StopReason::Locked,
                (false, _) => StopReason::of(met, quality.bearable),
            }
            .to_string(),
            quality,
            hausdorff: None,
            rms: None,
            solid: None,
        }
    }

    /// Report of the whole run; of a chain, from its coarsest level.
    pub(super) fn report(&mut self) -> RunReport {
        let levels = std::mem::take(&mut self.levels);
        let (config, source, partition) = (self.config, &self.prepared.source, &self.partition);
        let (seconds, rate) = self.stages.seconds(self.started, source.n_triangles());
        let coarsest = levels.last().cloned().unwrap_or_default();
        let has_seams = self.layout.codec.has_seams(source.schema());
        let n_materials = source.materials().map_or(0, |materials| materials.list.len());
        RunReport {
            schema_version: SCHEMA_VERSION,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            input: InputReport {
                faults: faults(source, partition, self.dropped.unwrap_or_default()),
                ..InputReport::new(&config.input, source, partition.bounds)
            },
            inputs: source.parts().to_vec(),
            settings: config.settings(),
            cells: partition.store.cells.len() as u32,
            rounds: self.rounds_done,
            seconds,
            triangles_per_second: rate,
            peak_memory_bytes: crate::system::memory::peak_bytes(),
            peak_temp_bytes: self.stages.peak_temp_bytes(),
            output: OutputReport {
                path: coarsest.path,
                vertices: coarsest.vertices,
                triangles: coarsest.triangles,
            },
            rejects: self.rejects.clone(),
            changes: self.changes.clone(),
            fit: self.fit,
            quality: coarsest.quality,
            seams: SeamReport {
                shared_vertices: self.shared_by_round.first().copied().unwrap_or(0),
                shared_vertices_by_round: self.shared_by_round.clone(),
                texture_seam_vertices: has_seams.then_some(self.seam_vertices),
                charts_vanished: has_seams.then_some(self.charts_vanished),
                sample_position: partition.seam_place,
                place: None,
            },
            face_properties: match (source.carried(), self.config.kind()) {
                (Some(carry), Ok(kind)) => FaceReport::list(carry, kind, n_materials),
                _ => Vec::new(),
            },
            target: coarsest.target,
            target_met: levels.iter().all(|level| level.target_met),
            stop_reason: coarsest.stop_reason,
            levels: if config.coarser.is_empty() { Vec::new() } else { levels },
            stages: self.stages.reports.clone(),
            method: config.method.name().to_owned(),
            textures: self.texture_report.take(),
            bake: self.bake_report.take(),
            components: self.component_sizes.take(),
            max_error: self.config.kernel.bound.map(|bound| BoundReport {
                bound: bound.distance,
                tracked_max: Some(self.reach),
                ..BoundReport::default()
            }),
            ..RunReport::default()
        }
    }
}

/// Faults of the input that were dropped, by name.
pub(in crate::pipeline) fn faults(
    source: &MeshSource,
    partition: &Partition,
    dropped: Dropped,
) -> BTreeMap<String, u64> {
    let found = source.faults();
    BTreeMap::from([
        ("degenerate_faces".to_owned(), partition.degenerate_faces),
        ("duplicate_faces".to_owned(), dropped.duplicate_faces),
        ("back_faces".to_owned(), dropped.back_faces),
        (
            "unreferenced_vertices".to_owned(),
            source.unreferenced_vertices() + dropped.unreferenced_vertices,
        ),
        ("bad_faces".to_owned(), partition.bad_faces + found.bad_faces),
        ("bad_vertices".to_owned(), found.bad_vertices),
        ("missing_faces".to_owned(), found.missing_faces),
        ("missing_vertices".to_owned(), found.missing_vertices),
    ])
}
