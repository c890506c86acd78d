//! `measure` against answers known in closed form, and against itself under every disguise.

use stonecut::Mesh;
use stonecut::measure::Deviation;
use stonecut::measure::{ColourChannels, Options, Region, two_sided};
use stonecut::system::progress::Progress;

fn options(samples: u64, threads: usize) -> Options {
    Options { samples, threads, ..Options::default() }
}

fn measure(a: &Mesh, b: &Mesh, options: &Options) -> Deviation {
    two_sided(a, b, options, &Progress::default()).expect("nobody asks to stop")
}

/// A height field of `2 n^2` triangles over the unit square, `height(x, y)` high.
fn field(n: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            positions.push([x, y, height(x, y)]);
        }
    }
    for j in 0..n {
        for i in 0..n {
            let at = j * (n + 1) + i;
            triangles.push([at, at + 1, at + n + 2]);
            triangles.push([at, at + n + 2, at + n + 1]);
        }
    }
    Mesh::new(positions, triangles)
}

fn bumpy(x: f64, y: f64) -> f64 {
    0.1 * (7.0 * x).sin() * (5.0 * y + x).cos()
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

#[test]
fn parallel_planes_are_apart_by_their_distance() {
    let (a, b) = (field(20, |_, _| 0.0), field(3, |_, _| 0.25));
    let d = measure(&a, &b, &options(10_000, 2));
    for side in [&d.forward, &d.backward] {
        for value in [side.distance.mean, side.distance.rms, side.distance.p999, side.distance.max]
        {
            assert!(near(value, 0.25, 1e-12), "{side:?}");
        }
        assert_eq!(side.normal_degrees, Some(0.0));
        assert!(side.distance.samples.abs_diff(10_000) < 200);
    }
    assert_eq!((d.forward.vertices, d.backward.vertices), (441, 16));
    assert!(near(d.diagonal, 2f64.sqrt(), 1e-12));
    assert!(near(d.relative_rms, 0.25 / 2f64.sqrt(), 1e-12));
}

#[test]
fn a_tilted_plane_gives_the_integral() {
    // Distances over the foot of the slope grow linearly: mean h/2, rms h/sqrt(3), the rest by symmetry.
    let (flat, tilted) = (field(8, |_, _| 0.0), field(8, |x, _| 1e-3 * x));
    let d = measure(&flat, &tilted, &options(200_000, 2));
    assert!(near(d.backward.distance.mean, 0.5e-3, 2e-6), "{d:?}");
    assert!(near(d.backward.distance.rms, 1e-3 / 3f64.sqrt(), 2e-6), "{d:?}");
    assert!(near(d.backward.distance.p999, 0.999e-3, 2e-6), "{d:?}");
    assert!(near(d.backward.distance.max, 1e-3, 1e-12), "{d:?}");
    assert!(near(d.forward.normal_degrees.unwrap(), 1e-3f64.to_degrees(), 1e-6));
}

#[test]
fn a_single_outlying_vertex_is_found_whatever_the_samples() {
    let mut spiked = field(100, |_, _| 0.0);
    spiked.positions[5000][2] = 0.7;
    let d = measure(&spiked, &field(2, |_, _| 0.0), &options(100, 2));
    assert_eq!(d.forward.distance.max, 0.7);
    assert_eq!(d.forward.worst, Some(spiked.positions[5000]));
}

#[test]
fn neither_threads_nor_order_nor_rotation_shows() {
    let (a, b) = (field(90, bumpy), field(17, bumpy));
    let single = measure(&a, &b, &options(30_000, 1));
    for threads in [2, 3, 8] {
        assert_eq!(single, measure(&a, &b, &options(30_000, threads)), "{threads} threads");
    }
    // Vertices reversed, triangles strided and each begun at another corner.
    let disguise = |mesh: &Mesh| {
        let n = mesh.triangles.len();
        let last = mesh.positions.len() as u32 - 1;
        let triangles = (0..n)
            .map(|i| {
                let mut t = mesh.triangles[(i * 7919 + 13) % n].map(|v| last - v);
                t.rotate_left(i % 3);
                t
            })
            .collect();
        Mesh::new(mesh.positions.iter().rev().copied().collect(), triangles)
    };
    assert_eq!(single, measure(&disguise(&a), &disguise(&b), &options(30_000, 2)));
}

#[test]
fn a_shift_far_from_the_origin_hardly_shows() {
    let (a, b) = (field(60, bumpy), field(11, bumpy));
    let here = measure(&a, &b, &options(50_000, 2));
    let shift = |mesh: &Mesh| {
        let mut moved = mesh.clone();
        moved.positions.iter_mut().for_each(|p| {
            p[0] += 500_000.0;
            p[1] += 5_400_000.0;
        });
        moved
    };
    let there = measure(&shift(&a), &shift(&b), &options(50_000, 2));
    // Other bits, other samples: equal to sampling noise, not to the last digit.
    assert!(near(here.rms / there.rms, 1.0, 0.01), "{here:?} {there:?}");
}

#[test]
fn empty_and_degenerate_sides_are_told_not_hidden() {
    let (full, empty) = (field(5, bumpy), Mesh::default());
    let d = measure(&full, &empty, &options(1000, 2));
    assert!(d.forward.distance.max.is_infinite() && d.rms.is_infinite());
    assert_eq!((d.backward.distance.samples, d.backward.distance.max), (0, 0.0));
    let json = serde_json::to_value(&d).unwrap();
    assert!(json["forward"]["rms"].is_null() && json["rms"].is_null());
    let d = measure(&empty, &full, &options(1000, 2));
    assert!(d.backward.distance.rms.is_infinite() && d.forward.distance.max == 0.0);
    let d = measure(&empty, &empty, &options(1000, 2));
    assert_eq!((d.rms, d.relative_rms, d.diagonal), (0.0, 0.0, 0.0));
    // A needle without area has vertices to measure, though no samples.
    let needle =
        Mesh::new(vec![[0.0, 0.0, 3.0], [1.0, 0.0, 3.0], [0.5, 0.0, 3.0]], vec![[0, 1, 2]]);
    let d = measure(&needle, &field(1, |_, _| 0.0), &options(1000, 1));
    assert_eq!((d.forward.distance.samples, d.forward.distance.max), (0, 3.0));
    assert!(d.backward.distance.rms >= 3.0);
}

#[test]
fn a_surface_far_away_is_measured_exactly() {
    let near_one = field(50, |_, _| 0.0);
    let mut far_one = field(2, |_, _| 0.0);
    far_one.positions.iter_mut().for_each(|p| p[2] += 1e9);
    let d = measure(&near_one, &far_one, &options(1000, 2));
    assert!(near(d.forward.distance.mean / 1e9, 1.0, 1e-12), "{d:?}");
    assert!(near(d.rms / 1e9, 1.0, 1e-12));
}

#[test]
fn colours_are_compared_where_the_surfaces_are() {
    let coloured = |n, rgb: [f32; 3]| {
        let mut mesh = field(n, |_, _| 0.0);
        mesh.n_channels = 4;
        // A channel of something else stands before the colour.
        mesh.channels = mesh.positions.iter().flat_map(|_| [9.0, rgb[0], rgb[1], rgb[2]]).collect();
        mesh
    };
    let channels = ColourChannels { channels: [1, 2, 3], white: 255.0 };
    let options = Options { colours: Some([channels.into(); 2]), ..options(1000, 1) };
    let white = coloured(4, [255.0; 3]);
    let same = measure(&white, &coloured(7, [255.0; 3]), &options);
    assert!(same.forward.color_delta_e.unwrap() < 1e-9);
    let other = measure(&white, &coloured(7, [0.0; 3]), &options);
    assert!(near(other.forward.color_delta_e.unwrap(), 100.0, 1e-9));
    assert_eq!(other.forward.color_delta_e, other.backward.color_delta_e);
}

#[test]
fn a_region_parts_the_samples() {
    // A step of height 1 across x = 0.5: only within 0.1 of it does the flat mesh deviate.
    let ridge = field(100, |x, _| (0.1 - (x - 0.5).abs()).max(0.0));
    let region = Region::around_segments(&[[[0.5, 0.0, 0.0], [0.5, 1.0, 0.0]]], 0.15);
    let options = Options { region: Some(region), ..options(50_000, 2) };
    let d = measure(&field(10, |_, _| 0.0), &ridge, &options);
    let (inside, outside) = (d.forward.near.unwrap(), d.forward.far.unwrap());
    assert_eq!(inside.samples + outside.samples, d.forward.distance.samples);
    assert!(near(inside.samples as f64 / 50_000.0, 0.3, 0.02));
    assert!(inside.rms > 0.03 && outside.max == 0.0, "{inside:?} {outside:?}");
}

#[test]
fn coordinates_of_any_size_give_the_numbers_in_their_unit() {
    let (a, b) = (field(40, bumpy), field(9, bumpy));
    let here = measure(&a, &b, &options(20_000, 2));
    for exponent in [-1000, -497, -150, -70, 70, 150, 497, 1000] {
        let scale = 2f64.powi(exponent);
        let scaled = |mesh: &Mesh| {
            let mut mesh = mesh.clone();
            mesh.positions.iter_mut().for_each(|p| p.iter_mut().for_each(|x| *x *= scale));
            mesh
        };
        let there = measure(&scaled(&a), &scaled(&b), &options(20_000, 2));
        assert!(near(there.diagonal / scale / here.diagonal, 1.0, 1e-12), "2^{exponent}");
        for (x, y) in [(&here.forward, &there.forward), (&here.backward, &there.backward)] {
            // Samples follow from the bits of the corners, so they are others; the maximum over vertices is not.
            assert!(y.distance.samples.abs_diff(20_000) < 400, "2^{exponent}: {y:?}");
            assert!(
                near(y.distance.mean / scale / x.distance.mean, 1.0, 0.05),
                "2^{exponent}: {y:?}"
            );
            assert!(
                near(y.distance.rms / scale / x.distance.rms, 1.0, 0.05),
                "2^{exponent}: {y:?}"
            );
            assert!(
                near(y.distance.max / scale / x.distance.max, 1.0, 0.05),
                "2^{exponent}: {y:?}"
            );
        }
        assert!(near(there.relative_rms / here.relative_rms, 1.0, 0.05));
    }
}
