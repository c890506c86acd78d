//! The rounds of a run of `tiles`: each simplifies all groups, and cuts what is left into those of the next.

use super::config::TilesConfig;
use super::plan::{Hidden, LAST, too_little};
use crate::error::{Error, Result};
use crate::kernel;
use crate::measure::step;
use crate::mesh::vec3::{length_sq, sub};
use crate::pipeline::sealed_stages::SealedStages;
use crate::stages::partition::Partition;
use crate::stages::simplify::{Beside, CellRun, Goal, channel_lengths, simplify_cells, work_bytes};
use crate::stages::stitch::{self, NewCells, within_reach};
use crate::stages::tiles::{self, TileRound};
use crate::store::cell_id::CellId;
use crate::store::cells::{
    BoxKey, CellStore, Dropped, GroupGrid, GroupRecord, Lattice, StoreInfo, SurvivorInfo,
    SurvivorPack, TileRecord, VertexLayout,
};
use crate::store::stage_context::StageContext;
use crate::system::memory::BASE_BYTES;
use std::path::Path;

/// The bound of a round's step exceeds the largest distance that was found by at most this factor.
const SLACK: f64 = 1.25;

/// Places may be rounded to this share of the mean edge, at most; as a rule a step is a hundredth of it.
const COARSEST_STEP: f64 = 0.5;

/// Mean length of the edges in the largest cell.
fn mean_edge(store: &CellStore) -> Result<f64> {
    let triangles = |cell: &CellId| (store.info().cells[*cell].triangles, *cell);
    let Some(cell) = CellId::first(store.n_cells()).max_by_key(triangles) else { return Ok(0.0) };
    let mesh = store.load(cell)?.mesh;
    let ends = mesh.triangles.iter().map(|t| [t[0], t[1]].map(|v| mesh.positions[v as usize]));
    let sum: f64 = ends.map(|[a, b]| length_sq(sub(a, b)).sqrt()).sum();
    Ok(sum / mesh.triangles.len().max(1) as f64)
}

/// The steps of one run: each is sealed in the job, timed and reported.
pub(super) struct Stages<'a> {
    pub(super) stages: SealedStages<'a>,
    pub(super) run: StageContext<'a>,
    pub(super) config: &'a TilesConfig,
    pub(super) pending: &'a Path,
    /// The folder that rounds write tiles into: that of the tree, or one of shapes within it.
    pub(super) tiles_folder: &'a Path,
    pub(super) input_triangles: u64,
    pub(super) layout: VertexLayout,
    pub(super) hidden: Hidden,
    pub(super) kernel: kernel::Options,
    /// Faces and vertices of the input that the first round left out; known after it.
    pub(super) dropped: Dropped,
}

impl Stages<'_> {
    fn store(&self, info: StoreInfo) -> Result<CellStore> {
        CellStore::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    /// All rounds, and the tile at the top. Those that leave levels finer than the finest write no tiles.
    pub(super) fn rounds(
        &mut self,
        partition: &Partition,
        grid: &GroupGrid,
    ) -> Result<(Vec<Vec<GroupRecord>>, TileRecord)> {
        let run = self.run;
        let hidden = self.hidden;
        let mut store = partition.store.clone();
        if self.layout.n_weighted() > 0 {
            let target = (store.triangles as f64 * hidden.left(1)) as u64;
            self.kernel.weights = run.job.sealed("channel lengths", || {
                channel_lengths(&self.store(store.clone())?, target, &run)
            })?;
        }
        let mut groups = grid.groups.clone();
        let mut parts: Option<Vec<Vec<(BoxKey, u64)>>> = None;
        let mut rounds: Vec<Vec<GroupRecord>> = Vec::new();
        let mut was_single = false;
        loop {
            let round = rounds.len() as u32 + 1;
            let tile = hidden.tile_triangles(round);
            let is_last = round > hidden.rounds
                && groups.len() == 1
                && (was_single || store.triangles <= LAST * tile);
            was_single = groups.len() == 1;
            let share = (store.triangles as f64 * hidden.left(round)) as u64;
            let wanted = if is_last { share.min(tile) } else { share };
            let wanted = within_reach(wanted, store.triangles, store.shared_vertices);
            let goal = Goal { round, triangles: wanted.max(4).min(store.triangles) };
            self.check_memory(&store)?;
            let disk = run.disk().clone();
            let layout = self.layout.clone();
            let work = TileRound {
                lattice: grid.lattice,
                round,
                finest: hidden.rounds,
                groups: &groups,
                parts: parts.as_deref(),
                has_spare_thread: groups.len() == 1 && run.threads > 1,
                is_last,
                tile_triangles: tile,
                folder: self.tiles_folder,
                is_output: self.tiles_folder == self.pending,
                packs: self.config.packs,
                is_z_up: self.config.is_z_up,
                input: &self.config.input,
                layout: &layout,
                disk: &disk,
                deviation: &|fine, coarse, followed| step::deviation(fine, coarse, followed, SLACK),
            };
            let (options, info, pending) = (self.kernel.clone(), store.clone(), self.pending);
            let rows = layout.clone();
            let mut left = self.stages.stage(
                (&format!("round {round}"), if round == 1 { "simplify" } else { "round" }),
                store.triangles,
                |left: &SurvivorInfo| left.triangles,
                |run| {
                    let store = CellStore::open(run.disk(), run.job.folder(), info, rows)?;
                    let beside = Beside {
                        bytes_per_triangle: tiles::BYTES_PER_TRIANGLE,
                        is_whole: &|cell, left| Ok(work.is_whole(cell, left)),
                        look: &|cell, before, left| work.look(cell, &before, left),
                    };
                    let (options, beside) = (&options, Some(beside));
                    let round = CellRun { store: &store, goal, options, beside, context: run };
                    let left = simplify_cells(&round)?;
                    run.disk().sync_all_below(pending)?;
                    Ok(left)
                },
            )?;
            store.packs.iter().try_for_each(|file| run.disk().remove(&run.job.path(&file.pack)))?;
            let records = std::mem::take(&mut left.statistics.groups);
            if round == 1 {
                self.dropped = left.statistics.dropped;
            }
            if left.triangles == 0 {
                let what = format!("no triangle is left after round {round}; nothing was written");
                return Err(Error::Empty { path: self.config.output.clone(), what });
            }
            if is_last {
                let top = run.job.sealed("top", || {
                    let pack = self.survivors(left.clone())?;
                    let top = work.write_root(&pack.load(CellId(0))?)?;
                    run.disk().sync_all_below(self.pending)?;
                    Ok(top)
                })?;
                rounds.push(records);
                return Ok((rounds, top));
            }
            let (next, next_parts) = tiles::next_groups(&records);
            let of_triangles = |cell: CellId, _: &crate::store::cells::Survivors| {
                tiles::next_cells(&records[cell].parts, &next)
            };
            let old_packs = left.packs.clone();
            let rows = self.layout.clone();
            store = self.stages.stage(
                (&format!("regroup {round}"), "repartition"),
                left.triangles,
                |store: &StoreInfo| store.triangles,
                |run| {
                    let pack = SurvivorPack::open(run.disk(), run.job.folder(), left, rows)?;
                    let n_cells = next.len() as u32;
                    let map = NewCells { n_cells, of_triangles: &of_triangles };
                    stitch::regroup(&pack, map, round + 1, run)
                },
            )?;
            for file in old_packs {
                run.disk().remove(&run.job.path(&file.pack))?;
            }
            rounds.push(records);
            groups = next;
            parts = Some(next_parts);
        }
    }

    /// Fails where places in tiles would be coarser than the mesh: a few pieces far from all others make the boxes wide.
    pub(super) fn check_step(&self, info: &StoreInfo, lattice: &Lattice) -> Result<()> {
        let edge = self.run.job.sealed("mean edge", || mean_edge(&self.store(info.clone())?))?;
        if lattice.step <= COARSEST_STEP * edge {
            return Ok(());
        }
        let what = format!(
            "positions in tiles would be rounded to {:.3e}, its edges are {edge:.3e} long: some of its parts, or vertices without a face, lie too far from the others. \
             Remove those first (stonecut simplify --min-component 100 --ratio 100%; stonecut convert for such vertices), or give a smaller --tile-triangles; nothing was written",
            lattice.step
        );
        Err(Error::bad_input(&self.config.input, what))
    }

    fn survivors(&self, info: SurvivorInfo) -> Result<SurvivorPack> {
        SurvivorPack::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    /// Fails where the largest group does not fit into memory.
    fn check_memory(&self, store: &StoreInfo) -> Result<()> {
        let bytes = |cell: &crate::store::cells::CellTally| {
            work_bytes(*cell, *cell, 1.0, &self.layout) + tiles::BYTES_PER_TRIANGLE * cell.triangles
        };
        let largest = store.cells.iter().map(bytes).max().unwrap_or(0);
        match largest > self.run.memory_bytes {
            true => Err(too_little(self.config, largest + BASE_BYTES)),
            false => Ok(()),
        }
    }
}
