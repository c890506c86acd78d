//! Pieces that lie far from all others: they cost the rest nothing.

use crate::dirty::{append, run, sheet};
use stonecut::Mesh;
use stonecut::kernel::{Bound, Options, Stop, Topology, simplify_mesh};

/// A round bump of 40 m in coordinates of UTM as `f32` holds them, and a stray triangle at the origin: rounding of what lies far away says
/// nothing of the bump.
fn far_from_a_stray() -> Mesh {
    let n = 80;
    let mut mesh = sheet(n, |_, _| false);
    for p in &mut mesh.positions {
        let (u, v) = (p[0] - 0.5, p[1] - 0.5);
        let z = 40.0 * (1.0 - 2.0 * (u * u + v * v));
        *p = [500_000.0 + 160.0 * p[0], 5_000_000.0 + 160.0 * p[1], z].map(|x| f64::from(x as f32));
    }
    let stray = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    append(&mut mesh, &stray, 1.0, [0.0; 3]);
    mesh
}

#[test]
fn a_stray_far_away_does_not_flatten_the_rest() {
    let mesh = far_from_a_stray();
    let result = run(&mesh, 1200, Topology::Error).mesh;
    for p in result.positions.iter().filter(|p| p[0] > 1000.0) {
        let (u, v) = ((p[0] - 500_000.0) / 160.0 - 0.5, (p[1] - 5_000_000.0) / 160.0 - 0.5);
        let off = p[2] - 40.0 * (1.0 - 2.0 * (u * u + v * v));
        assert!(off.abs() < 1.0 && u.abs() < 0.51 && v.abs() < 0.51, "{p:?} is {off} away");
    }
}

#[test]
fn a_stray_far_away_leaves_the_bound_to_the_rest() {
    let mesh = far_from_a_stray();
    let bound = Some(Bound { distance: 1.0, channel: None, patience: 1.0 });
    let options = Options { stop: Stop::Triangles(0), bound, ..Options::default() };
    let n = mesh.positions.len();
    let left = simplify_mesh(mesh, &vec![false; n], &options).mesh.triangles.len();
    assert!(left < 1000, "{left}");
}
