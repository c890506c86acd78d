//! The phases of a partition in parts: scan, tree, scatter, share; and what joins them.
//!
//! A part that is done again writes other files than before, so whoever comes later takes the names of all packs from the
//! records of today.

use super::phases::{PhaseRun, stage_report, unit_file};
use super::task::Task;
use crate::error::Result;
use crate::io::ply::MeshSource;
use crate::pipeline::prepare::prepare;
use crate::pipeline::run_report::StageReport;
use crate::stages::partition::{
    Part, Partition, Scanned, Scattered, SharedPart, join_parts, scan_part, scatter_part,
    share_part, tree_of_parts,
};
use crate::store::cells::{PackFile, VertexLayout};
use crate::store::job::Job;
use crate::store::job::fingerprint::unchanged;
use crate::store::job::units::{Record, Unit};
use crate::store::stage_context::StageContext;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::time::Duration;

/// Name of the outcome of a part.
const PART: &str = "part";

impl PhaseRun<'_> {
    /// Bounds and sample of a part.
    pub(super) fn scan(self, task: &Task) -> Result<Record> {
        let size = self.config.cell_triangles;
        self.of_part("scan", task, |source, part, run| {
            let found = scan_part(source, size, part, run)?;
            Ok((found.samples.clone(), found))
        })
    }

    /// The cells.
    pub(super) fn tree(self) -> Result<Record> {
        let job = self.guest(BTreeMap::new());
        let source = prepare(self.config)?.source;
        self.progress.begin("partition", 1, 1, 0);
        let parts: Vec<Scanned> = self.parts("scan")?;
        tree_of_parts(&source, self.config.cell_triangles, &parts, &self.context(&job))?;
        Ok(Record { outcomes: job.recorded(), ..Record::default() })
    }

    /// Vertices and triangles of a part into their cells.
    pub(super) fn scatter(self, task: &Task) -> Result<Record> {
        self.of_part("scatter", task, |source, part, run| {
            let found = scatter_part(source, part, run)?;
            Ok((found.cells.clone(), found))
        })
    }

    /// Shared vertices of a part into the cells that use them.
    pub(super) fn share(self, task: &Task) -> Result<Record> {
        let scattered: Vec<Scattered> = self.parts("scatter")?;
        self.of_part("share", task, |source, part, run| {
            let found = share_part(source, part, &scattered, run)?;
            Ok((found.cells.clone(), found))
        })
    }

    /// One part of a phase: `work` gives the pack that it leaves, and its outcome.
    fn of_part<T: Serialize>(
        &self,
        name: &'static str,
        task: &Task,
        work: impl FnOnce(&MeshSource, Part, &StageContext) -> Result<(PackFile, T)>,
    ) -> Result<Record> {
        let prepared = prepare(self.config)?;
        let of = task.frozen.units_of(name).len() as u32;
        let part = Part { index: task.unit.index, of };
        let triangles = prepared.source.n_triangles() / u64::from(of);
        self.progress.begin(name, 1, 1, triangles);
        let job = self.guest(BTreeMap::new());
        let run = StageContext { checkpoint_every: Duration::MAX, ..self.context(&job) };
        let outcome = work(&prepared.source, part, &run);
        let (pack, outcome) = unchanged(&self.config.input, &prepared.marks, outcome)?;
        let outcome = serde_json::to_value(outcome).expect("plain data");
        let outcomes = BTreeMap::from([(PART.to_owned(), outcome)]);
        Ok(Record { outcomes, files: vec![unit_file(pack)], triangles, ..Record::default() })
    }

    /// The outcomes of all parts of a phase.
    fn parts<T: DeserializeOwned>(&self, phase: &str) -> Result<Vec<T>> {
        let records = self.earlier.get(phase).into_iter().flatten();
        records.map(|(_, record)| record.outcome(PART)).collect()
    }

    /// Records the partition that the parts make, if it was done in parts.
    pub(super) fn join_parts(&self, source: &MeshSource, job: &Job) -> Result<()> {
        let (scattered, shared): (Vec<Scattered>, Vec<SharedPart>) =
            (self.parts("scatter")?, self.parts("share")?);
        if scattered.is_empty() {
            return Ok(());
        }
        let size = self.config.cell_triangles;
        let mut partition = join_parts(source, size, (&scattered, &shared), &self.context(job))?;
        if self.config.needs_size() {
            let layout = VertexLayout::new(source.schema(), source.n_vertices());
            partition.narrow(layout, &self.context(job))?;
        }
        let units: Vec<(Unit, Record)> = self.earlier.values().flatten().cloned().collect();
        let triangles = partition.store.triangles;
        let report = StageReport {
            triangles_in: source.n_triangles(),
            ..stage_report("partition", &units, triangles)
        };
        let outcome: (Partition, StageReport) = (partition, report);
        job.record("partition", &outcome)
    }

    /// Puts the names of the parts' packs of today into what is known of the cells.
    pub(super) fn name_packs(&self, outcomes: &mut BTreeMap<String, serde_json::Value>) {
        let units = ["scatter", "share"].map(|phase| self.earlier.get(phase));
        let records = units.into_iter().flatten().flatten();
        let files: Vec<PackFile> = records
            .flat_map(|(_, record)| &record.files)
            .map(|file| PackFile { pack: file.pack.clone(), pack_bytes: file.bytes })
            .collect();
        for name in ["partition", "components"] {
            let store =
                outcomes.get_mut(name).and_then(|outcome| outcome.get_mut(0)?.get_mut("store"));
            let packs = store.and_then(|store| store.get_mut("packs")?.as_array_mut());
            for (pack, file) in packs.into_iter().flatten().zip(&files) {
                *pack = serde_json::to_value(file).expect("plain data");
            }
        }
    }
}
