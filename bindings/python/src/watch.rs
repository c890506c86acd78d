//! Work without the interpreter's lock, while the calling thread hears Ctrl-C and reports progress.
//!
//! The work runs on a thread of its own. The calling thread wakes every 50 ms, takes the lock, lets Python handle
//! signals and calls the callback. An exception from either asks the work to stop, and is raised once it has.

use crate::errors::exception;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;
use stonecut::system::memory::resident_bytes;
use stonecut::system::pace::Pace;
use stonecut::system::progress;

/// Time between two looks at signals.
const WAKE_EVERY: Duration = Duration::from_millis(50);

/// As of a main thread; the default of other threads is a quarter of it.
const STACK_BYTES: usize = 8 << 20;

/// A Python callable that gets a `Progress`, or none.
pub type Callback = Option<Py<PyAny>>;

/// Progress of a call.
#[pyclass(frozen, get_all, module = "stonecut")]
#[derive(Clone, Debug)]
pub struct Progress {
    /// Name of the running stage: scan, partition, simplify, ...
    stage: String,
    /// 1 for the first stage.
    number: u32,
    /// Stages that the call is expected to have.
    stages: u32,
    /// Triangles of the stage that are done.
    done: u64,
    /// Triangles of the stage.
    total: u64,
    /// Share of the call that is done, 0 to 1: an estimate that never falls.
    fraction: f64,
    /// Seconds since the call began.
    seconds: f64,
    /// Seconds left: an estimate.
    seconds_left: f64,
    /// Resident memory of the process, in bytes.
    memory_bytes: u64,
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let Progress { stage, number, stages, fraction, seconds_left, .. } = self;
        format!(
            "Progress({stage} {number}/{stages}, {:.0} %, {seconds_left:.0} s left)",
            100.0 * fraction
        )
    }
}

/// Means of asking the work to stop.
pub struct Stop<'a> {
    /// Counters, and the request that is looked at between blocks and cells.
    pub progress: &'a progress::Progress,
    /// The flag that the kernel looks at within a call.
    pub flag: &'a Arc<AtomicBool>,
}

/// Runs `work` without the lock; see the head of this file.
pub fn watched<T: Send>(
    py: Python<'_>,
    callback: Callback,
    work: impl FnOnce(&Stop) -> stonecut::Result<T> + Send,
) -> PyResult<T> {
    let (progress, flag) = (progress::Progress::default(), Arc::new(AtomicBool::new(false)));
    let mut pace = Pace::default();
    let outcome = py.detach(|| {
        std::thread::scope(|scope| {
            let (send, receive) = channel();
            let (progress, flag) = (&progress, &flag);
            let job = move || {
                // The receiver waits until there is an answer.
                let _ = send.send(work(&Stop { progress, flag }));
            };
            let builder = std::thread::Builder::new().stack_size(STACK_BYTES);
            let worker = match builder.spawn_scoped(scope, job) {
                Ok(worker) => worker,
                Err(e) => {
                    let what = format!("cannot start a thread: {e}");
                    return (Err(stonecut::Error::NoMemory(what)), None);
                }
            };
            let mut raised = None;
            loop {
                match receive.recv_timeout(WAKE_EVERY) {
                    Ok(outcome) => return (outcome, raised),
                    Err(RecvTimeoutError::Disconnected) => {
                        let words = worker.join().err().map_or(String::new(), |panic| {
                            let words = panic.downcast_ref::<&str>().map(|&words| words.to_owned());
                            let words = words.or_else(|| panic.downcast_ref::<String>().cloned());
                            words.unwrap_or_default()
                        });
                        return (Err(stonecut::Error::Internal(words)), raised);
                    }
                    Err(RecvTimeoutError::Timeout) if raised.is_none() => {
                        let look = |py: Python<'_>| {
                            py.check_signals()?;
                            report(py, callback.as_ref(), progress, &mut pace, false)
                        };
                        if let Err(e) = Python::attach(look) {
                            raised = Some(e);
                            progress.request_stop(2);
                            flag.store(true, Ordering::Relaxed);
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    });
    match outcome {
        // Even if the work came to its end before it looked.
        (_, Some(raised)) => Err(raised),
        (Err(error), None) => Err(exception(py, &error)),
        (Ok(value), None) => {
            report(py, callback.as_ref(), &progress, &mut pace, true)?;
            Ok(value)
        }
    }
}

/// Calls the callback with the present state; with `is_over` all is done.
fn report(
    py: Python<'_>,
    callback: Option<&Py<PyAny>>,
    progress: &progress::Progress,
    pace: &mut Pace,
    is_over: bool,
) -> PyResult<()> {
    let Some(callback) = callback else { return Ok(()) };
    let (stage, done) = progress.read();
    if stage.name.is_empty() && !is_over {
        return Ok(());
    }
    let (figures, _) = pace.update(stage.clone(), done);
    let now = Progress {
        stage: stage.name.to_owned(),
        number: stage.number,
        stages: stage.n_stages,
        done: if is_over { stage.total } else { figures.done },
        total: stage.total,
        fraction: if is_over { 1.0 } else { figures.fraction },
        seconds: figures.seconds,
        seconds_left: if is_over { 0.0 } else { figures.seconds_left },
        memory_bytes: resident_bytes(),
    };
    callback.call1(py, (now,))?;
    Ok(())
}

/// A fault of the Python half, which checks what it hands over.
pub fn mismatch(what: &str) -> PyErr {
    PyRuntimeError::new_err(format!("stonecut: {what}; please report it"))
}
