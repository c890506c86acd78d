//! Progress for people and programs: a bar, lines, JSON, or nothing.

use super::log::{Log, Show, Talk};
use super::reading::{READ, process_bytes};
use crate::system::pace::{Figures, Pace, has_own_pace};
use crate::system::progress::{Progress, Stage};
use crate::system::units::{show_bytes, show_count};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const BAR_INTERVAL: Duration = Duration::from_millis(100);
/// Steps of the bar, from nothing to all.
const BAR_STEPS: u64 = 1000;
const LINE_INTERVAL: Duration = Duration::from_secs(10);
/// Most inputs are open before there is anything to tell.
const READING_INTERVAL: Duration = Duration::from_secs(1);
/// The beat of `--progress json`, which docs/report.md promises.
const JSON_INTERVAL: Duration = Duration::from_secs(1);

/// Shows `progress` while `work` runs.
pub fn watch<T>(talk: &Talk, progress: &Progress, log: &mut Log, work: impl FnOnce() -> T) -> T {
    let show = match talk.progress {
        Show::Json => Show::Json,
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
        let pace = Pace::expecting(progress.expected());
        let display = || Display::new(show, log, pace).run(progress, &is_over);
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
        progress.expect(Vec::new());
        outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

struct Display<'a> {
    show: Show,
    log: &'a mut Log,
    bar: ProgressBar,
    pace: Pace,
    last_line: Option<Instant>,
    began: Instant,
    /// Bytes that the process had read and written before.
    bytes_before: u64,
}

impl<'a> Display<'a> {
    fn new(show: Show, log: &'a mut Log, pace: Pace) -> Self {
        let bar = if show == Show::Bar { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{prefix} [{bar:32}] {percent:>3}% {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let (began, bytes_before) = (Instant::now(), process_bytes());
        Display { show, log, bar, pace, last_line: None, began, bytes_before }
    }

    fn run(mut self, progress: &Progress, is_over: &AtomicBool) {
        while !is_over.load(Ordering::Relaxed) {
            self.show_notes(progress);
            let (stage, done) = progress.read();
            match stage.name {
                "" => {}
                READ => self.reads(stage),
                _ => self.update(stage, done),
            }
            std::thread::park_timeout(BAR_INTERVAL);
        }
        self.bar.finish_and_clear();
        let (stage, done) = progress.read();
        if self.show == Show::Json && !["", READ].contains(&stage.name) {
            // A program that reads gets the last state, however short the run was.
            self.last_line = None;
            self.update(stage, done);
        }
        self.show_notes(progress);
    }

    /// Inputs are opened before there is a plan, which is the first thing that a program is told.
    fn reads(&mut self, stage: Stage) {
        if self.show != Show::Json && self.began.elapsed() > READING_INTERVAL {
            let done = process_bytes().saturating_sub(self.bytes_before);
            self.update(stage, done);
        }
    }

    fn show_notes(&mut self, progress: &Progress) {
        for line in progress.take_notes() {
            self.bar.suspend(|| self.log.say(&line));
        }
    }

    fn update(&mut self, stage: Stage, done: u64) {
        let (figures, is_new) = self.pace.update(stage.clone(), done);
        if is_new {
            self.last_line = None;
        }
        let Figures { done, per_second, seconds, seconds_left, stage_seconds_left, fraction } =
            figures;
        // A stage with its own pace counts other things than triangles.
        let rate = match stage.name {
            READ => format!("{}/s, ", show_bytes(per_second as u64)),
            name if has_own_pace(name) => String::new(),
            // Cells are counted when they are whole: until the first of them is, there is no rate.
            _ if per_second < 1.0 => String::new(),
            _ => format!("{} triangles/s, ", show_count(per_second as u64)),
        };
        // Of the whole run, never all of it while it goes on; the same for the time.
        let percent = (100.0 * fraction).floor();
        let left = seconds_left.ceil().max(1.0);
        let memory = crate::system::memory::resident_bytes();
        if self.show == Show::Bar {
            self.bar.set_prefix(format!("{}/{} {:11}", stage.number, stage.n_stages, stage.name));
            self.bar.set_length(BAR_STEPS);
            self.bar.set_position((fraction * BAR_STEPS as f64) as u64);
            self.bar.set_message(format!("{rate}{left} s left, {}", show_bytes(memory)));
            return;
        }
        let interval = if self.show == Show::Json { JSON_INTERVAL } else { LINE_INTERVAL };
        if self.last_line.is_some_and(|at| at.elapsed() < interval) {
            return;
        }
        self.last_line = Some(Instant::now());
        if self.show == Show::Json {
            let fields = serde_json::json!({
                "fraction": fraction, "stage": stage.name, "number": stage.number, "stages": stage.n_stages,
                "triangles_done": done, "triangles": stage.total, "triangles_per_second": per_second,
                "stage_seconds_left": stage_seconds_left, "seconds_left": seconds_left, "seconds": seconds,
                "memory_bytes": memory,
            });
            self.log.event("progress", fields);
        } else {
            let line = format!(
                "{seconds:7.1} s  {}/{} {:11} {percent:3.0} %  {rate}{left:.0} s left, {}",
                stage.number,
                stage.n_stages,
                stage.name,
                show_bytes(memory)
            );
            self.log.say(line);
        }
    }
}
