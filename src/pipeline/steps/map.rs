//! The map of `--map`: composed in the job folder before the result is written, named after that.

use super::SimplifyRun;
use crate::error::Result;
use crate::io::ply::Place;
use crate::stages::write::{self, MapCounts};
use crate::store::cells::{SurvivorInfo, SurvivorPack};
use crate::system::units::show_count;

impl SimplifyRun<'_> {
    /// Keeps the origins of a round or a finish, if a map is asked for.
    pub(super) fn pass(&mut self, left: &SurvivorInfo) {
        if self.config.map.is_some() {
            self.passed.push(left.clone());
        }
    }

    /// Composes the map of the result at work.
    pub(super) fn compose_map(&mut self) -> Result<()> {
        if self.config.map.is_none() {
            return Ok(());
        }
        let (source, infos, layout) = (&self.prepared.source, &self.passed, &self.layout);
        let counts: MapCounts = self.stages.stage(
            ("map", "map"),
            source.n_triangles(),
            |_| source.n_triangles(),
            |run| {
                let open = |info: &SurvivorInfo| {
                    SurvivorPack::open(run.disk(), run.job.folder(), info.clone(), layout.clone())
                };
                let packs = infos.iter().map(open).collect::<Result<Vec<_>>>()?;
                let (path, disk) = (run.job.path(write::MAP), run.disk().clone());
                write::write_map(&packs, source, Place { path, disk, replace: true }, run)
            },
        )?;
        let MapCounts { input, gone, result, new } = counts;
        self.run.progress.note(format!(
            "map: {} of {} vertices of the input became none, {} of {} of the result are new",
            show_count(gone),
            show_count(input),
            show_count(new),
            show_count(result)
        ));
        Ok(())
    }
}
