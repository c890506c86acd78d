//! Rows of varying length: found in one sequential pass, read block by block afterwards.
//!
//! Faces of more than three corners become triangles here (`io::polygon`).

use super::BLOCK_ROWS;
use super::fields::{FieldPlan, FieldStep};
use super::fixed_faces::Decoded;
use super::header::{Element, Kind};
use super::lookup::Lookup;
use super::scan::{Fault, Mark, Scan, Scanned};
use crate::polygon::{Diagonal, PolygonCutter, cut_quad};
use stonecut_mesh::property::write_scalar;

/// Most corners of a polygon that are supported; with more, a block of faces would outgrow its memory.
pub const MAX_CORNERS: u64 = 1 << 20;

/// A block of faces ends early once it holds this many triangles.
const MAX_BLOCK_TRIANGLES: u64 = 2 * BLOCK_ROWS;

/// Index of the places at which blocks of rows begin.
#[derive(Debug, Default)]
pub struct RowIndex {
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
pub enum Blocks {
    /// After `BLOCK_ROWS` rows exactly.
    ByRows,
    /// Also when its faces are many triangles.
    ByTriangles,
}

/// Passes over all rows of `element` and notes where blocks begin; 24 + 8 bytes a block.
pub fn index_rows<S: Scan>(scan: &mut S, element: &Element, blocks: Blocks) -> RowIndex {
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

/// Reads one row of the vertex element into `record`; with `skip_bad`, text that is not a number is a missing value.
#[inline(always)]
pub fn vertex_row<S: Scan>(
    scan: &mut S,
    plan: &FieldPlan,
    skip_bad: bool,
    record: &mut [u8],
) -> Scanned<()> {
    for step in &plan.steps {
        match *step {
            FieldStep::Take(field) => {
                match scan.store(field.wire, field.scalar, &mut record[field.target..]) {
                    Err(Fault::Text(_)) if skip_bad => {
                        scan.skip(field.wire, 1)?;
                        write_scalar(field.scalar, record, field.target, f64::NAN);
                    }
                    stored => stored?,
                }
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
pub struct FaceContext<'a, 'b> {
    /// The faces.
    pub element: &'a Element,
    /// Vertices of the file; corners are below.
    pub n_vertices: u64,
    /// Opens the vertices, where a polygon needs their places.
    pub lookup: &'a mut dyn FnMut() -> stonecut_system::error::Result<Lookup<'b>>,
    /// The vertices, once they have been opened.
    pub opened: Option<Lookup<'b>>,
    /// Corners of the polygon at hand, their places, and what cuts them.
    pub polygon: Polygon,
}

/// Memory for polygons, kept from one to the next.
#[derive(Default)]
pub struct Polygon {
    ids: Vec<u64>,
    places: Vec<[f64; 3]>,
    cutter: PolygonCutter,
}

impl<'b> FaceContext<'_, 'b> {
    /// Random access to positions.
    fn lookup(&mut self) -> stonecut_system::error::Result<&mut Lookup<'b>> {
        if self.opened.is_none() {
            self.opened = Some((self.lookup)()?);
        }
        Ok(self.opened.as_mut().expect("opened a line above"))
    }
}

/// Reads one row of the face element and appends its triangles.
#[inline(always)]
pub fn face_row<S: Scan>(
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
                let (degenerate, crossing) = (out.n_degenerate, out.n_crossing);
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
                    _ => polygon(scan, item, n, context, out).map(|()| n),
                };
                match n_read {
                    Ok(n_read) => scan.skip(item, n - n_read)?,
                    Err((n_read, Fault::Text(_))) if out.skip_bad => {
                        out.truncate(already);
                        (out.n_degenerate, out.n_crossing) = (degenerate, crossing);
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
pub fn out_of_range(n_vertices: u64) -> String {
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
    let mut places = || -> stonecut_system::error::Result<[[f64; 3]; 4]> {
        let lookup = context.lookup()?;
        let mut places = [[0.0; 3]; 4];
        for (place, &id) in places.iter_mut().zip(&q) {
            *place = lookup.position(id)?;
        }
        Ok(places)
    };
    let (diagonal, is_simple) = cut_quad(places().map_err(|e| (4, Fault::Other(e)))?);
    out.n_crossing += u64::from(!is_simple);
    match diagonal {
        Diagonal::Second => {
            out.push([q[0], q[1], q[3]]);
            out.push([q[1], q[2], q[3]]);
        }
        Diagonal::First => {
            out.push([q[0], q[1], q[2]]);
            out.push([q[0], q[2], q[3]]);
        }
    }
    Ok(())
}

fn polygon<S: Scan>(
    scan: &mut S,
    item: super::header::Wire,
    n: u64,
    context: &mut FaceContext<'_, '_>,
    out: &mut Decoded,
) -> Corners {
    let mut polygon = std::mem::take(&mut context.polygon);
    let Polygon { ids, places, cutter } = &mut polygon;
    ids.clear();
    places.clear();
    for i in 0..n {
        ids.push(corner(scan, item, context.n_vertices, i)?);
    }
    let mut look_up = || -> stonecut_system::error::Result<()> {
        let lookup = context.lookup()?;
        for &id in ids.iter() {
            places.push(lookup.position(id)?);
        }
        Ok(())
    };
    look_up().map_err(|e| (n, Fault::Other(e)))?;
    out.n_crossing += u64::from(!cutter.cut(places));
    for t in &cutter.triangles {
        out.push(t.map(|i| ids[i]));
    }
    // Corners that no triangle reaches are in one place with others, or sides cross.
    out.n_degenerate += (n - 2).saturating_sub(cutter.triangles.len() as u64);
    context.polygon = polygon;
    Ok(())
}
