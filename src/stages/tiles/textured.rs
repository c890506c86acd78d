//! Tiles with pages: read back as they were written without, their vertices parted along charts, and encoded again.
//!
//! A vertex that several charts have becomes one vertex for each of them. All of these have the number of the one they
//! come from, so that a checker and `extract` know that they are one; a vertex that no other tile has gets a number for that.
//!
//! docs/design/tiles.md, "Textures".

use super::{border_name, tile_path};
use std::collections::HashMap;
use std::path::Path;
use stonecut_io::tileset::{TileBorder, decode_borders};
use stonecut_io::{StoredTile, TileForm, TileMesh, TilePage, TileScalar, decode_tile, encode_tile};
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::guarded;

/// Numbers of vertices of one tile begin here: no input has as many vertices.
const OF_ONE_TILE: u64 = 1 << 63;

/// A tile without a page.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// As it lies in its file.
    pub tile: StoredTile,
    /// Numbers of the vertices that other tiles may have.
    pub border: TileBorder,
}

/// Places of a tile's triangles on its page.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    /// The chart of each triangle; `no_chart` where it has none.
    pub chart: &'a [u32],
    /// Stands for no chart.
    pub no_chart: u32,
    /// Corners from 0 to 1, from the upper left corner of the page.
    pub corners: &'a [[[f32; 2]; 3]],
}

/// Reads the tiles that a round has written of a cell. Errors: `Corrupt` for a file that is not as it was written.
pub fn read_shapes(
    folder: &Path,
    (level, cell): (u32, CellId),
    n_tiles: usize,
    scalars: &[TileScalar],
) -> Result<Vec<Shape>> {
    let read = |name: &str| {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).map_err(|e| Error::reading(&path, "cannot read", e))?;
        Ok::<_, Error>((path, bytes))
    };
    let (path, bytes) = read(&border_name(level, cell))?;
    let borders = decode_borders(&bytes).map_err(|what| Error::corrupt(&path, what))?;
    if borders.len() != n_tiles {
        let what = format!("{} tiles instead of {n_tiles}", borders.len());
        return Err(Error::corrupt(&path, what));
    }
    let mut out = Vec::with_capacity(n_tiles);
    for (n, border) in borders.into_iter().enumerate() {
        let (path, bytes) = read(&tile_path(level, cell, n))?;
        let decoded = guarded(|| Ok(decode_tile(&bytes)))?;
        let mut tile = decoded.map_err(|what| Error::corrupt(&path, what))?;
        tile.take_scalars(scalars).map_err(|what| Error::corrupt(&path, what))?;
        if border.iter().any(|&(at, _)| at as usize >= tile.mesh.positions.len()) {
            return Err(Error::corrupt(&path, "its numbers are those of another tile".to_owned()));
        }
        out.push(Shape { tile, border });
    }
    Ok(out)
}

/// Encodes a tile with its page; returns the file and the numbers of its vertices. `tile` counts the tiles of the tree.
pub fn encode_with_page(
    shape: &Shape,
    places: Places,
    (page, packs): (TilePage, bool),
    scalars: &[TileScalar],
    tile: u32,
) -> (Vec<u8>, TileBorder) {
    let old = &shape.tile.mesh;
    let (mesh, from) = parted(old, places);
    let mut numbers: Vec<Option<GlobalVertex>> = vec![None; old.positions.len()];
    shape.border.iter().for_each(|&(at, id)| numbers[at as usize] = Some(id));
    let mut copies = vec![0u32; old.positions.len()];
    from.iter().for_each(|&v| copies[v as usize] += 1);
    let own = |v: u32| GlobalVertex(OF_ONE_TILE | u64::from(tile) << 32 | u64::from(v));
    let number = |v: u32| {
        let is_parted = copies[v as usize] > 1;
        numbers[v as usize].or_else(|| is_parted.then(|| own(v)))
    };
    let StoredTile { step, is_z_up, .. } = shape.tile;
    let form = TileForm { step, packs, is_z_up, scalars, page: Some(page) };
    let (bytes, order) = encode_tile(mesh, form);
    let numbered = (0u32..).zip(order).filter_map(|(at, v)| Some((at, number(from[v as usize])?)));
    (bytes, numbered.collect())
}

/// The mesh with a vertex for each chart, and the old vertex of each; colours are left out.
fn parted(old: &TileMesh, places: Places) -> (TileMesh, Vec<u32>) {
    let mut found: HashMap<(u32, u32), u32> = HashMap::new();
    let mut any = vec![u32::MAX; old.positions.len()];
    let (mut from, mut coordinates) = (Vec::new(), Vec::new());
    let mut triangles = old.triangles.clone();
    let on_page = |at: [f32; 2]| at.map(|x| (x.clamp(0.0, 1.0) * 65_535.0).round() as u16);
    // Those without a chart take what vertices there are.
    for has_chart in [true, false] {
        let own = |t: &usize| (places.chart[*t] != places.no_chart) == has_chart;
        for t in (0..old.triangles.len()).filter(own) {
            for (corner, at) in triangles[t].iter_mut().zip(places.corners[t]) {
                let v = *corner;
                let next = from.len() as u32;
                let place = match has_chart {
                    true => found.entry((v, places.chart[t])).or_insert(next),
                    false => &mut any[v as usize],
                };
                if *place == next || *place == u32::MAX {
                    *place = next;
                    from.push(v);
                    coordinates.push(on_page(at));
                }
                *corner = *place;
                any[v as usize] = *corner;
            }
        }
    }
    let of = |column: &Vec<f64>| from.iter().map(|&v| column[v as usize]).collect();
    let mesh = TileMesh {
        positions: from.iter().map(|&v| old.positions[v as usize]).collect(),
        normals: from.iter().map(|&v| old.normals[v as usize]).collect(),
        colours: Vec::new(),
        coordinates,
        scalars: old.scalars.iter().map(of).collect(),
        triangles,
    };
    (mesh, from)
}
