//! The outcome of a conversion, for people and for programs.

use super::outcome::write_json;
use crate::error::Result;
use crate::io::ply::{PartReport, WeldReport};
use crate::system::losses::Ledger;
use crate::system::pending_file::Seen;
use std::path::Path;

/// Result of a conversion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Converted {
    /// Vertices written.
    pub n_vertices: u64,
    /// Triangles written.
    pub n_triangles: u64,
    /// Faces dropped because corners repeat or are fewer than three.
    pub n_degenerate: u64,
    /// Faces dropped because an earlier one has the same corners.
    pub n_duplicate: u64,
    /// Broken faces and missing rows dropped with `--skip-bad`.
    pub n_bad: u64,
    /// Vertices that no face uses.
    pub n_unreferenced: u64,
    /// Files that became the input, if they were several.
    pub inputs: Vec<PartReport>,
    /// Copies of vertices that became one.
    pub weld: Option<WeldReport>,
    /// Parts of the input that the output does not have.
    pub losses: Ledger,
    /// Length of the output.
    pub n_bytes: u64,
}

impl Converted {
    /// Returns whether the output is not all that the input is.
    pub fn is_short(&self) -> bool {
        self.n_bad > 0 || self.losses.has_whole()
    }
}

/// The report as JSON, written where that was asked for.
pub(super) fn write_report(
    to: Option<&Seen>,
    [input, output]: [&Path; 2],
    done: &Converted,
) -> Result<serde_json::Value> {
    let mut report = serde_json::json!({
        "schema_version": crate::system::json_keys::SCHEMA_VERSION,
        "version": env!("CARGO_PKG_VERSION"),
        "input": { "path": input },
        "output": {
            "path": output, "bytes": done.n_bytes,
            "vertices": done.n_vertices, "triangles": done.n_triangles,
        },
        "faults": {
            "degenerate_faces": done.n_degenerate, "duplicate_faces": done.n_duplicate,
            "bad_faces": done.n_bad, "unreferenced_vertices": done.n_unreferenced,
        },
        "losses": done.losses,
    });
    if !done.inputs.is_empty() {
        report["inputs"] = serde_json::json!(done.inputs);
    }
    if let Some(weld) = &done.weld {
        report["input"]["weld"] = serde_json::json!(weld);
    }
    if let Some(to) = to {
        write_json(to, &report)?;
    }
    Ok(report)
}
