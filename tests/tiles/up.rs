//! The axis that points upwards: y in glTF and z in all others, unless `--up` says otherwise.

use crate::common::{expect, json, run, scratch};
use serde_json::Value;
use std::path::Path;

fn tileset(folder: &Path, tree: &str) -> Value {
    json(&folder.join(tree), "tileset.json")
}

/// Half sides of the box of the root, in the axes of the tileset.
fn half_sides(set: &Value) -> [f64; 3] {
    let numbers = set["root"]["boundingVolume"]["box"].as_array().unwrap();
    let number = |at: usize| numbers[at].as_f64().unwrap().abs();
    [0, 1, 2].map(|k| number(3 + k) + number(6 + k) + number(9 + k))
}

#[test]
fn a_tower_stands_whatever_its_format() {
    let folder = &scratch();
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 0 4\n0 20 0\n\
                3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 3 0\n";
    std::fs::write(folder.join("y.ply"), text).unwrap();
    expect(folder, "convert y.ply y.glb", 0);
    expect(folder, "convert y.ply z.ply --up y", 0);
    for (input, options, wanted) in [
        ("y.glb", "", [1.0, 2.0, 10.0]),
        ("z.ply", "", [1.0, 2.0, 10.0]),
        ("y.ply", "--up y", [1.0, 2.0, 10.0]),
        ("y.ply", "", [1.0, 10.0, 2.0]),
        ("y.glb", "--up z", [1.0, 10.0, 2.0]),
        ("z.ply", "--scale 3 --translate 100,0,0 --recentre", [3.0, 6.0, 30.0]),
    ] {
        let said = expect(folder, &format!("tiles {input} t {options} --force"), 0);
        assert_eq!(said.contains("as glTF has it"), input == "y.glb" && options.is_empty());
        let set = tileset(folder, "t");
        let sides = half_sides(&set);
        let is_near = sides.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.02 * b);
        assert!(is_near, "{input} {options}: {sides:?}");
        let offset = set["extras"]["stonecut"].get("offset");
        assert_eq!(offset.is_some(), options.contains("--recentre"), "{set}");
        expect(folder, "info t --check", 0);
    }
}

/// The middle of the box of the root in the world.
fn middle(set: &Value) -> [f64; 3] {
    let number = |list: &Value, at: usize| list[at].as_f64().unwrap();
    let (map, low) = (&set["root"]["transform"], &set["root"]["boundingVolume"]["box"]);
    [0, 1, 2].map(|r| {
        (0..3).map(|c| number(map, 4 * c + r) * number(low, c)).sum::<f64>() + number(map, 12 + r)
    })
}

#[test]
fn a_shift_comes_after_the_turn_upwards() {
    let folder = &scratch();
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 0 4\n0 20 0\n\
                3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 0 3\n";
    std::fs::write(folder.join("y.ply"), text).unwrap();
    expect(folder, "convert y.ply y.glb", 0);
    expect(folder, "convert y.ply z.ply --up y", 0);
    for (input, shift, wanted) in [
        ("z.ply", "", [1.0, -2.0, 10.0]),
        ("z.ply", "--translate 30,40,50", [31.0, 38.0, 60.0]),
        ("y.glb", "--translate 30,40,50", [31.0, 38.0, 60.0]),
        ("y.ply --up y", "--translate 30,40,50 --scale 2", [32.0, 36.0, 70.0]),
        ("y.glb --up y", "--translate 30,40,50 --scale 2", [32.0, 36.0, 70.0]),
        ("y.glb --up z", "--translate 30,40,50", [31.0, 50.0, 52.0]),
    ] {
        let (file, up) = input.split_once(' ').unwrap_or((input, ""));
        expect(folder, &format!("tiles {file} t {up} {shift} --force --report r.json"), 0);
        let found = middle(&tileset(folder, "t"));
        let is_near = (0..3).all(|k| (found[k] - wanted[k]).abs() < 0.02);
        assert!(is_near, "{input} {shift}: {found:?}");
        let placing = &json(folder, "r.json")["settings"]["placing"];
        assert_eq!(placing.is_null(), shift.is_empty(), "{placing}");
        // What comes out of the tree lies where the mesh was put, in its own axes.
        expect(folder, "extract t back.ply --max-error 0 --force", 0);
    }
}

#[test]
fn what_comes_through_a_pipe_or_packed_stands_too() {
    let folder = &scratch();
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 0 4\n0 20 0\n\
                3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 3 0\n";
    std::fs::write(folder.join("y.ply"), text).unwrap();
    expect(folder, "convert y.ply y.glb", 0);
    for (file, wanted) in [("y.glb", [1.0, 2.0, 10.0]), ("y.ply", [1.0, 10.0, 2.0])] {
        let input = std::fs::File::open(folder.join(file)).unwrap();
        let mut command = crate::common::stonecut();
        command.current_dir(folder).args(["tiles", "-", "t", "--force", "-q"]).stdin(input);
        assert!(command.status().unwrap().success());
        let sides = half_sides(&tileset(folder, "t"));
        assert!(
            sides.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.02 * b),
            "{file}: {sides:?}"
        );
    }
}

/// The place of a point of the mesh on the earth, by the tree.
fn on_earth(set: &Value, p: [f64; 3]) -> [f64; 3] {
    let number = |list: &Value, at: usize| list[at].as_f64().unwrap();
    let (map, origin) = (&set["root"]["transform"], &set["extras"]["stonecut"]["origin"]);
    let p = [0, 1, 2].map(|k| p[k] - number(origin, k));
    [0, 1, 2]
        .map(|r| (0..3).map(|c| number(map, 4 * c + r) * p[c]).sum::<f64>() + number(map, 12 + r))
}

#[test]
fn a_coordinate_reference_system_puts_a_tree_on_the_earth() {
    let folder = &scratch();
    let mesh = |[x, y, z]: [f64; 3]| {
        let corner = |a: f64, b: f64, c: f64| format!("{} {} {}\n", x + a, y + b, z + c);
        let corners = [
            corner(0.0, 0.0, 0.0),
            corner(2.0, 0.0, 0.0),
            corner(0.0, 4.0, 0.0),
            corner(0.0, 0.0, 4.0),
        ];
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
             element face 4\nproperty list uchar int vertex_indices\nend_header\n{}3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n",
            corners.concat()
        )
    };
    let xml = "<ModelMetadata><SRS>EPSG:32633</SRS><SRSOrigin>500400,4600200,100</SRSOrigin></ModelMetadata>";
    for inner in ["far", "near", "near/tiles"] {
        std::fs::create_dir(folder.join(inner)).unwrap();
    }
    let utm = [500_400.0, 4_600_200.0, 100.0];
    std::fs::write(folder.join("far/utm.ply"), mesh(utm)).unwrap();
    std::fs::write(folder.join("near/tiles/local.ply"), mesh([0.0; 3])).unwrap();
    std::fs::write(folder.join("near/metadata.xml"), xml).unwrap();
    // 500401 4600202 102 by PROJ 9.5.1.
    let wanted = [4_617_133.909, 1_237_572.620_8, 4_208_686.982_9];
    for (words, from) in [
        ("far/utm.ply t --crs EPSG:32633", utm),
        ("far/utm.ply t --crs 32633 --recentre", [1.0, 2.0, 2.0]),
        ("near/tiles/local.ply t", [0.0; 3]),
        ("near/tiles/local.ply t --crs EPSG:32633", [0.0; 3]),
    ] {
        let said = expect(folder, &format!("tiles {words} --force"), 0);
        assert_eq!(said.contains("metadata.xml"), words.contains("local"), "{words}: {said}");
        let set = tileset(folder, "t");
        let offset = &set["extras"]["stonecut"]["offset"];
        let subtracted = [0, 1, 2].map(|k| offset[k].as_f64().unwrap_or(0.0));
        let p = [500_401.0, 4_600_202.0, 102.0];
        let base = if from == [0.0; 3] { utm } else { subtracted };
        let found = on_earth(&set, [0, 1, 2].map(|k| p[k] - base[k]));
        assert!((0..3).all(|k| (found[k] - wanted[k]).abs() < 1e-3), "{words}: {found:?}");
    }
    expect(folder, "tiles near/tiles/local.ply t --force --crs none", 0);
    let plain = on_earth(&tileset(folder, "t"), [1.0, 2.0, 2.0]);
    assert!((0..3).all(|k| (plain[k] - [1.0, 2.0, 2.0][k]).abs() < 1e-9), "{plain:?}");
    let info = run(folder, "info near/tiles/local.ply").stdout;
    assert!(String::from_utf8(info).unwrap().contains("EPSG:32633"));
    let said = expect(folder, "tiles far/utm.ply t --force --crs EPSG:5514", 2);
    assert!(said.contains("krovak"), "{said}");
    // Heights above the sea are named, those in feet are feet, depths are refused.
    let said =
        expect(folder, "tiles far/utm.ply t --force --crs EPSG:32633+5773 --report r.json", 0);
    assert!(said.contains("above the ellipsoid") && said.contains("--translate 0,0,N"), "{said}");
    assert_eq!(json(folder, "r.json")["settings"]["crs"], "EPSG:32633+5773");
    let said = expect(folder, "tiles far/utm.ply t --force --crs EPSG:32633+5715", 2);
    assert!(said.contains("EPSG:5715 is not a system of heights"), "{said}");
    let feet = [980_000.0, 200_000.0, 10.0];
    std::fs::write(folder.join("far/feet.ply"), mesh(feet)).unwrap();
    for (code, foot, said_of_it) in [
        ("EPSG:2263+6360", 1200.0 / 3937.0, "above the ellipsoid"),
        ("EPSG:2263", 1.0, "taken as metres"),
    ] {
        let said = expect(folder, &format!("tiles far/feet.ply t --force --crs {code}"), 0);
        assert!(said.contains(said_of_it), "{said}");
        let set = tileset(folder, "t");
        let [low, high] = [0.0, 1000.0].map(|z| on_earth(&set, [feet[0], feet[1], feet[2] + z]));
        let height = (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt();
        assert!((height - 1000.0 * foot).abs() < 1e-3, "{code}: {height}");
    }
    // A system of heights that a file beside names is one, too.
    std::fs::write(folder.join("near/metadata.xml"), xml.replace("32633", "32633+5773")).unwrap();
    let said = expect(folder, "tiles near/tiles/local.ply t --force", 0);
    assert!(said.contains("above the ellipsoid"), "{said}");
    std::fs::write(folder.join("near/metadata.xml"), xml.replace("32633", "32633+5715")).unwrap();
    let said = expect(folder, "tiles near/tiles/local.ply t --force", 0);
    assert!(said.contains("place     not used: EPSG:5715"), "{said}");
}

/// An offset that is not understood leaves the place unknown: the middle of the map is not taken for it.
#[test]
fn an_offset_that_is_not_understood_is_named() {
    let folder = &scratch();
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 0 4\n3 0 1 2\n";
    std::fs::write(folder.join("m.ply"), text).unwrap();
    std::fs::write(folder.join("m.prj"), "EPSG:25832").unwrap();
    std::fs::write(folder.join("m_offset.xyz"), "412000,5 5621000 50\n").unwrap();
    for command in ["info m.ply", "convert m.ply o.ply", "tiles m.ply t"] {
        let said = run(folder, command);
        let said = [said.stdout, said.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
        assert!(said.contains("m_offset.xyz is not understood"), "{command}: {said}");
        assert!(!said.contains("EPSG:25832"), "{command}: {said}");
    }
    std::fs::write(folder.join("m_offset.xyz"), "# metres\n412000.5 5621000 50\n").unwrap();
    let said = expect(folder, "tiles m.ply t --force", 0);
    assert!(said.contains("EPSG:25832, offset 412000.5 5621000 50"), "{said}");
}

/// Degrees and metres of one length would leave a line of the terrain.
#[test]
fn a_terrain_in_degrees_stands_on_the_earth_in_metres() {
    let folder = &scratch();
    let n = 10;
    let at = |k: usize| 1e-3 * (k as f64 / n as f64 - 0.5);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    );
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        text += &format!("{} {} {}\n", 9.0 + at(j), 47.0 + at(i), 450 + 5 * ((7 * i + 3 * j) % 10));
    }
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let a = i * (n + 1) + j;
        let b = a + n + 1;
        text += &format!("3 {a} {} {}\n3 {a} {} {b}\n", a + 1, b + 1, b + 1);
    }
    std::fs::write(folder.join("deg.ply"), &text).unwrap();
    expect(folder, "convert deg.ply y.glb --up z --format float", 0);
    expect(folder, "convert deg.ply named.ply", 0);
    std::fs::write(folder.join("named.prj"), "GEOGCS[\"WGS 84\",AUTHORITY[\"EPSG\",\"4326\"]]")
        .unwrap();
    // Of pyproj 3.7.2: the place itself, and half a thousandth of a degree along each axis, 472.5 m up.
    let centre = [4_304_355.6, 681_743.0, 4_642_110.4];
    let half = [38.031, 55.589, 22.5];
    for (input, options) in [
        ("deg.ply", "--crs EPSG:4326"),
        ("deg.ply", "--crs EPSG:4326 --recentre"),
        ("named.ply", ""),
        ("y.glb", "--crs EPSG:4326"),
    ] {
        let said = expect(folder, &format!("tiles {input} t {options} --force"), 0);
        assert!(said.contains("degrees of EPSG:4326 become metres east and north"), "{said}");
        let set = tileset(folder, "t");
        let (sides, found) = (half_sides(&set), middle(&set));
        // Floats have steps of degrees.
        let most = if input == "y.glb" { 0.3 } else { 0.02 };
        for k in 0..3 {
            assert!((sides[k] - half[k]).abs() < most, "{input}: {sides:?}");
            assert!((found[k] - centre[k]).abs() < 10.0 * most + 0.2, "{input}: {found:?}");
        }
        expect(folder, "extract t x.ply --max-error 1 --force", 0);
    }
    // Not on the earth, they stay, and no tree is whole then.
    for (command, code) in [
        ("tiles deg.ply t --force", 3),
        ("tiles deg.ply t --crs EPSG:32632 --force", 3),
        ("tiles named.ply t --crs none --force", 3),
        ("simplify deg.ply x.ply --ratio 50% --force", 0),
        ("simplify named.ply x.ply --ratio 50% --force", 0),
    ] {
        let said = expect(folder, command, code);
        assert!(said.contains("degrees") && said.contains("--transform 7606"), "{said}");
    }
    let said = expect(folder, "convert deg.ply x.glb", 3);
    assert!(said.contains("100 % of the triangles are thinner: they lose their shape"), "{said}");
    let said = expect(folder, "tiles deg.ply t --crs EPSG:4326 --translate 0,50,0 --force", 4);
    assert!(said.contains("outside of this system, which has degrees"), "{said}");
    // Metres of one's own are no longer degrees.
    let matrix = "76000,0,0,0,0,111000,0,0,0,0,1,0,0,0,0,1";
    let said = expect(folder, &format!("convert named.ply m.ply --transform {matrix}"), 0);
    assert!(said.contains("no longer degrees of EPSG:4326"), "{said}");
    expect(folder, "tiles m.ply t --force", 0);
}
