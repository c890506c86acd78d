//! Crashes, full disks, damage, little memory and many machines: the same bytes, or a clear error.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

mod budgets;
mod cluster;
mod crash;
mod forged;
mod full_disk;
mod memory_named;
mod memory_promise;
mod owned;
mod populated;
mod recipes;
mod resume_damage;
mod spoiled;
mod wide_ids;
