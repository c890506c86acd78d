//! Judges whether a result can stand for its input, from what probes found in every round.
//!
//! A mesh stands for a surface as long as its triangles are long against their distance from it. Where the error
//! comes near to the length of the edges, the surface has come apart into shards, whatever the count.

use crate::kernel::{Quality, QualityAt};
use crate::pipeline::run_report::QualityReport;

/// A result no longer stands for its input from this root mean square error over mean edge on. Clean scans stay
/// below 0.05 down to some hundred triangles. A chest CT has 0.05 at 1 %, 0.07 at 0.2 %, and 0.085 at 0.1 %, where a
/// fifth of it faces the wrong way. Scans that were simplified down to shards have 0.3 and more
/// (docs/results/real-scans.md, "What a scan can bear").
const MOST_ERROR_PER_EDGE: f64 = 0.08;

/// Estimates on the way from the input to the result.
#[derive(Clone, Debug, Default)]
pub(super) struct QualityCurve {
    /// Counts of triangles, falling, with error over edge.
    points: Vec<(u64, f64)>,
    /// Sum of the mean squared errors of all rounds so far. Each is against what the round before left, and
    /// they are independent of each other, so squares add up.
    mean_square: f64,
    share_against: f64,
    mean_edge: f64,
}

impl QualityCurve {
    /// Adds a round, or the finish: what it noted on its way, and its end.
    pub(super) fn add_round(&mut self, curve: &[QualityAt], end: Quality, triangles: u64) {
        let end = QualityAt { triangles, quality: end };
        for at in curve.iter().chain([&end]) {
            let rms = (self.mean_square + at.quality.mean_square()).sqrt();
            let edge = at.quality.mean_edge();
            if edge > 0.0 {
                self.points.push((at.triangles, rms / edge));
            }
        }
        self.mean_square += end.quality.mean_square();
        self.share_against += end.quality.share_against();
        self.mean_edge = end.quality.mean_edge();
    }

    /// Says whether the result can be borne, and if not, what count could.
    pub(super) fn judge(&self, n_input: u64) -> QualityReport {
        let (n_triangles, error_per_edge) = self.points.last().copied().unwrap_or((n_input, 0.0));
        // Written so that NaN is not borne.
        let bearable = error_per_edge <= MOST_ERROR_PER_EDGE;
        QualityReport {
            rms_estimate: self.mean_square.sqrt(),
            mean_edge: self.mean_edge,
            error_per_edge,
            share_against: self.share_against.min(1.0),
            bearable,
            sensible_triangles: if bearable { n_triangles } else { self.least_count(n_input) },
        }
    }

    /// The count at which error over edge passes the limit: linear in logarithms between two estimates. Where none
    /// is good, from the first one; the ratio grows about as the root of the count falls.
    fn least_count(&self, n_input: u64) -> u64 {
        let is_good = |&&(_, x): &&(u64, f64)| x <= MOST_ERROR_PER_EDGE;
        let Some(&(high, low_error)) = self.points.iter().rev().find(is_good) else {
            let (n, x) = self.points.first().copied().unwrap_or((n_input, 0.0));
            return two_digits_up(n as f64 * (x / MOST_ERROR_PER_EDGE).powi(2)).min(n_input);
        };
        let bad = self.points.iter().find(|&&(n, x)| n < high && x > MOST_ERROR_PER_EDGE);
        let Some(&(low, high_error)) = bad else { return high };
        if low_error <= 0.0 {
            return high;
        }
        let share = (MOST_ERROR_PER_EDGE / low_error).ln() / (high_error / low_error).ln();
        let count = (high as f64) * (low as f64 / high as f64).powf(share);
        two_digits_up(count).min(high)
    }
}

/// Rounds up to two digits: more would promise too much.
fn two_digits_up(count: f64) -> u64 {
    let step = 10f64.powf(count.max(1.0).log10().floor() - 1.0).max(1.0);
    ((count / step).ceil() * step) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unit area, the given error, edges of length 1 over the root of the count.
    fn at(triangles: u64, rms: f64) -> QualityAt {
        let squared_error = rms * rms;
        let edge_lengths = 1.0 / (triangles as f64).sqrt();
        let quality =
            Quality { area: 1.0, squared_error, n_edges: 1, edge_lengths, ..Quality::default() };
        QualityAt { triangles, quality }
    }

    #[test]
    fn a_small_error_is_borne() {
        let mut curve = QualityCurve::default();
        curve.add_round(&[at(40_000, 1e-5)], at(10_000, 1e-4).quality, 10_000);
        let report = curve.judge(1_000_000);
        assert!(report.bearable && report.sensible_triangles == 10_000, "{report:?}");
        assert!((report.error_per_edge - 0.01).abs() < 1e-12);
    }

    #[test]
    fn the_least_count_lies_where_the_error_passes_the_limit() {
        let mut curve = QualityCurve::default();
        curve.add_round(&[at(40_000, 0.05 / 200.0)], at(2500, 1.0 / 50.0).quality, 2500);
        let report = curve.judge(1_000_000);
        assert!(!report.bearable);
        // Error over edge is 0.05 at 40,000 and 1 at 2,500: the limit is ln 1.6 / ln 20 of the way.
        let expected = 40_000.0 * (1.0f64 / 16.0).powf(1.6f64.ln() / 20f64.ln());
        assert_eq!(report.sensible_triangles, two_digits_up(expected), "{report:?}");
    }

    #[test]
    fn what_was_never_good_is_extrapolated_up_to_the_input() {
        // Error over edge is 5, or 0.2 at 10,000: 2.5 times less takes 6.25 times as many.
        let mut curve = QualityCurve::default();
        curve.add_round(&[], at(100, 0.5).quality, 100);
        assert_eq!(curve.judge(5000).sensible_triangles, 5000);
        assert!(!curve.judge(5000).bearable);
        let mut curve = QualityCurve::default();
        curve.add_round(&[], at(10_000, 0.002).quality, 10_000);
        assert_eq!(curve.judge(1_000_000).sensible_triangles, 63_000);
    }

    #[test]
    fn errors_of_rounds_add_up() {
        let mut curve = QualityCurve::default();
        curve.add_round(&[], at(40_000, 3e-4).quality, 40_000);
        curve.add_round(&[], at(10_000, 4e-4).quality, 10_000);
        assert!((curve.judge(1_000_000).rms_estimate - 5e-4).abs() < 1e-12);
    }
}
