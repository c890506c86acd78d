//! Texts as programs write them: byte order marks, UTF-16, names of no-numbers, joined files, and what is not a mesh.

use std::io::Write;
use stonecut::io::StageOptions;
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\nf 1 2 4\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
    endfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 5 5 5\nendloop\nendfacet\nendsolid a\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n5 5 5\n3 0 1 2\n3 0 1 3\n";

fn open(name: &str, bytes: &[u8], skip_bad: bool) -> stonecut::Result<MeshSource> {
    let mut options = StageOptions::new(std::env::temp_dir());
    options.read.skip_bad = skip_bad;
    MeshSource::staged_from_bytes(name, bytes.to_vec(), &options)
}

/// Vertices, and triangles that are good.
fn counts(source: &MeshSource) -> (u64, usize) {
    let mut block = FaceBlock::default();
    let n = (0..source.n_face_blocks()).map(|i| {
        source.read_faces(i, &mut block).unwrap();
        block.triangles.len()
    });
    (source.n_vertices(), n.sum())
}

fn positions(source: &MeshSource) -> Vec<[f64; 3]> {
    let mut block = VertexBlock::default();
    source.read_vertices(0, &mut block).unwrap();
    let schema = source.schema();
    block.records.chunks_exact(schema.record_bytes()).map(|r| schema.position(r)).collect()
}

fn refusal(name: &str, bytes: &[u8]) -> String {
    // What stands in the rows of a PLY shows when they are read.
    let mut block = VertexBlock::default();
    let read = |source: MeshSource| source.read_vertices(0, &mut block);
    let error = open(name, bytes, false).and_then(read).unwrap_err();
    assert_eq!(error.exit_code(), 4, "{error}");
    error.to_string()
}

#[test]
fn byte_order_marks_and_utf16_change_nothing() {
    let mut wide = b"\xff\xfe".to_vec();
    for (name, text) in [("a.obj", OBJ), ("a.stl", STL), ("a.ply", PLY), ("a", OBJ), ("a", STL)] {
        let marked = [b"\xef\xbb\xbf", text.as_bytes()].concat();
        assert_eq!(counts(&open(name, &marked, false).unwrap()), (4, 2), "{name}");
        wide.truncate(2);
        wide.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
        assert_eq!(counts(&open(name, &wide, false).unwrap()), (4, 2), "{name}");
        let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        assert_eq!(counts(&open(name, &big, false).unwrap()), (4, 2), "{name}");
    }
    // The mark moves nothing in a binary body.
    let mut binary = b"\xef\xbb\xbfply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n\
        property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        .to_vec();
    binary.extend(
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0f32].iter().flat_map(|x| x.to_le_bytes()),
    );
    binary.push(3);
    binary.extend([0, 1, 2i32].iter().flat_map(|i| i.to_le_bytes()));
    assert_eq!(counts(&open("b.ply", &binary, false).unwrap()), (3, 1));
}

#[test]
fn names_of_no_numbers_are_missing_values() {
    for name in ["-nan(ind)", "1.#QNAN", "-1.#IND00", "nan", "1.#SNAN0", "-NaN", "1.#INF"] {
        for (file, text) in [("a.obj", OBJ), ("a.ply", PLY), ("a.stl", STL)] {
            let text = text.replace("5 5 5", &format!("5 {name} 5"));
            let message = refusal(file, text.as_bytes());
            assert!(message.contains("not finite") && message.contains("--skip-bad"), "{message}");
            let source = open(file, text.as_bytes(), true).unwrap();
            assert_eq!(counts(&source).1, 1, "{file} {name}");
        }
    }
    // What is not a number at all is refused, and with --skip-bad missing too.
    for (file, text) in [("a.obj", OBJ), ("a.ply", PLY), ("a.stl", STL)] {
        let text = text.replace("5 5 5", "5 1,5 5");
        let message = refusal(file, text.as_bytes());
        assert!(message.contains("--skip-bad"), "{message}");
        assert_eq!(counts(&open(file, text.as_bytes(), true).unwrap()).1, 1, "{file}");
    }
}

#[test]
fn comments_of_obj_end_where_they_end() {
    for text in [
        OBJ.replace("f 1 2 3", "# a folder: C:\\scan\\\nf 1 2 3"),
        OBJ.replace("f 1 2 3", "f 1 2 3 # the first \\"),
        OBJ.replace("v 0 0 0", "v 0 0 0#x"),
        OBJ.replace("f 1 2 3", "f 1 2 \\\n 3"),
        OBJ.replace("f 1 2 3", "F 1 2 3").replace("v 1", "V 1"),
    ] {
        assert_eq!(counts(&open("a.obj", text.as_bytes(), false).unwrap()), (4, 2), "{text}");
    }
    // A backslash in a name of a solid goes nowhere.
    let text = STL.replace("solid a\n", "solid C:\\scan\\\n");
    assert_eq!(counts(&open("a.stl", text.as_bytes(), false).unwrap()), (4, 2));
    let text = STL.replace("endsolid", "end solid").replace("endloop", "end loop");
    assert_eq!(counts(&open("a.stl", text.as_bytes(), false).unwrap()), (4, 2));
}

/// The losses and remarks of a file that is read.
fn said_of(name: &str, bytes: &[u8]) -> String {
    let source = open(name, bytes, false).unwrap();
    format!("{:?} {:?}", source.losses().entries(), source.notes())
}

#[test]
fn numbers_and_rows_that_are_not_expected_are_named() {
    let weights = "numbers behind the coordinates";
    for (row, is_named) in [
        ("v 5 5 5 1", false),
        ("v 5 5 5 2", true),
        ("v 5 5 5 1 0", true),
        ("v 5 5 5 1 0 0 1", false),
        ("v 5 5 5 1 0 0 1 3", true),
    ] {
        let said = said_of("a.obj", OBJ.replace("v 5 5 5", row).as_bytes());
        assert_eq!(said.contains(weights), is_named, "{row}: {said}");
    }
    // A file that was cut off among its faces, and one whose last line has no end.
    for (last, is_cut) in
        [("f 1 2 4", false), ("f 1 2", true), ("f 1/ 2/ 4", true), ("f 1 2 4\nf", true)]
    {
        let said = said_of("a.obj", OBJ.replace("f 1 2 4\n", last).as_bytes());
        assert_eq!(said.contains("may be cut off"), is_cut, "{last}: {said}");
    }
    // More rows than the header promises, and a second file.
    let joined = format!("{PLY}{PLY}");
    for (text, wanted) in [
        (PLY.replace("face 2", "face 1"), "fewer rows than there are"),
        (joined, "another PLY file"),
        (format!("{PLY}\n \0\0"), ""),
        (PLY.replace("ascii", "ASCII"), ""),
    ] {
        let said = said_of("a.ply", text.as_bytes());
        assert_eq!(said.contains("left out"), !wanted.is_empty(), "{said}");
        assert!(said.contains(wanted), "{said}");
    }
}

#[test]
fn what_is_not_obj_is_refused_whatever_its_name() {
    let noise: Vec<u8> =
        (1..3000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    for bytes in [&noise[..], b"", b"# nothing\n", b"hello world\n"] {
        refusal("a.obj", bytes);
    }
    assert!(refusal("a.obj", b"").contains("empty"));
}

/// A binary STL of loose triangles at heights, each with the bytes behind it.
fn binary(header: &[u8], facets: &[(f32, u16)]) -> Vec<u8> {
    let mut out = header.to_vec();
    out.resize(80, b' ');
    out.extend((facets.len() as u32).to_le_bytes());
    for &(z, word) in facets {
        let corners = [[0.0, 0.0, 1.0], [0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        out.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        out.extend(word.to_le_bytes());
    }
    out
}

#[test]
fn joined_stl_files_are_read_whole() {
    let two = [binary(b"one", &[(0.0, 0), (1.0, 0)]), binary(b"two", &[(2.0, 0)])].concat();
    for name in ["a.stl", "standard input"] {
        let source = open(name, &two, false).unwrap();
        assert_eq!(counts(&source), (9, 3), "{name}");
        assert!(source.notes()[0].what.contains("2 STL files"), "{:?}", source.notes());
    }
    let rest = [&two[..], b"not a facet"].concat();
    let source = open("a.stl", &rest, false).unwrap();
    assert_eq!(counts(&source), (9, 3));
    assert!(source.notes()[1].what.contains("11 bytes behind"), "{:?}", source.notes());
    let text = [STL, &STL.replace("5 5 5", "7 7 7")].concat();
    assert_eq!(counts(&open("a.stl", text.as_bytes(), false).unwrap()), (5, 4));
}

/// Colours of the faces of a mesh.
fn colours(source: &MeshSource) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("in.stl"), std::fs::read(source.path()).unwrap()).unwrap();
    crate::common::expect(folder.path(), "convert in.stl out.ply --format ascii", 0);
    let text = std::fs::read_to_string(folder.path().join("out.ply")).unwrap();
    let faces = text.lines().filter(|line| line.starts_with("3 "));
    faces.map(|line| line.split(' ').skip(4).collect::<Vec<_>>().join(" ")).collect()
}

#[test]
fn colours_of_facets_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.stl");
    let read = |bytes: Vec<u8>| {
        std::fs::write(&path, bytes).unwrap();
        let source = MeshSource::open_staged(&path, &StageOptions::new(folder.path())).unwrap();
        (colours(&source), source.notes().to_vec())
    };
    // VisCAM: flag, red, green, blue.
    let viscam = [(0.0, 0x8000 | 31 << 10), (1.0, 0x8000 | 31), (2.0, 0)];
    let (found, notes) = read(binary(b"", &viscam));
    assert_eq!(found, ["255 0 0", "0 0 255", "255 255 255"]);
    assert_eq!((notes[0].what.as_str(), notes[0].count), ("facets without colour", 1));
    // A facet whose bytes lack the flag has no colour; the others keep theirs.
    let (found, notes) = read(binary(b"", &[viscam[0], (1.0, 31), (2.0, 0)]));
    assert_eq!(found, ["255 0 0", "255 255 255", "255 255 255"]);
    assert_eq!((notes[0].what.as_str(), notes[0].count), ("facets without colour", 2));
    // Magics: no flag, blue, green, red; the flag stands for the colour of all.
    let header = b"COLOR=\x0a\x14\x1e\xff,MATERIAL=";
    let (found, _) = read(binary(header, &[(0.0, 31), (1.0, 31 << 10), (2.0, 0x8000)]));
    assert_eq!(found, ["255 0 0", "0 0 255", "10 20 30"]);
    let (found, notes) = read(binary(b"", &[(0.0, 7), (1.0, 0)]));
    assert_eq!(found, ["", ""]);
    assert!(notes[0].what.contains("1 facets have attribute bytes"), "{notes:?}");
}

#[test]
fn colours_of_facets_are_written() {
    let at = &crate::common::scratch();
    let viscam = [(0.0, 0x8000 | 31 << 10), (1.0, 0x8000 | 31), (2.0, 0x8000 | 5)];
    std::fs::write(at.join("in.stl"), binary(b"", &viscam)).unwrap();
    for command in ["convert in.stl", "simplify in.stl --ratio 100%"] {
        let said = crate::common::expect(at, &format!("{command} out.stl --force"), 0);
        assert!(!said.contains("lost"), "{said}");
        let bytes = std::fs::read(at.join("out.stl")).unwrap();
        let words = bytes[84..].chunks_exact(50).map(|facet| [facet[48], facet[49]]);
        let mut words: Vec<u16> = words.map(u16::from_le_bytes).collect();
        words.sort_unstable();
        assert_eq!(words, [0x8005, 0x801f, 0xfc00], "{command}");
    }
    let said = crate::common::expect(at, "convert in.stl text.stl --format ascii", 3);
    assert!(said.contains("colours of faces"), "{said}");
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 100 0\n";
    std::fs::write(at.join("in.ply"), ply).unwrap();
    let said = crate::common::expect(at, "convert in.ply rounded.stl", 0);
    assert!(said.contains("STL has 5 bits a channel"), "{said}");
}

#[test]
fn an_stl_of_the_other_kind_behind_one_is_refused() {
    let at = &crate::common::scratch();
    let binary = binary(b"one", &[(0.0, 0), (1.0, 0)]);
    let long = STL.replace("solid a", &format!("solid {}", "a".repeat(5000)));
    for parts in [[&binary, STL.as_bytes()], [long.as_bytes(), &binary]] {
        std::fs::write(at.join("in.stl"), parts.concat()).unwrap();
        let said = crate::common::expect(at, "convert in.stl out.ply --force", 4);
        assert!(said.contains("lies behind"), "{said}");
        crate::common::expect(at, "convert in.stl out.ply --force --skip-bad", 3);
    }
    std::fs::write(at.join("empty.stl"), "solid x\nendsolid x\n").unwrap();
    crate::common::expect(at, "convert empty.stl none.ply", 4);
    assert!(!at.join("none.ply").exists());
}

#[test]
fn a_weight_before_the_colour_of_a_vertex_is_not_its_red() {
    let rows = |last: &str| {
        let text = format!("v 0 0 0 1 0 1 0\nv 1 0 0 1 0 1 {last}\nv 0 1 0 1 0 1 0\nf 1 2 3\n");
        let at = &crate::common::scratch();
        std::fs::write(at.join("in.obj"), text).unwrap();
        let said = crate::common::expect(at, "convert in.obj out.ply --format ascii", 0);
        assert!(!said.contains("lost"), "{said}");
        std::fs::read_to_string(at.join("out.ply")).unwrap()
    };
    assert!(rows("1").contains("1 0 0 0 255 255\n"), "{}", rows("1"));
}

/// A ball of two metres at coordinates of a map keeps its shape.
#[test]
fn ascii_stl_keeps_what_it_says() {
    let shift = |text: &str| {
        text.replace("vertex 0 0 0", "vertex 412345.678 5712345.678 101.25")
            .replace("vertex 1 0 0", "vertex 412345.778 5712345.678 101.25")
            .replace("vertex 0 1 0", "vertex 412345.678 5712345.778 101.25")
            .replace("vertex 5 5 5", "vertex 412345.678 5712345.678 101.35")
    };
    let source = open("a.stl", shift(STL).as_bytes(), false).unwrap();
    assert_eq!(counts(&source), (4, 2));
    assert_eq!(positions(&source)[1], [412345.778, 5712345.678, 101.25]);
    // Near the origin it is floats, as ever.
    assert_eq!(open("a.stl", STL.as_bytes(), false).unwrap().schema().position_bytes(), 12);
}

#[test]
fn ascii_stl_may_be_one_line_and_begin_with_another() {
    let oneline = STL.replace('\n', " ");
    let commented = format!("; made by hand\n{STL}");
    for text in [oneline, commented] {
        assert_eq!(counts(&open("a.stl", text.as_bytes(), false).unwrap()), (4, 2), "{text}");
    }
    let long = STL.replace("solid a", &format!("solid {}", "a".repeat(5000)));
    let joined = [long.as_bytes(), &[0; 84]].concat();
    let source = open("a.stl", &joined, false).unwrap();
    assert_eq!(counts(&source), (4, 2));
    assert!(
        source.notes().iter().any(|note| note.what.contains("not text")),
        "{:?}",
        source.notes()
    );
}

#[test]
fn other_formats_are_named() {
    for (name, bytes, word) in [
        ("a.fbx", &b"Kaydara FBX Binary  \x00\x1a\x00rest"[..], "FBX"),
        ("a.usdc", b"PXR-USDC\0\0", "USD"),
        ("a.b3dm", b"b3dm\x01\0\0\0\x40\0\0\0", "b3dmToGlb"),
        ("a.pnts", b"pnts\x01\0\0\0\x40\0\0\0", "points"),
        ("a.las", b"LASF\0\0\0\0", "point cloud"),
        ("a.e57", b"ASTM-E57\0", "E57"),
        ("a.dae", b"<?xml version=\"1.0\"?>\n<COLLADA xmlns=\"x\">", "COLLADA"),
        ("a.obj", b"<!DOCTYPE html><html>", "web page"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n", "OFF"),
        ("b.off", b"NCOFF\n3 1 0\n0 0 0 1 1 1 255\n0 1 0 1 1 1 255\n1 0 0 1 1 1 255\n", "OFF"),
        ("a.xyz", b"0 0 0\n1 0 0\n1 1 0\n2 2 2\n", "list of points"),
        ("a.ply", b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
        ("a.step", b"ISO-10303-21;\n", "STEP"),
    ] {
        let message = refusal(name, bytes);
        assert!(message.contains(word) && message.contains("does not read"), "{message}");
    }
    let old = br#"{"asset":{"version":"1.0"},"meshes":{"a":{}},"nodes":{}}"#;
    assert!(refusal("a.gltf", old).contains("glTF version '1.0' is not read"));
    let other = b"\xef\xbb\xbf{\"type\":\"FeatureCollection\"}";
    assert!(refusal("a.json", other).contains("names no version"));
}

fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in files {
        writer.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

#[test]
fn an_archive_with_one_mesh_is_read() {
    let obj = OBJ.as_bytes();
    let one = zip(&[("scan/a.obj", obj), ("__MACOSX/._a.obj", b"x"), ("read me.txt", b"x")]);
    assert_eq!(counts(&open("a.zip", &one, false).unwrap()), (4, 2));
    let two = zip(&[("a.obj", obj), ("b.obj", obj)]);
    assert!(refusal("a.zip", &two).contains("2 of them meshes"));
    assert!(refusal("a.zip", &zip(&[("a.txt", b"x")])).contains("without a mesh"));
    // LZMA, which no reader of ours unpacks.
    let mut lzma = zip(&[("a.obj", obj)]);
    for (mark, at) in [(b"PK\x03\x04", 8), (b"PK\x01\x02", 10)] {
        let start = lzma.windows(4).position(|bytes| bytes == mark).unwrap();
        lzma[start + at] = 14;
    }
    assert!(refusal("a.zip", &lzma).contains("does not read (Lzma)"));
    assert!(refusal("a.3mf", &zip(&[("3D/3dmodel.model", b"<model/>")])).contains("3MF"));
    assert!(refusal("a.usdz", &zip(&[("a.usdc", b"PXR-USDC")])).contains("USDZ"));
    refusal("a.zip", &one[..one.len() / 2]);
}

/// A BMP of one red pixel.
const RED: &[u8] =
    b"BM\x3a\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\x01\0\0\0\x01\0\0\0\x01\0\x18\0\0\0\0\0\x04\0\0\0\
    \0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\xff\0";

#[test]
fn an_archive_is_read_with_all_that_its_mesh_names() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n";
    let mtl = b"newmtl a\nmap_Kd C:\\scans\\red.bmp\n";
    let ply = b"ply\nformat ascii 1.0\ncomment TextureFile tex/red.bmp\nelement vertex 3\nproperty float x\n\
        property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\n\
        property list uchar float texcoord\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 0 0 0 0\n";
    let gltf = br#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{
        "primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}]}],"buffers":[{"uri":"a.bin","byteLength":60}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}],"accessors":[{"bufferView":0,
        "componentType":5126,"count":3,"type":"VEC3"},{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}],
        "images":[{"uri":"textures/red.bmp"}],"textures":[{"source":0}],
        "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}]}"#;
    let points: [f32; 15] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 0., 0., 0., 0.];
    let buffer: Vec<u8> = points.iter().flat_map(|x| x.to_le_bytes()).collect();
    for (name, files) in [
        ("obj", &[("s/a.obj", &obj[..]), ("s/a.mtl", mtl), ("textures/red.bmp", RED)][..]),
        ("windows", &[("s\\a.obj", obj), ("s\\a.mtl", mtl), ("s\\t\\red.bmp", RED)]),
        ("outside", &[("a.obj", obj), ("../a.mtl", mtl), ("../../red.bmp", RED)]),
        ("ply", &[("a/a.ply", ply), ("a/tex/red.bmp", RED)]),
        ("gltf", &[("scene.gltf", gltf), ("a.bin", &buffer), ("textures/red.bmp", RED)]),
    ] {
        std::fs::write(at.join(format!("{name}.zip")), zip(files)).unwrap();
        let said = crate::common::expect(at, &format!("convert {name}.zip {name}.obj"), 0);
        assert!(!said.contains("/.stonecut"), "{name}: {said}");
        let found = std::fs::read_dir(at).unwrap().flatten().map(|entry| entry.file_name());
        let names: Vec<String> = found.map(|name| name.to_string_lossy().into_owned()).collect();
        let folders = names.iter().filter(|folder| folder.starts_with(name));
        let images: Vec<Vec<u8>> =
            folders.filter_map(|f| std::fs::read(at.join(f).join("red.bmp")).ok()).collect();
        assert!(images == [RED], "{name}: {names:?}");
        assert!(!names.iter().any(|name| name.starts_with('.')), "{names:?}");
    }
    // An image that is not there, and a mesh that is damaged, are named as the archive has them.
    let files = [("s/a.obj", &obj[..]), ("s/a.mtl", mtl)];
    std::fs::write(at.join("none.zip"), zip(&files)).unwrap();
    let said = crate::common::expect(at, "convert none.zip none.glb", 3);
    assert!(said.contains("none.zip/s/red.bmp") && !said.contains("/.stonecut"), "{said}");
    // What lies outside of an archive is not taken into the output.
    std::fs::write(at.join("secret.bmp"), RED).unwrap();
    let up = "../".repeat(20) + at.to_str().unwrap() + "/secret.bmp";
    for name in [at.join("secret.bmp").to_str().unwrap(), &up] {
        let mtl = format!("newmtl a\nmap_Kd {name}\n");
        let files = [files[0], ("s/a.mtl", mtl.as_bytes())];
        std::fs::write(at.join("out.zip"), zip(&files)).unwrap();
        crate::common::expect(at, "convert out.zip out.glb --force", 3);
    }
    // Names that no file can have belong to files that are missing.
    let long = format!("s/{}.bmp", "x".repeat(300));
    let files = [files[0], files[1], (&*long, RED), ("s/a\0.bmp", RED), ("s/a.mtl/red.bmp", RED)];
    std::fs::write(at.join("names.zip"), zip(&files)).unwrap();
    crate::common::expect(at, "convert names.zip names.glb", 3);
    std::fs::write(at.join("bad.zip"), zip(&[("a.obj", b"v 0 0 0\nf 1 2 3\n"), files[1]])).unwrap();
    let said = crate::common::expect(at, "info bad.zip", 4);
    assert!(said.contains("bad.zip/a.obj") && !said.contains("/.stonecut"), "{said}");
}
