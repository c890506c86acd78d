//! Looks that change on the way from one format to another if their meaning there is ignored: colours under images, tiling,
//! zeros of material libraries, normals behind mirrors, numbers far from 0.

use crate::common::{expect, glb_json, scratch};
use std::path::Path;

/// Two triangles with an image and coordinates up to `most`; the first and last vertex have the colour `rgb`.
fn photographed(at: &Path, library: &str, most: &str, rgb: &str) {
    image::RgbImage::from_pixel(2, 2, image::Rgb([200, 100, 50])).save(at.join("t.png")).unwrap();
    std::fs::write(at.join("in.mtl"), library).unwrap();
    let text = format!(
        "mtllib in.mtl\nv 0 0 0 {rgb}\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nv 1 1 0 {rgb}\nvt 0 0\nvt {most} 0\nvt 0 1\n\
         vt {most} 1\nusemtl a\nf 1/1 2/2 3/3\nf 2/2 4/4 3/3\n"
    );
    std::fs::write(at.join("in.obj"), text).unwrap();
}

/// All words of 16 bits of COLOR_0, which is written between positions and coordinates.
fn colours(at: &Path, file: &str) -> Vec<u16> {
    let (bytes, document) = (std::fs::read(at.join(file)).unwrap(), glb_json(&at.join(file)));
    let json_bytes = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let binary = &bytes[28 + json_bytes..];
    let accessor = &document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"];
    let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let number = |of: &serde_json::Value, name: &str| of[name].as_u64().unwrap_or(0) as usize;
    let first = number(view, "byteOffset") + number(accessor, "byteOffset");
    let rows = (0..number(accessor, "count")).map(|i| first + i * number(view, "byteStride"));
    let word = |at: usize| u16::from_le_bytes([binary[at], binary[at + 1]]);
    rows.flat_map(|row| (0..4).map(move |k| word(row + 2 * k))).collect()
}

#[test]
fn images_of_obj_do_not_become_darker_by_colours_under_them() {
    let at = &scratch();
    photographed(at, "newmtl a\nmap_Kd t.png\n", "1", "0.2 0.2 0.2");
    let said = expect(at, "convert in.obj out.glb", 0);
    assert!(said.contains("note: colours of vertices under images"), "{said}");
    assert!(colours(at, "out.glb").iter().all(|&x| x == u16::MAX));
    expect(at, "convert out.glb again.glb", 0);
    // In glTF they shine through and are kept.
    let text = std::fs::read_to_string(at.join("in.obj")).unwrap();
    let text = text.replace("usemtl a\n", "").replace("mtllib", "#");
    std::fs::write(at.join("bare.obj"), text).unwrap();
    expect(at, "convert bare.obj bare.glb", 0);
    assert!(colours(at, "bare.glb").iter().any(|&x| x < u16::MAX));
}

#[test]
fn clamped_images_stay_clamped_and_mirrored_ones_are_named() {
    let at = &scratch();
    photographed(at, "newmtl a\nmap_Kd -clamp on t.png\n", "3", "1 1 1");
    expect(at, "convert in.obj out.glb", 0);
    let said = expect(at, "convert out.glb back.obj", 0);
    assert!(!said.contains("tiling"), "{said}");
    let library = std::fs::read_to_string(at.join("back.mtl")).unwrap();
    assert!(library.contains("map_Kd -clamp on "), "{library}");
    assert!(expect(at, "convert out.glb back.ply", 0).contains("tiling of the colour image"));
    let mut bytes = std::fs::read(at.join("out.glb")).unwrap();
    let mut n_words = 0;
    while let Some(place) = bytes.windows(5).position(|word| word == b"33071") {
        bytes[place..place + 5].copy_from_slice(b"33648");
        n_words += 1;
    }
    assert_eq!(n_words, 2);
    std::fs::write(at.join("mirrored.glb"), bytes).unwrap();
    let said = expect(at, "convert mirrored.glb mirrored.obj", 0);
    assert!(said.contains("tiling of the colour image"), "{said}");
    // Nothing is seen of it where coordinates stay within the image.
    photographed(at, "newmtl a\nmap_Kd -clamp on t.png\n", "1", "1 1 1");
    expect(at, "convert in.obj inside.glb", 0);
    assert!(!expect(at, "convert inside.glb inside.ply", 0).contains("tiling"));
}

#[test]
fn zeros_of_a_library_leave_no_surface_black_or_invisible() {
    let at = &scratch();
    photographed(at, "newmtl a\nKd 0 0 0\nd 0\nmap_Kd t.png\n", "1", "1 1 1");
    let said = expect(at, "convert in.obj out.glb", 0);
    assert!(said.contains("Kd 0 0 0 of material 'a'") && said.contains("d 0 (Tr 1)"), "{said}");
    let material = &glb_json(&at.join("out.glb"))["materials"][0];
    let factor = &material["pbrMetallicRoughness"]["baseColorFactor"];
    assert!(factor.is_null() || *factor == serde_json::json!([1.0, 1.0, 1.0, 1.0]), "{material}");
    assert!(material["alphaMode"].is_null(), "{material}");
    // Black without an image is a colour.
    photographed(at, "newmtl a\nKd 0 0 0\n", "1", "1 1 1");
    assert!(!expect(at, "convert in.obj black.glb", 0).contains("Kd 0 0 0"));
}

#[test]
fn doubles_far_from_zero_are_averaged_about_their_middle() {
    let at = &scratch();
    let n = 40;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property double gps_time\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        n * n,
        2 * (n - 1) * (n - 1)
    );
    let height = |x: usize, y: usize| (x as f64 * 0.4).sin() + (y as f64 * 0.3).cos();
    for (x, y) in (0..n * n).map(|i| (i % n, i / n)) {
        text += &format!("{x} {y} {} {}\n", height(x, y), 1.7e9 + x as f64 * 0.5);
    }
    for v in (0..n * n).filter(|v| v % n < n - 1 && v / n < n - 1) {
        text += &format!("3 {v} {} {}\n3 {} {} {}\n", v + 1, v + n, v + 1, v + n + 1, v + n);
    }
    std::fs::write(at.join("in.ply"), text).unwrap();
    for method in ["", " --method cluster", " --method decimate", " --method retile"] {
        expect(
            at,
            &format!("simplify in.ply out.ply --ratio 20% --format ascii --force{method}"),
            0,
        );
        let out = std::fs::read_to_string(at.join("out.ply")).unwrap();
        let (head, body) = out.split_once("end_header\n").unwrap();
        let n = head.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
        for line in body.lines().take(n.parse().unwrap()) {
            let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
            // Half a second along x; a float there has steps of 128.
            let off = numbers[3] - (1.7e9 + 0.5 * numbers[0]);
            assert!(off.abs() < 2.0, "{method}: {line}");
        }
    }
}

#[test]
fn methods_without_coordinates_refuse_images_of_vertices() {
    let at = &scratch();
    image::RgbImage::new(2, 2).save(at.join("t.png")).unwrap();
    let head = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n\
                end_header\n";
    std::fs::write(at.join("in.ply"), format!("{head}0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"))
        .unwrap();
    for method in ["cluster", "decimate", "retile"] {
        let said =
            expect(at, &format!("simplify in.ply out.ply --triangles 1 --method {method}"), 4);
        assert!(said.contains("--drop-texture"), "{said}");
    }
}
