//! The disk formats of the job folder, defined here alone; docs/format.md draws them.
//!
//! All numbers are little-endian. A *pack* is a file header followed by chunks; each chunk belongs to one
//! cell and carries its own checksums, so that a pack can be re-indexed from its chunks after a crash. A
//! sealed pack ends with an index of its chunks.

use crate::cell_id::CellId;
use std::path::Path;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_system::error::{Error, Result};
use xxhash_rust::xxh3::xxh3_64;

/// First bytes of every pack: name, then version.
const PACK_MAGIC: [u8; 16] = *b"stonecut pack 02";

/// Bytes of a pack's file header.
pub const PACK_HEADER_BYTES: u64 = 16;

/// Bytes of a chunk header.
pub const CHUNK_HEADER_BYTES: u64 = 32;

/// Content of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ChunkKind {
    /// Rows of vertex id and vertex record.
    Vertices = 1,
    /// Rows of three vertex ids.
    Triangles = 2,
    /// Rows of one vertex id: vertices of this cell that other cells use too.
    SharedIds = 3,
    /// One simplified cell, see `cells::survivors`.
    Survivors = 4,
    /// Rows of a vertex id (8 bytes) and a cell (4 bytes) that uses it without owning it; a note of the
    /// partition to itself, under cell 0, or under the number of the part that takes it up.
    Foreign = 5,
    /// All chunks of a sealed pack, behind them; under cell 0.
    Index = 6,
    /// Findings of a cell on components, see `components::found`.
    Found = 7,
    /// Pieces of a cell that are left out: a bit for each, in the order of their least vertices.
    Verdict = 8,
    /// Places of sampled vertices, three numbers of 8 bytes each; under cell 0.
    Samples = 9,
    /// Rows of two vertex ids: a vertex of a cell before it was simplified, and the one that it became.
    Origins = 10,
}

impl ChunkKind {
    fn from_code(code: u32) -> Option<ChunkKind> {
        use ChunkKind::{
            Foreign, Found, Index, Origins, Samples, SharedIds, Survivors, Triangles, Verdict,
            Vertices,
        };
        let first = [Vertices, Triangles, SharedIds, Survivors, Foreign, Index, Found, Verdict];
        first.into_iter().chain([Samples, Origins]).find(|kind| *kind as u32 == code)
    }
}

/// Place of a chunk in its pack, and its expected content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// The cell it belongs to.
    pub cell: CellId,
    /// Kind of its content.
    pub kind: ChunkKind,
    /// Number of the file that it lies in, where several are read as one.
    pub file: u16,
    /// Byte offset of the payload in the pack.
    pub offset: u64,
    /// Payload bytes.
    pub bytes: u64,
    /// xxh3 of the payload.
    pub checksum: u64,
}

/// The file header of a pack.
pub fn pack_header() -> [u8; PACK_HEADER_BYTES as usize] {
    PACK_MAGIC
}

/// Checks the file header of a pack.
pub fn check_pack_header(path: &Path, header: &[u8]) -> Result<()> {
    if header == PACK_MAGIC {
        return Ok(());
    }
    Err(Error::corrupt(path, "does not begin as a pack of this version; run again with --restart"))
}

/// The number of 4 bytes at byte `i`.
#[inline]
pub fn u32_at(bytes: &[u8], i: usize) -> u32 {
    u32::from_le_bytes(bytes[i..i + 4].try_into().expect("4 bytes"))
}

/// The number of 8 bytes at byte `i`.
#[inline]
pub fn u64_at(bytes: &[u8], i: usize) -> u64 {
    u64::from_le_bytes(bytes[i..i + 8].try_into().expect("8 bytes"))
}

/// The header of a chunk whose payload follows it.
pub fn chunk_header(
    cell: CellId,
    kind: ChunkKind,
    payload: &[u8],
) -> [u8; CHUNK_HEADER_BYTES as usize] {
    let mut header = [0; CHUNK_HEADER_BYTES as usize];
    header[0..4].copy_from_slice(&cell.0.to_le_bytes());
    header[4..8].copy_from_slice(&(kind as u32).to_le_bytes());
    header[8..16].copy_from_slice(&(payload.len() as u64).to_le_bytes());
    header[16..24].copy_from_slice(&xxh3_64(payload).to_le_bytes());
    let sum = xxh3_64(&header[..24]);
    header[24..32].copy_from_slice(&sum.to_le_bytes());
    header
}

/// Reads a chunk header that lies at `at` in the pack; `None` if it is damaged.
pub fn parse_chunk_header(header: &[u8; CHUNK_HEADER_BYTES as usize], at: u64) -> Option<Chunk> {
    let (u32_at, u64_at) = (|i| u32_at(header, i), |i| u64_at(header, i));
    (u64_at(24) == xxh3_64(&header[..24])).then_some(())?;
    Some(Chunk {
        cell: CellId(u32_at(0)),
        kind: ChunkKind::from_code(u32_at(4))?,
        file: 0,
        offset: at + CHUNK_HEADER_BYTES,
        bytes: u64_at(8),
        checksum: u64_at(16),
    })
}

/// Bytes of an index's row, and of what follows the rows: the offset of the index's chunk header.
const INDEX_ROW_BYTES: usize = 32;
const INDEX_END_BYTES: usize = 8;

/// Bytes at the end of a sealed pack that tell where its index begins.
pub const PACK_END_BYTES: u64 = INDEX_END_BYTES as u64;

/// The payload of an index whose chunk header lies at `at`.
pub fn encode_index(chunks: &[Chunk], at: u64) -> Vec<u8> {
    let mut payload = Vec::with_capacity(chunks.len() * INDEX_ROW_BYTES + INDEX_END_BYTES);
    for chunk in chunks {
        payload.extend_from_slice(&chunk.cell.0.to_le_bytes());
        payload.extend_from_slice(&(chunk.kind as u32).to_le_bytes());
        for number in [chunk.offset, chunk.bytes, chunk.checksum] {
            payload.extend_from_slice(&number.to_le_bytes());
        }
    }
    payload.extend_from_slice(&at.to_le_bytes());
    payload
}

/// The chunks of an index; `None` if one of them does not lie before `end`, where the index begins.
pub fn decode_index(payload: &[u8], end: u64) -> Option<Vec<Chunk>> {
    let rows = payload.get(..payload.len().checked_sub(INDEX_END_BYTES)?)?;
    if rows.len() % INDEX_ROW_BYTES != 0 {
        return None;
    }
    let chunk_at = |row: &[u8]| {
        let (u32_at, u64_at) = (|i| u32_at(row, i), |i| u64_at(row, i));
        let (offset, bytes) = (u64_at(8), u64_at(16));
        offset.checked_add(bytes).filter(|&chunk_end| chunk_end <= end)?;
        let kind = ChunkKind::from_code(u32_at(4))?;
        Some(Chunk { cell: CellId(u32_at(0)), kind, file: 0, offset, bytes, checksum: u64_at(24) })
    };
    rows.chunks_exact(INDEX_ROW_BYTES).map(chunk_at).collect()
}

/// Width of a vertex id on disk: 4 bytes while all ids fit, else 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IdWidth {
    /// 4 or 8.
    pub bytes: usize,
}

thread_local! {
    /// Gives every input of this thread ids as wide as one of more vertices than a test can hold. For tests alone.
    #[doc(hidden)]
    pub static ALWAYS_WIDE: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

impl IdWidth {
    /// The width that holds ids below `n_vertices`.
    pub fn for_vertices(n_vertices: u64) -> IdWidth {
        if ALWAYS_WIDE.get() {
            return IdWidth { bytes: 8 };
        }
        IdWidth { bytes: if n_vertices <= u64::from(u32::MAX) { 4 } else { 8 } }
    }

    /// Appends an id.
    #[inline]
    pub fn push(self, id: GlobalVertex, out: &mut Vec<u8>) {
        out.extend_from_slice(&id.0.to_le_bytes()[..self.bytes]);
    }

    /// Reads the id at the start of `row`.
    #[inline]
    pub fn read(self, row: &[u8]) -> GlobalVertex {
        GlobalVertex(match self.bytes {
            4 => u32_at(row, 0).into(),
            _ => u64_at(row, 0),
        })
    }
}
