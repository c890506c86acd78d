//! The forecast of a comparison of two files: memory, temporary files, time.

use crate::compare::{Request, simplified_bytes, taken_bytes, usable_bytes, whole_bytes};
use stonecut_io::ply::MeshSource;
use stonecut_stages::partition;
use stonecut_store::cells::VertexLayout;

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
    /// Expected seconds, without a certificate.
    pub seconds: f64,
}

/// Samples, or triangles, that a core of the reference machine measures in a second.
const SAMPLES_PER_SECOND: f64 = 0.35e6;
const TRIANGLES_PER_SECOND: f64 = 1.5e6;

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
        let seconds = 2.0 * request.options.samples as f64 / SAMPLES_PER_SECOND
            + triangles.iter().sum::<u64>() as f64 / TRIANGLES_PER_SECOND;
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
            seconds: seconds / request.options.threads as f64,
        }
    }
}
