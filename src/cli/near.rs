//! Options of `simplify` about vertices that lie near each other.

use crate::io::{Lock, Weld};

/// Vertices and boundaries that are joined.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TypedNear {
    /// Copies of vertices that become one before everything else: auto (copies within rounding, where a sample shows that
    /// there are some), off, or a distance in input units. With a distance, free boundaries at most that far apart meet
    /// and join, too. Only open edges are joined.
    #[arg(long, value_name = "WHAT", default_value = "auto", conflicts_with = "merge_distance")]
    weld: Weld,
    /// The same as --weld T; 0: none.
    #[arg(long, value_name = "T", value_parser = super::arguments::parse_length, default_value_t = 0.0)]
    merge_distance: f64,
    /// Vertices that stay bit for bit, so that parts that were simplified apart fit together: boundary (those at open
    /// edges), or the name of a property of vertices (those where it is not 0).
    #[arg(long, value_name = "WHAT")]
    lock: Option<Lock>,
}

impl TypedNear {
    /// Returns whether a distance was given under its older name.
    pub(super) fn has_merge_distance(&self) -> bool {
        self.merge_distance > 0.0
    }

    /// Vertices that stay.
    pub(super) fn lock(&self) -> Option<Lock> {
        self.lock.clone()
    }

    /// Properties that are chosen, never averaged: `labels`, and one that says which vertices stay.
    pub(super) fn labels(&self, labels: &[String]) -> Vec<String> {
        let own = match &self.lock {
            Some(Lock::Property(name)) if !labels.contains(name) => Some(name),
            _ => None,
        };
        labels.iter().chain(own).cloned().collect()
    }

    /// Copies of vertices that become one.
    pub(super) fn weld(&self) -> Weld {
        if self.merge_distance > 0.0 { Weld::Distance(self.merge_distance) } else { self.weld }
    }

    /// Distance at which free boundaries meet: changes of the topology, which can be ruled out.
    pub(super) fn gap(&self, keeps_topology: bool) -> f64 {
        match self.weld() {
            Weld::Distance(distance) if !keeps_topology => distance,
            _ => 0.0,
        }
    }
}
