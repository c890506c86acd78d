//! STL, OBJ, GLB, compressed input and `convert`.

#![allow(clippy::type_complexity)]

use std::io::Write;
use std::path::Path;
use stonecut::cli::convert::{Args, Converted, InOut, convert};
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};
use stonecut::io::{OutputFormat, StageOptions, Weld};

type AnyResult<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn open(path: &Path) -> stonecut::Result<MeshSource> {
    MeshSource::open_staged(path, &StageOptions::new(std::env::temp_dir()))
}

/// Positions of the corners of all triangles, each from its smallest corner on, sorted; -0 is 0.
fn soup(source: &MeshSource) -> stonecut::Result<Vec<[[u64; 3]; 3]>> {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    let schema = source.schema();
    for i in 0..source.n_vertex_blocks() {
        source.read_vertices(i, &mut vertices)?;
        let records = vertices.records.chunks_exact(schema.record_bytes());
        positions.extend(records.map(|r| schema.position(r).map(|v| (v + 0.0).to_bits())));
    }
    for i in 0..source.n_face_blocks() {
        source.read_faces(i, &mut faces)?;
        triangles.extend(faces.triangles.iter().map(|t| {
            let p = t.map(|v| positions[v as usize]);
            (0..3).map(|i| [p[i], p[(i + 1) % 3], p[(i + 2) % 3]]).min().unwrap_or(p)
        }));
    }
    triangles.sort_unstable();
    Ok(triangles)
}

fn to(input: &Path, output: &Path, format: &str) -> stonecut::Result<Converted> {
    let format: OutputFormat = format.parse().map_err(stonecut::Error::Usage)?;
    convert(&Args {
        paths: InOut { input: input.into(), output: output.into() },
        format,
        force: false,
        skip_bad: false,
        drop_texture: false,
        drop_names: false,
        placing: Default::default(),
        textures: None,
        keep_duplicates: false,
        keep_unreferenced: false,
        split: None,
        weld: Some(Weld::Off),
        temp_dir: None,
        memory: None,
        report: None,
    })
}

/// A bumpy grid with colours and normals, and one vertex that no face uses.
fn bumpy(path: &Path, side: u32) -> AnyResult {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment made here\nobj_info old 1\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nproperty float nx\n\
         property float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty float quality\nproperty int label\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        side * side + 1,
        (side - 1) * (side - 1) * 2
    );
    text.push_str("9 9 9 0 0 1 1 2 3 0.5 -7\n");
    for i in 0..side * side {
        let (x, y) = (f64::from(i % side) / 7.0, f64::from(i / side) / 7.0);
        let z = (3.0 * x).sin() * (2.0 * y).cos();
        text.push_str(&format!("{x} {y} {z} 0.6 0 0.8 {} {} 0 {x} {i}\n", i % 256, i / 7 % 256));
    }
    for y in 0..side - 1 {
        for x in 0..side - 1 {
            let a = y * side + x + 1;
            text.push_str(&format!("3 {a} {} {}\n", a + 1, a + side));
            text.push_str(&format!("3 {} {} {}\n", a + 1, a + side + 1, a + side));
        }
    }
    Ok(std::fs::write(path, text)?)
}

#[test]
fn every_output_reads_back_as_the_same_triangles() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let input = folder.path().join("in.ply");
    bumpy(&input, 40)?;
    let source = open(&input)?;
    let expected = soup(&source)?;
    let cases = [
        ("a.ply", "ascii"),
        ("b.ply", ""),
        ("c.ply", "binary_big_endian"),
        ("d.ply", "double,uint"),
        ("e.ply", "ascii,double"),
        ("f.stl", ""),
        ("g.stl", "ascii"),
        ("h.obj", ""),
    ];
    for (name, format) in cases {
        let output = folder.path().join(name);
        let done = to(&input, &output, format)?;
        assert_eq!((done.n_vertices, done.n_triangles), (1600, 3042), "{name}");
        assert_eq!((done.n_unreferenced, done.n_degenerate, done.n_bad), (1, 0, 0), "{name}");
        let back = open(&output)?;
        assert_eq!(back.n_vertices(), 1600, "{name}: welded exactly");
        assert!(soup(&back)? == expected, "{name}");
        if name.ends_with("ply") {
            assert_eq!(back.schema().properties, source.schema().properties, "{name}");
            assert_eq!(back.obj_infos(), ["old 1"]);
            assert_eq!(back.comments()[0], "made here");
        }
    }
    // The long way round comes back to the same bytes, all attributes included.
    let second = folder.path().join("second.ply");
    to(&folder.path().join("a.ply"), &second, "")?;
    let body = |path: &Path| -> AnyResult<Vec<u8>> {
        let bytes = std::fs::read(path)?;
        let header = b"end_header\n";
        let at = bytes.windows(header.len()).position(|w| w == header).ok_or("no header")?;
        Ok(bytes[at..].to_vec())
    };
    assert_eq!(body(&second)?, body(&folder.path().join("b.ply"))?);
    let names = std::fs::read_dir(folder.path())?.count();
    assert_eq!(names, 1 + cases.len() + 1, "no temporary file is left");
    Ok(())
}

#[test]
fn repeated_and_degenerate_faces_are_dropped_and_counted() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let (input, output) = (folder.path().join("in.obj"), folder.path().join("out.ply"));
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 9 9 9\nf 1 2 3\nf 2 3 1\nf 1 1 2\nf 3 2 1\n";
    std::fs::write(&input, text)?;
    let done = to(&input, &output, "")?;
    assert_eq!((done.n_triangles, done.n_vertices), (1, 3));
    assert_eq!((done.n_duplicate, done.n_degenerate, done.n_unreferenced), (2, 1, 1));
    Ok(())
}

#[test]
fn a_glb_holds_the_mesh_within_half_a_step() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let input = folder.path().join("in.ply");
    bumpy(&input, 30)?;
    let output = folder.path().join("out.glb");
    to(&input, &output, "")?;
    let bytes = std::fs::read(&output)?;
    let word =
        |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!((word(4), word(8) as usize), (2, bytes.len()));
    let json_bytes = word(12) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_bytes])?;
    assert_eq!(json["extensionsRequired"][0], "KHR_mesh_quantization");
    let bin = 20 + json_bytes + 8;
    assert_eq!(word(bin - 8) as usize, bytes.len() - bin);
    let scale = json["nodes"][0]["scale"][0].as_f64().ok_or("scale")?;
    let stride = json["bufferViews"][0]["byteStride"].as_u64().ok_or("stride")? as usize;
    assert_eq!(stride, 20);
    let source = open(&input)?;
    let mut block = VertexBlock::default();
    source.read_vertices(0, &mut block)?;
    let records = block.records.chunks_exact(source.schema().record_bytes()).skip(1);
    for (i, record) in records.enumerate() {
        let position = source.schema().position(record);
        for axis in 0..3 {
            let at = bin + i * stride + 2 * axis;
            let steps = f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
            let origin = json["nodes"][0]["translation"][axis].as_f64().ok_or("translation")?;
            assert!((origin + steps * scale - position[axis]).abs() <= 0.501 * scale);
        }
        let at = bin + i * stride + 8;
        let light = f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])) / 65_535.0;
        let red = match light {
            light if light <= 0.003_130_8 => 12.92 * light,
            light => 1.055 * light.powf(1.0 / 2.4) - 0.055,
        };
        assert_eq!((255.0 * red).round() as u8, record[24], "red");
    }
    Ok(())
}

#[test]
fn compressed_input_is_a_stream() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let input = folder.path().join("in.ply");
    bumpy(&input, 30)?;
    let plain = std::fs::read(&input)?;
    let expected = soup(&open(&input)?)?;
    let half = plain.len() / 2;
    let mut packed = Vec::new();
    for part in [&plain[..half], &plain[half..]] {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(part)?;
        packed.extend(encoder.finish()?);
    }
    // What is packed, the bytes say, not the name.
    let gzip = folder.path().join("mesh.bin");
    std::fs::write(&gzip, &packed)?;
    assert!(soup(&open(&gzip)?)? == expected);
    let zstd = folder.path().join("mesh.ply.zst");
    std::fs::write(&zstd, zstd::encode_all(&plain[..], 3)?)?;
    assert!(soup(&open(&zstd)?)? == expected);

    std::fs::write(&gzip, &packed[..packed.len() - 40])?;
    let message = open(&gzip).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("damaged or cut off"), "{message}");
    Ok(())
}

fn staged(name: &str, text: &str, skip_bad: bool) -> stonecut::Result<MeshSource> {
    let mut options = StageOptions::new(std::env::temp_dir());
    options.read.skip_bad = skip_bad;
    MeshSource::staged_from_bytes(name, text.as_bytes().to_vec(), &options)
}

#[test]
fn obj_with_polygons_negative_indices_and_colours() -> AnyResult {
    let text = "# made here\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0.5 0 0 0.5\nvn 0 0 1\n\
         g side\nf 1//1 2//1 3//1 4//1\nf -4 \\\n -3 -2\nv 5 5 5 1 1 1\nf -1/7 1 2\nl 1 2\n";
    let source = staged("a.obj", text, false)?;
    assert_eq!((source.n_vertices(), source.n_face_rows()), (5, 3));
    let mut faces = FaceBlock::default();
    source.read_faces(0, &mut faces)?;
    // The diagonal from corner 1 to 3 is longer than the one from 0 to 2: (1,0,0)-(0,1,0.5).
    assert_eq!(faces.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [4, 0, 1]]);
    let mut vertices = VertexBlock::default();
    source.read_vertices(0, &mut vertices)?;
    assert_eq!(source.schema().properties.len(), 3);
    assert_eq!(&vertices.records[15 * 3 + 12..15 * 4], [0, 0, 128]);
    assert!(source.texture().is_none());
    assert_eq!(source.comments(), ["made here"]);

    // Without a name that says OBJ, the text does; far from the origin, coordinates are doubles.
    let far = "mtllib a.mtl\nv 500000.123 1 2\nv 500001.5 1 2\nv 500000 2 2\nf 1/1 2/1 3/1\n";
    let source = staged("standard input", far, false)?;
    let mut vertices = VertexBlock::default();
    source.read_vertices(0, &mut vertices)?;
    assert_eq!(source.schema().position(&vertices.records)[0], 500000.123);
    assert_eq!(source.texture().map(|t| t.files), Some(vec!["a.mtl".to_owned()]));

    for (body, wanted) in [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4 (byte offset 24): the corner '4'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "the corner '0'"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 -3\n", "the corner '-3'"),
        ("v 0 0\n", "line 1 (byte offset 0): a vertex has fewer"),
        ("v 0 0 nan\nf 1 1 1\n", "not finite"),
        ("v 0 0 zero\n", "is not a number"),
    ] {
        let message = staged("bad.obj", body, false).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains(wanted), "{message} lacks {wanted}");
    }
    let source = staged("bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\nf 1 2 3\n", true)?;
    assert_eq!((source.n_face_rows(), source.faults().bad_faces), (1, 1));
    Ok(())
}

#[test]
fn stl_is_told_apart_and_welded() -> AnyResult {
    let text = "solid a vertex in the name\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   \
         vertex 1 0 0\n   vertex 0 1 -0\n  endloop\n endfacet\n facet normal 0 0 1\n  outer loop\n   \
         VERTEX 1 0 -0\n   vertex 1 1 0\n   vertex 0 1\n 0\n  endloop\n endfacet\nendsolid a\n";
    let source = staged("a.stl", text, false)?;
    assert_eq!((source.n_vertices(), source.n_face_rows()), (4, 2));
    let mut faces = FaceBlock::default();
    source.read_faces(0, &mut faces)?;
    assert_eq!(faces.triangles, [[0, 1, 2], [1, 3, 2]]);

    // A binary file whose header begins with "solid".
    let mut binary = b"solid binary".to_vec();
    binary.resize(80, b' ');
    binary.extend(2u32.to_le_bytes());
    for corners in [
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0f32, 1.0, 0.0]],
    ] {
        binary.extend([0u8; 12]);
        corners.as_flattened().iter().for_each(|v: &f32| binary.extend(v.to_le_bytes()));
        binary.extend([0u8; 2]);
    }
    let options = StageOptions::new(std::env::temp_dir());
    let source = MeshSource::staged_from_bytes("b.stl", binary.clone(), &options)?;
    assert_eq!((source.n_vertices(), source.n_face_rows()), (4, 2));
    assert_eq!(source.comments(), ["solid binary"]);
    binary.truncate(84 + 70);
    binary[0] = b'x';
    let message = MeshSource::staged_from_bytes("b.stl", binary.clone(), &options).unwrap_err();
    assert!(message.to_string().contains("facet 1, byte offset 154"), "{message}");
    let mut lenient = options.clone();
    lenient.read.skip_bad = true;
    let source = MeshSource::staged_from_bytes("b.stl", binary, &lenient)?;
    assert_eq!((source.n_face_rows(), source.faults().bad_faces), (1, 1));
    let message = staged("c.stl", &text.replace("1 1 0", "1 inf 0"), false).unwrap_err();
    assert!(message.to_string().contains("not finite"), "{message}");
    let message = staged("c.stl", &text.replace("endsolid a\n", ""), false).unwrap_err();
    assert!(message.to_string().contains("endsolid"), "{message}");
    assert!(staged("x.bin", "nothing like a mesh", false).is_err());
    Ok(())
}

/// With the least memory, every sort spills; the result is the same.
#[test]
fn welding_does_not_depend_on_memory() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let (ply, stl) = (folder.path().join("in.ply"), folder.path().join("in.stl"));
    bumpy(&ply, 120)?;
    to(&ply, &stl, "")?;
    let read = |memory_bytes| -> stonecut::Result<_> {
        let options = StageOptions { memory_bytes, ..StageOptions::new(folder.path()) };
        let source = MeshSource::open_staged(&stl, &options)?;
        let mut faces = FaceBlock::default();
        source.read_faces(0, &mut faces)?;
        Ok((source.n_vertices(), soup(&source)?, faces.triangles))
    };
    assert!(read(0)? == read(1 << 30)?);
    assert_eq!(read(0)?.0, 120 * 120);
    Ok(())
}

#[test]
fn convert_refuses_what_it_cannot_keep() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let input = folder.path().join("in.ply");
    bumpy(&input, 5)?;
    let usage = |result: stonecut::Result<Converted>| result.unwrap_err().exit_code();
    assert_eq!(usage(to(&input, &input, "")), 2, "exists");
    assert_eq!(usage(to(&input, &folder.path().join("a.xyz"), "")), 2);
    assert_eq!(usage(to(&input, &folder.path().join("a.stl"), "double")), 2);
    assert_eq!(usage(to(&input, &folder.path().join("a.ply"), "big")), 2);
    assert_eq!(usage(to(&input, &folder.path().join("a.ply"), "ascii,binary")), 2);
    assert_eq!(std::fs::read_dir(folder.path())?.count(), 1);
    Ok(())
}

/// A triangle as corner positions, from the smallest corner on; -0 is 0.
fn turned(corners: [[f32; 3]; 3]) -> [[u64; 3]; 3] {
    let p = corners.map(|c| c.map(|v| (f64::from(v) + 0.0).to_bits()));
    (0..3).map(|i| [p[i], p[(i + 1) % 3], p[(i + 2) % 3]]).min().unwrap_or(p)
}

/// Our PLY files, of every encoding, read by ply-rs-bw: every property of every vertex, every corner.
#[test]
fn ply_rs_reads_what_we_write() -> AnyResult {
    use ply_rs_bw::ply::{DefaultElement, Property};
    let folder = tempfile::tempdir()?;
    let input = folder.path().join("in.ply");
    bumpy(&input, 30)?;
    let read = |path: &Path| -> AnyResult<ply_rs_bw::ply::Ply<DefaultElement>> {
        let parser = ply_rs_bw::parser::Parser::<DefaultElement>::new();
        Ok(parser.read_ply(&mut std::io::BufReader::new(std::fs::File::open(path)?))?)
    };
    let wide = |property: &Property| match property {
        Property::Float(v) => f64::from(*v),
        Property::Double(v) => *v,
        Property::UChar(v) => f64::from(*v),
        Property::Int(v) => f64::from(*v),
        other => panic!("{other:?}"),
    };
    let original = read(&input)?;
    for format in ["ascii", "", "binary_big_endian", "double,uint", "ascii,double"] {
        let output = folder.path().join(format!("out-{}.ply", format.replace(',', "-")));
        to(&input, &output, format)?;
        let ours = read(&output)?;
        let (first, second) = (&original.payload["vertex"], &ours.payload["vertex"]);
        // The first vertex of the input belongs to no face.
        assert_eq!(first.len(), second.len() + 1, "{format}");
        for (a, b) in first[1..].iter().zip(second) {
            assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{format}");
            for (name, value) in a {
                assert_eq!(wide(value), wide(&b[name]), "{format}: {name}");
            }
        }
        let corners = |face: &DefaultElement| face["vertex_indices"].to_u32_list().unwrap();
        let (first, second) = (&original.payload["face"], &ours.payload["face"]);
        assert_eq!(first.len(), second.len(), "{format}");
        for (a, b) in first.iter().zip(second) {
            let moved: Vec<u32> = corners(a).iter().map(|v| v - 1).collect();
            assert_eq!(moved, corners(b), "{format}");
        }
    }
    Ok(())
}

/// Our STL and OBJ files read by stl_io and tobj: the same triangles, bit for bit.
#[test]
fn stl_io_and_tobj_read_what_we_write() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let input = folder.path().join("in.ply");
    bumpy(&input, 30)?;
    let expected = soup(&open(&input)?)?;
    for format in ["", "ascii"] {
        let output = folder.path().join(format!("out{format}.stl"));
        to(&input, &output, format)?;
        let mesh = stl_io::read_stl(&mut std::io::BufReader::new(std::fs::File::open(&output)?))?;
        let corner = |v: usize| mesh.vertices[v].0;
        let mut found: Vec<_> = mesh.faces.iter().map(|f| turned(f.vertices.map(corner))).collect();
        found.sort_unstable();
        assert!(found == expected, "STL {format}");
        for face in &mesh.faces {
            let [a, b, c] = face.vertices.map(corner).map(|p| p.map(f64::from));
            let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
            let n =
                [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            for (found, n) in face.normal.0.iter().zip(n) {
                assert!((f64::from(*found) - n / length).abs() < 1e-4, "STL {format}");
            }
        }
    }
    let output = folder.path().join("out.obj");
    to(&input, &output, "")?;
    let mut reader = std::io::BufReader::new(std::fs::File::open(&output)?);
    let options = tobj::LoadOptions::default();
    let (models, _) =
        tobj::load_obj_buf(&mut reader, &options, |_| tobj::MTLLoadResult::Ok(Default::default()))?;
    assert_eq!(models.len(), 1);
    let mesh = &models[0].mesh;
    assert!(mesh.face_arities.is_empty(), "triangles only");
    let corner = |&v: &u32| [0, 1, 2].map(|k| mesh.positions[3 * v as usize + k]);
    let triangle = |t: &[u32]| turned([corner(&t[0]), corner(&t[1]), corner(&t[2])]);
    let mut found: Vec<_> = mesh.indices.chunks_exact(3).map(triangle).collect();
    found.sort_unstable();
    assert!(found == expected, "OBJ");
    // Red, from 0 to 1, follows from the place in the grid; tobj numbers vertices as faces use them.
    assert_eq!(mesh.vertex_color.len(), mesh.positions.len());
    for (p, colour) in mesh.positions.chunks_exact(3).zip(mesh.vertex_color.chunks_exact(3)) {
        let i = (7.0 * p[1]).round() * 30.0 + (7.0 * p[0]).round();
        assert!((colour[0] - i % 256.0 / 255.0).abs() < 1e-3, "vertex {i}: {colour:?}");
    }
    Ok(())
}

/// Our GLB files read by gltf: structure, counts, bounds, indices.
#[test]
fn gltf_reads_what_we_write() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let (input, output) = (folder.path().join("in.ply"), folder.path().join("out.glb"));
    bumpy(&input, 30)?;
    to(&input, &output, "")?;
    let bytes = std::fs::read(&output)?;
    // The crate knows no KHR_mesh_quantization, so it would refuse for that alone.
    let gltf = gltf::Gltf::from_slice_without_validation(&bytes)?;
    let blob = gltf.blob.as_deref().ok_or("a binary chunk")?;
    let mesh = gltf.document.meshes().next().ok_or("a mesh")?;
    let primitive = mesh.primitives().next().ok_or("a primitive")?;
    assert_eq!(primitive.mode(), gltf::mesh::Mode::Triangles);
    let positions = primitive.get(&gltf::Semantic::Positions).ok_or("positions")?;
    assert_eq!(
        (positions.count(), positions.dimensions()),
        (900, gltf::accessor::Dimensions::Vec3)
    );
    let indices = primitive.indices().ok_or("indices")?;
    assert_eq!(
        (indices.count(), indices.data_type()),
        (3 * 29 * 29 * 2, gltf::accessor::DataType::U32)
    );
    let view = indices.view().ok_or("a view")?;
    let at = view.offset() + indices.offset();
    let read = |i: usize| -> u32 {
        let place = at + 4 * i;
        u32::from_le_bytes([blob[place], blob[place + 1], blob[place + 2], blob[place + 3]])
    };
    let mut faces = FaceBlock::default();
    open(&input)?.read_faces(0, &mut faces)?;
    for (i, t) in faces.triangles.iter().enumerate() {
        // The first vertex of the input belongs to no face.
        assert_eq!([0, 1, 2].map(|k| u64::from(read(3 * i + k)) + 1), *t);
    }
    assert!(primitive.get(&gltf::Semantic::Colors(0)).is_some_and(|c| c.count() == 900));
    let node = gltf.document.nodes().find(|n| n.mesh().is_some()).ok_or("a node")?;
    let (translation, _, scale) = node.transform().decomposed();
    let view = positions.view().ok_or("a view")?;
    let stride = view.stride().ok_or("a stride")?;
    for i in 0..900usize {
        let (x, y) = ((i % 30) as f32 / 7.0, (i / 30) as f32 / 7.0);
        for (axis, wanted) in [x, y].into_iter().enumerate() {
            let place = view.offset() + positions.offset() + i * stride + 2 * axis;
            let steps = f32::from(u16::from_le_bytes([blob[place], blob[place + 1]]));
            let found = translation[axis] + steps * scale[axis];
            assert!((found - wanted).abs() <= 0.51 * scale[axis], "vertex {i}: {found} {wanted}");
        }
    }
    Ok(())
}

/// Programs that write while they scan leave 0 for the count of facets.
#[test]
fn binary_stl_without_a_count_has_the_facets_that_it_holds() -> AnyResult {
    let folder = tempfile::tempdir()?;
    bumpy(&folder.path().join("in.ply"), 8)?;
    let path = folder.path().join("a.stl");
    to(&folder.path().join("in.ply"), &path, "")?;
    let whole = soup(&open(&path)?)?;
    let mut bytes = std::fs::read(&path)?;
    bytes[80..84].fill(0);
    std::fs::write(&path, bytes)?;
    assert_eq!(soup(&open(&path)?)?, whole);
    Ok(())
}

#[test]
fn obj_may_have_comments_at_the_end_of_lines() -> AnyResult {
    let text = "v 0 0 0 # first\nv 1 0 0\nv 0 1 0 #third\nvt 0 0 # corner\nf 1 2 3 # face\n";
    let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    assert_eq!(soup(&staged("a.obj", text, false)?)?, soup(&staged("b.obj", plain, false)?)?);
    Ok(())
}

/// Missing data of terrains: -3.4e38.
#[test]
fn coordinates_beyond_all_places_are_named_or_left_out() -> AnyResult {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                element face 2\nproperty list uchar int vertex_indices\nend_header\n\
                0 0 0\n1 0 0\n0 1 0\n1 1 -3.4028235e38\n3 0 1 2\n3 1 3 2\n";
    let refused = staged("a.ply", text, false).and_then(|source| soup(&source));
    let said = refused.err().ok_or("taken")?.to_string();
    assert!(said.contains("row 3") && said.contains("beyond 1e30"), "{said}");
    assert_eq!(soup(&staged("a.ply", text, true)?)?.len(), 1);
    Ok(())
}

#[test]
fn properties_without_a_place_are_named() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("in.ply");
    std::fs::write(
        &path,
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty float confidence\nproperty int id\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n\
         0 0 0 0 0 1 0.5 7\n1 0 0 0 0 1 0.5 8\n0 1 0 0 0 1 0.5 9\n3 0 1 2\n",
    )?;
    for (name, lost) in [("a.glb", true), ("a.obj", true), ("a.stl", true), ("a.ply", false)] {
        let notes = to(&path, &folder.path().join(name), "")?.losses.lines().join("\n");
        assert_eq!(notes.contains("confidence, id"), lost, "{name}: {notes}");
    }
    Ok(())
}
