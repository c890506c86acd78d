//! `--progressive` of `simplify`, and what cannot be recorded.

use crate::config::Progressive;
use crate::error::{Error, Result};
use std::path::PathBuf;

/// A progressive mesh beside the result.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TypedProgressive {
    /// Write a progressive mesh, too: the result and all steps back to what the last stage (the finish) began with, from which
    /// 'stonecut refine' makes a mesh of any count between. The finish collapses in another order, without --fit; it takes 5 to 9
    /// times the CPU time, and 60 bytes of memory more for each triangle that it begins with.
    #[arg(long, value_name = "OUT.pm")]
    pub(super) progressive: Option<PathBuf>,
    /// With --progressive: coordinates and other floats of 8 to 24 bits, which makes a file several times smaller [default: bit by
    /// bit, so that 'refine' gives the very bytes of a direct run].
    #[arg(long, value_name = "N", requires = "progressive", value_parser = clap::value_parser!(u32).range(8..=24))]
    pub(super) progressive_bits: Option<u32>,
}

impl TypedProgressive {
    /// The path that was typed.
    pub(super) fn path(&self) -> Option<&PathBuf> {
        self.progressive.as_ref()
    }

    /// The settings; `typed` lists options that do not go with it.
    pub(super) fn settings(&self, typed: &[(&str, bool)]) -> Result<Option<Progressive>> {
        let Some(path) = self.progressive.clone() else { return Ok(None) };
        match typed.iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(Error::Usage(format!(
                "--progressive records collapses of one finish: not with {option}"
            ))),
            None => Ok(Some(Progressive { path, bits: self.progressive_bits })),
        }
    }
}
