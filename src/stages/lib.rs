//! The stages of the program, side by side: none imports another; `pipeline` runs them in order.

pub mod components;
pub mod partition;
pub mod simplify;
pub mod stitch;
pub mod tiles;
pub mod write;
