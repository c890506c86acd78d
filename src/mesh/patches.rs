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
