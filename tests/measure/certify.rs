//! The certificate holds the true Hausdorff distance: against brute force, closed forms, and what breaks lazy bounds.

mod brute_force;

use crate::common::meshes::{halves, soup, squares};
use brute_force::brute_force;
use std::f64::consts::TAU;
use std::path::Path;
use stonecut::Mesh;
use stonecut::io::ply::MeshSource;
use stonecut::measure::compare::{self, Request, compare, compare_in_cells};
use stonecut::measure::{Certificate, Certify, On, Options, Parts, Verdict, enclose, within};
use stonecut::mesh::vec3::{dot, sub};
use stonecut::system::progress::Progress;

type Vector = [f64; 3];

fn options(threads: usize) -> Options {
    Options { samples: 200, threads, ..Options::default() }
}

fn certify(original: &Mesh, simplified: &Mesh, tolerance: f64) -> Certificate {
    let wanted = Certify { tolerance, bound: None };
    enclose(original, simplified, wanted, &options(1), &Progress::default()).unwrap()
}

fn within_bound(original: &Mesh, simplified: &Mesh, bound: f64) -> Verdict {
    let [a, b] = [original, simplified].map(|mesh| Parts::in_memory(mesh, None));
    within(&a, &b, bound, (2, u64::MAX), &Progress::default()).unwrap()
}

/// The interval is proven, as narrow as asked for, and holds `truth`, which is known to `slack`.
fn assert_holds(certificate: &Certificate, truth: f64, slack: f64, what: &str) {
    assert!(certificate.certified, "{what}: {certificate:?}");
    assert!(certificate.lower <= truth + slack, "{what}: {truth} {certificate:?}");
    assert!(certificate.upper >= truth - slack, "{what}: {truth} {certificate:?}");
}

/// A rectangle of `n` by `n` squares at height `z`, cut along one diagonal or the other.
fn sheet(n: u32, size: f64, z: f64, is_turned: bool) -> Mesh {
    let at = |i: u32| size * f64::from(i) / f64::from(n);
    let positions = (0..(n + 1) * (n + 1)).map(|v| [at(v % (n + 1)), at(v / (n + 1)), z]).collect();
    let mut triangles = Vec::new();
    for square in 0..n * n {
        let a = square / n * (n + 1) + square % n;
        let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
        triangles.extend(match is_turned {
            false => [[a, b, c], [a, c, d]],
            true => [[a, b, d], [b, c, d]],
        });
    }
    Mesh::new(positions, triangles)
}

fn sphere(n: u32, radius: f64) -> Mesh {
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..2 * n {
            let (u, v) =
                (TAU * f64::from(i) / f64::from(2 * n), TAU / 2.0 * f64::from(j) / f64::from(n));
            positions.push([v.sin() * u.cos(), v.sin() * u.sin(), v.cos()].map(|x| radius * x));
        }
    }
    let (n, m) = (n as usize, 2 * n as usize);
    Mesh::new(positions, halves(squares(m, n), |i, j| (j * m + i % m) as u32))
}

#[test]
fn offset_spheres() {
    let (inner, outer) = (sphere(40, 1.0), sphere(40, 1.1));
    // A corner of the outer sphere is 0.1 from the same corner of the inner one, which is convex: nothing is nearer.
    let found = certify(&inner, &outer, 0.01);
    assert_holds(&found, 0.1, 1e-12, "spheres");
    assert!(found.upper <= 0.1011, "{found:?}");
    let moved = Mesh::new(
        inner.positions.iter().map(|p| [p[0], p[1], p[2] + 0.25]).collect(),
        inner.triangles.clone(),
    );
    assert_holds(&certify(&inner, &moved, 1e-4), 0.25, 1e-12, "a moved sphere");
}

#[test]
fn a_spike_on_a_plane() {
    // The tip of the spike is no sample, and stands in the middle of the other mesh's squares.
    let flat = sheet(7, 7.0, 0.0, false);
    let mut spiked = sheet(14, 7.0, 0.0, true);
    let tip = spiked.positions.iter().position(|p| p[0] == 3.5 && p[1] == 3.5).unwrap();
    spiked.positions[tip][2] = 2.0;
    let found = certify(&flat, &spiked, 0.01);
    assert_holds(&found, 2.0, 1e-12, "spike");
    assert_eq!((found.witness, found.witness_on), (Some([3.5, 3.5, 2.0]), Some(On::Simplified)));
    let turned = certify(&spiked, &flat, 0.01);
    assert_eq!(
        (turned.lower, turned.upper, turned.witness_on),
        (found.lower, found.upper, Some(On::Original))
    );
    assert!(found.beyond.is_empty(), "no bound, no list");
    // A bound below the tip: the triangles around it are beyond, each with its farthest point.
    let enclosed = |bound: f64| {
        let wanted = Certify { tolerance: 0.01, bound: Some(bound) };
        enclose(&flat, &spiked, wanted, &options(1), &Progress::default()).unwrap()
    };
    let found = enclosed(1.5);
    assert_holds(&found, 2.0, 1e-12, "spike, bound 1.5");
    assert_eq!(found.beyond.len(), 6, "{:?}", found.beyond);
    for one in &found.beyond {
        assert!(1.5 < one.distance && one.distance <= 2.0 && one.size >= 0.5, "{one:?}");
        let off = sub(one.point, [3.5, 3.5, 2.0]);
        assert!(dot(off, off).sqrt() < 1.0, "{one:?}");
    }
    // A bound that is kept, and one so far below that nearly everything would be listed.
    assert!(enclosed(2.1).beyond.is_empty() && enclosed(2.1).upper <= 2.1);
    assert!(enclosed(0.5).beyond.is_empty());
}

#[test]
fn parallel_sheets_of_other_triangles() {
    for height in [1.0, 1e-2, 1e-4] {
        let found = certify(&sheet(9, 9.0, 0.0, false), &sheet(13, 9.0, height, true), 0.01);
        assert_holds(&found, height, 1e-12, "sheets");
        assert!(found.upper <= 1.0101 * height, "{height}: {found:?}");
    }
}

#[test]
fn interleaved_sheets() {
    // Nine sheets against eight between them, each off the middle by a little: many nearest triangles everywhere.
    let all = |heights: &mut dyn Iterator<Item = f64>| {
        let mut mesh = Mesh::default();
        for (k, z) in heights.enumerate() {
            let one = sheet(5 + k as u32 % 4, 4.0, z, k % 2 == 0);
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(one.positions);
            mesh.triangles.extend(one.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        mesh
    };
    let a = all(&mut (0..9).map(f64::from));
    let b = all(&mut (0..8).map(|k| f64::from(k) + 0.45));
    // The topmost sheet is 0.55 above the highest of the others.
    let found = certify(&a, &b, 0.01);
    assert_holds(&found, 1.0 - 0.45, 1e-12, "interleaved");
}

#[test]
fn points_between_several_triangles() {
    // A sheet halfway between two others, and a point in the middle of four walls.
    let mut cage = sheet(6, 6.0, 0.0, false);
    let upper = sheet(5, 6.0, 2.0, true);
    cage.triangles
        .extend(upper.triangles.iter().map(|t| t.map(|v| v + cage.positions.len() as u32)));
    cage.positions.extend(upper.positions);
    let mut both = cage.clone();
    let middle = sheet(1, 6.0, 1.0, false);
    both.triangles
        .extend(middle.triangles.iter().map(|t| t.map(|v| v + both.positions.len() as u32)));
    both.positions.extend(middle.positions);
    assert_holds(&certify(&cage, &both, 0.01), 1.0, 1e-12, "halfway");
    // A roof upside down: every point of a slanted triangle has another foot; the ridge of distances runs inside.
    let valley = soup(&[
        [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 9.0, 0.0]],
        [[-1.0, 0.0, 0.0], [1.0, 9.0, 0.0], [-1.0, 9.0, 0.0]],
    ]);
    let walls = soup(&[
        [[-1.0, 0.0, -5.0], [-1.0, 9.0, -5.0], [-1.0, 4.5, 9.0]],
        [[1.0, 0.0, -5.0], [1.0, 9.0, -5.0], [1.0, 4.5, 9.0]],
        [[-1.0, 0.0, 5.0], [-1.0, 9.0, 5.0], [-1.0, 4.5, -9.0]],
        [[1.0, 0.0, 5.0], [1.0, 9.0, 5.0], [1.0, 4.5, -9.0]],
    ]);
    let [lower, upper] = brute_force([&valley, &walls], 20_000);
    let found = certify(&valley, &walls, 1e-4);
    assert!(
        found.certified && found.lower <= upper && found.upper >= lower,
        "{lower} {upper} {found:?}"
    );
}

#[test]
fn a_speck_far_away_and_unused_vertices() {
    let flat = sheet(20, 1.0, 0.0, false);
    let mut speck = sheet(20, 1.0, 0.0, true);
    let n = speck.positions.len() as u32;
    speck.positions.extend([[1e6, 0.5, 0.0], [1e6 + 1e-3, 0.5, 0.0], [1e6, 0.5 + 1e-3, 0.0]]);
    // Vertices that no triangle uses are not part of the surface.
    let unused = certify(&flat, &speck, 0.01);
    assert!(unused.certified && unused.upper < 1e-5, "{unused:?}");
    speck.triangles.push([n, n + 1, n + 2]);
    assert_holds(&certify(&flat, &speck, 0.01), 1e6 + 1e-3 - 1.0, 1e-6, "speck");
    assert_holds(&certify(&speck, &flat, 1e-6), 1e6 + 1e-3 - 1.0, 1e-6, "speck");
}

#[test]
fn nothing_on_one_side_or_both() {
    let (flat, none) = (sheet(2, 1.0, 0.0, false), Mesh::default());
    for (a, b) in [(&flat, &none), (&none, &flat)] {
        let found = certify(a, b, 0.01);
        assert!(
            found.lower.is_infinite() && found.upper.is_infinite() && !found.certified,
            "{found:?}"
        );
        assert!(
            matches!(within_bound(a, b, 1e9), Verdict::Beyond { distance, .. } if distance.is_infinite())
        );
    }
    let found = certify(&none, &none, 0.01);
    assert_eq!((found.lower, found.upper, found.certified), (0.0, 0.0, true));
    assert_eq!(within_bound(&none, &none, 0.0), Verdict::Within(0.0));
}

#[test]
fn the_same_surface_has_no_distance() {
    let a = sphere(30, 3.0);
    let found = certify(&a, &a, 0.01);
    assert_eq!((found.lower, found.upper, found.certified, found.witness), (0.0, 0.0, true, None));
    assert_eq!(within_bound(&a, &a, 0.0), Verdict::Within(0.0));
    // In another order, from other corners; without the poles, where triangles are lines.
    let mut a = a;
    a.triangles.retain(|t| t.iter().all(|&v| (60..60 * 30).contains(&v)));
    let mut b = a.clone();
    b.triangles.reverse();
    b.triangles.iter_mut().for_each(|t| t.rotate_left(1));
    let found = certify(&a, &b, 0.01);
    assert_eq!((found.lower, found.upper, found.certified), (0.0, 0.0, true));
    assert_eq!(within_bound(&a, &b, 0.0), Verdict::Within(0.0));
    // The same plane in other triangles: what rounding hides, and no more.
    let found = certify(&sheet(11, 1.0, 0.3, false), &sheet(7, 1.0, 0.3, true), 0.01);
    assert!(found.certified && found.lower <= 1e-15 && found.upper < 1e-11, "{found:?}");
}

#[test]
fn tiny_differences_far_from_the_origin() {
    let place = |mesh: Mesh, up: f64| {
        let positions =
            mesh.positions.iter().map(|p| [p[0] + 5e6, p[1] - 3e6, p[2] + up]).collect();
        Mesh::new(positions, mesh.triangles)
    };
    let a = place(sheet(8, 1.0, 0.0, false), 7e5);
    let b = place(sheet(6, 1.0, 0.0, true), 7e5 + 1e-3);
    let truth = (7e5 + 1e-3) - 7e5;
    assert_holds(&certify(&a, &b, 0.01), truth, 1e-9, "far from the origin");
}

#[test]
fn lengths_of_any_size() {
    for scale in [1e-150, 1e-30, 1e30, 1e150] {
        let scaled = |mesh: Mesh| {
            Mesh::new(mesh.positions.iter().map(|p| p.map(|x| scale * x)).collect(), mesh.triangles)
        };
        let found =
            certify(&scaled(sheet(4, 4.0, 0.0, false)), &scaled(sheet(3, 4.0, 0.5, true)), 0.01);
        assert_holds(&found, 0.5 * scale, 1e-9 * scale, "scaled");
    }
}

#[test]
fn what_is_not_a_number_is_refused() {
    let good = sheet(2, 1.0, 0.0, false);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut other = good.clone();
        other.positions[4][1] = bad;
        let wanted = Certify { tolerance: 0.01, bound: None };
        let error = enclose(&good, &other, wanted, &options(1), &Progress::default()).unwrap_err();
        assert!(error.to_string().contains("simplified mesh: vertex 4"), "{error}");
    }
}

#[test]
fn threads_change_no_bit() {
    let (a, b) = (sphere(60, 1.0), sphere(23, 1.02));
    let with = |threads| {
        let wanted = Certify { tolerance: 0.005, bound: None };
        enclose(&a, &b, wanted, &options(threads), &Progress::default()).unwrap()
    };
    let single = with(1);
    for threads in [2, 5] {
        assert_eq!(single, with(threads), "{threads} threads");
    }
}

fn write(path: &Path, mesh: &Mesh) {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    for [x, y, z] in &mesh.positions {
        text += &format!("{x:?} {y:?} {z:?}\n");
    }
    for [a, b, c] in &mesh.triangles {
        text += &format!("3 {a} {b} {c}\n");
    }
    std::fs::write(path, text).unwrap();
}

#[test]
fn cells_prove_what_memory_proves() {
    let bumpy = |n: u32, amount: f64| {
        let mut mesh = sheet(n, 8.0, 0.0, n.is_multiple_of(2));
        mesh.positions
            .iter_mut()
            .for_each(|p| p[2] = amount * (3.0 * p[0]).sin() * (2.0 * p[1]).cos());
        mesh
    };
    let folder = tempfile::tempdir().unwrap();
    let progress = Progress::default();
    // Fine against coarse, and one triangle as large as many cells; nearly nothing apart, and nothing at all.
    let pairs = [
        (bumpy(140, 0.4), bumpy(35, 0.4)),
        (bumpy(120, 0.4), sheet(1, 8.0, 0.1, false)),
        (sheet(120, 8.0, 0.0, false), sheet(75, 8.0, 0.02, true)),
        (sheet(120, 8.0, 0.0, false), sheet(70, 8.0, 0.0, true)),
    ];
    for (number, (a, b)) in pairs.iter().enumerate() {
        write(&folder.path().join("a.ply"), a);
        write(&folder.path().join("b.ply"), b);
        let open = |name: &str| MeshSource::open(&folder.path().join(name)).unwrap();
        for turned in [false, true] {
            let (original, simplified) = if turned {
                (open("b.ply"), open("a.ply"))
            } else {
                (open("a.ply"), open("b.ply"))
            };
            let request = |memory_mib: u64, cell_triangles: u64, threads: usize| Request {
                original: &original,
                simplified: &simplified,
                options: Options {
                    samples: 20_000,
                    certify: Some(Certify { tolerance: 0.01, bound: None }),
                    ..options(threads)
                },
                memory_bytes: memory_mib << 20,
                cell_triangles,
                temp_dir: folder.path().to_path_buf(),
                heat: false,
            };
            let whole = compare(&request(4096, 20_000, 2), &progress)
                .unwrap()
                .measured
                .certificate
                .unwrap();
            let mut all = Vec::new();
            for (memory, cells, threads) in
                [(500, 3000, 2), (60, 3000, 2), (60, 700, 1), (60, 700, 3)]
            {
                let found = compare_in_cells(&request(memory, cells, threads), &progress).unwrap();
                let found = found.measured.certificate.unwrap();
                let what = format!(
                    "pair {number}, {turned}, {memory} {cells} {threads}: {whole:?} {found:?}"
                );
                assert!(found.certified && whole.certified, "{what}");
                assert!(found.lower <= whole.upper && found.upper >= whole.lower, "{what}");
                all.push(found);
            }
            assert_eq!(all[2], all[3], "threads show");
            // The cheaper question, in memory and in cells; samples were taken for what is proven here without.
            for memory in [4096, 60] {
                let request = request(memory, 700, 2);
                let verdict = |bound: f64| compare::within(&request, bound, &progress).unwrap();
                let above = whole.upper * 1.02;
                if whole.upper > 1e-9 {
                    assert_eq!(verdict(above), Verdict::Within(above), "pair {number}");
                }
                if whole.lower > 1e-9 {
                    let below = verdict(whole.lower * 0.98);
                    assert!(
                        matches!(below, Verdict::Beyond { distance, .. } if distance > whole.lower * 0.98),
                        "{below:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_bound_is_kept_or_broken_or_too_near_to_tell() {
    let (a, b) = (sheet(9, 9.0, 0.0, false), sheet(13, 9.0, 0.25, true));
    assert_eq!(within_bound(&a, &b, 0.2500001), Verdict::Within(0.2500001));
    assert_eq!(within_bound(&a, &b, 100.0), Verdict::Within(100.0));
    for bound in [0.2499999, 1e-3, 0.0] {
        let Verdict::Beyond { point, distance, .. } = within_bound(&a, &b, bound) else {
            panic!("{bound} is not kept");
        };
        assert!(distance > bound && distance <= 0.25, "{distance}");
        assert!(point[2] == 0.0 || point[2] == 0.25, "{point:?}");
    }
    let at_the_bound = within_bound(&a, &b, 0.25);
    let Verdict::Undecided { lower, upper } = at_the_bound else { panic!("{at_the_bound:?}") };
    assert!(lower <= 0.25 && (0.25..0.25 + 1e-9).contains(&upper), "{lower} {upper}");
    // A bound within the tolerance of the distance is proven all the same, if the surfaces keep it.
    let wanted = Certify { tolerance: 0.1, bound: Some(0.251) };
    let found = enclose(&a, &b, wanted, &options(1), &Progress::default()).unwrap();
    assert!(found.upper <= 0.251 && found.certified, "{found:?}");
}
