//! The table of PLY dialects: what programs are known to write, in small, for any encoding.

/// One row of an element: for a list property its items, else one number.
pub type Row = Vec<Vec<f64>>;

/// A PLY file to be written in any encoding; property lines as in a header, without `property`.
pub struct Dialect {
    pub name: &'static str,
    pub remarks: &'static [&'static str],
    pub elements: Vec<(&'static str, Vec<&'static str>, Vec<Row>)>,
}

pub fn put(out: &mut Vec<u8>, kind: &str, value: f64, big: bool) {
    let start = out.len();
    match kind {
        "char" | "int8" => out.push(value as i8 as u8),
        "uchar" | "uint8" => out.push(value as u8),
        "short" | "int16" => out.extend((value as i16).to_le_bytes()),
        "ushort" | "uint16" => out.extend((value as u16).to_le_bytes()),
        "int" | "int32" => out.extend((value as i32).to_le_bytes()),
        "uint" | "uint32" => out.extend((value as u32).to_le_bytes()),
        "int64" | "longlong" => out.extend((value as i64).to_le_bytes()),
        "uint64" | "ulonglong" => out.extend((value as u64).to_le_bytes()),
        "float" | "float32" => out.extend((value as f32).to_le_bytes()),
        "double" | "float64" => out.extend(value.to_le_bytes()),
        "float16" => {
            // Only the numbers of these tests: 0, and powers of two.
            let half = if value == 0.0 { 0 } else { ((value.log2() as i32 + 15) as u16) << 10 };
            out.extend(half.to_le_bytes());
        }
        _ => panic!("{kind}"),
    }
    if big {
        out[start..].reverse();
    }
}

impl Dialect {
    pub fn write(&self, format: &str, end: &str) -> Vec<u8> {
        let mut lines = vec!["ply".to_owned(), format!("format {format} 1.0")];
        lines.extend(self.remarks.iter().map(|r| r.to_string()));
        for (name, properties, rows) in &self.elements {
            lines.push(format!("element {name} {}", rows.len()));
            lines.extend(properties.iter().map(|p| format!("property {p}")));
        }
        lines.push("end_header".to_owned());
        lines.push(String::new());
        let mut out = lines.join(end).into_bytes();
        let big = format == "binary_big_endian";
        for (_, properties, rows) in &self.elements {
            for row in rows {
                for (property, values) in properties.iter().zip(row) {
                    let words: Vec<_> = property.split(' ').collect();
                    let (count, kind) = if words[0] == "list" {
                        (Some(words[1]), words[2])
                    } else {
                        (None, words[0])
                    };
                    if format == "ascii" {
                        if count.is_some() {
                            out.extend(format!("{} ", values.len()).bytes());
                        }
                        values.iter().for_each(|v| out.extend(format!("{v} ").bytes()));
                        continue;
                    }
                    if let Some(count) = count {
                        put(&mut out, count, values.len() as f64, big);
                    }
                    values.iter().for_each(|&v| put(&mut out, kind, v, big));
                }
                if format == "ascii" {
                    out.extend(end.bytes());
                }
            }
        }
        out
    }
}

/// Turns positions and further numbers into rows of an element without lists.
pub fn rows(n: usize, extra: &[f64]) -> Vec<Row> {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]];
    let row = |i: usize| {
        let p = corners[i % 4].iter().map(|&v| vec![v]);
        p.chain(extra.iter().map(|&v| vec![v])).collect()
    };
    (0..n).map(row).collect()
}

pub const XYZ: [&str; 3] = ["float x", "float y", "float z"];
pub const DOUBLE_XYZ: [&str; 3] = ["double x", "double y", "double z"];

pub fn with(base: &[&'static str], more: &[&'static str]) -> Vec<&'static str> {
    base.iter().chain(more).copied().collect()
}

pub fn two_triangles(before: &[f64], after: &[Vec<f64>]) -> Vec<Row> {
    [[0.0, 1.0, 2.0], [0.0, 2.0, 3.0]]
        .iter()
        .map(|t| {
            let mut row: Row = before.iter().map(|&v| vec![v]).collect();
            row.push(t.to_vec());
            row.extend(after.iter().cloned());
            row
        })
        .collect()
}

/// A dialect of the two triangles (0, 1, 2) and (0, 2, 3).
pub fn table() -> Vec<Dialect> {
    let plain = || two_triangles(&[], &[]);
    let range = vec!["list uchar int vertex_indices"];
    vec![
        Dialect {
            name: "PoissonRecon",
            remarks: &[],
            elements: vec![
                (
                    "vertex",
                    with(&XYZ, &["float value", "uchar red", "uchar green", "uchar blue"]),
                    rows(4, &[7.5, 255.0, 128.0, 0.0]),
                ),
                ("face", vec!["list int int vertex_indices"], plain()),
            ],
        },
        Dialect {
            name: "PoissonRecon, 64-bit indices",
            remarks: &[],
            elements: vec![
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                ("face", vec!["list int longlong vertex_indices"], plain()),
            ],
        },
        Dialect {
            name: "PoissonRecon, unsigned 64-bit indices",
            remarks: &[],
            elements: vec![
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                ("face", vec!["list int ulonglong vertex_indices"], plain()),
            ],
        },
        Dialect {
            name: "MeshLab",
            remarks: &["comment VCGLIB generated", "comment TextureFile skin.png"],
            elements: vec![
                (
                    "camera",
                    vec!["float view_px", "int viewportx"],
                    vec![vec![vec![0.5], vec![3.0]]],
                ),
                (
                    "vertex",
                    with(
                        &DOUBLE_XYZ,
                        &[
                            "float nx",
                            "float ny",
                            "float nz",
                            "int flags",
                            "uchar red",
                            "uchar green",
                            "uchar blue",
                            "uchar alpha",
                            "double quality",
                        ],
                    ),
                    rows(4, &[0.0, 0.0, 1.0, 0.0, 1.0, 2.0, 3.0, 255.0, 0.1]),
                ),
                (
                    "face",
                    vec![
                        "list uchar int vertex_indices",
                        "int flags",
                        "list uchar float texcoord",
                        "int texnumber",
                    ],
                    two_triangles(&[], &[vec![0.0], vec![0.0; 6], vec![0.0]]),
                ),
                ("edge", vec!["int vertex1", "int vertex2"], vec![vec![vec![0.0], vec![1.0]]]),
            ],
        },
        Dialect {
            name: "MeshLab, lists at vertices",
            remarks: &["comment VCGLIB generated"],
            elements: vec![
                (
                    "vertex",
                    vec!["float x", "list uchar float weights", "float y", "float z", "int id"],
                    (0..4usize)
                        .map(|i| {
                            let p = rows(4, &[])[i].clone();
                            let list = vec![1.5; i * 3 % 5];
                            vec![p[0].clone(), list, p[1].clone(), p[2].clone(), vec![i as f64]]
                        })
                        .collect(),
                ),
                ("face", range.clone(), plain()),
            ],
        },
        Dialect {
            name: "CloudCompare",
            remarks: &["comment made", "obj_info Generated by CloudCompare!"],
            elements: vec![
                ("vertex", with(&DOUBLE_XYZ, &["float scalar_Dip"]), rows(4, &[30.0])),
                ("face", range.clone(), plain()),
            ],
        },
        Dialect {
            name: "Open3D",
            remarks: &["comment Created by Open3D"],
            elements: vec![
                (
                    "vertex",
                    with(&DOUBLE_XYZ, &["double nx", "double ny", "double nz", "uchar red"]),
                    rows(4, &[0.0, 0.6, 0.8, 9.0]),
                ),
                ("face", vec!["list uchar uint vertex_indices"], plain()),
            ],
        },
        Dialect {
            name: "RealityCapture",
            remarks: &["comment Created in Reality Capture "],
            elements: vec![
                ("vertex", with(&XYZ, &["uchar red"]), rows(4, &[200.0])),
                ("face", range.clone(), plain()),
            ],
        },
        Dialect {
            name: "Metashape",
            remarks: &["comment TextureFile model.jpg"],
            elements: vec![
                (
                    "vertex",
                    with(&XYZ, &["float nx", "float ny", "float nz"]),
                    rows(4, &[0.0, 0.0, 1.0]),
                ),
                (
                    "face",
                    vec![
                        "list uchar int vertex_indices",
                        "list uchar float texcoord",
                        "int texnumber",
                    ],
                    two_triangles(&[], &[vec![0.5; 6], vec![0.0]]),
                ),
            ],
        },
        Dialect {
            name: "Blender",
            remarks: &["comment Created in Blender version 4.2"],
            elements: vec![
                (
                    "vertex",
                    with(&XYZ, &["float s", "float t", "uchar alpha"]),
                    rows(4, &[0.25, 0.5, 9.0]),
                ),
                (
                    "face",
                    vec!["list uchar uint vertex_indices"],
                    vec![vec![vec![0.0, 1.0, 2.0, 3.0]]],
                ),
            ],
        },
        Dialect {
            name: "PCL",
            remarks: &["comment PCL generated"],
            elements: vec![
                ("vertex", with(&XYZ, &["uchar red", "float curvature"]), rows(4, &[1.0, 0.5])),
                (
                    "camera",
                    vec!["float view_px", "int viewportx"],
                    vec![vec![vec![0.5], vec![3.0]]],
                ),
                ("face", range.clone(), plain()),
            ],
        },
        Dialect {
            name: "VTK",
            remarks: &[
                "comment VTK generated PLY File",
                "obj_info vtkPolyData points and polygons",
            ],
            elements: vec![
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                (
                    "face",
                    vec!["list uchar int vertex_indices", "uchar red", "uchar green", "uchar blue"],
                    two_triangles(&[], &[vec![1.0], vec![2.0], vec![3.0]]),
                ),
            ],
        },
        Dialect {
            name: "trimesh",
            remarks: &["comment https://github.com/mikedh/trimesh"],
            elements: vec![
                (
                    "vertex",
                    with(&XYZ, &["uint64 label", "int64 other", "float16 weight"]),
                    rows(4, &[9e15, -5.0, 0.5]),
                ),
                (
                    "face",
                    vec!["int64 group", "list uchar int64 vertex_index"],
                    two_triangles(&[4.0], &[]),
                ),
            ],
        },
        Dialect {
            name: "Stanford zipper",
            remarks: &["comment zipper output"],
            elements: vec![
                (
                    "vertex",
                    with(&XYZ, &["float confidence", "float intensity"]),
                    rows(4, &[0.9, 0.5]),
                ),
                ("face", range.clone(), plain()),
            ],
        },
        Dialect {
            name: "Stanford statues",
            remarks: &["obj_info num_cols 512"],
            elements: vec![
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                (
                    "tristrips",
                    vec!["list int int vertex_indices"],
                    vec![vec![vec![0.0, 1.0, 2.0, -1.0, -1.0, 0.0, 2.0, 3.0, -1.0]]],
                ),
            ],
        },
        Dialect {
            name: "strips of two triangles, every other reversed",
            remarks: &[],
            elements: vec![
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                (
                    "tristrips",
                    vec!["list int int vertex_indices"],
                    vec![vec![vec![1.0, 2.0, 0.0, 3.0]]],
                ),
            ],
        },
        Dialect {
            name: "OpenMesh",
            remarks: &[],
            elements: vec![
                (
                    "vertex",
                    vec!["float32 x", "float32 y", "float32 z", "list uint8 float32 weights"],
                    rows(4, &[])
                        .into_iter()
                        .map(|mut r| {
                            r.push(vec![1.0, 2.0]);
                            r
                        })
                        .collect(),
                ),
                ("face", vec!["list uint8 int32 vertex_indices"], plain()),
            ],
        },
        Dialect {
            name: "faces before vertices, unknown elements everywhere",
            remarks: &[],
            elements: vec![
                (
                    "odd",
                    vec!["list ushort double a", "char b"],
                    vec![vec![vec![1.0; 3], vec![1.0]]],
                ),
                ("face", range.clone(), plain()),
                ("odd2", vec!["double b"], vec![vec![vec![1.0]], vec![vec![2.0]]]),
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                ("odd3", vec!["list ushort double a"], vec![vec![vec![1.0; 7]]]),
            ],
        },
        Dialect {
            name: "padded counts, blank lines, trailing blanks",
            remarks: &["", "comment x  ", "   "],
            elements: vec![
                ("vertex", XYZ.to_vec(), rows(4, &[])),
                ("face", range.clone(), plain()),
            ],
        },
        Dialect {
            name: "integers as coordinates",
            remarks: &[],
            elements: vec![
                (
                    "vertex",
                    vec!["short z", "int x", "uchar y"],
                    [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 1.0, 1.0], [0.0, 0.0, 1.0]]
                        .iter()
                        .map(|p| p.iter().map(|&v| vec![v]).collect())
                        .collect(),
                ),
                ("face", range, plain()),
            ],
        },
    ]
}
