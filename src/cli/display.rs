//! Progress for people and programs: a bar, lines, JSON, or nothing.

use super::log::{Log, Show, Talk};
use crate::system::progress::{Progress, Stage};
use crate::system::units::{show_bytes, show_count};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const BAR_INTERVAL: Duration = Duration::from_millis(100);
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// What the estimate starts from: so many weighted triangles, taken to have been done in so many seconds before
/// the run began. Without it, the first second's estimate would be any number.
const ASSUMED_WEIGHT: f64 = 4e6;
const ASSUMED_SECONDS: f64 = 1.5;

/// Relative cost of a triangle in each stage, for the overall estimate only.
fn weight(stage: &str) -> f64 {
    match stage {
        "partition" => 0.25,
        "components" | "write" => 0.1,
        _ => 1.0,
    }
}

/// Shows `progress` while `work` runs.
pub fn watch<T>(talk: &Talk, progress: &Progress, log: &mut Log, work: impl FnOnce() -> T) -> T {
    let show = match talk.progress {
        _ if talk.quiet => Show::None,
        Show::Auto if std::io::stderr().is_terminal() => Show::Bar,
        Show::Auto => Show::Plain,
        chosen => chosen,
    };
    if show == Show::None {
        return work();
    }
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let display = || Display::new(show, log).run(progress, &is_over);
        let Ok(watcher) = std::thread::Builder::new().spawn_scoped(scope, display) else {
            // No memory for a thread: the work may still succeed without being watched.
            return work();
        };
        // The watcher must end whatever happens to the work.
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
        is_over.store(true, Ordering::Relaxed);
        watcher.thread().unpark();
        let _ = watcher.join();
        // The next command of the demo begins with no stage.
        progress.begin("", 0, 0, 0);
        outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

struct Display<'a> {
    show: Show,
    log: &'a mut Log,
    bar: ProgressBar,
    started: Instant,
    stage: Stage,
    stage_started: Instant,
    last_line: Option<Instant>,
    /// Weighted triangles of stages that are over.
    weight_done: f64,
}

impl<'a> Display<'a> {
    fn new(show: Show, log: &'a mut Log) -> Self {
        let bar = if show == Show::Bar { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{prefix} [{bar:32}] {percent:>3}% {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let now = Instant::now();
        Display {
            show,
            log,
            bar,
            started: now,
            stage: Stage::default(),
            stage_started: now,
            last_line: None,
            weight_done: 0.0,
        }
    }

    fn run(mut self, progress: &Progress, is_over: &AtomicBool) {
        while !is_over.load(Ordering::Relaxed) {
            self.show_notes(progress);
            let (stage, done) = progress.read();
            if !stage.name.is_empty() {
                self.update(stage, done);
            }
            std::thread::park_timeout(BAR_INTERVAL);
        }
        self.bar.finish_and_clear();
        let (stage, done) = progress.read();
        if self.show == Show::Json && !stage.name.is_empty() {
            // A program that reads gets the last state, however short the run was.
            self.last_line = None;
            self.update(stage, done);
        }
        self.show_notes(progress);
    }

    fn show_notes(&mut self, progress: &Progress) {
        for line in progress.take_notes() {
            if self.show == Show::Json {
                let _ = writeln!(self.log, "{}", serde_json::json!({ "note": line }));
            } else {
                self.bar.suspend(|| self.log.say(&line));
            }
        }
    }

    fn update(&mut self, stage: Stage, done: u64) {
        if stage.number != self.stage.number {
            self.weight_done += self.stage.total as f64 * weight(self.stage.name);
            self.stage_started = Instant::now();
            self.last_line = None;
        }
        self.stage = stage;
        let stage = &self.stage;
        let seconds = self.stage_started.elapsed().as_secs_f64();
        let done = done.min(stage.total);
        let per_second = done as f64 / seconds.max(1e-3);
        let stage_eta =
            (stage.total - done) as f64 * weight(stage.name) * (seconds + ASSUMED_SECONDS)
                / (done as f64 * weight(stage.name) + ASSUMED_WEIGHT);
        let memory = crate::system::memory::resident_bytes();
        if self.show == Show::Bar {
            self.bar.set_prefix(format!("{}/{} {:11}", stage.number, stage.n_stages, stage.name));
            self.bar.set_length(stage.total.max(1));
            self.bar.set_position(done);
            self.bar.set_message(format!(
                "{}/s, {:.0} s left, {}",
                show_count(per_second as u64),
                self.eta(done),
                show_bytes(memory)
            ));
            return;
        }
        if self.last_line.is_some_and(|at| at.elapsed() < LINE_INTERVAL) {
            return;
        }
        self.last_line = Some(Instant::now());
        let elapsed = self.started.elapsed().as_secs_f64();
        if self.show == Show::Json {
            let line = serde_json::json!({
                "stage": stage.name, "number": stage.number, "stages": stage.n_stages,
                "triangles_done": done, "triangles": stage.total, "triangles_per_second": per_second,
                "stage_seconds_left": stage_eta, "seconds_left": self.eta(done), "seconds": elapsed,
                "memory_bytes": memory,
            });
            let _ = writeln!(self.log, "{line}");
        } else {
            let line = format!(
                "{elapsed:7.1} s  {}/{} {:11} {:3.0} %  {}/s  {:.0} s left  {}",
                stage.number,
                stage.n_stages,
                stage.name,
                100.0 * done as f64 / stage.total.max(1) as f64,
                show_count(per_second as u64),
                self.eta(done),
                show_bytes(memory)
            );
            self.log.say(line);
        }
    }

    /// Seconds left of the run: stages to come are taken to be as small as this one is, weighted by kind.
    fn eta(&self, done: u64) -> f64 {
        let stage = &self.stage;
        let own = weight(stage.name) * stage.total as f64;
        let ahead = match stage.name {
            // Everything is still to come: the cells, and a little for stitching and writing.
            "partition" | "components" => 1.2 * stage.total as f64,
            "simplify" => 0.15 * stage.total as f64,
            _ => own * 0.2 * f64::from(stage.n_stages.saturating_sub(stage.number)),
        };
        let so_far = self.weight_done + weight(stage.name) * done as f64;
        let left = own - weight(stage.name) * done as f64 + ahead;
        let seconds = self.started.elapsed().as_secs_f64() + ASSUMED_SECONDS;
        seconds * left / (so_far + ASSUMED_WEIGHT)
    }
}
