//! Vertices that faces use, and their numbers without the others: a bit and an eighth a vertex.

use crate::error::Result;
use crate::io::MeshSink;
use crate::io::ply::{BLOCK_ROWS, MeshSource, VertexBlock};

/// The vertices that the output has, and their new ids.
pub(super) struct Used {
    /// A bit a vertex.
    bits: Vec<u64>,
    /// Vertices used before each group of 512.
    before: Vec<u64>,
    pub(super) n_vertices: u64,
}

/// Words of 64 vertices in a group.
const GROUP_WORDS: usize = 8;

impl Used {
    /// No vertex.
    pub(super) fn none(n_vertices: u64) -> Self {
        let words = n_vertices.div_ceil(64) as usize;
        Used { bits: vec![0; words], before: Vec::new(), n_vertices }
    }

    /// All vertices.
    pub(super) fn all(n_vertices: u64) -> Self {
        let mut used = Self::none(n_vertices);
        used.bits.fill(u64::MAX);
        if let Some(last) = used.bits.last_mut().filter(|_| !n_vertices.is_multiple_of(64)) {
            *last = (1 << (n_vertices % 64)) - 1;
        }
        used
    }

    /// Notes that a vertex is used.
    pub(super) fn mark(&mut self, vertex: u64) {
        self.bits[(vertex / 64) as usize] |= 1 << (vertex % 64);
    }

    /// Numbers the used vertices, once all are marked; returns how many there are.
    pub(super) fn count(&mut self) -> u64 {
        let mut sum = 0;
        for group in self.bits.chunks(GROUP_WORDS) {
            self.before.push(sum);
            sum += group.iter().map(|word| u64::from(word.count_ones())).sum::<u64>();
        }
        sum
    }

    fn contains(&self, vertex: u64) -> bool {
        self.bits[(vertex / 64) as usize] >> (vertex % 64) & 1 == 1
    }

    /// The id that a used vertex has in the output.
    pub(super) fn new_id(&self, vertex: u64) -> u64 {
        let word = (vertex / 64) as usize;
        let group = word / GROUP_WORDS;
        let whole: u64 = self.bits[group * GROUP_WORDS..word]
            .iter()
            .map(|word| u64::from(word.count_ones()))
            .sum();
        let below = self.bits[word] & ((1u64 << (vertex % 64)) - 1);
        self.before[group] + whole + u64::from(below.count_ones())
    }

    /// Writes the records of used vertices, or of all; reads no block without one. `step` comes before each block.
    pub(super) fn write_vertices(
        &self,
        source: &MeshSource,
        all: bool,
        sink: &mut MeshSink,
        mut step: impl FnMut() -> Result<()>,
    ) -> Result<()> {
        let (mut block, mut kept) = (VertexBlock::default(), Vec::new());
        for i in 0..source.n_vertex_blocks() {
            step()?;
            let words = (i * BLOCK_ROWS / 64) as usize..;
            let mut words = self.bits[words].iter().take(BLOCK_ROWS.div_ceil(64) as usize);
            if !all && words.all(|word| *word == 0) {
                continue;
            }
            source.read_vertices(i, &mut block)?;
            if all {
                sink.write_vertices(&block.records)?;
                continue;
            }
            kept.clear();
            let records = block.records.chunks_exact(source.schema().record_bytes());
            for (vertex, record) in (block.first..).zip(records) {
                if self.contains(vertex) {
                    kept.extend_from_slice(record);
                }
            }
            sink.write_vertices(&kept)?;
        }
        Ok(())
    }
}
