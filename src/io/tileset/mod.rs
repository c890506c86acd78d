//! The JSON of a tree of tiles, OGC 3D Tiles 1.1 with explicit tiles: out, and in as far as a checker needs it.
//!
//! A large tree is cut into several files, each of which a tile of another one points to.

mod borders;
mod own_files;
mod read;
mod write;

pub use borders::{TileBorder, border_path, decode_borders, encode_borders};
pub use own_files::{MOST_FILE_BYTES, OWN_PAGES, TreeFiles, most_tile_bytes};
pub use read::{Asset, Content, Tile, Tileset, Volume, read_tileset, resolve};
pub use write::{FILE_NAME, TileTree, TreeTile, write_tilesets};
