//! The fit: it lowers the error, both ways, and touches nothing that it must not.

use crate::common::meshes::{self, bumps};
use stonecut::Mesh;
use stonecut::kernel::{Fit, Options, Simplified, Stop, simplify_mesh};
use stonecut::measure;
use stonecut::measure::Deviation;
use stonecut::mesh::relief::Relief;
use stonecut::synth::{self, Kind, Settings};
use stonecut::system::progress::Progress;

/// A height field far from the origin.
fn sheet(n: usize, height: impl Fn(f64, f64) -> f64) -> Mesh {
    meshes::sheet(n, |u, v| [u + 1000.0, v - 2000.0, height(u, v)])
}

fn simplified(mesh: &Mesh, locked: &[bool], target: u64, fit: Fit) -> Simplified {
    let options = Options { stop: Stop::Triangles(target), fit, ..Options::default() };
    simplify_mesh(mesh.clone(), locked, &options)
}

fn deviation(original: &Mesh, result: &Mesh) -> Deviation {
    let options = measure::Options { samples: 100_000, threads: 2, ..Default::default() };
    measure::two_sided(original, result, &options, &Progress::default()).unwrap()
}

#[test]
fn the_error_falls_both_ways() {
    let mesh = sheet(240, bumps);
    let locked = vec![false; mesh.positions.len()];
    // Vertices merged, vertices alone, edges.
    for (target, at_most) in [(800, 0.93), (4_000, 0.93), (12_000, 0.95)] {
        let without = simplified(&mesh, &locked, target, Fit::Off);
        let with = simplified(&mesh, &locked, target, Fit::On);
        assert_eq!(without.mesh.triangles, with.mesh.triangles, "triangles stay what they are");
        assert_eq!(without.source, with.source);
        let (before, after) = (deviation(&mesh, &without.mesh), deviation(&mesh, &with.mesh));
        let ratio = |a: f64, b: f64| a / b;
        let forward = ratio(after.forward.distance.rms, before.forward.distance.rms);
        let backward = ratio(after.backward.distance.rms, before.backward.distance.rms);
        assert!(forward < at_most && backward < at_most, "{target}: {forward:.3} {backward:.3}");
        let fit = with.statistics.fit.unwrap();
        assert!(fit.samples > target && fit.moved > target / 4, "{fit:?}");
        assert!(fit.rms_after < fit.rms_before, "{fit:?}");
        assert_eq!(without.statistics.fit, None);
    }
}

#[test]
fn boundary_and_locked_vertices_keep_their_bits() {
    let mesh = sheet(120, bumps);
    let mut locked = vec![false; mesh.positions.len()];
    for (v, locked) in locked.iter_mut().enumerate() {
        *locked = v % 97 == 0;
    }
    let without = simplified(&mesh, &locked, 2_500, Fit::Off);
    let with = simplified(&mesh, &locked, 2_500, Fit::On);
    let rim = |p: &[f64; 3]| {
        [0, 1].iter().any(|&k| p[k] == [1000.0, -2000.0][k] || p[k] == [1001.0, -1999.0][k])
    };
    let mut held = 0;
    for (v, (a, b)) in without.mesh.positions.iter().zip(&with.mesh.positions).enumerate() {
        if rim(a) || locked[without.source[v] as usize] {
            assert_eq!(a.map(f64::to_bits), b.map(f64::to_bits));
            held += 1;
        }
    }
    assert!(held > 100);
    assert_ne!(without.mesh.positions, with.mesh.positions);
}

#[test]
fn the_maximum_stays_where_the_surface_has_creases() {
    // Creases and chisel marks that the samples see only from both sides: unbounded, a vertex ran off by 1.5
    // times the maximum there was.
    let mesh = synth::mesh(&Settings::new(Kind::Statue, 200_000)).unwrap();
    let locked = vec![false; mesh.positions.len()];
    let most = |fit| {
        let result = simplified(&mesh, &locked, 20_000, fit);
        let deviation = deviation(&mesh, &result.mesh);
        deviation.forward.distance.max.max(deviation.backward.distance.max)
    };
    let (before, after) = (most(Fit::Off), most(Fit::On));
    assert!(after <= 1.1 * before, "{before} {after}");
}

#[test]
fn neither_size_nor_place_matters() {
    let mesh = sheet(100, bumps);
    let locked = vec![false; mesh.positions.len()];
    let plain = simplified(&mesh, &locked, 1_000, Fit::On);
    // Powers of two round nothing: about 1e-30 and 1e30.
    for factor in [2f64.powi(-100), 2f64.powi(100)] {
        let mut scaled = mesh.clone();
        scaled.positions.iter_mut().flatten().for_each(|x| *x *= factor);
        let result = simplified(&scaled, &locked, 1_000, Fit::On);
        assert_eq!(plain.mesh.triangles, result.mesh.triangles);
        for (a, b) in plain.mesh.positions.iter().zip(&result.mesh.positions) {
            assert_eq!(a.map(|x| (x * factor).to_bits()), b.map(f64::to_bits));
        }
    }
    // As far from the origin as UTM coordinates in metres, with details of millimetres.
    let mut far = mesh.clone();
    for p in &mut far.positions {
        *p = [p[0] + 499_000.0, p[1] + 5_402_000.0, p[2]];
    }
    let without = simplified(&far, &locked, 1_000, Fit::Off);
    let with = simplified(&far, &locked, 1_000, Fit::On);
    let ratio = deviation(&far, &with.mesh).rms / deviation(&far, &without.mesh).rms;
    assert!(ratio < 0.95, "{ratio}");
}

#[test]
fn channels_follow_the_vertices() {
    // Each vertex carries where it is.
    let mut mesh = sheet(150, bumps);
    mesh.n_channels = 2;
    let local = |p: &[f64; 3]| [(p[0] - 1000.0) as f32, (p[1] + 2000.0) as f32];
    mesh.channels = mesh.positions.iter().flat_map(local).collect();
    let locked = vec![false; mesh.positions.len()];
    let off = |result: &Simplified| {
        let places = result.mesh.positions.iter().flat_map(local);
        let sum: f64 =
            places.zip(&result.mesh.channels).map(|(x, c)| f64::from(x - c).powi(2)).sum();
        (sum / result.mesh.channels.len() as f64).sqrt()
    };
    let without = simplified(&mesh, &locked, 1_500, Fit::Off);
    let with = simplified(&mesh, &locked, 1_500, Fit::On);
    assert_ne!(without.mesh.positions, with.mesh.positions);
    let (before, after) = (off(&without), off(&with));
    assert!(after < 1.1 * before, "{before} {after}");
    // What is the same everywhere stays so exactly: labels of regions do.
    let labels = Mesh { n_channels: 1, channels: vec![0.1; mesh.positions.len()], ..mesh };
    let result = simplified(&labels, &locked, 1_500, Fit::On);
    assert!(result.mesh.channels.iter().all(|&label| label == 0.1));
}

#[test]
fn the_same_call_gives_the_same_bytes() {
    let mesh = sheet(150, bumps);
    let locked = vec![false; mesh.positions.len()];
    let first = simplified(&mesh, &locked, 900, Fit::On);
    assert_eq!(first, simplified(&mesh, &locked, 900, Fit::On));
}

#[test]
fn a_plane_stays_a_plane() {
    let mesh = sheet(64, |_, _| 0.25);
    let locked = vec![false; mesh.positions.len()];
    let result = simplified(&mesh, &locked, 300, Fit::On);
    assert!(result.mesh.positions.iter().all(|p| p[2] == 0.25));
    let without = simplified(&mesh, &locked, 300, Fit::Off);
    assert_eq!(without.mesh, result.mesh);
}

#[test]
fn auto_fits_only_strong_reductions() {
    let mesh = sheet(100, bumps);
    let locked = vec![false; mesh.positions.len()];
    let fitted = |target| simplified(&mesh, &locked, target, Fit::Auto).statistics.fit.is_some();
    assert!(fitted(200) && !fitted(400));
    assert_eq!(Fit::Auto.decided(1_000, 11), Fit::On);
    assert_eq!(Fit::Auto.decided(1_000, 12), Fit::Off);
    assert_eq!(Fit::On.decided(100, 100), Fit::Off);
}

#[test]
fn nothing_to_fit_to_is_no_harm() {
    // No triangles; one; all vertices in one point.
    let meshes = [
        Mesh::default(),
        Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]),
        Mesh::new(vec![[7.0; 3]; 6], vec![[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5]]),
    ];
    for mesh in meshes {
        let locked = vec![false; mesh.positions.len()];
        let options = Options { stop: Stop::Triangles(0), fit: Fit::On, ..Options::default() };
        let result = simplify_mesh(mesh, &locked, &options);
        assert!(result.mesh.positions.iter().flatten().all(|x| x.is_finite()));
    }
}

/// Rounds of one cell each: every one fits to what the one before knew of the original.
fn through_rounds(mesh: &Mesh, shares: &[f64], hands_on: bool) -> Mesh {
    let mut now = mesh.clone();
    for (i, &share) in shares.iter().enumerate() {
        let locked = vec![false; now.positions.len()];
        let target = (mesh.triangles.len() as f64 * share) as u64;
        let keeps_relief = hands_on && i + 1 < shares.len();
        let (stop, fit) = (Stop::Triangles(target), Fit::On);
        let options = Options { stop, fit, keeps_relief, ..Options::default() };
        now = simplify_mesh(now, &locked, &options).mesh;
        assert_eq!(now.relief.len(), if keeps_relief { now.triangles.len() } else { 0 });
    }
    now
}

#[test]
fn relief_stands_for_the_original_from_round_to_round() {
    let mesh = synth::mesh(&Settings::new(Kind::Terrain, 200_000)).unwrap();
    let rms = |result: &Mesh| deviation(&mesh, result).rms;
    let once = rms(&through_rounds(&mesh, &[0.1], false));
    let shares = [0.4, 0.2, 0.11, 0.1];
    let with = rms(&through_rounds(&mesh, &shares, true)) / once;
    let without = rms(&through_rounds(&mesh, &shares, false)) / once;
    assert!(with < 1.01 && with < 0.997 * without, "{with} {without}");
}

#[test]
fn relief_of_the_wrong_length_is_ignored() {
    let mut mesh = sheet(60, bumps);
    let locked = vec![false; mesh.positions.len()];
    let plain = simplified(&mesh, &locked, 700, Fit::On);
    mesh.relief = vec![Relief::new([1.0; 3]); 5];
    assert_eq!(plain, simplified(&mesh, &locked, 700, Fit::On));
}

#[test]
fn a_threshold_fits_only_where_a_share_is_expected() {
    let mesh = sheet(120, bumps);
    let mut locked = vec![false; mesh.positions.len()];
    locked.iter_mut().step_by(11).for_each(|locked| *locked = true);
    let run = |expected_share: f64| {
        let stop = Stop::Costs(vec![1e-10, 1e-9]);
        let options = Options {
            stop,
            fit: Fit::On,
            expected_share,
            keeps_relief: true,
            ..Options::default()
        };
        simplify_mesh(mesh.clone(), &locked, &options)
    };
    let (without, with) = (run(0.0), run(0.3));
    assert_eq!(without.mesh.triangles, with.mesh.triangles);
    assert_eq!(without.statistics.fit, None);
    assert!(without.mesh.relief.is_empty());
    let fit = with.statistics.fit.unwrap();
    assert!(fit.moved > 0 && fit.rms_after < fit.rms_before, "{fit:?}");
    let off = |result: &Simplified| deviation(&mesh, &result.mesh).rms;
    assert!(off(&with) < 0.95 * off(&without));
    for (v, &source) in with.source.iter().enumerate().filter(|(_, s)| locked[**s as usize]) {
        assert_eq!(with.mesh.positions[v], mesh.positions[source as usize]);
    }
}
