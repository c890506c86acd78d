//! A synthetic scan in many files, as photogrammetry programs write it.
//!
//! Vertices go to a temporary file, a sample of them makes the boxes of the tiles (boxes.rs). Faces with their tiles are sorted on
//! disk; then one tile after the other is in memory (tile.rs). The folder appears when all of its files are there.

mod boxes;
mod tile;

use crate::rooms::{self, Rooms};
use crate::sliced::CountedSurface;
use crate::write::Stream;
use boxes::Boxes;
use std::path::{Path, PathBuf};
use stonecut_io::ply::lookup::Lookup;
use stonecut_io::ply::raw::{RawFile, Spool};
use stonecut_io::ply::{FaceSchema, OutputHeader, TexturedTriangle};
use stonecut_io::{ExternalSort, MeshSink, OutputFormat, OutputKind, halves};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::scatter::hash;
use stonecut_system::error::{Error, Result};
pub use tile::Rounding;
use tile::Tile;

/// The way a mesh is cut into files; every value is final.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Number of files.
    pub n_tiles: u64,
    /// Rounds coordinates, in each tile from another place.
    pub rounding: Option<Rounding>,
    /// Splits edges of borders in one of the two tiles.
    pub t_junctions: bool,
    /// Margin by which tiles reach into their neighbours, as a share of their sides.
    pub overlap: f64,
}

/// Sizes of all tiles together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileCounts {
    /// Files written.
    pub n_tiles: u64,
    /// Vertices in them; those of a border count in each.
    pub n_vertices: u64,
    /// Triangles in them.
    pub n_triangles: u64,
    /// Images beside them.
    pub n_images: u64,
    /// Edges that were split in one tile alone.
    pub n_split: u64,
}

/// Most tiles; their boxes and sample take some 100 MB then.
pub(super) const MOST_TILES: u64 = 100_000;

/// Triangles of a tile, on average, that are held in memory: some 200 bytes each.
const MOST_TRIANGLES: u64 = 4_000_000;

/// Vertices of the sample for each tile: boxes hold equally many to within some 6 %.
const SAMPLE: u64 = 256;
const LEAST_SAMPLE: u64 = 1 << 16;

/// Memory for sorting faces.
const SORT_BYTES: usize = 64 << 20;

/// Words of a face on its way: its tile, its number, its corners.
const PLAIN: usize = 6;
/// The same with the texture coordinates of the corners and the number of the image.
const TEXTURED: usize = PLAIN + 7;

/// A mesh to be cut; with `rooms`, which is the same surface, its textures too.
pub(super) struct WholeScan<'a> {
    pub(super) stream: Stream<'a>,
    pub(super) rooms: Option<&'a CountedSurface<Rooms>>,
    pub(super) header: OutputHeader,
}

/// A folder under a temporary name; removed unless it is complete.
struct Pending {
    folder: PathBuf,
    to: PathBuf,
}

impl Pending {
    fn create(to: &Path) -> Result<Pending> {
        let is_taken = to.symlink_metadata().is_ok();
        let is_empty = std::fs::read_dir(to).is_ok_and(|mut files| files.next().is_none());
        if is_taken && !is_empty {
            return Err(Error::Usage(format!(
                "{}: there is something of this name already; remove it, or give the folder of tiles another name",
                to.display()
            )));
        }
        let mut name = to.file_name().unwrap_or_default().to_os_string();
        name.push(format!(".{}.stonecut-part", std::process::id()));
        let folder = to.with_file_name(name);
        std::fs::create_dir(&folder).map_err(|e| Error::io(&folder, "cannot create", e))?;
        Ok(Pending { folder, to: to.to_path_buf() })
    }

    fn keep(mut self) -> Result<()> {
        std::fs::rename(&self.folder, &self.to)
            .map_err(|e| Error::io(&self.to, "cannot rename to", e))?;
        self.folder = PathBuf::new();
        Ok(())
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        if !self.folder.as_os_str().is_empty() {
            // A leftover only wastes space.
            drop(std::fs::remove_dir_all(&self.folder));
        }
    }
}

/// Writes the tiles of a mesh into a folder that is not there yet.
///
/// Memory: 64 MB to sort, a sample of the vertices, and one tile. Disk, for a while: the vertices, and 24 bytes a face, 52 with
/// texture. The bytes depend on the mesh, the cut and the format alone.
pub(super) fn write(
    to: &Path,
    whole: &WholeScan,
    cut: &Cut,
    format: OutputFormat,
) -> Result<TileCounts> {
    let n_faces = whole.stream.surface.n_faces();
    if n_faces / cut.n_tiles > MOST_TRIANGLES {
        return Err(Error::Usage(format!(
            "--tiles {}: a tile would have more than {MOST_TRIANGLES} triangles; ask for at least {}",
            cut.n_tiles,
            n_faces.div_ceil(MOST_TRIANGLES)
        )));
    }
    let pending = Pending::create(to)?;
    let counts = if whole.rooms.is_some() {
        Cutter::<TEXTURED>::new(&pending.folder, whole, cut, format)?.run()
    } else {
        Cutter::<PLAIN>::new(&pending.folder, whole, cut, format)?.run()
    }?;
    pending.keep()?;
    Ok(counts)
}

/// A mesh whose vertices are on disk, and the boxes of its tiles.
struct Cutter<'a, const N: usize> {
    folder: &'a Path,
    whole: &'a WholeScan<'a>,
    cut: &'a Cut,
    format: OutputFormat,
    kind: OutputKind,
    vertices: RawFile,
    boxes: Boxes,
    images: Vec<String>,
    counts: TileCounts,
}

impl<'a, const N: usize> Cutter<'a, N> {
    fn new(
        folder: &'a Path,
        whole: &'a WholeScan,
        cut: &'a Cut,
        format: OutputFormat,
    ) -> Result<Self> {
        let kind = format.kind.unwrap_or(OutputKind::Ply);
        let (vertices, boxes) = read_vertices(folder, whole, cut)?;
        let mut images = Vec::new();
        if let Some(rooms) = whole.rooms {
            // Named after the tiles, whatever their folder is called.
            let n_pages = rooms.surface().atlas.n_pages;
            images = rooms::file_names(Path::new("image.ply"), n_pages, format)?.0;
            let files: Vec<PathBuf> = images.iter().map(|name| folder.join(name)).collect();
            rooms::paint(rooms.surface(), &files, &whole.stream, false, &mut Vec::new())?;
        }
        let counts = TileCounts { n_images: images.len() as u64, ..TileCounts::default() };
        Ok(Cutter { folder, whole, cut, format, kind, vertices, boxes, images, counts })
    }

    fn run(mut self) -> Result<TileCounts> {
        let sort = self.sort_faces()?;
        let mut tile = Tile::default();
        sort.drain(|words| {
            if words[0] != tile.number {
                self.finish(&mut tile)?;
                tile.number = words[0];
            }
            let number = |n: usize| f32::from_bits(words[n]);
            let mut face = TexturedTriangle {
                corners: [words[3], words[4], words[5]].map(u64::from),
                ..TexturedTriangle::default()
            };
            if N == TEXTURED {
                face.texture = [6, 8, 10].map(|n| [number(n), number(n + 1)]);
                tile.pages.push(words[N - 1]);
            }
            tile.faces.push(face);
            Ok(())
        })?;
        self.finish(&mut tile)?;
        Ok(self.counts)
    }

    /// All faces, each once for every tile that it belongs to.
    fn sort_faces(&self) -> Result<ExternalSort<N>> {
        let schema = self.whole.stream.layout.schema();
        let row_bytes = schema.record_bytes();
        let mut sort = ExternalSort::<N>::new(self.folder, SORT_BYTES);
        let mut places =
            Lookup::new(&self.vertices, 0, row_bytes as u64, |record| schema.position(record));
        let (mut row, mut found) = (0, Vec::new());
        let mut put = |corners: [u32; 3], texture: &[u32]| -> Result<()> {
            let [a, b, c] = corners.map(|id| places.position(u64::from(id)));
            let (a, b, c) = (a?, b?, c?);
            let middle = [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0);
            self.boxes.all(middle, &mut found);
            let mut words = [0; N];
            words[1..3].copy_from_slice(&halves(row));
            words[3..6].copy_from_slice(&corners);
            words[6..].copy_from_slice(texture);
            for &tile in &found {
                words[0] = tile;
                sort.push(words)?;
            }
            row += 1;
            Ok(())
        };
        match self.whole.rooms {
            Some(rooms) => rooms::faces(rooms, &self.whole.stream, None, |encoded| {
                encoded.chunks_exact(4 * (N - 3)).try_for_each(|face| {
                    let word = |n: usize| bytemuck::pod_read_unaligned(&face[4 * n..4 * n + 4]);
                    let texture: Vec<u32> = (3..N - 3).map(word).collect();
                    put([word(0), word(1), word(2)], &texture)
                })
            })?,
            None => self.whole.stream.faces(
                |_, face| face,
                |faces, _| faces.iter().try_for_each(|&face| put(face, &[])),
            )?,
        }
        Ok(sort)
    }

    /// Writes a tile that has triangles, and empties it.
    fn finish(&mut self, tile: &mut Tile) -> Result<()> {
        if tile.faces.is_empty() {
            return Ok(());
        }
        self.whole.stream.progress.check()?;
        let mut schema = self.whole.stream.layout.schema();
        tile.gather(&self.vertices, schema.record_bytes())?;
        if self.cut.t_junctions {
            self.counts.n_split += tile.split_border(&schema, &self.boxes);
        }
        if let Some(rounding) = self.cut.rounding {
            schema = tile.round(&schema, rounding);
        }
        let mut header = self.whole.header.clone();
        header.n_vertices = (tile.records.len() / schema.record_bytes()) as u64;
        header.n_faces = tile.faces.len() as u64;
        header.schema = schema;
        self.counts.n_tiles += 1;
        self.counts.n_vertices += header.n_vertices;
        self.counts.n_triangles += header.n_faces;
        let digits = self.boxes.n_boxes().to_string().len().max(3);
        let name = format!("tile_{:0digits$}", tile.number);
        let ending = self.kind.name().to_ascii_lowercase();
        let path = self.folder.join(format!("{name}.{ending}"));
        let is_textured = !self.images.is_empty();
        if is_textured {
            let library =
                (self.kind == OutputKind::Obj).then(|| self.folder.join(format!("{name}.mtl")));
            self.name_images(tile, &mut header, library);
        }
        let mut sink = MeshSink::create(path.as_path(), header, self.format)?;
        sink.write_vertices(&tile.records)?;
        if is_textured {
            sink.write_full_faces(&tile.faces, bytemuck::cast_slice(&tile.pages))?;
        } else {
            sink.write_faces(&tile.faces.iter().map(|face| face.corners).collect::<Vec<_>>())?;
        }
        sink.finish()?;
        tile.faces.clear();
        tile.pages.clear();
        Ok(())
    }

    /// Names the images that a tile uses, and gives its faces their numbers among these.
    fn name_images(&self, tile: &mut Tile, header: &mut OutputHeader, library: Option<PathBuf>) {
        let mut used = tile.pages.clone();
        used.sort_unstable();
        used.dedup();
        for page in &mut tile.pages {
            *page = used.partition_point(|other| other < page) as u32;
        }
        let pages: Vec<(u64, &str)> = used
            .iter()
            .map(|&page| (u64::from(page), self.images[page as usize].as_str()))
            .collect();
        let (properties, plan) = rooms::texture(&pages, library);
        header.faces = FaceSchema { texture: true, properties };
        header.textures = Some(plan);
    }
}

/// Puts all vertices on disk, and makes the boxes of the tiles.
fn read_vertices(folder: &Path, whole: &WholeScan, cut: &Cut) -> Result<(RawFile, Boxes)> {
    let schema = whole.stream.layout.schema();
    let n_vertices = whole.stream.surface.n_vertices();
    let stride = (n_vertices / (SAMPLE * cut.n_tiles).max(LEAST_SAMPLE)).max(1);
    let (mut spool, mut bounds) = (Spool::new(folder), Bounds::default());
    let (mut id, mut sample) = (0, Vec::new());
    whole.stream.vertices(|records| {
        for record in records.chunks_exact(schema.record_bytes()) {
            let position = schema.position(record);
            bounds.add(position);
            if hash(id).is_multiple_of(stride) {
                sample.push(position);
            }
            id += 1;
        }
        spool.write(records)
    })?;
    let boxes = Boxes::new(&mut sample, &bounds, cut.n_tiles, cut.overlap);
    Ok((spool.finish(folder)?, boxes))
}
