//! Layout of the body: places of the rows of vertices and faces.
//!
//! Walks through the elements in file order, by arithmetic as far as rows have one size and by scanning
//! otherwise, and stops once vertices and faces are found. Nothing is allocated for what a header claims;
//! indices grow with what is really there.

use super::binary::BinaryScan;
use super::checked::Checked;
use super::fixed_faces::FixedFaces;
use super::header::{Element, Encoding, Header};
use super::range_grid::{self, RangeGrid};
use super::raw::RawFile;
use super::rows::{Blocks, RowIndex, index_rows};
use super::scan::{Fault, Mark};
use super::strips::{StripIndex, index_strips};
use std::sync::{Arc, Mutex};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Loss, LossKind};

/// Runs `$body` with a scan of the file's encoding that stands at `$mark`.
macro_rules! with_scan {
    ($file:expr, $encoding:expr, $mark:expr, |$scan:ident| $body:expr) => {
        if $encoding == $crate::ply::header::Encoding::Ascii {
            let mut $scan = $crate::ply::ascii::AsciiScan::new($file, $mark);
            $body
        } else {
            let mut $scan = $crate::ply::binary::BinaryScan::new($file, $encoding, $mark);
            $body
        }
    };
}
pub(crate) use with_scan;

/// Rows of faces probed before their layout is taken to be fixed.
const PROBES: u64 = 64;

/// Layout of the rows of the vertex element.
pub enum VertexLayout {
    /// Rows of one size from `offset`.
    Fixed { offset: u64, row_bytes: u64 },
    /// Blocks of exactly `BLOCK_ROWS` rows.
    Indexed(RowIndex),
}

/// Layout of the faces.
pub enum FaceLayout {
    /// The file holds points only.
    None,
    /// Rows of one size from `offset`, until one is found that has another; then `fallback` is built.
    Fixed {
        offset: u64,
        rows: FixedFaces,
        checked: Checked,
        fallback: Mutex<Option<Arc<RowIndex>>>,
    },
    /// Blocks of rows.
    Indexed(Arc<RowIndex>),
    /// Blocks of strip triangles.
    Strips(StripIndex),
}

/// Layout of the body as found.
pub struct Layout {
    pub vertices: VertexLayout,
    pub faces: FaceLayout,
    pub n_vertices: u64,
    /// Rows of the face element, or triangles of the strips.
    pub n_face_rows: u64,
    /// Triangles that the faces make, degenerate ones included.
    pub n_triangles: u64,
    /// Index of the element that holds the vertices, and of that with the faces.
    pub vertex_element: usize,
    pub face_element: Option<usize>,
    /// Posts in rows and columns, where there are no faces.
    pub grid: Option<RangeGrid>,
    /// A remark on what lies behind the last element.
    pub rest: Option<Loss>,
}

/// Finds vertices and faces; with `skip_bad`, as many as a truncated file still holds.
pub fn locate(file: &RawFile, header: &Header, skip_bad: bool) -> Result<Layout> {
    let vertex_element =
        header.elements.iter().position(|e| e.name == "vertex").ok_or_else(|| {
            file.bad("the element 'vertex' is missing; stonecut needs vertices and faces")
        })?;
    let face_element = choose_faces(file, header)?;
    let posts = if face_element.is_none() { range_grid::find(file, header)? } else { None };
    if let Some(grid) = posts {
        check_corners(file, &header.elements[grid.element])?;
    }
    let (line, line_start) = match header.encoding {
        Encoding::Ascii => (header.n_lines + 1, header.body_offset),
        _ => (0, 0),
    };
    let at = Mark { offset: header.body_offset, line, line_start };
    let vertices = VertexLayout::Fixed { offset: at.offset, row_bytes: 1 };
    let mut walk = Walk {
        file,
        header,
        skip_bad,
        at,
        vertices_seen: false,
        out: Layout {
            vertices,
            faces: FaceLayout::None,
            n_vertices: header.elements[vertex_element].count,
            n_face_rows: 0,
            n_triangles: 0,
            vertex_element,
            face_element,
            grid: None,
            rest: None,
        },
    };
    let last = vertex_element.max(face_element.or(posts.map(|grid| grid.element)).unwrap_or(0));
    for i in 0..=last {
        let element = &header.elements[i];
        walk.check_plausible(element)?;
        if i == vertex_element {
            walk.vertices(element)?;
        } else if Some(i) == face_element && element.name == "tristrips" {
            walk.strips(element)?;
        } else if Some(i) == face_element {
            walk.faces(element)?;
        } else if let Some(grid) = posts
            && i == grid.element
        {
            walk.out.grid = Some(RangeGrid { mark: walk.at, ..grid });
            if i < last {
                walk.pass(element)?;
            }
        } else {
            walk.pass(element)?;
        }
    }
    if posts.is_none() {
        walk.out.rest = walk.rest(&header.elements[last + 1..])?;
    }
    Ok(walk.out)
}

/// The element that holds faces: `face`, unless it is empty and there are strips.
fn choose_faces(file: &RawFile, header: &Header) -> Result<Option<usize>> {
    let find = |name: &str| header.elements.iter().position(|e| e.name == name && e.count > 0);
    let Some(i) = find("face").or_else(|| find("tristrips")) else { return Ok(None) };
    check_corners(file, &header.elements[i])?;
    Ok(Some(i))
}

/// Refuses an element without a list of corners.
fn check_corners(file: &RawFile, element: &Element) -> Result<()> {
    if element.index_list().is_some() {
        return Ok(());
    }
    Err(file.bad(format!(
        "element {}: it has no list 'vertex_indices' or 'vertex_index', so its corners are unknown",
        element.name
    )))
}

/// The walk through the elements.
struct Walk<'a> {
    file: &'a RawFile,
    header: &'a Header,
    skip_bad: bool,
    at: Mark,
    vertices_seen: bool,
    out: Layout,
}

impl Walk<'_> {
    fn fixed_bytes(&self, element: &Element) -> Option<u64> {
        element.fixed_bytes().filter(|_| self.header.encoding != Encoding::Ascii)
    }

    fn left(&self) -> u64 {
        self.file.len().saturating_sub(self.at.offset)
    }

    /// Refuses a count of rows of one size that the rest of the file cannot hold. Rows of varying size
    /// are counted as they are found; nothing is allocated for a promise.
    fn check_plausible(&self, element: &Element) -> Result<()> {
        let Some(row_bytes) = self.fixed_bytes(element) else { return Ok(()) };
        let needed = row_bytes.checked_mul(element.count);
        if self.skip_bad || needed.is_some_and(|bytes| bytes <= self.left()) {
            return Ok(());
        }
        let row = self.left().checked_div(row_bytes).unwrap_or(0);
        Err(explain(self.file, element, row, self.at, Fault::End))
    }

    /// Moves over `count` rows of `row_bytes` bytes; returns how many of them the file holds.
    fn advance(&mut self, element: &Element, row_bytes: u64) -> u64 {
        let held =
            self.left().checked_div(row_bytes).map_or(element.count, |n| n.min(element.count));
        // Whole rows that the file holds cannot overflow.
        self.at.offset += held * row_bytes;
        held
    }

    fn index(&mut self, element: &Element, blocks: Blocks) -> Result<RowIndex> {
        let mut index = with_scan!(self.file, self.header.encoding, self.at, |scan| index_rows(
            &mut scan, element, blocks
        ));
        if let Some((fault, mark)) = index.fault.take() {
            if !(self.skip_bad && matches!(fault, Fault::End)) {
                return Err(explain(self.file, element, index.n_rows, mark, fault));
            }
            // What follows a cut-off element is lost too.
            index.end.offset = self.file.len();
        }
        self.at = index.end;
        Ok(index)
    }

    fn vertices(&mut self, element: &Element) -> Result<()> {
        self.vertices_seen = true;
        match self.fixed_bytes(element) {
            Some(row_bytes) => {
                self.out.vertices = VertexLayout::Fixed { offset: self.at.offset, row_bytes };
                self.out.n_vertices = self.advance(element, row_bytes);
                if self.out.n_vertices < element.count {
                    self.at.offset = self.file.len();
                }
            }
            None => {
                let index = self.index(element, Blocks::ByRows)?;
                self.out.n_vertices = index.n_rows;
                self.out.vertices = VertexLayout::Indexed(index);
            }
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element) -> Result<()> {
        let offset = self.at.offset;
        let fixed = self.fixed_faces(element)?;
        let stride = fixed.as_ref().map_or(0, |rows| rows.stride as u64);
        let all_bytes = stride.saturating_mul(element.count);
        let are_triangles = match &fixed {
            None => false,
            Some(rows) => {
                rows.has_one_list() && self.left().checked_sub(all_bytes) == self.bytes_behind()
            }
        };
        if !are_triangles {
            // Triangles are not rows: only the rows themselves tell how many there are.
            let index = self.index(element, Blocks::ByTriangles)?;
            self.out.n_face_rows = index.n_rows;
            self.out.n_triangles = index.n_triangles;
            let as_guessed = index.n_rows == element.count
                && index.n_triangles == element.count
                && index.end.offset == offset + all_bytes;
            if fixed.is_none() || !as_guessed {
                self.out.faces = FaceLayout::Indexed(Arc::new(index));
                return Ok(());
            }
        } else {
            self.out.n_face_rows = element.count;
            self.out.n_triangles = element.count;
            self.at.offset = offset + all_bytes;
        }
        if let Some(rows) = fixed {
            let (checked, fallback) = (Checked::default(), Mutex::new(None));
            self.out.faces = FaceLayout::Fixed { offset, rows, checked, fallback };
        }
        Ok(())
    }

    /// Bytes of the elements behind the faces, which are last but for these; `None` if that is unknown.
    ///
    /// A file that ends right behind rows of triangles of one size, and these, holds nothing but
    /// triangles: one polygon more would make it longer.
    fn bytes_behind(&self) -> Option<u64> {
        self.bytes_of(&self.header.elements[self.out.face_element? + 1..])
    }

    /// Bytes of all rows of some elements; `None` if that is unknown.
    fn bytes_of(&self, elements: &[Element]) -> Option<u64> {
        elements.iter().try_fold(0u64, |sum, element| {
            let bytes = if element.count == 0 { 0 } else { self.fixed_bytes(element)? };
            sum.checked_add(bytes.checked_mul(element.count)?)
        })
    }

    /// The remark on bytes behind all elements, of which `behind` were not looked at. Padding is not named.
    fn rest(&self, behind: &[Element]) -> Result<Option<Loss>> {
        let Some(bytes) = self.bytes_of(behind) else { return Ok(None) };
        let at = self.at.offset.saturating_add(bytes);
        let mut first = [0; 4096];
        let n = if at < self.file.len() { self.file.read_at_most(&mut first, at)? } else { 0 };
        let is_padding = |b: &u8| b.is_ascii_whitespace() || matches!(b, 0 | 0x1a);
        if first[..n].iter().all(is_padding) {
            return Ok(None);
        }
        let what = match first[..n].trim_ascii_start().starts_with(b"ply") {
            true => "another PLY file stands behind this one: left out; give them one by one",
            false => "the header promises fewer rows than there are: the rest is left out",
        };
        let what =
            format!("byte offset {at}, {} bytes before the end: {what}", self.file.len() - at);
        Ok(Some(Loss { kind: LossKind::Elements, ..Loss::remark(what) }))
    }

    /// The layout of rows of one size, if the first row, the file's length and a few probes agree on it.
    fn fixed_faces(&self, element: &Element) -> Result<Option<FixedFaces>> {
        // Vertices behind the faces are found only by knowing exactly where the faces end.
        if self.header.encoding == Encoding::Ascii || !self.vertices_seen {
            return Ok(None);
        }
        let mut first = [0u8; 4096];
        let n = self.file.read_at_most(&mut first, self.at.offset)?;
        let Some(rows) = FixedFaces::guess(element, self.header.encoding, &first[..n]) else {
            return Ok(None);
        };
        let stride = rows.stride as u64;
        if stride.checked_mul(element.count).is_none_or(|bytes| bytes > self.left()) {
            return Ok(None);
        }
        let mut row = vec![0; rows.stride];
        for probe in 0..=PROBES {
            let i = (u128::from(element.count - 1) * u128::from(probe) / u128::from(PROBES)) as u64;
            self.file.read_exact_at(&mut row, self.at.offset + i * stride)?;
            if !rows.matches(&row) {
                return Ok(None);
            }
        }
        Ok(Some(rows))
    }

    fn strips(&mut self, element: &Element) -> Result<()> {
        let n_vertices = self.out.n_vertices;
        let mut index = with_scan!(self.file, self.header.encoding, self.at, |scan| index_strips(
            &mut scan, element, n_vertices
        ));
        if let Some((fault, mark, row)) = index.fault.take() {
            if !(self.skip_bad && matches!(fault, Fault::End)) {
                return Err(explain(self.file, element, row, mark, fault));
            }
            index.end.offset = self.file.len();
        }
        self.at = index.end;
        self.out.n_face_rows = index.n_triangles;
        self.out.n_triangles = index.n_triangles;
        self.out.faces = FaceLayout::Strips(index);
        Ok(())
    }

    /// Passes over an element that is not used.
    fn pass(&mut self, element: &Element) -> Result<()> {
        match self.fixed_bytes(element) {
            Some(row_bytes) => {
                if self.advance(element, row_bytes) < element.count {
                    self.at.offset = self.file.len();
                }
                Ok(())
            }
            None => self.index(element, Blocks::ByRows).map(drop),
        }
    }
}

/// The index of faces whose layout turned out not to be fixed; blocks of exactly `BLOCK_ROWS` rows.
pub fn index_faces(
    file: &RawFile,
    encoding: Encoding,
    element: &Element,
    offset: u64,
) -> Result<RowIndex> {
    let mark = Mark { offset, ..Mark::default() };
    let mut scan = BinaryScan::new(file, encoding, mark);
    let mut index = index_rows(&mut scan, element, Blocks::ByRows);
    match index.fault.take() {
        Some((fault, mark)) => Err(explain(file, element, index.n_rows, mark, fault)),
        None => Ok(index),
    }
}

/// The words for a file that ends too early.
fn truncated(count: u64) -> String {
    format!(
        "the file ends here, but its header promises {count} rows; copy or export it again, or read \
         what is there with --skip-bad"
    )
}

/// An error from a fault in a row.
pub fn explain(file: &RawFile, element: &Element, row: u64, mark: Mark, fault: Fault) -> Error {
    let name = &element.name;
    match fault {
        Fault::Other(error) => error,
        Fault::End => file.bad(format!(
            "element {name}, row {row}, byte offset {}: {}",
            file.len(),
            truncated(element.count)
        )),
        Fault::Text(what) => file.bad(format!(
            "element {name}, row {row}, {mark}: {what}; export the mesh again, or drop broken faces \
             with --skip-bad"
        )),
    }
}
