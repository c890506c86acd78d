//! Cost of a collapse and where its survivor goes: geometry, folds, attributes.

pub(crate) mod attribute_lanes;
pub(crate) mod attributes;
pub(crate) mod flats;
pub(crate) mod fold_quadric;
pub(crate) mod junction;
pub(crate) mod labels;
pub(crate) mod placement;
pub(crate) mod quadric;
pub(crate) mod recession;
pub(crate) mod seam;
