//! Copies of vertices within rounding become one before everything else.

use crate::common::{check, count, expect, json, scratch, write_ply};
use std::collections::HashMap;
use std::path::Path;
use stonecut::mesh::property::Scalar;
use stonecut::mesh::topology_counts;
use stonecut::pipeline::in_memory::{Input, simplify};
use stonecut::system::progress::Progress;

/// A mesh as positions and triangles.
type Plain = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// An icosahedron whose triangles were cut into four `n` times, on the unit sphere.
fn sphere(n: u32) -> Plain {
    let t = (1.0 + 5f64.sqrt()) / 2.0;
    let unit = |p: [f64; 3]| {
        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        p.map(|x| x / length)
    };
    let mut points: Vec<[f64; 3]> = Vec::new();
    for (a, b) in [(-1.0, t), (1.0, t), (-1.0, -t), (1.0, -t)] {
        points.push([a, b, 0.0]);
    }
    for (a, b) in [(-1.0, t), (1.0, t), (-1.0, -t), (1.0, -t)] {
        points.push([0.0, a, b]);
    }
    for (a, b) in [(t, -1.0), (t, 1.0), (-t, -1.0), (-t, 1.0)] {
        points.push([a, 0.0, b]);
    }
    let mut points: Vec<[f64; 3]> = points.into_iter().map(unit).collect();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..n {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32, points: &mut Vec<[f64; 3]>| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let (p, q) = (points[a as usize], points[b as usize]);
                points.push(unit([p[0] + q[0], p[1] + q[1], p[2] + q[2]]));
                points.len() as u32 - 1
            })
        };
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let [d, e, f] = [(a, b), (b, c), (c, a)].map(|(p, q)| middle(p, q, &mut points));
            finer.extend([[a, d, f], [d, b, e], [f, e, c], [d, e, f]]);
        }
        triangles = finer;
    }
    (points, triangles)
}

/// Numbers from -1 to 1 that are the same on every machine.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Every triangle with vertices of its own, each off by up to `off`.
fn soup((points, triangles): &Plain, off: f64) -> Plain {
    let mut noise = noise();
    let corner = |&v: &u32| points[v as usize];
    let own = triangles.iter().flatten().map(corner).map(|p| p.map(|x| x + off * noise()));
    let points: Vec<[f64; 3]> = own.collect();
    let n = points.len() as u32 / 3;
    (points, (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

fn write(folder: &Path, (points, triangles): &Plain, coordinate: Scalar) {
    write_ply(&folder.join("in.ply"), coordinate, points, triangles);
}

fn is_closed(folder: &Path, file: &str) {
    let found = check(folder, file);
    assert_eq!(count(&found, "boundary_edges"), 0, "{found}");
    assert_eq!(count(&found, "components"), 1, "{found}");
    assert_eq!(count(&found, "non_manifold_edges"), 0, "{found}");
}

#[test]
fn a_soup_of_near_copies_comes_out_closed() {
    let mesh = sphere(4);
    // The third lies astride what rounding explains.
    let offs = [(2e-7, Scalar::F64), (1e-6, Scalar::F64), (3e-5, Scalar::F64), (1e-7, Scalar::F32)];
    for (off, coordinate) in offs {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &soup(&mesh, off), coordinate);
        let said = expect(folder.path(), "simplify in.ply out.ply --ratio 10% --report r.json", 0);
        assert!(said.contains("12.8 k of 15.4 k vertices"), "{off}: {said}");
        is_closed(folder.path(), "out.ply");
        let report = json(folder.path(), "r.json");
        assert_eq!(report["input"]["weld"]["joined"], 12_798, "{off}");
        assert_eq!(report["input"]["vertices"], 15_360);
    }
}

#[test]
fn cells_threads_and_memory_change_nothing() {
    let at = &scratch();
    write(at, &soup(&sphere(5), 2e-7), Scalar::F64);
    let options = "--ratio 10% --cell-triangles 1k --report r.json";
    expect(at, &format!("simplify in.ply a.ply {options} --threads 1 --memory 64MiB"), 0);
    is_closed(at, "a.ply");
    expect(at, &format!("simplify in.ply b.ply {options} --threads 3 --memory 1GiB --force"), 0);
    assert_eq!(std::fs::read(at.join("a.ply")).unwrap(), std::fs::read(at.join("b.ply")).unwrap());
}

#[test]
fn exact_copies_come_out_closed_through_cells_too() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &soup(&sphere(5), 0.0), Scalar::F32);
    expect(folder.path(), "simplify in.ply out.ply --ratio 10% --cell-triangles 1k", 0);
    is_closed(folder.path(), "out.ply");
}

#[test]
fn patches_with_borders_that_nearly_agree_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let (points, triangles) = sphere(4);
    // Eight octants, each with its own vertices.
    let (mut own, mut noise) = ((Vec::new(), Vec::new()), noise());
    let mut numbers = HashMap::new();
    for t in &triangles {
        let octant = (0..3).fold(0, |octant, axis| {
            let middle: f64 = t.iter().map(|&v| points[v as usize][axis]).sum();
            2 * octant + u32::from(middle > 0.0)
        });
        own.1.push(t.map(|v| {
            *numbers.entry((octant, v)).or_insert_with(|| {
                own.0.push(points[v as usize].map(|x| x + 2e-7 * noise()));
                own.0.len() as u32 - 1
            })
        }));
    }
    write(folder.path(), &own, Scalar::F64);
    expect(folder.path(), "simplify in.ply out.ply --ratio 20% --cell-triangles 1k", 0);
    is_closed(folder.path(), "out.ply");
}

#[test]
fn beyond_rounding_a_distance_is_named_and_joins() {
    let at = &scratch();
    write(at, &soup(&sphere(4), 1e-4), Scalar::F64);
    let said =
        String::from_utf8(crate::common::run(at, "simplify in.ply out.ply --ratio 50%").stderr)
            .unwrap();
    let distance = said.split("--weld ").nth(1).unwrap_or_else(|| panic!("{said}"));
    let distance = distance.split_whitespace().next().unwrap();
    expect(
        at,
        &format!("simplify in.ply out.ply --ratio 10% --force --restart --weld {distance}"),
        0,
    );
    is_closed(at, "out.ply");
    for wrong in ["-1", "0", "nan", "on"] {
        let said = expect(at, &format!("simplify in.ply o.ply --ratio 10% --weld={wrong}"), 2);
        assert!(said.contains("auto, off"), "{said}");
    }
}

#[test]
fn colours_of_copies_are_averaged_and_faces_keep_what_they_have() {
    let at = &scratch();
    let mesh = soup(&sphere(3), 2e-7);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
         property list uchar int vertex_indices\nproperty int part\nend_header\n",
        mesh.0.len(),
        mesh.1.len()
    );
    for (i, [x, y, z]) in mesh.0.iter().enumerate() {
        text += &format!("{x} {y} {z} {} 100 0\n", 40 + 2 * (i / 3 % 2));
    }
    for (i, [a, b, c]) in mesh.1.iter().enumerate() {
        text += &format!("3 {a} {b} {c} {}\n", u32::from(mesh.0[3 * i][2] > 0.0));
    }
    std::fs::write(at.join("in.ply"), text).unwrap();
    expect(at, "simplify in.ply out.ply --ratio 50% --format ascii", 0);
    is_closed(at, "out.ply");
    let out = std::fs::read_to_string(at.join("out.ply")).unwrap();
    let rows: Vec<Vec<&str>> = out
        .split("end_header\n")
        .nth(1)
        .unwrap()
        .lines()
        .map(|line| line.split(' ').collect())
        .collect();
    for row in rows.iter().filter(|row| row.len() == 6) {
        assert!((40..=42).contains(&row[3].parse::<u8>().unwrap()), "{row:?}");
        assert_eq!(row[4..], ["100", "0"]);
    }
    let parts: Vec<&str> = rows.iter().filter(|row| row.len() == 5).map(|row| row[4]).collect();
    assert!(parts.contains(&"0") && parts.contains(&"1") && parts.len() > 100, "{}", parts.len());
}

#[test]
fn a_clean_mesh_is_left_as_it_is() {
    let at = &scratch();
    write(at, &sphere(4), Scalar::F32);
    expect(at, "simplify in.ply a.ply --ratio 10%", 0);
    expect(at, "simplify in.ply b.ply --ratio 10% --weld off", 0);
    let bodies = ["a.ply", "b.ply"].map(|name| {
        let bytes = std::fs::read(at.join(name)).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
        bytes[end..].to_vec()
    });
    assert_eq!(bodies[0], bodies[1]);
}

#[test]
fn convert_joins_copies_where_that_is_asked_for() {
    let at = &scratch();
    write(at, &soup(&sphere(3), 2e-7), Scalar::F64);
    expect(at, "convert in.ply as_it_is.ply", 0);
    assert_eq!(count(&check(at, "as_it_is.ply"), "components"), 1280);
    for how in ["auto", "1e-5"] {
        let options = format!("--weld {how} --report r.json --force");
        let said = expect(at, &format!("convert in.ply out.ply {options}"), 0);
        assert!(said.contains("3198 of 3840 vertices"), "{how}: {said}");
        is_closed(at, "out.ply");
        let report = json(at, "r.json");
        assert_eq!(report["input"]["weld"]["joined"], 3198, "{how}");
    }
    expect(at, "convert in.ply out.stl --weld -1", 2);
}

#[test]
fn arrays_of_loose_triangles_come_out_closed() {
    let (points, triangles) = soup(&sphere(4), 2e-7);
    let run = |options: &str| {
        let words = ["simplify", "arrays", "arrays.ply", "--ratio", "10%"];
        let words: Vec<std::ffi::OsString> =
            words.into_iter().chain(options.split_whitespace()).map(Into::into).collect();
        let input =
            Input { positions: points.clone(), triangles: triangles.clone(), ..Input::default() };
        let config = stonecut::cli::call::config(&words).unwrap();
        simplify(input, &config, &Progress::default()).unwrap()
    };
    for options in ["", "--weld 1e-5"] {
        let output = run(options);
        let counts = topology_counts::of_triangles(output.positions.len(), &output.triangles);
        assert_eq!((counts.boundary_edges, counts.components), (0, 1), "{options}");
        assert_eq!(output.report.input.joined_vertices, 12_798);
        assert!(output.triangles.len() >= 510, "{options}: {}", output.triangles.len());
        // Every vertex is near the one of the input that it says to be.
        for (position, &source) in output.positions.iter().zip(&output.source) {
            let from = points[source as usize];
            assert!((0..3).all(|k| (position[k] - from[k]).abs() < 0.3), "{position:?} {from:?}");
        }
    }
    assert_eq!(run("--weld off").report.input.joined_vertices, 0);
}

#[test]
fn copies_in_rounded_text_are_joined_or_named() {
    let at = &scratch();
    let (points, triangles) = soup(&sphere(4), 2e-7);
    let mut options = "--ratio 10%".to_owned();
    for digits in [6, 4] {
        let off = 10f64.powi(6 - digits as i32);
        let mut text = String::new();
        for p in &points {
            let exact = p.map(|x| (x * 1e6).round() / 1e6);
            let [x, y, z] = [0, 1, 2].map(|k| exact[k] + off * (p[k] - exact[k]));
            text += &format!("v {x:.digits$} {y:.digits$} {z:.digits$}\n");
        }
        for t in &triangles {
            text += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
        }
        std::fs::write(at.join("in.obj"), text).unwrap();
        if digits == 4 {
            let output = crate::common::run(at, "simplify in.obj out.ply --ratio 10% --force");
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(said.contains("if they belong together, --weld"), "{said}");
            options += " --weld 3e-4";
        }
        expect(at, &format!("simplify in.obj out.ply {options} --force"), 0);
        is_closed(at, "out.ply");
    }
}
