//! The largest distance that was found, and what needs no second look beside it.

/// The largest distance found so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Largest {
    /// Of a point, for certain; squared.
    pub(super) certain_sq: f64,
    /// Of what was accepted, at most; squared.
    pub(super) bound_sq: f64,
    /// Factor, squared: up to it times the certain one nothing is looked at again.
    pub(super) slack_sq: f64,
    /// The rounding of coordinates, squared: anything less counts as 0.
    pub(super) rounding_sq: f64,
    /// Pieces that a triangle is cut into, at most.
    pub(super) most_pieces: usize,
}

/// Pieces for each triangle of the mesh, of all triangles that are cut, at most: a scan takes less than one. A fan or a strip of
/// needles takes thousands, and its bound is wider than `slack` then.
const PIECES: usize = 8;

/// Rounding of distances as a share of the largest coordinate.
pub(super) const ROUNDING: f64 = 1.0 / (1u64 << 44) as f64;

impl Largest {
    /// The largest squared distance that needs no second look.
    pub(super) fn enough_sq(&self) -> f64 {
        (self.certain_sq * self.slack_sq).max(self.rounding_sq)
    }

    /// Shares the pieces that `n_triangles` are worth among those triangles that may be cut.
    pub(super) fn share_pieces(&mut self, n_triangles: usize, n_cut: usize) {
        self.most_pieces = (PIECES * n_triangles / n_cut.max(1)).max(2 * PIECES);
    }

    /// True if a squared distance, or a bound of one, needs no second look; takes it into the bound if so.
    pub(super) fn accepts(&mut self, distance_sq: f64) -> bool {
        let is_near = distance_sq <= self.enough_sq();
        if is_near {
            self.bound_sq = self.bound_sq.max(distance_sq);
        }
        is_near
    }

    /// Takes a distance that is certain.
    pub(super) fn add(&mut self, distance_sq: f64) {
        self.certain_sq = self.certain_sq.max(distance_sq);
        self.bound_sq = self.bound_sq.max(distance_sq);
    }
}
