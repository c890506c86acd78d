//! The size up to which holes are filled, as it is typed and stored.

use stonecut_system::units::parse_ratio;

/// Largest diagonal of the box around a hole that is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoleSize {
    /// Every hole is filled.
    All,
    /// A length in input units.
    Length(f64),
    /// A share of the diagonal of the input's box.
    Share(f64),
}

impl HoleSize {
    /// The length in input units, for an input with a box of this diagonal.
    pub fn length(self, diagonal: f64) -> f64 {
        match self {
            HoleSize::All => f64::INFINITY,
            HoleSize::Length(length) => length,
            HoleSize::Share(share) => share * diagonal,
        }
    }
}

impl std::fmt::Display for HoleSize {
    /// As it is typed.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            HoleSize::All => f.write_str("all"),
            HoleSize::Length(length) => write!(f, "{length}"),
            HoleSize::Share(share) => write!(f, "{}%", share * 100.0),
        }
    }
}

impl std::str::FromStr for HoleSize {
    type Err = String;

    /// Reads `all`, `2.5` or `5%`.
    fn from_str(text: &str) -> Result<Self, String> {
        let complaint = || {
            format!(
                "'{text}' is not a size of holes: all, 2.5 (input units) or 5% (of the scan's diagonal)"
            )
        };
        match text.trim() {
            "all" => Ok(HoleSize::All),
            share if share.ends_with('%') => {
                parse_ratio(share).map(HoleSize::Share).map_err(|_| complaint())
            }
            length => {
                let length = length.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
                length.map(HoleSize::Length).ok_or_else(complaint)
            }
        }
    }
}
