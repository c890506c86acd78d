//! A unit to be done, and how.

use crate::store::job::units::{Frozen, Unit};
use std::path::Path;
use std::time::Duration;

/// One unit to be done.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// The job folder.
    pub folder: &'a Path,
    /// The plan of the job.
    pub frozen: &'a Frozen,
    /// The unit.
    pub unit: &'a Unit,
    /// Missing files are looked for again during this time.
    pub patience: Duration,
    /// Check the files of a unit that is done, and do it again if they are damaged.
    pub mends: bool,
}
