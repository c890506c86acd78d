//! `--method` and `--grid` of `simplify`, and the options that one method alone has.

use super::arguments::parse_length;
use crate::config::{FEATURE_ANGLE, Method};
use crate::error::{Error, Result};
use clap::ValueEnum;

/// The choices of `--method`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum MethodName {
    /// Edges collapse, least error first; for results.
    Collapse,
    /// Vertices of a cell of a grid become one; for previews, at the speed of the disk.
    Cluster,
    /// Vertices are removed, least distance first; all others stay exactly where they are.
    Decimate,
    /// Vertices spread evenly over the surface, joined by nearly equilateral triangles.
    Retile,
}

impl MethodName {
    /// The word itself.
    pub(super) fn name(self) -> String {
        let word = self.to_possible_value();
        word.map_or_else(String::new, |word| word.get_name().to_owned())
    }
}

/// The choice of a method.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TypedMethod {
    /// Method: collapse (edges, least error first; for results), cluster (vertices of a cell of a grid become one, in one
    /// pass at the speed of the disk; for previews), decimate (vertices are removed, all others stay exactly where they
    /// are; in memory) or retile (nearly equilateral triangles of one size, for simulation; in memory). See docs/methods.md.
    #[arg(long, value_enum, value_name = "METHOD", default_value = "collapse")]
    pub(super) method: MethodName,
    /// With --method cluster: length of a cell of the grid, in input units, instead of a count of triangles.
    #[arg(long, value_name = "SIZE", value_parser = parse_cell_size, conflicts_with_all = ["triangles", "ratio", "max_error"])]
    pub(super) grid: Option<f64>,
    /// With --method decimate: edges whose triangles differ by more than this angle, in degrees, are features, which stay
    /// edges [default: 60].
    #[arg(long, value_name = "DEGREES", value_parser = parse_angle)]
    pub(super) feature_angle: Option<f64>,
    /// With --method retile: smaller triangles where the surface is bent, by this power of its curvature, 0 to 3 [default:
    /// 0, all of one size; 1.5 shows].
    #[arg(long, value_name = "POWER", value_parser = parse_gradation)]
    pub(super) gradation: Option<f64>,
    /// With --method cluster: take the result apart where more than two triangles meet at an edge or sheets share a
    /// vertex; vertices are copied, no triangle is lost.
    #[arg(long)]
    pub(super) manifold: bool,
    /// Contract pairs of vertices that no edge joins as well, where they face each other across a gap: components join, tunnels
    /// and handles close where that costs less than keeping them. The end of the collapse, in memory; the result is manifold.
    #[arg(long)]
    pub(super) pairs: bool,
    /// Sweeps over the result of any method that make it fit the original better at the same count: vertices move, edges are
    /// swapped, an edge collapses where another one's split gains more. Takes longer than everything else; in memory. 2 is enough.
    #[arg(long, value_name = "SWEEPS", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub(super) optimize: Option<u32>,
}

fn parse_angle(text: &str) -> std::result::Result<f64, String> {
    let angle = text.parse().ok().filter(|x: &f64| (0.0..=180.0).contains(x));
    angle.ok_or_else(|| "an angle in degrees, 0 to 180: 30".to_owned())
}

fn parse_gradation(text: &str) -> std::result::Result<f64, String> {
    let power = text.parse().ok().filter(|x: &f64| (0.0..=3.0).contains(x));
    power.ok_or_else(|| "a power, 0 to 3: 1.5".to_owned())
}

fn parse_cell_size(text: &str) -> std::result::Result<f64, String> {
    match parse_length(text)? {
        size if size > 0.0 => Ok(size),
        _ => Err("a length in input units, above 0: 0.2".to_owned()),
    }
}

impl TypedMethod {
    /// The method with its settings.
    pub(super) fn settings(&self) -> Method {
        match self.method {
            MethodName::Collapse => Method::Collapse,
            MethodName::Cluster => Method::Cluster { manifold: self.manifold },
            MethodName::Decimate => {
                Method::Decimate { feature_angle: self.feature_angle.unwrap_or(FEATURE_ANGLE) }
            }
            MethodName::Retile => Method::Retile { gradation: self.gradation.unwrap_or(0.0) },
        }
    }

    /// Refuses options that only another method has.
    pub(super) fn check(&self) -> Result<()> {
        for (option, is_given, of) in [
            ("--grid", self.grid.is_some(), MethodName::Cluster),
            ("--feature-angle", self.feature_angle.is_some(), MethodName::Decimate),
            ("--gradation", self.gradation.is_some(), MethodName::Retile),
            ("--manifold", self.manifold, MethodName::Cluster),
        ] {
            if is_given && self.method != of {
                let (of, name) = (of.name(), self.method.name());
                return Err(Error::Usage(format!(
                    "{option} is for --method {of}; leave it out with {name}"
                )));
            }
        }
        Ok(())
    }
}
