//! The pace of a run: from counters, a clock and the stages of a plan to shares done and seconds left.
//!
//! For whoever shows progress: the bar and lines of the command line, and callers in the same process.

use crate::progress::{Stage, StageSeconds};
use std::collections::VecDeque;
use std::time::Instant;

/// Seconds for a triangle of a stage that no plan has named, and the share of a pass that only reads and writes.
const ASSUMED_PACE: f64 = 0.375e-6;
const PASS_SHARE: f64 = 0.2;
/// Weight of the plan against measurements: as much as this share of a run, or of a stage, that was measured. Where a stage shows itself to be much
/// slower than expected, that counts for less.
const EXPECTED_SHARE: f64 = 0.1;
/// Never for less than this part of it: the first count of a stage comes late and is small.
const LEAST_TRUST: f64 = 0.4;
/// Something is always left while the work goes on: this share of the stage's time so far, and this many seconds.
const LEAST_LEFT: f64 = 0.05;
const LEAST_SECONDS_LEFT: f64 = 0.1;
/// Share that a run at work has done at most.
pub const MOST_DONE: f64 = 0.995;
/// A stage that took less than this share of what was expected was done by an earlier process; it says nothing of the machine.
const GIVEN_SHARE: f64 = 0.05;

/// Stages that do not count triangles at the pace of others: what they have left is told by themselves.
pub fn has_own_pace(stage: &str) -> bool {
    stage == "bake"
}

/// Stages that count samples alone, and neither trees nor vertices: what they have left is told by the plan.
fn counts_in_part(stage: &str) -> bool {
    stage == "measure"
}

/// Stages that read and write more than they compute: a slow disk says nothing of the others, nor they of it.
fn is_pass(stage: &str) -> bool {
    ["partition", "components", "repartition", "load", "map", "write"].contains(&stage)
}

/// Share of such a stage that is taken to have been done in no time, so that its first second's estimate is a number.
const HEAD_START: f64 = 0.05;

/// Seconds that stages of one kind took, beside those that were expected.
#[derive(Clone, Copy, Debug, Default)]
struct Timing {
    took: f64,
    expected: f64,
}

/// A clock over the stages of one run.
#[derive(Debug)]
pub struct Pace {
    started: Instant,
    stage: Stage,
    /// Seconds that the plan expects of it.
    expected: f64,
    /// The last look at the stage before: it began after that.
    stage_started: Instant,
    looked_at: Instant,
    /// Since when the stage counts in its present units.
    part_started: Instant,
    /// Units that an earlier process had done, or that were done at the first look.
    given: u64,
    /// Units at the first and the last change of the count, and their times: cells are counted when they are whole, and
    /// before the first of them a sample is taken.
    first: Option<(u64, Instant)>,
    counted: u64,
    counted_at: Instant,
    /// Stages that are over, computing ones and passes.
    over: [Timing; 2],
    /// Seconds expected of all stages that are over, measured or not.
    expected_over: f64,
    /// Stages to come, as the plan has them; without a plan they are guessed from the stage at work.
    ahead: VecDeque<StageSeconds>,
    has_plan: bool,
    /// Seconds expected of the whole run.
    whole: f64,
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
        Pace::expecting(Vec::new())
    }
}

impl Pace {
    /// A clock that starts now, for the stages that a plan expects; without any it guesses.
    pub fn expecting(stages: Vec<StageSeconds>) -> Pace {
        let now = Instant::now();
        let whole: f64 = stages.iter().map(|(_, seconds)| seconds).sum();
        Pace {
            started: now,
            stage: Stage::default(),
            expected: 0.0,
            stage_started: now,
            looked_at: now,
            part_started: now,
            given: 0,
            first: None,
            counted: 0,
            counted_at: now,
            over: [Timing::default(); 2],
            expected_over: 0.0,
            has_plan: whole > 0.0,
            ahead: stages.into(),
            whole,
            fraction: 0.0,
        }
    }

    /// Takes notice of the count of a stage; true if it is another one than before.
    fn look(&mut self, stage: Stage, done: u64) -> bool {
        let is_new = stage.number != self.stage.number || stage.name != self.stage.name;
        let now = Instant::now();
        if is_new {
            let took = seconds_between(self.stage_started, self.looked_at);
            if took > GIVEN_SHARE * self.expected {
                let over = &mut self.over[usize::from(is_pass(self.stage.name))];
                over.took += took;
                over.expected += self.expected;
            }
            self.expected_over += self.expected;
            self.stage_started = self.looked_at;
            self.expected = self.expected_of(&stage);
        }
        if is_new || stage.total != self.stage.total {
            self.part_started = if is_new { self.looked_at } else { now };
            (self.given, self.counted, self.counted_at) = (done, done, self.part_started);
            self.first = None;
        }
        if done != self.counted {
            self.first.get_or_insert((done, now));
            (self.counted, self.counted_at) = (done, now);
        }
        self.looked_at = now;
        self.stage = stage;
        if !self.has_plan && self.whole == 0.0 {
            self.whole = self.expected + self.ahead();
        }
        is_new
    }

    /// Seconds expected of a stage that begins; those before it that did not come are dropped.
    fn expected_of(&mut self, stage: &Stage) -> f64 {
        match self.ahead.iter().position(|(name, _)| *name == stage.name) {
            Some(at) => self.ahead.drain(..=at).next_back().map_or(0.0, |(_, seconds)| seconds),
            None => {
                let share = if is_pass(stage.name) { PASS_SHARE } else { 1.0 };
                share * ASSUMED_PACE * stage.total as f64
            }
        }
    }

    /// Seconds expected of the stages to come, at the expected pace.
    fn ahead(&self) -> f64 {
        if self.has_plan {
            return self.ahead.iter().map(|(_, seconds)| seconds).sum();
        }
        let stage = &self.stage;
        let own = ASSUMED_PACE * stage.total as f64;
        match stage.name {
            // Everything is still to come: the cells, and a little for stitching and writing.
            "partition" | "components" => 1.2 * own,
            "simplify" => 0.15 * own,
            _ => PASS_SHARE * own * f64::from(stage.n_stages.saturating_sub(stage.number)),
        }
    }

    /// The figures of a running stage with `done` triangles done, and whether it is another stage than before.
    pub fn update(&mut self, stage: Stage, done: u64) -> (Figures, bool) {
        let done = done.min(stage.total);
        let is_new = self.look(stage, done);
        let seconds = self.started.elapsed().as_secs_f64();
        let stage_seconds_left = match has_own_pace(self.stage.name) {
            true => self.own_left(done),
            false => self.stage_left(),
        };
        let least = self.part_started.elapsed().as_secs_f64() * LEAST_LEFT;
        let stage_seconds_left = stage_seconds_left.max(least).max(LEAST_SECONDS_LEFT);
        let seconds_left = stage_seconds_left + self.later(stage_seconds_left);
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

    /// Times as long as expected stages of a kind take, once `more` is measured too.
    fn times(&self, is_pass: bool, more: Timing) -> f64 {
        let over = self.over[usize::from(is_pass)];
        let trusted = EXPECTED_SHARE * self.whole;
        (trusted + over.took + more.took) / (trusted + over.expected + more.expected).max(1e-9)
    }

    /// Seconds left of a stage that counts its parts in units of theirs, by the part at work; by the plan until a second part says more.
    fn own_left(&self, done: u64) -> f64 {
        let total = self.stage.total.max(1) as f64;
        let per_unit =
            self.part_started.elapsed().as_secs_f64() / (done as f64 + HEAD_START * total);
        let own = per_unit * (self.stage.total - done) as f64;
        if !self.has_plan {
            return own;
        }
        let took = self.stage_started.elapsed().as_secs_f64();
        let planned = (self.times(false, Timing::default()) * self.expected - took).max(0.0);
        let trust = if self.part_started > self.stage_started { done as f64 / total } else { 0.0 };
        planned + (own - planned) * (trust / (trust + EXPECTED_SHARE))
    }

    /// Seconds left of the stage at work.
    fn stage_left(&self) -> f64 {
        let units = |count: u64| count.saturating_sub(self.given) as f64;
        let all = units(self.stage.total).max(1.0);
        let of_stage = self.times(is_pass(self.stage.name), Timing::default()) * self.expected;
        if self.has_plan && counts_in_part(self.stage.name) {
            return (of_stage - seconds_between(self.stage_started, Instant::now())).max(0.0);
        }
        let share = units(self.counted) / all;
        // Whatever comes before the first count is not the pace of the others.
        let (from, given) = match self.first {
            Some((count, at)) if count < self.counted => (at, units(count) / all),
            _ => (self.part_started, 0.0),
        };
        let (measured, part) = (seconds_between(from, self.counted_at), share - given);
        let slower = (part * of_stage / measured.max(1e-9)).clamp(LEAST_TRUST, 1.0);
        let trust = EXPECTED_SHARE * if part > 0.0 { slower } else { 1.0 };
        let whole = (trust * of_stage + measured) / (trust + part).max(1e-9);
        // Since the last count some of what is left has been done.
        ((1.0 - share) * whole - seconds_between(self.counted_at, Instant::now())).max(0.0)
    }

    /// Seconds of the stages to come, where the one at work has this many left.
    fn later(&self, stage_left: f64) -> f64 {
        if !self.has_plan {
            return self.ahead() * self.times(false, Timing::default());
        }
        // The stage at work will have taken as long as it is now expected to, as far as it has been seen.
        let took = seconds_between(self.stage_started, Instant::now());
        let seen = took / (took + stage_left).max(1e-9);
        let own = Timing { took, expected: seen * self.expected };
        let is_given = own.took < GIVEN_SHARE * own.expected;
        let at_work = |kind: bool| match kind == is_pass(self.stage.name) && !is_given {
            true => own,
            false => Timing::default(),
        };
        let times = [false, true].map(|kind| self.times(kind, at_work(kind)));
        self.ahead.iter().map(|(name, seconds)| times[usize::from(is_pass(name))] * seconds).sum()
    }
}

fn seconds_between(from: Instant, to: Instant) -> f64 {
    to.saturating_duration_since(from).as_secs_f64()
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
        for at in [
            &mut pace.started,
            &mut pace.stage_started,
            &mut pace.looked_at,
            &mut pace.part_started,
            &mut pace.counted_at,
        ] {
            back(at);
        }
        pace.first.iter_mut().for_each(|(_, at)| back(at));
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

    /// A comparison builds trees and looks at vertices without a count.
    #[test]
    fn a_count_that_is_over_early_does_not_end_a_stage() {
        let measure = stage("measure", 2, 2, 100_000);
        let mut pace = Pace::expecting(vec![("measure", 100.0)]);
        pace.update(measure.clone(), 0);
        wait(&mut pace, 40);
        let (figures, _) = pace.update(measure, 100_000);
        assert!((55.0..65.0).contains(&figures.seconds_left), "{}", figures.seconds_left);
    }

    /// Cells are counted when they are whole: until the first one is, what is left falls.
    #[test]
    fn what_is_left_does_not_count_up_while_nothing_is_counted() {
        let finish = stage("finish", 1, 1, 1_000_000);
        let mut pace = Pace::expecting(vec![("finish", 60.0)]);
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
    }
}
