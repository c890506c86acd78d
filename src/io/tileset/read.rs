//! Reads a file of a tree of tiles, as far as its checker needs it.

use serde::Deserialize;
use serde_json::Value;

/// A file of a tree.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Tileset {
    /// Facts about the format.
    pub asset: Asset,
    /// Error of showing nothing.
    pub geometric_error: f64,
    /// The first tile.
    pub root: Tile,
    /// Facts of the program that wrote it.
    #[serde(default)]
    pub extras: Value,
}

/// Facts about the format.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Asset {
    /// `1.1`.
    pub version: String,
    /// The program that wrote it.
    #[serde(default)]
    pub generator: String,
}

/// A tile.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Tile {
    /// Volume that holds the contents of the tile and of all below it.
    pub bounding_volume: Volume,
    /// Error of showing it instead of its children.
    pub geometric_error: f64,
    /// `ADD` or `REPLACE`.
    pub refine: Option<String>,
    /// Mesh or further file.
    pub content: Option<Content>,
    /// Finer tiles.
    #[serde(default)]
    pub children: Vec<Tile>,
    /// From the frame of the tile to that of its parent, by columns.
    pub transform: Option<[f64; 16]>,
    /// Facts of the program that wrote it.
    #[serde(default)]
    pub extras: Value,
}

/// A volume; other kinds than boxes are not read.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Volume {
    /// Centre and three half axes.
    #[serde(rename = "box")]
    pub cuboid: Option<[f64; 12]>,
}

/// The content of a tile.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Content {
    /// Address, from the file that names it; version 1.0 began as `url`.
    #[serde(alias = "url")]
    pub uri: String,
    /// Volume that holds the content alone.
    pub bounding_volume: Option<Volume>,
}

/// Reads a file of a tree; the error says what is wrong with it.
pub fn read_tileset(text: &[u8]) -> Result<Tileset, String> {
    serde_json::from_slice(text).map_err(|e| format!("its JSON is not that of a tileset: {e}"))
}

/// The path in the folder of the tree that an address in `file` leads to; none if that lies outside.
pub fn resolve(file: &str, uri: &str) -> Option<String> {
    let mut parts: Vec<&str> = file.split('/').collect();
    parts.pop();
    for part in uri.split('/') {
        match part {
            ".." => drop(parts.pop()?),
            "" | "." => return None,
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}
