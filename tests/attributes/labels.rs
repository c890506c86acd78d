//! Labels of vertices: their borders stay sharp, numbers that differ nearly everywhere hold nothing.

use crate::common::{expect, scratch};
use crate::faces::{Triangles, checker_board_beside_sheets, sphere};
use std::path::Path;

/// Three labels on a sphere of radius 10: a cap, and two halves with a wavy border.
fn label([x, y, z]: [f64; 3]) -> u8 {
    match () {
        () if z > 6.0 => 9,
        () if y > 2.0 * (0.4 * x).sin() => 200,
        () => 3,
    }
}

/// Writes vertices with a further property, given as bytes.
fn write(path: &Path, (points, faces): &Triangles, kind: &str, value: impl Fn(usize) -> Vec<u8>) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty {kind}\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        points.len(),
        faces.len()
    )
    .into_bytes();
    for (v, point) in points.iter().enumerate() {
        point.iter().for_each(|&x| bytes.extend((x as f32).to_le_bytes()));
        bytes.extend(value(v));
        bytes.extend([200, 100, 50]);
    }
    for t in faces {
        bytes.push(3);
        t.iter().for_each(|&v| bytes.extend((v as i32).to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

/// Positions, what comes behind them up to the colour, and faces.
type Contents = (Vec<[f64; 3]>, Vec<Vec<u8>>, Vec<[usize; 3]>);

/// The contents of such a file.
fn read(path: &Path, value_bytes: usize) -> Contents {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let n = |element: &str| -> usize {
        header.lines().find_map(|line| line.strip_prefix(element)).unwrap().trim().parse().unwrap()
    };
    let (row, n_vertices) = (12 + value_bytes + 3, n("element vertex"));
    let (mut points, mut values) = (Vec::new(), Vec::new());
    for vertex in bytes[end..].chunks(row).take(n_vertices) {
        let x = |k: usize| f32::from_le_bytes(vertex[4 * k..4 * k + 4].try_into().unwrap());
        points.push([0, 1, 2].map(|k| f64::from(x(k))));
        values.push(vertex[12..12 + value_bytes].to_vec());
    }
    let corner = |face: &[u8], k: usize| {
        i32::from_le_bytes(face[1 + 4 * k..5 + 4 * k].try_into().unwrap()) as usize
    };
    let faces = bytes[end + row * n_vertices..].chunks(13);
    (points, values, faces.map(|face| [0, 1, 2].map(|k| corner(face, k))).collect())
}

/// Share of the area whose nearest corner has another label than the place.
fn wrong(path: &Path) -> f64 {
    let (points, labels, faces) = read(path, 1);
    let (mut all, mut wrong) = (0.0, 0.0);
    for t in faces {
        let [a, b, c] = t.map(|v| points[v]);
        let edge = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
        let (u, v) = (edge(b), edge(c));
        let normal =
            [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let area = normal.iter().map(|x| x * x).sum::<f64>().sqrt() / 2.0;
        const STEPS: usize = 12;
        for i in 0..STEPS {
            for j in 0..STEPS - i {
                let (s, t_) =
                    ((i as f64 + 1.0 / 3.0) / STEPS as f64, (j as f64 + 1.0 / 3.0) / STEPS as f64);
                let weights = [1.0 - s - t_, s, t_];
                let nearest = (0..3).max_by(|&x, &y| weights[x].total_cmp(&weights[y])).unwrap();
                let place = [0, 1, 2].map(|k| weights[0] * a[k] + s * b[k] + t_ * c[k]);
                let length = place.iter().map(|x| x * x).sum::<f64>().sqrt();
                all += area;
                if labels[t[nearest]][0] != label(place.map(|x| 10.0 * x / length)) {
                    wrong += area;
                }
            }
        }
    }
    wrong / all
}

#[test]
fn borders_of_labels_stay_sharp() {
    let at = &scratch();
    let mesh = sphere(90);
    write(&at.join("in.ply"), &mesh, "uchar label", |v| vec![label(mesh.0[v])]);
    let before = wrong(&at.join("in.ply"));
    for options in ["", "--cell-triangles 4k"] {
        expect(at, &format!("simplify in.ply out.ply --ratio 6% --force {options}"), 0);
        let after = wrong(&at.join("out.ply"));
        // 3.6 % before borders were kept.
        assert!(after < before + 0.003, "{options}: {after} after {before}");
    }
}

#[test]
fn borders_of_labels_stay_within_a_bound() {
    let at = &scratch();
    let mesh = sphere(60);
    write(&at.join("in.ply"), &mesh, "uchar label", |v| vec![label(mesh.0[v])]);
    let before = wrong(&at.join("in.ply"));
    expect(at, "simplify in.ply out.ply --max-error 0.2", 0);
    let after = wrong(&at.join("out.ply"));
    // 10 % where the bound holds positions alone.
    assert!(after < before + 0.01, "{after} after {before}");
}

#[test]
fn numbers_of_vertices_hold_nothing() {
    let at = &scratch();
    let mesh = sphere(40);
    write(&at.join("ids.ply"), &mesh, "int id", |v| (7 * v as i32).to_le_bytes().to_vec());
    write(&at.join("none.ply"), &mesh, "int id", |_| vec![0; 4]);
    expect(at, "simplify ids.ply a.ply --ratio 10%", 0);
    expect(at, "simplify none.ply b.ply --ratio 10%", 0);
    let ((a, ids, corners), (b, _, others)) =
        (read(&at.join("a.ply"), 4), read(&at.join("b.ply"), 4));
    assert_eq!((a, corners), (b, others));
    let mut ids: Vec<i32> =
        ids.iter().map(|id| i32::from_le_bytes(id[..].try_into().unwrap())).collect();
    ids.sort_unstable();
    ids.dedup();
    assert!(ids.iter().all(|id| id % 7 == 0) && ids.len() > 300, "{}", ids.len());
}

#[test]
fn bands_of_a_measurement_hold_nothing() {
    let at = &scratch();
    let mesh = sphere(90);
    let intensity = |v: usize| (100.0 + 10.0 * mesh.0[v][2]).round();
    write(&at.join("bytes.ply"), &mesh, "uchar intensity", |v| vec![intensity(v) as u8]);
    write(&at.join("floats.ply"), &mesh, "float intensity", |v| {
        (intensity(v) as f32).to_le_bytes().to_vec()
    });
    write(&at.join("none.ply"), &mesh, "uchar intensity", |_| vec![0]);
    let result = |name: &str, bytes: usize| {
        expect(at, &format!("simplify {name}.ply out.ply --ratio 10% --force"), 0);
        read(&at.join("out.ply"), bytes)
    };
    let ((points, _, faces), none) = (result("bytes", 1), result("none", 1));
    assert_eq!((points, faces), (none.0, none.2), "chosen, but without borders");
    let averaged =
        |value: &Vec<u8>| f32::from_le_bytes(value[..].try_into().unwrap()).fract() != 0.0;
    assert!(result("floats", 4).1.iter().any(averaged), "numbers, not labels");
}

/// Programs without other types write labels as floats: whole numbers in patches are labels, measurements are averaged.
#[test]
fn whole_floats_in_patches_are_labels() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mesh = sphere(40);
    let bytes = |value: f32| value.to_le_bytes().to_vec();
    write(&at.join("i.ply"), &mesh, "int label", |v| {
        i32::from(label(mesh.0[v])).to_le_bytes().to_vec()
    });
    write(&at.join("f.ply"), &mesh, "float label", |v| bytes(f32::from(label(mesh.0[v]))));
    write(&at.join("m.ply"), &mesh, "float q", |v| bytes(0.5 * f32::from(label(mesh.0[v]))));
    let result = |name: &str, how: &str| {
        expect(at, &format!("simplify {name}.ply out.ply --ratio 10% --force --restart {how}"), 0);
        read(&at.join("out.ply"), 4)
    };
    for how in ["", "--pairs", "--optimize 2"] {
        let ((points, labels, faces), (a, whole, b)) = (result("i", how), result("f", how));
        assert_eq!((&points, &faces), (&a, &b), "{how}");
        let as_floats = labels.iter().map(|label| bytes(label[0].into()));
        assert_eq!(as_floats.collect::<Vec<_>>(), whole, "{how}");
    }
    let known = [1.5, 4.5, 100.0].map(bytes);
    assert!(result("m", "").1.iter().any(|q| !known.contains(q)), "halves are averaged");
}

#[test]
fn whole_floats_of_faces_are_labels() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (points, faces) = sphere(40);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nproperty float label\nend_header\n",
        points.len(),
        faces.len()
    );
    points.iter().for_each(|[x, y, z]| text.push_str(&format!("{x} {y} {z}\n")));
    for [a, b, c] in &faces {
        text.push_str(&format!("3 {a} {b} {c} {}\n", label(points[*a])));
    }
    std::fs::write(at.join("in.ply"), text).unwrap();
    let said = expect(at, "simplify in.ply out.ply --ratio 10% --format ascii", 0);
    assert!(!said.contains("averaged"), "{said}");
    let out = std::fs::read_to_string(at.join("out.ply")).unwrap();
    let of_face = |line: &str| line.strip_prefix("3 ")?.split(' ').nth(3)?.parse().ok();
    let labels: Vec<f32> = out.lines().filter_map(of_face).collect();
    assert!(labels.len() > 500 && labels.iter().all(|l| [3.0, 9.0, 200.0].contains(l)));
}

#[test]
fn what_is_taken_apart_keeps_the_class_of_its_place() {
    let at = &scratch();
    let mesh = checker_board_beside_sheets(40);
    let class = |x: f64| [5u8, 9, 40][((x + 0.5) / 2.0).floor() as usize];
    write(&at.join("in.ply"), &mesh, "uchar class", |v| vec![class(mesh.0[v][0])]);
    for cells in ["", " --cell-triangles 1000"] {
        expect(at, &format!("simplify in.ply out.ply --ratio 70% --force -q{cells}"), 0);
        let (points, values, _) = read(&at.join("out.ply"), 1);
        assert!(points.len() > 2000);
        for ([x, ..], value) in points.iter().zip(&values) {
            assert_eq!(value[0], class(*x), "{cells} at {x}");
        }
    }
}
