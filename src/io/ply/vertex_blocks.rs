//! Reads blocks of vertices, and positions in any order for the diagonals of quads.

use super::fields::{FieldPlan, FieldStep, first_not_finite, not_finite, wire_value};
use super::header::{Encoding, Wire};
use super::layout::{VertexLayout, explain, with_scan};
use super::lookup::Lookup;
use super::raw::{RawFile, Spool};
use super::rows::vertex_row;
use super::scan::{Mark, Scan};
use super::skipped::BadVertices;
use super::source::MeshSource;
use super::{BLOCK_ROWS, VertexBlock};
use std::sync::PoisonError;
use stonecut_system::error::Result;

impl MeshSource {
    /// Reads and checks one block of vertices; callable from any thread. Reuses `block`'s memory.
    pub fn read_vertices(&self, index: u64, block: &mut VertexBlock) -> Result<()> {
        self.read_checked(index, block)?;
        if let Some(placed) = &self.placed {
            placed.put_vertices(&self.plan.schema, block);
        }
        Ok(())
    }

    /// Calls `each` with one block of vertices after the other.
    pub fn each_vertex_block(
        &self,
        mut each: impl FnMut(&VertexBlock) -> Result<()>,
    ) -> Result<()> {
        let mut block = VertexBlock::default();
        (0..self.n_vertex_blocks()).try_for_each(|index| {
            self.read_vertices(index, &mut block)?;
            each(&block)
        })
    }

    /// Calls `each` with every vertex and its record, in order.
    pub fn each_vertex(&self, mut each: impl FnMut(u64, &[u8]) -> Result<()>) -> Result<()> {
        let record_bytes = self.schema().record_bytes();
        self.each_vertex_block(|block| {
            let records = block.records.chunks_exact(record_bytes);
            (block.first..).zip(records).try_for_each(|(vertex, record)| each(vertex, record))
        })
    }

    /// Reads and checks one block of vertices as they stand in the file.
    fn read_checked(&self, index: u64, block: &mut VertexBlock) -> Result<()> {
        self.read_unchecked(index, block)?;
        if self.options.skip_bad {
            self.bad_vertices.replace(block, &self.plan.schema);
            return Ok(());
        }
        match first_not_finite(&self.plan.schema, &block.records) {
            None => Ok(()),
            Some(i) => {
                let at = i * self.plan.schema.record_bytes();
                Err(not_finite(
                    self.file.path(),
                    block.first + i as u64,
                    self.place_of_vertex(index, i as u64),
                    self.plan.schema.position(&block.records[at..]),
                ))
            }
        }
    }

    /// Reads one block of vertices as they stand in the file.
    pub(super) fn read_unchecked(&self, index: u64, block: &mut VertexBlock) -> Result<()> {
        assert!(index < self.n_vertex_blocks(), "the block exists");
        block.first = index * BLOCK_ROWS;
        let n = BLOCK_ROWS.min(self.n_vertices() - block.first) as usize;
        let record_bytes = self.plan.schema.record_bytes();
        block.records.resize(n * record_bytes, 0);
        match &self.layout.vertices {
            VertexLayout::Fixed { offset, row_bytes } => {
                let offset = offset + block.first * row_bytes;
                if self.plan.is_identity() {
                    return self.file.read_exact_at(&mut block.records, offset);
                }
                block.scratch.resize(n * *row_bytes as usize, 0);
                self.file.read_exact_at(&mut block.scratch, offset)?;
                self.plan.convert(&block.scratch, *row_bytes as usize, &mut block.records);
                Ok(())
            }
            VertexLayout::Indexed(rows) => {
                let (mark, first) = rows.blocks[index as usize];
                let skip_bad = self.options.skip_bad;
                with_scan!(&self.file, self.header.encoding, mark, |scan| {
                    for (i, record) in block.records.chunks_exact_mut(record_bytes).enumerate() {
                        if let Err(fault) = vertex_row(&mut scan, &self.plan, skip_bad, record) {
                            let (row, at) = (first + i as u64, scan.last());
                            return Err(explain(&self.file, self.vertex(), row, at, fault));
                        }
                    }
                    Ok(())
                })
            }
        }
    }

    /// Byte offset of row `i` in a block of vertices.
    fn place_of_vertex(&self, block: u64, i: u64) -> Mark {
        match &self.layout.vertices {
            VertexLayout::Fixed { offset, row_bytes } => {
                let offset = offset + (block * BLOCK_ROWS + i) * row_bytes;
                Mark { offset, ..Mark::default() }
            }
            VertexLayout::Indexed(rows) => {
                let (mark, _) = rows.blocks[block as usize];
                with_scan!(&self.file, self.header.encoding, mark, |scan| {
                    // The row was read a moment ago; should it fail now, the block's place must do.
                    let properties = &self.vertex().properties;
                    let passed = (0..i)
                        .flat_map(|_| properties)
                        .chain(properties.first())
                        .try_for_each(|p| scan.skip_property(p));
                    if passed.is_ok() { scan.last() } else { mark }
                })
            }
        }
    }

    /// True if every vertex is found where its number says, without a pass over the file before.
    pub fn has_even_vertices(&self) -> bool {
        matches!(self.layout.vertices, VertexLayout::Fixed { .. })
    }

    /// Random access to positions as they stand in the file, before they are placed.
    pub fn positions(&self) -> Result<Lookup<'_>> {
        self.lookup()
    }

    /// Random access to positions, for the diagonals of quads.
    pub(super) fn lookup(&self) -> Result<Lookup<'_>> {
        match &self.layout.vertices {
            VertexLayout::Fixed { offset, row_bytes } => {
                let axes = self.plan.axes();
                let swap = self.header.encoding == Encoding::BinaryBigEndian;
                Ok(Lookup::new(&self.file, *offset, *row_bytes, move |row| {
                    axes.map(|(wire, at)| wire_value(wire, &row[at..], swap))
                }))
            }
            VertexLayout::Indexed(_) => {
                let _one_at_a_time =
                    self.positions_lock.lock().unwrap_or_else(PoisonError::into_inner);
                let file = match self.positions.get() {
                    Some(file) => file,
                    None => {
                        let spooled = self.spool_positions()?;
                        self.positions.get_or_init(|| spooled)
                    }
                };
                Ok(Lookup::new(file, 0, 24, |row| {
                    [0, 8, 16]
                        .map(|at| f64::from_le_bytes(row[at..at + 8].try_into().expect("8 bytes")))
                }))
            }
        }
    }

    /// Writes all positions to a nameless temporary file, 24 bytes each.
    fn spool_positions(&self) -> Result<RawFile> {
        let folder = self.options.temp_dir.clone().unwrap_or_else(std::env::temp_dir);
        let mut spool = Spool::new(&folder);
        let (mut block, mut bytes) = (VertexBlock::default(), Vec::new());
        for index in 0..self.n_vertex_blocks() {
            self.read_unchecked(index, &mut block)?;
            bytes.clear();
            for record in block.records.chunks_exact(self.plan.schema.record_bytes()) {
                for value in self.plan.schema.position(record) {
                    bytes.extend_from_slice(&value.to_le_bytes());
                }
            }
            spool.write(&bytes)?;
        }
        spool.finish(self.file.path())
    }

    /// Finds the vertices whose position is not finite.
    pub(super) fn find_bad_vertices(&self) -> Result<BadVertices> {
        let mut bad = BadVertices::default();
        let mut block = VertexBlock::default();
        for index in 0..self.n_vertex_blocks() {
            self.read_unchecked(index, &mut block)?;
            bad.collect(&block, &self.plan.schema);
        }
        Ok(bad)
    }
}

impl FieldPlan {
    /// Type and place in a binary row of fixed size of x, y and z.
    fn axes(&self) -> [(Wire, usize); 3] {
        let size = self.schema.coordinate.bytes();
        let mut axes = [(Wire::F16, 0); 3];
        for step in &self.steps {
            if let FieldStep::Take(field) = step
                && field.target < 3 * size
            {
                axes[field.target / size] = (field.wire, field.source);
            }
        }
        axes
    }
}
