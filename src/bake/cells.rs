//! Cells of an original: cut from the input, or finer tiles that have their pages. Loads them; looks nothing up in them.

use super::need::CELL_BYTES;
use std::path::PathBuf;
use std::sync::Arc;
use stonecut_io::materials::{CLAMPED, Image, ImageData, Map, MapKind, Material, Materials, Part};
use stonecut_io::ply::raw::RawFile;
use stonecut_io::{NUMBER, StoredTile, decode_tile};
use stonecut_measure::temp_store::Scratch;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::property::{Origin, Scalar, read_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_render::texture::{Palette, Purpose, WantedMaps};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellMesh, load_bytes};
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::guarded;

/// No material.
const NONE: u32 = u32::MAX;

/// The cells of an original.
pub(super) enum OriginalCells {
    /// Cut from the input.
    Cut(Box<Scratch>, Numbers),
    /// Tiles, each with a material of its number.
    Tiles(Vec<PagedTile>),
}

/// Numbers of materials.
#[derive(Clone, Copy)]
pub(super) enum Numbers {
    /// The same for all.
    Same(u32),
    /// At a byte of vertex records.
    At(Scalar, usize),
}

impl Numbers {
    pub fn of(value: f64) -> u32 {
        if (0.0..f64::from(NONE)).contains(&value) { value as u32 } else { NONE }
    }

    /// Place of the number of the material in records.
    pub fn find(schema: &VertexSchema) -> Numbers {
        let mut at = schema.position_bytes();
        for property in &schema.properties {
            if property.name == NUMBER && property.origin == Origin::FaceLabel {
                return Numbers::At(property.scalar, at);
            }
            at += property.scalar.bytes();
        }
        Numbers::Same(0)
    }
}

impl OriginalCells {
    /// Bytes of a cell in memory, without a tree, and its triangles and vertices.
    pub fn size(&self, cell: usize) -> (u64, [u64; 2]) {
        match self {
            OriginalCells::Cut(scratch, _) => {
                let tally = scratch.store().info().cells[cell];
                let bytes = load_bytes(tally, scratch.store().layout());
                (bytes, [tally.triangles, tally.vertices])
            }
            OriginalCells::Tiles(tiles) => {
                let n = tiles[cell].n_triangles;
                (CELL_BYTES * n, [n, n])
            }
        }
    }

    /// Has a cell read ahead.
    pub fn expect(&self, cell: usize) {
        if let OriginalCells::Cut(scratch, _) = self {
            scratch.store().expect(CellId::at(cell));
        }
    }

    /// A cell without its records, and the materials of its triangles.
    pub fn load(&self, cell: usize) -> Result<(CellMesh, Vec<u32>)> {
        let (scratch, numbers) = match self {
            OriginalCells::Cut(scratch, numbers) => (scratch, numbers),
            OriginalCells::Tiles(tiles) => {
                let mesh = tiles[cell].load()?;
                let material = vec![cell as u32; mesh.triangles.len()];
                return Ok((CellMesh { mesh, ..CellMesh::default() }, material));
            }
        };
        let store = scratch.store();
        let mut loaded = store.load(CellId::at(cell))?;
        let record_bytes = store.layout().schema.record_bytes();
        let number = |t: &[u32; 3]| match *numbers {
            Numbers::Same(number) => number,
            Numbers::At(scalar, at) => {
                Numbers::of(read_scalar(scalar, &loaded.records, t[0] as usize * record_bytes + at))
            }
        };
        let material = loaded.mesh.triangles.iter().map(number).collect();
        loaded.records = Vec::new();
        Ok((loaded, material))
    }
}

/// A tile that has its page, as its file holds them.
#[derive(Clone, Debug)]
pub struct PagedTile {
    /// Its file, which ends with the image.
    pub path: PathBuf,
    /// Bytes of the file, and of the image in it.
    pub bytes: [u64; 2],
    /// Triangles.
    pub n_triangles: u64,
    /// Box of its triangles.
    pub bounds: Bounds,
    /// Origin of the lattice.
    pub origin: [f64; 3],
}

impl PagedTile {
    /// Its surface, with its texture coordinates as channels.
    fn load(&self) -> Result<Mesh> {
        let bytes =
            std::fs::read(&self.path).map_err(|e| Error::reading(&self.path, "cannot read", e))?;
        let tile = guarded(|| Ok(decode_tile(&bytes)))?;
        let tile = tile.map_err(|what| Error::corrupt(&self.path, what))?;
        let channels = tile.mesh.coordinates.iter().map(|at| at.map(|x| f32::from(x) / 65_535.0));
        let channels: Vec<f32> = channels.flat_map(|[x, y]| [x, 1.0 - y]).collect();
        let mesh = Mesh { channels, n_channels: 2, ..surface(&tile, self.origin) };
        if mesh.channels.len() != 2 * mesh.positions.len() {
            return Err(Error::corrupt(&self.path, "it has no texture coordinates"));
        }
        Ok(mesh)
    }
}

/// The surface of a tile in the frame of the input.
pub fn surface(tile: &StoredTile, origin: [f64; 3]) -> Mesh {
    let place = |p: &[i32; 3]| [0, 1, 2].map(|k| origin[k] + f64::from(p[k]) * tile.step);
    let stored = &tile.mesh;
    Mesh::new(stored.positions.iter().map(place).collect(), stored.triangles.clone())
}

/// The pages of tiles as the images of a material for each.
pub(super) fn palette(tiles: &[PagedTile]) -> Palette {
    let mut materials = Materials::default();
    for tile in tiles {
        let [bytes, n_bytes] = tile.bytes;
        let file = Arc::new(RawFile::closed(&tile.path, bytes));
        let offset = bytes.saturating_sub(n_bytes.next_multiple_of(4));
        let data = ImageData::Inside(Part { file, offset, n_bytes });
        let image = Image { name: tile.path.display().to_string(), data };
        let map = Map::new(MapKind::Base, materials.add_image(image), String::new());
        let map = Map { wrap: Some(CLAMPED), ..map };
        materials.list.push(Material { maps: vec![map], ..Material::default() });
    }
    Palette::new(Some(&materials), Purpose::Bake(WantedMaps::default()))
}
