//! Triangle strips: lists of vertices in which every three neighbours are a triangle and -1 ends a strip.
//!
//! A statue is ONE list of hundreds of millions of numbers, so blocks begin inside it: the state of the
//! strip at the beginning of each block is kept from the one sequential pass (80 bytes a block).

use super::BLOCK_ROWS;
use super::fixed_faces::Decoded;
use super::header::{Element, Kind, Wire};
use super::scan::{Fault, Mark, Scan, Scanned};
use stonecut_mesh::property::Scalar;

/// Everything needed to go on reading strips.
#[derive(Clone, Copy, Debug, Default)]
pub struct StripState {
    pub mark: Mark,
    /// Row of the strips element.
    pub row: u64,
    in_list: bool,
    /// Numbers left in the row's list.
    left: u64,
    /// The last two corners of the strip, as far as there are any.
    previous: [u64; 2],
    n_previous: u8,
    /// True if the next triangle of the strip is reversed.
    odd: bool,
}

impl StripState {
    pub fn new(mark: Mark) -> Self {
        StripState { mark, ..StripState::default() }
    }
}

/// Index of the places at which blocks of strip triangles begin.
#[derive(Debug, Default)]
pub struct StripIndex {
    pub blocks: Vec<StripState>,
    pub n_triangles: u64,
    pub end: Mark,
    pub fault: Option<(Fault, Mark, u64)>,
}

/// Passes over all strips; triangles with repeated corners count too.
pub fn index_strips<S: Scan>(scan: &mut S, element: &Element, n_vertices: u64) -> StripIndex {
    let mut index = StripIndex::default();
    let mut state = StripState::new(scan.mark());
    loop {
        let start = state;
        let mut n = 0;
        let result = run(scan, element, n_vertices, &mut state, BLOCK_ROWS, |_| {
            n += 1;
            Ok(())
        });
        index.n_triangles += n;
        if n > 0 {
            index.blocks.push(start);
        }
        if let Err(fault) = result {
            index.fault = Some((fault, scan.last(), state.row));
            break;
        }
        state.mark = scan.mark();
        if n < BLOCK_ROWS {
            break;
        }
    }
    index.end = scan.mark();
    index
}

/// Reads one block of at most `n_triangles` strip triangles; the scan stands at the state's mark.
pub fn read_strips<S: Scan>(
    scan: &mut S,
    element: &Element,
    n_vertices: u64,
    mut state: StripState,
    n_triangles: u64,
    out: &mut Decoded,
) -> Result<(), (Fault, u64)> {
    let result = run(scan, element, n_vertices, &mut state, n_triangles, |corners| {
        if corners.iter().all(|&v| v < n_vertices) {
            out.push(corners);
        } else if out.skip_bad {
            out.n_bad += 1;
        } else {
            return Err(Fault::Text(super::rows::out_of_range(n_vertices)));
        }
        Ok(())
    });
    result.map_err(|fault| (fault, state.row))
}

/// Goes on from `state` until `limit` triangles were emitted or the element ends.
#[inline(always)]
fn run<S: Scan>(
    scan: &mut S,
    element: &Element,
    n_vertices: u64,
    state: &mut StripState,
    limit: u64,
    mut emit: impl FnMut([u64; 3]) -> Scanned<()>,
) -> Scanned<()> {
    let Some(list) = element.index_list() else { return Ok(()) };
    let Kind::List { count, item } = element.properties[list].kind else { return Ok(()) };
    let stop = stop_value(item, n_vertices);
    let mut emitted = 0;
    while state.row < element.count {
        if !state.in_list {
            for property in &element.properties[..list] {
                scan.skip_property(property)?;
            }
            state.left = scan.count(count)?;
            (state.in_list, state.n_previous, state.odd) = (true, 0, false);
        }
        while state.left > 0 {
            // A block ends right after its last triangle: what follows may be beyond a cut-off end.
            if emitted == limit {
                return Ok(());
            }
            let vertex = scan.index(item)?;
            state.left -= 1;
            if vertex >= stop {
                (state.n_previous, state.odd) = (0, false);
            } else if state.n_previous < 2 {
                state.previous[usize::from(state.n_previous)] = vertex;
                state.n_previous += 1;
            } else {
                let [a, b] = state.previous;
                emit(if state.odd { [b, a, vertex] } else { [a, b, vertex] })?;
                emitted += 1;
                state.previous = [b, vertex];
                state.odd = !state.odd;
            }
        }
        for property in &element.properties[list + 1..] {
            scan.skip_property(property)?;
        }
        (state.in_list, state.row) = (false, state.row + 1);
    }
    Ok(())
}

/// The least number that ends a strip: -1, or what -1 becomes in an unsigned type that has room for it.
fn stop_value(item: Wire, n_vertices: u64) -> u64 {
    let unsigned = match item {
        Wire::Plain(Scalar::U8) => u64::from(u8::MAX),
        Wire::Plain(Scalar::U16) => u64::from(u16::MAX),
        Wire::Plain(Scalar::U32) => u64::from(u32::MAX),
        _ => u64::MAX,
    };
    if n_vertices <= unsigned { unsigned } else { u64::MAX }
}
