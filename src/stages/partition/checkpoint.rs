//! Checkpoints within the partition: how far its passes have come, so that a killed run repeats little.
//!
//! A checkpoint writes out all scatter buffers, syncs the pack and records the place in the manifest. The
//! chunks this makes are smaller than others, which no reader notices; within a cell rows keep their order,
//! so the mesh does not depend on when checkpoints were made.

use serde::{Deserialize, Serialize};
use std::time::Instant;
use stonecut_store::cells::{CellTally, PackWriter, VertexLayout};
use stonecut_store::pack_format::{Chunk, ChunkKind};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};

/// The name of checkpoints in the manifest.
const NAME: &str = "partition so far";

/// The passes that write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Pass {
    /// Vertices go to their cells.
    #[default]
    Vertices,
    /// Triangles go to their cells.
    Triangles,
    /// Vertices go to the foreign cells that use them.
    Shared,
}

/// Faces that a pass has left out.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Dropped {
    /// A corner repeats or is missing.
    pub degenerate: u64,
    /// Broken, and dropped on request.
    pub bad: u64,
}

/// The vertices that several cells use.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Seams {
    /// Number of shared vertices.
    pub n_shared: u64,
    /// The one nearest to the middle of the bounds.
    pub place: Option<[f64; 3]>,
}

/// A place between two blocks of a pass. Everything before it is in the pack, durably.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct ResumePoint {
    /// The pass.
    pub pass: Pass,
    /// First vertex and number of vertices of the window, in the pass over the triangles.
    pub window: [u64; 2],
    /// Bytes of memory that the table of the window takes.
    #[serde(default = "unknown_bytes")]
    pub table_bytes: u64,
    /// The next block; in the last pass among the blocks that hold shared vertices.
    pub block: u64,
    /// Faces left out in this pass.
    pub dropped: Dropped,
    /// Shared vertices so far, in the last pass.
    pub seams: Seams,
    /// Sealed length of the pack.
    pub pack_bytes: u64,
}

/// More than any table may take: a place that an older build noted is not taken up.
fn unknown_bytes() -> u64 {
    u64::MAX
}

/// Decides when a checkpoint is due, and records it.
pub struct Checkpoints<'a> {
    run: &'a StageContext<'a>,
    last: Instant,
}

impl<'a> Checkpoints<'a> {
    /// Checkpoints of this run; the first is due one interval from now.
    pub fn new(run: &'a StageContext<'a>) -> Self {
        Checkpoints { run, last: Instant::now() }
    }

    /// Returns whether enough time has passed that a checkpoint is worth its sync.
    pub fn is_due(&self) -> bool {
        self.last.elapsed() >= self.run.checkpoint_every
    }

    /// Syncs the pack, to which the caller has written all its buffers, and records the place.
    pub fn seal(&mut self, place: ResumePoint, pack: &mut PackWriter) -> Result<()> {
        pack.sync()?;
        self.run.job.record(NAME, &Some(ResumePoint { pack_bytes: pack.length(), ..place }))?;
        self.last = Instant::now();
        Ok(())
    }
}

/// The pack as an earlier run left it and the place up to which it is whole; or a new pack, from the start.
///
/// `table_bytes` is what the table may take today: a place within a window that took more cannot be taken up.
pub fn take_up(
    run: &StageContext,
    pack_name: &str,
    table_bytes: u64,
) -> Result<(PackWriter, ResumePoint)> {
    let path = run.job.path(pack_name);
    let recorded = run.job.outcome::<Option<ResumePoint>>(NAME)?.flatten();
    if let Some(place) = recorded
        && place.table_bytes <= table_bytes
    {
        match PackWriter::continue_at(run.disk(), &path, place.pack_bytes) {
            Ok(pack) => return Ok((pack, place)),
            // The input is still there: all of it is simply done again.
            Err(Error::Corrupt { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    if recorded.is_some() {
        run.job.record(NAME, &None::<ResumePoint>)?;
    }
    let pack = PackWriter::create(run.disk(), &path)?;
    run.disk().sync_folder_of(&path)?;
    Ok((pack, ResumePoint::default()))
}

/// Rows per cell of what chunks hold.
pub fn tally(chunks: &[Chunk], layout: &VertexLayout, n_cells: u32) -> Result<Vec<CellTally>> {
    let mut tally = vec![CellTally::default(); n_cells as usize];
    for chunk in chunks {
        let cell = tally.get_mut(chunk.cell.index()).ok_or_else(|| {
            let what = format!("byte {}: cell {} of {n_cells}", chunk.offset, chunk.cell);
            Error::corrupt("the pack of cells", format!("{what}; run again with --restart"))
        })?;
        let ids = layout.ids.bytes;
        match chunk.kind {
            ChunkKind::Vertices => {
                cell.vertices += chunk.bytes / (ids + layout.row_bytes(false)) as u64
            }
            ChunkKind::Triangles => cell.triangles += chunk.bytes / (3 * ids) as u64,
            ChunkKind::SharedIds
            | ChunkKind::Survivors
            | ChunkKind::Foreign
            | ChunkKind::Index
            | ChunkKind::Found
            | ChunkKind::Samples
            | ChunkKind::Origins
            | ChunkKind::Verdict => {}
        }
    }
    Ok(tally)
}
