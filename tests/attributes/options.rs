//! Colours, labels and textures through the whole program: cells or not, at vertices or at corners.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

type Place = [u32; 3];

/// A bumpy sheet of 2 n^2 triangles, coloured, with one texture chart for every 10 x 10 quads: the right
/// half of them on a second image. Texture coordinates at corners, as MeshLab writes them.
fn textured(n: usize) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment TextureFile a.png\ncomment TextureFile b.png\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nproperty int class\nelement face {}\n\
         property list uchar int vertex_indices\nproperty list uchar float texcoord\n\
         property int texnumber\nproperty short label\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    )
    .into_bytes();
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
            let z = 0.1 * (9.0 * x).sin() * (7.0 * y).cos() + 0.01 * (61.0 * x * y).sin();
            [x, y, z].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            bytes.extend([(255.0 * x) as u8, (200.0 * y) as u8, 7]);
            bytes.extend((if x < 0.5 { 10i32 } else { 20 }).to_le_bytes());
        }
    }
    for i in 0..n {
        for j in 0..n {
            for (a, b, c) in [((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1))] {
                let corners = [a, b, c].map(|(k, l)| (i + k, j + l));
                bytes.push(3);
                for (k, l) in corners {
                    bytes.extend(((k * (n + 1) + l) as i32).to_le_bytes());
                }
                bytes.push(6);
                // A chart has a 16th of the width and height of the atlas, and uses 3/4 of it.
                for (k, l) in corners {
                    let place = |at: usize, chart: usize| {
                        (chart as f32 + 0.125 + 0.075 * (at - 10 * chart) as f32) / 16.0
                    };
                    bytes.extend(place(k, i / 10).to_le_bytes());
                    bytes.extend(place(l, j / 10).to_le_bytes());
                }
                bytes.extend(i32::from(i >= n / 2).to_le_bytes());
                // Labels whose border crosses charts and images.
                bytes.extend(if 3 * i < 2 * j { 300i16 } else { -2 }.to_le_bytes());
            }
        }
    }
    bytes
}

fn stonecut(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_stonecut")).args(arguments).output().unwrap();
    // The images are not there.
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Positions, and faces with corners, texture coordinates and image, of what `textured` and its results are.
struct Read {
    positions: Vec<Place>,
    classes: Vec<i32>,
    faces: Vec<([usize; 3], [[f32; 2]; 3], i32)>,
    labels: Vec<i16>,
}

fn read(path: &Path) -> Read {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    assert!(
        header
            .contains("list uchar float texcoord\nproperty int texnumber\nproperty short label\n"),
        "{header}"
    );
    assert!(header.contains("comment TextureFile b.png"));
    let count = |what: &str| -> usize {
        let line = header.lines().find(|l| l.starts_with(&format!("element {what} "))).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let word = |at: usize| -> [u8; 4] { bytes[at..at + 4].try_into().unwrap() };
    let (n, m) = (count("vertex"), count("face"));
    let vertex = |v: usize| end + 19 * v;
    let face = |f: usize| end + 19 * n + 44 * f;
    assert_eq!(face(m), bytes.len());
    Read {
        labels: (0..m)
            .map(|f| i16::from_le_bytes([bytes[face(f) + 42], bytes[face(f) + 43]]))
            .collect(),
        positions: (0..n)
            .map(|v| [0, 4, 8].map(|k| u32::from_le_bytes(word(vertex(v) + k))))
            .collect(),
        classes: (0..n).map(|v| i32::from_le_bytes(word(vertex(v) + 15))).collect(),
        faces: (0..m)
            .map(|f| {
                let at = face(f);
                let corners = [1, 5, 9].map(|k| i32::from_le_bytes(word(at + k)) as usize);
                let texture = [14, 22, 30].map(|k| {
                    [f32::from_le_bytes(word(at + k)), f32::from_le_bytes(word(at + k + 4))]
                });
                (corners, texture, i32::from_le_bytes(word(at + 38)))
            })
            .collect(),
    }
}

fn open_edges(mesh: &Read) -> usize {
    let mut count: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for ([a, b, c], ..) in &mesh.faces {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            *count.entry((*a.min(b), *a.max(b))).or_default() += 1;
        }
    }
    assert!(count.values().all(|&n| n <= 2), "manifold");
    count.values().filter(|&&n| n == 1).count()
}

#[test]
fn textures_at_corners_come_back_at_corners_in_cells_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let [input, output] = ["in.ply", "out.ply"].map(|name| folder.path().join(name));
    std::fs::write(&input, textured(120)).unwrap();
    let mut counts = Vec::new();
    for cell_triangles in ["1M", "1000"] {
        stonecut(&[
            "simplify",
            input.to_str().unwrap(),
            output.to_str().unwrap(),
            "--triangles=800",
            "--cell-triangles",
            cell_triangles,
            "--force",
            "-q",
        ]);
        let mesh = read(&output);
        assert!((798..=800).contains(&mesh.faces.len()));
        let places: BTreeSet<&Place> = mesh.positions.iter().collect();
        assert_eq!(places.len(), mesh.positions.len());
        assert!(mesh.classes.iter().all(|c| [10, 20].contains(c)), "labels are chosen");
        for (_, texture, image) in &mesh.faces {
            let chart = |x: f32| (x * 16.0).floor();
            for uv in texture {
                assert!(uv.iter().zip(&texture[0]).all(|(a, b)| chart(*a) == chart(*b)));
                // Within the chart, to half a texel of 4096.
                let inside = uv.map(|x| (x * 16.0).fract());
                assert!(inside.iter().all(|x| (0.123..=0.877).contains(x)), "{inside:?}");
                assert_eq!(i32::from(chart(texture[0][0]) >= 6.0), *image);
            }
        }
        // The border of the labels is where it was, or nearly so.
        let place = |v: usize| [0, 1].map(|k| f64::from(f32::from_bits(mesh.positions[v][k])));
        let mut areas = [0.0; 2];
        for ((t, ..), label) in mesh.faces.iter().zip(&mesh.labels) {
            assert!([300, -2].contains(label));
            let [a, b, c] = t.map(place);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            areas[usize::from(*label == 300)] += 0.5 * area.abs();
            let off = |p: [f64; 2]| (3.0 * p[0] - 2.0 * p[1]) / 13f64.sqrt();
            let wrong = [a, b, c].map(|p| if *label == 300 { off(p) } else { -off(p) });
            assert!(wrong.iter().all(|off| *off < 0.04), "{wrong:?}");
        }
        assert!((areas[1] - 1.0 / 3.0).abs() < 0.01, "{areas:?}");
        counts.push(open_edges(&mesh));
    }
    // The border of the sheet and nothing else.
    assert!(counts.iter().all(|&n| n < 160), "{counts:?}");
}

#[test]
fn a_weight_for_what_is_not_there_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [input, output] = ["in.ply", "out.ply"].map(|name| folder.path().join(name));
    std::fs::write(&input, textured(20)).unwrap();
    for (weight, words) in [("heat=1", "heat"), ("class=1", "class"), ("color=x", "color=x")] {
        let run = Command::new(env!("CARGO_BIN_EXE_stonecut"))
            .args(["simplify", "--ratio=10%", "--weight", weight])
            .args([&input, &output])
            .output()
            .unwrap();
        assert_eq!(run.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&run.stderr).contains(words));
        assert!(!output.exists());
    }
}
