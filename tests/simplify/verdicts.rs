//! Verdicts on results: a clean one is never called short, a ruin always is.

use crate::common::meshes::{halves, torus};
use crate::common::{expect, report, run, scratch, write_ply};
use stonecut::mesh::property::Scalar;

#[test]
fn a_fan_of_very_many_triangles_to_half_is_what_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    // A flat cone: a hub, and a rim of 8,000 vertices.
    let n = 8000u32;
    let mut points = vec![[0.0, 0.0, 0.1]];
    points.extend((0..n).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
        [cos, sin, 0.0]
    }));
    let triangles: Vec<[u32; 3]> = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
    write_ply(&folder.path().join("in.ply"), Scalar::F64, &points, &triangles);
    expect(folder.path(), "simplify in.ply out.ply --ratio 50% --report r.json", 0);
    let quality = &report(folder.path())["quality"];
    assert_eq!(quality["bearable"], true, "{quality}");
    assert!(quality["rms_estimate"].as_f64().unwrap() < 1e-5, "{quality}");
}

/// A thin ring, of which whatever takes places on chords or of the input makes a thinner one.
#[test]
fn volume_that_is_lost_is_said() {
    let at = &scratch();
    let ring = torus(200, 16, |_, _| 0.05);
    write_ply(&at.join("in.ply"), Scalar::F64, &ring.positions, &ring.triangles);
    let command = "simplify in.ply o.ply --triangles 150 --force --report r.json";
    expect(at, command, 0);
    assert!(report(at)["quality"]["volume_kept"].as_f64().unwrap() > 0.9);
    for options in ["--for simulation", "--method decimate"] {
        let said = expect(at, &format!("{command} {options}"), 3);
        assert!(said.contains("% of their volume; ask for at least"), "{options}: {said}");
        let quality = &report(at)["quality"];
        assert!(quality["volume_kept"].as_f64().unwrap() < 0.85, "{options}: {quality}");
        assert_eq!(quality["bearable"], false, "{options}");
    }
    // Clusters reach around the ring: hardly a triangle is between three of them.
    let said = [115, 105, 95, 40].map(|n| {
        let command = format!("simplify in.ply o.ply --triangles {n} --method retile --force");
        expect(at, &command, 3)
    });
    assert!(said.iter().any(|said| said.contains("triangles: parts thinner")), "{said:?}");
}

#[test]
fn ten_triangles_stand_for_no_ring() {
    let folder = tempfile::tempdir().unwrap();
    let (n, m) = (96u32, 24u32);
    let turn = |i: u32, n: u32| (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
    let point = |i: u32, j: u32| {
        let ((sin, cos), (up, out)) = (turn(i, n), turn(j, m));
        [(1.0 + 0.15 * out) * cos, (1.0 + 0.15 * out) * sin, 0.15 * up]
    };
    let at = |i: u32, j: u32| (i % n) * m + j % m;
    let places: Vec<[u32; 2]> = (0..n).flat_map(|i| (0..m).map(move |j| [i, j])).collect();
    let points: Vec<[f64; 3]> = places.iter().map(|&[i, j]| point(i, j)).collect();
    let squares = places.iter().map(|&[i, j]| (i as usize, j as usize));
    let triangles = halves(squares, |i, j| at(i as u32, j as u32));
    write_ply(&folder.path().join("in.ply"), Scalar::F64, &points, &triangles);
    expect(folder.path(), "simplify in.ply out.ply --triangles 10 --report r.json", 3);
    let report = report(folder.path());
    let quality = &report["quality"];
    assert_eq!(quality["bearable"], false, "{quality}");
    assert!(quality["mean_edge"].as_f64().unwrap() > 0.0, "{quality}");
    assert!(quality["sensible_triangles"].as_u64().unwrap() > 12, "{quality}");
    // Clean results are never in doubt, however coarse.
    expect(folder.path(), "simplify in.ply out.ply --triangles 200 --force", 0);
}

#[test]
fn a_run_that_was_continued_reports_all_of_its_time_and_disk() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 60k --seed 3", 0);
    let command = "simplify in.ply out.ply --ratio 5% --cell-triangles 4k --report r.json";
    expect(at, command, 0);
    let whole = report(at)["peak_temp_bytes"].as_u64().unwrap();
    expect(at, &format!("{command} --force --restart --until simplify"), 0);
    std::fs::remove_file(at.join("r.json")).unwrap();
    expect(at, &format!("{command} --force"), 0);
    let report = report(at);
    assert!(report["peak_temp_bytes"].as_u64().unwrap() >= whole / 10 * 8, "{report}");
    let stages = report["stages"].as_array().unwrap();
    let seconds: f64 = stages.iter().map(|stage| stage["seconds"].as_f64().unwrap()).sum();
    let n = report["input"]["triangles"].as_f64().unwrap();
    let rate = report["triangles_per_second"].as_f64().unwrap();
    assert!(rate * seconds <= 1.001 * n, "{rate} for {seconds} s");
    assert!(report["seconds"].as_f64().unwrap() >= 0.999 * seconds, "{report}");
}

/// A run that goes farther sees other surfaces on its way than those at which shorter runs end.
#[test]
fn fewer_triangles_of_a_sponge_are_never_judged_better() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth gyroid in.ply --triangles 30k", 0);
    let mut judged = Vec::new();
    for n in [10, 30, 50, 100, 200, 1000] {
        let words = format!("simplify in.ply out.ply --triangles {n} --report r.json --force");
        run(folder.path(), &words);
        judged.push(report(folder.path())["quality"]["bearable"].as_bool().unwrap());
    }
    assert!(judged.is_sorted() && !judged[0] && judged[5], "{judged:?}");
}

#[test]
fn the_count_that_is_named_is_enough_at_the_first_try() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let axes = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let ends = [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let octahedron =
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let mut points: Vec<[f64; 3]> = axes.into_iter().chain(ends).collect();
    let mut triangles = octahedron.to_vec();
    write_ply(&out.join("octahedron.ply"), Scalar::F64, &points, &triangles);
    // Cut three times and blown up: a sphere; and another beside it.
    for _ in 0..3 {
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let mut middle = |i: u32, j: u32| {
                let [p, q] = [i, j].map(|v| points[v as usize]);
                let sum = [p[0] + q[0], p[1] + q[1], p[2] + q[2]];
                let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
                points.push(sum.map(|x| x / length));
                points.len() as u32 - 1
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    let n = points.len() as u32;
    points.extend(points.clone().iter().map(|p| [p[0] + 3.0, p[1], p[2]]));
    triangles.extend(triangles.clone().iter().map(|t| t.map(|v| v + n)));
    write_ply(&out.join("spheres.ply"), Scalar::F64, &points, &triangles);
    for (name, count) in [("octahedron", 4), ("octahedron", 6), ("spheres", 4), ("spheres", 9)] {
        let ask = |count: u64, code| {
            let command =
                format!("simplify {name}.ply out.ply --triangles {count} --force --report r.json");
            expect(out, &command, code);
            report(out)["quality"]["sensible_triangles"].as_u64().unwrap()
        };
        let named = ask(count, 3);
        assert!(named > count, "{name}: {count}, {named}");
        ask(named, 0);
    }
}
