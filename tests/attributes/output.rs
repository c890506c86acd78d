//! In which form attributes are written: normals kept, computed or dropped; textures at corners after any
//! number of cells, in PLY and OBJ.

use crate::common::{check, count, expect, scratch};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A sheet of 2 n^2 triangles in 4 x 4 charts as OBJ: the left half of one material, the right of another,
/// with `vt` lines after the faces that name them, some of them counted from the end.
fn sheet(n: usize) -> String {
    let mut text = "# a sheet\nmtllib sheet.mtl\n".to_owned();
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
            let z = 0.1 * (9.0 * x).sin() * (7.0 * y).cos() + 0.01 * (61.0 * x * y).sin();
            text.push_str(&format!("v {x:.6} {y:.6} {z:.6}\n"));
        }
    }
    let size = n / 4;
    let id = |i: usize, j: usize| i * (n + 1) + j + 1;
    for ci in 0..4 {
        text.push_str(if ci == 0 { "usemtl left side\n" } else { "" });
        text.push_str(if ci == 2 { "usemtl right\n" } else { "" });
        for cj in 0..4 {
            let chart = ci * 4 + cj;
            let first = chart * (size + 1) * (size + 1) + 1;
            let vt = |k: usize, l: usize| first + k * (size + 1) + l;
            let mut coordinates = String::new();
            for k in 0..=size {
                for l in 0..=size {
                    let u = (ci as f64 + 0.1 + 0.8 * k as f64 / size as f64) / 4.0;
                    let v = (cj as f64 + 0.1 + 0.8 * l as f64 / size as f64) / 4.0;
                    coordinates.push_str(&format!("vt {u:.6} {v:.6}\n"));
                }
            }
            let relative = chart % 2 == 1;
            if relative {
                text.push_str(&coordinates);
            }
            for k in 0..size {
                for l in 0..size {
                    let corner = |(a, b): (usize, usize)| {
                        let t = vt(k + a, l + b) as i64;
                        let t = if relative { t - (vt(size, size) as i64 + 1) } else { t };
                        format!("{}/{t}", id(ci * size + k + a, cj * size + l + b))
                    };
                    let quad = [(0, 0), (1, 0), (1, 1), (0, 1)].map(corner);
                    text.push_str(&format!("f {}\n", quad.join(" ")));
                }
            }
            if !relative {
                text.push_str(&coordinates);
            }
        }
    }
    text
}

/// Faces of an OBJ file: place, texture coordinates and material of each corner.
struct Obj {
    positions: Vec<[String; 3]>,
    faces: Vec<([usize; 3], [[f64; 2]; 3], String)>,
}

fn read_obj(path: &Path) -> Obj {
    let text = std::fs::read_to_string(path).unwrap();
    let stem = path.file_stem().unwrap().to_str().unwrap();
    assert!(text.contains(&format!("\nmtllib {stem}.mtl\n")));
    let mut obj = Obj { positions: Vec::new(), faces: Vec::new() };
    let (mut coordinates, mut material) = (Vec::new(), String::new());
    for line in text.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[0] {
            "v" => obj.positions.push([1, 2, 3].map(|k| words[k].to_owned())),
            "vt" => coordinates.push([1, 2].map(|k| words[k].parse::<f64>().unwrap())),
            "usemtl" => material = line[7..].to_owned(),
            "f" => {
                let corner = |k: usize| {
                    let parts: Vec<usize> =
                        words[k].split('/').map(|part| part.parse().unwrap()).collect();
                    (parts[0] - 1, coordinates[parts[1] - 1])
                };
                let corners = [1, 2, 3].map(corner);
                let (v, uv) = (corners.map(|c| c.0), corners.map(|c| c.1));
                obj.faces.push((v, uv, material.clone()));
            }
            _ => {}
        }
    }
    obj
}

fn open_edges(faces: impl Iterator<Item = [usize; 3]>) -> usize {
    let mut count: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for [a, b, c] in faces {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            *count.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    assert!(count.values().all(|&n| n <= 2), "manifold");
    count.values().filter(|&&n| n == 1).count()
}

#[test]
fn textures_of_obj_come_back_from_one_cell_and_from_many() {
    let folder = &scratch();
    std::fs::write(folder.join("in.obj"), sheet(120)).unwrap();
    let library = "newmtl right\nmap_Kd -s 1 1 1 right.png\nnewmtl left side\nmap_Kd left.png\n";
    std::fs::write(folder.join("sheet.mtl"), library).unwrap();
    // 10,000 triangles of cells of 1000 are too many for one finish: the result has many cells.
    for (cells, target) in [("1M", 1000), ("1000", 1000), ("1000", 10_000)] {
        let options = format!("--triangles {target} --cell-triangles {cells} --force -q");
        // The images are not there.
        expect(folder, &format!("simplify in.obj out.obj {options}"), 3);
        let mesh = read_obj(&folder.join("out.obj"));
        assert!(mesh.faces.len() <= target && mesh.faces.len() * 100 >= target * 98);
        let places: BTreeSet<_> = mesh.positions.iter().collect();
        assert_eq!(places.len(), mesh.positions.len(), "one vertex in one place");
        for (_, uv, material) in &mesh.faces {
            let chart = |[u, v]: [f64; 2]| [u * 4.0, v * 4.0].map(f64::floor);
            assert!(uv.iter().all(|&x| chart(x) == chart(uv[0])), "{uv:?}");
            for x in uv.iter().flatten() {
                assert!((0.0999..0.9001).contains(&(x * 4.0).fract()), "{x}");
            }
            assert_eq!(material, if uv[0][0] < 0.5 { "left side" } else { "right" });
        }
        assert!(open_edges(mesh.faces.iter().map(|f| f.0)) < 500);
    }
    // As PLY: the form that carries the images' names.
    expect(folder, "simplify in.obj out.ply --triangles 10k --cell-triangles 1000 -q", 3);
    let bytes = std::fs::read(folder.join("out.ply")).unwrap();
    let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    assert!(header.contains("comment TextureFile left.png\ncomment TextureFile right.png\n"));
    assert!(header.contains("property list uchar float texcoord\nproperty int texnumber\n"));
    let json = check(folder, "out.ply");
    assert_eq!(count(&json, "components"), 1);
    assert!(count(&json, "boundary_edges") < 500);
    // And from there to OBJ again.
    expect(folder, "simplify out.ply again.obj --triangles 500 -q", 3);
    // A collapse inside takes two triangles at once.
    let left = read_obj(&folder.join("again.obj")).faces.len();
    assert!((499..=500).contains(&left), "{left}");
}

/// Vertices of a PLY whose vertex rows are floats only: names, rows; and its triangles.
fn floats(path: &Path) -> (Vec<String>, Vec<Vec<f32>>, Vec<[usize; 3]>) {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let number = |what: &str| -> usize {
        let line = header.lines().find(|line| line.starts_with(what)).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let names: Vec<String> = header
        .lines()
        .filter_map(|line| line.strip_prefix("property float "))
        .map(str::to_owned)
        .collect();
    let (n, m, row) = (number("element vertex"), number("element face"), 4 * names.len());
    let word = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let rows = (0..n).map(|v| (0..row / 4).map(|k| word(end + v * row + 4 * k)).collect());
    let rows: Vec<Vec<f32>> = rows.collect();
    let faces = (0..m).map(|f| {
        let at = end + n * row + 13 * f + 1;
        let index = |k: usize| i32::from_le_bytes(bytes[at + k..at + k + 4].try_into().unwrap());
        [0, 4, 8].map(|k| index(k) as usize)
    });
    (names, rows, faces.collect())
}

/// A sphere of 20 * 4^5 triangles with normals of length 1 but for every fifth, and a scalar.
fn sphere(path: &Path) {
    let mut bytes = Vec::new();
    let (points, faces) = crate::faces::sphere(100);
    let points: Vec<_> = points.into_iter().map(|p| p.map(|x| x / 10.0)).collect();
    bytes.extend(
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n\
             property float y\nproperty float z\nproperty float nx\nproperty float ny\n\
             property float nz\nproperty float quality\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n",
            points.len(),
            faces.len()
        )
        .into_bytes(),
    );
    for p in &points {
        let all = p.iter().map(|x| 10.0 * x).chain(*p).chain([p[2]]);
        all.for_each(|x| bytes.extend((x as f32).to_le_bytes()));
    }
    for t in &faces {
        bytes.push(3);
        t.iter().for_each(|&v| bytes.extend((v as i32).to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

/// Sums of the normals of each vertex's triangles, weighted by area.
fn area_normals(rows: &[Vec<f32>], faces: &[[usize; 3]]) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0; 3]; rows.len()];
    for t in faces {
        let cross =
            stonecut::mesh::vec3::normal(t.map(|v| [0, 1, 2].map(|k| f64::from(rows[v][k]))));
        for &corner in t {
            (0..3).for_each(|k| sums[corner][k] += cross[k]);
        }
    }
    sums
}

#[test]
fn normals_are_kept_computed_anew_or_dropped() {
    let folder = &scratch();
    sphere(&folder.join("in.ply"));
    let names = |with: bool| {
        let all = ["x", "y", "z", "nx", "ny", "nz", "quality"];
        all.into_iter().filter(|n| with || !n.starts_with('n')).collect::<Vec<_>>()
    };
    // The last is the result of many cells.
    for (cells, target) in [("1M", 1000), ("1000", 1000), ("1000", 10_000)] {
        let mut positions = Vec::new();
        for what in ["keep", "recompute", "drop"] {
            let options = format!("--triangles {target} --cell-triangles {cells} --force -q");
            expect(folder, &format!("simplify in.ply out.ply {options} --normals {what}"), 0);
            let (found, rows, faces) = floats(&folder.join("out.ply"));
            assert_eq!(found, names(what != "drop"));
            assert_eq!(open_edges(faces.iter().copied()), 0);
            positions.push(rows.iter().map(|row| row[..3].to_vec()).collect::<Vec<_>>());
            if what == "drop" {
                continue;
            }
            for row in &rows {
                let length = (row[3] * row[3] + row[4] * row[4] + row[5] * row[5]).sqrt();
                assert!((length - 1.0).abs() < 1e-5, "{row:?}");
                if what == "recompute" {
                    continue;
                }
                let radius = (row[0] * row[0] + row[1] * row[1] + row[2] * row[2]).sqrt();
                let cosine = (row[0] * row[3] + row[1] * row[4] + row[2] * row[5]) / radius;
                assert!(cosine > 0.97, "{what} {cells} {target}: {cosine} {row:?}");
            }
            if what == "recompute" {
                for (row, sum) in rows.iter().zip(area_normals(&rows, &faces)) {
                    let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
                    let cosine: f64 = (0..3).map(|k| sum[k] * f64::from(row[3 + k])).sum();
                    assert!(cosine > 0.9999 * length, "{cells} {target}: {row:?}, not {sum:?}");
                }
            }
        }
        assert!(positions.iter().all(|p| *p == positions[0]), "only normals differ");
    }
    // Without normals in the input: none, unless asked for.
    expect(folder, "simplify out.ply none.ply --triangles 1000 -q", 0);
    assert_eq!(floats(&folder.join("none.ply")).0, ["x", "y", "z", "quality"]);
    expect(folder, "simplify out.ply new.ply --triangles 1000 --normals recompute -q", 0);
    let (found, rows, _) = floats(&folder.join("new.ply"));
    assert_eq!(found, ["x", "y", "z", "quality", "nx", "ny", "nz"]);
    assert!(rows.iter().all(|r| r[0] * r[4] + r[1] * r[5] + r[2] * r[6] > 9.8));
}
