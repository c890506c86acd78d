//! The table of PLY dialects: what programs are known to write, in small, for any encoding.

/// One row of an element: for a list property its items, else one number.
pub type Row = Vec<Vec<f64>>;

/// An element: its name, its properties as in a header, without `property`, and its rows.
pub type Element = (&'static str, String, Vec<Row>);

/// A PLY file to be written in any encoding.
pub struct Dialect {
    pub name: &'static str,
    pub remarks: &'static [&'static str],
    pub elements: Vec<Element>,
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
            lines.extend(properties.split(", ").map(|p| format!("property {p}")));
        }
        lines.push("end_header".to_owned());
        lines.push(String::new());
        let mut out = lines.join(end).into_bytes();
        let big = format == "binary_big_endian";
        for (_, properties, rows) in &self.elements {
            for row in rows {
                for (property, values) in properties.split(", ").zip(row) {
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

/// An element with properties in words, joined by commas.
pub fn element(name: &'static str, properties: &str, rows: Vec<Row>) -> Element {
    (name, properties.to_owned(), rows)
}

/// Four vertices with coordinates of a type and properties besides, each of one value.
fn points(kind: &str, more: &str, values: &[f64]) -> Element {
    let comma = if more.is_empty() { "" } else { ", " };
    ("vertex", format!("{kind} x, {kind} y, {kind} z{comma}{more}"), rows(4, values))
}

/// `n` vertices with nothing but their places.
pub fn places(n: usize) -> Element {
    element("vertex", "float x, float y, float z", rows(n, &[]))
}

/// Both triangles as faces, with properties in words.
fn faces(properties: &str) -> Element {
    element("face", properties, two_triangles(&[], &[]))
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

fn dialect(
    name: &'static str,
    remarks: &'static [&'static str],
    elements: Vec<Element>,
) -> Dialect {
    Dialect { name, remarks, elements }
}

/// Dialects of the two triangles (0, 1, 2) and (0, 2, 3).
pub fn table() -> Vec<Dialect> {
    const INDICES: &str = "list uchar int vertex_indices";
    const TEXTURE: &str = "list uchar float texcoord, int texnumber";
    let range = || faces(INDICES);
    let camera =
        || element("camera", "float view_px, int viewportx", vec![vec![vec![0.5], vec![3.0]]]);
    let weights =
        |row: &Row, n: usize| vec![row[0].clone(), vec![1.5; n], row[1].clone(), row[2].clone()];
    let with_lists = rows(4, &[]).into_iter().enumerate().map(|(i, row)| {
        let mut row = weights(&row, i * 3 % 5);
        row.push(vec![i as f64]);
        row
    });
    let with_pairs = rows(4, &[]).into_iter().map(|row| [row, vec![vec![1.0, 2.0]]].concat());
    let integers = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 1.0, 1.0], [0.0, 0.0, 1.0]];
    vec![
        dialect(
            "PoissonRecon",
            &[],
            vec![
                points(
                    "float",
                    "float value, uchar red, uchar green, uchar blue",
                    &[7.5, 255.0, 128.0, 0.0],
                ),
                faces("list int int vertex_indices"),
            ],
        ),
        dialect(
            "PoissonRecon, 64-bit indices",
            &[],
            vec![places(4), faces("list int longlong vertex_indices")],
        ),
        dialect(
            "PoissonRecon, unsigned 64-bit indices",
            &[],
            vec![places(4), faces("list int ulonglong vertex_indices")],
        ),
        dialect(
            "MeshLab",
            &["comment VCGLIB generated", "comment TextureFile skin.png"],
            vec![
                camera(),
                points(
                    "double",
                    "float nx, float ny, float nz, int flags, uchar red, uchar green, uchar blue, uchar alpha, double quality",
                    &[0.0, 0.0, 1.0, 0.0, 1.0, 2.0, 3.0, 255.0, 0.1],
                ),
                element(
                    "face",
                    &format!("{INDICES}, int flags, {TEXTURE}"),
                    two_triangles(&[], &[vec![0.0], vec![0.0; 6], vec![0.0]]),
                ),
                element("edge", "int vertex1, int vertex2", vec![vec![vec![0.0], vec![1.0]]]),
            ],
        ),
        dialect(
            "MeshLab, lists at vertices",
            &["comment VCGLIB generated"],
            vec![
                element(
                    "vertex",
                    "float x, list uchar float weights, float y, float z, int id",
                    with_lists.collect(),
                ),
                range(),
            ],
        ),
        dialect(
            "CloudCompare",
            &["comment made", "obj_info Generated by CloudCompare!"],
            vec![points("double", "float scalar_Dip", &[30.0]), range()],
        ),
        dialect(
            "Open3D",
            &["comment Created by Open3D"],
            vec![
                points(
                    "double",
                    "double nx, double ny, double nz, uchar red",
                    &[0.0, 0.6, 0.8, 9.0],
                ),
                faces("list uchar uint vertex_indices"),
            ],
        ),
        dialect(
            "RealityCapture",
            &["comment Created in Reality Capture "],
            vec![points("float", "uchar red", &[200.0]), range()],
        ),
        dialect(
            "Metashape",
            &["comment TextureFile model.jpg"],
            vec![
                points("float", "float nx, float ny, float nz", &[0.0, 0.0, 1.0]),
                element(
                    "face",
                    &format!("{INDICES}, {TEXTURE}"),
                    two_triangles(&[], &[vec![0.5; 6], vec![0.0]]),
                ),
            ],
        ),
        dialect(
            "Blender",
            &["comment Created in Blender version 4.2"],
            vec![
                points("float", "float s, float t, uchar alpha", &[0.25, 0.5, 9.0]),
                element(
                    "face",
                    "list uchar uint vertex_indices",
                    vec![vec![vec![0.0, 1.0, 2.0, 3.0]]],
                ),
            ],
        ),
        dialect(
            "PCL",
            &["comment PCL generated"],
            vec![points("float", "uchar red, float curvature", &[1.0, 0.5]), camera(), range()],
        ),
        dialect(
            "VTK",
            &["comment VTK generated PLY File", "obj_info vtkPolyData points and polygons"],
            vec![
                places(4),
                element(
                    "face",
                    &format!("{INDICES}, uchar red, uchar green, uchar blue"),
                    two_triangles(&[], &[vec![1.0], vec![2.0], vec![3.0]]),
                ),
            ],
        ),
        dialect(
            "trimesh",
            &["comment https://github.com/mikedh/trimesh"],
            vec![
                points("float", "uint64 label, int64 other, float16 weight", &[9e15, -5.0, 0.5]),
                element(
                    "face",
                    "int64 group, list uchar int64 vertex_index",
                    two_triangles(&[4.0], &[]),
                ),
            ],
        ),
        dialect(
            "Stanford zipper",
            &["comment zipper output"],
            vec![points("float", "float confidence, float intensity", &[0.9, 0.5]), range()],
        ),
        dialect(
            "Stanford statues",
            &["obj_info num_cols 512"],
            vec![
                places(4),
                element(
                    "tristrips",
                    "list int int vertex_indices",
                    vec![vec![vec![0.0, 1.0, 2.0, -1.0, -1.0, 0.0, 2.0, 3.0, -1.0]]],
                ),
            ],
        ),
        dialect(
            "strips of two triangles, every other reversed",
            &[],
            vec![
                places(4),
                element(
                    "tristrips",
                    "list int int vertex_indices",
                    vec![vec![vec![1.0, 2.0, 0.0, 3.0]]],
                ),
            ],
        ),
        dialect(
            "OpenMesh",
            &[],
            vec![
                element(
                    "vertex",
                    "float32 x, float32 y, float32 z, list uint8 float32 weights",
                    with_pairs.collect(),
                ),
                faces("list uint8 int32 vertex_indices"),
            ],
        ),
        dialect(
            "faces before vertices, unknown elements everywhere",
            &[],
            vec![
                element("odd", "list ushort double a, char b", vec![vec![vec![1.0; 3], vec![1.0]]]),
                range(),
                element("odd2", "double b", vec![vec![vec![1.0]], vec![vec![2.0]]]),
                places(4),
                element("odd3", "list ushort double a", vec![vec![vec![1.0; 7]]]),
            ],
        ),
        dialect(
            "padded counts, blank lines, trailing blanks",
            &["", "comment x  ", "   "],
            vec![places(4), range()],
        ),
        dialect(
            "integers as coordinates",
            &[],
            vec![
                element(
                    "vertex",
                    "short z, int x, uchar y",
                    integers.map(|p| p.map(|v| vec![v]).to_vec()).to_vec(),
                ),
                range(),
            ],
        ),
    ]
}
