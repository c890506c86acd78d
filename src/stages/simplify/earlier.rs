//! Cells that come out as in an earlier attempt at the same round: taken over from what that has left.
//!
//! An attempt at a bound differs from the one before by a few balls in which it is tighter. What the kernel makes of a cell
//! depends on the cell and on the balls that meet it: where both are the same, so is the result.

use super::cell_run::CellRun;
use stonecut_kernel::{Options, Tight};
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    CellMesh, CellTally, SurvivorFile, SurvivorInfo, SurvivorPack, Survivors, VertexLayout,
};
use xxhash_rust::xxh3::Xxh3;

/// Survivors of the earlier attempt, if there are any.
pub(super) struct Earlier(Option<SurvivorPack>);

impl Earlier {
    /// Opens what an earlier attempt at this round has left.
    pub(super) fn open(round: &CellRun) -> Earlier {
        let (run, layout) = (round.context, round.store.layout());
        let pack = run.job.name(&format!("round-{}-trial.survivors", round.goal.round));
        let length = std::fs::metadata(run.job.folder().join(&pack)).map(|meta| meta.len());
        let Ok(pack_bytes) = length else { return Earlier(None) };
        let packs = vec![SurvivorFile { pack, pack_bytes, first_cell: CellId(0) }];
        let cells = vec![CellTally::default(); round.store.n_cells()];
        let info = SurvivorInfo { packs, cells, ..SurvivorInfo::default() };
        Earlier(SurvivorPack::open(run.disk(), run.job.folder(), info, layout.clone()).ok())
    }

    /// The survivors of a cell that had the same key. What cannot be read is made again.
    pub(super) fn take(&self, cell: CellId, key: &str) -> Option<Survivors> {
        let left = self.0.as_ref()?.load(cell).ok()?;
        (left.statistics.key == key).then_some(left)
    }
}

/// A digest of everything that a cell's result depends on within one job.
pub(super) fn key(cell: &CellMesh, layout: &VertexLayout, options: &Options) -> String {
    let CellMesh { ids, records, shared, mesh, dropped: _ } = cell;
    let mut digest = Xxh3::new();
    for n in [ids.len(), mesh.triangles.len()] {
        digest.update(&n.to_le_bytes());
    }
    ids.iter().for_each(|id| digest.update(&id.0.to_le_bytes()));
    digest.update(records);
    shared.iter().for_each(|&shared| digest.update(&[u8::from(shared)]));
    mesh.channels.iter().for_each(|x| digest.update(&x.to_le_bytes()));
    let mut row = Vec::new();
    for (i, t) in mesh.triangles.iter().enumerate() {
        row.clear();
        t.iter().for_each(|v| row.extend_from_slice(&v.to_le_bytes()));
        layout.push_original(mesh, i, &mut row);
        digest.update(&row);
    }
    let mut number = |x: f64| digest.update(&x.to_le_bytes());
    number(options.bound.map_or(0.0, |bound| bound.distance));
    for Tight { place, radius, margin } in balls_that_meet(cell, &options.tight) {
        place.iter().chain([radius, margin]).for_each(|&x| number(x));
    }
    format!("{:032x}", digest.digest128())
}

/// The balls that hold a vertex of a cell, or may hold a point of the original that goes with one of its triangles.
fn balls_that_meet<'a>(cell: &CellMesh, balls: &'a [Tight]) -> impl Iterator<Item = &'a Tight> {
    let mesh = &cell.mesh;
    // Points of the original are given from a corner on.
    let mut reach = vec![0.0f64; mesh.positions.len()];
    for (t, extremes) in mesh.triangles.iter().zip(&mesh.extremes) {
        let far_sq = extremes.offsets().map(|offset| length_sq(offset.map(f64::from)));
        let far = far_sq.fold(0.0, f64::max).sqrt() * (1.0 + 1e-6);
        t.iter().for_each(|&v| reach[v as usize] = reach[v as usize].max(far));
    }
    balls.iter().filter(move |ball| {
        mesh.positions.iter().zip(&reach).any(|(&at, reach)| {
            let near = ball.radius + reach;
            length_sq(sub(at, ball.place)) <= near * near
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use stonecut_kernel::Bound;
    use stonecut_mesh::Mesh;
    use stonecut_mesh::extremes::Extremes;
    use stonecut_mesh::global_vertex::GlobalVertex;
    use stonecut_mesh::property::Scalar;
    use stonecut_mesh::record::VertexSchema;

    #[test]
    fn a_key_depends_on_the_cell_and_the_balls_that_meet_it() {
        // 2
        // |\     a point of the original beyond it: x at (3, 0, 0)
        // 0-1
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mut mesh = Mesh::new(positions, vec![[0, 1, 2]]);
        mesh.extremes = vec![Extremes::new(&[[3.0, 0.0, 0.0]])];
        let cell = CellMesh {
            ids: (0..3).map(GlobalVertex).collect(),
            records: vec![7; 36],
            shared: vec![false; 3],
            mesh,
            ..CellMesh::default()
        };
        let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let layout = VertexLayout { has_reach: true, ..VertexLayout::new(&schema, 3) };
        let ball = |x: f64| Tight { place: [x, 0.0, 0.0], radius: 0.5, margin: 0.1 };
        let key_of = |cell: &CellMesh, distance: f64, balls: &[Tight]| {
            let bound = Some(Bound { distance, channel: None, patience: 1.0 });
            let tight = Arc::from(balls);
            key(cell, &layout, &Options { bound, tight, ..Options::default() })
        };
        let plain = key_of(&cell, 1.0, &[]);
        assert_eq!(plain, key_of(&cell, 1.0, &[ball(9.0), ball(-4.0)]));
        assert_ne!(plain, key_of(&cell, 0.9, &[]));
        for x in [0.0, 1.4, 3.0] {
            assert_ne!(plain, key_of(&cell, 1.0, &[ball(9.0), ball(x)]), "{x}");
        }
        let change = |change: &dyn Fn(&mut CellMesh)| {
            let mut other = cell.clone();
            change(&mut other);
            assert_ne!(plain, key_of(&other, 1.0, &[]));
        };
        change(&|cell| cell.shared[1] = true);
        change(&|cell| cell.records[5] = 8);
        change(&|cell| cell.ids[2] = GlobalVertex(9));
        change(&|cell| cell.mesh.triangles[0] = [1, 2, 0]);
        change(&|cell| cell.mesh.extremes[0] = Extremes::default());
    }
}
