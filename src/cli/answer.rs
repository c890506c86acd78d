//! Answers of commands: an exit code for the command line, a report for a caller in the same process.

use super::log::EXIT_SHORT;
use crate::error::{Error, Result};
use serde_json::Value;

/// Result of a command for a caller in the same process.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The JSON that the command writes as its report; `null` where a run stopped at `--until`.
    pub report: Value,
    /// True where the command line would end with exit code 3: done, but not all that was asked for.
    pub is_short: bool,
}

/// End of a command.
pub(super) struct CommandEnd {
    /// The report; `null` if the command has none.
    pub(super) report: Value,
    /// The exit code.
    pub(super) code: u8,
}

impl CommandEnd {
    /// Nothing to report, all that was asked for.
    pub(super) fn plain() -> CommandEnd {
        CommandEnd { report: Value::Null, code: 0 }
    }

    /// All that was asked for.
    pub(super) fn whole(report: &impl serde::Serialize) -> Result<CommandEnd> {
        CommandEnd::of(report, false)
    }

    /// All that was asked for, or not.
    pub(super) fn of(report: &impl serde::Serialize, is_short: bool) -> Result<CommandEnd> {
        let report = serde_json::to_value(report)
            .map_err(|e| Error::Internal(format!("the report cannot be written as JSON: {e}")))?;
        Ok(CommandEnd { report, code: if is_short { EXIT_SHORT } else { 0 } })
    }
}
