//! The forecast of a comparison of two files: memory, temporary files, time.

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

/// Samples, or triangles, that a core of the reference machine measures in a second.
const TRIANGLES_PER_SECOND: f64 = 2.6e6;
/// Seconds of a sample of meshes of a million triangles together; of larger ones they grow with this power of the count.
const SAMPLE_SECONDS: f64 = 0.75e-6;
const SAMPLE_POWER: f64 = 0.4;
/// Seconds of a triangle of the partition, and times as long as in memory, where the original is cut into cells.
const CUT_SECONDS: f64 = 0.06e-6;
const IN_CELLS: f64 = 1.2;
/// Seconds of a certificate for a triangle.
const CERTIFY_SECONDS: f64 = 1e-6;

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
        let n = triangles.iter().sum::<u64>() as f64;
        let of_sample = SAMPLE_SECONDS * (n * 1e-6).powf(SAMPLE_POWER);
        let seconds = 2.0 * request.options.samples as f64 * of_sample + n / TRIANGLES_PER_SECOND;
        let threads = request.options.threads as f64;
        let mut stage_seconds = Vec::new();
        if in_cells {
            stage_seconds.push(("partition", CUT_SECONDS * n));
        }
        stage_seconds.push(("measure", seconds / threads * if in_cells { IN_CELLS } else { 1.0 }));
        if request.options.certify.is_some() {
            stage_seconds.push(("certify", CERTIFY_SECONDS * n / threads));
        }
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
