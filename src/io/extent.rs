//! The type of coordinates that a text needs, which does not say it.

use stonecut_mesh::property::Scalar;

/// Box around the places of a text.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    least: [f64; 3],
    most: [f64; 3],
}

impl Default for Extent {
    fn default() -> Self {
        Extent { least: [f64::MAX; 3], most: [f64::MIN; 3] }
    }
}

impl Extent {
    /// Takes a place; what is not finite is passed over.
    pub fn add(&mut self, position: [f64; 3]) {
        for (axis, value) in position.into_iter().enumerate().filter(|(_, x)| x.is_finite()) {
            self.least[axis] = self.least[axis].min(value);
            self.most[axis] = self.most[axis].max(value);
        }
    }

    /// Floats keep 24 bits of the distance from the origin. They do unless the mesh lies so far from it
    /// that less than 21 bits are left for its own extent.
    pub fn coordinate(&self) -> Scalar {
        let extent = (0..3).map(|i| self.most[i] - self.least[i]).fold(0.0, f64::max);
        let far = (0..3).map(|i| self.most[i].abs().max(self.least[i].abs()));
        // An axis without a place lies nowhere.
        let far = far.filter(|&x| x < f64::MAX).fold(0.0, f64::max);
        if far > 8.0 * extent || far > f64::from(f32::MAX) { Scalar::F64 } else { Scalar::F32 }
    }
}
