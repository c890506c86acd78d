//! Parts that an output, a new texture or a picture has no place for: each is named.

use super::bake::sheet;
use crate::common::{expect, scratch};
use image::{Rgba, RgbaImage};
use std::path::Path;

fn says_all(said: &str, all: &[&str]) {
    for words in all {
        assert!(said.contains(words), "{words}\n{said}");
    }
}

fn image(folder: &Path) {
    let image = RgbaImage::from_fn(16, 16, |x, y| Rgba([16 * x as u8, 16 * y as u8, 90, 255]));
    image.save(folder.join("image.png")).unwrap();
}

#[test]
fn lines_of_obj_without_a_place_are_named() {
    let folder = &scratch();
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let more = "vn 0 0 1\nl 1 2\np 1\no first\ng second\nvp 0.5\n";
    std::fs::write(folder.join("plain.obj"), format!("o only\n{triangle}")).unwrap();
    std::fs::write(folder.join("more.obj"), format!("{triangle}{more}")).unwrap();
    for output in ["out.obj", "out.ply", "out.glb"] {
        let said = expect(folder, &format!("convert more.obj {output} --force"), 0);
        says_all(
            &said,
            &[
                "note: normals of corners (vn): not carried",
                "lost in part: lines and points (l, p), 2 of them: not carried",
                "lost in part: curves and surfaces (vp, curv, surf): not carried",
            ],
        );
        let said = expect(folder, &format!("convert plain.obj {output} --force"), 0);
        assert!(!said.contains("not carried"), "{said}");
    }
    // Nothing comes of a note: no library, no material.
    let text = std::fs::read_to_string(folder.join("out.obj")).unwrap();
    assert!(!text.contains("mtl") && !folder.join("out.mtl").exists(), "{text}");
    expect(folder, "convert more.obj more.out.obj", 0);
    assert!(!folder.join("more.out.mtl").exists());
}

#[test]
fn colours_that_pages_do_not_hold_are_named() {
    let folder = &scratch();
    image(folder);
    let library = "newmtl only\nKd 1 1 1\nKa 0.2 0 0\nKs 0.5 0.5 0.5\nKe 1 0 0\nTf 0.5 1 1\nillum 2\n\
                   map_Kd image.png\nmap_Ks image.png\nnorm image.png\n";
    sheet(folder, |x, y| format!("{x} {y}"), library);
    let said = expect(folder, "simplify sheet.obj out.obj --ratio 20% --texture bake", 0);
    let named = ["ambient colour", "highlights", "line 'Tf'", "image of highlights"];
    let named = named.map(|what| format!("{what} of material 'only': not baked"));
    says_all(&said, &named.each_ref().map(String::as_str));
    assert!(!said.contains("illum") && !said.contains("emitted light"), "{said}");
    assert!(std::fs::read_to_string(folder.join("out.mtl")).unwrap().contains("Ke 1 0 0"));
    // What says nothing is not a loss.
    let library = "newmtl only\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd image.png\n";
    sheet(folder, |x, y| format!("{x} {y}"), library);
    let said = expect(folder, "simplify sheet.obj out.obj --ratio 20% --texture bake --force", 0);
    assert!(!said.contains("not baked"), "{said}");
}

/// Formats without a place for emitted light, and pictures, show it as the colour of what is black.
#[test]
fn light_is_the_colour_of_what_is_black() {
    let folder = &scratch();
    image(folder);
    let made = |library: &str| {
        sheet(folder, |x, y| format!("{x} {y}"), library);
        expect(folder, "render sheet.obj -o p.png --unlit --size 90x60 --force", 0);
        expect(folder, "convert sheet.obj out.ply --force", 0);
        expect(folder, "simplify sheet.obj bake.ply --ratio 20% --texture bake --force", 0);
        ["p.png", "out.ply", "bake.ply", "bake_textures/bake_0.png"]
            .map(|name| std::fs::read(folder.join(name)).unwrap())
    };
    let wanted = made("newmtl only\nmap_Kd image.png\n");
    assert!(made("newmtl only\nKd 0 0 0\nKe 1 1 1\nmap_Ke image.png\n") == wanted);
    // A new texture is seen as its input, by its light alone; lamps change nothing.
    expect(folder, "simplify sheet.obj light.obj --ratio 20% --texture bake", 0);
    let picture = |mesh: &str, options: &str| {
        let command = format!("render {mesh} -o lit.png --size 90x60 --force {options}");
        expect(folder, &command, 0);
        image::open(folder.join("lit.png")).unwrap().to_rgb8()
    };
    let middle = |options: &str| picture("sheet.obj", options).get_pixel(45, 30).0;
    assert_eq!(middle(""), middle("--unlit"));
    // Side by side, two pixels apart.
    let both = picture("sheet.obj light.obj", "--unlit");
    let off = |x: u32, y: u32| {
        let pair = both.get_pixel(x, y).0.into_iter().zip(both.get_pixel(x + 92, y).0);
        pair.map(|(a, b)| u64::from(a.abs_diff(b))).sum::<u64>()
    };
    let off: u64 = (0..90).flat_map(|x| (0..60).map(move |y| (x, y))).map(|(x, y)| off(x, y)).sum();
    assert!(off < 16 * 90 * 60, "{off}");
    let said = expect(folder, "convert sheet.obj out.ply --force", 0);
    assert!(
        said.contains("emitted light of material 'only': taken for the colour, which is black"),
        "{said}"
    );
}

#[test]
fn pictures_name_the_looks_that_they_lack() {
    let folder = &scratch();
    image(folder);
    sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nd 0.5\nmap_Kd image.png\n");
    let picture =
        |mesh: &str| expect(folder, &format!("render {mesh} -o p.png --size 90x60 --force"), 0);
    assert!(picture("sheet.obj").contains("lost in part: opacity of materials: drawn opaque"));
    sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nmap_Kd image.png\n");
    assert!(!picture("sheet.obj").contains("lost"));
    let ply = "ply\nformat ascii 1.0\ncomment TextureFile image.png\nelement vertex 3\nproperty float x\n\
               property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
    std::fs::write(folder.join("st.ply"), ply).unwrap();
    let said = expect(folder, "render st.ply -o p.png --size 90x60 --force", 3);
    assert!(said.contains("lost: images: not drawn"), "{said}");
    expect(folder, "convert st.ply st.obj", 0);
    assert!(!picture("st.obj").contains("lost"));
}

#[test]
fn coordinates_and_images_that_are_not_whole_are_named() {
    let folder = &scratch();
    let image = image::RgbImage::from_fn(128, 128, |x, y| {
        image::Rgb([(x * y) as u8, (7 * x) as u8, y as u8])
    });
    image.save(folder.join("image.jpg")).unwrap();
    let whole = std::fs::read(folder.join("image.jpg")).unwrap();
    std::fs::write(folder.join("image.jpg"), &whole[..whole.len() / 2]).unwrap();
    let odd = |x: f64, y: f64| if x < 0.2 { format!("nan {y}") } else { format!("{x} {y}") };
    sheet(folder, odd, "newmtl only\nmap_Kd image.jpg\n");
    let (cut, odd) =
        ("is doubtful: its end is missing", "texture coordinates (vt), 84 of them: not finite");
    let said = expect(folder, "simplify sheet.obj out.obj --ratio 20% --texture bake", 0);
    says_all(&said, &[cut, odd]);
    let said = expect(folder, "convert sheet.obj out.glb", 0);
    says_all(&said, &["is doubtful: its end is missing", odd]);
    let said = expect(folder, "render sheet.obj -o p.png --size 90x60", 0);
    says_all(&said, &[cut]);
}

#[test]
fn coordinates_of_faces_that_are_not_finite_are_named() {
    let folder = &scratch();
    let text = "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                element face 4\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n\
                0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2 6 nan 0 1 0 0 1\n3 0 3 1 6 0 0 1 0 0 1\n3 0 2 3 6 0 0 1 0 0 1\n\
                3 1 3 2 6 0 0 1 inf 0 1\n";
    std::fs::write(folder.join("in.ply"), text).unwrap();
    let odd = "faces with texture coordinates that are not finite, 2 of them: 0 was written";
    // The only image is not there.
    for output in ["out.obj", "out.glb"] {
        says_all(&expect(folder, &format!("convert in.ply {output}"), 3), &[odd]);
    }
    assert!(!expect(folder, "convert in.ply out.ply", 3).contains(odd));
}

#[test]
fn libraries_that_name_themselves_end() {
    let folder = &scratch();
    let cyclic = "mtllib sheet.mtl\nmtllib sheet.obj\nnewmtl only\nmap_Kd sheet.mtl\n";
    sheet(folder, |x, y| format!("{x} {y}"), cyclic);
    let said = expect(folder, "convert sheet.obj out.glb", 3);
    says_all(&said, &["sheet.mtl' (material 'only') is not an image"]);
    let text = std::fs::read_to_string(folder.join("sheet.obj")).unwrap();
    std::fs::write(folder.join("self.obj"), text.replace("sheet.mtl", "self.obj")).unwrap();
    let said = expect(folder, "simplify self.obj self.glb --ratio 20%", 0);
    says_all(&said, &["materials: in no library"]);
}

#[test]
fn a_glb_has_images_that_gltf_does_not_know_as_png_or_ends_with_3() {
    let at = &scratch();
    image::RgbImage::from_pixel(4, 4, image::Rgb([200, 120, 60])).save(at.join("a.bmp")).unwrap();
    std::fs::write(at.join("a.mtl"), "newmtl m\nmap_Kd a.bmp\n").unwrap();
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    std::fs::write(at.join("a.obj"), text).unwrap();
    for command in ["convert a.obj a.glb", "simplify a.obj a.glb --ratio 100% --texture keep"] {
        let said = expect(at, &format!("{command} --force"), 0);
        assert!(said.contains("as PNG, since glTF knows no bmp"), "{said}");
        let image = crate::maps::embedded(&at.join("a.glb"), "a");
        assert!(image.pixels().all(|pixel| pixel.0 == [200, 120, 60]));
    }
    // One that cannot be decoded.
    let bytes = std::fs::read(at.join("a.bmp")).unwrap();
    std::fs::write(at.join("a.bmp"), &bytes[..bytes.len() - 20]).unwrap();
    let said = expect(at, "convert a.obj a.glb --force", 3);
    assert!(said.contains("lost: all images") && said.contains("JPEG"), "{said}");
    expect(at, "convert a.obj b.obj", 0);
}

/// A TGA file has nothing at its beginning that tells it.
#[test]
fn images_in_tga_are_decoded() {
    let at = &scratch();
    // Uncompressed, 2 x 2, 24 bits: blue, green, red.
    let mut image = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, 0];
    image.extend([10u8, 20, 230].repeat(4));
    std::fs::write(at.join("a.tga"), image).unwrap();
    std::fs::write(at.join("a.mtl"), "newmtl m\nmap_Kd a.tga\n").unwrap();
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    std::fs::write(at.join("a.obj"), text).unwrap();
    let said = expect(at, "render a.obj -o p.png --size 32x32 --unlit", 0);
    assert!(!said.contains("lost"), "{said}");
    let picture = image::open(at.join("p.png")).unwrap().into_rgb8();
    let is_red = |p: &image::Rgb<u8>| p.0[0] > 200 && p.0[1] < 60 && p.0[2] < 60;
    assert!(picture.pixels().any(is_red), "no red pixel");
}

/// Pages have names that the images of the input may have already.
#[test]
fn images_of_the_input_are_never_replaced() {
    let folder = &scratch();
    image(folder);
    std::fs::create_dir(folder.join("out_textures")).unwrap();
    let page = folder.join("out_textures/out_0.png");
    std::fs::rename(folder.join("image.png"), &page).unwrap();
    sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nmap_Kd out_textures/out_0.png\n");
    let before = std::fs::read(&page).unwrap();
    let refused = |output: &str, what: &str| {
        let command = format!("simplify sheet.obj {output} --ratio 20% --texture bake");
        for force in ["", "--force"] {
            let said = expect(folder, &format!("{command} {force}"), 2);
            assert!(said.contains(what) && !said.contains("give --force"), "{command}: {said}");
        }
        assert!(!folder.join(format!("{output}.stonecut-job")).exists(), "{output}");
        assert_eq!(std::fs::read(&page).unwrap(), before, "{output}");
    };
    let is_image = "out_0.png is an image of the input; give OUTPUT another name";
    refused("out.obj", is_image);
    refused("out.ply", is_image);
    expect(folder, "simplify sheet.obj out.obj --ratio 20% --force", 2);
    expect(folder, "simplify sheet.obj first.obj --ratio 20% --and out.obj=10% --force", 2);
    std::fs::rename(folder.join("sheet.mtl"), folder.join("own.mtl")).unwrap();
    let text = std::fs::read_to_string(folder.join("sheet.obj")).unwrap();
    std::fs::write(folder.join("sheet.obj"), text.replace("sheet.mtl", "own.mtl")).unwrap();
    refused("own.obj", "own.mtl is the material library of the input; give OUTPUT another name");
    // A GLB holds its images; one that is kept stays where it is.
    for command in ["--texture bake", "--texture keep"] {
        expect(folder, &format!("simplify sheet.obj out.glb --ratio 20% --force {command}"), 0);
    }
    expect(folder, "simplify sheet.obj out.obj --ratio 90% --force", 0);
    assert_eq!(std::fs::read(&page).unwrap(), before);
}
