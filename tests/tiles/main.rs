//! Trees of tiles and what is extracted from them.

#[path = "../common/mod.rs"]
mod common;

mod errors;
mod extract;
mod scalars;
mod stops;
mod textures;
mod tiles;
mod up;
