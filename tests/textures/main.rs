//! Textured meshes: kept, baked, drawn and compared.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

mod appearance;
mod bake;
mod found;
mod keep;
#[cfg(feature = "ktx2")]
mod ktx2;
mod losses;
mod maps;
mod normals;
mod opacity;
mod pages;
mod render;
