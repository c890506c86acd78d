//! Rows of varying length: found in one sequential pass, read block by block afterwards.
//!
//! Faces of more than three corners become triangles here: quads along their shorter diagonal, larger
//! polygons as a fan around their first corner.

use super::BLOCK_ROWS;
use super::fields::{FieldPlan, FieldStep};
use super::fixed_faces::Decoded;
use super::header::{Element, Kind};
use super::lookup::Lookup;
use super::scan::{Fault, Mark, Scan, Scanned};

/// Most corners of a polygon that are supported; with more, a block of faces would outgrow its memory.
pub(crate) const MAX_CORNERS: u64 = 1 << 20;

/// A block of faces ends early once it holds this many triangles.
const MAX_BLOCK_TRIANGLES: u64 = 2 * BLOCK_ROWS;

/// Index of the places at which blocks of rows begin.
#[derive(Debug, Default)]
pub(crate) struct RowIndex {
    /// Place and first row of every block.
    pub blocks: Vec<(Mark, u64)>,
    /// Rows found; fewer than the header says only if the file ends early.
    pub n_rows: u64,
    /// Triangles that their corner lists make, degenerate ones included.
    pub n_triangles: u64,
    /// Place after the last row.
    pub end: Mark,
    /// Fault that stopped the pass, with its place.
    pub fault: Option<(Fault, Mark)>,
}

/// Rule for the size of the blocks of an index.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Blocks {
    /// After `BLOCK_ROWS` rows exactly.
    ByRows,
    /// Also when its faces are many triangles.
    ByTriangles,
}

/// Passes over all rows of `element` and notes where blocks begin; 24 + 8 bytes a block.
pub(crate) fn index_rows<S: Scan>(scan: &mut S, element: &Element, blocks: Blocks) -> RowIndex {
    let mut index = RowIndex { end: scan.mark(), ..RowIndex::default() };
    let corners = element.index_list();
    let (mut rows, mut triangles) = (BLOCK_ROWS, 0);
    // An element without properties has rows of no bytes: there is nothing to pass over.
    let n_rows = if element.properties.is_empty() { 0 } else { element.count };
    while index.n_rows < n_rows {
        if rows == BLOCK_ROWS || (blocks == Blocks::ByTriangles && triangles >= MAX_BLOCK_TRIANGLES)
        {
            index.blocks.push((index.end, index.n_rows));
            (rows, triangles) = (0, 0);
        }
        match skip_row(scan, element, corners) {
            Ok(n) => {
                triangles += n;
                index.n_triangles += n;
            }
            Err(fault) => {
                if rows == 0 {
                    index.blocks.pop();
                }
                index.fault = Some((fault, scan.last()));
                return index;
            }
        }
        rows += 1;
        index.n_rows += 1;
        index.end = scan.mark();
    }
    index
}

/// Passes over one row; returns how many triangles its corner list makes.
#[inline(always)]
fn skip_row<S: Scan>(scan: &mut S, element: &Element, corners: Option<usize>) -> Scanned<u64> {
    let mut triangles = 0;
    for (i, property) in element.properties.iter().enumerate() {
        match property.kind {
            Kind::List { count, item } if Some(i) == corners => {
                let n = scan.count(count)?;
                scan.skip(item, n)?;
                triangles = if n > MAX_CORNERS { 0 } else { n.saturating_sub(2) };
            }
            _ => scan.skip_property(property)?,
        }
    }
    Ok(triangles)
}

/// Reads one row of the vertex element into `record`.
#[inline(always)]
pub(crate) fn vertex_row<S: Scan>(
    scan: &mut S,
    plan: &FieldPlan,
    record: &mut [u8],
) -> Scanned<()> {
    for step in &plan.steps {
        match *step {
            FieldStep::Take(field) => {
                scan.store(field.wire, field.scalar, &mut record[field.target..])?;
            }
            FieldStep::SkipList { count, item } => {
                let n = scan.count(count)?;
                scan.skip(item, n)?;
            }
        }
    }
    Ok(())
}

/// Input of `face_row` besides the numbers.
pub(crate) struct FaceContext<'a, 'b> {
    /// The faces.
    pub element: &'a Element,
    /// Vertices of the file; corners are below.
    pub n_vertices: u64,
    /// Opens the vertices, where a polygon needs their places.
    pub lookup: &'a mut dyn FnMut() -> crate::error::Result<Lookup<'b>>,
    /// The vertices, once they have been opened.
    pub opened: Option<Lookup<'b>>,
}

/// Reads one row of the face element and appends its triangles.
#[inline(always)]
pub(crate) fn face_row<S: Scan>(
    scan: &mut S,
    context: &mut FaceContext<'_, '_>,
    corners: usize,
    out: &mut Decoded,
) -> Scanned<()> {
    let element = context.element;
    for (i, property) in element.properties.iter().enumerate() {
        match property.kind {
            Kind::List { count, item } if i == corners => {
                let n = scan.count(count)?;
                let already = out.triangles.len();
                let degenerate = out.n_degenerate;
                let n_read = match n {
                    0..=2 => {
                        out.n_degenerate += 1;
                        Ok(0)
                    }
                    3 => triangle(scan, item, context.n_vertices, out).map(|()| 3),
                    4 => quad(scan, item, context, out).map(|()| 4),
                    _ if n > MAX_CORNERS => Err((
                        0,
                        Fault::Text(format!(
                            "a face has {n} corners; at most {MAX_CORNERS} are supported"
                        )),
                    )),
                    _ => fan(scan, item, n, context.n_vertices, out).map(|()| n),
                };
                match n_read {
                    Ok(n_read) => scan.skip(item, n - n_read)?,
                    Err((n_read, Fault::Text(_))) if out.skip_bad => {
                        out.truncate(already);
                        out.n_degenerate = degenerate;
                        out.n_bad += 1;
                        scan.skip(item, n - n_read)?;
                    }
                    Err((_, fault)) => return Err(fault),
                }
            }
            _ => scan.skip_property(property)?,
        }
    }
    Ok(())
}

/// The fault of a corner list, and how many corners had been read.
type Corners = Result<(), (u64, Fault)>;

#[inline(always)]
fn corner<S: Scan>(
    scan: &mut S,
    item: super::header::Wire,
    n_vertices: u64,
    n_read: u64,
) -> Result<u64, (u64, Fault)> {
    match scan.index(item) {
        Ok(v) if v < n_vertices => Ok(v),
        Ok(_) => Err((n_read + 1, Fault::Text(out_of_range(n_vertices)))),
        Err(fault) => Err((n_read, fault)),
    }
}

/// The words for a corner that names no vertex.
pub(crate) fn out_of_range(n_vertices: u64) -> String {
    format!("a corner names a vertex that does not exist (there are {n_vertices})")
}

#[inline(always)]
fn triangle<S: Scan>(
    scan: &mut S,
    item: super::header::Wire,
    n_vertices: u64,
    out: &mut Decoded,
) -> Corners {
    let mut corners = [0; 3];
    for (i, place) in corners.iter_mut().enumerate() {
        *place = corner(scan, item, n_vertices, i as u64)?;
    }
    out.push(corners);
    Ok(())
}

fn quad<S: Scan>(
    scan: &mut S,
    item: super::header::Wire,
    context: &mut FaceContext<'_, '_>,
    out: &mut Decoded,
) -> Corners {
    let mut q = [0; 4];
    for (i, place) in q.iter_mut().enumerate() {
        *place = corner(scan, item, context.n_vertices, i as u64)?;
    }
    let mut diagonals = || -> crate::error::Result<[f64; 2]> {
        if context.opened.is_none() {
            context.opened = Some((context.lookup)()?);
        }
        let Some(lookup) = context.opened.as_mut() else { return Ok([0.0; 2]) };
        let [a, b, c, d] = [
            lookup.position(q[0])?,
            lookup.position(q[1])?,
            lookup.position(q[2])?,
            lookup.position(q[3])?,
        ];
        Ok([distance_sq(a, c), distance_sq(b, d)])
    };
    let [first, second] = diagonals().map_err(|e| (4, Fault::Other(e)))?;
    // Equal diagonals, and those that are not numbers, split along the first.
    if second < first {
        out.push([q[0], q[1], q[3]]);
        out.push([q[1], q[2], q[3]]);
    } else {
        out.push([q[0], q[1], q[2]]);
        out.push([q[0], q[2], q[3]]);
    }
    Ok(())
}

fn distance_sq(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}

fn fan<S: Scan>(
    scan: &mut S,
    item: super::header::Wire,
    n: u64,
    n_vertices: u64,
    out: &mut Decoded,
) -> Corners {
    let first = corner(scan, item, n_vertices, 0)?;
    let mut previous = corner(scan, item, n_vertices, 1)?;
    for i in 2..n {
        let next = corner(scan, item, n_vertices, i)?;
        out.push([first, previous, next]);
        previous = next;
    }
    Ok(())
}
