//! Places that parts count from: a part with another offset than the first is moved to its place.

use crate::ply::MeshSource;
use crate::sidecars::{Georeference, crs_in, crs_of};
use stonecut_mesh::placing::offset_of;
use stonecut_system::error::{Error, Result};

/// Places of the parts so far.
#[derive(Default)]
pub(super) struct Places {
    /// Place of the first part, if it names one; `None` before there is a part.
    first: Option<Option<Georeference>>,
    /// The first system that is named.
    crs: Option<String>,
    /// The first place that files beside a part name.
    pub found: Option<Georeference>,
    n_moved: u64,
}

/// The system that a part names, if it is known.
fn named_crs(source: &MeshSource) -> Option<String> {
    crs_in(source.comments()).filter(|crs| !crs.is_empty())
}

/// Returns whether a comment is on the place of a mesh.
pub(super) fn is_place(comment: &str) -> bool {
    offset_of(comment).is_some() || crs_of(comment).is_some()
}

impl Places {
    /// The shift that takes a part to the place of the first one, if it has another.
    ///
    /// `found` is its place as files beside it say, which may be no offset: 0 0 0. Errors: one of them names no offset, or another system.
    pub fn shift(
        &self,
        source: &MeshSource,
        found: Option<&Georeference>,
    ) -> Result<Option<[f64; 3]>> {
        let Some(first) = &self.first else { return Ok(None) };
        let own = source.georeference().or_else(|| found.cloned());
        let named = |place: &Option<Georeference>| place.as_ref().map(|place| place.offset);
        let (from, to) = (named(&own), named(first));
        let other_crs =
            named_crs(source).filter(|own| self.crs.as_ref().is_some_and(|crs| crs != own));
        let far = [from, to].map(Option::unwrap_or_default);
        if other_crs.is_some() || (from.is_none() || to.is_none()) && far[0] != far[1] {
            let words = |place: &Option<Georeference>| {
                place.as_ref().map_or_else(|| "no offset".to_owned(), Georeference::words)
            };
            let what = format!(
                "its coordinates count from another place than those of the files before it ({}, not {}); \
                 give {} a file beside it that says its offset (0 0 0 if it has none), or bring it there with --translate",
                words(&own),
                words(first),
                if own.is_some() && first.is_none() { "each of those" } else { "it" }
            );
            return Err(Error::bad_input(source.path(), what));
        }
        let shift = [0, 1, 2].map(|k| far[0][k] - far[1][k]);
        Ok(Some(shift).filter(|shift| *shift != [0.0; 3]))
    }

    /// Notes the place of a part.
    pub fn add(&mut self, source: &MeshSource, found: Option<Georeference>, is_moved: bool) {
        self.first.get_or_insert_with(|| source.georeference().or_else(|| found.clone()));
        self.crs = self.crs.take().or_else(|| named_crs(source));
        self.found = self.found.take().or(found.filter(|found| !found.is_nowhere()));
        self.n_moved += u64::from(is_moved);
    }

    /// Comments of the first part, with a system that only another one names.
    pub fn comments(&self, mut comments: Vec<String>) -> Vec<String> {
        if let Some(crs) = &self.crs
            && crs_in(&comments).as_ref() != Some(crs)
        {
            comments.retain(|line| crs_of(line).is_none());
            comments.push(format!("crs {crs}"));
        }
        comments
    }

    /// A line on parts that were moved.
    pub fn remark(&self, first: &str) -> Option<String> {
        let n = self.n_moved;
        (n > 0).then(|| format!("{n} files count from other places: moved to that of {first}"))
    }
}
