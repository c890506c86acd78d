//! `bench cluster`: a job in units on other numbers of workers, from the records of one that was run.
//!
//! List scheduling, phase by phase, of what the records say: processor time and bytes of each unit. A worker computes with all
//! its threads and moves bytes meanwhile; the bandwidth of the file system is shared evenly among the workers that move
//! some, each within its link. Nothing fails, and no engine takes time but for the start of a unit.

use crate::Outcome;
use crate::page::table;
use serde_json::Value;
use std::path::Path;

/// A unit, or what is left of it while it runs.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// Seconds before it begins and after it ends.
    pub start: f64,
    /// Processor time in seconds.
    pub processor: f64,
    /// Bytes read and written.
    pub bytes: f64,
}

/// The machines to plan for.
#[derive(Clone, Copy, Debug)]
pub struct Machines {
    /// Processes at work at once.
    pub workers: usize,
    /// Threads of each, taken to share the work evenly.
    pub threads: f64,
    /// Bytes a second of a worker.
    pub link: f64,
    /// Bytes a second of the file system.
    pub files: f64,
}

/// Share of the input that a unit of a phase reads: vertices are a third of a mesh of bare positions.
fn share_of_input(phase: &str, phases: Option<&Vec<Value>>) -> f64 {
    let units = |name: &str| {
        let phase = phases?.iter().find(|phase| phase["name"] == name);
        phase?["units"].as_f64()
    };
    match (phase, units("scatter")) {
        ("partition", None) => 1.0,
        ("scatter", Some(parts)) => 1.0 / parts,
        ("scan" | "share", Some(parts)) => 1.0 / (3.0 * parts),
        _ => 0.0,
    }
}

/// The phases of a job, with the costs of their units.
#[derive(Clone, Debug)]
pub struct Job {
    names: Vec<String>,
    phases: Vec<Vec<Cost>>,
}

impl Job {
    /// Reads the records of a finished job. `times`: every cost is multiplied; `start` seconds come to each unit.
    pub fn read(folder: &Path, times: f64, start: f64) -> Outcome<Job> {
        let line = |path: &Path| -> Outcome<Value> {
            let text =
                std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
            Ok(serde_json::from_str(text.split('\t').next().unwrap_or_default())?)
        };
        let plan = line(&folder.join("plan.record"))?;
        let plan = &plan["outcome"];
        let input: f64 =
            plan["identity"]["input_marks"]["bytes"].as_str().unwrap_or("0").parse()?;
        let (mut names, mut phases) = (Vec::new(), Vec::new());
        for phase in plan["phases"].as_array().ok_or("no phases in the plan")? {
            let name = phase["name"].as_str().unwrap_or_default();
            let mut units = Vec::new();
            for index in 0..phase["units"].as_u64().unwrap_or(0) {
                let record = line(&folder.join(format!("units/{name}-{index:04}.record")))?;
                let number = |key: &str| record["outcome"][key].as_f64().unwrap_or(0.0);
                // Records count the files of the job and the output.
                let read = input * share_of_input(name, plan["phases"].as_array());
                let bytes = times * (number("bytes_read") + number("bytes_written") + read);
                units.push(Cost { start, processor: times * number("processor_seconds"), bytes });
            }
            names.push(name.to_owned());
            phases.push(units);
        }
        Ok(Job { names, phases })
    }

    /// A row of predicted seconds for each number of workers.
    pub fn table(&self, counts: &[usize], machines: Machines) -> String {
        let header: Vec<String> = std::iter::once("workers".to_owned())
            .chain(self.names.iter().cloned())
            .chain(["all, s".to_owned(), "against 1".to_owned()])
            .collect();
        let seconds = |workers| -> Vec<f64> {
            let machines = Machines { workers, ..machines };
            self.phases.iter().map(|units| simulate(units, machines)).collect()
        };
        let one: f64 = seconds(1).iter().sum();
        let row = |&workers: &usize| -> Vec<String> {
            let phases = seconds(workers);
            let all: f64 = phases.iter().sum();
            std::iter::once(workers.to_string())
                .chain(phases.iter().map(|s| format!("{s:.2}")))
                .chain([format!("{all:.2}"), format!("{:.2}", one / all)])
                .collect()
        };
        let rows: Vec<Vec<String>> = counts.iter().map(row).collect();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        table(&header, &rows)
    }
}

/// Seconds that the units of one phase take.
pub fn simulate(units: &[Cost], machines: Machines) -> f64 {
    let Machines { workers, threads, link, files } = machines;
    let mut waiting = units.iter().copied();
    let mut running: Vec<Cost> = waiting.by_ref().take(workers).collect();
    let mut now = 0.0;
    while !running.is_empty() {
        let moving = running.iter().filter(|unit| unit.start <= 0.0 && unit.bytes > 0.0).count();
        let rate = link.min(files / moving.max(1) as f64);
        // Until anything ends, nothing changes.
        let next = |unit: &Cost| {
            let ends = [unit.processor / threads, unit.bytes / rate];
            let left = ends.into_iter().filter(|&left| left > 0.0).fold(f64::INFINITY, f64::min);
            if unit.start > 0.0 { unit.start } else { left }
        };
        let step = running.iter().map(next).fold(f64::INFINITY, f64::min);
        let step = if step.is_finite() { step } else { 0.0 };
        now += step;
        for unit in &mut running {
            if unit.start > 0.0 {
                unit.start = less(unit.start, step);
            } else {
                unit.processor = less(unit.processor, step * threads);
                unit.bytes = less(unit.bytes, step * rate);
            }
        }
        running.retain(|unit| unit.start > 0.0 || unit.processor > 0.0 || unit.bytes > 0.0);
        let free = workers - running.len();
        running.extend(waiting.by_ref().take(free));
    }
    now
}

/// A difference; what rounding leaves of it is nothing.
fn less(from: f64, step: f64) -> f64 {
    let left = from - step;
    if left <= 1e-9 * from { 0.0 } else { left }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAST: Machines = Machines { workers: 2, threads: 1.0, link: 1e12, files: 1e12 };

    #[test]
    fn units_are_shared_out_in_order() {
        let unit = Cost { start: 0.5, processor: 1.0, bytes: 0.0 };
        let seconds = |n, workers| simulate(&vec![unit; n], Machines { workers, ..FAST });
        assert_eq!(
            [seconds(4, 1), seconds(4, 2), seconds(5, 2), seconds(5, 9)],
            [6.0, 3.0, 4.5, 1.5]
        );
        assert_eq!(simulate(&[], FAST), 0.0);
        assert_eq!(simulate(&[Cost { start: 0.0, processor: 0.0, bytes: 0.0 }], FAST), 0.0);
    }

    #[test]
    fn bandwidth_is_shared_and_moving_overlaps_computing() {
        let unit = Cost { start: 0.0, processor: 2.0, bytes: 1e9 };
        let machines = Machines { files: 1e9, ..FAST };
        // One alone computes longer than it moves; four together move longer.
        assert!((simulate(&[unit], machines) - 2.0).abs() < 1e-6);
        let four = simulate(&[unit; 4], Machines { workers: 4, ..machines });
        assert!((four - 4.0).abs() < 1e-6, "{four}");
        let linked = simulate(&[unit], Machines { link: 1e8, ..machines });
        assert!((linked - 10.0).abs() < 1e-6, "{linked}");
    }
}
