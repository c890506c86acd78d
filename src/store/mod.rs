//! What lies on disk between the stages: the job folder, packs of cells, and what a stage is given of them.

pub mod cells;
pub mod job;
pub mod pack_format;
pub mod stage_context;
