//! Under `--no-self-intersections` nothing passes through itself that did not, in one cell and in many.

use crate::common::{expect, one_in, run, scratch, write_ply};
use stonecut::kernel::{Fit, Options, Stop, simplify_mesh};
use stonecut::measure::intersections::in_memory;
use stonecut::mesh::Mesh;
use stonecut::mesh::property::Scalar;
use stonecut::system::progress::Progress;

/// Two sheets of n by n squares, so rough that each fills its layer, and hardly apart.
fn sheets(n: u32, seed: u64) -> Mesh {
    let mut state = seed;
    let mut roll = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as f32 / (1u32 << 24) as f32
    };
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for sheet in 0..2 {
        let first = positions.len() as u32;
        for y in 0..=n {
            for x in 0..=n {
                let height = 1.02 * sheet as f32 + roll();
                positions.push([f64::from(x), f64::from(y), f64::from(height)]);
            }
        }
        for y in 0..n {
            for x in 0..n {
                let at = |dx, dy| first + (y + dy) * (n + 1) + x + dx;
                triangles.push([at(0, 0), at(1, 0), at(1, 1)]);
                triangles.push([at(0, 0), at(1, 1), at(0, 1)]);
            }
        }
    }
    Mesh::new(positions, triangles)
}

fn pairs(mesh: &Mesh) -> u64 {
    in_memory(mesh, 1, &Progress::default()).unwrap().self_intersections
}

#[test]
fn the_kernel_makes_no_new_pair() {
    let mut n_plain = 0;
    for seed in (1..6).step_by(one_in(2)) {
        let mesh = sheets(60, seed);
        assert_eq!(pairs(&mesh), 0);
        for (target, fit) in [(6000, Fit::Off), (2000, Fit::On), (300, Fit::On)] {
            let options = Options { stop: Stop::Triangles(target), fit, ..Options::default() };
            let locked = vec![false; mesh.positions.len()];
            n_plain += pairs(&simplify_mesh(mesh.clone(), &locked, &options).mesh);
            let watched = Options { no_self_intersections: true, ..options };
            let result = simplify_mesh(mesh.clone(), &locked, &watched);
            assert_eq!(pairs(&result.mesh), 0, "seed {seed}, {target} triangles");
            assert!(result.statistics.reached, "seed {seed}, {target} triangles");
        }
    }
    assert!(n_plain > 30, "a plain run makes {n_plain}");
}

#[test]
fn what_was_there_may_stay_but_not_grow() {
    // The upper sheet hangs through the lower one.
    let mut mesh = sheets(40, 9);
    let half = mesh.positions.len() / 2;
    mesh.positions[half..].iter_mut().for_each(|p| p[2] -= 0.4);
    let before = pairs(&mesh);
    assert!(before > 100);
    let options =
        Options { stop: Stop::Triangles(2000), no_self_intersections: true, ..Options::default() };
    let locked = vec![false; mesh.positions.len()];
    let result = simplify_mesh(mesh, &locked, &options);
    assert!(pairs(&result.mesh) <= before);
    assert!(result.statistics.reached);
}

#[test]
fn cells_make_none_either_and_threads_do_not_show() {
    let at = &scratch();
    let mesh = sheets(100, 4);
    write_ply(&at.join("in.ply"), Scalar::F32, &mesh.positions, &mesh.triangles);
    let options = "--ratio 5% --cell-triangles 2000 --no-self-intersections";
    for threads in [1, 3] {
        expect(at, &format!("simplify in.ply out{threads}.ply {options} --threads {threads}"), 0);
    }
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(bytes("out1.ply") == bytes("out3.ply"));
    let info = run(at, "info out1.ply --check --self-intersections --json");
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["self_intersections"], 0);
    expect(at, "simplify in.ply no.ply --ratio 5% --method cluster --no-self-intersections", 2);
}
