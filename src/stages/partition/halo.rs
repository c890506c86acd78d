//! The vertices that cells use without owning them, in bounded memory: pairs of a vertex and a cell.
//!
//! A pass gathers pairs; what exceeds its memory goes as notes into the pack, which is also what checkpoints do.
//! Afterwards the pairs are one sorted list: in memory if they fit, else in a nameless file.

use std::path::Path;
use stonecut_io::ply::BLOCK_ROWS;
use stonecut_io::ply::raw::{RawFile, Spool};
use stonecut_io::{ExternalSort, halves, whole};
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{Pack, PackWriter};
use stonecut_store::pack_format::ChunkKind;
use stonecut_system::error::Result;

/// A vertex, and a cell that uses it without owning it.
pub(super) type Foreign = (GlobalVertex, CellId);

/// Bytes of a pair on disk and in memory, and the number of pairs in a chunk or read at a time.
const FOREIGN_BYTES: usize = 12;
const LISTED_BYTES: u64 = 16;
const FOREIGN_ROWS: usize = 65_536;

/// Pairs are sorted, and repeats among them dropped, when about this many have come. In shuffled input the same
/// pair comes again and again.
const SORT_ROWS: usize = 1_000_000;

/// Pairs as a pass finds them.
pub(super) struct Gathering<'a> {
    list: Vec<Foreign>,
    sorted_up_to: usize,
    most_rows: usize,
    /// The number under which the pairs of a vertex are noted.
    note_of: &'a dyn Fn(GlobalVertex) -> CellId,
}

/// All pairs are noted together.
pub(super) const TOGETHER: &dyn Fn(GlobalVertex) -> CellId = &|_| CellId(0);

impl<'a> Gathering<'a> {
    /// Keeps at most `memory_bytes` of pairs, or 1 MiB if that is more. `note_of` rises with the vertices.
    pub(super) fn new(memory_bytes: u64, note_of: &'a dyn Fn(GlobalVertex) -> CellId) -> Self {
        let most_rows = (memory_bytes / LISTED_BYTES).max(FOREIGN_ROWS as u64) as usize;
        Gathering { list: Vec::new(), sorted_up_to: 0, most_rows, note_of }
    }

    /// Takes all of `found`.
    pub(super) fn add(&mut self, found: &mut Vec<Foreign>, pack: &mut PackWriter) -> Result<()> {
        self.list.append(found);
        if self.list.len() > (2 * self.sorted_up_to + SORT_ROWS).min(self.most_rows) {
            self.tidy();
            if self.list.len() > self.most_rows / 2 {
                self.note(pack)?;
            }
        }
        Ok(())
    }

    fn tidy(&mut self) {
        self.list.sort_unstable();
        self.list.dedup();
        self.sorted_up_to = self.list.len();
    }

    /// Appends all pairs to the pack, as a note for the end of the pass or for the run that takes it up.
    pub(super) fn note(&mut self, pack: &mut PackWriter) -> Result<()> {
        self.tidy();
        for rows in self.list.chunk_by(|a, b| (self.note_of)(a.0) == (self.note_of)(b.0)) {
            note((self.note_of)(rows[0].0), rows.iter().copied().map(Ok), pack)?;
        }
        self.list.clear();
        self.sorted_up_to = 0;
        Ok(())
    }

    /// The pairs and what was noted under a number in the pack that `noted` reads, sorted, each once; `folder` takes a
    /// file.
    pub(super) fn finish(mut self, noted: Option<(&Pack, CellId)>, folder: &Path) -> Result<Halo> {
        let of_notes = |(reader, number)| {
            Pack::chunks_of(reader, number).iter().map(move |chunk| (reader, chunk))
        };
        let notes: Vec<_> = noted
            .into_iter()
            .flat_map(of_notes)
            .filter(|(_, chunk)| chunk.kind == ChunkKind::Foreign)
            .collect();
        let n_noted: u64 = notes.iter().map(|(_, chunk)| chunk.bytes / FOREIGN_BYTES as u64).sum();
        let mut payload = Vec::new();
        if n_noted + self.list.len() as u64 <= self.most_rows as u64 {
            for (reader, chunk) in notes {
                reader.read(chunk, &mut payload)?;
                self.list.extend(payload.chunks_exact(FOREIGN_BYTES).map(decode));
            }
            self.tidy();
            let mut blocks: Vec<u64> = self.list.iter().map(|row| row.0.0 / BLOCK_ROWS).collect();
            blocks.dedup();
            return Ok(Halo {
                n_rows: self.list.len() as u64,
                rows: Rows::List(self.list),
                blocks,
            });
        }
        let memory = self.most_rows * LISTED_BYTES as usize / 2;
        let mut sort = ExternalSort::<3>::new(folder, memory);
        for (id, cell) in std::mem::take(&mut self.list) {
            let [high, low] = halves(id.0);
            sort.push([high, low, cell.0])?;
        }
        for (reader, chunk) in notes {
            reader.read(chunk, &mut payload)?;
            for row in payload.chunks_exact(FOREIGN_BYTES) {
                let (id, cell) = decode(row);
                let [high, low] = halves(id.0);
                sort.push([high, low, cell.0])?;
            }
        }
        let mut spool = Spool::new(folder);
        let (mut last, mut n_rows, mut blocks) = (None, 0, Vec::new());
        sort.drain(|[high, low, cell]| {
            let row = (GlobalVertex(whole(high, low)), CellId(cell));
            if last.replace(row) != Some(row) {
                spool.write(&encode(row))?;
                n_rows += 1;
                let block = row.0.0 / BLOCK_ROWS;
                if blocks.last() != Some(&block) {
                    blocks.push(block);
                }
            }
            Ok(())
        })?;
        Ok(Halo { rows: Rows::File(spool.finish(folder)?), n_rows, blocks })
    }
}

/// Appends pairs to the pack, under a number.
fn note(
    number: CellId,
    rows: impl Iterator<Item = Result<Foreign>>,
    pack: &mut PackWriter,
) -> Result<()> {
    let mut payload = Vec::new();
    for row in rows {
        payload.extend_from_slice(&encode(row?));
        if payload.len() == FOREIGN_ROWS * FOREIGN_BYTES {
            pack.append(number, ChunkKind::Foreign, &payload)?;
            payload.clear();
        }
    }
    if payload.is_empty() { Ok(()) } else { pack.append(number, ChunkKind::Foreign, &payload) }
}

fn encode((id, cell): Foreign) -> [u8; FOREIGN_BYTES] {
    let mut out = [0; FOREIGN_BYTES];
    out[..8].copy_from_slice(&id.0.to_le_bytes());
    out[8..].copy_from_slice(&cell.0.to_le_bytes());
    out
}

fn decode(row: &[u8]) -> Foreign {
    let (id, cell) = row.split_at(8);
    let id = u64::from_le_bytes(id.try_into().expect("8 bytes"));
    (GlobalVertex(id), CellId(u32::from_le_bytes(cell.try_into().expect("4 bytes"))))
}

enum Rows {
    List(Vec<Foreign>),
    File(RawFile),
}

/// All pairs, sorted by vertex, then by cell.
pub(super) struct Halo {
    rows: Rows,
    n_rows: u64,
    /// The blocks of vertices that hold any of them, ascending.
    pub(super) blocks: Vec<u64>,
}

impl Halo {
    /// Pairs from vertex `first_id` on, one after the other.
    pub(super) fn from(&self, first: GlobalVertex) -> Result<Cursor<'_>> {
        let (mut low, mut high) = (0, self.n_rows);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.row(middle)?.0 < first { low = middle + 1 } else { high = middle }
        }
        Ok(Cursor { halo: self, at: low, buffer: Vec::new(), next: 0 })
    }

    fn row(&self, at: u64) -> Result<Foreign> {
        match &self.rows {
            Rows::List(list) => Ok(list[at as usize]),
            Rows::File(file) => {
                let mut bytes = [0; FOREIGN_BYTES];
                file.read_exact_at(&mut bytes, at * FOREIGN_BYTES as u64)?;
                Ok(decode(&bytes))
            }
        }
    }

    /// Appends all pairs to the pack, as a note for a run that takes up what follows.
    pub(super) fn note(&self, pack: &mut PackWriter) -> Result<()> {
        let mut cursor = self.from(GlobalVertex(0))?;
        note(CellId(0), std::iter::from_fn(|| cursor.take().transpose()), pack)
    }
}

/// A place in the sorted pairs.
pub(super) struct Cursor<'a> {
    halo: &'a Halo,
    /// Rows before it have been taken or lie in `buffer`.
    at: u64,
    buffer: Vec<Foreign>,
    next: usize,
}

impl Cursor<'_> {
    /// The next pair, which stays.
    pub(super) fn peek(&mut self) -> Result<Option<Foreign>> {
        if self.next == self.buffer.len() {
            let n = (self.halo.n_rows - self.at).min(FOREIGN_ROWS as u64) as usize;
            self.buffer.clear();
            self.next = 0;
            match &self.halo.rows {
                Rows::List(list) => {
                    self.buffer.extend_from_slice(&list[self.at as usize..self.at as usize + n]);
                }
                Rows::File(file) => {
                    let mut bytes = vec![0; n * FOREIGN_BYTES];
                    file.read_exact_at(&mut bytes, self.at * FOREIGN_BYTES as u64)?;
                    self.buffer.extend(bytes.chunks_exact(FOREIGN_BYTES).map(decode));
                }
            }
            self.at += n as u64;
        }
        Ok(self.buffer.get(self.next).copied())
    }

    /// The next pair.
    pub(super) fn take(&mut self) -> Result<Option<Foreign>> {
        let row = self.peek()?;
        self.next += usize::from(row.is_some());
        Ok(row)
    }
}
