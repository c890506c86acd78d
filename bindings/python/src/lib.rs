//! The compiled half of the Python module `stonecut`: words and arrays in, reports and arrays out.
//!
//! The Python half (`python/stonecut`) checks and names arguments, knows the mesh types of other packages and has the
//! exception classes. Here are the three things that it cannot do: borrow and give arrays (`arrays`), work without
//! the interpreter's lock while callbacks and Ctrl-C are heard (`watch`), and turn errors into exceptions (`errors`).
//! It holds no global state, so free-threaded interpreters may call it from any thread.

mod arrays;
mod errors;
mod watch;

use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use std::ffi::OsString;
use stonecut::cli::call;
use watch::{Callback, watched};

/// Runs a command in this process; gives its report as JSON, and whether it fell short of what was asked for.
#[pyfunction]
fn run(py: Python<'_>, words: Vec<OsString>, callback: Callback) -> PyResult<(String, bool)> {
    let answer = watched(py, callback, |stop| call::call(&words, stop.progress))?;
    Ok((answer.report.to_string(), answer.is_short))
}

/// Renders the files that the words of `render` name, or the mesh: pixels as an array (height, width, 3). Also writes
/// the PNG file if asked to.
#[pyfunction]
fn picture<'py>(
    py: Python<'py>,
    words: Vec<OsString>,
    mesh: Option<arrays::GivenMesh<'py>>,
    writes: bool,
    callback: Callback,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let mesh = mesh.map(|mesh| mesh.read()).transpose()?;
    let make = if writes { call::picture_file } else { call::picture };
    let picture = watched(py, callback, |stop| make(&words, mesh.as_ref(), stop.progress))?;
    let shape = [picture.height as usize, picture.width as usize, 3];
    PyArray1::from_vec(py, picture.rgb).reshape(shape)
}

/// Runs the command line and gives its exit code; for the `stonecut` command only.
#[pyfunction]
fn main(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| stonecut::cli::main_from(words))
}

/// The compiled half of `stonecut`.
#[pymodule(gil_used = false)]
fn _stonecut(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<watch::Progress>()?;
    module.add_function(wrap_pyfunction!(run, module)?)?;
    module.add_function(wrap_pyfunction!(picture, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::simplify_arrays, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::measure_arrays, module)?)
}
