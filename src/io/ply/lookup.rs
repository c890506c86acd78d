//! Positions of single vertices, for the diagonal of a quad.
//!
//! Reads small pages of a file whose rows have one size and keeps a few of them; on a mesh in any sane
//! order nearly every look-up hits a page at hand. Bodies without fixed rows are spooled to a nameless
//! temporary file first (24 bytes a vertex).

use super::raw::RawFile;
use stonecut_system::error::Result;

/// Pages kept: 1 MiB in all.
const PAGES: usize = 256;
const PAGE_BYTES: u64 = 4096;

/// Reads the position from the bytes of a row.
type Decode<'a> = Box<dyn Fn(&[u8]) -> [f64; 3] + 'a>;

/// Random access to positions: places of their rows, and how a row is read.
pub struct Lookup<'a> {
    file: &'a RawFile,
    rows: PagedRows,
    decode: Decode<'a>,
}

impl<'a> Lookup<'a> {
    /// Prepares to look vertices up.
    pub fn new(
        file: &'a RawFile,
        offset: u64,
        row_bytes: u64,
        decode: impl Fn(&[u8]) -> [f64; 3] + 'a,
    ) -> Self {
        Lookup { file, rows: PagedRows::new(offset, row_bytes, PAGES), decode: Box::new(decode) }
    }

    /// The position of a vertex that exists.
    pub fn position(&mut self, vertex: u64) -> Result<[f64; 3]> {
        Ok((self.decode)(self.rows.get(self.file, vertex)?))
    }
}

/// Rows of one size from `offset` of a file on, of which some pages are in memory: each has one place.
pub(crate) struct PagedRows {
    offset: u64,
    row_bytes: u64,
    /// Rows of a page, as a power of two.
    row_bits: u32,
    n_pages: usize,
    pages: Vec<(u64, Vec<u8>)>,
}

impl PagedRows {
    /// Keeps `n_pages`, a power of two.
    pub fn new(offset: u64, row_bytes: u64, n_pages: usize) -> PagedRows {
        let row_bits = (PAGE_BYTES / row_bytes).max(1).ilog2();
        PagedRows { offset, row_bytes, row_bits, n_pages, pages: Vec::new() }
    }

    /// A row that is there.
    #[inline]
    pub fn get(&mut self, file: &RawFile, row: u64) -> Result<&[u8]> {
        let page = row >> self.row_bits;
        let place = page as usize & (self.n_pages - 1);
        if self.pages.get(place).is_none_or(|(kept, _)| *kept != page) {
            self.load(file, page, place)?;
        }
        let at = ((row - (page << self.row_bits)) * self.row_bytes) as usize;
        let row = self.pages[place].1.get(at..at + self.row_bytes as usize);
        row.ok_or_else(|| file.bad("the file was shortened during the run"))
    }

    #[cold]
    fn load(&mut self, file: &RawFile, page: u64, place: usize) -> Result<()> {
        self.pages.resize_with(self.n_pages, || (u64::MAX, Vec::new()));
        let (kept, bytes) = &mut self.pages[place];
        // A page that failed to load must not be taken for a loaded one.
        *kept = u64::MAX;
        let page_bytes = self.row_bytes << self.row_bits;
        bytes.resize(page_bytes as usize, 0);
        let n = file.read_at_most(bytes, self.offset + page * page_bytes)?;
        bytes.truncate(n);
        *kept = page;
        Ok(())
    }
}
