//! Trees of tiles and what is extracted from them.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

mod errors;
mod extract;
mod recipes;
mod scalars;
mod stops;
mod textures;
mod tiles;
mod up;
