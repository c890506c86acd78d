//! Cells of a block of vertices in few bits, for tables that do not fit as plain numbers.
//!
//! Vertices that follow each other in a file mostly lie near each other in space, so a stretch of them uses few
//! cells: it holds a list of those and an index of 0 to 8 bits a vertex, or plain numbers where that takes no more.
//! `synth statue` takes 4 bits a vertex in place of 16.

use stonecut_store::cell_id::CellId;

/// Rows of a stretch, a power of two.
pub const STRETCH: usize = 1024;

/// Bytes of the header for each stretch: where it begins in the block, and its form in the lowest 3 bits.
const ENTRY: usize = 4;
const FORM_BITS: u32 = 3;

/// Forms of a stretch. Below `PLAIN_16`: indices of 0, 1, 2, 4 or 8 bits, then the list of cells.
const PLAIN_16: u32 = 5;
const PLAIN_32: u32 = 6;

/// Bits of an index of a form.
const INDEX_BITS: [usize; 5] = [0, 1, 2, 4, 8];

/// A packer, whose memory is re-used from block to block.
#[derive(Default)]
pub struct Packer {
    /// Cells of the stretch, in the order in which they come.
    found: Vec<CellId>,
    indices: Vec<u8>,
}

impl Packer {
    /// Packs the cells of at most 65,536 vertices into `out`, which is cleared.
    pub fn pack(&mut self, cells: &[CellId], out: &mut Vec<u8>) {
        out.clear();
        out.resize(cells.len().div_ceil(STRETCH) * ENTRY, 0);
        for (stretch, cells) in cells.chunks(STRETCH).enumerate() {
            let at = out.len();
            let form = self.append(cells, out);
            let entry = ((at as u32) << FORM_BITS) | form;
            out[stretch * ENTRY..][..ENTRY].copy_from_slice(&entry.to_le_bytes());
        }
    }

    /// Appends a stretch; returns its form.
    fn append(&mut self, cells: &[CellId], out: &mut Vec<u8>) -> u32 {
        let is_narrow = cells.iter().all(|cell| cell.0 <= u32::from(u16::MAX));
        let plain_bytes = cells.len() * if is_narrow { 2 } else { 4 };
        if self.index(cells) {
            let n_found = self.found.len();
            let fits = |&form: &usize| n_found <= 1 << INDEX_BITS[form];
            let form = (0..INDEX_BITS.len()).find(fits).unwrap_or(INDEX_BITS.len() - 1);
            let bits = INDEX_BITS[form];
            let index_bytes = STRETCH * bits / 8;
            if index_bytes + 4 * n_found < plain_bytes {
                let at = out.len();
                out.resize(at + index_bytes, 0);
                if bits > 0 {
                    for (row, &index) in self.indices.iter().enumerate() {
                        out[at + row * bits / 8] |= index << (row * bits % 8);
                    }
                }
                out.extend(self.found.iter().flat_map(|cell| cell.0.to_le_bytes()));
                return form as u32;
            }
        }
        if is_narrow {
            out.extend(cells.iter().flat_map(|cell| (cell.0 as u16).to_le_bytes()));
            PLAIN_16
        } else {
            out.extend(cells.iter().flat_map(|cell| cell.0.to_le_bytes()));
            PLAIN_32
        }
    }

    /// Lists the cells of a stretch and the index of each row in that list; false if there are more than 256.
    fn index(&mut self, cells: &[CellId]) -> bool {
        self.found.clear();
        self.indices.clear();
        let mut last = 0;
        for &cell in cells {
            if self.found.get(last) != Some(&cell) {
                last = match self.found.iter().position(|&known| known == cell) {
                    Some(index) => index,
                    None if self.found.len() > usize::from(u8::MAX) => return false,
                    None => {
                        self.found.push(cell);
                        self.found.len() - 1
                    }
                };
            }
            self.indices.push(last as u8);
        }
        true
    }
}

/// The cell of a row of a packed block.
#[inline]
pub fn cell_of(block: &[u8], row: usize) -> CellId {
    let entry = u32_at(block, row / STRETCH * ENTRY);
    let (form, at) = (entry & ((1 << FORM_BITS) - 1), (entry >> FORM_BITS) as usize);
    let row = row % STRETCH;
    match form {
        0 => cell_at(block, at),
        PLAIN_16 => narrow_cell([block[at + 2 * row], block[at + 2 * row + 1]]),
        PLAIN_32 => cell_at(block, at + 4 * row),
        _ => {
            let bits = INDEX_BITS[form as usize];
            let byte = block[at + row * bits / 8] >> (row * bits % 8);
            let index = usize::from(byte) & ((1 << bits) - 1);
            cell_at(block, at + STRETCH * bits / 8 + 4 * index)
        }
    }
}

/// Writes the cells of stretch number `stretch` of a packed block, of `n_rows` rows, to the beginning of `out`.
pub fn unpack(block: &[u8], stretch: usize, n_rows: usize, out: &mut [CellId]) {
    let entry = u32_at(block, stretch * ENTRY);
    let (form, at) = (entry & ((1 << FORM_BITS) - 1), (entry >> FORM_BITS) as usize);
    let out = &mut out[..n_rows];
    match form {
        0 => out.fill(cell_at(block, at)),
        PLAIN_16 => {
            let cells = block[at..].chunks_exact(2).map(|bytes| narrow_cell([bytes[0], bytes[1]]));
            out.iter_mut().zip(cells).for_each(|(out, cell)| *out = cell);
        }
        PLAIN_32 => (0..n_rows).for_each(|row| out[row] = cell_at(block, at + 4 * row)),
        _ => {
            let bits = INDEX_BITS[form as usize];
            let found = at + STRETCH * bits / 8;
            let (per_byte, mask) = (8 / bits, (1usize << bits) - 1);
            for (cells, &byte) in out.chunks_mut(per_byte).zip(&block[at..found]) {
                let mut indices = usize::from(byte);
                for cell in cells {
                    *cell = cell_at(block, found + 4 * (indices & mask));
                    indices >>= bits;
                }
            }
        }
    }
}

fn cell_at(block: &[u8], at: usize) -> CellId {
    CellId(u32_at(block, at))
}

fn narrow_cell(bytes: [u8; 2]) -> CellId {
    CellId(u16::from_le_bytes(bytes).into())
}

fn u32_at(block: &[u8], at: usize) -> u32 {
    let bytes: [u8; 4] = block[at..at + 4].try_into().expect("four bytes");
    u32::from_le_bytes(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every form, with a last stretch that is cut short, gives back what went in.
    #[test]
    fn every_form_is_read_back() {
        let mut packer = Packer::default();
        let mut out = Vec::new();
        for n_cells in [1u32, 2, 3, 5, 17, 256, 257, 1000, 70_000] {
            let cells: Vec<u32> =
                (0..5_000u32).map(|i| i.wrapping_mul(2_654_435_761) % n_cells).collect();
            for far in [0, 1 << 20] {
                let cells: Vec<CellId> = cells.iter().map(|cell| CellId(cell + far)).collect();
                packer.pack(&cells, &mut out);
                for (row, &cell) in cells.iter().enumerate() {
                    assert_eq!(cell_of(&out, row), cell, "{n_cells} cells, row {row}");
                }
                for (stretch, expected) in cells.chunks(STRETCH).enumerate() {
                    let mut found = [CellId(u32::MAX); STRETCH];
                    unpack(&out, stretch, expected.len(), &mut found);
                    assert_eq!(&found[..expected.len()], expected, "{n_cells} cells");
                }
                assert!(out.len() <= cells.len().div_ceil(STRETCH) * ENTRY + 4 * cells.len());
            }
        }
    }

    /// Cells in runs take the bits that their number in a stretch needs.
    #[test]
    fn runs_of_cells_take_few_bits() {
        let mut out = Vec::new();
        let bits = |run: u32, out: &mut Vec<u8>| {
            let cells: Vec<CellId> = (0..65_536u32).map(|i| CellId(i / run)).collect();
            Packer::default().pack(&cells, out);
            out.len() as f64 * 8.0 / cells.len() as f64
        };
        assert!(bits(4096, &mut out) < 0.1);
        assert!(bits(700, &mut out) < 2.2);
        assert!(bits(1, &mut out) < 16.2);
    }
}
