//! Bounds on what is parsed: windows of compressed streams, names, descriptions that are larger in memory than in their file.

use crate::common::{expect, run, scratch};
use std::path::Path;

const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

/// A zstd frame of one raw block (RFC 8878) whose header asks for a window of 2^`log` bytes.
fn write_frame(path: &Path, log: u8, content: &[u8]) {
    let mut bytes = vec![0x28, 0xb5, 0x2f, 0xfd, 0, (log - 10) << 3];
    let block = (content.len() as u32) << 3 | 1;
    bytes.extend_from_slice(&block.to_le_bytes()[..3]);
    bytes.extend_from_slice(content);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_window_beyond_the_memory_is_refused_with_the_size_that_does() {
    let at = &scratch();
    write_frame(&at.join("a.ply.zst"), 28, TRIANGLE.as_bytes());
    let said = expect(at, "simplify a.ply.zst o.ply --triangles 1 --memory 128MiB --dry-run", 6);
    assert!(said.contains("window of 256.0 MiB") && said.contains("--memory 512MiB"), "{said}");
    assert!(!said.contains("damaged"), "{said}");
    // The size that is named does, and so does every window below the memory.
    let said = run(at, "simplify a.ply.zst o.ply --triangles 1 --memory 512MiB --dry-run").stderr;
    let said = String::from_utf8_lossy(&said);
    assert!(!said.contains("window"), "{said}");
}

/// Every spelling of one library, and names that all materials have in common: each is looked at once.
#[test]
fn libraries_and_names_that_repeat_are_read_once() {
    let at = &scratch();
    let mut library = String::from("newmtl a\nKd 1 0 0\n");
    library.push_str(&"# a line of a comment\n".repeat(100_000));
    std::fs::write(at.join("m.mtl"), library).unwrap();
    let mut text = String::new();
    for n in 0..900 {
        text.push_str(&format!("mtllib {}m.mtl\n", "./".repeat(n)));
    }
    text.push_str("usemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    std::fs::write(at.join("a.obj"), text).unwrap();
    expect(at, "info a.obj", 0);
}

/// A GLB file of a description and a buffer.
fn write_glb(path: &Path, document: &str, binary: &[u8]) {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, binary) = (padded(document.as_bytes(), b' '), padded(binary, 0));
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend_from_slice(&((28 + json.len() + binary.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        out.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(chunk);
    }
    std::fs::write(path, out).unwrap();
}

/// A description with one scene of one node; the buffer has `n` bytes.
fn document(n: usize, views: &str, accessors: &str, primitives: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{n}}}],"bufferViews":[{views}],
        "accessors":[{accessors}],"meshes":[{{"primitives":[{primitives}]}}],"nodes":[{{"mesh":0}}],
        "scenes":[{{"nodes":[0]}}],"scene":0}}"#
    )
}

#[test]
fn lists_of_empty_things_are_refused_before_they_are_parsed() {
    let at = &scratch();
    for list in ["materials", "nodes", "meshes", "accessors", "images"] {
        let text =
            format!(r#"{{"asset":{{"version":"2.0"}},"{list}":[{}{{}}]}}"#, "{},".repeat(300_000));
        std::fs::write(at.join("a.gltf"), text).unwrap();
        let command = "simplify a.gltf o.ply --triangles 1 --dry-run --memory";
        let said = expect(at, &format!("{command} 64MiB"), 6);
        let named = said.split("give --memory ").nth(1).unwrap_or_else(|| panic!("{said}"));
        let memory = named.trim_end_matches(['\n', '.']);
        // The size that is named is enough: what is refused then is the mesh that is not there.
        let said = expect(at, &format!("{command} {memory}"), 4);
        assert!(said.contains("no triangles"), "{list}: {said}");
    }
}

/// A mesh that stands in the file once and in its scene twenty thousand times.
#[test]
fn a_small_file_of_a_huge_scene_is_not_unpacked_for_a_look() {
    let at = &scratch();
    let binary = vec![0; 12 * 30_000 + 2 * 60_000];
    let views =
        r#"{"buffer":0,"byteLength":360000},{"buffer":0,"byteOffset":360000,"byteLength":120000}"#;
    let accessors = r#"{"bufferView":0,"componentType":5126,"count":30000,"type":"VEC3"},
        {"bufferView":1,"componentType":5123,"count":60000,"type":"SCALAR"}"#;
    let primitive = r#"{"attributes":{"POSITION":0},"indices":1}"#;
    let primitives = vec![primitive; 20_000].join(",");
    let text = document(binary.len(), views, accessors, &primitives);
    write_glb(&at.join("a.glb"), &text, &binary);
    let said = expect(at, "info a.glb", 4);
    assert!(said.contains("400.00 M triangles") && said.contains("20.0 k primitives"), "{said}");
    // The same by nodes in place of primitives.
    let nodes = vec![r#"{"mesh":0}"#; 20_000].join(",");
    let all = (0..20_000).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
    let text = document(binary.len(), views, accessors, primitive)
        .replace(r#""nodes":[{"mesh":0}]"#, &format!(r#""nodes":[{nodes}]"#))
        .replace(r#"{"nodes":[0]}"#, &format!(r#"{{"nodes":[{all}]}}"#));
    write_glb(&at.join("b.glb"), &text, &binary);
    let said = expect(at, "info b.glb", 4);
    assert!(said.contains("400.00 M triangles"), "{said}");
}

/// Lines of an ASCII PLY behind its header.
fn rows(path: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().skip_while(|line| *line != "end_header").skip(1).map(str::to_owned).collect()
}

/// Positions by a sparse accessor over a view, over zeros, and by none at all; indices by one.
#[test]
fn sparse_accessors_and_those_without_a_view_are_read() {
    let at = &scratch();
    let floats = |list: &[f32]| list.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    // Four corners of a square at z = 5, which the sparse values bring to 0 but for the last.
    let mut binary = floats(&[0.0, 0.0, 5.0, 1.0, 0.0, 5.0, 1.0, 1.0, 5.0, 0.0, 1.0, 5.0]);
    binary.extend([0u8, 1, 2, 0]);
    binary.extend(floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]));
    binary.extend([0u16, 1, 2, 0, 2, 3].map(u16::to_le_bytes).as_flattened());
    let views = r#"{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":3},
        {"buffer":0,"byteOffset":52,"byteLength":36},{"buffer":0,"byteOffset":88,"byteLength":12}"#;
    let sparse = r#""sparse":{"count":3,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":2}}"#;
    let indices = r#"{"bufferView":3,"componentType":5123,"count":6,"type":"SCALAR"}"#;
    let primitive = r#"{"attributes":{"POSITION":0},"indices":1}"#;
    for (view, last) in [(r#""bufferView":0,"#, "0 1 5"), ("", "0 0 0")] {
        let accessors =
            format!(r#"{{{view}"componentType":5126,"count":4,"type":"VEC3",{sparse}}},{indices}"#);
        write_glb(
            &at.join("a.glb"),
            &document(binary.len(), views, &accessors, primitive),
            &binary,
        );
        expect(at, "convert a.glb a.ply --format ascii --force --keep-unreferenced", 0);
        let rows = rows(&at.join("a.ply"));
        assert_eq!(rows[..3], ["0 0 0", "1 0 0", "1 1 0"], "{rows:?}");
        // Without a view the last corner is at the first, and they become one.
        match view {
            "" => assert!(!rows.contains(&"0 1 5".to_owned()), "{rows:?}"),
            _ => assert_eq!(rows[3], last),
        }
    }
    // Indices that do not rise, or lie beyond, are named.
    for bad in [[0u8, 0, 1], [0, 1, 4]] {
        let mut binary = binary.clone();
        binary[48..51].copy_from_slice(&bad);
        let accessors = format!(
            r#"{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3",{sparse}}},{indices}"#
        );
        write_glb(
            &at.join("a.glb"),
            &document(binary.len(), views, &accessors, primitive),
            &binary,
        );
        let said = expect(at, "info a.glb", 4);
        assert!(said.contains("sparse index"), "{said}");
    }
    // Nothing but zeros: one point, no triangle, and no word of sparse accessors.
    let accessors = format!(r#"{{"componentType":5126,"count":4,"type":"VEC3"}},{indices}"#);
    write_glb(&at.join("a.glb"), &document(binary.len(), views, &accessors, primitive), &binary);
    let said = expect(at, "convert a.glb b.ply", 4);
    assert!(!said.contains("sparse"), "{said}");
}

#[test]
fn indices_that_make_no_triangle_are_named() {
    let at = &scratch();
    let mut binary: Vec<u8> = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    binary.extend([0u16, 1, 2, 0, 2, 3, 1, 2].map(u16::to_le_bytes).as_flattened());
    let views = r#"{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":16}"#;
    let accessors = |n: u32, m: u32| {
        let index = r#""bufferView":1,"componentType":5123,"type":"SCALAR""#;
        format!(
            r#"{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},{{{index},"count":{n}}},{{{index},"count":{m}}}"#
        )
    };
    let list = r#"{"attributes":{"POSITION":0},"indices":1}"#;
    let strip = r#"{"attributes":{"POSITION":0},"indices":2,"mode":5}"#;
    for (n, m, left) in [(6, 4, 0), (8, 4, 2), (7, 2, 3), (6, 1, 1)] {
        let text = document(binary.len(), views, &accessors(n, m), &format!("{list},{strip}"));
        write_glb(&at.join("a.glb"), &text, &binary);
        let said = expect(at, "convert a.glb a.ply --force", 0);
        let line = format!("{left} indices at the end of primitives make no triangle");
        assert_eq!(said.contains(&line), left > 0, "{n} {m}: {said}");
        assert_eq!(said.contains("make no triangle"), left > 0, "{n} {m}: {said}");
    }
}
