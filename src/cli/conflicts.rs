//! Options of `simplify` that do not go with each other: one table, and a sentence for each kind of run.

use crate::error::{Error, Result};

/// A kind of run that refuses some options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    /// `--optimize`.
    Optimize,
    /// `--pairs`.
    Pairs,
    /// Another method than the collapse.
    Method,
    /// Options of the pages of a new texture.
    Pages,
    /// `--merge-distance`.
    Joining,
    /// `--seams`.
    Seams,
    /// `--progressive`.
    Progressive,
    /// `--close`, or `--for`, which stands for it.
    Closing,
    /// `--map`.
    Map,
}

impl Mode {
    /// Says why `option` does not go with it; `typed` is the word that asked for it.
    fn refusal(self, typed: &str, option: &str) -> String {
        match self {
            Mode::Optimize => {
                format!("--optimize makes one result fit its original better: not with {option}")
            }
            Mode::Pairs => format!(
                "--pairs changes the topology and moves vertices at the end of one run: not with {option}"
            ),
            Mode::Method => format!(
                "{option} means nothing for --method {typed}; leave it out, or take --method collapse"
            ),
            Mode::Pages => format!(
                "{typed} is for a new texture, which {option} does not make; leave it out, or choose --texture bake"
            ),
            Mode::Joining => format!("--merge-distance changes the topology: not with {option}"),
            Mode::Seams => format!("{option} may take several runs: not with --seams"),
            Mode::Progressive => {
                format!("--progressive records collapses of one finish: not with {option}")
            }
            Mode::Closing => format!(
                "--close (or --for) fills holes far from the input's surface, and needs their borders free: not with {option}"
            ),
            Mode::Map => {
                format!(
                    "--map follows vertices through the collapses of one run: not with {option}"
                )
            }
        }
    }
}

/// A row of the table: an option, true if it was given, and the kinds of run that refuse it.
pub(super) type Row = (&'static str, bool, &'static [Mode]);

/// Refuses the first option that does not go with a kind of run that was asked for; `modes` have the words that did.
pub(super) fn check(modes: &[(Mode, Option<&str>)], options: &[Row]) -> Result<()> {
    for (mode, typed) in modes {
        let refused = options.iter().find(|(_, is_given, by)| *is_given && by.contains(mode));
        if let (Some(typed), Some((option, ..))) = (typed, refused) {
            return Err(Error::Usage(mode.refusal(typed, option)));
        }
    }
    Ok(())
}
