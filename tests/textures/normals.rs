//! Normal maps of results: the directions of the original, in the frames that viewers have, the same bytes however it is
//! done; pictures that are nearer to the original.

use crate::bake::{files, look_up, points_of};
use crate::common::meshes::{halves, ply_text, squares};
use crate::common::{check, expect, json, scratch};
use image::{Rgb, RgbImage};
use std::path::Path;

pub(super) type Vector = [f64; 3];

/// A sheet over the unit square of `2 n^2` triangles, of height `z`, as PLY.
fn sheet(path: &Path, n: usize, z: impl Fn(f64, f64) -> f64) {
    let rows: Vec<String> = squares(n + 1, n + 1)
        .map(|(y, x)| (x as f64 / n as f64, y as f64 / n as f64))
        .map(|(x, y)| format!("{x} {y} {}", z(x, y)))
        .collect();
    let columns = squares(n, n).map(|(y, x)| (x, y));
    let triangles = halves(columns, |x, y| (x * (n + 1) + y) as u32);
    std::fs::write(path, ply_text("", rows.into_iter(), &triangles)).unwrap();
}

/// A corner of a result in OBJ: position, texture coordinates, normal.
pub(super) type Corner = (Vector, [f64; 2], Vector);

/// Faces of an OBJ with coordinates and normals, and the normal map of its only material.
pub(super) fn read(folder: &Path, name: &str) -> (Vec<[Corner; 3]>, RgbImage) {
    let (mut points, mut uvs, mut normals, mut faces) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for line in std::fs::read_to_string(folder.join(format!("{name}.obj"))).unwrap().lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let numbers = || words[1..].iter().map(|x| x.parse().unwrap()).collect::<Vec<f64>>();
        match words.first() {
            Some(&"v") => points.push(*numbers().first_chunk::<3>().unwrap()),
            Some(&"vt") => uvs.push(*numbers().first_chunk::<2>().unwrap()),
            Some(&"vn") => normals.push(*numbers().first_chunk::<3>().unwrap()),
            Some(&"f") => faces.push([1, 2, 3].map(|k| {
                let ids: Vec<usize> = words[k].split('/').map(|id| id.parse().unwrap()).collect();
                (points[ids[0] - 1], uvs[ids[1] - 1], normals[ids[2] - 1])
            })),
            _ => {}
        }
    }
    let library = std::fs::read_to_string(folder.join(format!("{name}.mtl"))).unwrap();
    let maps: Vec<&str> = library.lines().filter_map(|line| line.strip_prefix("norm ")).collect();
    assert_eq!(maps.len(), 1, "{library}");
    (faces, image::open(folder.join(maps[0])).unwrap().into_rgb8())
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

pub(super) fn unit(a: Vector) -> Vector {
    a.map(|x| x / dot(a, a).sqrt())
}

pub(super) fn degrees_between(a: Vector, b: Vector) -> f64 {
    dot(unit(a), unit(b)).clamp(-1.0, 1.0).acos().to_degrees()
}

/// Points of all faces, with the direction that the normal map gives them: red along rising u, green along rising v, blue
/// along the normal. The axes are found from the face's coordinates here, without the program's.
pub(super) fn directions(faces: &[[Corner; 3]], map: &RgbImage) -> Vec<(Vector, Vector)> {
    let mut out = Vec::new();
    for face in faces {
        let [a, b, c] = face.map(|(at, _, _)| at);
        let [p, q, r] = face.map(|(_, uv, _)| uv);
        let (du, dv) = ([q[0] - p[0], r[0] - p[0]], [q[1] - p[1], r[1] - p[1]]);
        let area = du[0] * dv[1] - du[1] * dv[0];
        let edges = [0, 1, 2].map(|k| [b[k] - a[k], c[k] - a[k]]);
        let along_u = edges.map(|e| (e[0] * dv[1] - e[1] * dv[0]) / area);
        let along_v = edges.map(|e| (e[1] * du[0] - e[0] * du[1]) / area);
        let all = face.map(|([x, y, z], [u, v], [i, j, k])| [x, y, z, u, v, i, j, k]);
        for [x, y, z, u, v, i, j, k] in points_of(all) {
            let normal = unit([i, j, k]);
            let across = |axis: Vector| {
                let up = dot(axis, normal);
                unit([0, 1, 2].map(|k| axis[k] - up * normal[k]))
            };
            let (tangent, other) = (across(along_u), across(along_v));
            let [r, g, b] = look_up(map, [u, v]).map(|x| 2.0 * x / 255.0 - 1.0);
            let direction = [0, 1, 2].map(|k| r * tangent[k] + g * other[k] + b * normal[k]);
            out.push(([x, y, z], direction));
        }
    }
    out
}

#[test]
fn the_map_of_a_plane_is_straight() {
    let folder = &scratch();
    sheet(&folder.join("flat.ply"), 30, |x, y| 0.25 * x - 0.5 * y);
    expect(folder, "simplify flat.ply flat.obj --triangles 20 --bake-normals -q", 0);
    let (faces, map) = read(folder, "flat");
    assert!(faces.len() <= 20, "{}", faces.len());
    assert!(map.pixels().all(|pixel| *pixel == Rgb([128, 128, 255])));
    // There are no colours, so there is no image of any.
    assert_eq!(files(&folder.join("flat_textures")).len(), 1);
}

/// Waves in both directions, too fine for the triangles that are left: the map turned back by the result's own axes gives
/// the normals of the formula. Far from the origin, and with its sides the other way round, too.
#[test]
fn waves_come_back_with_their_normals() {
    let (high, k) = (0.004, 40.0);
    for (name, turned) in [("waves", 1.0), ("below", -1.0)] {
        let folder = &scratch();
        let z = |x: f64, y: f64| 3.0 + high * ((k * x).sin() + (0.7 * k * y).cos());
        // A mirrored sheet has its front below.
        sheet(&folder.join("waves.ply"), 160, |x, y| turned * z(x, y));
        if turned < 0.0 {
            let text = std::fs::read_to_string(folder.join("waves.ply")).unwrap();
            let swapped = text.lines().map(|line| match line.split(' ').collect::<Vec<_>>()[..] {
                ["3", a, b, c] if !line.contains('.') => format!("3 {a} {c} {b}\n"),
                _ => format!("{line}\n"),
            });
            std::fs::write(folder.join("waves.ply"), swapped.collect::<String>()).unwrap();
        }
        let command = format!(
            "simplify waves.ply {name}.obj --triangles 60 --bake-normals --cell-triangles 12000 --report r.json"
        );
        let said = expect(folder, &command, 0);
        assert!(said.contains("normal maps"), "{said}");
        let (faces, map) = read(folder, name);
        let mut off: Vec<f64> = Vec::new();
        for ([x, y, _], direction) in directions(&faces, &map) {
            let slopes = [high * k * (k * x).cos(), -0.7 * high * k * (0.7 * k * y).sin()];
            // Below, heights and the front are turned over, so slopes are not.
            let normal = [-slopes[0], -slopes[1], turned];
            off.push(degrees_between(direction, normal));
        }
        off.sort_by(f64::total_cmp);
        let (middle, most) = (off[off.len() / 2], off[off.len() * 98 / 100]);
        assert!(middle < 1.0 && most < 4.0, "{name}: {middle} {most} of {}", off.len());
        let report = json(folder, "r.json");
        let normals = &report["bake"]["normals"];
        assert_eq!(normals["source"], "faces");
        assert!((4.0..9.0).contains(&normals["mean_degrees"].as_f64().unwrap()), "{normals}");
    }
}

/// Normals of the input's vertices are taken where it has them.
#[test]
fn the_input_s_own_normals_count() {
    let folder = &scratch();
    sheet(&folder.join("flat.ply"), 24, |_, _| 0.0);
    let text = std::fs::read_to_string(folder.join("flat.ply")).unwrap();
    let names = "property float nx\nproperty float ny\nproperty float nz\nelement face";
    let with_normals = text.replace("element face", names).replace(" 0\n", " 0 0.6 0 0.8\n");
    // The last numbers of faces are corners.
    let faces = text.find("\n3 ").unwrap();
    let with_normals = with_normals.split("\n3 ").next().unwrap().to_owned() + &text[faces..];
    std::fs::write(folder.join("flat.ply"), with_normals).unwrap();
    expect(folder, "simplify flat.ply o.obj --triangles 30 --bake-normals -q --report r.json", 0);
    let (faces, map) = read(folder, "o");
    let worst = directions(&faces, &map)
        .into_iter()
        .map(|(_, direction)| degrees_between(direction, [0.6, 0.0, 0.8]))
        .fold(0.0, f64::max);
    assert!(worst < 1.0, "{worst}");
    assert!(
        std::fs::read_to_string(folder.join("r.json")).unwrap().contains("\"source\": \"input\"")
    );
}

/// Threads, memory and a stop change no byte, with images and without; the GLB is sound, and its tangents are.
#[test]
fn bytes_depend_on_the_question_alone() {
    let folder = &scratch();
    expect(folder, "synth rooms rooms.obj --triangles 20k", 0);
    expect(folder, "synth statue statue.ply --triangles 20k", 0);
    for (input, output) in [("rooms.obj", "o.obj"), ("statue.ply", "o.glb"), ("rooms.obj", "o.glb")]
    {
        let simplify = |to: &str, how: &str| {
            std::fs::create_dir_all(folder.join(to)).unwrap();
            let what = "--ratio 5% --cell-triangles 2000 --bake-normals --bake-size 256 -q";
            expect(folder, &format!("simplify {input} {to}/{output} {what} {how}"), 0);
        };
        simplify("one", "--threads 1 --memory 150MiB");
        simplify("two", "--threads 2 --memory 2GiB");
        simplify("stopped", "--threads 2 --until stitch");
        simplify("stopped", "--threads 3");
        let first = files(&folder.join("one"));
        assert!(output == "o.glb" || first.keys().any(|name| name.contains("_normal.png")));
        for other in ["two", "stopped"] {
            let found = files(&folder.join(other));
            assert!(first.keys().eq(found.keys()), "{:?} {:?}", first.keys(), found.keys());
            for (name, bytes) in &first {
                assert!(bytes == &found[name], "{input}: {other}/{name} differs");
            }
            std::fs::remove_dir_all(folder.join(other)).unwrap();
        }
        if output == "o.glb" {
            let json = check(folder, "one/o.glb");
            assert_eq!(json["degenerate_triangles"], 0, "{json}");
            frames_are_sound(&folder.join("one/o.glb"));
        }
        std::fs::remove_dir_all(folder.join("one")).unwrap();
    }
}

/// Every vertex has a unit normal, a unit tangent across it, and a side.
fn frames_are_sound(path: &Path) {
    // The crate does not know quantised attributes, so it reads without checking.
    let file = gltf::Gltf::from_slice_without_validation(&std::fs::read(path).unwrap()).unwrap();
    let blob = file.blob.clone().unwrap();
    let materials: Vec<_> = file.materials().collect();
    assert!(!materials.is_empty() && materials.iter().all(|m| m.normal_texture().is_some()));
    let mut n = 0;
    for primitive in file.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
        let numbers = |semantic: gltf::Semantic, width: usize| -> Vec<Vec<f64>> {
            let accessor = primitive.get(&semantic).unwrap();
            assert!(accessor.normalized());
            assert_eq!(accessor.data_type(), gltf::accessor::DataType::I16);
            let view = accessor.view().unwrap();
            let (start, stride) = (view.offset() + accessor.offset(), view.stride().unwrap());
            let number =
                |at: usize| f64::from(i16::from_le_bytes([blob[at], blob[at + 1]])) / 32767.0;
            let row = |i: usize| (0..width).map(|k| number(start + i * stride + 2 * k)).collect();
            (0..accessor.count()).map(row).collect()
        };
        let normals = numbers(gltf::Semantic::Normals, 3);
        let tangents = numbers(gltf::Semantic::Tangents, 4);
        for (normal, tangent) in normals.iter().zip(&tangents) {
            let (n3, t3) =
                ([normal[0], normal[1], normal[2]], [tangent[0], tangent[1], tangent[2]]);
            assert!((dot(n3, n3) - 1.0).abs() < 1e-3 && (dot(t3, t3) - 1.0).abs() < 1e-3);
            assert!(dot(n3, t3).abs() < 1e-2 && tangent[3].abs() == 1.0, "{n3:?} {tangent:?}");
        }
        n += normals.len();
    }
    assert!(n > 500, "{n}");
}

#[test]
fn a_picture_with_the_map_is_nearer_to_the_original() {
    let folder = &scratch();
    expect(folder, "synth statue statue.ply --triangles 100k", 0);
    let psnr = |output: &str, how: &str| {
        expect(folder, &format!("simplify statue.ply {output} --ratio 1% -q {how}"), 0);
        let command = format!(
            "measure statue.ply {output} --samples 1k --appearance --views 2 --report m.json"
        );
        expect(folder, &command, 0);
        let report = json(folder, "m.json");
        report["appearance"]["psnr"].as_f64().unwrap()
    };
    let without = psnr("plain.glb", "");
    let with = ["mapped.glb", "mapped.obj"].map(|output| psnr(output, "--bake-normals"));
    assert!(with[0] > without + 2.5, "{with:?} {without}");
    assert!((with[0] - with[1]).abs() < 0.5, "{with:?}");
}

#[test]
fn what_cannot_hold_a_map_is_refused_first() {
    let folder = &scratch();
    sheet(&folder.join("flat.ply"), 10, |_, _| 0.0);
    for (how, word) in [
        ("o.ply --ratio 5%", "PLY has no place"),
        ("o.stl --ratio 5%", "STL has no place"),
        ("o.obj --ratio 5% --texture keep", "--texture bake"),
        ("o.obj --ratio 5% --texture none", "--texture none"),
        ("o.obj --ratio 5% --normals drop", "--normals drop"),
        ("o.obj --max-error 0.1", "--max-error"),
        ("o.obj --ratio 5% --method cluster", "--bake-normals"),
        ("o.glb --ratio 5% --progressive p.sp", "--bake-normals"),
    ] {
        let said = expect(folder, &format!("simplify flat.ply {how} --bake-normals"), 2);
        assert!(said.contains(word), "{how}: {said}");
    }
    expect(folder, "synth rooms rooms.obj --triangles 5k", 0);
    let said = expect(folder, "simplify rooms.obj o.obj --ratio 50% --bake-normals", 2);
    assert!(said.contains("30 %") && said.contains("--texture bake"), "{said}");
}
