//! Settings for opening an input: folder for unpacking, memory, strictness.

use super::external_sort::ExternalSort;
use crate::ply::ReadOptions;
use crate::ply::raw::Spool;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use stonecut_system::disk::Disk;
use stonecut_system::memory::{budget_bytes, limit_bytes};
use stonecut_system::units::memory_word;

/// Decides which vertices are joined before all else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Weld {
    /// Copies within rounding, where a sample shows that there are some.
    #[default]
    Auto,
    /// None.
    Off,
    /// Those at most this far apart, in input units.
    Distance(f64),
}

impl std::str::FromStr for Weld {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Weld, String> {
        match text {
            "auto" => Ok(Weld::Auto),
            "off" => Ok(Weld::Off),
            _ => match text.parse::<f64>() {
                Ok(distance) if distance > 0.0 && distance.is_finite() => {
                    Ok(Weld::Distance(distance))
                }
                _ => Err("expected auto, off or a positive distance in input units".to_owned()),
            },
        }
    }
}

impl std::fmt::Display for Weld {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Weld::Auto => write!(f, "auto"),
            Weld::Off => write!(f, "off"),
            Weld::Distance(distance) => write!(f, "{distance}"),
        }
    }
}

/// Normals of a glTF file that differ in one place, as along hard edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HardEdges {
    /// Stay apart, as vertices of one place.
    Kept,
    /// Are averaged, which is a loss with this remedy.
    Averaged(&'static str),
    /// Are averaged, and no result has them.
    Unused,
}

/// Vertices that must stay bit for bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Lock {
    /// Those at open edges.
    Boundary,
    /// Those with a property that is not 0.
    Property(String),
}

impl std::str::FromStr for Lock {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Lock, String> {
        match text {
            "" => Err("expected boundary, or the name of a property of vertices".to_owned()),
            "boundary" => Ok(Lock::Boundary),
            name => Ok(Lock::Property(name.to_owned())),
        }
    }
}

impl std::fmt::Display for Lock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Lock::Boundary => write!(f, "boundary"),
            Lock::Property(name) => write!(f, "{name}"),
        }
    }
}

/// Settings of the weld.
#[derive(Clone, Debug)]
pub struct WeldOptions {
    /// Vertices that are joined.
    pub how: Weld,
    /// Up to this many triangles exact copies are left as they are: those who take in the whole mesh at once join them.
    pub exact_above: u64,
    /// Properties of vertices that are chosen, never averaged.
    pub labels: Vec<String>,
    /// Keeps the new number of each vertex with the mesh, 4 bytes a vertex (`MeshSource::joined_numbers`).
    pub keeps_numbers: bool,
}

/// More memory than this makes sorting no faster.
const MOST_SORT_BYTES: u64 = 256 << 20;

/// A spool keeps at most one in this many bytes of the memory; several are filled at a time.
const SPOOL_SHARE: u64 = 16;

/// Settings for staging an input.
#[derive(Clone, Debug)]
pub struct StageOptions {
    /// Threads for files that are read side by side.
    pub threads: NonZeroUsize,
    /// The folder for staged data; up to the size of the input, decompressed, and for STL three times
    /// that for a while.
    pub temp_dir: PathBuf,
    /// Memory for sorting the corners of an STL file, and vertices that are joined; at least 3 MiB are sensible.
    pub memory_bytes: u64,
    /// Memory for what has to be held as a whole: the description in a glTF file, the window of a compressed stream.
    pub parse_bytes: u64,
    /// True for a look at a file: one that says to be far larger than it is, is refused.
    pub only_looks: bool,
    /// Strictness of reading; its `temp_dir` is set to the one above.
    pub read: ReadOptions,
    /// The disk whose account staged data is part of.
    pub disk: Disk,
    /// Joins copies of vertices; `None` leaves the mesh as it is.
    pub weld: Option<WeldOptions>,
    /// Marks vertices that must stay.
    pub lock: Option<Lock>,
    /// Fate of normals that differ in one place.
    pub hard_edges: HardEdges,
    /// Vertices without a colour, where others have one, get that of their material (glTF): the output has no materials.
    pub bare_as_material: bool,
}

impl StageOptions {
    /// Strict reading with 256 MiB for sorting, and half of the memory that is used by default for parsing.
    pub fn new(temp_dir: impl Into<PathBuf>) -> Self {
        StageOptions {
            threads: NonZeroUsize::MIN,
            temp_dir: temp_dir.into(),
            memory_bytes: MOST_SORT_BYTES,
            parse_bytes: budget_bytes(None, limit_bytes()) / 2,
            only_looks: false,
            read: ReadOptions::default(),
            disk: Disk::default(),
            weld: None,
            lock: None,
            hard_edges: HardEdges::Averaged(""),
            bare_as_material: false,
        }
    }

    /// The same within half of the memory of a command.
    pub fn within(self, command_bytes: u64) -> Self {
        let half = command_bytes / 2;
        StageOptions { memory_bytes: half.min(MOST_SORT_BYTES), parse_bytes: half, ..self }
    }

    /// Temporary bytes that a file of some bytes may come to, if there is a bound: much more than any real scene does, of
    /// which little stands in many places.
    pub fn most_unpacked(&self, file_bytes: u64) -> Option<u64> {
        self.only_looks.then(|| file_bytes.saturating_mul(200).max(1 << 30))
    }

    /// The memory of a command, as people type it, with which `parse_bytes` is `bytes`.
    pub fn memory_for(bytes: u64) -> String {
        memory_word(bytes.saturating_mul(2))
    }

    /// An empty spool in the folder for staged data.
    pub fn spool(&self) -> Spool {
        Spool::new(&self.temp_dir).within(self.memory_bytes / SPOOL_SHARE).counted(&self.disk)
    }

    /// An empty sort in the folder for staged data.
    pub fn sort<const N: usize>(&self, memory_bytes: usize) -> ExternalSort<N> {
        ExternalSort::new(&self.temp_dir, memory_bytes).counted(&self.disk)
    }
}
