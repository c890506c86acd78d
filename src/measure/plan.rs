//! The forecast of a comparison of two files: memory, temporary files, time.

use crate::Options;
use crate::compare::{Request, simplified_bytes, taken_bytes, usable_bytes, whole_bytes};
use stonecut_io::ply::MeshSource;
use stonecut_stages::partition;
use stonecut_store::cells::VertexLayout;
use stonecut_system::progress::StageSeconds;

/// Forecast of a comparison.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeasurePlan {
    /// Triangles of the original and of the simplified mesh.
    pub triangles: [u64; 2],
    /// Samples on each surface.
    pub samples: u64,
    /// True if the original is cut into cells.
    pub in_cells: bool,
    /// Memory that holds both as a whole, in bytes.
    pub whole_memory_bytes: u64,
    /// Bytes of temporary files.
    pub temp_bytes: u64,
    /// Expected seconds.
    pub seconds: f64,
    /// The same of each stage.
    #[serde(skip)]
    pub stage_seconds: Vec<StageSeconds>,
}

/// Seconds of the reference machine for a triangle: that one core reads, and that all look at.
const LOAD_SECONDS: f64 = 0.02e-6;
const LOOK_SECONDS: f64 = 0.75e-6;
/// Seconds of a sample against a mesh of a million triangles; against larger ones they grow with this power of the count.
/// Statues of 4 k to 4 million triangles.
const SAMPLE_SECONDS: f64 = 0.66e-6;
const SAMPLE_POWER: f64 = 0.2;
/// Seconds of a triangle of the partition, and times as long as in memory, where the original is cut into cells.
const CUT_SECONDS: f64 = 0.06e-6;
const IN_CELLS: f64 = 1.2;
/// Seconds of a certificate for a triangle.
const CERTIFY_SECONDS: f64 = 0.45e-6;
/// Gain of every core after the first.
const SECOND_CORE: f64 = 0.76;

/// Cores' worth of work that threads do at a time.
pub fn cores_of(threads: usize) -> f64 {
    1.0 + SECOND_CORE * (threads - 1) as f64
}

/// Expected seconds of the stages of a comparison in memory: `load`, `measure` with samples on both sides, `certify`.
pub fn stages(triangles: [u64; 2], samples: u64, threads: usize) -> [StageSeconds; 3] {
    let n = triangles.iter().sum::<u64>() as f64;
    let of_mesh = |triangles: u64| SAMPLE_SECONDS * (triangles as f64 * 1e-6).powf(SAMPLE_POWER);
    let of_samples = samples as f64 * triangles.map(of_mesh).iter().sum::<f64>();
    let cores = cores_of(threads);
    [
        ("load", LOAD_SECONDS * n),
        ("measure", (LOOK_SECONDS * n + of_samples) / cores),
        ("certify", CERTIFY_SECONDS * n / cores),
    ]
}

impl MeasurePlan {
    /// The forecast of `compare`.
    pub fn new(request: &Request) -> MeasurePlan {
        let sources = [request.original, request.simplified];
        let in_cells = whole_bytes(request) > usable_bytes(request);
        let store = |source: &MeshSource| {
            let layout = VertexLayout::new(source.schema(), source.n_vertices());
            partition::store_bytes(source.n_vertices(), source.n_triangles(), &layout)
        };
        let second = simplified_bytes(request) > usable_bytes(request) / 3;
        let triangles = sources.map(MeshSource::n_triangles);
        let Options { samples, threads, certify, .. } = &request.options;
        let [load, measure, certificate] = stages(triangles, *samples, *threads);
        let mut stage_seconds = match in_cells {
            false => vec![load, measure],
            true => {
                let n = triangles.iter().sum::<u64>() as f64;
                vec![("partition", CUT_SECONDS * n), (measure.0, IN_CELLS * (load.1 + measure.1))]
            }
        };
        stage_seconds.extend(certify.iter().map(|_| certificate));
        MeasurePlan {
            triangles,
            samples: request.options.samples,
            in_cells,
            whole_memory_bytes: whole_bytes(request) + taken_bytes(request),
            temp_bytes: match (in_cells, second) {
                (false, _) => 0,
                (true, false) => store(sources[0]),
                (true, true) => store(sources[0]) + store(sources[1]),
            },
            seconds: stage_seconds.iter().map(|(_, seconds)| seconds).sum(),
            stage_seconds,
        }
    }
}
