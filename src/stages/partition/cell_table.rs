//! The cell of every vertex: the one table of partitioning that grows with the input.
//!
//! It is a list of plain numbers where that fits its share of the budget. Else blocks of vertices are packed. If those
//! do not fit either, they lie in a mapped file where faces use vertices that are near each other in the
//! input, and otherwise the table ends before the last vertex: a window, and each window takes a pass over the faces. One of
//! many processes, which sees a part of the faces, finds pages of it when they are needed (`pages`).

use super::packed_cells::{STRETCH, cell_of, unpack};
use super::pages::{Page, Pages};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stonecut_io::ply::BLOCK_ROWS;
use stonecut_store::cell_id::CellId;
use stonecut_system::error::{Error, Result};
use stonecut_system::mapped_file::{MappedFile, MappedWriter};

/// Memory of a packed block beside its bytes.
const BLOCK_OVERHEAD: u64 = 32;

/// Stretches that a reader keeps unpacked, 4 KiB each; a power of two.
const SLOTS: usize = 16;

/// Pages that a reader has in hand, 256 KiB each; a power of two.
const PAGES: usize = 8;

/// The cell of every vertex of a window of ids.
pub struct CellTable<'a> {
    /// Id of the first vertex of the window.
    pub first: u64,
    n_rows: u64,
    room: Room,
    cells: Cells<'a>,
}

/// Room for a table.
#[derive(Clone, Debug)]
pub struct Room {
    /// Bytes of memory for blocks or plain numbers.
    pub bytes: u64,
    /// Folder of a file for blocks that exceed them; without one the table ends there.
    pub folder: Option<PathBuf>,
    /// True if faces use vertices near each other in the input.
    pub is_near: bool,
}

/// Plain numbers, of 2 bytes while there are at most 65,536 cells, or packed blocks of `BLOCK_ROWS` vertices.
enum Cells<'a> {
    Narrow(Vec<u16>),
    Wide(Vec<CellId>),
    Packed {
        blocks: Vec<Box<[u8]>>,
        bytes: u64,
        is_full: bool,
    },
    /// Blocks on their way to a file, and where each begins.
    Filed {
        writer: MappedWriter,
        starts: Vec<u64>,
    },
    Mapped {
        file: MappedFile,
        starts: Vec<u64>,
    },
    /// Blocks that are found when they are needed.
    Paged(Pages<'a>),
}

impl<'a> CellTable<'a> {
    /// Bytes of a plain number: 2 or 4.
    pub fn bytes_per_vertex(n_cells: u32) -> u64 {
        if n_cells <= 1 << 16 { 2 } else { 4 }
    }

    /// An empty table for at most `n_rows` vertices from `first` on, the beginning of a block.
    pub fn new(first: u64, n_rows: u64, n_cells: u32, room: Room) -> CellTable<'a> {
        let n = n_rows as usize;
        let per_vertex = Self::bytes_per_vertex(n_cells);
        let cells = match per_vertex {
            _ if n_rows * per_vertex > room.bytes => {
                Cells::Packed { blocks: Vec::new(), bytes: 0, is_full: false }
            }
            2 => Cells::Narrow(Vec::with_capacity(n)),
            _ => Cells::Wide(Vec::with_capacity(n)),
        };
        CellTable { first, n_rows: 0, room, cells }
    }

    /// A table of all `n_rows` vertices whose blocks are found when they are needed.
    pub fn paged(n_rows: u64, pages: Pages<'a>) -> CellTable<'a> {
        let room = Room { bytes: 0, folder: None, is_near: true };
        CellTable { first: 0, n_rows, room, cells: Cells::Paged(pages) }
    }

    /// Returns whether `extend` takes packed blocks.
    pub fn is_packed(&self) -> bool {
        !matches!(self.cells, Cells::Narrow(_) | Cells::Wide(_) | Cells::Paged(_))
    }

    /// Returns whether further vertices belong to the next window.
    pub fn is_full(&self) -> bool {
        matches!(self.cells, Cells::Packed { is_full: true, .. })
    }

    /// Vertices in the window so far.
    pub fn len(&self) -> u64 {
        self.n_rows
    }

    /// Bytes of memory that the table takes, without the pages of a file.
    pub fn bytes(&self) -> u64 {
        match &self.cells {
            Cells::Narrow(table) => 2 * table.len() as u64,
            Cells::Wide(table) => 4 * table.len() as u64,
            Cells::Packed { bytes, .. } => *bytes,
            Cells::Filed { starts, .. } | Cells::Mapped { starts, .. } => 8 * starts.len() as u64,
            Cells::Paged(pages) => pages.most_bytes(),
        }
    }

    /// Appends the cells of the next block of vertices, given as `packed` too if the table is. A table that is full
    /// takes nothing; one of pages takes any `block`, the others the next one.
    pub fn extend(&mut self, block: u64, cells: &[CellId], packed: &[u8]) -> Result<()> {
        match &mut self.cells {
            Cells::Narrow(table) => table.extend(cells.iter().map(|cell| cell.0 as u16)),
            Cells::Wide(table) => table.extend_from_slice(cells),
            Cells::Packed { is_full: true, .. } => return Ok(()),
            Cells::Packed { blocks, bytes, is_full } => {
                let more = packed.len() as u64 + BLOCK_OVERHEAD;
                if *bytes + more <= self.room.bytes || blocks.is_empty() {
                    *bytes += more;
                    blocks.push(packed.into());
                } else if let Some(folder) = &self.room.folder {
                    let blocks = std::mem::take(blocks);
                    self.cells = filed(blocks, folder).map_err(|e| unwritten(folder, e))?;
                    return self.extend(block, cells, packed);
                } else {
                    *is_full = true;
                    return Ok(());
                }
            }
            Cells::Filed { writer, starts } => {
                let start = writer.append(packed);
                let folder = self.room.folder.as_deref().unwrap_or(Path::new(""));
                starts.push(start.map_err(|e| unwritten(folder, e))?);
            }
            Cells::Mapped { .. } => return Err(Error::Internal("a table was closed".to_owned())),
            Cells::Paged(pages) => {
                pages.keep(block, Arc::new(cells.to_vec()));
                return Ok(());
            }
        }
        self.n_rows += cells.len() as u64;
        Ok(())
    }

    /// Readies a table that takes no further vertices to be read.
    pub fn finish(mut self) -> Result<CellTable<'a>> {
        if let Cells::Filed { writer, mut starts } = self.cells {
            let folder = self.room.folder.as_deref().unwrap_or(Path::new(""));
            starts.push(writer.length());
            let resident = self.room.bytes.saturating_sub(8 * starts.len() as u64);
            let file = writer.finish(resident).map_err(|e| unwritten(folder, e))?;
            self.cells = Cells::Mapped { file, starts };
        }
        Ok(self)
    }

    /// Looks cells up, for one thread.
    pub fn reader(&self) -> CellReader<'_, 'a> {
        let is_near = self.is_packed() && self.room.is_near;
        let unpacked = vec![CellId(0); if is_near { SLOTS * STRETCH } else { 0 }];
        let (held, pages) = ([u64::MAX; SLOTS], Default::default());
        CellReader { table: self, is_near, held, unpacked, pages, failure: None }
    }

    /// A block, packed.
    fn block(&self, block: usize) -> &[u8] {
        match &self.cells {
            Cells::Packed { blocks, .. } => &blocks[block],
            Cells::Mapped { file, starts } => {
                let (start, end) = (starts[block], starts[block + 1]);
                file.at(start, (end - start) as usize)
            }
            Cells::Narrow(_) | Cells::Wide(_) | Cells::Filed { .. } | Cells::Paged(_) => &[],
        }
    }

    /// Gives memory of a mapped file back where it exceeds what was allowed. Call it between blocks of faces.
    pub fn trim(&self) {
        if let Cells::Mapped { file, .. } = &self.cells {
            file.trim();
        }
    }
}

/// Looks cells up. Where vertices of faces are near each other it keeps some stretches unpacked.
pub struct CellReader<'t, 'a> {
    table: &'t CellTable<'a>,
    is_near: bool,
    /// Number of the stretch in each slot.
    held: [u64; SLOTS],
    unpacked: Vec<CellId>,
    /// Pages in hand, each with the number of its block.
    pages: [Option<(u64, Page)>; PAGES],
    failure: Option<Error>,
}

impl CellReader<'_, '_> {
    /// The first failure to find a page; looked-up cells are `None` after it.
    pub fn finish(self) -> Result<()> {
        self.failure.map_or(Ok(()), Err)
    }

    #[inline]
    fn paged(&mut self, pages: &Pages, row: u64) -> Option<CellId> {
        let block = row / BLOCK_ROWS;
        let slot = (block.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - PAGES.ilog2())) as usize;
        if self.pages[slot].as_ref().is_none_or(|(held, _)| *held != block) {
            match pages.page(block) {
                Ok(page) => self.pages[slot] = Some((block, page)),
                Err(error) => {
                    self.failure.get_or_insert(error);
                    return None;
                }
            }
        }
        let (_, page) = self.pages[slot].as_ref()?;
        page.get((row % BLOCK_ROWS) as usize).copied()
    }

    /// The cell of a vertex; `None` outside the window.
    #[inline]
    pub fn get(&mut self, vertex: u64) -> Option<CellId> {
        let row = vertex.wrapping_sub(self.table.first);
        if row >= self.table.n_rows {
            return None;
        }
        Some(match &self.table.cells {
            Cells::Narrow(cells) => CellId(cells[row as usize].into()),
            Cells::Wide(cells) => cells[row as usize],
            Cells::Paged(pages) => return self.paged(pages, row),
            _ if self.is_near => self.unpacked(row),
            _ => {
                let block = self.table.block((row / BLOCK_ROWS) as usize);
                cell_of(block, (row % BLOCK_ROWS) as usize)
            }
        })
    }

    #[inline]
    fn unpacked(&mut self, row: u64) -> CellId {
        let stretch = row / STRETCH as u64;
        // Neighbours, and rows of a grid, fall into different slots.
        let slot = (stretch.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - SLOTS.ilog2())) as usize;
        if self.held[slot] != stretch {
            self.unpack(stretch, slot);
        }
        self.unpacked[slot * STRETCH + row as usize % STRETCH]
    }

    #[cold]
    fn unpack(&mut self, stretch: u64, slot: usize) {
        let first = stretch * STRETCH as u64;
        let n_rows = (self.table.n_rows - first).min(STRETCH as u64) as usize;
        let block = self.table.block((first / BLOCK_ROWS) as usize);
        let within = (first % BLOCK_ROWS) as usize / STRETCH;
        unpack(block, within, n_rows, &mut self.unpacked[slot * STRETCH..][..STRETCH]);
        self.held[slot] = stretch;
    }
}

/// Blocks in a file in `folder`.
fn filed(blocks: Vec<Box<[u8]>>, folder: &Path) -> std::io::Result<Cells<'static>> {
    let mut writer = MappedWriter::create(folder)?;
    let starts: std::io::Result<_> = blocks.iter().map(|block| writer.append(block)).collect();
    Ok(Cells::Filed { writer, starts: starts? })
}

fn unwritten(folder: &Path, error: std::io::Error) -> Error {
    Error::io(folder, "cannot write the table of cells", error)
}
