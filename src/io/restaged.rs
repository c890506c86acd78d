//! A mesh written again as a staged PLY, with other vertices: faces keep their order and all they carry.

use super::open_options::StageOptions;
use crate::ply::header::Encoding;
use crate::ply::lookup::PagedRows;
use crate::ply::raw::{RawFile, Spool};
use crate::ply::source::Staged;
use crate::ply::{FaceSchema, Faults, MeshSource, OutputHeader, TextureInfo};
use std::ops::Range;
use std::path::Path;
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;

/// Bytes that are read at once.
const WINDOW: usize = 1 << 20;

/// Lengths of what rows of faces have besides their corners.
#[derive(Clone, Copy)]
pub(crate) struct RowLayout {
    pub has_texture: bool,
    pub value_bytes: usize,
}

impl RowLayout {
    pub fn of(faces: &FaceSchema) -> RowLayout {
        let value_bytes = faces.properties.iter().map(|p| p.scalar.bytes()).sum();
        RowLayout { has_texture: faces.texture, value_bytes }
    }

    /// Bytes of a row up to the ends of its corners, of its texture coordinates and of its properties.
    #[inline(always)]
    pub fn ends(self, n_corners: u8) -> [usize; 3] {
        let n = usize::from(n_corners);
        let corners = 1 + 4 * n;
        let texture = corners + if self.has_texture { 1 + 8 * n } else { 0 };
        [corners, texture, texture + self.value_bytes]
    }
}

/// A corner of a row.
#[inline(always)]
pub(crate) fn corner(row: &[u8], i: usize) -> u32 {
    u32::from_le_bytes(row[1 + 4 * i..5 + 4 * i].try_into().expect("4 bytes"))
}

/// Changes a corner of a row.
#[inline(always)]
pub(crate) fn set_corner(row: &mut [u8], i: usize, v: u32) {
    row[1 + 4 * i..5 + 4 * i].copy_from_slice(&v.to_le_bytes());
}

/// Calls `each` with the rows in a range of a file in turn.
pub(crate) fn each_row(
    file: &RawFile,
    range: Range<u64>,
    layout: RowLayout,
    each: impl FnMut(&mut [u8]) -> Result<()>,
) -> Result<()> {
    each_row_of_pieces(file, range, layout, each, |_| Ok(()))
}

/// The same, and `put` with all rows of a piece of the file after their turn.
pub(crate) fn each_row_of_pieces(
    file: &RawFile,
    range: Range<u64>,
    layout: RowLayout,
    mut each: impl FnMut(&mut [u8]) -> Result<()>,
    mut put: impl FnMut(&[u8]) -> Result<()>,
) -> Result<()> {
    let mut buffer = Vec::new();
    let Range { start: mut at, end } = range;
    while at < end || !buffer.is_empty() {
        let old = buffer.len();
        let n = (end - at).min(WINDOW as u64) as usize;
        buffer.resize(old + n, 0);
        file.read_exact_at(&mut buffer[old..], at)?;
        at += n as u64;
        let mut done = 0;
        while let Some(&n) = buffer.get(done) {
            let [_, _, n_bytes] = layout.ends(n);
            let Some(row) = buffer.get_mut(done..done + n_bytes) else { break };
            done += n_bytes;
            each(row)?;
        }
        assert!(done > 0 || at < end, "faces are whole rows");
        put(&buffer[..done])?;
        buffer.drain(..done);
    }
    Ok(())
}

/// Rows of faces as they stand in a staged file.
pub(crate) struct FaceRows {
    pub rows: RawFile,
    pub n_faces: u64,
    pub n_bad: u64,
}

/// Rows of one size, one behind the other.
#[derive(Clone, Copy)]
pub(crate) struct FewRows<'a> {
    pub bytes: &'a [u8],
    pub n: u64,
}

impl<'a> FewRows<'a> {
    pub fn row_bytes(self) -> usize {
        self.bytes.len() / self.n.max(1) as usize
    }

    pub fn each(self) -> std::slice::ChunksExact<'a, u8> {
        self.bytes.chunks_exact(self.row_bytes())
    }
}

/// New numbers of vertices, some pages of which are in memory.
pub(crate) struct Numbers<'a> {
    file: &'a RawFile,
    rows: PagedRows,
}

impl<'a> Numbers<'a> {
    /// Pages kept: 4 MiB in all.
    const PAGES: usize = 1024;

    pub fn new(file: &'a RawFile) -> Numbers<'a> {
        Numbers { file, rows: PagedRows::new(0, 4, Self::PAGES) }
    }

    #[inline]
    pub fn get(&mut self, v: u64) -> Result<u32> {
        let row = self.rows.get(self.file, v)?;
        Ok(u32::from_le_bytes(row.try_into().expect("4 bytes")))
    }
}

/// Tables of new numbers that have pages in memory at a time.
const MOST_THREADS: usize = 4;

/// Writes the faces as they are; `None` if one has too many corners for a row.
pub(crate) fn face_rows(source: &MeshSource, options: &StageOptions) -> Result<Option<FaceRows>> {
    face_rows_with(source, None, options, |_, rows, out| {
        out.write(rows.bytes)?;
        Ok(rows.n)
    })
}

/// Gives rows with their new corners to `put`, which has the first one's number in the source, and writes what becomes of them:
/// some rows. If some rows are not of one size, `put` has the first ones again, from number 0.
pub(crate) fn face_rows_with<'a>(
    source: &MeshSource,
    numbers: Option<&'a RawFile>,
    options: &StageOptions,
    mut put: impl FnMut(u64, FewRows, &mut Spool) -> Result<u64>,
) -> Result<Option<FaceRows>> {
    let has_texture = source.has_corner_texture();
    let mut out = options.spool();
    let (mut n_faces, mut n_bad, mut row) = (0u64, 0, Vec::new());
    let change = |row: &mut [u8], own: &mut Option<Numbers<'a>>| {
        let Some(file) = numbers else { return Ok(()) };
        let own = own.get_or_insert_with(|| Numbers::new(file));
        (0..3).try_for_each(|i| {
            set_corner(row, i, own.get(u64::from(corner(row, i)))?);
            Ok(())
        })
    };
    let threads = if numbers.is_some() { options.threads.get().min(MOST_THREADS) } else { 1 };
    let is_plain = source.each_plain_block(threads, change, |first, bytes, n| {
        n_faces += put(first, FewRows { bytes, n }, &mut out)?;
        Ok(())
    })?;
    if is_plain {
        return Ok(Some(FaceRows { rows: out.finish(source.path())?, n_faces, n_bad: 0 }));
    }
    let mut own = numbers.map(Numbers::new);
    let mut number = |v: u64| own.as_mut().map_or(Ok(v as u32), |own| own.get(v));
    let mut n_read = 0;
    (out, n_faces) = (options.spool(), 0);
    if source.has_strips() {
        source.each_face_block(|block| {
            n_bad += block.n_bad;
            for triangle in &block.triangles {
                row.clear();
                row.push(3);
                for &v in triangle {
                    row.extend_from_slice(&number(v)?.to_le_bytes());
                }
                n_faces += put(n_read, FewRows { bytes: &row, n: 1 }, &mut out)?;
                n_read += 1;
            }
            Ok(())
        })?;
    } else {
        let mut is_too_wide = false;
        n_bad = source.each_full_face(|place, face| {
            is_too_wide |= face.corners.len() > 127;
            if face.is_bad || is_too_wide {
                return Ok(());
            }
            row.clear();
            row.push(face.corners.len() as u8);
            for &v in &face.corners {
                row.extend_from_slice(&number(v)?.to_le_bytes());
            }
            if has_texture {
                row.push(2 * face.corners.len() as u8);
                for uv in &face.texture {
                    row.extend_from_slice(uv.map(f32::to_le_bytes).as_flattened());
                }
            }
            row.extend_from_slice(&face.values);
            n_faces += put(place, FewRows { bytes: &row, n: 1 }, &mut out)?;
            Ok(())
        })?;
        if is_too_wide {
            return Ok(None);
        }
    }
    Ok(Some(FaceRows { rows: out.finish(source.path())?, n_faces, n_bad }))
}

/// The mesh with these vertices and faces instead; `note` adds to what is known of it.
pub(crate) fn restage(
    source: MeshSource,
    schema: VertexSchema,
    (n_vertices, vertices): (u64, RawFile),
    faces: FaceRows,
    options: &StageOptions,
    note: impl FnOnce(&mut Staged),
) -> Result<MeshSource> {
    let path = source.path().to_path_buf();
    let header = OutputHeader {
        comments: source.comments().to_vec(),
        obj_infos: source.obj_infos().to_vec(),
        faces: FaceSchema {
            texture: source.has_corner_texture(),
            properties: source.face_properties(),
        },
        ..OutputHeader::new(schema, n_vertices, faces.n_faces)
    };
    let file = staged_file(&path, &header, vertices, faces.rows)?;
    let counts = source.faults();
    let texture = source.has_corner_texture().then(|| TextureInfo {
        files: source.texture().map_or_else(Vec::new, |texture| texture.files),
        property: "texcoord".to_owned(),
    });
    let mut staged = Staged {
        given_bytes: Some(source.given_bytes()),
        faults: Faults { bad_faces: counts.bad_faces + faces.n_bad, ..counts },
        texture,
        ..source.into_staged()
    };
    note(&mut staged);
    let mut read = options.read.clone();
    read.temp_dir = Some(options.temp_dir.clone());
    MeshSource::from_staged(file, read, staged)
}

/// A staged PLY of its header and rows that were written already.
pub(crate) fn staged_file(
    path: &Path,
    header: &OutputHeader,
    vertices: RawFile,
    faces: RawFile,
) -> Result<RawFile> {
    let index = header.index_type()?;
    let text = header.text_signed(Encoding::BinaryLittleEndian, index, None);
    let text = RawFile::from_bytes("", text.into_bytes());
    Ok(RawFile::chain(path, vec![text, vertices, faces]))
}
