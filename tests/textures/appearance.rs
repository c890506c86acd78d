//! Pictures of textured meshes, and their likeness: colours at the places that perspective gives them, small sizes of images
//! far away, holes, the same bytes however it is done; figures that are known.

use crate::common::{expect, json, scratch};
use crate::maps::vertex_lines;
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::Value;
use std::path::Path;

/// A quad over [-1, 1]^2 at height z with coordinates from 0 to `n`, of a material with these lines.
fn quad(folder: &Path, name: &str, n: f64, material: &str) {
    let text = format!(
        "mtllib {name}.mtl\nusemtl a\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt {n} 0\nvt {n} {n}\nvt 0 {n}\n\
         f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    );
    std::fs::write(folder.join(format!("{name}.obj")), text).unwrap();
    std::fs::write(folder.join(format!("{name}.mtl")), format!("newmtl a\n{material}\n")).unwrap();
}

/// A board of 8 x 8 fields of 16 texels, the lower left one black.
fn board(folder: &Path) {
    let image = RgbImage::from_fn(128, 128, |x, y| {
        let is_white = (x / 16 + (127 - y) / 16) % 2 == 1;
        Rgb([if is_white { 255 } else { 0 }; 3])
    });
    image.save(folder.join("board.png")).unwrap();
}

fn picture(folder: &Path, arguments: &str) -> RgbImage {
    expect(folder, &format!("render {arguments} -o p.png --force"), 0);
    image::open(folder.join("p.png")).unwrap().into_rgb8()
}

/// The camera of a close-up of a sphere, as `render --zoom` has it, for a picture of `side` pixels: a point of space in pixels.
fn project(p: [f64; 3], to_viewer: [f64; 3], radius: f64, side: f64) -> [f64; 2] {
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
    let length = dot(to_viewer, to_viewer).sqrt();
    let back = to_viewer.map(|x| x / length);
    // The quad is flat, so up is z.
    let right = [-back[1], back[0], 0.0];
    let size = dot(right, right).sqrt();
    let right = right.map(|x| x / size);
    let up = [
        back[1] * right[2] - back[2] * right[1],
        back[2] * right[0] - back[0] * right[2],
        back[0] * right[1] - back[1] * right[0],
    ];
    let focal = 0.5 * side / 0.21;
    let sine = 0.21 / (1.0 + 0.21f64 * 0.21).sqrt();
    let depth = radius / sine - dot(p, back);
    [0.5 * side + focal * dot(p, right) / depth, 0.5 * side - focal * dot(p, up) / depth]
}

#[test]
fn fields_of_a_board_are_where_perspective_puts_them() {
    let folder = &scratch();
    board(folder);
    quad(folder, "q", 1.0, "Kd 1 1 1\nmap_Kd board.png");
    let arguments = "--view 0.3,-1,0.6 --zoom 0,0,0,1.5 --size 600x600 --unlit";
    let seen = picture(folder, &format!("q.obj {arguments}"));
    for i in 0..8 {
        for j in 0..8 {
            let middle = [(f64::from(i) + 0.5) / 4.0 - 1.0, (f64::from(j) + 0.5) / 4.0 - 1.0, 0.0];
            let [x, y] = project(middle, [0.3, -1.0, 0.6], 1.5, 600.0);
            let Rgb([value, ..]) = *seen.get_pixel(x as u32, y as u32);
            let expected = if (i + j) % 2 == 1 { 255 } else { 0 };
            assert_eq!(value, expected, "field {i}, {j} at {x:.1}, {y:.1}");
        }
    }
    // Affine coordinates would put the middle of the quad's diagonal into its middle in the picture.
    let corners =
        [[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]].map(|p| project(p, [0.3, -1.0, 0.6], 1.5, 600.0));
    let [mx, my] = project([0.0; 3], [0.3, -1.0, 0.6], 1.5, 600.0);
    assert!((0.5 * (corners[0][1] + corners[1][1]) - my).abs() > 4.0 && (mx - 300.0).abs() < 1e-9);
    // Through PLY, one thread and little memory: the same picture. GLB counts v from the top, so that is rounded.
    expect(folder, "convert q.obj q.ply", 0);
    assert!(picture(folder, &format!("q.ply {arguments}")) == seen);
    expect(folder, "convert q.obj q.glb --format float", 0);
    let other = picture(folder, &format!("q.glb {arguments}"));
    let differs = seen.pixels().zip(other.pixels()).filter(|(a, b)| a.0[0].abs_diff(b.0[0]) > 8);
    assert!(differs.count() < 400);
    assert!(picture(folder, &format!("q.obj {arguments} --threads 1 --memory 165MiB")) == seen);
    assert!(picture(folder, &format!("q.obj {arguments} --color-by texture")) == seen);
    assert!(picture(folder, &format!("q.obj {arguments} --color plain")) != seen);
}

/// Coordinates reach from border to border, and images repeat unless they say otherwise: red at the left and blue at the right
/// never meet.
#[test]
fn nothing_is_seen_across_the_border_of_an_image() {
    let folder = &scratch();
    let column = |x: u32| [[255, 0, 0], [0, 255, 0], [0, 255, 0], [0, 0, 255]][x as usize / 4];
    RgbImage::from_fn(16, 16, |x, _| Rgb(column(x))).save(folder.join("stripes.png")).unwrap();
    quad(folder, "q", 1.0, "Kd 1 1 1\nmap_Kd stripes.png");
    expect(folder, "tiles q.obj tree --texture colors", 0);
    expect(folder, "extract tree q.ply --max-error 0", 0);
    let of_vertices = vertex_lines(folder, "q.ply");
    for line in &of_vertices {
        let [own, other] = if line[0] < 0.0 { [3, 5] } else { [5, 3] };
        assert!(line[own] > 0.7 && line[other] == 0.0, "{of_vertices:?}");
    }
    expect(folder, "simplify q.obj b.obj --ratio 100% --texture bake", 0);
    let page = std::fs::read_to_string(folder.join("b.mtl")).unwrap();
    let page = page.lines().find_map(|line| line.strip_prefix("map_Kd ")).unwrap();
    let page = image::open(folder.join(page)).unwrap().into_rgb8();
    let is_mixed = |pixel: &&Rgb<u8>| pixel[0].min(pixel[2]) > 40 && pixel[1] < 90;
    assert_eq!(page.pixels().filter(is_mixed).count(), 0);
    let seen = picture(folder, "q.obj --view 0,-0.001,1 --size 300x300 --unlit");
    assert_eq!(seen.pixels().filter(is_mixed).count(), 0);
    // Coordinates of two repetitions cross a border in the middle.
    quad(folder, "q", 2.0, "Kd 1 1 1\nmap_Kd stripes.png");
    let seen = picture(folder, "q.obj --view 0,-0.001,1 --size 300x300 --unlit");
    assert!(seen.pixels().filter(is_mixed).count() > 500);
}

#[test]
fn far_away_a_board_is_grey_in_linear_light() {
    let folder = &scratch();
    board(folder);
    // 128 boards a side on 100 pixels: 10 fields a pixel, 55 texels from sample to sample.
    quad(folder, "q", 128.0, "Kd 1 1 1\nmap_Kd board.png");
    let seen = picture(folder, "q.obj --view top --zoom 0,0,0,1 --size 100x100 --unlit");
    for x in [30, 45, 50, 62, 70] {
        for y in [31, 44, 50, 61, 68] {
            // Half of the light is 188.
            let Rgb([value, ..]) = *seen.get_pixel(x, y);
            assert!(value.abs_diff(188) <= 3, "{value} at {x}, {y}");
        }
    }
    // Colours of the material multiply the light of the image: Kd is as screens show it.
    quad(folder, "r", 128.0, "Kd 0.5 1 0\nmap_Kd board.png");
    let seen = picture(folder, "r.obj --view top --zoom 0,0,0,1 --size 100x100 --unlit");
    let Rgb([r, g, b]) = *seen.get_pixel(50, 50);
    let half = |value: f64| {
        let light = 0.5 * ((value + 0.055) / 1.055).powf(2.4);
        255.0 * (1.055 * light.powf(1.0 / 2.4) - 0.055)
    };
    assert!(
        (f64::from(r) - half(0.5)).abs() < 3.0 && g.abs_diff(188) <= 3 && b <= 3,
        "{r} {g} {b}"
    );
}

#[test]
fn what_lies_behind_the_holes_of_an_image_is_seen() {
    let folder = &scratch();
    let fence = RgbaImage::from_fn(64, 64, |x, _| match x / 16 % 2 {
        0 => Rgba([255, 0, 0, 255]),
        _ => Rgba([0, 255, 0, 0]),
    });
    fence.save(folder.join("fence.png")).unwrap();
    let text = "mtllib q.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\n\
        vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl fence\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\nusemtl wall\nf 5/1 6/2 7/3\nf 5/1 7/3 8/4\n";
    std::fs::write(folder.join("q.obj"), text).unwrap();
    let library = "newmtl fence\nmap_Kd fence.png\nnewmtl wall\nKd 0 0 1\n";
    std::fs::write(folder.join("q.mtl"), library).unwrap();
    let seen = picture(folder, "q.obj --view top --zoom 0,0,0,1 --size 200x200 --unlit");
    // Four bars of a quarter of the quad each; the wall is a little smaller behind it.
    for (x, color) in
        [(-0.75, [255, 0, 0]), (-0.25, [0, 0, 255]), (0.25, [255, 0, 0]), (0.6, [0, 0, 255])]
    {
        let pixel = *seen.get_pixel((100.0 + 100.0 * 0.978 * x) as u32, 100);
        assert_eq!(pixel, Rgb(color), "at {x}");
    }
}

#[test]
fn an_image_that_is_missing_or_damaged_is_a_warning() {
    let folder = &scratch();
    quad(folder, "q", 1.0, "Kd 0 0 1\nmap_Kd board.png");
    let arguments =
        "render q.obj -o p.png --view top --zoom 0,0,0,1 --size 100x100 --unlit --force";
    let said = expect(folder, arguments, 3);
    assert!(said.contains("lost") && said.contains("board.png"), "{said}");
    let blue = Rgb([0, 0, 255]);
    assert_eq!(*image::open(folder.join("p.png")).unwrap().into_rgb8().get_pixel(50, 50), blue);
    board(folder);
    assert!(!expect(folder, arguments, 0).contains("lost"));
    let bytes = std::fs::read(folder.join("board.png")).unwrap();
    std::fs::write(folder.join("board.png"), &bytes[..bytes.len() / 2]).unwrap();
    let said = expect(folder, arguments, 3);
    assert!(said.contains("cannot be decoded"), "{said}");
    assert_eq!(*image::open(folder.join("p.png")).unwrap().into_rgb8().get_pixel(50, 50), blue);
}

fn appearance(folder: &Path, arguments: &str) -> Value {
    expect(folder, &format!("measure {arguments} --samples 1k --appearance --report m.json"), 0);
    json(folder, "m.json")["appearance"].clone()
}

#[test]
fn likeness_is_that_of_the_colours() {
    let folder = &scratch();
    for (name, value) in [("a", 100u8), ("b", 120)] {
        RgbImage::from_pixel(8, 8, Rgb([value; 3]))
            .save(folder.join(format!("{name}.png")))
            .unwrap();
        quad(folder, name, 1.0, &format!("Kd 1 1 1\nmap_Kd {name}.png"));
    }
    let same = appearance(folder, "a.obj a.obj --views 2");
    assert_eq!((&same["psnr"], &same["views"]), (&Value::Null, &Value::from(2)));
    assert!((same["ssim"].as_f64().unwrap() - 1.0).abs() < 1e-12, "{same}");
    let other = appearance(folder, "a.obj b.obj --views 2");
    assert_eq!(other["lighting"], "unlit");
    // At the rim a pixel is partly background, so the mean is a little better.
    let psnr = 20.0 * (255.0f64 / 20.0).log10();
    for found in [&other["psnr"], &other["worst"]["psnr"]] {
        let found = found.as_f64().unwrap();
        assert!((psnr - 1e-9..psnr + 0.2).contains(&found), "{found} for {psnr}");
    }
    assert!(other["ssim"].as_f64().unwrap() < 1.0);
    // One thread: the same figures. Pictures of all views.
    assert_eq!(appearance(folder, "a.obj b.obj --views 2 --threads 1 --pictures shots"), other);
    let shot = image::open(folder.join("shots/view-01.png")).unwrap().into_rgb8();
    assert_eq!(shot.dimensions().0, 2 * 768 + 2);
    // Without colours it is the shape that counts, under lamps.
    expect(folder, "synth statue s.ply --triangles 2k", 0);
    expect(folder, "simplify s.ply t.ply --triangles 200 -q", 0);
    let plain = appearance(folder, "s.ply t.ply --views 2");
    assert_eq!(plain["lighting"], "studio");
    let psnr = plain["psnr"].as_f64().unwrap();
    assert!((10.0..40.0).contains(&psnr) && plain["ssim"].as_f64().unwrap() < 0.99, "{plain}");
    assert!(plain["worst"]["psnr"].as_f64().unwrap() <= psnr);
}
