//! The report of a run of `tiles`, as `--report` writes it; docs/design/tiles.md describes the keys.

use crate::io::ply::PartReport;
use crate::pipeline::run_report::{InputReport, StageReport};
use crate::store::cells::{GroupRecord, TileRecord};
use crate::system::losses::Ledger;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A level of detail.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelReport {
    /// 0 for the finest.
    pub level: u32,
    /// Tiles with content.
    pub tiles: u64,
    /// Triangles of all of them.
    pub triangles: u64,
    /// Bytes of their files.
    pub bytes: u64,
    /// Groups that were simplified to make it from the level below; 0 for the finest.
    pub groups: u64,
    /// Groups that kept most of their triangles.
    pub stuck: u64,
    /// Largest distance from the input, at most, in input units.
    pub error_max: f64,
}

/// The folder of a tree.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FolderReport {
    /// As it was given.
    pub path: String,
    /// Bytes of all files.
    pub bytes: u64,
}

/// The pages of tiles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PagesReport {
    /// One a tile.
    pub pages: u64,
    /// Charts on all of them.
    pub charts: u64,
    /// Texels of all pages.
    pub texels: u64,
    /// Texels that show the surface.
    pub covered_texels: u64,
    /// Bytes of their images, within the bytes of the tiles.
    pub bytes: u64,
    /// Texels per input unit of length on the finest level; half of it on each level above. Tiles whose page would be too
    /// large have half or less of that.
    pub texels_per_unit: f64,
    /// Missing, damaged and lost parts of the input's images, a line each; deprecated, `TilesReport::losses` has them too.
    pub notes: Vec<String>,
    /// The same as they are.
    #[serde(skip)]
    pub losses: Ledger,
}

/// The report of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TilesReport {
    /// `SCHEMA_VERSION`.
    pub schema_version: u32,
    /// Version of the program.
    pub version: String,
    /// The input.
    pub input: InputReport,
    /// Files that became the input, if they were several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<PartReport>,
    /// Settings that change the result.
    pub settings: BTreeMap<String, String>,
    /// The folder.
    pub output: FolderReport,
    /// Tiles with content.
    pub tiles: u64,
    /// Files of JSON.
    pub tilesets: u64,
    /// Levels, the finest first.
    pub levels: Vec<LevelReport>,
    /// Pages of tiles; absent where tiles have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<PagesReport>,
    /// Groups that kept most of their triangles, on all levels.
    pub stuck: u64,
    /// Wall time.
    pub seconds: f64,
    /// Triangles of the input for each second.
    pub triangles_per_second: f64,
    /// Peak resident memory of the process, in bytes.
    pub peak_memory_bytes: u64,
    /// The most bytes in the job folder at one time.
    pub peak_temp_bytes: u64,
    /// Stages one after the other.
    pub stages: Vec<StageReport>,
    /// Parts of the input that are not carried, for people; deprecated, `losses` says more.
    pub notes: Vec<String>,
    /// Parts of the input that the tiles do not have.
    pub losses: Ledger,
}

impl TilesReport {
    /// Returns whether the result is not all that was asked for. A few groups that keep their triangles make nothing
    /// worse; a level that keeps them as a whole is not a coarser one.
    pub fn is_short(&self) -> bool {
        let is_stuck = self.levels.windows(2).any(|pair| pair[1].is_stuck(&pair[0]));
        let lacks_images = self.losses.has_whole();
        is_stuck || lacks_images || self.input.lost_rows() > 0
    }
}

/// A group that keeps more than this share of its triangles is stuck, unless it has but a tile; so is a level with such
/// groups.
const STUCK: f64 = 0.8;

impl LevelReport {
    /// Returns whether groups that are stuck kept this level from being coarser than the one `below` it.
    fn is_stuck(&self, below: &LevelReport) -> bool {
        self.stuck > 0 && self.triangles as f64 > STUCK * below.triangles as f64
    }
}

/// Facts about each level, the finest first; `deviations` are their distances from the input, at most.
pub(super) fn level_reports(
    rounds: &[Vec<GroupRecord>],
    top: &TileRecord,
    deviations: &[f64],
    tile_triangles: u64,
) -> Vec<LevelReport> {
    let mut out = Vec::new();
    for (level, &error_max) in deviations.iter().enumerate() {
        let tiles: Vec<&TileRecord> = match rounds.get(level) {
            Some(round) => round.iter().flat_map(|record| &record.tiles).collect(),
            None => vec![top],
        };
        let borders = rounds
            .get(level)
            .map_or(0, |round| round.iter().map(|record| record.borders.1).sum::<u64>());
        let groups = level.checked_sub(1).map_or(&[][..], |round| &rounds[round]);
        let is_stuck = |record: &&GroupRecord| {
            let [before, after] = record.triangles;
            before > tile_triangles && after as f64 > STUCK * before as f64
        };
        out.push(LevelReport {
            level: level as u32,
            tiles: tiles.len() as u64,
            triangles: tiles.iter().map(|tile| tile.triangles).sum(),
            bytes: tiles.iter().map(|tile| tile.bytes).sum::<u64>() + borders,
            groups: groups.len() as u64,
            stuck: groups.iter().filter(is_stuck).count() as u64,
            error_max,
        });
    }
    out
}
