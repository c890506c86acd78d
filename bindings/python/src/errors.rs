//! Errors of the library as exceptions of `stonecut.errors`, one class for each exit code.

use pyo3::prelude::*;
use stonecut::Error;
use stonecut::error::Offers;

/// Remedies that a Python function offers against a failure.
const OFFERS: Offers = Offers { resumes: false, temp_dir: false };

/// The exception for an error.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    let advice = error.advice(OFFERS).map_or(String::new(), |advice| format!("; {advice}"));
    let path = match error {
        Error::Io { path, .. }
        | Error::BadInput { path, .. }
        | Error::Empty { path, .. }
        | Error::NoSpace { path, .. }
        | Error::Device { path, .. }
        | Error::Locked { path, .. }
        | Error::StateMismatch { path, .. }
        | Error::Corrupt { path, .. } => Some(path.clone()),
        _ => None,
    };
    let errno = match error {
        Error::Io { source, .. } => source.raw_os_error(),
        _ => None,
    };
    let make = || {
        let errors = py.import("stonecut.errors")?;
        errors.call_method1("_make", (error.exit_code(), format!("{error}{advice}"), path, errno))
    };
    make().map_or_else(|e| e, PyErr::from_value)
}
