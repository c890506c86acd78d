//! Order of the steps in a file, in blocks: that of the run, or batches of splits that do not depend on each other.
//!
//! In a batch splits come in the order of their vertices, so that a small difference names each. A batch takes what it can
//! from the next steps of the run; what depends on a step before it in the batch, or on one that was put off, is put off to
//! the next.

use super::replay::NONE;
use stonecut_kernel::{Cursor, History, Step};

/// Steps in a block in the order of the run.
const BLOCK: usize = 1 << 15;
/// Steps that a batch looks at, for each vertex that is there.
const SHARE: f64 = 0.5;
/// Batches are neither smaller nor larger looks than this.
const LEAST: usize = 256;
const MOST: usize = 1 << 19;

/// Cuts the steps of the run, coarse to fine, into blocks in their order.
pub(super) fn in_order(steps: Vec<Cursor>) -> Vec<Vec<Cursor>> {
    steps.chunks(BLOCK).map(<[Cursor]>::to_vec).collect()
}

/// Vertices whose triangles a step gives away or takes over, and those that only get new ones.
#[derive(Default)]
struct Touched {
    centres: Vec<u32>,
    rims: Vec<u32>,
}

fn touched(history: &History, step: &Step, out: &mut Touched) {
    out.centres.clear();
    out.rims.clear();
    match *step {
        Step::Collapse { removed, kept, gone, .. } => {
            out.centres.extend([removed, kept]);
            let corners = gone.iter().flat_map(|&t| history.corners(t));
            out.rims.extend(corners.filter(|&v| v != removed && v != kept));
        }
        Step::Vanish { gone } => {
            out.centres.extend(gone.iter().flat_map(|&t| history.corners(t)));
        }
        Step::Cut { cycle, new, gone, .. } => {
            out.centres.extend(cycle.into_iter().chain(new));
            out.centres.extend(gone.iter().flat_map(|&t| history.corners(t)));
        }
    }
}

/// Cuts the steps of the run, coarse to fine, into batches; `n_vertices` are there at the beginning. In each batch no step
/// depends on another.
pub(super) fn in_batches(
    history: &History,
    steps: Vec<Cursor>,
    n_vertices: usize,
) -> Vec<Vec<Cursor>> {
    // The batch in which a vertex was touched last, as a centre and as a rim.
    let mut centre = vec![NONE; history.positions.len()];
    let mut rim = centre.clone();
    let (mut batches, mut open, mut steps) = (Vec::new(), Vec::new(), steps.into_iter());
    let (mut n, mut now) = (n_vertices, Touched::default());
    loop {
        let number = batches.len() as u32;
        let look = ((n as f64 * SHARE) as usize).clamp(LEAST, MOST);
        let before = open.len();
        open.extend(steps.by_ref().take(look.saturating_sub(before).max(look / 8)));
        if open.is_empty() {
            return batches;
        }
        let (mut batch, mut later) = (Vec::new(), Vec::new());
        for cursor in open {
            touched(history, &history.step(cursor), &mut now);
            let is_centre = |&v: &u32| centre[v as usize] == number;
            let is_rim = |&v: &u32| rim[v as usize] == number;
            let depends = now.centres.iter().any(|v| is_centre(v) || is_rim(v))
                || now.rims.iter().any(is_centre);
            now.centres.iter().for_each(|&v| centre[v as usize] = number);
            now.rims.iter().for_each(|&v| rim[v as usize] = number);
            if depends { later.push(cursor) } else { batch.push(cursor) }
        }
        n += batch.len();
        batches.push(batch);
        open = later;
    }
}
