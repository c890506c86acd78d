//! Labels of vertices that lie in patches, as a segmentation's do: told from numbers that differ nearly everywhere.

/// Counts triangles whose corners have different labels.
#[derive(Clone, Copy, Debug, Default)]
pub struct PatchCount {
    n: u64,
    mixed: u64,
}

impl PatchCount {
    /// Triangles that are enough to tell.
    pub const SAMPLE: usize = 100_000;

    /// Takes the labels of a triangle's corners.
    pub fn add<T: PartialEq>(&mut self, [a, b, c]: [T; 3]) {
        self.n += 1;
        self.mixed += u64::from(a != b || b != c);
    }

    /// Returns whether the labels lie in patches: no more than a third of the triangles has several (patches of 50 vertices,
    /// of which 2 % leave one). Labels that are the same on all triangles of the mesh have no borders.
    pub fn is_patchy(&self, is_all: bool) -> bool {
        self.n > 0 && 3 * self.mixed <= self.n && !(is_all && self.mixed == 0)
    }
}

/// Values of a property of floats, which is a label if all are whole and few differ: programs without other types
/// (CloudCompare) write labels so.
#[derive(Clone, Debug, Default)]
pub struct WholeValues {
    /// Different values so far, in order.
    seen: Vec<f64>,
    /// True once a value is not whole, or there are too many.
    are_others: bool,
}

impl WholeValues {
    /// Different values of a label, at most.
    const MOST: usize = 256;

    /// Takes a value in.
    pub fn add(&mut self, value: f64) {
        if self.are_others {
            return;
        }
        if let Err(place) = self.seen.binary_search_by(|known| known.total_cmp(&value)) {
            self.are_others = value.fract() != 0.0 || self.seen.len() == Self::MOST;
            self.seen.insert(place, value);
        }
    }

    /// Returns whether all values so far may be labels.
    pub fn are_few_and_whole(&self) -> bool {
        !self.are_others
    }

    /// Returns whether the values are labels: not all the same, too.
    pub fn are_labels(&self) -> bool {
        !self.are_others && self.seen.len() > 1
    }
}
