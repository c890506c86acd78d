//! Cells on disk: packs of chunks, the cells that partitioning fills, and what simplifying leaves of them.
//!
//! This layer stores and loads; it does not know why the cells are cut where they are.

mod cell_map;
mod cell_mesh;
mod cell_store;
mod deduplicate;
mod group_record;
mod id_map;
mod kd_tree;
mod lattice;
mod origins;
mod pack;
mod pieces;
mod scatter;
mod simplified_cell;
mod split_oversized;

pub use cell_map::CellMap;
pub use cell_mesh::{CellMesh, Dropped};
pub use cell_store::{CellStore, CellTally, StoreInfo, VertexLayout, load_bytes, store_row_bytes};
pub use group_record::{GroupRecord, TileRecord};
pub use id_map::IdMap;
pub use kd_tree::{CellTree, TurnedFrame, n_samples, plan_cells};
pub use lattice::{BoxKey, GroupGrid, Lattice, clamp_below, clamp_to, group_of, parent_of};
pub use origins::lead_copies;
pub use pack::{BEHIND_BYTES, Pack, PackFile, PackWriter, check_pack, half_written};
pub use pieces::{Extent, PieceSet, Pieces};
pub use scatter::Scatter;
pub use simplified_cell::{
    SurvivorFile, SurvivorInfo, SurvivorPack, SurvivorWriter, Survivors, survivor_bytes,
};
pub use split_oversized::split_overfull;
