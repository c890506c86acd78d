//! Colours, normals, labels and other values of vertices and faces, through the whole program.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

mod colours;
mod faces;
mod labels;
mod names;
mod options;
mod output;
mod regions;
