//! What the kernel promises, on small nasty meshes from seeds, and on those that once broke it.
//!
//! The generator, the promises and the search for the smallest mesh are in `tools/fuzz/kernel`, which the fuzz
//! target and the program `soak` share.

#[path = "../../tools/fuzz/kernel/mod.rs"]
mod kernel;

use kernel::case::Case;
use kernel::choices::Choices;
use kernel::judge::Depth;
use kernel::shrink::shrink;
use stonecut::kernel::{Fit, Options, Placement, Stop, Topology, simplify_mesh};
use stonecut::mesh::Mesh;

/// Judges a mesh that once broke a promise.
fn holds(case: &Case) {
    if let Err(fault) = kernel::verdict(case, Depth::AllRuns) {
        panic!("{}: {}", fault.kind, fault.detail);
    }
}

fn free(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>, options: Options) -> Case {
    let locked = vec![false; positions.len()];
    Case { mesh: Mesh::new(positions, triangles), locked, options }
}

#[test]
fn a_vertex_that_cleaning_left_alone_is_not_joined_with() {
    // 4 lies on the edge from 3 to 5: that triangle goes, and with it 5, which is in the place of 1.
    let positions = vec![
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [3.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
    ];
    let triangles = [[3, 5, 4], [1, 2, 0]];
    for lowest in [0, 4] {
        let mut positions = positions.clone();
        positions.rotate_left(lowest);
        let n = positions.len() as u32;
        let moved = |v: u32| (v + n - lowest as u32) % n;
        let triangles = triangles.iter().map(|t: &[u32; 3]| t.map(moved)).collect();
        let options = Options { topology: Topology::Keep, ..Options::default() };
        holds(&free(positions, triangles, options));
    }
}

#[test]
fn small_nasty_meshes_break_no_promise() {
    for seed in 0..1500 {
        let case = Case::new(&mut Choices::from_seed(seed));
        if let Err(fault) = kernel::verdict(&case, Depth::AllRuns) {
            let least = shrink(&case, &fault.kind);
            panic!("seed {seed}: {}: {}\n{least:?}", fault.kind, fault.detail);
        }
    }
}

fn keep(triangles: u64) -> Options {
    let stop = Stop::Triangles(triangles);
    Options { stop, topology: Topology::Keep, fit: Fit::Off, ..Options::default() }
}

#[test]
fn a_locked_vertex_keeps_its_last_triangle() {
    // Without area, and open: 2 is on the edge from 0 to 1.
    let positions = vec![[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    let mut flat = free(positions, vec![[0, 1, 2]], keep(u64::MAX));
    flat.locked[2] = true;
    holds(&flat);
    // Two triangles that are joined in one vertex, 0 and 3: what is left of the second is 4, which is locked.
    let positions = vec![
        [0.0; 3],
        [-1.0, 0.0, 0.0],
        [-1.0, 1.0, 0.0],
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [1.0, 0.5, 0.0],
    ];
    let mut ear = free(positions, vec![[0, 1, 2], [3, 4, 5]], keep(1));
    ear.locked[4] = true;
    holds(&ear);
}

#[test]
fn the_last_edge_between_two_vertices_does_not_fold_away() {
    // Three ears around a hole 1 2 3 that has no triangle: 5 must not go into 1 or 3.
    let positions = vec![
        [0.0, 0.0, 0.0],
        [0.0, 5.0, 0.0],
        [0.0, 0.0, 0.0001],
        [0.0, 7.0, 0.0],
        [0.0, 8.0, 0.0],
        [0.0, 0.0, 0.00005],
    ];
    holds(&free(positions, vec![[0, 2, 1], [1, 5, 3], [2, 4, 3]], keep(0)));
}

#[test]
fn weights_that_round_to_nothing_make_no_values() {
    let positions =
        vec![[0.0; 3], [0.0; 3], [0.0; 3], [0.0, 2.75e30, 0.0], [0.0, 0.0, 2.5e29], [0.0; 3]];
    let triangles = vec![[0, 2, 4], [1, 4, 2], [0, 4, 3], [0, 3, 5]];
    let stop = Stop::Triangles(3);
    let options = Options { stop, weights: vec![1e-20], ..Options::default() };
    let mut case = free(positions, triangles, options);
    (case.mesh.n_channels, case.mesh.channels) = (1, vec![0.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    holds(&case);
}

#[test]
fn bridges_of_a_gap_repeat_no_edge() {
    let positions = vec![
        [0.0; 3],
        [0.0; 3],
        [0.0, 2.0, 1.0],
        [0.0; 3],
        [0.0, 2.0, 1.0078125],
        [0.0; 3],
        [0.0, 2.0, 1.015625],
        [0.0, 2.0, 1.0],
    ];
    let triangles = vec![[4, 0, 3], [6, 7, 3], [0, 4, 1], [2, 5, 6]];
    let options = Options { merge_distance: 1.0, ..Options::default() };
    let mut case = free(positions, triangles, options);
    case.locked[1] = true;
    holds(&case);
}

#[test]
fn triangles_without_area_that_hold_a_fan_together_stay() {
    let positions =
        vec![[0.0; 3], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [0.0, 0.0, 1.0]];
    let triangles = vec![[0, 2, 3], [0, 3, 1], [1, 3, 4]];
    let options = Options { placement: Placement::Subset, ..Options::default() };
    holds(&free(positions, triangles, options));
    let (x, y) = (-998e12, -997_968_979_492_188.0);
    let positions = vec![[0.0; 3], [x, 0.0, 0.0], [y, 0.0, 0.0], [x, 0.0, 0.0], [0.0, 1e15, 1e15]];
    let triangles = vec![[0, 2, 3], [0, 3, 1], [4, 2, 0]];
    holds(&free(positions, triangles, Options::default()));
}

#[test]
fn levels_beyond_f32_let_everything_out() {
    // So small that a threshold of 1e-3 is beyond f32 in scaled units.
    let positions = vec![[0.0; 3], [0.0; 3], [0.0; 3], [0.0, 0.0, 3e-9]];
    let stop = Stop::CloseCosts(vec![1e-9, 1e-6, 1e-3]);
    let options = Options { stop, placement: Placement::Subset, ..keep(0) };
    let case = free(positions, vec![[0, 2, 3], [0, 3, 1]], options);
    holds(&case);
    let result = simplify_mesh(case.mesh, &case.locked, &case.options);
    assert_eq!(result.statistics.level_counts, [1, 1, 1]);
}

#[test]
fn a_locked_vertex_stays_where_two_sheets_lie_on_each_other() {
    let positions = vec![
        [3.0, 3.0, 3.0],
        [3.0, 0.0, 3.0],
        [2.0, 0.0, 4.0],
        [2.0, 0.0, 4.0],
        [3.0, 3.0, 3.0],
        [3.0, 0.0, 3.0],
        [3.0, 3.0, 1.0],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 2.0],
        [0.0, 0.0, 1.0],
        [3.0, 3.0, 1.0],
    ];
    let triangles = vec![[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]];
    for confined in [vec![], vec![true]] {
        let mut mesh = Mesh::new(positions.clone(), triangles.clone());
        mesh.n_channels = 1;
        mesh.channels = vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0];
        let mut locked = vec![false; 12];
        locked[2] = true;
        let options = Options { stop: Stop::Triangles(36), confined, ..Options::default() };
        holds(&Case { mesh, locked, options });
    }
}
