//! A PLY file that this program wrote, with other values of its vertices. Header and faces stay byte for byte.

use super::header::Header;
use super::raw::RawFile;
use super::writer::put_vertex;
use super::{Encoding, MeshSource, Place};
use stonecut_system::error::Result;
use stonecut_system::pending_file::PendingFile;

/// Bytes that are copied at a time.
const PIECE: usize = 1 << 20;

/// Writes the file of `source` to `place`; `change` gets the number of the first vertex of each block, and its records.
///
/// The file has its vertices first, a line each where it is text, and no lists among their properties, as `PlyWriter` writes them.
pub fn rewrite_vertices(
    source: &MeshSource,
    place: Place,
    mut change: impl FnMut(u64, &mut [u8]) -> Result<()>,
) -> Result<()> {
    let (schema, encoding) = (source.schema(), source.encoding());
    let file = RawFile::open(source.path())?;
    let begin = Header::read(&file)?.body_offset;
    let vertex_bytes = match encoding {
        Encoding::Ascii => lines_bytes(&file, begin, source.n_vertices())?,
        _ => source.n_vertices() * schema.record_bytes() as u64,
    };
    let mut out = PendingFile::create(place)?;
    file.each_piece(0..begin, PIECE, |bytes| out.write(bytes))?;
    let (mut records, mut rows) = (Vec::new(), Vec::new());
    source.each_vertex_block(|block| {
        records.clone_from(&block.records);
        change(block.first, &mut records)?;
        rows.clear();
        for record in records.chunks_exact(schema.record_bytes()) {
            put_vertex(schema, schema.coordinate, encoding, record, &mut rows);
        }
        out.write(&rows)
    })?;
    file.each_piece(begin + vertex_bytes..file.len(), PIECE, |bytes| out.write(bytes))?;
    out.finish().map(drop)
}

/// Length of `n` lines from an offset on.
fn lines_bytes(file: &RawFile, begin: u64, n: u64) -> Result<u64> {
    let (mut left, mut length) = (n, 0);
    file.each_piece(begin..file.len(), PIECE, |bytes| {
        let ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n');
        for (at, _) in ends {
            if left > 0 {
                left -= 1;
                if left == 0 {
                    length += at as u64 + 1;
                }
            }
        }
        length += if left > 0 { bytes.len() as u64 } else { 0 };
        Ok(())
    })?;
    Ok(length)
}
