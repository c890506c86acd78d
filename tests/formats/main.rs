//! Mesh files in and out: dialects of PLY, other formats, and what is not a mesh at all.

mod dialects;
mod fuzz;
mod other;
mod round_trips;
