//! Every property name that programs are known to write comes back, with its type and its meaning.

use crate::common::{expect, scratch};
use crate::faces::{bytes_of, number, put};
use std::path::Path;

/// Vertex properties of a program besides x, y and z, as in ../shared/PLY-DIALECTS.md.
const DIALECTS: [(&str, &str, &str); 12] = [
    (
        "PoissonRecon",
        "float",
        "float nx, float ny, float nz, float value, uchar red, uchar green, uchar blue",
    ),
    (
        "MeshLab",
        "double",
        "double nx, double ny, double nz, int flags, uchar red, uchar green, uchar blue, \
         uchar alpha, double quality, float radius, float texture_u, float texture_v, \
         float user",
    ),
    (
        "CloudCompare",
        "double",
        "uchar red, uchar green, uchar blue, float nx, float ny, float nz, \
         float scalar_Intensity, float scalar_Number_of_returns",
    ),
    ("Open3D", "double", "double nx, double ny, double nz, uchar red, uchar green, uchar blue"),
    ("RealityCapture", "float", "uchar red, uchar green, uchar blue"),
    (
        "Metashape",
        "float",
        "float nx, float ny, float nz, uchar red, uchar green, uchar blue, float confidence",
    ),
    (
        "Blender",
        "float",
        "float nx, float ny, float nz, float s, float t, uchar red, uchar green, uchar blue, uchar alpha",
    ),
    (
        "PCL",
        "float",
        "uchar red, uchar green, uchar blue, float nx, float ny, float nz, float curvature",
    ),
    ("VTK", "float", "uchar red, uchar green, uchar blue, uchar alpha"),
    (
        "trimesh",
        "float",
        "float nx, float ny, float nz, uchar red, uchar green, uchar blue, uchar alpha, \
         int64 id, uint64 time",
    ),
    ("Stanford zipper", "float", "float confidence, float intensity"),
    (
        "others",
        "float",
        "ushort r, ushort g, ushort b, uchar diffuse_red, uchar diffuse_green, \
         uchar diffuse_blue, float u, float v, short class, char sign, ushort count, \
         uint label",
    ),
];

/// What a property is at a place of the sheet: a constant for labels and normals, smooth for the rest.
fn value(kind: &str, name: &str, x: f64) -> f64 {
    match (kind, name) {
        (_, "nx" | "ny") => 0.0,
        (_, "nz") => 1.0,
        ("uchar" | "ushort", _) if name != "count" => 20.0 + 200.0 * x,
        ("float" | "double", _) => 0.25 + 0.5 * x,
        ("char" | "short", _) => -7.0,
        _ => 1_000_003.0 % 65_521.0,
    }
}

fn write(path: &Path, coordinate: &str, properties: &[&str]) {
    let n = 40usize;
    let mut bytes =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", (n + 1) * (n + 1));
    for axis in ["x", "y", "z"] {
        bytes.push_str(&format!("property {coordinate} {axis}\n"));
    }
    properties.iter().for_each(|p| bytes.push_str(&format!("property {p}\n")));
    bytes.push_str(&format!(
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        2 * n * n
    ));
    let mut bytes = bytes.into_bytes();
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
            [x, y, 0.05 * (9.0 * x).sin() * (8.0 * y).sin()]
                .iter()
                .for_each(|v| put(coordinate, *v, &mut bytes));
            for property in properties {
                let (kind, name) = property.split_once(' ').unwrap();
                put(kind, value(kind, name, x), &mut bytes);
            }
        }
    }
    for i in 0..n {
        for j in 0..n {
            let id = |k: usize, l: usize| ((i + k) * (n + 1) + j + l) as i32;
            for t in [[id(0, 0), id(1, 0), id(1, 1)], [id(0, 0), id(1, 1), id(0, 1)]] {
                bytes.push(3);
                t.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            }
        }
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn every_property_of_every_program_comes_back() {
    let folder = &scratch();
    for (program, coordinate, properties) in DIALECTS {
        let properties: Vec<&str> = properties.split(", ").collect();
        write(&folder.join("in.ply"), coordinate, &properties);
        for cells in ["1M", "1000"] {
            let options = format!("--triangles 300 --cell-triangles {cells} --force -q");
            expect(folder, &format!("simplify in.ply out.ply {options}"), 0);
            let bytes = std::fs::read(folder.join("out.ply")).unwrap();
            let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
            let mut wanted: Vec<String> =
                ["x", "y", "z"].iter().map(|axis| format!("{coordinate} {axis}")).collect();
            wanted.extend(properties.iter().map(|p| (*p).to_owned()));
            let found: Vec<&str> = header
                .lines()
                .skip_while(|line| !line.starts_with("element vertex"))
                .skip(1)
                .map_while(|line| line.strip_prefix("property "))
                .collect();
            assert_eq!(found, wanted, "{program}");
            let line = header.lines().find(|line| line.starts_with("element vertex")).unwrap();
            let n: usize = line[15..].parse().unwrap();
            let mut at = end;
            for _ in 0..n {
                let mut x = 0.0;
                for (i, property) in wanted.iter().enumerate() {
                    let (kind, name) = property.split_once(' ').unwrap();
                    let read = number(kind, &bytes[at..at + bytes_of(kind)]);
                    at += bytes_of(kind);
                    match i {
                        0 => x = read,
                        1 | 2 => {}
                        _ => {
                            let expected = value(kind, name, x);
                            let off = (read - expected).abs();
                            // Colours are rounded; averages follow the place within an edge or so.
                            let allowed = match kind {
                                "uchar" | "ushort" if name != "count" => 12.0,
                                "float" | "double" => 0.03,
                                _ => 0.0,
                            };
                            assert!(
                                off <= allowed,
                                "{program} {name}: {read}, not {expected} at {x}"
                            );
                        }
                    }
                }
            }
        }
    }
}
