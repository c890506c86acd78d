//! Options of `simplify` for results that are printed or computed with: closed, turned one way, not passing through themselves.

use crate::config::{HoleSize, MinComponent};
use crate::io::{OutputFormat, OutputKind};
use crate::kernel::Placement;
use crate::mesh::property::Scalar;
use std::path::Path;

/// Smaller components are not printed: this share of the scan's diagonal.
const PRINTED_SHARE: f64 = 0.01;

/// The choices of `--for`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum SolidPurpose {
    /// 3D printing.
    Print,
    /// Computing with the surface.
    Simulation,
}

/// Holes, senses of rotation, self-intersections.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TypedSolid {
    /// Fill holes whose box has a diagonal up to SIZE with triangles between their own vertices: 5% of the scan's diagonal, 2.5 in
    /// input units, or all. Larger ones, and those whose filling would pass through the surface, stay and are counted.
    #[arg(long, value_name = "SIZE", num_args = 0..=1, require_equals = true, default_missing_value = "5%")]
    close: Option<HoleSize>,
    /// Turn triangles over so that neighbours agree, in every round; of each component those that are fewer. Components with one
    /// side only (Moebius bands) stay and are counted. Closed components that are inside out are turned where the result fits into one cell.
    #[arg(long)]
    orient: bool,
    /// Refuse what would make the surface pass through itself where it did not, for 3D printing and simulation: takes two to
    /// four times as long.
    #[arg(long)]
    no_self_intersections: bool,
    /// Options in one word; those that are typed beside it count. print: --close=all --orient --no-self-intersections
    /// --min-component size=1%. simulation: --close=all --orient --no-self-intersections --placement midpoint.
    #[arg(long = "for", value_enum, value_name = "PURPOSE")]
    purpose: Option<SolidPurpose>,
}

impl TypedSolid {
    /// True with `--for`.
    pub(super) fn has_purpose(&self) -> bool {
        self.purpose.is_some()
    }

    /// Size of the holes that are filled.
    pub(super) fn close(&self) -> Option<HoleSize> {
        self.close.or(self.purpose.map(|_| HoleSize::All))
    }

    /// True if neighbours are to agree.
    pub(super) fn orient(&self) -> bool {
        self.orient || self.has_purpose()
    }

    /// True if the surface must not pass through itself.
    pub(super) fn no_self_intersections(&self) -> bool {
        self.no_self_intersections || self.has_purpose()
    }

    /// Format of the output: a GLB has positions as floats, since steps of 16 bits can let sheets meet.
    pub(super) fn format(&self, typed: OutputFormat, output: &Path) -> OutputFormat {
        let is_glb = typed.kind_of(output) == OutputKind::Glb;
        let asks = self.close().is_some() || self.no_self_intersections();
        let coordinate = typed.coordinate.or((is_glb && asks).then_some(Scalar::F32));
        OutputFormat { coordinate, ..typed }
    }

    /// Least size of components, beside one that was typed.
    pub(super) fn min_component(&self, typed: Option<MinComponent>) -> Option<MinComponent> {
        let printed = self.purpose.filter(|purpose| *purpose == SolidPurpose::Print);
        typed.or(printed.map(|_| MinComponent::Share(PRINTED_SHARE)))
    }

    /// Place of survivors, unless another than the default was typed: rounder triangles for simulation.
    pub(super) fn placement(&self, typed: Placement) -> Placement {
        match (self.purpose, typed) {
            (Some(SolidPurpose::Simulation), Placement::Optimal) => Placement::Midpoint,
            _ => typed,
        }
    }
}
