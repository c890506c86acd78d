//! Options of `simplify` on what faces carry.

use super::method::{MethodName, TypedMethod};
use crate::io::NameUse;

/// Parts of faces to give up.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TypedFaces {
    /// Give up properties of faces (colours, labels, flags), which saves moving them to vertices and back.
    #[arg(long)]
    pub(super) drop_faces: bool,
    /// Give up names of objects and groups, whose borders are kept otherwise.
    #[arg(long)]
    drop_names: bool,
}

impl TypedFaces {
    /// Fate of names, which go with the faces: not every way to simplify keeps these apart.
    pub(super) fn names(&self, method: &TypedMethod, is_progressive: bool) -> NameUse {
        match () {
            () if self.drop_names || self.drop_faces => NameUse::GivenUp(""),
            () if method.method != MethodName::Collapse => {
                NameUse::GivenUp("only --method collapse carries them")
            }
            () if method.pairs => NameUse::GivenUp("not carried by --pairs"),
            () if method.optimize.is_some() => NameUse::GivenUp("not carried by --optimize"),
            () if is_progressive => NameUse::GivenUp("not carried by --progressive"),
            () => NameUse::Carried,
        }
    }
}
