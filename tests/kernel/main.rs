//! The kernel alone, on families of meshes from clean to nasty.

#[path = "../common/mod.rs"]
mod common;

mod dirty;
mod facing;
mod gaps;
mod property;
mod quality;
mod strays;
