//! What is kept of every run, as it lies in the JSON files.

use crate::child::{Ending, Usage};
use crate::inside::Inner;
use serde::{Deserialize, Serialize};
use stonecut::mesh::topology_counts::Topology;

/// One run of one tool.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Run {
    /// The whole process.
    pub usage: Usage,
    /// The simplification alone, where the driver tells.
    pub inner: Option<Inner>,
    /// The tool's own account by stage: name and seconds; only stonecut.
    #[serde(default)]
    pub stages: Vec<(String, f64)>,
}

/// How good a result is.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Quality {
    /// Of the mesh that went in.
    pub before: Topology,
    /// Of the result.
    pub after: Topology,
    /// Samples a side that were asked for.
    #[serde(default)]
    pub samples: u64,
    /// Two-sided root mean square distance, input units.
    pub rms: f64,
    /// The same from the original to the result alone.
    #[serde(default)]
    pub rms_forward: f64,
    /// The larger of the two directions' 99.9th percentiles, input units.
    pub p999: f64,
    /// The larger of the two directions' maxima, input units.
    pub max: f64,
    /// Diagonal of the original's bounding box.
    pub diagonal: f64,
    /// Result triangles that face against the original; `None` where the original was too large to ask.
    pub facing_against: Option<u64>,
}

/// One tool on one mesh to one target.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Row {
    /// Name of the mesh.
    pub mesh: String,
    /// Name of the tool.
    pub peer: String,
    /// Its version; empty if it is not installed.
    pub version: String,
    /// Triangles that went in.
    pub triangles_in: u64,
    /// Triangles asked for.
    pub target: u64,
    /// Threads it was allowed; 0 where it decides itself.
    pub threads: u64,
    /// All runs, in order; the last one may have failed.
    pub runs: Vec<Run>,
    /// What went wrong, in words; empty if nothing did.
    pub trouble: String,
    /// Of the last result.
    pub quality: Option<Quality>,
    /// Whether the runs are from an earlier session.
    #[serde(default)]
    pub cached: bool,
}

impl Row {
    /// The runs that ended with a result.
    pub fn good(&self) -> impl Iterator<Item = &Run> {
        // 3 is stonecut's code for «finished, but short of the target».
        self.runs.iter().filter(|run| matches!(run.usage.ending, Ending::Exit(0 | 3)))
    }

    /// Median, least and largest of a number over the runs that ended with a result.
    pub fn spread(&self, of: impl Fn(&Run) -> f64) -> Option<Spread> {
        Spread::of(self.good().map(of).collect())
    }

    /// Seconds of the simplification alone on one core: CPU time where the driver tells it, else of the process.
    pub fn core_seconds(&self) -> Option<Spread> {
        self.spread(|run| {
            let whole = run.usage.user + run.usage.system;
            run.inner.as_ref().map_or(whole, |inner| inner.cpu_seconds)
        })
    }

    /// Input triangles per second of wall time, the whole process.
    pub fn triangles_per_second(&self) -> Option<f64> {
        self.spread(|run| run.usage.wall).map(|s| self.triangles_in as f64 / s.median)
    }

    /// Root mean square error as a share of the diagonal.
    pub fn relative_rms(&self) -> Option<f64> {
        self.quality.as_ref().map(|q| q.rms / q.diagonal)
    }
}

/// The middle and the ends of several measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The median; the mean of the two middle ones if their number is even.
    pub median: f64,
    /// The least.
    pub min: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// `None` of nothing.
    pub fn of(mut values: Vec<f64>) -> Option<Spread> {
        values.sort_by(f64::total_cmp);
        let (&min, &max) = (values.first()?, values.last()?);
        let half = values.len() / 2;
        let median = if values.len() % 2 == 1 {
            values[half]
        } else {
            (values[half - 1] + values[half]) / 2.0
        };
        Some(Spread { median, min, max })
    }
}

/// Where and with what everything was measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Machine {
    /// Processor and cores.
    pub processor: String,
    /// Physical memory.
    pub memory_bytes: u64,
    /// Load average of the last minute, at the start.
    pub load: String,
    /// Commit of the working tree.
    pub commit: String,
    /// Day.
    pub date: String,
    /// The command line.
    pub command: String,
}

impl Machine {
    /// This machine, now.
    pub fn here() -> Machine {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = cpuinfo
            .lines()
            .find_map(|line| line.strip_prefix("model name"))
            .map_or("unknown processor", |rest| rest.trim_start_matches([' ', '\t', ':']));
        let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
        // Where this machine keeps its files is nobody's business: names stand for paths.
        let name =
            |word: String| match word.strip_prefix('/').and_then(|rest| rest.rsplit('/').next()) {
                Some(name) => name.to_owned(),
                None => word,
            };
        let arguments: Vec<String> = std::env::args().skip(1).map(name).collect();
        Machine {
            processor: format!("{} cores of {model}", stonecut::system::memory::cores()),
            memory_bytes: stonecut::system::memory::limit_bytes(),
            load: load.split(' ').next().unwrap_or_default().to_owned(),
            commit: said_by("git", &["describe", "--always", "--dirty"]),
            date: said_by("date", &["-u", "+%F"]),
            command: format!("bench {}", arguments.join(" ")),
        }
    }

    /// In one sentence.
    pub fn words(&self) -> String {
        format!(
            "{}, {}; {}; commit {}; load average at the start {}.",
            self.processor,
            stonecut::system::units::show_bytes(self.memory_bytes),
            self.date,
            self.commit,
            self.load
        )
    }
}

fn said_by(program: &str, arguments: &[&str]) -> String {
    let output = std::process::Command::new(program)
        .args(arguments)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output();
    output.map_or_else(
        |_| "unknown".to_owned(),
        |output| String::from_utf8_lossy(&output.stdout).trim().to_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_numbers() {
        let of = |values: &[f64]| Spread::of(values.to_vec()).map(|s| (s.median, s.min, s.max));
        assert_eq!(of(&[3.0, 1.0, 2.0]), Some((2.0, 1.0, 3.0)));
        assert_eq!(of(&[4.0, 1.0]), Some((2.5, 1.0, 4.0)));
        assert_eq!(of(&[]), None);
    }

    #[test]
    fn failed_runs_do_not_count() {
        let run = |ending, wall| Run {
            usage: Usage { ending, wall, ..Usage::default() },
            ..Run::default()
        };
        let row = Row {
            runs: vec![run(Ending::Exit(0), 2.0), run(Ending::Signal(11), 9.0)],
            triangles_in: 10,
            ..Row::default()
        };
        assert_eq!(row.triangles_per_second(), Some(5.0));
    }
}
