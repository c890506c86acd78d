//! Arrays of numpy in and out: read once and checked on the way, handed out without a copy.
//!
//! The Python half has made them C-contiguous, of native byte order and of the types below. They are copied while the
//! interpreter's lock is held, so no other Python thread changes them meanwhile.

use crate::errors::exception;
use crate::watch::{Callback, mismatch, watched};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::ffi::OsString;
use stonecut::cli::call;
use stonecut::kernel::Interrupt;
use stonecut::measure::Options;
use stonecut::mesh::property::{Property, Scalar};
use stonecut::pipeline::in_memory::attributes::{Attributes, Column};
use stonecut::pipeline::in_memory::{self, Input, given};
use stonecut::{Error, Mesh};

/// A mesh as it is given: points (n, 3) of float32 or float64; faces (m, 3) of int32, uint32, int64 or uint64.
#[derive(FromPyObject)]
pub struct GivenMesh<'py> {
    points: Bound<'py, PyAny>,
    faces: Bound<'py, PyAny>,
    /// Red, green and blue of each vertex (n, 3), uint8; for pictures.
    colors: Option<PyReadonlyArray1<'py, u8>>,
}

impl GivenMesh<'_> {
    /// The mesh in memory.
    pub fn read(&self) -> PyResult<Mesh> {
        let (positions, triangles) = read_mesh(&self.points, &self.faces)?;
        let mut mesh = Mesh::new(positions, triangles);
        if let Some(colors) = &self.colors {
            mesh.channels = colors.as_slice()?.iter().map(|&c| f32::from(c)).collect();
            mesh.n_channels = 3;
            if mesh.channels.len() != 3 * mesh.positions.len() {
                return Err(mismatch("colours are not three a vertex"));
            }
        }
        Ok(mesh)
    }
}

/// One column of an attribute: its name and type, its array as bytes, first byte and step.
#[derive(FromPyObject)]
pub struct GivenColumn<'py> {
    name: String,
    scalar: String,
    bytes: PyReadonlyArray1<'py, u8>,
    offset: usize,
    stride: usize,
}

/// The result of `simplify_arrays`: points, faces as uint32, source, map, records as bytes, the report as JSON.
type Simplified<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u8>>,
    String,
);

/// Simplifies a mesh in memory; `words` are those of the command `simplify`.
#[pyfunction]
pub fn simplify_arrays<'py>(
    py: Python<'py>,
    points: Bound<'py, PyAny>,
    faces: Bound<'py, PyAny>,
    columns: Vec<GivenColumn<'py>>,
    words: Vec<OsString>,
    callback: Callback,
) -> PyResult<Simplified<'py>> {
    let fail = |error: Error| exception(py, &error);
    let mut config = call::config(&words).map_err(fail)?;
    let is_single = points.cast::<PyArray2<f32>>().is_ok();
    let (positions, triangles) = read_mesh(&points, &faces)?;
    let (arrays, places) = copies(&columns)?;
    let columns = columns.iter().zip(places).map(|(column, place)| {
        Ok(Column {
            property: Property::new(&column.name, scalar(&column.scalar)?),
            bytes: &arrays[place],
            offset: column.offset,
            stride: column.stride,
        })
    });
    let columns = columns.collect::<PyResult<_>>()?;
    let labels = &config.attributes.labels;
    let attributes = Attributes::new(columns, positions.len(), labels).map_err(fail)?;
    let input = Input { positions, triangles, attributes, ..Input::default() };
    let done = watched(py, callback, |stop| {
        config.kernel.interrupt = Interrupt::when(stop.flag.clone());
        in_memory::simplify(input, &config, stop.progress)
    })?;
    let n = done.positions.len();
    let points = match is_single {
        true => {
            let single = done.positions.as_flattened().iter().map(|&x| x as f32);
            PyArray1::from_vec(py, single.collect()).reshape([n, 3])?.into_any()
        }
        false => {
            PyArray1::from_vec(py, done.positions.into_flattened()).reshape([n, 3])?.into_any()
        }
    };
    let m = done.triangles.len();
    let faces = PyArray1::from_vec(py, done.triangles.into_flattened()).reshape([m, 3])?;
    let report = serde_json::to_string(&done.report)
        .map_err(|e| mismatch(&format!("the report cannot be written as JSON: {e}")))?;
    let [source, map] = [done.source, done.map].map(|list| PyArray1::from_vec(py, list));
    Ok((points, faces, source, map, PyArray1::from_vec(py, done.records), report))
}

/// Copies the arrays of some columns, each once, with the place of each column's among them: what is borrowed could be
/// changed by another thread while the work runs.
fn copies(columns: &[GivenColumn<'_>]) -> PyResult<(Vec<Vec<u8>>, Vec<usize>)> {
    let (mut arrays, mut given) = (Vec::new(), Vec::<&[u8]>::new());
    let mut places = Vec::with_capacity(columns.len());
    for column in columns {
        let bytes = column.bytes.as_slice()?;
        let known = given.iter().position(|other| std::ptr::eq(*other, bytes));
        places.push(known.unwrap_or(given.len()));
        if known.is_none() {
            given.push(bytes);
            arrays.push(bytes.to_vec());
        }
    }
    Ok((arrays, places))
}

/// Measures how far two meshes in memory deviate; gives the report as JSON.
#[pyfunction]
pub fn measure_arrays(
    py: Python<'_>,
    original: GivenMesh<'_>,
    simplified: GivenMesh<'_>,
    samples: u64,
    seed: u64,
    threads: Option<usize>,
    callback: Callback,
) -> PyResult<String> {
    let meshes = [original.read()?, simplified.read()?];
    let options = Options { samples, seed, ..Options::default() };
    let options = Options { threads: threads.unwrap_or(options.threads), ..options };
    let report = watched(py, callback, |stop| {
        given::measure([&meshes[0], &meshes[1]], &options, stop.progress)
    })?;
    Ok(report.to_string())
}

/// A scalar type by its numpy code.
fn scalar(code: &str) -> PyResult<Scalar> {
    Ok(match code {
        "i1" => Scalar::I8,
        "u1" => Scalar::U8,
        "i2" => Scalar::I16,
        "u2" => Scalar::U16,
        "i4" => Scalar::I32,
        "u4" => Scalar::U32,
        "i8" => Scalar::I64,
        "u8" => Scalar::U64,
        "f4" => Scalar::F32,
        "f8" => Scalar::F64,
        _ => return Err(mismatch(&format!("an attribute of type {code}"))),
    })
}

type Positions = Vec<[f64; 3]>;
type Triangles = Vec<[u32; 3]>;

fn read_mesh(
    points: &Bound<'_, PyAny>,
    faces: &Bound<'_, PyAny>,
) -> PyResult<(Positions, Triangles)> {
    let fail = |error: Error| exception(points.py(), &error);
    let positions = if points.cast::<PyArray2<f32>>().is_ok() {
        positions(&rows::<f32>(points)?, f64::from).map_err(fail)?
    } else {
        positions(&rows::<f64>(points)?, |x| x).map_err(fail)?
    };
    let n = positions.len();
    let triangles = if faces.cast::<PyArray2<i32>>().is_ok() {
        triangles(&rows::<i32>(faces)?, n, |v| i64::from(v) as u64)
    } else if faces.cast::<PyArray2<u32>>().is_ok() {
        triangles(&rows::<u32>(faces)?, n, u64::from)
    } else if faces.cast::<PyArray2<u64>>().is_ok() {
        triangles(&rows::<u64>(faces)?, n, |v| v)
    } else {
        triangles(&rows::<i64>(faces)?, n, |v| v as u64)
    };
    Ok((positions, triangles.map_err(fail)?))
}

/// The numbers of an (n, 3) array in C order.
fn rows<'py, T: Element>(array: &Bound<'py, PyAny>) -> PyResult<numpy::PyReadonlyArray2<'py, T>> {
    let array = array.cast::<PyArray2<T>>().map_err(|_| mismatch("an array of another type"))?;
    // A slice of an array in Fortran order would give its numbers in another order.
    if !array.is_c_contiguous() || array.shape()[1] != 3 {
        return Err(mismatch("an array in another order"));
    }
    Ok(array.readonly())
}

fn positions<T: Element + Copy>(
    points: &numpy::PyReadonlyArray2<'_, T>,
    widen: impl Fn(T) -> f64,
) -> Result<Positions, Error> {
    given::positions("points", slice(points)?.as_chunks::<3>().0.iter().copied(), widen)
}

fn triangles<T: Element + Copy + std::fmt::Display>(
    faces: &numpy::PyReadonlyArray2<'_, T>,
    n_vertices: usize,
    widen: impl Fn(T) -> u64,
) -> Result<Triangles, Error> {
    given::triangles("faces", slice(faces)?.as_chunks::<3>().0.iter().copied(), n_vertices, widen)
}

fn slice<'a, T: Element>(array: &'a numpy::PyReadonlyArray2<'_, T>) -> Result<&'a [T], Error> {
    let fail = |e| Error::Internal(format!("an array cannot be read: {e}"));
    array.as_slice().map_err(fail)
}
