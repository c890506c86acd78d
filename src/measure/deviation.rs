//! The outcome of a two-sided measurement.

use super::side::Side;

/// Deviation of a simplified mesh from its original. Lengths are in input units.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Deviation {
    /// From the original to the simplified mesh.
    pub forward: Side,
    /// From the simplified mesh to the original.
    pub backward: Side,
    /// Both ways: sqrt((forward.rms^2 + backward.rms^2) / 2).
    pub rms: f64,
    /// The diagonal of the original's bounding box.
    pub diagonal: f64,
    /// `rms / diagonal`; infinite if the original has no extent and the simplified mesh deviates.
    pub relative_rms: f64,
    /// Samples taken, both ways.
    pub samples: u64,
}

impl Deviation {
    /// Both sides as one; `diagonal` is that of the original.
    pub fn new(forward: Side, backward: Side, diagonal: f64) -> Self {
        let (there, back) = (forward.distance.rms, backward.distance.rms);
        // Scaled, so that neither square overflows nor vanishes.
        let larger = there.max(back);
        let rms = if larger > 0.0 && larger.is_finite() {
            larger * (((there / larger).powi(2) + (back / larger).powi(2)) / 2.0).sqrt()
        } else {
            larger
        };
        let relative_rms = if rms == 0.0 { 0.0 } else { rms / diagonal };
        let samples = forward.distance.samples + backward.distance.samples;
        Deviation { forward, backward, rms, diagonal, relative_rms, samples }
    }
}
