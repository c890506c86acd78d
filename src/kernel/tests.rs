//! Tests of the kernel as a whole.

use super::*;
use crate::run::run;
use stonecut_mesh::{Mesh, vec3};

/// A bumpy sheet of 2 n^2 triangles.
pub(super) fn sheet(n: usize) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
            let z = 0.1 * (9.0 * x).sin() * (7.0 * y).cos() + 0.01 * (61.0 * x * y).sin();
            mesh.positions.push([x + 1e5, y - 3e4, z]);
        }
    }
    let at = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    for i in 0..n {
        for j in 0..n {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

#[test]
fn portable_lanes_give_the_same_bytes() {
    // Large enough for levels of blocks.
    let mesh = sheet(260);
    let locked = vec![false; mesh.positions.len()];
    for target in [60_000, 3_000] {
        let (stop, fit) = (Stop::Triangles(target), Fit::On);
        let options = Options { stop, fit, ..Options::default() };
        let portable = run(mesh.clone(), &locked, &options, simd::Simd::Portable);
        let fastest = run(mesh.clone(), &locked, &options, simd::Simd::detect());
        assert_eq!(portable, fastest);
        assert!(portable.statistics.reached);
    }
}

#[test]
fn a_prefix_of_close_levels_gives_the_same_counts() {
    let mesh = sheet(90);
    let locked = vec![false; mesh.positions.len()];
    let levels: Vec<f64> = (0..20).map(|k| 1e-12 * 1.5f64.powi(k)).collect();
    let counts = |n: usize| {
        let options =
            Options { stop: Stop::CloseCosts(levels[..n].to_vec()), ..Options::default() };
        let result = simplify_mesh(mesh.clone(), &locked, &options);
        let counts = result.statistics.level_counts;
        assert_eq!(counts.last(), Some(&(result.mesh.triangles.len() as u64)));
        counts
    };
    let all = counts(levels.len());
    assert!(all[0] > 3 * all[19] / 2, "the levels do something: {all:?}");
    assert_eq!(counts(7), all[..7]);
}

#[test]
fn close_levels_may_be_taken_one_at_a_time() {
    let mesh = sheet(90);
    let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v % 11 == 0).collect();
    let levels: Vec<f64> = (0..20).map(|k| 1e-12 * 1.5f64.powi(k)).collect();
    for (fit, expected_share) in [(Fit::Off, 0.0), (Fit::On, 0.3)] {
        let of = |stop| Options { stop, fit, expected_share, ..Options::default() };
        let options = of(Stop::Triangles(0));
        let mut way = CloseLevels::new(mesh.clone(), &locked, &options, levels.clone());
        [5, 5, 6, 13].into_iter().for_each(|n| way.take(n));
        assert_eq!(way.counts().len(), 13);
        assert!(way.bytes() > 40 * mesh.triangles.len() as u64, "{}", way.bytes());
        let at_once =
            simplify_mesh(mesh.clone(), &locked, &of(Stop::CloseCosts(levels[..13].to_vec())));
        assert_eq!(way.finish(), at_once);
        assert!(at_once.mesh.triangles.len() < mesh.triangles.len() - 1000);
    }
}

/// A sheet and a tetrahedron, far smaller than the error will be, so high above its middle.
fn sheet_and_speck(height: f64) -> (Mesh, u32) {
    let mut mesh = sheet(40);
    let first = mesh.positions.len() as u32;
    let [x, y, z] = mesh.positions[20 * 41 + 20];
    let (z, e) = (z + height, 1e-4);
    mesh.positions.extend([[x, y, z], [x + e, y, z], [x, y + e, z], [x, y, z + e]]);
    let corners = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    mesh.triangles.extend(corners.map(|t: [u32; 3]| t.map(|v| v + first)));
    (mesh, first)
}

fn specks_left(mesh: Mesh, locked: &[bool], first: u32, options: &Options) -> usize {
    let result = simplify_mesh(mesh, locked, options);
    result.source.iter().filter(|&&v| v >= first).count()
}

#[test]
fn specks_vanish_only_if_asked() {
    let (mesh, first) = sheet_and_speck(1e-3);
    let mut locked = vec![false; mesh.positions.len()];
    for (topology, left) in [(Topology::Keep, 4), (Topology::Error, 0)] {
        let options = Options { stop: Stop::Triangles(300), topology, ..Options::default() };
        assert_eq!(specks_left(mesh.clone(), &locked, first, &options), left);
    }
    locked[first as usize] = true;
    let options = Options { stop: Stop::Triangles(300), ..Options::default() };
    let left = specks_left(mesh, &locked, first, &options);
    assert_eq!(left, 4, "a locked vertex holds it");
}

#[test]
fn specks_far_from_everything_stay_until_the_error_is_as_large() {
    let (mesh, first) = sheet_and_speck(0.2);
    let locked = vec![false; mesh.positions.len()];
    for (target, left) in [(300, 4), (4, 0)] {
        let options = Options { stop: Stop::Triangles(target), ..Options::default() };
        assert_eq!(specks_left(mesh.clone(), &locked, first, &options), left, "{target}");
    }
}

/// A disk whose rim is joined to itself by eight bands, each with its opposite side: no collapse takes it below 32 triangles,
/// since every edge inside joins two places of the rim.
fn banded_disk(mesh: &mut Mesh, centre: [f64; 3], radius: f64) {
    const N: u32 = 32;
    let first = mesh.positions.len() as u32;
    mesh.positions.push(centre);
    for i in 0..N {
        let angle = f64::from(i) * std::f64::consts::TAU / f64::from(N);
        let (x, y) = (radius * angle.cos(), radius * angle.sin());
        mesh.positions.push([centre[0] + x, centre[1] + y, centre[2]]);
    }
    let rim = |i: u32| first + 1 + i % N;
    mesh.triangles.extend((0..N).map(|i| [first, rim(i), rim(i + 1)]));
    for slot in (0..N / 2).step_by(2) {
        let [a, b] = [rim(slot), rim(slot + 1)];
        let [c, d] = [rim(slot + N / 2), rim(slot + N / 2 + 1)];
        mesh.triangles.extend([[b, a, d], [b, d, c]]);
    }
}

#[test]
fn what_collapses_are_stuck_on_vanishes_before_a_large_floor() {
    let mut mesh = sheet(40);
    let first = mesh.positions.len() as u32;
    for x in [0.2, 0.4, 0.6, 0.8] {
        banded_disk(&mut mesh, [x, 0.5, 0.3], 0.02);
    }
    let locked = vec![false; mesh.positions.len()];
    for (target, of_disks) in [(300, true), (20, false)] {
        let options = Options { stop: Stop::Triangles(target), ..Options::default() };
        let result = simplify_mesh(mesh.clone(), &locked, &options);
        assert!(result.mesh.triangles.len() as u64 <= target, "{target}");
        assert_eq!(result.source.iter().any(|&v| v >= first), of_disks, "{target}");
        assert!(result.source.iter().any(|&v| v < first), "{target}: the floor stays");
    }
}

#[test]
fn the_rim_of_a_thin_sheet_does_not_recede() {
    // A pillow: two sheets, next to nothing apart, with a common rim.
    let n = 40;
    let mut mesh = Mesh::default();
    let mut id = std::collections::BTreeMap::new();
    for side in [0usize, 1] {
        let mut vertex = |i: usize, j: usize| {
            let is_rim = i == 0 || j == 0 || i == n || j == n;
            let key = (i, j, if is_rim { 0 } else { side });
            *id.entry(key).or_insert_with(|| {
                let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
                let z = 0.05 * (5.0 * x).sin() * (4.0 * y).cos() + 1e-6 * key.2 as f64;
                mesh.positions.push([x, y, z]);
                mesh.positions.len() as u32 - 1
            })
        };
        for i in 0..n {
            for j in 0..n {
                let q = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                for t in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
                    mesh.triangles.push(if side == 0 { [t[0], t[2], t[1]] } else { t });
                }
            }
        }
    }
    let locked = vec![false; mesh.positions.len()];
    let options = Options { stop: Stop::Triangles(300), ..Options::default() };
    let result = simplify_mesh(mesh, &locked, &options).mesh;
    for axis in 0..2 {
        let along = || result.positions.iter().map(|p| p[axis]);
        let (low, high) = (along().fold(1.0, f64::min), along().fold(0.0, f64::max));
        assert!(low.abs() < 0.01 && (high - 1.0).abs() < 0.01, "{low} to {high}");
    }
    // Nearly all of both sheets is left.
    let area = |t: &[u32; 3]| {
        let corners = t.map(|v| result.positions[v as usize]);
        0.5 * vec3::length_sq(vec3::normal(corners)).sqrt()
    };
    let total: f64 = result.triangles.iter().map(area).sum();
    assert!(total > 1.98, "{total}");
}

#[test]
fn charts_that_touch_are_joined_unless_locked() {
    // Each row of quads is a separate chart, as if split along texture seams.
    let whole = sheet(24);
    let mut split = Mesh::default();
    for row in whole.triangles.chunks(2 * 24) {
        let first = split.positions.len() as u32;
        let lowest = row.iter().flatten().min().copied().unwrap_or(0);
        let n = 2 * 25;
        split.positions.extend_from_slice(&whole.positions[lowest as usize..][..n]);
        split.triangles.extend(row.iter().map(|t| t.map(|v| v - lowest + first)));
    }
    for lock in [false, true] {
        let locked = vec![lock; split.positions.len()];
        let options = Options { stop: Stop::Triangles(2000), ..Options::default() };
        let result = simplify_mesh(split.clone(), &locked, &options);
        let expected = if lock { split.positions.len() } else { whole.positions.len() };
        assert_eq!(result.source.len(), expected);
    }
}

#[test]
fn a_lock_presses_the_rest_no_more_than_the_count_asks() {
    // Blocks on the left are locked, and the first one is what a level's threshold comes from.
    let mesh = sheet(150);
    let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v < 151 * 30).collect();
    let run = |target: u64| {
        let stop = Stop::Triangles(target);
        let options = Options { stop, fit: Fit::Off, estimate: true, ..Options::default() };
        let result = simplify_mesh(mesh.clone(), &locked, &options);
        let quality = result.statistics.quality.unwrap_or_default();
        let error = quality.mean_square().sqrt();
        (result.mesh.triangles.len() as u64, result.statistics.reached, error)
    };
    let found = [13_500, 9_900, 4_500].map(run);
    assert!(found[0].1 && found[0].2 < 2e-4, "{found:?}");
    // Fewer than what is locked: what can still stand for the rest stays.
    assert!(found[1].2 < 1e-3 && !found[2].1 && found[2].2 < 3e-3, "{found:?}");
    assert!((9_000..11_000).contains(&found[2].0), "{found:?}");
}
