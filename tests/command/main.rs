//! The command: its words, paths, pages, reports, and how it stops.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

#[path = "../common/mod.rs"]
mod common;

mod builders;
mod command_line;
mod empty;
mod exit_codes;
mod pages;
mod paths;
mod plans;
mod receipt;
mod report;
mod report_schema;
mod serve;
mod stopping;
mod terminal;
mod words;
