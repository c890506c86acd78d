//! Facts about a group of a tree of tiles that are kept with its simplified cell: its tiles, its parts, its error.

use super::lattice::BoxKey;
use serde::{Deserialize, Serialize};

/// A group after its round. Lengths are in input units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GroupRecord {
    /// The group.
    pub group: BoxKey,
    /// The tiles of the level below that it holds, in the order of their files.
    pub tiles: Vec<TileRecord>,
    /// xxh3 and bytes of the file of the numbers of their common vertices.
    pub borders: (u64, u64),
    /// Boxes of the group's level with their triangles, in the order of the triangles that are left.
    pub parts: Vec<(BoxKey, u64)>,
    /// Largest distance from the tiles to the parts, at most, or back, whichever is larger.
    pub deviation: f64,
    /// Triangles before and after.
    pub triangles: [u64; 2],
}

/// A tile as it was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileRecord {
    /// Its box.
    pub key: BoxKey,
    /// Its triangles.
    pub triangles: u64,
    /// Its vertices.
    pub vertices: u64,
    /// Values of its properties of vertices that it holds otherwise than the mesh: not finite, or too long.
    #[serde(default)]
    pub inexact: u64,
    /// Bytes of its file.
    pub bytes: u64,
    /// xxh3 of its file.
    pub checksum: u64,
    /// Side of a texel of its page, in input units; 0 without a page.
    #[serde(default)]
    pub texel: f64,
    /// Bounds of its vertices as they are stored, from the lattice's origin.
    pub low: [f64; 3],
    /// Upper end of them.
    pub high: [f64; 3],
    /// Bounds of its triangles in each box of the level below, in steps of the level of the tile; none for tiles of the finest level.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_box: Vec<[[i32; 3]; 2]>,
}
