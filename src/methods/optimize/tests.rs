//! The optimisation on meshes made for it.

use super::*;
use stonecut_mesh::topology_counts::of_triangles;
use stonecut_mesh::vec3::{length_sq, sub, unit};

/// Points of the unit sphere, evenly spread.
fn sphere_samples(n: u32) -> Vec<Sample> {
    let at = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
        let (sin, cos) = (2.399_963_229_728_653 * f64::from(i)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    };
    (0..n).map(|i| Sample::new(at(i), at(i), 4.0 * std::f64::consts::PI / f64::from(n))).collect()
}

/// A sphere of meridians and parallels, its vertices off their places by as much as `noise`.
fn sphere(n: u32, noise: f64) -> Mesh {
    let mut positions = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let mut triangles = Vec::new();
    let at = |i: u32, k: u32| 2 + i * n + k % n;
    let mut random = 1u32;
    let mut next = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(random >> 8) / f64::from(1 << 24) - 0.5
    };
    for i in 0..n {
        let (sin, z) = (std::f64::consts::PI * f64::from(i + 1) / f64::from(n + 1)).sin_cos();
        for k in 0..n {
            let (y, x) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
            positions.push([sin * x, sin * y, z].map(|x| x + noise * next()));
        }
    }
    for k in 0..n {
        triangles.push([0, at(0, k), at(0, k + 1)]);
        triangles.push([1, at(n - 1, k + 1), at(n - 1, k)]);
        for i in 0..n - 1 {
            triangles.push([at(i, k), at(i + 1, k), at(i + 1, k + 1)]);
            triangles.push([at(i, k), at(i + 1, k + 1), at(i, k + 1)]);
        }
    }
    Mesh::new(positions, triangles)
}

fn optimized(
    mesh: &Mesh,
    samples: Vec<Sample>,
    sweeps: u32,
    threads: usize,
) -> (Mesh, OptimizeOutcome) {
    let mut mesh = mesh.clone();
    let progress = Progress::default();
    let settings = Settings { sweeps, threads, progress: &progress };
    let outcome = optimize(&mut mesh, &mut Vec::new(), samples, settings).unwrap();
    (mesh, outcome)
}

#[test]
fn a_rough_sphere_becomes_round_and_stays_a_sphere() {
    let rough = sphere(16, 0.06);
    let centre = centre(&rough);
    let samples: Vec<Sample> = sphere_samples(20_000)
        .iter()
        .map(|s| Sample::new(sub(s.at(), centre), s.normal(), s.weight()))
        .collect();
    let (mesh, outcome) = optimized(&rough, samples.clone(), 4, 1);
    assert!(outcome.rms_after < 0.35 * outcome.rms_before, "{outcome:?}");
    assert!(outcome.splits > 0 && outcome.splits == outcome.collapses, "{outcome:?}");
    assert!(outcome.swaps > 0 && outcome.relocations > 100, "{outcome:?}");
    assert_eq!(mesh.triangles.len(), rough.triangles.len());
    let topology = of_triangles(mesh.positions.len(), &mesh.triangles);
    assert_eq!(topology, of_triangles(rough.positions.len(), &rough.triangles));
    // Poles are crowded with vertices that others have more use for.
    for t in 0..mesh.triangles.len() {
        let corners = mesh.corners(t);
        let middle = stonecut_measure::triangle::point_at(&corners, [1.0 / 3.0; 3]);
        let n = unit(stonecut_measure::triangle::area_normal(&corners)).unwrap();
        assert!(stonecut_mesh::vec3::dot(n, unit(middle).unwrap()) > 0.5, "{corners:?}");
    }
    for threads in [2, 5] {
        assert!(optimized(&rough, samples.clone(), 4, threads) == (mesh.clone(), outcome.clone()));
    }
}

//   3---2     the ridge of the samples runs from 0 to 2,
//   | \ |     the edge of the mesh from 1 to 3: they swap
//   0---1
#[test]
fn an_edge_across_a_ridge_is_swapped() {
    let height = |x: f64, y: f64| -0.3 * (x - y).abs();
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    // The quad has others around it, so that its corners are inside.
    for (y, x) in (0..4).flat_map(|y| (0..4).map(move |x| (f64::from(y), f64::from(x)))) {
        positions.push([x, y, height(x, y)]);
    }
    for (y, x) in (0..3u32).flat_map(|y| (0..3).map(move |x| (y, x))) {
        let [a, b, c, d] = [4 * y + x, 4 * y + x + 1, 4 * y + x + 5, 4 * y + x + 4];
        match x == y {
            true => triangles.extend([[a, b, d], [b, c, d]]),
            false => triangles.extend([[a, b, c], [a, c, d]]),
        }
    }
    let mesh = Mesh::new(positions, triangles);
    let centre = centre(&mesh);
    let grid = (0..90).flat_map(|y| (0..90).map(move |x| (f64::from(x), f64::from(y))));
    let samples = grid.map(|(x, y)| {
        let (x, y) = ((x + 0.5) / 30.0, (y + 0.5) / 30.0);
        Sample::new(sub([x, y, height(x, y)], centre), [0.0, 0.0, 1.0], 1.0)
    });
    let (after, outcome) = optimized(&mesh, samples.collect(), 1, 1);
    assert!(outcome.swaps >= 3, "{outcome:?}");
    assert!(outcome.rms_after < 0.01 * outcome.rms_before, "{outcome:?}");
    let has_edge =
        |a: u32, b: u32| after.triangles.iter().any(|t| t.contains(&a) && t.contains(&b));
    assert!(has_edge(5, 10) && !has_edge(6, 9));
    // The rim has not moved.
    for v in [0, 1, 2, 3, 4, 7, 8, 11, 12, 13, 14, 15] {
        assert_eq!(after.positions[v], mesh.positions[v]);
    }
}

#[test]
fn nothing_is_done_without_samples_near() {
    let mesh = sphere(8, 0.02);
    let far = sphere_samples(100)
        .into_iter()
        .map(|s| Sample::new(s.at().map(|x| 9.0 * x), s.normal(), 1.0));
    let (after, outcome) = optimized(&mesh, far.collect(), 3, 1);
    assert_eq!(outcome.samples_apart, 100);
    assert!(after == mesh && outcome.sweeps == 0);
    let empty = Mesh::default();
    assert!(optimized(&empty, Vec::new(), 2, 1).0 == empty);
}

#[test]
fn what_is_not_a_fan_stays() {
    // Two tetrahedra that share vertex 0.
    let mut positions = vec![[0.0; 3]];
    for s in [1.0, -1.0] {
        positions.extend([[s, 0.0, 0.0], [s, s, 0.0], [s, 0.0, s]]);
    }
    let tetrahedron = |i: u32| [[0, i, i + 1], [0, i + 1, i + 2], [0, i + 2, i], [i, i + 2, i + 1]];
    let triangles = [tetrahedron(1), tetrahedron(4)].concat();
    let mesh = Mesh::new(positions, triangles);
    let centre = centre(&mesh);
    let samples = (0..400).map(|i| {
        let mesh = &mesh;
        let corners = mesh.corners(i % 8);
        let (u, v) = ((i / 8) as f64 / 50.0, (i * 7 % 50) as f64 / 50.0);
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let at = stonecut_measure::triangle::point_at(&corners, [1.0 - u - v, u, v]);
        let n = unit(stonecut_measure::triangle::area_normal(&corners)).unwrap();
        Sample::new(sub(at.map(|x| 1.02 * x), centre), n, 1.0)
    });
    let (after, _) = optimized(&mesh, samples.collect(), 2, 1);
    assert_eq!(after.positions[0], mesh.positions[0]);
    assert_eq!(after.triangles.len(), 8);
    assert!(after.positions.iter().all(|&p| length_sq(p) < 4.0));
}
