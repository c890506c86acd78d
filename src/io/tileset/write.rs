//! Writes the JSON of a tree of tiles, in files of at most 2,000 tiles.

use serde_json::{Value, json};
use std::path::Path;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::disk::Disk;
use stonecut_system::error::Result;

/// Name of the first file of a tree.
pub const FILE_NAME: &str = "tileset.json";

/// Tiles in a file, at most, and files in a folder.
const MOST_TILES: u64 = 2000;
const MOST_FILES: usize = 1000;

/// The error of a tile that points to a file is larger than that of the file's first tile by this share.
const ABOVE: f64 = 1.0 / 4096.0;

/// A tile of a tree. Lengths are in units of the mesh, places from the middle of the tree.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TreeTile {
    /// Level of detail, 0 the finest.
    pub level: u32,
    /// The group that is shown finer as one, by its number in its level; `None` on level 0.
    pub group: Option<u32>,
    /// Path of the content from the tree's folder; `None` if nothing is left to show.
    pub content: Option<String>,
    /// Bounds of the content.
    pub content_bounds: Bounds,
    /// Bounds of the tile: the same for all tiles of a group.
    pub bounds: Bounds,
    /// Error that a viewer holds against its threshold.
    pub geometric_error: f64,
    /// Distance from the input, at most.
    pub deviation: f64,
    /// Triangles of the content.
    pub triangles: u64,
    /// Numbers of the finer tiles.
    pub children: Vec<u32>,
}

/// A tree of tiles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TileTree {
    /// All tiles.
    pub tiles: Vec<TreeTile>,
    /// Number of the tile at the top.
    pub root: u32,
    /// From the frame of the tree to that of the world, by columns.
    pub transform: [f64; 16],
    /// True if z points upwards in the mesh.
    pub is_z_up: bool,
    /// Facts for people and for the checker.
    pub extras: Value,
}

impl TileTree {
    /// Bounds in the frame of tiles, in which z points upwards, as centre and half axes.
    fn volume(&self, bounds: &Bounds) -> Value {
        let (low, high) = match self.is_z_up {
            true => (bounds.low, bounds.high),
            false => (
                [bounds.low[0], -bounds.high[2], bounds.low[1]],
                [bounds.high[0], -bounds.low[2], bounds.high[1]],
            ),
        };
        let [x, y, z] = [0, 1, 2].map(|k| 0.5 * (low[k] + high[k]));
        let [a, b, c] = [0, 1, 2].map(|k| 0.5 * (high[k] - low[k]));
        json!({ "box": [x, y, z, a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c] })
    }
}

/// Writes the JSON of a tree into `folder`; returns the number of files and their bytes.
pub fn write_tilesets(tree: &TileTree, folder: &Path, disk: &Disk) -> Result<(u64, u64)> {
    let mut writer = Writer { tree, folder, disk, n_files: 0, n_bytes: 0 };
    let is_cut = writer.cuts();
    // Deepest first, so that no recursion is deeper than the tree.
    let mut names: Vec<Option<String>> = vec![None; tree.tiles.len()];
    let cut: Vec<u32> = is_cut.into_iter().filter(|&tile| tile != tree.root).collect();
    for (n, &tile) in cut.iter().enumerate() {
        names[tile as usize] = Some(format!("sets/{}/{n}.json", n / MOST_FILES));
    }
    for &tile in &cut {
        let name = names[tile as usize].clone().unwrap_or_default();
        let error = tree.tiles[tile as usize].geometric_error * (1.0 + ABOVE);
        let top = writer.tile(tile, &names, "../../", true);
        let text = json!({ "asset": asset(), "geometricError": error, "root": top });
        writer.put(&name, &text)?;
    }
    let root = &tree.tiles[tree.root as usize];
    let mut top = writer.tile(tree.root, &names, "", true);
    top["transform"] = json!(tree.transform);
    let error = (4.0 * root.geometric_error).max(root.bounds.diagonal());
    let text = json!({
        "asset": asset(), "geometricError": error, "extras": tree.extras, "root": top,
    });
    writer.put(FILE_NAME, &text)?;
    Ok((writer.n_files, writer.n_bytes))
}

fn asset() -> Value {
    json!({ "version": "1.1", "generator": concat!("stonecut ", env!("CARGO_PKG_VERSION")) })
}

struct Writer<'a> {
    tree: &'a TileTree,
    folder: &'a Path,
    disk: &'a Disk,
    n_files: u64,
    n_bytes: u64,
}

impl Writer<'_> {
    /// The tiles that begin files, in the order of their numbers.
    fn cuts(&self) -> Vec<u32> {
        let tiles = &self.tree.tiles;
        // Parents before children.
        let mut order = vec![self.tree.root];
        let mut at = 0;
        while at < order.len() {
            order.extend(&tiles[order[at] as usize].children);
            at += 1;
        }
        let mut sizes = vec![1u64; tiles.len()];
        let mut cut = Vec::new();
        for &tile in order.iter().rev() {
            let mut children = tiles[tile as usize].children.clone();
            // The largest first; of equal ones the first.
            children.sort_by_key(|&child| (std::cmp::Reverse(sizes[child as usize]), child));
            let mut size: u64 = 1 + children.iter().map(|&c| sizes[c as usize]).sum::<u64>();
            for &child in &children {
                if size <= MOST_TILES || sizes[child as usize] == 1 {
                    break;
                }
                size -= sizes[child as usize] - 1;
                sizes[child as usize] = 1;
                cut.push(child);
            }
            sizes[tile as usize] = size;
        }
        cut.sort_unstable();
        cut
    }

    /// A tile with everything below it that lies in the same file; `up` leads from the file to the folder.
    fn tile(&self, number: u32, names: &[Option<String>], up: &str, is_first: bool) -> Value {
        let tile = &self.tree.tiles[number as usize];
        let mut out = json!({
            "boundingVolume": self.tree.volume(&tile.bounds),
            "geometricError": tile.geometric_error,
        });
        if let (Some(name), false) = (&names[number as usize], is_first) {
            out["geometricError"] = (tile.geometric_error * (1.0 + ABOVE)).into();
            out["content"] = json!({ "uri": format!("{up}{name}") });
            return out;
        }
        if is_first {
            out["refine"] = "REPLACE".into();
        }
        let mut facts = json!({ "level": tile.level, "triangles": tile.triangles });
        if let Some(group) = tile.group {
            facts["group"] = group.into();
        }
        if tile.group.is_some() || tile.deviation > 0.0 {
            facts["deviation"] = tile.deviation.into();
        }
        out["extras"] = facts;
        if let Some(path) = &tile.content {
            out["content"] = json!({
                "uri": format!("{up}{path}"),
                "boundingVolume": self.tree.volume(&tile.content_bounds),
            });
        }
        if !tile.children.is_empty() {
            let children = tile.children.iter();
            out["children"] = children.map(|&child| self.tile(child, names, up, false)).collect();
        }
        out
    }

    fn put(&mut self, name: &str, text: &Value) -> Result<()> {
        let path = self.folder.join(name);
        let folder = stonecut_system::disk::folder_of(&path);
        if !folder.is_dir() {
            self.disk.create_dir(folder)?;
        }
        let text = text.to_string();
        let mut file = self.disk.create(&path)?;
        file.append(text.as_bytes())?;
        file.sync()?;
        self.n_files += 1;
        self.n_bytes += text.len() as u64;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::read_tileset;
    use super::*;

    #[test]
    fn a_large_tree_is_cut_into_files_that_hold_every_tile_once() {
        let mut tree = TileTree { is_z_up: true, ..TileTree::default() };
        let bounds = Bounds { low: [0.0; 3], high: [1.0; 3] };
        let mut last = vec![];
        for level in 0..6u32 {
            let from = tree.tiles.len() as u32;
            for i in 0..4u32.pow(6 - level) {
                let children =
                    if level == 0 { vec![] } else { last[4 * i as usize..][..4].to_vec() };
                tree.tiles.push(TreeTile {
                    level,
                    group: Some(i),
                    content: Some(format!("tiles/{level}/{i}.glb")),
                    bounds,
                    content_bounds: bounds,
                    geometric_error: f64::from(level),
                    children,
                    ..TreeTile::default()
                });
            }
            last = (from..tree.tiles.len() as u32).collect();
        }
        tree.root = tree.tiles.len() as u32;
        tree.tiles.push(TreeTile {
            level: 6,
            bounds,
            content_bounds: bounds,
            geometric_error: 9.0,
            children: last,
            ..TreeTile::default()
        });
        let folder = tempfile::tempdir().unwrap();
        let (n_files, _) = write_tilesets(&tree, folder.path(), &Disk::default()).unwrap();
        assert!((3..12).contains(&n_files), "{n_files}");
        let mut uris = Vec::new();
        let mut open = vec![FILE_NAME.to_owned()];
        while let Some(name) = open.pop() {
            let text = std::fs::read(folder.path().join(&name)).unwrap();
            let set = read_tileset(&text).unwrap();
            let mut n = 0;
            let mut tiles = vec![&set.root];
            while let Some(tile) = tiles.pop() {
                n += 1;
                tiles.extend(&tile.children);
                let Some(content) = &tile.content else { continue };
                let uri = content.uri.trim_start_matches("../").to_owned();
                if uri.ends_with("json") { open.push(uri) } else { uris.push(uri) }
            }
            assert!(n <= MOST_TILES, "{name}: {n}");
        }
        let n = uris.len();
        uris.sort_unstable();
        uris.dedup();
        assert_eq!((n, uris.len()), (tree.tiles.len() - 1, tree.tiles.len() - 1));
    }
}
