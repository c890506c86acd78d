//! The kernel as a WebAssembly module: arrays in, arrays out, nine functions for `stonecut.mjs`.
//!
//! The caller makes a job with room for its arrays, fills them in place, and simplifies; then the arrays are those of the
//! result. A panic ends the module: its owner makes another one. Knows nothing of JavaScript.

use stonecut_kernel::{
    Fit, MAX_TRIANGLES, MAX_VERTICES, Options, Placement, Stop, Topology, simplify_mesh,
};
use stonecut_mesh::Mesh;

/// A mesh on its way: that of the caller, then that of the result.
#[derive(Default)]
pub struct Job {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// For each vertex that was given that of the result, or `u32::MAX`; after the work, if it was asked for.
    map: Vec<u32>,
}

/// Only vertices of the input stay.
const SUBSET: u32 = 1;
/// Components, holes and handles stay.
const KEEP_TOPOLOGY: u32 = 2;
/// Vertices at open edges stay where they are.
const LOCK_BOUNDARY: u32 = 4;
/// Fills the map.
const MAP: u32 = 8;
/// Moves vertices to fit the original, however many are left.
const FIT: u32 = 16;

/// Makes a job of this size; null beyond what the kernel takes.
#[unsafe(no_mangle)]
pub extern "C" fn stonecut_new(n_vertices: u32, n_triangles: u32) -> *mut Job {
    if u64::from(n_vertices) > MAX_VERTICES || u64::from(n_triangles) > MAX_TRIANGLES {
        return std::ptr::null_mut();
    }
    Box::into_raw(Box::new(Job {
        positions: vec![[0.0; 3]; n_vertices as usize],
        triangles: vec![[0; 3]; n_triangles as usize],
        map: Vec::new(),
    }))
}

/// Frees a job.
///
/// # Safety
///
/// `job` is of `stonecut_new` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_free(job: *mut Job) {
    // SAFETY: it was made by `Box::into_raw`, and the caller gives it up.
    drop(unsafe { Box::from_raw(job) });
}

/// The job behind a pointer.
///
/// # Safety
///
/// As of `stonecut_free`; nothing else uses the job meanwhile.
unsafe fn job<'a>(job: *mut Job) -> &'a mut Job {
    // SAFETY: the caller keeps the contract, and the module has one thread.
    unsafe { &mut *job }
}

/// The positions: three `f64` a vertex.
///
/// # Safety
///
/// As of `stonecut_free`. The place holds until the next call with this job.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_positions(of: *mut Job) -> *mut [f64; 3] {
    // SAFETY: as the caller's.
    unsafe { job(of) }.positions.as_mut_ptr()
}

/// The triangles: three `u32` each.
///
/// # Safety
///
/// As of `stonecut_positions`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_triangles(of: *mut Job) -> *mut [u32; 3] {
    // SAFETY: as the caller's.
    unsafe { job(of) }.triangles.as_mut_ptr()
}

/// The map: one `u32` for each vertex that was given.
///
/// # Safety
///
/// As of `stonecut_positions`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_map(of: *mut Job) -> *mut u32 {
    // SAFETY: as the caller's.
    unsafe { job(of) }.map.as_mut_ptr()
}

/// Number of vertices.
///
/// # Safety
///
/// As of `stonecut_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_n_vertices(of: *mut Job) -> u32 {
    // SAFETY: as the caller's.
    unsafe { job(of) }.positions.len() as u32
}

/// Number of triangles.
///
/// # Safety
///
/// As of `stonecut_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_n_triangles(of: *mut Job) -> u32 {
    // SAFETY: as the caller's.
    unsafe { job(of) }.triangles.len() as u32
}

/// Simplifies to at most `target` triangles. Returns 0; 1 if a triangle names a vertex that is not there, 2 if a position is not
/// finite: then the job is as it was.
///
/// # Safety
///
/// As of `stonecut_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stonecut_simplify(of: *mut Job, target: u32, flags: u32) -> u32 {
    // SAFETY: as the caller's.
    let job = unsafe { job(of) };
    let n = job.positions.len();
    if job.triangles.as_flattened().iter().any(|&v| v as usize >= n) {
        return 1;
    }
    if job.positions.as_flattened().iter().any(|x| !x.is_finite()) {
        return 2;
    }
    let has = |flag: u32| flags & flag != 0;
    let options = Options {
        stop: Stop::Triangles(target.into()),
        topology: if has(KEEP_TOPOLOGY) { Topology::Keep } else { Topology::Error },
        placement: if has(SUBSET) { Placement::Subset } else { Placement::Optimal },
        fit: if has(FIT) { Fit::On } else { Fit::Auto },
        follow: has(MAP),
        ..Options::default()
    };
    let Job { positions, triangles, .. } = std::mem::take(job);
    let locked = if has(LOCK_BOUNDARY) { at_open_edges(&triangles, n) } else { vec![false; n] };
    let simplified = simplify_mesh(Mesh::new(positions, triangles), &locked, &options);
    let Mesh { positions, triangles, .. } = simplified.mesh;
    *job = Job { positions, triangles, map: simplified.followed };
    0
}

/// True for vertices of edges that one triangle alone has.
fn at_open_edges(triangles: &[[u32; 3]], n_vertices: usize) -> Vec<bool> {
    let edges = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let mut edges: Vec<[u32; 2]> = edges.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    let mut locked = vec![false; n_vertices];
    for same in edges.chunk_by(|a, b| a == b).filter(|same| same.len() == 1) {
        same[0].iter().for_each(|&v| locked[v as usize] = true);
    }
    locked
}
