//! New textures for results: colours in the right places, nothing between charts, the same bytes however it is done.

use crate::common::meshes::{halves, ply_text, squares};
use crate::common::{expect, json, run, scratch};
use image::{Rgb, RgbImage};
use std::collections::BTreeMap;
use std::path::Path;

/// A result in OBJ: for each face its material, and position and coordinates of its corners.
type Faces = Vec<(String, [([f64; 3], [f64; 2]); 3])>;

fn read_obj(path: &Path) -> Faces {
    let (mut points, mut uvs, mut material) = (Vec::new(), Vec::new(), String::new());
    let mut faces = Vec::new();
    for line in std::fs::read_to_string(path).unwrap().lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let numbers =
            || words[1..].iter().map(|word| word.parse::<f64>().unwrap()).collect::<Vec<_>>();
        match words.first() {
            Some(&"v") => points.push(*numbers().first_chunk::<3>().unwrap()),
            Some(&"vt") => uvs.push(*numbers().first_chunk::<2>().unwrap()),
            Some(&"usemtl") => material = words[1].to_owned(),
            Some(&"f") => {
                let corner = |k: usize| {
                    let ids: Vec<usize> =
                        words[k].split('/').map(|id| id.parse().unwrap()).collect();
                    (points[ids[0] - 1], uvs[ids[1] - 1])
                };
                faces.push((material.clone(), [corner(1), corner(2), corner(3)]));
            }
            _ => {}
        }
    }
    faces
}

/// The colour image of each material of a library.
fn pages(library: &Path) -> BTreeMap<String, RgbImage> {
    let (mut out, mut name) = (BTreeMap::new(), String::new());
    for line in std::fs::read_to_string(library).unwrap().lines() {
        if let Some(new) = line.strip_prefix("newmtl ") {
            name = new.to_owned();
        } else if let Some(path) = line.strip_prefix("map_Kd ") {
            let image = image::open(library.parent().unwrap().join(path)).unwrap();
            out.insert(name.clone(), image.into_rgb8());
        }
    }
    out
}

/// Half the size, each pixel the mean of four.
fn half(image: &RgbImage) -> RgbImage {
    RgbImage::from_fn(image.width() / 2, image.height() / 2, |x, y| {
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let four = four.map(|(dx, dy)| image.get_pixel(2 * x + dx, 2 * y + dy).0);
        let mean = |k: usize| (four.iter().map(|p| u32::from(p[k])).sum::<u32>() + 2) / 4;
        Rgb([0, 1, 2].map(|k| mean(k) as u8))
    })
}

/// The mix of the four pixels around coordinates, v upwards, as a graphics card does it.
pub(super) fn look_up(image: &RgbImage, [u, v]: [f64; 2]) -> [f64; 3] {
    let size = [image.width(), image.height()].map(f64::from);
    let at = [u * size[0] - 0.5, (1.0 - v) * size[1] - 0.5];
    let pixel = |dx: f64, dy: f64| {
        let [x, y] = [(at[0].floor() + dx, size[0]), (at[1].floor() + dy, size[1])]
            .map(|(x, n)| x.clamp(0.0, n - 1.0) as u32);
        image.get_pixel(x, y).0.map(f64::from)
    };
    let [fx, fy] = at.map(|x| x - x.floor());
    let four = [pixel(0.0, 0.0), pixel(1.0, 0.0), pixel(0.0, 1.0), pixel(1.0, 1.0)];
    let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
    std::array::from_fn(|k| (0..4).map(|i| weights[i] * four[i][k]).sum())
}

/// Points of a triangle, its corners among them.
pub(super) fn points_of<const N: usize>(corners: [[f64; N]; 3]) -> impl Iterator<Item = [f64; N]> {
    (0..=6).flat_map(move |i| {
        (0..=6 - i).map(move |j| {
            let w = [i as f64 / 6.0, j as f64 / 6.0, (6 - i - j) as f64 / 6.0];
            std::array::from_fn(|k| (0..3).map(|c| w[c] * corners[c][k]).sum())
        })
    })
}

/// Red, green and blue of the six sides: only these channels are ever above 0 on a side.
const HUES: [[u8; 3]; 6] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]];

/// Quads along an edge of the cube, and pixels of a side's square in the atlas.
const N: usize = 24;
const SIDE: u32 = 96;

/// A cube whose sides are checker boards in six hues, side by side in one atlas without a gap.
fn cube(folder: &Path) {
    let atlas = RgbImage::from_fn(3 * SIDE, 2 * SIDE, |x, y| {
        let side = (x / SIDE + 3 * (y / SIDE)) as usize;
        let value = if (x / 8 + y / 8) % 2 == 0 { 250 } else { 90 };
        Rgb(HUES[side].map(|hue| hue * value))
    });
    atlas.save(folder.join("atlas.png")).unwrap();
    std::fs::write(folder.join("cube.mtl"), "newmtl sides\nKd 1 1 1\nmap_Kd atlas.png\n").unwrap();
    let mut text = String::from("mtllib cube.mtl\nusemtl sides\n");
    for side in 0..6 {
        let (axis, is_far) = (side / 2, side % 2 == 1);
        for i in 0..=N {
            for j in 0..=N {
                let (a, b) = (i as f64 / N as f64, j as f64 / N as f64);
                let mut point = [0.0; 3];
                (point[(axis + 1) % 3], point[(axis + 2) % 3]) = (a, b);
                point[axis] = if is_far { 1.0 } else { 0.0 };
                let [x, y, z] = point;
                // Half a pixel from the neighbours in the atlas, so that nothing of them is mixed in.
                let within = |t: f64| (0.75 + t * (f64::from(SIDE) - 1.5)) / f64::from(SIDE);
                let u = ((side % 3) as f64 + within(a)) / 3.0;
                let v = 1.0 - ((side / 3) as f64 + within(b)) / 2.0;
                text += &format!("v {x} {y} {z}\nvt {u} {v}\n");
            }
        }
        for i in 0..N {
            for j in 0..N {
                let id = |i: usize, j: usize| {
                    let id = side * (N + 1) * (N + 1) + i * (N + 1) + j + 1;
                    format!("{id}/{id}")
                };
                let (a, b, c, d) = (id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1));
                text += &match is_far {
                    true => format!("f {a} {b} {c}\nf {a} {c} {d}\n"),
                    false => format!("f {a} {c} {b}\nf {a} {d} {c}\n"),
                };
            }
        }
    }
    std::fs::write(folder.join("cube.obj"), text).unwrap();
}

/// On a checker board no texel of another chart shows, nor what lies between charts, at full size, 1/2, 1/4 and 1/8,
/// mixed by a graphics card; and every side shows its own squares.
#[test]
fn nothing_bleeds_from_chart_to_chart() {
    let folder = &scratch();
    cube(folder);
    let said = expect(folder, "simplify cube.obj out.obj --ratio 5% --texture bake", 0);
    assert!(said.contains("charts on 1 pages"), "{said}");
    let faces = read_obj(&folder.join("out.obj"));
    assert!(faces.len() <= 346 && faces.len() >= 12, "{}", faces.len());
    let pages = pages(&folder.join("out.mtl"));
    assert_eq!(pages.len(), 1);
    let mut levels = vec![pages.into_values().next().unwrap()];
    for _ in 0..3 {
        levels.push(half(&levels[levels.len() - 1]));
    }
    let mut n_of = [0; 6];
    for (_, corners) in &faces {
        let places = corners.map(|(at, _)| at);
        let middle: [f64; 3] = [0, 1, 2].map(|k| places.iter().map(|p| p[k]).sum::<f64>() / 3.0);
        let off = |side: usize| (middle[side / 2] - (side % 2) as f64).abs();
        let side = (0..6).min_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap();
        assert!(off(side) < 1e-6, "{places:?}");
        n_of[side] += 1;
        for (level, image) in levels.iter().enumerate() {
            for uv in points_of(corners.map(|(_, uv)| uv)) {
                let colour = look_up(image, uv);
                for (k, &hue) in HUES[side].iter().enumerate() {
                    let fits = if hue == 0 { colour[k] < 2.0 } else { colour[k] > 85.0 };
                    assert!(fits, "side {side} has {colour:?} at 1/{}, uv {uv:?}", 1 << level);
                }
            }
        }
        // Well inside a square of the board its own value shows.
        let inside = places.iter().map(|p| [p[(side / 2 + 1) % 3], p[(side / 2 + 2) % 3]]);
        let uvs: Vec<[f64; 2]> = corners.iter().map(|(_, uv)| *uv).collect();
        let ab: Vec<[f64; 2]> = inside.collect();
        let both = [0, 1, 2].map(|i| [ab[i][0], ab[i][1], uvs[i][0], uvs[i][1]]);
        for [a, b, u, v] in points_of(both) {
            let pixel = |t: f64| 0.75 + t * (f64::from(SIDE) - 1.5);
            let (x, y) = (pixel(a), pixel(b));
            let (own_x, own_y) =
                ((side % 3) as f64 * f64::from(SIDE), (side / 3) as f64 * f64::from(SIDE));
            let is_inside = [x, y].iter().all(|t| (2.5..5.5).contains(&(t % 8.0)));
            if is_inside {
                let is_bright =
                    (((own_x + x) / 8.0) as u32 + ((own_y + y) / 8.0) as u32).is_multiple_of(2);
                let value = look_up(&levels[0], [u, v]).into_iter().fold(0.0, f64::max);
                let expected = if is_bright { 250.0 } else { 90.0 };
                assert!((value - expected).abs() < 20.0, "{value} for {expected}: {a} {b}");
            }
        }
    }
    assert!(n_of.iter().all(|&n| n >= 2), "{n_of:?}");
}

/// A result with a new texture has the shape that it has without any, to the last digit, and exactly the triangles that
/// were asked for.
#[test]
fn the_shape_is_that_of_a_mesh_without_texture() {
    let folder = &scratch();
    expect(folder, "synth rooms rooms.obj --triangles 60k", 0);
    for triangles in [6000, 600] {
        let to = format!("--triangles {triangles} -q --force --cell-triangles 10000");
        expect(folder, &format!("simplify rooms.obj plain.ply {to} --texture none"), 0);
        expect(folder, &format!("simplify rooms.obj baked.ply {to} --texture bake"), 0);
        let plain = open(&folder.join("plain.ply"));
        let baked = open(&folder.join("baked.ply"));
        assert!((triangles - 1..=triangles).contains(&plain.mesh.triangles.len()));
        assert_eq!(plain.mesh.positions, baked.mesh.positions);
        assert_eq!(plain.mesh.triangles, baked.mesh.triangles);
        std::fs::remove_dir_all(folder.join("baked_textures")).unwrap();
    }
}

fn open(path: &Path) -> stonecut::measure::load::Loaded {
    let source = stonecut::io::ply::MeshSource::open(path).unwrap();
    stonecut::measure::load::load(&source, 1, &Default::default()).unwrap()
}

/// Every file of a folder, by name.
pub(super) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            out.extend(
                files(&path).into_iter().map(|(file, bytes)| (format!("{name}/{file}"), bytes)),
            );
        } else {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            out.insert(name, std::fs::read(path).unwrap());
        }
    }
    out
}

/// Threads, memory and a stop before the bake change no byte; pages that do not do are several.
#[test]
fn bytes_depend_on_the_question_alone() {
    let folder = &scratch();
    expect(folder, "synth rooms rooms.obj --triangles 40k", 0);
    for kind in ["obj", "glb"] {
        let simplify = |to: &str, how: &str| {
            std::fs::create_dir_all(folder.join(to)).unwrap();
            let what = "--ratio 5% --cell-triangles 4000 --texture bake --bake-size 256 -q";
            expect(folder, &format!("simplify rooms.obj {to}/room.{kind} {what} {how}"), 0);
        };
        simplify("one", "--threads 1 --memory 150MiB");
        simplify("two", "--threads 2 --memory 2GiB");
        simplify("stopped", "--threads 2 --until stitch");
        simplify("stopped", "--threads 3");
        let first = files(&folder.join("one"));
        assert!(first.keys().any(|name| name.contains('_')) || kind == "glb", "{:?}", first.keys());
        for other in ["two", "stopped"] {
            let found = files(&folder.join(other));
            assert!(first.keys().eq(found.keys()), "{:?} {:?}", first.keys(), found.keys());
            for (name, bytes) in &first {
                assert!(bytes == &found[name], "{other}/{name} differs");
            }
            std::fs::remove_dir_all(folder.join(other)).unwrap();
        }
        std::fs::remove_dir_all(folder.join("one")).unwrap();
    }
    let report = |how: &str| {
        let command =
            format!("simplify rooms.obj r.glb --ratio 5% -q --force --report r.json {how}");
        expect(folder, &command, 0);
        json(folder, "r.json")
    };
    let many = report("--texture bake --bake-size 512");
    assert!(many["bake"]["pages"].as_u64().unwrap() > 1, "{}", many["bake"]);
    let density = many["bake"]["texel_density"].as_f64().unwrap();
    let of_input = many["bake"]["original_texel_density"].as_f64().unwrap();
    assert!((density / of_input - 1.0).abs() < 1e-9);
    let one = report("--texture bake --bake-size 512 --bake-pages 1");
    assert_eq!(one["bake"]["pages"], 1);
    assert!(one["bake"]["texel_density"].as_f64().unwrap() < density);
}

/// A sheet over the unit square with coordinates that repeat its image three times along x and begin far from 0.
pub(super) fn sheet(folder: &Path, uv: impl Fn(f64, f64) -> String, library: &str) {
    let n = 20;
    let mut text = String::from("mtllib sheet.mtl\nusemtl only\n");
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            let z = 0.02 * (5.0 * x).sin() * (4.0 * y).cos();
            text += &format!("v {x} {y} {z}\nvt {}\n", uv(x, y));
        }
    }
    for i in 0..n {
        for j in 0..n {
            let id = |i: i32, j: i32| format!("{0}/{0}", i * (n + 1) + j + 1);
            let (a, b, c, d) = (id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1));
            text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
        }
    }
    std::fs::write(folder.join("sheet.obj"), text).unwrap();
    std::fs::write(folder.join("sheet.mtl"), library).unwrap();
}

/// The colour that a result has at each of many places of its surface: the page times the material's.
fn colours(folder: &Path, name: &str) -> Vec<([f64; 3], [f64; 3])> {
    let library = folder.join(format!("{name}.mtl"));
    let text = std::fs::read_to_string(&library).unwrap();
    let kd = text.lines().find_map(|line| line.strip_prefix("Kd ")).unwrap();
    let kd: Vec<f64> = kd.split_whitespace().map(|x| x.parse().unwrap()).collect();
    let pages = pages(&library);
    let mut out = Vec::new();
    for (material, corners) in read_obj(&folder.join(format!("{name}.obj"))) {
        let both = corners.map(|([x, y, z], [u, v])| [x, y, z, u, v]);
        for [x, y, z, u, v] in points_of(both) {
            let [r, g, b] = look_up(&pages[&material], [u, v]);
            out.push(([x, y, z], [kd[0] * r, kd[1] * g, kd[2] * b]));
        }
    }
    out
}

const WITH_IMAGE: &str = "newmtl only\nKd 1 1 1\nmap_Kd image.png\n";

#[test]
fn colours_are_those_of_the_nearest_place_and_images_repeat() {
    let folder = &scratch();
    let image = RgbImage::from_fn(128, 64, |x, y| {
        // Smooth where it repeats, so that no colour depends on half a pixel.
        let wave = 127.5 + 100.0 * (f64::from(x) / 128.0 * std::f64::consts::TAU).sin();
        Rgb([wave as u8, 40 + 3 * y as u8, 30])
    });
    image.save(folder.join("image.png")).unwrap();
    sheet(folder, |x, y| format!("{} {}", 3.0 * x - 7.0, 0.1 + 0.8 * y), WITH_IMAGE);
    expect(folder, "simplify sheet.obj out.obj --ratio 10% --texture bake -q", 0);
    let found = colours(folder, "out");
    let mut worst: f64 = 0.0;
    for ([x, y, _], colour) in &found {
        let expected = look_up(&image, [(3.0 * x).rem_euclid(1.0), 0.1 + 0.8 * y]);
        worst = (0..3).map(|k| (colour[k] - expected[k]).abs()).fold(worst, f64::max);
    }
    assert!(found.len() > 500 && worst < 16.0, "{worst} at one of {}", found.len());
}

#[test]
fn what_cannot_be_used_is_said_and_the_material_stands_for_it() {
    let folder = &scratch();
    let plain = |x: f64, y: f64| format!("{x} {y}");
    let library = "newmtl only\nKd 0.2 0.6 1\nmap_Kd image.png\n";
    let is_kd = |name: &str| {
        let colours = colours(folder, name);
        colours.iter().all(|(_, c)| (0..3).all(|k| (c[k] - [51.0, 153.0, 255.0][k]).abs() < 2.0))
    };
    let bake = |name: &str, code| {
        expect(folder, &format!("simplify sheet.obj {name}.obj --ratio 20% --texture bake"), code)
    };
    sheet(folder, plain, library);
    let said = bake("missing", 3);
    assert!(said.contains("image.png is not there") && is_kd("missing"), "{said}");

    let mut huge = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    huge.extend(100_000u32.to_be_bytes());
    huge.extend(100_000u32.to_be_bytes());
    huge.extend(b"\x08\x02\0\0\0\0\0\0\0\0\0\0\0IEND\xaeB`\x82");
    std::fs::write(folder.join("image.png"), huge).unwrap();
    let said = bake("huge", 3);
    assert!(said.contains("100000 x 100000") && is_kd("huge"), "{said}");

    let noise = RgbImage::from_fn(64, 64, |x, y| Rgb([(x * y) as u8, (x * 7 + y * 13) as u8, 9]));
    noise.save(folder.join("image.png")).unwrap();
    let whole = std::fs::read(folder.join("image.png")).unwrap();
    std::fs::write(folder.join("image.png"), &whole[..whole.len() / 2]).unwrap();
    let said = bake("cut", 3);
    assert!(said.contains("cannot be decoded") && is_kd("cut"), "{said}");

    std::fs::write(folder.join("image.png"), b"no image at all").unwrap();
    let said = bake("wrong", 3);
    assert!(said.contains("is not an image") && is_kd("wrong"), "{said}");

    // Coordinates that are not numbers, or too large for any, in a third of the sheet.
    let blue = RgbImage::from_pixel(32, 32, Rgb([10, 20, 200]));
    blue.save(folder.join("image.png")).unwrap();
    let odd = |x: f64, y: f64| match x {
        x if x < 0.2 => "nan nan".to_owned(),
        x if x < 0.4 => format!("1e30 {y}"),
        x => format!("{x} {y}"),
    };
    sheet(folder, odd, WITH_IMAGE);
    let output = run(folder, "simplify sheet.obj odd.obj --ratio 20% --texture bake");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.code() == Some(0) {
        assert!(said.contains("not numbers"), "{said}");
        let right = colours(folder, "odd").into_iter().filter(|([x, ..], _)| *x > 0.5);
        assert!(right.clone().count() > 100);
        assert!(right.clone().all(|(_, c)| (c[2] - 200.0).abs() < 2.0));
    } else {
        // The reader may refuse them first, in words.
        assert!(said.contains("sheet.obj") && said.contains("nan"), "{said}");
    }
}

#[test]
fn the_ratio_decides_unless_it_is_said() {
    let folder = &scratch();
    let image = RgbImage::from_fn(64, 64, |x, y| Rgb([4 * x as u8, 4 * y as u8, 99]));
    image.save(folder.join("image.png")).unwrap();
    sheet(folder, |x, y| format!("{x} {y}"), WITH_IMAGE);
    let texture = |how: &str| {
        let command = format!("simplify sheet.obj out.glb -q --force --report r.json {how}");
        expect(folder, &command, 0);
        let report = json(folder, "r.json");
        assert_eq!(report["bake"].is_null(), report["settings"]["texture"] != "bake");
        report["settings"]["texture"].as_str().unwrap().to_owned()
    };
    assert_eq!(texture("--ratio 50%"), "carry");
    assert_eq!(texture("--ratio 31%"), "carry");
    assert_eq!(texture("--ratio 29%"), "bake");
    assert_eq!(texture("--ratio 5%"), "bake");
    assert_eq!(texture("--ratio 5% --texture keep"), "carry");
    assert_eq!(texture("--ratio 50% --texture bake"), "bake");
    assert_eq!(texture("--ratio 5% --texture none"), "drop");
    for (how, word) in [
        ("out.stl --texture bake", "STL"),
        ("- --format obj --texture bake", "standard output"),
        ("out.obj --texture bake --textures link", "copy or embed"),
        ("out.ply --texture bake --method cluster", "--texture bake"),
        ("out.ply --texture bake --bake-size 63", "64 to 16384"),
        ("out.ply --texture bake --max-error 0.1", "--max-error"),
    ] {
        let said = expect(folder, &format!("simplify sheet.obj {how} --ratio 5%"), 2);
        assert!(said.contains(word), "{how}: {said}");
    }
    // An image that is not ours stays.
    std::fs::create_dir(folder.join("own_textures")).unwrap();
    std::fs::write(folder.join("own_textures/own_0.png"), "mine").unwrap();
    let said = expect(folder, "simplify sheet.obj own.obj --ratio 5%", 2);
    assert!(said.contains("own_textures") && said.contains("--force"), "{said}");
    assert_eq!(std::fs::read(folder.join("own_textures/own_0.png")).unwrap(), b"mine");
}

/// Fewer pages than the input's density takes lower the density until they do, and no further than needed.
#[test]
fn pages_that_are_allowed_are_used() {
    let folder = &scratch();
    expect(folder, "synth rooms rooms.obj --triangles 20k", 0);
    let found = |how: &str| {
        let what =
            "simplify rooms.obj o.glb --triangles 1k -q --force --report r.json --texture bake";
        expect(folder, &format!("{what} --bake-size 256 {how}"), 0);
        let report = json(folder, "r.json");
        let number = |key: &str| report["bake"][key].as_f64().unwrap();
        (number("pages") as u64, number("texel_density"), number("covered_texels"))
    };
    let free = found("");
    assert!(free.0 > 2, "{free:?}");
    let mut last = free;
    for most in [2, 1] {
        let now = found(&format!("--bake-pages {most}"));
        assert!(now.0 <= most && now.1 < last.1, "{now:?} after {last:?}");
        // Nothing but what fits was tried: as many pages as are allowed are there.
        assert_eq!(now.0, most, "{now:?}");
        // Texels of the surface go with the square of the density, but for the rounding of small charts.
        let per_density = |(_, density, texels): (u64, f64, f64)| texels / (density * density);
        assert!((per_density(now) / per_density(free) - 1.0).abs() < 0.2, "{now:?} {free:?}");
        last = now;
    }
    // More than are needed change nothing.
    assert_eq!(found("--bake-pages 99"), free);
    // Any number of pages of any size has a result.
    let what =
        "simplify rooms.obj no.glb --triangles 1k --texture bake --bake-size 64 --bake-pages 1";
    expect(folder, what, 0);
}

/// A sheet of points with colours and no texture: the colours become one.
#[test]
fn colours_of_vertices_are_baked() {
    let folder = &scratch();
    let n = 40;
    let rows: Vec<String> = squares(n + 1, n + 1)
        .map(|(j, i)| (i, (i as f64).sin() * 0.01, j))
        .map(|(i, z, j)| format!("{i} {j} {z} {} {} 60", 5 * i, 255 - 5 * j))
        .collect();
    let columns = squares(n, n).map(|(j, i)| (i, j));
    let triangles = halves(columns, |i, j| (i * (n + 1) + j) as u32);
    let text = ply_text("uchar red, uchar green, uchar blue", rows.into_iter(), &triangles);
    std::fs::write(folder.join("points.ply"), text).unwrap();
    expect(folder, "simplify points.ply out.obj --triangles 40 --texture bake -q", 0);
    let found = colours(folder, "out");
    for ([x, y, _], colour) in &found {
        let expected = [5.0 * x, 255.0 - 5.0 * y, 60.0];
        let off = (0..3).map(|k| (colour[k] - expected[k]).abs()).fold(0.0, f64::max);
        assert!(off < 8.0, "{colour:?} for {expected:?} at {x} {y}");
    }
    // In glTF they would multiply the page, so a GLB has them there alone.
    expect(folder, "simplify points.ply out.glb --triangles 40 --texture bake -q", 0);
    let bytes = std::fs::read(folder.join("out.glb")).unwrap();
    let file = gltf::Gltf::from_slice_without_validation(&bytes).unwrap();
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    let has = |semantic| primitive.get(&semantic).is_some();
    assert!(has(gltf::Semantic::TexCoords(0)) && !has(gltf::Semantic::Colors(0)));
}

/// Photographs with eight pixels for a texel of the page: decoded in a fraction of their size, they show the same colours,
/// with any threads and memory.
#[test]
fn photographs_far_denser_than_the_pages_are_baked() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let shade = |at: u32| (30 + 200 * at / 512) as u8;
    let grain = |x: u32, y: u32| 100 + (x * y % 7) as u8;
    let photograph =
        RgbImage::from_fn(512, 512, |x, y| Rgb([shade(x), shade(511 - y), grain(x, y)]));
    photograph.save(folder.join("image.jpg")).unwrap();
    sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nKd 1 1 1\nmap_Kd image.jpg\n");
    let simplify = |to: &str, how: &str| {
        let what = "--triangles 60 --texture bake --bake-pages 1 --bake-size 64 -q";
        expect(folder, &format!("simplify sheet.obj {to}.obj {what} {how}"), 0);
        std::fs::read(folder.join(format!("{to}_textures/{to}_0.jpg"))).unwrap()
    };
    assert_eq!(simplify("one", "--threads 1 --memory 150MiB"), simplify("two", "--threads 3"));
    let is_inside =
        |([x, y, _], _): &([f64; 3], _)| [x, y].iter().all(|&at| (0.1..0.9).contains(at));
    for ([x, y, _], [red, green, blue]) in colours(folder, "one").into_iter().filter(is_inside) {
        let off = (red - 30.0 - 200.0 * x).abs().max((green - 30.0 - 200.0 * y).abs());
        assert!(off.max((blue - 103.0).abs()) < 32.0, "{red} {green} {blue} at {x} {y}");
    }
}
