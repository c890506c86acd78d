//! Judges whether a result can stand for its input, from what probes found in every round.
//!
//! A mesh stands for a surface as long as its triangles are long against their distance from it. Where the error
//! comes near to the length of the edges, the surface has come apart into shards, whatever the count.

use crate::quality::{Quality, QualityAt};
use serde::{Deserialize, Serialize};

/// A result may no longer stand for its input from this root mean square error over mean edge on. Clean scans stay
/// below 0.05 down to some hundred triangles. A chest CT has 0.05 at 1 %, 0.07 at 0.2 %, and 0.085 at 0.1 %, where a
/// fifth of it faces the wrong way (docs/results/real-scans.md, "What a scan can bear").
const MOST_ERROR_PER_EDGE: f64 = 0.08;
/// From there to this ratio a result still stands for its input, unless `MOST_AGAINST` of it faces the wrong way: an
/// interior full of small things has 0.08 at 1 % with a twentieth against it, and all of its walls are right. Scans
/// that were simplified down to shards have 0.15 and more.
const SURELY_TOO_MUCH: f64 = 0.12;
/// Share of the surface that faces the wrong way, as a second witness.
const MOST_AGAINST: f64 = 0.1;
/// Error over the root of the surface's area, about its size, that no result may have. A head of ten triangles has 0.018,
/// a sponge of ten, which is a lump, 0.034.
const MOST_ERROR_OF_SIZE: f64 = 0.02;
/// Share of the volume of closed bodies that a result may lose or gain. Of thin rings, pipes, screws, plates and spheres the default
/// placement keeps 0.93 or more where the error is borne; midpoints keep 0.54 to 0.89 at the same counts, decimation 0.32 to 0.88.
const MOST_OF_VOLUME: f64 = 0.1;
/// Below this share of the volume bodies have vanished, which says too little of how many triangles they take; less than the second is
/// not told from it. Of 30 needles (810 triangles are enough) 8 to 600 triangles lead to 870 to 1600 in one step.
const HALF_LOST: f64 = 0.5;
const LEAST_KEPT: f64 = 0.01;
/// Volume falls a little slower than squares of chords.
const MORE_FOR_VOLUME: f64 = 1.1;
/// A count that is named to those who asked for too few is at least this multiple of theirs.
const CLEARLY_MORE: f64 = 1.25;
/// Below this count the error of a result does not fall steadily (two spheres of 12 triangles have more than of 8), and a count that
/// is named is this multiple of the estimate.
const FEW: f64 = 100.0;
const MORE_OF_FEW: f64 = 2.0;

/// Estimate of how well the result stands for the input, from probes in every round and in the finish.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct QualityReport {
    /// Root mean square distance from the input to the result, in input units.
    pub rms_estimate: f64,
    /// Mean edge of the result, in input units.
    pub mean_edge: f64,
    /// The one over the other.
    pub error_per_edge: f64,
    /// The error over the root of the input's area, the largest on the way.
    pub error_of_size: f64,
    /// Share of the input's area that faces against the result where it is nearest, 0 to 1.
    pub share_against: f64,
    /// Volume of the result over that of the input; absent where the input is not closed, or the result is bounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_kept: Option<f64>,
    /// True if the result can stand for the input; false where it has come apart into shards.
    pub bearable: bool,
    /// The least count of triangles that can be expected to stand for the input; the result's own if it does.
    pub sensible_triangles: u64,
}

/// True if bodies that keep this share of their volume have lost or gained too much.
pub fn is_off_volume(kept: f64) -> bool {
    (kept - 1.0).abs() > MOST_OF_VOLUME
}

impl QualityReport {
    /// Says if closed bodies have come to another volume.
    pub fn is_volume_lost(&self) -> bool {
        self.volume_kept.is_some_and(is_off_volume)
    }

    /// The count at which the volume can be expected to stay, if it does not at this one.
    fn count_for_volume(&self, n_triangles: u64) -> u64 {
        // Chords cut off as much as their squares, which shrink as the count grows; what has vanished cannot lose more.
        let off = self.volume_kept.map_or(0.0, |kept| match kept < HALF_LOST {
            true => (1.0 - kept) * HALF_LOST / kept.max(LEAST_KEPT),
            false => (kept - 1.0).abs(),
        });
        two_digits_up(MORE_FOR_VOLUME * n_triangles as f64 * off / MOST_OF_VOLUME)
    }

    /// Judges the result of a method that estimates no error, by volumes of input and result; `asked` triangles were wanted.
    pub fn of_volumes(
        mean_edge: f64,
        (asked, n_input): (u64, u64),
        volumes: [Option<f64>; 2],
    ) -> Self {
        let volume_kept = match volumes {
            [Some(before), Some(after)] if before > 0.0 => Some(after / before),
            _ => None,
        };
        let judged = QualityReport { mean_edge, volume_kept, ..QualityReport::default() };
        if !judged.is_volume_lost() {
            return judged;
        }
        let more = two_digits_up(CLEARLY_MORE * asked as f64);
        let sensible_triangles = judged.count_for_volume(asked).max(more).min(n_input);
        QualityReport { bearable: false, sensible_triangles, ..judged }
    }
}

impl Default for QualityReport {
    /// Nothing known, nothing wrong: reports of earlier versions have no estimate.
    fn default() -> Self {
        QualityReport {
            rms_estimate: 0.0,
            mean_edge: 0.0,
            error_per_edge: 0.0,
            error_of_size: 0.0,
            share_against: 0.0,
            volume_kept: None,
            bearable: true,
            sensible_triangles: 0,
        }
    }
}

/// State of the surface at one count of triangles.
#[derive(Clone, Copy, Debug)]
struct Point {
    triangles: u64,
    /// Root mean square error over mean edge.
    error_per_edge: f64,
    /// Share of the surface that faces the wrong way.
    share_against: f64,
    /// Root mean square error over the root of the area.
    error_of_size: f64,
}

impl Point {
    /// Written so that NaN is not borne.
    fn is_good(self) -> bool {
        let limit =
            if self.share_against < MOST_AGAINST { SURELY_TOO_MUCH } else { MOST_ERROR_PER_EDGE };
        self.error_per_edge <= limit && self.error_of_size <= MOST_ERROR_OF_SIZE
    }
}

/// Estimates on the way from the input to the result.
#[derive(Clone, Debug, Default)]
pub struct QualityCurve {
    /// Counts of triangles, falling. What is lost is not found again with fewer triangles, so neither measure falls:
    /// whether a count can be borne never depends on how far below it the run went.
    points: Vec<Point>,
    /// Sum of the mean squared errors of all rounds so far. Each is against what the round before left, and
    /// they are independent of each other, so squares add up.
    mean_square: f64,
    share_against: f64,
    mean_edge: f64,
    error_per_edge: f64,
    /// Volume at the end over that at the beginning, where rounds knew both.
    volume_kept: Option<f64>,
}

impl QualityCurve {
    /// Adds a round, or the finish: what it noted on its way, and its end.
    pub fn add_round(&mut self, curve: &[QualityAt], end: Quality, triangles: u64) {
        let end = QualityAt { triangles, quality: end };
        for at in curve.iter().chain([&end]) {
            let rms = (self.mean_square + at.quality.mean_square()).sqrt();
            let edge = at.quality.mean_edge();
            // A surface without edges that is off stands for nothing.
            let now = match (rms > 0.0, edge > 0.0) {
                (_, true) => rms / edge,
                (true, false) => f64::MAX,
                (false, false) => continue,
            };
            self.error_per_edge = now;
            let against = self.share_against + at.quality.share_against();
            let of_size = if at.quality.area > 0.0 { rms / at.quality.area.sqrt() } else { 0.0 };
            let worst = self.points.last().copied();
            self.points.push(Point {
                triangles: at.triangles,
                error_per_edge: worst.map_or(now, |worst| now.max(worst.error_per_edge)),
                share_against: worst.map_or(against, |worst| against.max(worst.share_against)),
                error_of_size: worst.map_or(of_size, |worst| of_size.max(worst.error_of_size)),
            });
        }
        self.mean_square += end.quality.mean_square();
        self.share_against += end.quality.share_against();
        self.mean_edge = end.quality.mean_edge();
        let [before, after] = end.quality.volume;
        if before > 0.0 {
            self.volume_kept = Some(self.volume_kept.unwrap_or(1.0) * after / before);
        }
    }

    /// Says whether the result can be borne, and if not, what count could.
    pub fn judge(&self, n_input: u64) -> QualityReport {
        let last = self.points.last().copied();
        let n_triangles = last.map_or(n_input, |point| point.triangles);
        let enough = |n: u64| n.max(two_digits_up(CLEARLY_MORE * n_triangles as f64)).min(n_input);
        let judged = QualityReport {
            rms_estimate: self.mean_square.sqrt(),
            mean_edge: self.mean_edge,
            error_per_edge: self.error_per_edge,
            error_of_size: last.map_or(0.0, |point| point.error_of_size),
            share_against: self.share_against.min(1.0),
            volume_kept: self.volume_kept,
            bearable: true,
            sensible_triangles: n_triangles,
        };
        let is_good = last.is_none_or(Point::is_good);
        // All that there is can always be borne.
        if n_triangles >= n_input || is_good && !judged.is_volume_lost() {
            return judged;
        }
        let by_error = if is_good { 0 } else { self.least_count(n_input) };
        let sensible_triangles = enough(by_error.max(judged.count_for_volume(n_triangles)));
        QualityReport { bearable: false, sensible_triangles, ..judged }
    }

    /// The least count that surely is good: where few triangles are enough, with a margin.
    fn least_count(&self, n_input: u64) -> u64 {
        match self.count_at_limit(n_input).max(self.count_of_size()) {
            count if (count as f64) < FEW => (MORE_OF_FEW * count as f64).ceil() as u64,
            count => count,
        }
    }

    /// The count at which the error is no longer too large for the size of the surface; it grows as the count falls.
    fn count_of_size(&self) -> u64 {
        let bad = self.points.iter().find(|point| point.error_of_size > MOST_ERROR_OF_SIZE);
        bad.map_or(0, |p| two_digits_up(p.triangles as f64 * p.error_of_size / MOST_ERROR_OF_SIZE))
    }

    /// The count at which error over edge passes the limit: linear in logarithms between two estimates. Where none
    /// is good, from the first one; the ratio grows about as the root of the count falls.
    fn count_at_limit(&self, n_input: u64) -> u64 {
        let Some(good) = self.points.iter().rev().find(|point| point.is_good()) else {
            let (n, x) =
                self.points.first().map_or((n_input, 0.0), |p| (p.triangles, p.error_per_edge));
            let count = n as f64 * (x / MOST_ERROR_PER_EDGE).powi(2);
            return two_digits_up(count.min(n_input as f64)).min(n_input);
        };
        let is_bad = |point: &&Point| point.triangles < good.triangles && !point.is_good();
        let Some(bad) = self.points.iter().find(is_bad) else { return good.triangles };
        if good.error_per_edge <= 0.0 || good.error_per_edge >= MOST_ERROR_PER_EDGE {
            return good.triangles;
        }
        let share = (MOST_ERROR_PER_EDGE / good.error_per_edge).ln()
            / (bad.error_per_edge / good.error_per_edge).ln();
        let high = good.triangles as f64;
        two_digits_up(high * (bad.triangles as f64 / high).powf(share)).min(good.triangles)
    }
}

/// Rounds up to two digits: more would promise too much.
pub fn two_digits_up(count: f64) -> u64 {
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

    /// The same with a share of the surface that faces the wrong way.
    fn against(triangles: u64, error_per_edge: f64, share: f64) -> QualityAt {
        let mut at = at(triangles, error_per_edge / (triangles as f64).sqrt());
        at.quality.area_against = share;
        at
    }

    #[test]
    fn fewer_triangles_are_never_judged_better() {
        let way = [
            against(40_000, 0.05, 0.01),
            against(10_000, 0.09, 0.05),
            against(5000, 0.075, 0.12),
            against(2500, 0.06, 0.2),
        ];
        let judged = |n: usize| {
            let mut curve = QualityCurve::default();
            curve.add_round(&way[..n - 1], way[n - 1].quality, way[n - 1].triangles);
            curve.judge(1_000_000)
        };
        let borne: Vec<bool> = (1..=4).map(|n| judged(n).bearable).collect();
        assert_eq!(borne, [true, true, false, false], "a margin, and no way back");
        for n in 3..=4 {
            let report = judged(n);
            assert!(report.sensible_triangles as f64 >= 1.25 * way[n - 1].triangles as f64);
        }
    }

    #[test]
    fn the_count_that_was_given_is_never_named() {
        let mut curve = QualityCurve::default();
        curve.add_round(
            &[against(11_000, 0.079, 0.2)],
            against(10_900, 0.081, 0.2).quality,
            10_900,
        );
        let report = curve.judge(1_000_000);
        assert!(!report.bearable && report.sensible_triangles == 14_000, "{report:?}");
        assert!(curve.judge(10_900).bearable, "all that there is");
    }

    #[test]
    fn what_is_off_and_has_no_edges_is_not_borne() {
        let mut curve = QualityCurve::default();
        let quality = Quality { area: 1.0, squared_error: 0.01, ..Quality::default() };
        curve.add_round(&[], quality, 10);
        let report = curve.judge(1000);
        assert!(!report.bearable && report.sensible_triangles == 1000, "{report:?}");
    }

    #[test]
    fn few_triangles_that_are_named_are_enough() {
        // The error, about 1 over the count, is 0.024 of the size at 10: it is 0.02 at 12.
        let mut curve = QualityCurve::default();
        curve.add_round(&[at(100_000, 2.4e-6)], at(10, 0.024).quality, 10);
        let report = curve.judge(1_000_000);
        assert!(!report.bearable && report.sensible_triangles == 24, "{report:?}");
        assert_eq!(curve.judge(12).sensible_triangles, 12, "all that there is");
    }

    #[test]
    fn volume_that_is_lost_is_not_borne() {
        let judged = |after: f64| {
            let mut curve = QualityCurve::default();
            let mut end = at(10_000, 1e-4).quality;
            end.volume = [2.0, after];
            curve.add_round(&[], end, 10_000);
            curve.judge(1_000_000)
        };
        assert!(judged(1.9).bearable && judged(2.1).bearable);
        let report = judged(1.2);
        assert!(!report.bearable && report.sensible_triangles == 44_000, "{report:?}");
    }

    #[test]
    fn errors_of_rounds_add_up() {
        let mut curve = QualityCurve::default();
        curve.add_round(&[], at(40_000, 3e-4).quality, 40_000);
        curve.add_round(&[], at(10_000, 4e-4).quality, 10_000);
        assert!((curve.judge(1_000_000).rms_estimate - 5e-4).abs() < 1e-12);
    }
}
