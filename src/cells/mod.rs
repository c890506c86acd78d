//! Cells on disk: packs of chunks, the cells that partitioning fills, and what simplifying leaves of them.
//!
//! This layer stores and loads; it does not know why the cells are cut where they are.

mod id_map;
mod pack;
mod pieces;
mod scatter;
mod split;
mod store;
mod survivors;
mod tidy;
mod tree;

pub use id_map::IdMap;
pub use pack::{Pack, PackWriter};
pub use pieces::{Bounds, Extent, NOWHERE, PieceSet, Pieces, around, position_bits};
pub use scatter::Scatter;
pub use split::split_overfull;
pub use store::{
    CellMesh, CellStore, CellTally, StoreInfo, Verdicts, VertexLayout, load_bytes, store_row_bytes,
};
pub use survivors::{SurvivorInfo, SurvivorPack, SurvivorWriter, Survivors, survivor_bytes};
pub use tidy::Dropped;
pub use tree::{CellTree, Frame, n_samples, plan_cells};
