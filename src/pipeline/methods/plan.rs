//! The plan of a method other than the collapse: grid, memory, output, from a survey of the vertices.

use crate::config::{Config, Method, Target};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::methods::MANIFOLD_TRIANGLE_BYTES;
use crate::methods::cluster::{self, Need, Survey};
use crate::methods::{decimate, retile};
use crate::pipeline::plan::MANIFEST_BYTES;
use crate::pipeline::plan::disk::check_space;
use crate::pipeline::plan::output::output;
use crate::system::memory::BASE_BYTES;
use crate::system::progress::StageSeconds;
use crate::system::units::{show_bytes, show_count, show_length};

/// Speed of a pass of the clustering on one core of the reference machine in triangles/s, and of the decimation on one core
/// in all, for the expected time only.
const CLUSTERED_PER_SECOND_PER_CORE: f64 = 1.5e7;
const DECIMATED_PER_SECOND: f64 = 0.08e6;
/// The same of the re-tiling, in triangles of the input.
const RETILED_PER_SECOND: f64 = 1.3e6;

/// Forecast of a run.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MethodPlan {
    /// The method.
    pub method: &'static str,
    /// Triangles of the input.
    pub triangles_in: u64,
    /// Triangles wanted, at most; with `--grid` those that are expected.
    pub target: u64,
    /// Length of a cell, in input units; only of a grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cell_size: Option<f64>,
    /// Expected occupied cells; only of a grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cells: Option<u64>,
    /// Expected triangles of the result.
    pub expected_triangles: u64,
    /// Memory for positions of vertices, in bytes.
    pub position_memory_bytes: u64,
    /// True if all positions fit into it.
    pub holds_all_positions: bool,
    /// Memory that the run needs at least, in bytes.
    pub needed_memory_bytes: u64,
    /// Bytes in the job folder.
    pub temp_bytes: u64,
    /// Bytes of the output.
    pub output_bytes: u64,
    /// Bytes kept in the output's folder while it is written, besides the output.
    pub spool_bytes: u64,
    /// Expected seconds, without those of the survey.
    pub seconds: f64,
}

impl MethodPlan {
    /// Plans a run; `survey` belongs to a grid. Fails with `NoMemory` where the budget cannot hold what the method keeps.
    pub(super) fn new(
        source: &MeshSource,
        survey: Option<&Survey>,
        target: Option<u64>,
        config: &Config,
    ) -> Result<MethodPlan> {
        let threads = config.threads.get();
        let codec = source.schema().kernel_codec(&config.attributes.labels);
        let triangles_in = source.n_triangles();
        let most = target.unwrap_or(triangles_in).min(triangles_in);
        let (need, expected, vertices) = match survey {
            Some(survey) => {
                let expected = survey.triangles().min(triangles_in as f64) as u64;
                let mut need = cluster::need(source, survey, &codec, threads)?;
                if config.method == (Method::Cluster { manifold: true }) {
                    need.tables += MANIFOLD_TRIANGLE_BYTES * expected;
                }
                (need, expected, survey.cells as u64)
            }
            None => {
                let share = most as f64 / triangles_in as f64;
                let vertices = (share * source.n_vertices() as f64) as u64;
                let record_bytes = match source.schema().properties.is_empty() {
                    true => 0,
                    false => (4 * codec.n_channels() + source.schema().record_bytes()) as u64,
                };
                let tables = match config.method {
                    Method::Retile { gradation } => retile::need(source, &codec, most, gradation),
                    _ => decimate::need(source) + vertices * record_bytes,
                };
                (Need { tables, positions: 0, all_positions: 0 }, most, vertices)
            }
        };
        let needed = BASE_BYTES + need.tables + need.positions;
        if needed > config.memory_bytes {
            return Err(too_little(config, needed, &need));
        }
        let (output_bytes, spool_bytes) = output(source, config, vertices, expected)?;
        let position_memory_bytes = config.memory_bytes - BASE_BYTES - need.tables;
        let verifying =
            if config.checks.verify { 3 * output_bytes + source.file_bytes() } else { 0 };
        let per_second = match survey {
            Some(_) => CLUSTERED_PER_SECOND_PER_CORE * threads as f64,
            None if matches!(config.method, Method::Retile { .. }) => RETILED_PER_SECOND,
            None => DECIMATED_PER_SECOND,
        };
        Ok(MethodPlan {
            method: config.method.name(),
            triangles_in,
            target: target.unwrap_or(expected),
            cell_size: survey.map(|survey| survey.grid.cell_size),
            cells: survey.map(|_| vertices),
            expected_triangles: expected,
            position_memory_bytes,
            holds_all_positions: need.all_positions <= position_memory_bytes,
            needed_memory_bytes: needed,
            // The output counts until it has its name.
            temp_bytes: MANIFEST_BYTES + verifying + output_bytes,
            output_bytes,
            spool_bytes,
            seconds: triangles_in as f64 / per_second,
        })
    }

    /// The seconds of the stages.
    pub fn stage_seconds(&self) -> Vec<StageSeconds> {
        let name = match self.method {
            "decimate" => "decimate",
            "retile" => "retile",
            _ => "cluster",
        };
        vec![(name, self.seconds)]
    }

    /// Fails where the output would not fit, or its folder does not take files.
    pub(super) fn check_disk(&self, config: &Config) -> Result<()> {
        let written = self.output_bytes + self.spool_bytes;
        check_space(
            (&config.output, &config.job_folder),
            self.temp_bytes - self.output_bytes,
            written,
            self.temp_bytes + self.spool_bytes,
            config.job.min_free_bytes,
        )
    }

    /// The plan for people, one fact a line.
    pub fn lines(&self, config: &Config) -> Vec<String> {
        let positions = match self.holds_all_positions {
            true => "all vertices in memory".to_owned(),
            false => format!(
                "{} for vertices, read again as needed",
                show_bytes(self.position_memory_bytes)
            ),
        };
        let method = match (self.cell_size, self.cells) {
            (Some(size), Some(cells)) => format!(
                "a grid of cells of {}, about {} occupied; one pass",
                show_length(size),
                show_count(cells)
            ),
            _ => match config.method {
                Method::Retile { gradation } => {
                    format!("vertices are spread over the surface in memory; gradation {gradation}")
                }
                Method::Decimate { feature_angle } => {
                    format!("vertices are removed in memory; feature angle {feature_angle}")
                }
                Method::Collapse | Method::Cluster { .. } => String::new(),
            },
        };
        vec![
            format!("input    {} triangles", show_count(self.triangles_in)),
            match config.target {
                Target::CellSize(_) => format!(
                    "target   as many triangles as the grid leaves, about {}",
                    show_count(self.expected_triangles)
                ),
                _ => format!(
                    "target   {} triangles, at most; about {} expected",
                    show_count(self.target),
                    show_count(self.expected_triangles)
                ),
            },
            format!("method   {}: {method}", self.method),
            format!(
                "memory   budget {}, at least {} needed; {positions}; {} threads",
                show_bytes(config.memory_bytes),
                show_bytes(self.needed_memory_bytes),
                config.threads
            ),
            format!("disk     {} output", show_bytes(self.output_bytes)),
            format!("time     about {:.0} s", self.seconds.max(1.0)),
        ]
    }
}

/// Refuses a budget, and says what would help.
fn too_little(config: &Config, needed: u64, need: &Need) -> Error {
    let why = match config.method {
        Method::Cluster { .. }
            if need.positions >= need.all_positions && need.positions > need.tables =>
        {
            ", since its faces are not in the order of its vertices and all of these must be at hand; \
             --method collapse takes any order in any memory"
        }
        Method::Cluster { .. } => "; a smaller result needs less",
        Method::Retile { .. } => {
            ", since it works in memory; --method collapse can make the mesh smaller first, in any memory"
        }
        Method::Decimate { .. } | Method::Collapse => {
            ", since it works in memory; --method collapse --placement subset keeps to vertices of the input as well, in \
             any memory"
        }
    };
    Error::NoMemory(format!(
        "the budget of {} is too small for --method {}, {} are needed: give at least --memory {}MiB{why}",
        show_bytes(config.memory_bytes),
        config.method.name(),
        show_bytes(needed),
        // Long triangles are cut before there is anything to choose from; how many there are is not known yet.
        match config.method {
            Method::Retile { .. } =>
                (BASE_BYTES + 4 * needed.saturating_sub(BASE_BYTES)).div_ceil(1 << 20),
            _ => needed.div_ceil(1 << 20),
        },
    ))
}
