//! The frame of the file: a head, then blocks, each with checksums, coarse to fine.
//!
//! docs/format.md describes every byte.

use super::columns::MOST_BYTES;
use super::rows::Rows;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use stonecut_io::ply::raw::RawFile;
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::PendingFile;
use xxhash_rust::xxh3::xxh3_64;

use stonecut_system::first_bytes::PROGRESSIVE_MAGIC as MAGIC;
/// Raised with every change that old readers would misread.
const FORMAT_VERSION: u32 = 1;
const BLOCK_MAGIC: &[u8; 4] = b"pmbl";
const BLOCK_HEAD: usize = 48;
/// Bytes of the longest head that is read.
const MOST_HEAD: usize = 16 << 20;

/// Description of a progressive mesh, as JSON at the beginning of its file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// Program that wrote the file.
    pub program: String,
    /// Bits of a coordinate; `None`: every value bit by bit, and vertices and triangles in the order of direct runs.
    pub bits: Option<u32>,
    /// Layout of values.
    pub(super) rows: Rows,
    /// Comments of the original.
    pub comments: Vec<String>,
    /// The original's `obj_info`.
    pub obj_infos: Vec<String>,
    /// Settings of the run, by name.
    pub settings: BTreeMap<String, String>,
    /// Triangles of the coarsest mesh.
    pub base_triangles: u64,
    /// Vertices of the coarsest mesh.
    pub base_vertices: u64,
    /// Triangles of the finest mesh.
    pub finest_triangles: u64,
    /// Steps from one to the other.
    pub steps: u64,
}

/// Contents of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Vertices = 1,
    Triangles = 2,
    Steps = 3,
    End = 4,
}

/// The head of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockHead {
    pub(super) kind: Kind,
    /// Vertices, triangles or steps in it.
    pub(super) n: u32,
    payload: u32,
    /// Triangles of the mesh behind it.
    pub(super) triangles: u64,
    /// Fewest triangles of any mesh that begins in it or later.
    pub(super) least: u64,
    checksum: u64,
}

/// Writes the beginning of a file.
pub(super) fn write_head(file: &mut PendingFile, head: &Head) -> Result<()> {
    let text = serde_json::to_vec(head).map_err(|e| Error::Internal(e.to_string()))?;
    file.write(MAGIC)?;
    file.write(&FORMAT_VERSION.to_le_bytes())?;
    file.write(&(text.len() as u32).to_le_bytes())?;
    file.write(&text)?;
    file.write(&xxh3_64(&text).to_le_bytes())
}

/// Writes a block.
pub(super) fn write_block(
    file: &mut PendingFile,
    kind: Kind,
    n: usize,
    (triangles, least): (u64, u64),
    payload: &[u8],
) -> Result<()> {
    let mut head = Vec::with_capacity(BLOCK_HEAD);
    head.extend_from_slice(BLOCK_MAGIC);
    for x in [kind as u32, n as u32, payload.len() as u32] {
        head.extend(x.to_le_bytes());
    }
    for x in [triangles, least, xxh3_64(payload)] {
        head.extend(x.to_le_bytes());
    }
    head.extend(xxh3_64(&head).to_le_bytes());
    file.write(&head)?;
    file.write(payload)
}

/// A file that is read from its beginning, block by block.
pub(super) struct BlockReader {
    file: RawFile,
    /// Beginning of the next block, and its number.
    offset: u64,
    pub(super) number: u64,
}

impl BlockReader {
    /// Opens a file and reads its head.
    pub(super) fn open(path: &Path) -> Result<(BlockReader, Head)> {
        BlockReader::of(RawFile::open(path)?)
    }

    pub(super) fn of(file: RawFile) -> Result<(BlockReader, Head)> {
        let mut first = [0; 16];
        if file.read_at_most(&mut first, 0)? < first.len() || &first[..8] != MAGIC {
            let what = "is not a progressive mesh of stonecut: the first 8 bytes are not 'stncutpm'; \
                        'simplify --progressive FILE' makes one";
            return Err(file.bad(what));
        }
        let [version, length] =
            [8, 12].map(|at| u32::from_le_bytes([0, 1, 2, 3].map(|i| first[at + i])));
        if version != FORMAT_VERSION {
            return Err(file.bad(format!(
                "byte offset 8: format version {version}, this program reads {FORMAT_VERSION}; make the file again with \
                 this program"
            )));
        }
        let length = length as usize;
        let damaged = |file: &RawFile, what: &str| {
            file.bad(format!("byte offset 16: the head {what}; make the file again"))
        };
        if length > MOST_HEAD || 24 + length as u64 > file.len() {
            return Err(damaged(&file, "does not fit into the file"));
        }
        let mut text = vec![0; length + 8];
        file.read_exact_at(&mut text, 16)?;
        let sum = text.split_off(length);
        if xxh3_64(&text).to_le_bytes() != sum[..] {
            return Err(damaged(&file, "is damaged: its checksum does not fit"));
        }
        let head: Head = serde_json::from_slice(&text)
            .map_err(|e| damaged(&file, &format!("makes no sense: {e}")))?;
        if let Some(fault) = head.rows.fault(head.bits.is_some()) {
            return Err(damaged(&file, fault));
        }
        Ok((BlockReader { file, offset: 24 + length as u64, number: 0 }, head))
    }

    /// An error in the block that was read last, or is read next.
    pub(super) fn bad(&self, at: u64, what: &str, remedy: &str) -> Error {
        self.file.bad(format!("block {}, byte offset {at}: {what}; {remedy}", self.number))
    }

    /// Place of the next block.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// Reads the head of the next block.
    pub(super) fn head(&self, remedy: &str) -> Result<BlockHead> {
        let mut bytes = [0; BLOCK_HEAD];
        if self.file.read_at_most(&mut bytes, self.offset)? < BLOCK_HEAD {
            return Err(self.bad(self.offset, "the file ends here, before its last block", remedy));
        }
        let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| bytes[at + i]));
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        if &bytes[..4] != BLOCK_MAGIC || xxh3_64(&bytes[..40]) != long(40) {
            return Err(self.bad(self.offset, "the head of the block is damaged", remedy));
        }
        let kind = match word(4) {
            1 => Kind::Vertices,
            2 => Kind::Triangles,
            3 => Kind::Steps,
            4 => Kind::End,
            other => {
                let what = format!("a block of the unknown kind {other}");
                return Err(self.bad(self.offset, &what, remedy));
            }
        };
        let (n, payload) = (word(8), word(12));
        let (triangles, least, checksum) = (long(16), long(24), long(32));
        Ok(BlockHead { kind, n, payload, triangles, least, checksum })
    }

    /// Reads what the block with this head holds, and goes on to the next.
    pub(super) fn payload(&mut self, head: &BlockHead, remedy: &str) -> Result<Vec<u8>> {
        let (at, length) = (self.offset + BLOCK_HEAD as u64, u64::from(head.payload));
        if at + length > self.file.len() {
            let what = format!(
                "the file ends at {} within the block, which has {length} bytes more",
                self.file.len()
            );
            return Err(self.bad(self.offset, &what, remedy));
        }
        if length > 16 * MOST_BYTES as u64 {
            return Err(self.bad(self.offset, "no block is that long", remedy));
        }
        let mut bytes = vec![0; length as usize];
        self.file.read_exact_at(&mut bytes, at)?;
        if xxh3_64(&bytes) != head.checksum {
            return Err(self.bad(
                self.offset,
                "the block is damaged: its checksum does not fit",
                remedy,
            ));
        }
        self.offset = at + length;
        Ok(bytes)
    }
}
