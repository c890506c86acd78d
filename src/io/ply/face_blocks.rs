//! Reads blocks of faces as triangles, however the file holds them.

use super::fixed_faces::{BlockEnd, Decoded, PLAIN_BYTES, corners4};
use super::layout::{FaceLayout, explain, index_faces, with_scan};
use super::placed::Placed;
use super::rows::{FaceContext, Polygon, RowIndex, face_row, out_of_range};
use super::scan::{Fault, Mark, Scan};
use super::source::MeshSource;
use super::strips::read_strips;
use super::{BLOCK_ROWS, FaceBlock};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use stonecut_system::error::Result;
use stonecut_system::losses::Loss;
use stonecut_system::parallel;
use stonecut_system::progress::Progress;

impl MeshSource {
    /// Reads and checks one block of faces; callable from any thread. Reuses `block`'s memory.
    pub fn read_faces(&self, index: u64, block: &mut FaceBlock) -> Result<()> {
        self.read_face_block(index, block, false)
    }

    /// Calls `each` with one block of faces after the other.
    pub fn each_face_block(
        &self,
        mut each: impl FnMut(&mut FaceBlock) -> Result<()>,
    ) -> Result<()> {
        let mut block = FaceBlock::default();
        (0..self.n_face_blocks()).try_for_each(|index| {
            self.read_faces(index, &mut block)?;
            each(&mut block)
        })
    }

    /// The same, with the row of every triangle in `block.rows`.
    pub fn read_faces_with_rows(&self, index: u64, block: &mut FaceBlock) -> Result<()> {
        self.read_face_block(index, block, true)
    }

    fn read_face_block(&self, index: u64, block: &mut FaceBlock, tracked: bool) -> Result<()> {
        assert!(index < self.n_face_blocks(), "the block exists");
        let mut out = Decoded {
            triangles: std::mem::take(&mut block.triangles),
            rows: std::mem::take(&mut block.rows),
            skip_bad: self.options.skip_bad,
            tracked,
            ..Decoded::default()
        };
        out.truncate(0);
        match &self.layout.faces {
            FaceLayout::None => {}
            FaceLayout::Fixed { .. } => self.read_fixed_faces(index, block, &mut out)?,
            FaceLayout::Indexed(rows) => {
                block.first_row = rows.blocks[index as usize].1;
                self.read_face_rows(index, rows, &mut out)?;
            }
            FaceLayout::Strips(strips) => {
                block.first_row = index * BLOCK_ROWS;
                let n = BLOCK_ROWS.min(strips.n_triangles - block.first_row);
                let state = strips.blocks[index as usize];
                let element = self.face();
                with_scan!(&self.file, self.header.encoding, state.mark, |scan| {
                    read_strips(&mut scan, element, self.n_vertices(), state, n, &mut out).map_err(
                        |(fault, row)| explain(&self.file, element, row, scan.last(), fault),
                    )
                })?;
            }
        }
        if self.bad_vertices.len() > 0 {
            let before = out.triangles.len();
            let is_bad = |t: &[u64; 3]| t.iter().any(|&v| self.bad_vertices.contains(v));
            if tracked {
                let mut bad = out.triangles.iter().map(is_bad);
                out.rows.retain(|_| bad.next() == Some(false));
            }
            out.triangles.retain(|t| !is_bad(t));
            out.n_bad += (before - out.triangles.len()) as u64;
        }
        if self.placed.as_ref().is_some_and(Placed::is_mirror) {
            out.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        block.triangles = out.triangles;
        block.rows = out.rows;
        block.n_degenerate = out.n_degenerate;
        block.n_bad = out.n_bad;
        Ok(())
    }

    fn read_fixed_faces(&self, index: u64, block: &mut FaceBlock, out: &mut Decoded) -> Result<()> {
        let FaceLayout::Fixed { offset, rows, checked, fallback } = &self.layout.faces else {
            return Ok(());
        };
        block.first_row = index * BLOCK_ROWS;
        let built = fallback.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(rows) = built {
            return self.read_face_rows(index, &rows, out);
        }
        let n = self.read_fixed_rows(index, &mut block.scratch)?;
        out.triangles.reserve(n);
        let mut found = rows.decode(&block.scratch, self.n_vertices(), out);
        // These rows are where they seem to be only if all before them are triangles.
        while found != Err(BlockEnd::OtherLayout)
            && let Some(earlier) = checked.gap_before(index)
        {
            self.read_fixed_rows(earlier, &mut block.scratch)?;
            if block.scratch.chunks_exact(rows.stride).all(|row| rows.matches(row)) {
                checked.add(earlier);
            } else {
                found = Err(BlockEnd::OtherLayout);
            }
        }
        if found == Ok(()) {
            checked.add(index);
        }
        match found {
            Ok(()) => Ok(()),
            Err(BlockEnd::OutOfRange(i)) => {
                let row = block.first_row + i as u64;
                let at = Mark { offset: offset + row * rows.stride as u64, ..Mark::default() };
                let what = Fault::Text(out_of_range(self.n_vertices()));
                Err(explain(&self.file, self.face(), row, at, what))
            }
            Err(BlockEnd::OtherLayout) => {
                *out = Decoded {
                    triangles: std::mem::take(&mut out.triangles),
                    rows: std::mem::take(&mut out.rows),
                    skip_bad: out.skip_bad,
                    tracked: out.tracked,
                    ..Decoded::default()
                };
                out.truncate(0);
                let rows = {
                    let mut built = fallback.lock().unwrap_or_else(PoisonError::into_inner);
                    match &*built {
                        Some(rows) => rows.clone(),
                        None => {
                            let rows = index_faces(
                                &self.file,
                                self.header.encoding,
                                self.face(),
                                *offset,
                            )?;
                            built.insert(Arc::new(rows)).clone()
                        }
                    }
                };
                self.read_face_rows(index, &rows, out)
            }
        }
    }

    /// Calls `each` with blocks of rows of triangles in turn, their first row and number, if all stand in the file as they would
    /// in a staged one: a count of one byte, three numbers of four, properties. Rows are changed by `change` before, on several
    /// threads. Returns false if any does not; then `each` has had rows in vain.
    pub(crate) fn each_plain_block<T: Default + Send>(
        &self,
        threads: usize,
        change: impl Fn(&mut [u8], &mut T) -> Result<()> + Sync,
        mut each: impl FnMut(u64, &[u8], u64) -> Result<()>,
    ) -> Result<bool> {
        let FaceLayout::Fixed { rows, fallback, .. } = &self.layout.faces else { return Ok(false) };
        let is_built = fallback.lock().unwrap_or_else(PoisonError::into_inner).is_some();
        let value_bytes: usize = self.face_properties().iter().map(|p| p.scalar.bytes()).sum();
        let is_mirror = self.placed.as_ref().is_some_and(Placed::is_mirror);
        let is_plain = rows.is_plain() && rows.stride == PLAIN_BYTES + value_bytes;
        if is_built || is_mirror || !is_plain || self.bad_vertices.len() > 0 {
            return Ok(false);
        }
        let is_odd = AtomicBool::new(false);
        let produce = |index, (block, own): &mut (Vec<u8>, T)| {
            if is_odd.load(Ordering::Relaxed) {
                return Ok(());
            }
            self.read_fixed_rows(index, block)?;
            block.chunks_exact_mut(rows.stride).try_for_each(|row| {
                let corners = corners4(&row[1..], |v| u64::from(u32::from_le_bytes(v)));
                if row[0] == 3 && corners.iter().all(|&v| v < self.n_vertices()) {
                    return change(row, own);
                }
                is_odd.store(true, Ordering::Relaxed);
                Ok(())
            })
        };
        let mut consume =
            |index, (block, _): &mut (Vec<u8>, T)| match is_odd.load(Ordering::Relaxed) {
                true => Ok(()),
                false => each(index * BLOCK_ROWS, block, (block.len() / rows.stride) as u64),
            };
        if threads > 1 {
            let progress = Progress::default();
            parallel::in_order(self.n_face_blocks(), threads, &progress, produce, consume)?;
        } else {
            let mut slot = Default::default();
            for index in 0..self.n_face_blocks() {
                produce(index, &mut slot)?;
                consume(index, &mut slot)?;
            }
        }
        Ok(!is_odd.into_inner())
    }

    /// Reads the bytes of a block of rows of one size; returns the number of rows.
    fn read_fixed_rows(&self, index: u64, bytes: &mut Vec<u8>) -> Result<usize> {
        let FaceLayout::Fixed { offset, rows, .. } = &self.layout.faces else { return Ok(0) };
        let first = index * BLOCK_ROWS;
        let n = BLOCK_ROWS.min(self.n_face_rows() - first) as usize;
        bytes.resize(n * rows.stride, 0);
        self.file.read_exact_at(bytes, offset + first * rows.stride as u64)?;
        Ok(n)
    }

    fn read_face_rows(&self, index: u64, rows: &RowIndex, out: &mut Decoded) -> Result<()> {
        let (mark, first) = rows.blocks[index as usize];
        let next = rows.blocks.get(index as usize + 1).map_or(rows.n_rows, |b| b.1);
        let element = self.face();
        let Some(corners) = element.index_list() else { return Ok(()) };
        let mut open = || self.lookup();
        let mut context = FaceContext {
            element,
            n_vertices: self.n_vertices(),
            lookup: &mut open,
            opened: None,
            polygon: Polygon::default(),
        };
        with_scan!(&self.file, self.header.encoding, mark, |scan| {
            for row in first..next {
                out.row = (row - first) as u32;
                if let Err(fault) = face_row(&mut scan, &mut context, corners, out) {
                    return Err(explain(&self.file, element, row, scan.last(), fault));
                }
            }
            Ok(())
        })?;
        let mut crossing = self.crossing.lock().unwrap_or_else(PoisonError::into_inner);
        crossing.insert(index, out.n_crossing);
        Ok(())
    }

    /// Lines for people on what was passed over or found to be odd, in the file and in its faces.
    pub fn remarks(&self) -> Result<Vec<Loss>> {
        let mut lines = self.notes().to_vec();
        let n = self.n_crossing_polygons()?;
        if n > 0 {
            let what = "polygons cross themselves: their triangles overlap or miss a part";
            lines.push(Loss::remark(format!("{n} {what}")));
        }
        Ok(lines)
    }

    /// Number of polygons whose sides cross; no triangles have exactly their area.
    ///
    /// Reads the blocks of faces that were not read before, if the file has polygons.
    pub fn n_crossing_polygons(&self) -> Result<u64> {
        let has_polygons = match &self.layout.faces {
            FaceLayout::None | FaceLayout::Strips(_) => false,
            FaceLayout::Fixed { fallback, .. } => {
                fallback.lock().unwrap_or_else(PoisonError::into_inner).is_some()
            }
            FaceLayout::Indexed(rows) => rows.n_triangles > rows.n_rows,
        };
        if !has_polygons {
            return Ok(0);
        }
        let known = || self.crossing.lock().unwrap_or_else(PoisonError::into_inner);
        let mut block = FaceBlock::default();
        for index in 0..self.n_face_blocks() {
            if !known().contains_key(&index) {
                self.read_faces(index, &mut block)?;
            }
        }
        Ok(known().values().sum())
    }
}
