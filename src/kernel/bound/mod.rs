//! Keeps the surface within a distance of the mesh that was given, in both directions, collapse by collapse.
//!
//! Every vertex of the input is a *witness*: it belongs to the triangle of the surface that it is nearest to. A
//! collapse is looked at before it is carried out: the witnesses of the triangles around both ends are held
//! against the triangles that would be there (`look`), and it is refused if one of them, or a point between two
//! of them, or the survivor seen from the input, would be farther than the bound. What was farther away from the
//! start (`Witness::before`) counts too. In rounds after the first, points of the original ride with the triangles
//! (`extremes`) and are witnesses too.
//!
//! It decides nothing but yes or no; `schedule` chooses edges. docs/algorithm.md, section 13.

mod between;
mod cap;
pub(crate) mod extremes;
mod fan;
mod input;
mod look;
mod new_triangles;
mod original;
mod outside;
mod refused;
pub(crate) mod scratch;
pub(crate) mod tight;
pub(crate) mod tracker;
pub(crate) mod vanish;
mod walk;
