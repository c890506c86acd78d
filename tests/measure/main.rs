//! What is measured of meshes: deviation, certificates, self-intersections.

#[path = "../common/mod.rs"]
mod common;

mod cells;
mod certify;
mod deviation;
mod self_intersections;
mod verify;
