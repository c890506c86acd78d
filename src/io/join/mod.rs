//! Many mesh files as one: a set of parts (`inputs`), opened one after the other, staged as one PLY.
//!
//! Everything behind sees one `MeshSource` (docs/design/inputs.md).

mod affine;
mod contents;
mod implicit;
mod inputs;
mod limits;
mod lists;
mod looks;
mod places;
mod schemas;
mod sizes;
mod stage;
mod tree_folder;
mod trees;

pub use inputs::InputPaths;
pub(crate) use stage::stage;

use std::ops::Range;
use std::path::PathBuf;
use stonecut_mesh::placing::Placing;
use stonecut_system::losses::Ledger;

/// One mesh file of several that become one.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPart {
    /// The file.
    pub path: PathBuf,
    /// Map of this part alone, before that of the whole.
    pub placing: Placing,
    /// Place of the mesh in the file, where it is not all of it: a GLB in a b3dm.
    pub bytes: Option<Range<u64>>,
}

impl MeshPart {
    /// A whole file, where it is.
    pub fn of(path: impl Into<PathBuf>) -> MeshPart {
        MeshPart { path: path.into(), placing: Placing::default(), bytes: None }
    }
}

/// Parts that become one mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InputSet {
    /// In the order in which they are joined.
    pub parts: Vec<MeshPart>,
    /// Files that were read to find them: lists, the JSON of trees.
    pub found_in: Vec<PathBuf>,
    /// Files that were named more than once, and are taken once.
    pub repeated: Vec<PathBuf>,
    /// Parts of trees that are not read.
    pub losses: Ledger,
}
