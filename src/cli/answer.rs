//! Answers of commands to a caller in the same process.

use crate::error::{Error, Result};
use serde_json::Value;

/// Result of a command.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The JSON that the command writes as its report; `null` where a run stopped at `--until`.
    pub report: Value,
    /// True where the command line would end with exit code 3: done, but not all that was asked for.
    pub is_short: bool,
}

impl Answer {
    /// An answer that is all that was asked for.
    pub(super) fn whole(report: Value) -> Answer {
        Answer { report, is_short: false }
    }
}

/// Any report as JSON.
pub(super) fn json_of(report: &impl serde::Serialize) -> Result<Value> {
    serde_json::to_value(report)
        .map_err(|e| Error::Internal(format!("the report cannot be written as JSON: {e}")))
}
