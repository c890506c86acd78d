//! The kernel alone, on families of meshes from clean to nasty.

mod dirty;
mod facing;
mod gaps;
mod property;
mod quality;
mod strays;
