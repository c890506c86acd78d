//! The target of a run, the levels of a chain, and the method.

use std::path::PathBuf;

/// Target of the simplification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// At most this many triangles.
    Triangles(u64),
    /// This share of the input's triangles, in (0, 1].
    Ratio(f64),
    /// As few as keep the distance both ways within this, in input units.
    MaxError(f64),
    /// Those of a grid with cells of this length, in input units; only for `Method::Cluster`.
    CellSize(f64),
}

impl Target {
    /// The target as a count, for an input of `n_triangles`; of a bound on the error or a grid, a guess.
    pub fn triangles(self, n_triangles: u64) -> u64 {
        match self {
            Target::Triangles(count) => count,
            Target::Ratio(ratio) => (n_triangles as f64 * ratio).round() as u64,
            Target::MaxError(_) | Target::CellSize(_) => n_triangles / 10,
        }
    }
}

impl std::fmt::Display for Target {
    /// As it is stored: `triangles=10035`, `ratio=0.01`, `max_error=0.5`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Target::Triangles(count) => write!(f, "triangles={count}"),
            Target::Ratio(ratio) => write!(f, "ratio={ratio}"),
            Target::MaxError(bound) => write!(f, "max_error={bound}"),
            Target::CellSize(size) => write!(f, "grid={size}"),
        }
    }
}

impl Target {
    /// Refuses a share of `n_triangles` that is less than a triangle.
    pub fn check(self, n_triangles: u64) -> stonecut_system::Result<()> {
        match self {
            Target::Ratio(ratio) if n_triangles > 0 && self.triangles(n_triangles) == 0 => {
                let ratio = stonecut_system::units::show_share(ratio);
                Err(stonecut_system::Error::Usage(format!(
                    "--ratio {ratio} of {n_triangles} triangles is less than one; ask for at least \
                     --triangles 1"
                )))
            }
            _ => Ok(()),
        }
    }
}

/// A level of a chain: one of several results of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// Its target.
    pub target: Target,
    /// Path of its file.
    pub output: PathBuf,
}

/// Method of simplification, with its own settings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Method {
    /// Edges collapse, least error first; for results.
    #[default]
    Collapse,
    /// Vertices of a cell of a grid become one; for previews, at the speed of the disk.
    Cluster {
        /// Take the result apart where it is not manifold.
        manifold: bool,
    },
    /// Vertices are removed, least distance first; all others stay exactly where they are.
    Decimate {
        /// Angle between triangles, in degrees, beyond which their edge is a feature.
        feature_angle: f64,
    },
    /// Vertices spread evenly over the surface, joined by nearly equilateral triangles.
    Retile {
        /// Power of the curvature by which triangles are denser; 0 for one size.
        gradation: f64,
    },
}

impl Method {
    /// The name in settings and reports.
    pub fn name(self) -> &'static str {
        match self {
            Method::Collapse => "collapse",
            Method::Cluster { .. } => "cluster",
            Method::Decimate { .. } => "decimate",
            Method::Retile { .. } => "retile",
        }
    }
}
