//! Decides about the fit of results to the original: if there is one, and how closely it looks.
//!
//! `--fit on` fits every round and the finish, `auto` where that costs at most 15 % of the run: a finish that keeps little, and
//! the later rounds of a result that is too large for a finish, there with one sample for each triangle
//! (docs/results/quality.md, "The fit through cells").

use crate::config::Config;
use crate::kernel::{Fit, Options, Placement};
use crate::stages::stitch::FINISH_CELLS;

/// `Fit::Auto` fits results too large for one finish where at most this share of the triangles is left: 10 %, with room for targets
/// that were rounded up. Beyond it the later rounds have most of the triangles, and so does the fit.
const LARGE_RATIO: f64 = 0.11;

/// Decides the fit of a result of `target` triangles from `n_triangles`.
pub(super) fn decided(config: &Config, n_triangles: u64, target: u64) -> Fit {
    match is_large(config, n_triangles, target) {
        true => Fit::On,
        false => config.kernel.fit.decided(n_triangles, target),
    }
}

/// Sets the options of the kernel for such a result.
pub(super) fn decide(options: &mut Options, config: &Config, n_triangles: u64, target: u64) {
    options.fit = decided(config, n_triangles, target);
    options.fits_first_round = config.kernel.fit == Fit::On;
    options.sparse_rounds = is_large(config, n_triangles, target);
}

/// True if the triangles of a job carry the relief of the original from round to round: where a level ends with a fit.
pub(super) fn carries_relief(config: &Config, n_triangles: u64) -> bool {
    let kernel = &config.kernel;
    let is_free = kernel.placement == Placement::Optimal && kernel.bound.is_none();
    let mut levels = config.targets().map(|target| target.triangles(n_triangles));
    is_free && levels.any(|target| decided(config, n_triangles, target) == Fit::On)
}

/// True if a result is fitted in rounds only because it is large.
fn is_large(config: &Config, n_triangles: u64, target: u64) -> bool {
    let finish = config.cell_triangles.saturating_mul(FINISH_CELLS);
    let is_cheap = target as f64 <= n_triangles as f64 * LARGE_RATIO;
    config.kernel.fit == Fit::Auto
        && target > finish
        && is_cheap
        && !config.kernel.fit.applies(n_triangles, target)
}
