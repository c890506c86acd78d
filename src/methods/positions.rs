//! Positions of the vertices of a source in any order, from blocks that are kept as long as the memory allows.
//!
//! Where all blocks fit, each is read once. Else the least recently used ones make room, which is cheap as long as the
//! faces lie in the file in an order like that of their vertices; `Positions::order` finds out before the work. The
//! memory changes the number of readings, never a value.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use stonecut_io::ply::{BLOCK_ROWS, FaceBlock, MeshSource, VertexBlock};
use stonecut_mesh::property::Scalar;
use stonecut_system::error::Result;

/// Pairs of consecutive blocks of faces that are sampled to see the order of the file.
const SAMPLED_PAIRS: u64 = 24;

/// Bytes of the positions of a block of vertices.
pub fn page_bytes(source: &MeshSource) -> u64 {
    source.schema().position_bytes() as u64 * BLOCK_ROWS.min(source.n_vertices().max(1))
}

/// Positions of the vertices of a source.
pub struct Positions<'a> {
    source: &'a MeshSource,
    position_bytes: usize,
    is_double: bool,
    most_pages: usize,
    most_held: usize,
    /// One lock a block, so that two threads that need the same one read it once.
    pages: Vec<Mutex<Option<Page>>>,
    /// Blocks that are in memory, the one that was asked for last at the end.
    recent: Mutex<Vec<usize>>,
}

/// The positions of a block of vertices.
type Page = Arc<Vec<u8>>;

/// Blocks that one thread has at hand.
#[derive(Default)]
pub struct Held {
    pages: Vec<Option<Page>>,
    n_held: usize,
    block: VertexBlock,
}

/// The order of the faces against that of the vertices, from samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileOrder {
    /// Blocks of vertices that one block of faces uses: the median.
    pub pages: u64,
    /// Readings of a block of vertices in a pass over the faces, relative to reading each once, where only those of the
    /// block of faces before are at hand.
    pub rereads: f64,
}

impl<'a> Positions<'a> {
    /// Keeps blocks of at most `memory_bytes`, those that `n_readers` have at hand included; at least four for each.
    pub fn new(source: &'a MeshSource, memory_bytes: u64, n_readers: usize) -> Self {
        let n_pages = source.n_vertex_blocks() as usize;
        let fit = (memory_bytes / page_bytes(source)) as usize;
        let (most_pages, most_held) = match fit >= n_pages {
            true => (n_pages, n_pages),
            false => (fit / 2, (fit / 2 / n_readers.max(1)).max(4)),
        };
        Positions {
            source,
            position_bytes: source.schema().position_bytes(),
            is_double: source.schema().coordinate == Scalar::F64,
            most_pages: most_pages.max(1),
            most_held,
            pages: (0..n_pages).map(|_| Mutex::default()).collect(),
            recent: Mutex::default(),
        }
    }

    /// Finds how the faces lie in the file, from a sample that is the same at any time.
    pub fn order(source: &MeshSource) -> Result<FileOrder> {
        let n_blocks = source.n_face_blocks();
        let pages_of = |index: u64| -> Result<BTreeSet<u64>> {
            let mut faces = FaceBlock::default();
            source.read_faces(index, &mut faces)?;
            Ok(faces.triangles.as_flattened().iter().map(|v| v / BLOCK_ROWS).collect())
        };
        let (mut n_pages, mut n_new) = (Vec::new(), 0);
        for i in 0..SAMPLED_PAIRS.min(n_blocks.saturating_sub(1)) {
            let index = i * (n_blocks - 1) / SAMPLED_PAIRS.min(n_blocks - 1);
            let (before, after) = (pages_of(index)?, pages_of(index + 1)?);
            n_pages.push(after.len() as u64);
            n_new += after.difference(&before).count() as u64;
        }
        n_pages.sort_unstable();
        let pages = n_pages.get(n_pages.len() / 2).copied().unwrap_or(1);
        let readings = n_new as f64 * n_blocks as f64 / n_pages.len().max(1) as f64;
        Ok(FileOrder { pages, rereads: readings / source.n_vertex_blocks().max(1) as f64 })
    }

    /// The position of a vertex, exactly.
    #[inline(always)]
    pub fn get(&self, held: &mut Held, vertex: u64) -> Result<[f64; 3]> {
        let page = (vertex / BLOCK_ROWS) as usize;
        if let Some(Some(bytes)) = held.pages.get(page) {
            return Ok(self.decode(bytes, vertex));
        }
        self.hold(held, page)?;
        match &held.pages[page] {
            Some(bytes) => Ok(self.decode(bytes, vertex)),
            None => unreachable!("it is held now"),
        }
    }

    #[inline(always)]
    fn decode(&self, bytes: &[u8], vertex: u64) -> [f64; 3] {
        let at = (vertex % BLOCK_ROWS) as usize * self.position_bytes;
        let row = &bytes[at..at + self.position_bytes];
        match self.is_double {
            true => {
                [0, 8, 16].map(|k| f64::from_le_bytes(row[k..k + 8].try_into().expect("8 bytes")))
            }
            false => [0, 4, 8]
                .map(|k| f64::from(f32::from_le_bytes(row[k..k + 4].try_into().expect("4 bytes")))),
        }
    }

    #[cold]
    fn hold(&self, held: &mut Held, page: usize) -> Result<()> {
        if held.pages.len() <= page || held.n_held >= self.most_held {
            held.pages.clear();
            held.pages.resize(self.source.n_vertex_blocks() as usize, None);
            held.n_held = 0;
        }
        held.pages[page] = Some(self.page(page, &mut held.block)?);
        held.n_held += 1;
        Ok(())
    }

    /// The positions of a block of vertices.
    fn page(&self, index: usize, block: &mut VertexBlock) -> Result<Page> {
        self.make_room_for(index);
        let mut place = self.pages[index].lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = &*place {
            return Ok(bytes.clone());
        }
        self.source.read_vertices(index as u64, block)?;
        let record_bytes = self.source.schema().record_bytes();
        let mut bytes =
            Vec::with_capacity(block.records.len() / record_bytes * self.position_bytes);
        for record in block.records.chunks_exact(record_bytes) {
            bytes.extend_from_slice(&record[..self.position_bytes]);
        }
        let bytes = Arc::new(bytes);
        *place = Some(bytes.clone());
        Ok(bytes)
    }

    /// Notes the use of a block; forgets those that were used longest ago if it is one too many.
    fn make_room_for(&self, index: usize) {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        match recent.iter().rposition(|&other| other == index) {
            Some(at) => recent[at..].rotate_left(1),
            None => recent.push(index),
        }
        while recent.len() > self.most_pages {
            let oldest = recent.remove(0);
            *self.pages[oldest].lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
    }
}
