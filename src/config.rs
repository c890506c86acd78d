//! What was decided for a run of `simplify`: every value final.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Default cell size. Cells of 128k-512k triangles are fastest (KERNEL experiments), and at this size a cell
/// on each of two cores and the finish fit into a budget of 256 MiB.
pub const DEFAULT_CELL_TRIANGLES: u64 = 256_000;

/// How far to simplify.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// At most so many triangles.
    Triangles(u64),
    /// This share of the input's triangles, in (0, 1].
    Ratio(f64),
    /// As few as keep the measured two-sided deviation within this, in input units.
    MaxError(f64),
}

impl Target {
    /// The target as a count, for an input of `n_triangles`; of a bound on the error, that of the first trial.
    pub fn triangles(self, n_triangles: u64) -> u64 {
        match self {
            Target::Triangles(count) => count,
            Target::Ratio(ratio) => (n_triangles as f64 * ratio).round() as u64,
            Target::MaxError(_) => n_triangles / 10,
        }
    }
}

impl Target {
    /// Refuses a share of `n_triangles` that is less than a triangle.
    pub fn check(self, n_triangles: u64) -> crate::Result<()> {
        match self {
            Target::Ratio(ratio) if n_triangles > 0 && self.triangles(n_triangles) == 0 => {
                let percent = 100.0 * ratio;
                Err(crate::Error::Usage(format!(
                    "--ratio: {percent} % of {n_triangles} triangles is less than one; ask for at least \
                     --triangles 1"
                )))
            }
            _ => Ok(()),
        }
    }
}

/// The stage after which a run stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Until {
    /// Cells lie on disk.
    Partition,
    /// Every cell has been simplified once.
    Simplify,
    /// The result is final but not yet written.
    Stitch,
}

/// What becomes of normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Normals {
    /// The input's, averaged and of length 1; none if it has none.
    #[default]
    Keep,
    /// Those of the result's own triangles, whether or not the input has any.
    Recompute,
    /// None.
    Drop,
}

/// What becomes of what vertices carry besides their place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes {
    /// What counts in the error, and how much.
    pub weights: crate::attributes::Weights,
    /// Properties that are chosen, not averaged.
    pub labels: Vec<String>,
    /// Whether normals are kept, computed anew, or left out.
    pub normals: Normals,
}

/// A run of `simplify`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The mesh to simplify.
    pub input: PathBuf,
    /// Where the result appears.
    pub output: PathBuf,
    /// How far to simplify.
    pub target: Target,
    /// Memory budget in bytes.
    pub memory_bytes: u64,
    /// Worker threads.
    pub threads: NonZeroUsize,
    /// Triangles per cell.
    pub cell_triangles: u64,
    /// Where temporary data lies.
    pub job_folder: PathBuf,
    /// Leave the job folder in place after success.
    pub keep_temp: bool,
    /// Stop early.
    pub until: Option<Until>,
    /// Overwrite the output.
    pub force: bool,
    /// Throw away what an earlier run left.
    pub restart: bool,
    /// Where to write the vertices on the first round's seams, as a point set.
    pub seams: Option<PathBuf>,
    /// Measure the result at the end.
    pub verify: bool,
    /// How the output is written.
    pub format: crate::formats::OutputFormat,
    /// Drop and count broken faces and vertices instead of failing.
    pub skip_bad: bool,
    /// Give up texture coordinates at corners.
    pub drop_texture: bool,
    /// Give up scalar properties of faces.
    pub drop_faces: bool,
    /// Progress within a stage is made durable so often; does not change the result.
    pub checkpoint_every: std::time::Duration,
    /// What becomes of colours, normals and other properties.
    pub attributes: Attributes,
    /// How cells and finish are simplified; the stop is set by the stages.
    pub kernel: crate::kernel::Options,
}

impl Config {
    /// Every setting that changes the result.
    pub fn settings(&self) -> BTreeMap<String, String> {
        BTreeMap::from([
            ("target".to_owned(), format!("{:?}", self.target)),
            ("cell-triangles".to_owned(), self.cell_triangles.to_string()),
            ("skip-bad".to_owned(), self.skip_bad.to_string()),
            ("placement".to_owned(), format!("{:?}", self.kernel.placement).to_lowercase()),
            ("merge-distance".to_owned(), self.kernel.merge_distance.to_string()),
            ("weight".to_owned(), self.attributes.weights.to_string()),
            ("faces".to_owned(), if self.drop_faces { "drop" } else { "carry" }.to_owned()),
            ("label".to_owned(), self.attributes.labels.join(",")),
            ("normals".to_owned(), format!("{:?}", self.attributes.normals).to_lowercase()),
            ("topology".to_owned(), format!("{:?}", self.kernel.topology).to_lowercase()),
            ("fit".to_owned(), format!("{:?}", self.kernel.fit).to_lowercase()),
        ])
    }
}
