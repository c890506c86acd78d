//! Vertices that `--skip-bad` leaves out: known by id, so that faces which use them can be dropped.
//!
//! Ids of vertices cannot shift, so a bad vertex stays in its place with the position of the first good
//! one; no face uses it, and it vanishes as unreferenced. Costs 8 KiB for every block of 65,536 vertices
//! that has a bad one: at most a bit a vertex.

use super::fields::is_place;
use super::{BLOCK_ROWS, VertexBlock};
use std::collections::BTreeMap;
use stonecut_mesh::record::VertexSchema;

const WORDS: usize = (BLOCK_ROWS / 64) as usize;

/// The set of bad vertices.
#[derive(Debug, Default)]
pub struct BadVertices {
    blocks: BTreeMap<u64, Box<[u64; WORDS]>>,
    count: u64,
    /// The position bytes of the first good vertex; zeros stand in as long as there is none.
    stand_in: Option<Vec<u8>>,
}

impl BadVertices {
    /// Returns their number.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Returns whether a vertex is one of them.
    pub fn contains(&self, vertex: u64) -> bool {
        let within = (vertex % BLOCK_ROWS) as usize;
        self.blocks
            .get(&(vertex / BLOCK_ROWS))
            .is_some_and(|bits| bits[within / 64] >> (within % 64) & 1 == 1)
    }

    /// Notes the bad vertices of a block.
    pub fn collect(&mut self, block: &VertexBlock, schema: &VertexSchema) {
        for (i, record) in block.records.chunks_exact(schema.record_bytes()).enumerate() {
            if schema.position(record).into_iter().all(|x| is_place(schema.coordinate, x)) {
                if self.stand_in.is_none() {
                    self.stand_in = Some(record[..schema.position_bytes()].to_vec());
                }
                continue;
            }
            let bits =
                self.blocks.entry(block.first / BLOCK_ROWS).or_insert_with(|| Box::new([0; WORDS]));
            bits[i / 64] |= 1 << (i % 64);
            self.count += 1;
        }
    }

    /// Puts the stand-in's position into the bad vertices of a block.
    pub fn replace(&self, block: &mut VertexBlock, schema: &VertexSchema) {
        if !self.blocks.contains_key(&(block.first / BLOCK_ROWS)) {
            return;
        }
        let size = schema.position_bytes();
        for (i, record) in block.records.chunks_exact_mut(schema.record_bytes()).enumerate() {
            if self.contains(block.first + i as u64) {
                match &self.stand_in {
                    Some(position) => record[..size].copy_from_slice(position),
                    None => record[..size].fill(0),
                }
            }
        }
    }
}
