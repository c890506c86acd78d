//! The pace of a run: from counters and a clock to shares done and seconds left.
//!
//! For whoever shows progress: the bar and lines of the command line, and callers in the same process.

use crate::system::progress::Stage;
use std::time::Instant;

/// Start of the estimate: this many weighted triangles, assumed to have been done in this many seconds before
/// the run began. Without it, the first second's estimate would be any number.
const ASSUMED_WEIGHT: f64 = 4e6;
const ASSUMED_SECONDS: f64 = 1.5;
/// A stage is taken to have gone for this many seconds at the pace of those before it: within a bound on the error it is twenty
/// times as slow as they were, and soon shows it.
const HANDED_ON_SECONDS: f64 = 1.5;
/// Neither counts for more than this share of the triangles: many samples of a small mesh take long, too.
const MOST_ASSUMED: f64 = 0.03;

/// Relative cost of a triangle in each stage, for the overall estimate only.
fn weight(stage: &str) -> f64 {
    match stage {
        "partition" => 0.25,
        "components" | "write" => 0.1,
        _ => 1.0,
    }
}

/// Stages that do not count triangles at the pace of others: what they have left is told by themselves.
pub(super) fn has_own_pace(stage: &str) -> bool {
    stage == "bake"
}

/// Share of such a stage that is taken to have been done in no time, so that its first second's estimate is a number.
const HEAD_START: f64 = 0.05;

/// A clock over the stages of one run.
#[derive(Debug)]
pub struct Pace {
    started: Instant,
    stage: Stage,
    /// The last look at the stage before: it began after that.
    stage_started: Instant,
    looked_at: Instant,
    /// Since when the stage counts in its present units.
    part_started: Instant,
    /// Weighted triangles of stages that are over.
    weight_done: f64,
    /// The largest share so far: it never falls.
    fraction: f64,
}

/// Progress of a run at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Triangles of the stage that are done, at most all of them.
    pub done: u64,
    /// The same in one second, since the stage began.
    pub per_second: f64,
    /// Share of the run that is done, 0 to 1; an estimate that never falls.
    pub fraction: f64,
    /// Seconds since the run began.
    pub seconds: f64,
    /// Seconds left of the stage; an estimate.
    pub stage_seconds_left: f64,
    /// Seconds left of the run; an estimate.
    pub seconds_left: f64,
}

impl Default for Pace {
    fn default() -> Pace {
        let now = Instant::now();
        Pace {
            started: now,
            stage: Stage::default(),
            stage_started: now,
            looked_at: now,
            part_started: now,
            weight_done: 0.0,
            fraction: 0.0,
        }
    }
}

impl Pace {
    /// The figures of a running stage with `done` triangles done, and whether it is another stage than before.
    pub fn update(&mut self, stage: Stage, done: u64) -> (Figures, bool) {
        let is_new = stage.number != self.stage.number;
        if is_new {
            self.weight_done += self.stage.total as f64 * weight(self.stage.name);
            self.stage_started = self.looked_at;
        }
        self.looked_at = Instant::now();
        if is_new || stage.total != self.stage.total {
            self.part_started = Instant::now();
        }
        self.stage = stage;
        let stage = &self.stage;
        let own_seconds = self.stage_started.elapsed().as_secs_f64();
        let done = done.min(stage.total);
        let weighted = done as f64 * weight(stage.name);
        let stage_left = (stage.total - done) as f64 * weight(stage.name);
        let ahead = self.weight_ahead();
        let left = stage_left + ahead;
        let so_far = self.weight_done + weighted;
        let seconds = self.started.elapsed().as_secs_f64();
        self.fraction = self.fraction.max(so_far / (so_far + left).max(1.0));
        let (stage_seconds_left, seconds_left) = match has_own_pace(stage.name) {
            true => {
                let total = stage.total.max(1) as f64;
                let per_unit =
                    self.part_started.elapsed().as_secs_f64() / (done as f64 + HEAD_START * total);
                let left = per_unit * (stage.total - done) as f64;
                (left, left)
            }
            false => {
                // Seconds for a weighted triangle.
                let assumed = ASSUMED_SECONDS / ASSUMED_WEIGHT;
                let pace = |seconds: f64, weight: f64, all: f64| {
                    let extra = ASSUMED_WEIGHT.min(MOST_ASSUMED * all);
                    (seconds + assumed * extra) / (weight + extra).max(1.0)
                };
                let before = pace(seconds - own_seconds, self.weight_done, f64::INFINITY);
                let most = MOST_ASSUMED * (weighted + stage_left);
                let handed_on = (HANDED_ON_SECONDS / before).min(most).max(1.0);
                let own = (own_seconds + before * handed_on) / (weighted + handed_on);
                (stage_left * own, stage_left * own + ahead * pace(seconds, so_far, so_far + left))
            }
        };
        let figures = Figures {
            done,
            per_second: done as f64 / own_seconds.max(1e-3),
            fraction: self.fraction,
            seconds,
            stage_seconds_left,
            seconds_left,
        };
        (figures, is_new)
    }

    /// Weighted triangles of stages to come: they are taken to be as small as this one is, weighted by kind.
    fn weight_ahead(&self) -> f64 {
        let stage = &self.stage;
        match stage.name {
            // Everything is still to come: the cells, and a little for stitching and writing.
            "partition" | "components" => 1.2 * stage.total as f64,
            "simplify" => 0.15 * stage.total as f64,
            name => {
                let own = weight(name) * stage.total as f64;
                own * 0.2 * f64::from(stage.n_stages.saturating_sub(stage.number))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bake_tells_what_it_has_left_by_its_own_pace() {
        let stage = |total| Stage { name: "bake", number: 7, n_stages: 7, total };
        let mut pace = Pace::default();
        pace.update(stage(1_000_000), 1_000_000);
        // From here it counts in other units.
        pace.update(stage(1000), 0);
        pace.part_started -= std::time::Duration::from_secs(100);
        let (figures, _) = pace.update(stage(1000), 200);
        let expected = 100.0 / 250.0 * 800.0;
        assert!((figures.seconds_left - expected).abs() < 1.0, "{}", figures.seconds_left);
    }

    #[test]
    fn a_stage_that_is_slower_than_those_before_soon_says_so() {
        let stage = |name, number, total| Stage { name, number, n_stages: 3, total };
        let back = std::time::Duration::from_secs;
        let mut pace = Pace::default();
        pace.update(stage("partition", 1, 64_000_000), 64_000_000);
        pace.started -= back(8);
        pace.update(stage("simplify", 2, 64_000_000), 0);
        // A tenth of it in 40 seconds.
        (pace.started, pace.stage_started) =
            (pace.started - back(40), pace.stage_started - back(40));
        let (figures, _) = pace.update(stage("simplify", 2, 64_000_000), 6_400_000);
        let expected = 9.0 * 40.0;
        let says = [figures.stage_seconds_left, figures.seconds_left];
        assert!(says.iter().all(|s| (0.5 * expected..1.5 * expected).contains(s)), "{says:?}");
    }

    #[test]
    fn many_samples_of_a_small_mesh_take_long() {
        let stage = Stage { name: "measure", number: 1, n_stages: 1, total: 100_000 };
        let mut pace = Pace::default();
        pace.update(stage.clone(), 0);
        let back = std::time::Duration::from_secs(100);
        (pace.started, pace.stage_started) = (pace.started - back, pace.stage_started - back);
        let (figures, _) = pace.update(stage, 35_000);
        assert!((150.0..200.0).contains(&figures.seconds_left), "{}", figures.seconds_left);
    }

    #[test]
    fn shares_rise_from_nothing_to_nearly_all() {
        let stage = |name, number| Stage { name, number, n_stages: 3, total: 1000 };
        let mut pace = Pace::default();
        let mut last = -1.0;
        for (name, number) in [("partition", 1), ("simplify", 2), ("finish", 3)] {
            for done in [0, 500, 1000, 1500] {
                let (figures, is_new) = pace.update(stage(name, number), done);
                assert_eq!(is_new, done == 0);
                assert!(figures.done <= 1000 && figures.seconds_left >= 0.0);
                assert!(figures.fraction >= last && figures.fraction <= 1.0, "{name} {done}");
                last = figures.fraction;
            }
        }
        assert!(last > 0.99, "{last}");
    }
}
