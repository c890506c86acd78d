//! The time that a run will take, about. For the plan alone: the estimate during the run is measured.

use crate::config::Config;
use crate::io::ply::MeshSource;

/// End-to-end speed on one core of the reference machine, in triangles a second.
const TRIANGLES_PER_SECOND: f64 = 1.7e6;
/// Times as long where vertices carry colours or others that have a weight (legion: 0.76 to 0.94 s for 0.69 M triangles).
const WITH_PROPERTIES: f64 = 1.6;
/// Times as long where charts have seams, their way to vertices included (legion 11, `synth rooms` 5 to 17, 100 M of it 10).
const WITH_SEAMS: f64 = 10.0;
/// Times as long under `--no-self-intersections` (3.8 to 5.3, the legion 8).
const APART: f64 = 5.0;
/// Times as long within a bound on the error (3 to 58; docs/results/bound.md).
const BOUNDED: f64 = 30.0;

/// Seconds that a run of the collapse takes, without a bake.
pub(super) fn of_run(source: &MeshSource, config: &Config, n_triangles: u64) -> f64 {
    let schema = source.schema();
    let mut times = match (schema.codec().has_seams(schema), schema.properties.is_empty()) {
        (true, _) => WITH_SEAMS,
        (false, false) => WITH_PROPERTIES,
        (false, true) => 1.0,
    };
    if config.kernel.no_self_intersections {
        times *= APART;
    }
    if config.kernel.bound.is_some() {
        times *= BOUNDED;
    }
    times * n_triangles as f64 / (TRIANGLES_PER_SECOND * config.threads.get() as f64)
}
