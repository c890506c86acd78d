//! The main job and the other methods, from input to result.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

mod apart;
mod chain;
mod components;
mod fit;
mod flats;
mod in_memory;
mod input;
mod junctions;
mod lock;
mod map;
mod max_error;
mod methods;
mod optimize;
mod pairs;
mod progressive;
mod retile;
mod simplify;
mod sizes;
mod slides;
mod solid;
mod subset;
mod unused;
mod verdicts;
mod walls;
mod weld;
