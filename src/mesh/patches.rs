//! Labels of vertices that lie in patches, as a segmentation's do: told from numbers that differ nearly everywhere.

/// Names of properties that are labels, whatever their values.
pub const LABEL_NAMES: [&str; 8] =
    ["label", "labels", "region", "region_id", "material", "material_id", "segment", "segment_id"];

/// Counts triangles whose corners have different labels.
#[derive(Clone, Debug, Default)]
pub struct PatchCount {
    n: u64,
    mixed: u64,
    steps: NeighbourSteps,
}

impl PatchCount {
    /// Triangles that are enough to tell.
    pub const SAMPLE: usize = 100_000;

    /// Takes the labels of a triangle's corners, as they are and as numbers, which need not be exact.
    pub fn add<T: PartialEq>(&mut self, [a, b, c]: [T; 3], numbers: [f64; 3]) {
        self.n += 1;
        self.mixed += u64::from(a != b || b != c);
        self.steps.add(numbers);
    }

    /// Returns whether the labels lie in patches: no more than a third of the triangles has several (patches of 50 vertices,
    /// of which 2 % leave one). Labels that are the same on all triangles of the mesh (`is_all`) have no borders, nor have
    /// measurements, unless their name or the user says that they are labels.
    pub fn is_patchy(&self, name: &str, labels: &[String], is_all: bool) -> bool {
        let is_named = LABEL_NAMES.contains(&name) || labels.iter().any(|label| label == name);
        let are_few = 3 * self.mixed <= self.n && !(is_all && self.mixed == 0);
        self.n > 0 && are_few && (is_named || !self.steps.are_small())
    }
}

/// Values of neighbours beside values anywhere: measurements in whole numbers (the intensity of a laser, 0 to 255) lie in bands, as labels do in
/// patches, but neighbours differ by little.
#[derive(Clone, Debug, Default)]
struct NeighbourSteps {
    n: u64,
    /// Different values, the first few of them.
    seen: Vec<f64>,
    /// Sums of the values and of their squares.
    sums: [f64; 2],
    n_steps: u64,
    /// Sum of the differences of neighbours that differ.
    steps: f64,
}

impl NeighbourSteps {
    /// A measurement's neighbours differ by at most one in this many of the standard deviation of all. (Layers that are numbered from one end
    /// to the other pass for a measurement from 28 on.)
    const LEAST: f64 = 8.0;
    /// Different values of a measurement, at least.
    const VALUES: usize = 16;

    /// Takes the values of a triangle's corners.
    fn add(&mut self, [a, b, c]: [f64; 3]) {
        self.n += 3;
        for (value, next) in [(a, b), (b, c), (c, a)] {
            if self.seen.len() < Self::VALUES && !self.seen.contains(&value) {
                self.seen.push(value);
            }
            self.sums = [self.sums[0] + value, self.sums[1] + value * value];
            self.n_steps += u64::from(value != next);
            self.steps += (value - next).abs();
        }
    }

    /// Returns whether values are many, and neighbours differ by little. Not so for values that are not finite.
    fn are_small(&self) -> bool {
        let [mean, mean_square] = self.sums.map(|sum| sum / self.n as f64);
        let deviation = (mean_square - mean * mean).sqrt();
        let are_many = self.n_steps > 0 && self.seen.len() == Self::VALUES;
        are_many && Self::LEAST * self.steps / self.n_steps as f64 <= deviation
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_of_a_measurement_are_told_from_patches_of_labels() {
        let are_small = |value: fn(u32) -> u32| {
            let mut steps = NeighbourSteps::default();
            for i in 0..10_000 {
                steps.add([i, i + 1, i + 2].map(|i| f64::from(value(i))));
            }
            steps.are_small()
        };
        assert!(are_small(|i| 50 + i / 80), "0 to 255, some 80 rows each");
        assert!(are_small(|i| (127.0 + 120.0 * (f64::from(i) / 500.0).sin()).round() as u32));
        assert!(!are_small(|i| i / 2500), "four labels");
        assert!(!are_small(|i| i / 500), "twenty layers");
        assert!(!are_small(|i| if i < 5000 { i / 500 % 2 } else { 255 }), "two and none");
        assert!(!are_small(|i| (i / 100).wrapping_mul(7919) % 200), "two hundred labels");
        assert!(!are_small(|_| 7));
    }
}
