//! The pace of a run: from counters and a clock to shares done and seconds left.
//!
//! For whoever shows progress: the bar and lines of the command line, and callers in the same process.

use crate::system::progress::Stage;
use std::time::Instant;

/// Seconds for a weighted triangle where no plan says what to expect.
const ASSUMED_PACE: f64 = 0.375e-6;
/// Weight of the plan against measurements: as much as this share of a run, or of a stage, that was measured. Where a stage shows itself to be much
/// slower than expected, that counts for less.
const EXPECTED_SHARE: f64 = 0.1;
/// Never for less than this part of it: the first count of a stage comes late and is small.
const LEAST_TRUST: f64 = 0.4;
/// Something is always left while the work goes on: this share of the stage's time so far, and this many seconds.
const LEAST_LEFT: f64 = 0.05;
const LEAST_SECONDS_LEFT: f64 = 0.1;
/// Share that a run at work has done at most.
const MOST_DONE: f64 = 0.995;

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
    /// Beginning of the first stage.
    began: Option<Instant>,
    stage: Stage,
    /// The last look at the stage before: it began after that.
    stage_started: Instant,
    looked_at: Instant,
    /// Since when the stage counts in its present units.
    part_started: Instant,
    /// Units that an earlier process had done, or that were done at the first look.
    given: u64,
    /// Units at the last change of the count, and its time: cells are counted when they are whole.
    counted: u64,
    counted_at: Instant,
    /// Weighted triangles of stages that are over.
    weight_done: f64,
    /// Those of the whole run, as the first stage lets expect.
    whole_weight: f64,
    /// Seconds that the plan expects.
    expected: Option<f64>,
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
        Pace::expecting(None)
    }
}

impl Pace {
    /// A clock that starts now; `seconds` are what the plan expects of the whole run.
    pub fn expecting(seconds: Option<f64>) -> Pace {
        let now = Instant::now();
        Pace {
            started: now,
            began: None,
            stage: Stage::default(),
            stage_started: now,
            looked_at: now,
            part_started: now,
            given: 0,
            counted: 0,
            counted_at: now,
            weight_done: 0.0,
            whole_weight: 0.0,
            expected: seconds.filter(|seconds| *seconds > 0.0),
            fraction: 0.0,
        }
    }

    /// Takes notice of the count of a stage; true if it is another one than before.
    fn look(&mut self, stage: Stage, done: u64) -> bool {
        let is_new = stage.number != self.stage.number;
        let is_first = self.began.is_none();
        if is_new {
            self.weight_done += self.stage.total as f64 * weight(self.stage.name);
            self.stage_started = self.looked_at;
            self.began.get_or_insert(self.looked_at);
        }
        let now = Instant::now();
        if is_new || stage.total != self.stage.total {
            self.part_started = if is_new { self.looked_at } else { now };
            (self.given, self.counted, self.counted_at) = (done, done, self.part_started);
        }
        if done != self.counted {
            (self.counted, self.counted_at) = (done, now);
        }
        self.looked_at = now;
        self.stage = stage;
        if is_first {
            self.whole_weight =
                self.stage.total as f64 * weight(self.stage.name) + self.weight_ahead();
        }
        is_new
    }

    /// Share of the weighted triangles of a run, for whoever did not see how long they took.
    pub(super) fn counted_share(&mut self, stage: Stage, done: u64) -> f64 {
        self.look(stage, done);
        let own = weight(self.stage.name);
        let so_far = self.weight_done + done.min(self.stage.total) as f64 * own;
        let left = self.stage.total.saturating_sub(done) as f64 * own + self.weight_ahead();
        (so_far / (so_far + left).max(1.0)).min(MOST_DONE)
    }

    /// The figures of a running stage with `done` triangles done, and whether it is another stage than before.
    pub fn update(&mut self, stage: Stage, done: u64) -> (Figures, bool) {
        let done = done.min(stage.total);
        let is_new = self.look(stage, done);
        let seconds = self.started.elapsed().as_secs_f64();
        let (stage_seconds_left, seconds_left) = match has_own_pace(self.stage.name) {
            true => {
                let total = self.stage.total.max(1) as f64;
                let per_unit =
                    self.part_started.elapsed().as_secs_f64() / (done as f64 + HEAD_START * total);
                let left = per_unit * (self.stage.total - done) as f64;
                (left, left)
            }
            false => self.seconds_left(),
        };
        let least = self.part_started.elapsed().as_secs_f64() * LEAST_LEFT;
        let least = least.max(LEAST_SECONDS_LEFT);
        let stage_seconds_left = stage_seconds_left.max(least);
        let seconds_left = seconds_left.max(stage_seconds_left);
        self.fraction = self.fraction.max((seconds / (seconds + seconds_left)).min(MOST_DONE));
        let own_seconds = self.stage_started.elapsed().as_secs_f64();
        let figures = Figures {
            done,
            per_second: done.saturating_sub(self.given) as f64 / own_seconds.max(1e-3),
            fraction: self.fraction,
            seconds,
            stage_seconds_left,
            seconds_left,
        };
        (figures, is_new)
    }

    /// Seconds left of the stage, and of the run.
    fn seconds_left(&self) -> (f64, f64) {
        let stage = &self.stage;
        let since = |from: Instant, to: Instant| to.saturating_duration_since(from).as_secs_f64();
        let expected = self.expected.map_or(ASSUMED_PACE, |all| all / self.whole_weight.max(1.0));
        let trusted = EXPECTED_SHARE * self.whole_weight;
        let over = self.began.map_or(0.0, |began| since(began, self.stage_started));
        let pace = |seconds: f64, weight: f64| {
            (expected * trusted + seconds) / (trusted + weight).max(1.0)
        };
        let all = stage.total.saturating_sub(self.given) as f64;
        let own_weight = weight(stage.name) * all;
        let of_stage = pace(over, self.weight_done) * own_weight;
        let share = self.counted.saturating_sub(self.given) as f64 / all.max(1.0);
        let measured = since(self.part_started, self.counted_at);
        let slower = (share * of_stage / measured.max(1e-9)).clamp(LEAST_TRUST, 1.0);
        let trust = EXPECTED_SHARE * if share > 0.0 { slower } else { 1.0 };
        let whole = (trust * of_stage + measured) / (trust + share).max(1e-9);
        // Since the last count some of what is left has been done.
        let left = ((1.0 - share) * whole - since(self.counted_at, Instant::now())).max(0.0);
        let later = pace(over + measured, self.weight_done + share * own_weight);
        (left, left + self.weight_ahead() * later)
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
    use std::time::Duration;

    fn stage(name: &'static str, number: u32, n_stages: u32, total: u64) -> Stage {
        Stage { name, number, n_stages, total }
    }

    /// Lets time pass.
    fn wait(pace: &mut Pace, seconds: u64) {
        let back = |at: &mut Instant| *at -= Duration::from_secs(seconds);
        pace.began.iter_mut().for_each(back);
        for at in [
            &mut pace.started,
            &mut pace.stage_started,
            &mut pace.looked_at,
            &mut pace.part_started,
            &mut pace.counted_at,
        ] {
            back(at);
        }
    }

    #[test]
    fn a_bake_tells_what_it_has_left_by_its_own_pace() {
        let bake = |total| stage("bake", 7, 7, total);
        let mut pace = Pace::default();
        pace.update(bake(1_000_000), 1_000_000);
        // From here it counts in other units.
        pace.update(bake(1000), 0);
        wait(&mut pace, 100);
        let (figures, _) = pace.update(bake(1000), 200);
        let expected = 100.0 / 250.0 * 800.0;
        assert!((figures.seconds_left - expected).abs() < 1.0, "{}", figures.seconds_left);
    }

    #[test]
    fn a_stage_that_is_slower_than_those_before_soon_says_so() {
        let mut pace = Pace::default();
        pace.update(stage("partition", 1, 3, 64_000_000), 0);
        wait(&mut pace, 8);
        pace.update(stage("partition", 1, 3, 64_000_000), 64_000_000);
        pace.update(stage("simplify", 2, 3, 64_000_000), 0);
        // A tenth of it in 40 seconds.
        wait(&mut pace, 40);
        let (figures, _) = pace.update(stage("simplify", 2, 3, 64_000_000), 6_400_000);
        let expected = 9.0 * 40.0;
        let says = [figures.stage_seconds_left, figures.seconds_left];
        assert!(says.iter().all(|s| (0.7 * expected..1.3 * expected).contains(s)), "{says:?}");
    }

    #[test]
    fn many_samples_of_a_small_mesh_take_long() {
        let measure = stage("measure", 1, 1, 100_000);
        let mut pace = Pace::default();
        pace.update(measure.clone(), 0);
        wait(&mut pace, 100);
        let (figures, _) = pace.update(measure, 35_000);
        assert!((150.0..200.0).contains(&figures.seconds_left), "{}", figures.seconds_left);
    }

    /// Cells are counted when they are whole: until the first one is, what is left falls.
    #[test]
    fn what_is_left_does_not_count_up_while_nothing_is_counted() {
        let finish = stage("finish", 1, 1, 1_000_000);
        let mut pace = Pace::expecting(Some(60.0));
        let mut last = f64::INFINITY;
        for _ in 0..11 {
            let (figures, _) = pace.update(finish.clone(), 0);
            assert!(figures.seconds_left < last && figures.seconds_left > 0.0);
            assert!(figures.fraction < 1.0);
            last = figures.seconds_left;
            wait(&mut pace, 5);
        }
        wait(&mut pace, 20);
        let (figures, _) = pace.update(finish, 0);
        assert!((0.5..10.0).contains(&figures.seconds_left) && figures.fraction < 1.0);
    }

    #[test]
    fn cells_of_an_earlier_process_are_no_pace() {
        let simplify = stage("simplify", 2, 2, 1_000_000);
        let mut pace = Pace::default();
        pace.update(simplify.clone(), 900_000);
        wait(&mut pace, 10);
        let (figures, _) = pace.update(simplify, 950_000);
        let left = figures.stage_seconds_left;
        assert!((8.0..12.0).contains(&left), "{left}");
        assert!(figures.per_second < 5100.0, "{}", figures.per_second);
    }

    #[test]
    fn shares_rise_from_nothing_to_nearly_all() {
        let mut pace = Pace::default();
        let mut last = -1.0;
        for (name, number) in [("partition", 1), ("simplify", 2), ("finish", 3)] {
            for done in [0, 500, 1000, 1500] {
                let (figures, is_new) = pace.update(stage(name, number, 3, 1000), done);
                assert_eq!(is_new, done == 0);
                assert!(figures.done <= 1000 && figures.seconds_left > 0.0);
                assert!(figures.fraction >= last && figures.fraction < 1.0, "{name} {done}");
                last = figures.fraction;
                wait(&mut pace, 10);
            }
        }
        assert!(last > 0.9, "{last}");
        let mut pace = Pace::default();
        pace.counted_share(stage("partition", 1, 3, 1000), 1000);
        let share = pace.counted_share(stage("simplify", 2, 3, 1000), 500);
        assert!((0.4..0.6).contains(&share), "{share}");
    }
}
