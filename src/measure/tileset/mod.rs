//! Checks a tree of tiles that `stonecut tiles` has written: its rules, its files, and whether neighbours meet.
//!
//! Knows nothing of the program that wrote it but the format (docs/design/tiles.md): the JSON of 3D Tiles 1.1, the
//! numbers in the files, and the facts in `extras` that say which tiles are shown finer together.

mod borders;
mod found;
mod rules;

use borders::{Border, Borders, border};
pub use found::TilesetCheck;
use rules::{CheckedTile, Cuboid, Tree};
use std::path::Path;
use stonecut_io::tileset::{
    FILE_NAME, MOST_FILE_BYTES, TileBorder, Tileset, border_path, decode_borders, most_tile_bytes,
    read_tileset,
};
use stonecut_io::{StoredTile, decode_tile_within};
use stonecut_system::disk::read_regular;
use stonecut_system::error::Result;
use stonecut_system::parallel::{guarded, in_order};
use stonecut_system::progress::Progress;

/// A tile that could be read.
struct Tile {
    triangles: u64,
    border: Border,
    /// A fault that leaves its border what it is.
    fault: Option<String>,
}

/// Checks the tree in `folder`. Memory: a few hundred bytes a tile, and 48 for each edge on the border of a tile of one
/// level.
///
/// Errors: `BadInput` if there is no tree, or none of this program. Faults of a tree are findings, not errors.
pub fn check_tileset(
    folder: &Path,
    (memory_bytes, threads): (u64, usize),
    progress: &Progress,
) -> Result<TilesetCheck> {
    let most_bytes = most_tile_bytes(memory_bytes, threads);
    let mut found = TilesetCheck::default();
    let tree = Tree::read(folder, &mut found)?;
    tree.check(&mut found);
    found.levels = tree.tiles.iter().map(|tile| tile.level + 1).max().unwrap_or(0);
    let (mut finer, mut total) = (None, 0);
    for level in 0..found.levels {
        let tiles: Vec<u32> = (0u32..)
            .zip(&tree.tiles)
            .filter(|(_, tile)| tile.level == level && tile.content.is_some())
            .map(|(number, _)| number)
            .collect();
        let mut borders = Borders::new(level);
        in_order(
            tiles.len() as u64,
            threads,
            progress,
            |index, out: &mut Option<_>| {
                let tile = &tree.tiles[tiles[index as usize] as usize];
                *out = Some(look(folder, tile, &tree, most_bytes));
                Ok(())
            },
            |index, looked| {
                let number = tiles[index as usize];
                match looked.take() {
                    Some(Ok(Tile { triangles, border, fault })) => {
                        found.tiles += 1;
                        total += triangles;
                        found.triangles += if level == 0 { triangles } else { 0 };
                        borders.add(number, border);
                        if let Some(what) = fault {
                            let name = tree.tiles[number as usize].name();
                            found.fault(|| format!("{name}: {what}"));
                        }
                    }
                    Some(Err(what)) => {
                        let name = tree.tiles[number as usize].name();
                        found.fault(|| format!("{name}: {what}"));
                    }
                    None => {}
                }
                Ok(())
            },
        )?;
        let open = borders.within(&tree, &mut found);
        if level == 0 {
            found.boundary_edges = open;
        } else if open > 0 && found.boundary_edges == 0 {
            found.fault(|| {
                format!("level {level} has {open} edges of one triangle, the finest level none")
            });
        }
        if let Some(finer) = &finer {
            Borders::across(finer, &borders, &tree, &mut found);
        }
        finer = Some(borders);
    }
    found.triangles_of_all_levels = total;
    if tree.finest_triangles != found.triangles {
        let (n, wanted) = (found.triangles, tree.finest_triangles);
        found.fault(|| format!("the finest tiles have {n} triangles, the mesh had {wanted}"));
    }
    Ok(found)
}

/// True if a folder is a tree of tiles, but for those that another program says it has made.
pub fn is_tileset(path: &Path) -> bool {
    let file = path.join(FILE_NAME);
    // What is not a file there is refused by name when it is read, and so is a damaged one.
    if !path.is_dir() || std::fs::symlink_metadata(&file).is_err() {
        return false;
    }
    let text = read_regular(&file, MOST_FILE_BYTES).unwrap_or_default();
    let is_own = |set: Tileset| {
        set.asset.generator.starts_with("stonecut") || set.extras["stonecut"].is_object()
    };
    read_tileset(&text).map_or(true, is_own)
}

/// Reads a tile and holds it against its description.
fn look(
    folder: &Path,
    tile: &CheckedTile,
    tree: &Tree,
    most_bytes: u64,
) -> std::result::Result<Tile, String> {
    let path = folder.join(tile.name());
    let bytes = read_regular(&path, most_bytes).map_err(|e| format!("cannot be read: {e}"))?;
    // The decoder of compressed data checks by panicking in places.
    let decoded = guarded(|| Ok(decode_tile_within(&bytes, most_bytes)));
    let mut stored: StoredTile = decoded.map_err(|_| "its data is damaged".to_owned())??;
    stored.take_scalars(&tree.scalars)?;
    let mesh = &stored.mesh;
    let n = mesh.triangles.len() as u64;
    if n != tile.triangles {
        return Err(format!("it has {n} triangles, its tile says {}", tile.triangles));
    }
    let step = tree.step * f64::from(tile.level).exp2();
    if (stored.step / step - 1.0).abs() > 1e-9 || stored.is_z_up != tree.is_z_up {
        return Err(format!("its step is {}, not {step}, or another axis points up", stored.step));
    }
    let Some(volume) = tile.content_volume.or(tile.volume) else {
        return Ok(Tile { triangles: n, border: Border::default(), fault: None });
    };
    let place = |p: &[i32; 3]| {
        let p = p.map(|x| f64::from(x) * step);
        if tree.is_z_up { p } else { [p[0], -p[2], p[1]] }
    };
    for p in mesh.positions.iter().map(place) {
        if !volume.contains(p, step) {
            return Err(format!("its vertex at {p:?} lies outside of its volume"));
        }
    }
    // Viewers may leave out a tile of which nothing finer lies in the picture.
    let is_held = |t: &[u32; 3]| {
        let corners = t.map(|v| place(&mesh.positions[v as usize]));
        let holds = |volume: &Cuboid| corners.iter().all(|p| volume.contains(*p, step / 1024.0));
        tile.finer.iter().any(holds)
    };
    let leaves = mesh.triangles.iter().position(|t| tile.level > 0 && !is_held(t));
    let fault =
        leaves.map(|t| format!("its triangle {t} lies in none of the volumes of its finer tiles"));
    if let Some(i) = mesh.normals.iter().position(|n| *n == [0; 3]) {
        return Err(format!("the normal of its vertex {i} has no direction"));
    }
    if tree.has_pages && (stored.page.is_none() || mesh.coordinates.is_empty()) {
        return Err("it has no page, or no coordinates on it".to_owned());
    }
    if stored.page.is_some() && !mesh.colours.is_empty() {
        return Err("it has a page and colours, which multiply it".to_owned());
    }
    let border = border(mesh, &numbers_of(folder, tile.name(), most_bytes)?)?;
    Ok(Tile { triangles: n, border, fault })
}

/// Bytes of a number in memory for one of its file, at most.
const NUMBER_BYTES: u64 = 16;

/// The numbers of the vertices that a tile has in common with others.
fn numbers_of(
    folder: &Path,
    tile: &str,
    most_bytes: u64,
) -> std::result::Result<TileBorder, String> {
    let (name, n) = border_path(tile).ok_or("its name is not that of a tile")?;
    let bytes = read_regular(&folder.join(&name), most_bytes / NUMBER_BYTES)
        .map_err(|e| format!("{name} cannot be read: {e}"))?;
    let mut tiles = decode_borders(&bytes).map_err(|what| format!("{name}: {what}"))?;
    if n >= tiles.len() {
        return Err(format!("{name} has {} tiles, this is number {n}", tiles.len()));
    }
    Ok(tiles.swap_remove(n))
}
