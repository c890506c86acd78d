//! Receipts of runs: the files that went in and came out, the settings, and the distance that is proven between them, in one file that can be
//! kept and signed.
//!
//! The form alone: `cli/receipt` fills a receipt in after a run, `cli/verify` checks one. Everything in it follows from the run, nothing from the
//! time or the machine, so two runs of one build give the same bytes ([docs/design/receipt.md]).

pub(crate) mod hashes;
pub(crate) mod signature;

use crate::error::{Error, Result};
use crate::system::canonical_json::canonical;
use crate::system::disk::read_regular;
use crate::system::losses::Ledger;
use hashes::{HashedFile, sha256_of};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// The first value of a receipt, by which it is known; it grows with every change of the keys or of their meaning.
pub(crate) const ABOUT: &str = "stonecut receipt, version 1; canonical JSON (RFC 8785)";

/// Bytes of a receipt at most: some hundred thousand files.
const MOST_BYTES: u64 = 64 << 20;

/// Files by their paths, with slashes, from the folder of the receipt.
pub(crate) type HashedFiles = BTreeMap<String, HashedFile>;

/// A receipt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Receipt {
    /// `ABOUT`.
    pub(crate) about: String,
    /// The place on the globe.
    pub(crate) coordinates: ReceiptPlace,
    /// The input.
    pub(crate) input: ReceiptInput,
    /// Parts of the input that the output does not have.
    pub(crate) losses: Ledger,
    /// Options of `simplify` that decide the bytes, sorted, as they were typed.
    pub(crate) options: Vec<String>,
    /// The end of the run.
    pub(crate) outcome: ReceiptOutcome,
    /// The output as typed, of a chain with its mark.
    pub(crate) output: String,
    /// The outputs, finest first.
    pub(crate) outputs: Vec<ReceiptOutput>,
    /// The program.
    pub(crate) program: MadeBy,
    /// Every setting that changes the result, as in the report.
    pub(crate) settings: BTreeMap<String, String>,
    /// SHA-256 of the canonical form without this key.
    pub(crate) sha256: String,
    /// The tree of tiles, in place of outputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) tree: Option<ReceiptTree>,
}

/// The program that made a receipt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MadeBy {
    /// SHA-256 of the executable; absent where the program ran within another one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) build: Option<String>,
    /// Version of stonecut.
    pub(crate) version: String,
}

/// The input of a receipt.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReceiptInput {
    /// Files that the meshes name or that say where they lie: libraries, images, buffers, sidecars.
    pub(crate) beside: HashedFiles,
    /// Triangles, vertices, components, edges by kind, Euler characteristic.
    pub(crate) counts: BTreeMap<String, i64>,
    /// The files of the mesh, with lists and trees that name them.
    pub(crate) files: HashedFiles,
    /// Files, folders and lists as typed.
    pub(crate) given: Vec<String>,
}

/// An output of a receipt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReceiptOutput {
    /// Counts as those of the input.
    pub(crate) counts: BTreeMap<String, i64>,
    /// The proven interval.
    pub(crate) distance: ProvenInterval,
    /// The file of the mesh and those that it names.
    pub(crate) files: HashedFiles,
    /// The file of the mesh.
    pub(crate) path: String,
}

/// A tree of tiles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReceiptTree {
    /// Tiles, files of JSON, levels, groups, triangles of the finest tiles and of all.
    pub(crate) counts: BTreeMap<String, i64>,
    /// The largest distance from the input that tiles of each level state, the finest level first, in input units.
    pub(crate) errors: Vec<f64>,
    /// Every file.
    pub(crate) files: HashedFiles,
}

/// An interval that holds the Hausdorff distance between input and output, in input units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProvenInterval {
    /// True if its width is at most `tolerance * upper`.
    pub(crate) certified: bool,
    /// Some point of one surface is at least as far from the other.
    pub(crate) lower: f64,
    /// The width that was wanted, relative to `upper`.
    pub(crate) tolerance: f64,
    /// No point of either surface is farther from the other.
    pub(crate) upper: f64,
}

/// Place of a mesh on the globe, as files beside it say, and shifts of its coordinates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReceiptPlace {
    /// To be added to coordinates of the input, for those of the system.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) offset: Option<[f64; 3]>,
    /// The place that coordinates of the result count from: by files beside the input, and by `--recentre`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) recentred: Option<[f64; 3]>,
    /// `EPSG:n`, or `ENU:LAT,LON`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) system: Option<String>,
}

/// End of the run of a receipt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReceiptOutcome {
    /// Defects of the input, by kind; the rows were dropped.
    pub(crate) faults: BTreeMap<String, u64>,
    /// Reason why collapsing ended.
    pub(crate) stop_reason: String,
    /// As in the report.
    pub(crate) target_met: bool,
}

impl Receipt {
    /// The bytes of the file, with the checksum filled in.
    pub(crate) fn sealed(mut self) -> Result<Vec<u8>> {
        self.sha256 = self.checksum()?;
        let bytes = canonical(&json(&self)?);
        if bytes.len() as u64 > MOST_BYTES {
            let what = format!(
                "the receipt would have {} bytes, more than {MOST_BYTES}: too many files",
                bytes.len()
            );
            return Err(Error::Usage(what));
        }
        Ok(bytes)
    }

    /// SHA-256 of everything but itself.
    fn checksum(&self) -> Result<String> {
        let mut value = json(self)?;
        if let Value::Object(keys) = &mut value {
            keys.remove("sha256");
        }
        Ok(sha256_of(&canonical(&value)))
    }

    /// Reads a receipt, and gives its bytes and what is wrong with its form.
    ///
    /// Errors: `BadInput` for all that is not a receipt of this version.
    pub(crate) fn read(path: &Path) -> Result<(Receipt, Vec<u8>, Vec<String>)> {
        let bad = |what: String| Error::bad_input(path, what);
        let bytes = read_regular(path, MOST_BYTES).map_err(|e| bad(format!("cannot read: {e}")))?;
        let receipt: Receipt = serde_json::from_slice(&bytes).map_err(|_| {
            let found = match serde_json::from_slice::<Value>(&bytes) {
                Ok(Value::Object(keys)) if keys.contains_key("about") => {
                    "it has been edited, or is of another version"
                }
                Ok(_) => "it is JSON of another kind",
                Err(_) => "it is not JSON",
            };
            bad(format!("not a receipt: {found}; give what simplify or tiles wrote with --receipt, unchanged"))
        })?;
        if receipt.about != ABOUT {
            return Err(bad(format!(
                "not a receipt of this version: 'about' is '{}', not '{ABOUT}'",
                receipt.about
            )));
        }
        let mut wrong = Vec::new();
        if canonical(&json(&receipt)?) != bytes {
            wrong.push(
                "receipt: not in canonical form, it was changed since it was written".to_owned(),
            );
        }
        let found = receipt.checksum()?;
        if found != receipt.sha256 {
            wrong.push(format!(
                "receipt: sha256: {} recorded, {found} found; it was changed since it was written",
                receipt.sha256
            ));
        }
        Ok((receipt, bytes, wrong))
    }
}

/// A part of a receipt as JSON.
pub(crate) fn json(part: &impl Serialize) -> Result<Value> {
    serde_json::to_value(part)
        .map_err(|e| Error::Internal(format!("the receipt cannot be written as JSON: {e}")))
}
