//! The standing of a job in units, from its files alone.

use crate::error::Result;
use crate::store::job::units::{Frozen, Record, Unit, UnitJob};
use crate::system::progress::Progress;
use serde::Serialize;
use std::collections::BTreeMap;

/// A phase, and how far it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhaseStanding {
    /// Its name.
    pub name: String,
    /// Number of units.
    pub units: u32,
    /// Units that are done.
    pub done: u32,
    /// Seconds of all attempts that count.
    pub seconds: f64,
    /// Processor time of these.
    pub processor_seconds: f64,
    /// Bytes of job files that they have read and written.
    pub bytes_read: u64,
    /// Bytes that they have written.
    pub bytes_written: u64,
    /// The largest peak of memory among them.
    pub peak_memory_bytes: u64,
}

/// The standing of a job.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Standing {
    /// Version of the program.
    pub version: String,
    /// The input.
    pub input: String,
    /// Triangles of the input.
    pub triangles: u64,
    /// The phases, in order.
    pub phases: Vec<PhaseStanding>,
    /// Share of the whole that is done, 0 to 1; an estimate.
    pub share: f64,
    /// True if the output stands.
    pub is_over: bool,
    /// Seconds from the begin of the first unit to the end of the last one that is done.
    pub seconds: f64,
    /// The report of the run, once it is over.
    pub report: Option<serde_json::Value>,
}

/// Reads the records that are not `known` yet, and sums up.
pub fn standing(
    job: &UnitJob,
    known: &mut BTreeMap<Unit, Record>,
    progress: &Progress,
) -> Result<Standing> {
    let frozen: Frozen = job.frozen(progress)?;
    for unit in job.done()? {
        if !known.contains_key(&unit)
            && let Ok(Some(record)) = job.record(&unit)
        {
            known.insert(unit, record);
        }
    }
    let began = known.values().map(|record| record.span[0]).fold(f64::INFINITY, f64::min);
    let ended = known.values().map(|record| record.span[1]).fold(0.0, f64::max);
    let mut phases = Vec::new();
    let (mut done_seconds, mut all_seconds) = (0.0, 0.0);
    for phase in &frozen.phases {
        let records = || known.iter().filter(|(u, _)| u.phase == phase.name).map(|(_, r)| r);
        let done = records().count() as u32;
        done_seconds += phase.seconds * f64::from(done);
        all_seconds += phase.seconds * f64::from(phase.units);
        phases.push(PhaseStanding {
            name: phase.name.clone(),
            units: phase.units,
            done,
            seconds: records().map(|record| record.span[1] - record.span[0]).sum(),
            processor_seconds: records().map(|record| record.processor_seconds).sum(),
            bytes_read: records().map(|record| record.bytes_read).sum(),
            bytes_written: records().map(|record| record.bytes_written).sum(),
            peak_memory_bytes: records().map(|record| record.peak_memory_bytes).max().unwrap_or(0),
        });
    }
    let last = phases.last();
    let is_over = last.is_some_and(|phase| phase.done == phase.units);
    let mut reports = known.values().filter_map(|record| record.outcomes.get("report"));
    Ok(Standing {
        version: frozen.version,
        input: frozen.identity.input,
        triangles: frozen.triangles,
        share: if is_over { 1.0 } else { done_seconds / all_seconds.max(1e-9) },
        is_over,
        seconds: (ended - began).max(0.0),
        report: reports.next().cloned(),
        phases,
    })
}
