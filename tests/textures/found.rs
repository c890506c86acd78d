//! Images of meshes that come from other machines: found all the same, with a line, or missed with exit 3.

use crate::common::{expect, scratch};
use image::{Rgb, RgbImage};
use std::path::Path;

const OBJ: &str = "mtllib in.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3\n";
const MTL: &str = "newmtl wood\nmap_Kd tex.png\n";

fn picture(path: &Path) {
    RgbImage::from_pixel(4, 4, Rgb([200, 100, 50])).save(path).unwrap();
}

/// A folder with an image of this name.
fn folder(image: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(image);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    picture(&path);
    folder
}

/// Writes mesh and library, converts to GLB, and returns what was said.
fn convert(folder: &Path, obj: &[u8], mtl: &[u8], code: i32) -> String {
    std::fs::write(folder.join("in.obj"), obj).unwrap();
    std::fs::write(folder.join("in.mtl"), mtl).unwrap();
    let said = expect(folder, "convert in.obj out.glb --force", code);
    let glb = std::fs::read(folder.join("out.glb")).unwrap();
    let has_image = glb.windows(4).any(|bytes| bytes == b"\x89PNG");
    assert_eq!(has_image, code == 0, "{said}");
    said
}

#[test]
fn images_of_other_machines_are_found() {
    for (image, line) in [
        ("tex.png", "map_Kd C:\\Users\\me\\scan\\tex.png"),
        ("tex.png", "map_Kd /home/me/tex.png"),
        ("Tex.PNG", "map_Kd tex.png"),
        ("tex.png", "MAP_KD tex.png"),
        ("tex.png", "map_kd tex.png"),
        ("a b.png", "map_Kd \"a b.png\""),
        ("tex.png", "map_Kd tex.png # the wall"),
        ("tex.png", "map_Kd -o 0 0 0 -s 1 1 1 tex.png"),
        ("maps/tex.png", "map_Kd D:\\scan\\maps\\tex.png"),
        ("tex.png", "map_Ka tex.png"),
        ("u.1001.png", "map_Kd u.<UDIM>.png"),
    ] {
        let dir = folder(image);
        let said =
            convert(dir.path(), OBJ.as_bytes(), format!("newmtl wood\n{line}\n").as_bytes(), 0);
        let is_plain = line.contains("_KD")
            || line.contains("_kd")
            || line.contains("-o")
            || line.contains('"')
            || line.contains('#');
        assert_eq!(said.contains("taken"), !is_plain, "{line}\n{said}");
        let is_mapped = line.to_lowercase().starts_with("map_kd ") && !line.contains("-o");
        assert!(!is_mapped || !said.contains("no place"), "{line}\n{said}");
    }
}

#[test]
fn names_in_other_encodings_are_found() {
    for (image, bytes) in [
        ("stra\u{df}e.png", &b"stra\xdfe.png"[..]),
        ("\u{7eb9}\u{7406}.png", b"\xce\xc6\xc0\xed.png"),
    ] {
        let dir = folder(image);
        let mtl = [b"newmtl wood\nmap_Kd ", bytes, b"\n"].concat();
        convert(dir.path(), OBJ.as_bytes(), &mtl, 0);
    }
    // The library has the name of its material in another encoding than the mesh.
    let dir = folder("tex.png");
    let obj = OBJ.replace("wood", "gr\u{fc}n");
    let said = convert(dir.path(), obj.as_bytes(), b"newmtl gr\xfcn\nmap_Kd tex.png\n", 0);
    assert!(said.contains("names that differ"), "{said}");
}

#[test]
fn libraries_and_materials_are_found() {
    for (obj, mtl) in [
        (OBJ.replace("usemtl wood", "USEMTL Wood"), MTL.to_owned()),
        (OBJ.replace("usemtl wood", "usemtl wood # oak"), MTL.to_owned()),
        (OBJ.replace("mtllib in.mtl", "mtllib C:\\scan\\in.mtl"), MTL.to_owned()),
        (OBJ.replace("mtllib in.mtl", "mtllib \"in.mtl\""), MTL.to_owned()),
        (OBJ.replace("mtllib in.mtl", "mtllib renamed.mtl"), MTL.to_owned()),
        (OBJ.replace("mtllib in.mtl\n", ""), MTL.to_owned()),
        (OBJ.replace("mtllib", "MtlLib"), MTL.to_owned()),
        (format!("\u{feff}{OBJ}"), MTL.to_owned()),
        (OBJ.to_owned(), format!("\u{feff}{MTL}")),
        (OBJ.to_owned(), MTL.replace("newmtl", "NEWMTL")),
        // An accent as one letter, and as macOS parts it.
        (OBJ.replace("wood", "b\u{f6}den"), MTL.replace("wood", "bo\u{308}den")),
    ] {
        let dir = folder("tex.png");
        let said = convert(dir.path(), obj.as_bytes(), mtl.as_bytes(), 0);
        assert!(!said.contains("white"), "{obj}\n{said}");
    }
    let dir = folder("tex.png");
    let mtl: Vec<u8> = format!("\u{feff}{MTL}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    convert(dir.path(), OBJ.as_bytes(), &mtl, 0);
}

#[test]
fn a_mesh_without_any_of_its_images_is_short() {
    let dir = folder("other.png");
    let folder = dir.path();
    let said = convert(folder, OBJ.as_bytes(), MTL.as_bytes(), 3);
    assert!(said.contains("tex.png") && said.contains("none of the images"), "{said}");
    // As asked.
    expect(folder, "convert in.obj out.obj --textures none", 0);
    expect(folder, "convert in.obj out.ply --drop-texture", 0);
    // A set of tiles is named.
    for n in [1001, 1002] {
        picture(&folder.join(format!("u.{n}.png")));
    }
    let said = convert(folder, OBJ.as_bytes(), b"newmtl wood\nmap_Kd u.<UDIM>.png\n", 3);
    assert!(said.contains("set of tiles (UDIM)"), "{said}");
    let mtl = b"newmtl wood\nmap_Kd -o 0 0 1\nKe 0 0 0\nmap_Ke other.png\n";
    let said = convert(folder, OBJ.as_bytes(), mtl, 0);
    for word in ["'map_Kd -o 0 0 1': their lines name no file", "Ke 0 0 0 leaves it dark"] {
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn names_of_images_in_ply_are_read_in_every_form() {
    for line in [
        "comment TextureFile tex.png",
        "comment TextureFile: tex.png",
        "comment texturefile C:\\scan\\tex.png",
        "comment TextureFile \"tex.png\"",
        "obj_info TextureFile tex.png",
        "comment TextureFile TEX.png",
        "comment TEXTURE_FILE tex.png",
        "comment Texture File: tex.png",
        "comment texture: tex.png",
    ] {
        let dir = folder("tex.png");
        let text = format!(
            "ply\nformat ascii 1.0\n{line}\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
             end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1\n"
        );
        std::fs::write(dir.path().join("in.ply"), text).unwrap();
        let said = expect(dir.path(), "convert in.ply out.glb", 0);
        let glb = std::fs::read(dir.path().join("out.glb")).unwrap();
        assert!(glb.windows(4).any(|bytes| bytes == b"\x89PNG"), "{line}\n{said}");
    }
}

#[test]
fn exr_is_decoded_for_colours() {
    let folder = &scratch();
    let light = image::Rgb32FImage::from_pixel(4, 4, Rgb([1.0, 0.215_86, 0.0]));
    image::DynamicImage::ImageRgb32F(light).save(folder.join("tex.exr")).unwrap();
    std::fs::write(folder.join("in.obj"), OBJ).unwrap();
    std::fs::write(folder.join("in.mtl"), "newmtl wood\nmap_Kd tex.exr\n").unwrap();
    let said = expect(folder, "convert in.obj out.glb", 3);
    assert!(said.contains("glTF knows no exr"), "{said}");
    let said = expect(folder, "render in.obj -o p.png --size 32x32 --unlit", 0);
    let picture = image::open(folder.join("p.png")).unwrap().into_rgb8();
    let is_orange = |p: &Rgb<u8>| p.0[0] > 250 && p.0[1].abs_diff(128) < 3 && p.0[2] < 3;
    assert!(picture.pixels().filter(|p| is_orange(p)).count() > 50, "{said}");
}

#[test]
fn info_lists_materials_and_images() {
    let dir = folder("tex.png");
    let folder = dir.path();
    std::fs::write(folder.join("in.obj"), format!("{OBJ}usemtl bare\nf 1/1 3/3 2/2\n")).unwrap();
    let mtl = format!("{MTL}newmtl bare\nmap_Kd none.png\n");
    std::fs::write(folder.join("in.mtl"), mtl).unwrap();
    let json = crate::common::run(folder, "info in.obj --json").stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["file_format"], "OBJ");
    assert_eq!(json["materials"], serde_json::json!(["wood", "bare"]));
    assert_eq!(json["images"], serde_json::json!(["tex.png", "none.png"]));
    assert_eq!(json["missing_images"], serde_json::json!(["none.png"]));
    assert_eq!(json["image_pixels"], serde_json::json!([[4, 4], null]));
    let said = String::from_utf8(crate::common::run(folder, "info in.obj").stdout).unwrap();
    assert!(said.contains("OBJ") && said.contains("2, 1 not there: none.png"), "{said}");
    assert!(said.contains("4 x 4"), "{said}");
}
