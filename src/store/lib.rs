//! Data on disk between the stages: the job folder, packs of cells, and the context of a stage.

pub mod config;

pub mod cell_id;
pub mod cells;
pub mod job;
pub mod pack_format;
pub mod shape;
pub mod stage_context;
