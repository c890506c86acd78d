//! The least size of components that stay, as it is typed and stored.

use stonecut_system::units::{parse_count, parse_ratio};

/// Least size of components that stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MinComponent {
    /// Those of fewer triangles.
    Triangles(u64),
    /// Those whose bounding box has a shorter diagonal, in input units.
    Size(f64),
    /// Those whose bounding box has a diagonal below this share of the input's.
    Share(f64),
}

impl MinComponent {
    /// The least diagonal, of a scan with this one; 0 for a count.
    pub fn length(self, diagonal: f64) -> f64 {
        match self {
            MinComponent::Triangles(_) => 0.0,
            MinComponent::Size(length) => length,
            MinComponent::Share(share) => share * diagonal,
        }
    }
}

impl std::fmt::Display for MinComponent {
    /// As it is typed.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            MinComponent::Triangles(count) => write!(f, "{count}"),
            MinComponent::Size(length) => write!(f, "size={length}"),
            MinComponent::Share(share) => write!(f, "size={}%", share * 100.0),
        }
    }
}

impl std::str::FromStr for MinComponent {
    type Err = String;

    /// Reads `300`, `2k`, `size=2.5` or `size=0.1%`. A fraction of a triangle is taken for a forgotten `size=`.
    fn from_str(text: &str) -> Result<Self, String> {
        let complaint = || {
            format!(
                "'{text}' is neither a count of triangles nor a size: 300, 2k, size=2.5 (input units), size=0.1% (of the scan's diagonal)"
            )
        };
        if let Some(size) = text.trim().strip_prefix("size=") {
            if size.ends_with('%') {
                return parse_ratio(size).map(MinComponent::Share).map_err(|_| complaint());
            }
            let length = size.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
            return length.map(MinComponent::Size).ok_or_else(complaint);
        }
        if text.parse::<f64>().is_ok_and(|number| number.fract() != 0.0) {
            return Err(complaint());
        }
        parse_count(text).map(MinComponent::Triangles).map_err(|_| complaint())
    }
}
