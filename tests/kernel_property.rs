//! What the kernel promises, on small nasty meshes from seeds, and on those that once broke it.
//!
//! The generator, the promises and the search for the smallest mesh are in `tools/fuzz/kernel`, which the fuzz
//! target and the program `soak` share.

#[path = "../tools/fuzz/kernel/mod.rs"]
mod kernel;

use kernel::case::Case;
use kernel::judge::Depth;
use stonecut::kernel::{Options, Topology};
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
