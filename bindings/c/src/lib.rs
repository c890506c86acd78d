//! The C interface of stonecut: the ten functions of `include/stonecut.h`.
//!
//! Arrays and words in, arrays and reports out. It checks what C cannot (`given`), turns errors and panics into codes with texts
//! (`errors`) and owns what it hands out (`results`). It has no rules about meshes and no global state: the last error belongs to a
//! thread, everything else to a call.

pub mod errors;
pub mod given;
mod returned;

use errors::{End, LastError, border};
use given::{GivenMesh, Options, RawOptions, Watch, required};
use returned::Outcome;
use std::ffi::{CStr, OsString, c_char, c_int, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use stonecut::cli::call;
use stonecut::kernel::Interrupt;
use stonecut::measure;
use stonecut::pipeline::in_memory;
use stonecut::system::progress::Progress;
use stonecut::{Result, followed};

/// A result as C sees it.
pub type ResultHandle = *mut Outcome;

/// Returns the version of the library.
#[unsafe(no_mangle)]
pub extern "C" fn stonecut_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Sets all bytes of a structure to 0, and its first member to its size.
///
/// # Safety
///
/// `structure` is null or has `size` writable bytes, and begins with a `size_t`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_init(structure: *mut c_void, size: usize) {
    if structure.is_null() || size < size_of::<usize>() {
        return;
    }
    // SAFETY: the caller gives `size` writable bytes, enough for a `size_t`.
    unsafe {
        structure.cast::<u8>().write_bytes(0, size);
        structure.cast::<usize>().write_unaligned(size);
    }
}

/// Simplifies a mesh in memory.
///
/// # Safety
///
/// Pointers are null or point to what the header says, and nothing changes it during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_simplify(
    mesh: *const given::Mesh,
    options: *const RawOptions,
    result: *mut ResultHandle,
) -> c_int {
    // SAFETY: the caller keeps the contract of the header.
    let read = || unsafe { (GivenMesh::new("mesh", mesh), Options::read(options)) };
    answer(result, || {
        let (mesh, options) = read();
        let (mesh, options) = (mesh?, options?);
        let words = ["simplify", "arrays", "arrays.ply"].map(OsString::from);
        let words = [words.to_vec(), options.words()].concat();
        let mut config = call::config(&words)?;
        let input = mesh.input(&config.attributes.labels)?;
        let stop = Arc::new(AtomicBool::new(false));
        config.kernel.interrupt = Interrupt::when(stop.clone());
        let done = watched(&options.watch(), &stop, |progress| {
            in_memory::simplify(input, &config, progress)
        })?;
        let is_short = !(done.report.target_met && done.report.quality.bearable);
        Outcome::of_mesh(done, &mesh, is_short)
    })
}

/// Measures how far two meshes in memory are apart.
///
/// # Safety
///
/// As of `stonecut_simplify`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_measure(
    original: *const given::Mesh,
    simplified: *const given::Mesh,
    options: *const RawOptions,
    result: *mut ResultHandle,
) -> c_int {
    // SAFETY: the caller keeps the contract of the header.
    let read = || unsafe {
        let meshes =
            [GivenMesh::new("original", original), GivenMesh::new("simplified", simplified)];
        (meshes, Options::read(options))
    };
    answer(result, || {
        let ([original, simplified], options) = read();
        let (original, simplified, options) = (original?.mesh()?, simplified?.mesh()?, options?);
        let mut how = measure::Options::default();
        if options.samples > 0 {
            how.samples = options.samples;
        }
        if options.threads > 0 {
            how.threads = options.threads;
        }
        let report = watched(&options.watch(), &AtomicBool::new(false), |progress| {
            in_memory::given::measure([&original, &simplified], &how, progress)
        })?;
        Outcome::of_report(report, false)
    })
}

/// Runs a command from file to file.
///
/// # Safety
///
/// As of `stonecut_simplify`; `words` has `n_words` texts that end with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_run(
    words: *const *const c_char,
    n_words: usize,
    options: *const RawOptions,
    result: *mut ResultHandle,
) -> c_int {
    // SAFETY: the caller keeps the contract of the header.
    let read = || unsafe { (given::texts("words", words, n_words), Options::read(options)) };
    answer(result, || {
        let (words, options) = read();
        let (words, options) = (words?, options?);
        let words = [words, options.words()].concat();
        let answer = watched(&options.watch(), &AtomicBool::new(false), |progress| {
            call::call(&words, progress)
        })?;
        Outcome::of_report(answer.report, answer.is_short)
    })
}

/// Returns how the last call of this thread ended.
#[unsafe(no_mangle)]
pub extern "C" fn stonecut_last_error() -> *const LastError {
    errors::last()
}

/// Returns the mesh of a result, or null.
///
/// # Safety
///
/// `result` is null or was given by this library and not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_result_mesh(result: *const Outcome) -> *const given::Mesh {
    // SAFETY: the caller keeps the contract of the header.
    unsafe { result.as_ref() }.map_or(std::ptr::null(), Outcome::mesh)
}

/// Returns the report of a result as JSON; null of null.
///
/// # Safety
///
/// As of `stonecut_result_mesh`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_result_report(result: *const Outcome) -> *const c_char {
    // SAFETY: the caller keeps the contract of the header.
    unsafe { result.as_ref() }.map_or(std::ptr::null(), |result| result.report().as_ptr())
}

/// Reads a number of the report by its JSON pointer.
///
/// # Safety
///
/// As of `stonecut_result_mesh`; `pointer` is null or ends with a zero, `number` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_result_number(
    result: *const Outcome,
    pointer: *const c_char,
    number: *mut f64,
) -> c_int {
    border(|| {
        required("result", result)?;
        required("pointer", pointer)?;
        required("number", number)?;
        // SAFETY: none is null, and the caller keeps the contract of the header.
        let (result, pointer) = unsafe { (&*result, CStr::from_ptr(pointer)) };
        let found = result.number(&pointer.to_string_lossy())?;
        // SAFETY: as above; the caller may not have aligned it.
        unsafe { number.write_unaligned(found) };
        Ok(End::Whole)
    })
}

/// Frees a result.
///
/// # Safety
///
/// As of `stonecut_result_mesh`, and nothing that was read from it is used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_result_free(result: ResultHandle) {
    if !result.is_null() {
        // SAFETY: it came from `Box::into_raw` in `answer`, and the caller frees it once.
        drop(unsafe { Box::from_raw(result) });
    }
}

/// Runs a call that gives a result, and puts that where the caller wants it.
fn answer(place: *mut ResultHandle, work: impl FnOnce() -> Result<(Outcome, End)>) -> c_int {
    border(|| {
        required("result", place)?;
        // SAFETY: it is not null, and the caller lets us write to it.
        unsafe { place.write_unaligned(std::ptr::null_mut()) };
        let (outcome, end) = work()?;
        // SAFETY: as above.
        unsafe { place.write_unaligned(Box::into_raw(Box::new(outcome))) };
        Ok(end)
    })
}

/// Runs `work` in another thread, with a stack of known size, while the caller's function follows it from this one.
fn watched<T: Send>(
    watch: &Watch,
    stop: &AtomicBool,
    work: impl FnOnce(&Progress) -> Result<T> + Send,
) -> Result<T> {
    let follower = Box::new(|moment: &stonecut::Moment| {
        if !stop.load(Ordering::Relaxed) && watch.wants_to_stop(moment) {
            stop.store(true, Ordering::Relaxed);
            moment.stop();
        }
    });
    followed(Some(follower), work)
}
