//! Placing of an input before all else: `--up`, `--scale`, `--translate`, `--transform`, `--recentre`.

use crate::common::meshes::ply_text;
use crate::common::{expect, glb_json, json, printed, rms, run, scratch};
use std::path::Path;

/// A tower of a quadrilateral and a triangle, 10 high along y, with normals along x, at `shift`.
fn tower(folder: &Path, kind: &str, shift: [f64; 3]) {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 5\nproperty {kind} x\nproperty {kind} y\n\
         property {kind} z\nproperty float nx\nproperty float ny\nproperty float nz\nelement face 2\n\
         property list uchar int vertex_indices\nend_header\n"
    );
    for p in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 8.0, 0.0], [0.0, 8.0, 0.0], [0.5, 10.0, 2.0]]
    {
        let [x, y, z] = [0, 1, 2].map(|k| p[k] + shift[k]);
        text += &format!("{x} {y} {z} 1 0 0\n");
    }
    std::fs::write(folder.join("in.ply"), text + "4 0 1 2 3\n3 3 2 4\n").unwrap();
}

/// Lines before and behind the end of the header of a mesh, as it is converted to ASCII PLY.
fn shown(folder: &Path, file: &str) -> (String, Vec<Vec<f64>>) {
    let arguments = format!(
        "convert {file} shown.ply --format ascii --force --keep-duplicates --keep-unreferenced"
    );
    expect(folder, &arguments, 0);
    let text = std::fs::read_to_string(folder.join("shown.ply")).unwrap();
    let (head, body) = text.split_once("end_header\n").unwrap();
    let row = |line: &str| line.split(' ').map(|word| word.parse().unwrap()).collect();
    (head.to_owned(), body.lines().map(row).collect())
}

fn near(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3)
}

/// Sides of the bounding box of the first five rows.
fn sides(rows: &[Vec<f64>]) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let column = rows[..5].iter().map(|row| row[k]);
        column.clone().fold(f64::MIN, f64::max) - column.fold(f64::MAX, f64::min)
    })
}

#[test]
fn the_axis_that_points_upwards_is_that_of_the_output() {
    let folder = &scratch();
    tower(folder, "float", [0.0; 3]);
    for (options, output, wanted) in [
        ("", "out.ply", [1.0, 10.0, 2.0]),
        ("--up y", "out.ply", [1.0, 2.0, 10.0]),
        ("--up y", "out.obj", [1.0, 2.0, 10.0]),
        ("--up z", "out.ply", [1.0, 10.0, 2.0]),
        ("--up y", "out.glb", [1.0, 10.0, 2.0]),
        ("--up z", "out.glb", [1.0, 2.0, 10.0]),
    ] {
        expect(folder, &format!("convert in.ply {output} --force {options}"), 0);
        let (_, rows) = shown(folder, output);
        assert!(near(&sides(&rows), &wanted), "{options} {output} {:?}", sides(&rows));
    }
    expect(folder, "convert in.ply out.ply --force --up y", 0);
    let (_, rows) = shown(folder, "out.ply");
    assert_eq!(rows[4], [0.5, -2.0, 10.0, 1.0, 0.0, 0.0]);
}

#[test]
fn a_mirror_turns_faces_and_normals_around() {
    let folder = &scratch();
    tower(folder, "float", [0.0; 3]);
    let mirror = "--scale 2 --transform -1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1 --translate 0,0,-3";
    expect(folder, &format!("convert in.ply out.ply {mirror}"), 0);
    let (head, rows) = shown(folder, "out.ply");
    assert!(head.contains("property float x"), "{head}");
    assert_eq!(rows[2], [-2.0, 16.0, -3.0, -1.0, 0.0, 0.0]);
    // Seen from above all three triangles still go around in one sense: their corners were turned around.
    let area = |face: &[f64]| {
        let [a, b, c] = [1, 2, 3].map(|k| &rows[face[k] as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    let areas: Vec<f64> = rows[5..].iter().map(|face| area(face)).collect();
    assert_eq!(areas.len(), 3);
    assert!(areas.iter().all(|&area| area > 0.0), "{areas:?}");
}

#[test]
fn an_offset_is_subtracted_and_written_down() {
    let folder = &scratch();
    tower(folder, "double", [500_000.25, 4_600_000.5, 100.0]);
    let wanted = "offset: 500000 4600010 100 ";
    let said = expect(folder, "convert in.ply out.stl --recentre", 0);
    assert!(said.contains("500000 4600010 100 was subtracted"), "{said}");
    let stl = std::fs::read(folder.join("out.stl")).unwrap();
    let corners = stl[84..].chunks_exact(50).flat_map(|facet| facet[12..48].as_chunks::<4>().0);
    assert!(corners.map(|x| f32::from_le_bytes(*x).abs()).all(|x| x < 12.0));
    expect(folder, "convert in.ply out.ply --recentre", 0);
    let (head, rows) = shown(folder, "out.ply");
    assert!(head.contains(&format!("comment {wanted}")), "{head}");
    assert!(near(&rows[4][..3], &[0.75, 0.5, 2.0]), "{:?}", rows[4]);
    assert!(rms(folder, "in.ply", "out.ply") < 1e-9);
    // Once more: one comment with the sum, and the same place.
    expect(folder, "convert out.ply again.ply --translate 30,0,0 --recentre", 0);
    let (head, _) = shown(folder, "again.ply");
    assert!(head.matches("offset: ").count() == 1 && !head.contains(wanted), "{head}");
    expect(folder, "convert in.ply out.obj --recentre", 0);
    let text = std::fs::read_to_string(folder.join("out.obj")).unwrap();
    assert!(text.contains(&format!("# {wanted}")), "{text}");
    expect(folder, "convert in.ply out.glb --recentre", 0);
    let document = glb_json(&folder.join("out.glb"));
    assert_eq!(
        document["nodes"][0]["extras"]["offset"],
        serde_json::json!([500_000.0, 4_600_010.0, 100.0])
    );
    // It stays with the mesh through every format.
    for file in ["out.stl", "out.obj", "out.glb"] {
        let (head, _) = shown(folder, file);
        assert!(head.contains("offset: 500000 4600010 100"), "{file}: {head}");
    }
    expect(folder, "convert in.ply text.stl --recentre --format ascii", 0);
    let text = std::fs::read_to_string(folder.join("text.stl")).unwrap();
    assert!(text.starts_with("solid offset: 500000 4600010 100\n"), "{text}");
    expect(folder, "simplify in.ply small.ply --triangles 2 --recentre --report r.json -q", 0);
    let report = json(folder, "r.json");
    assert_eq!(report["input"]["offset"], serde_json::json!([500_000.0, 4_600_010.0, 100.0]));
    assert_eq!(report["input"]["bounds"][0], serde_json::json!([0.25, -9.5, 0.0]));
    let (head, _) = shown(folder, "small.ply");
    assert!(head.contains(&format!("comment {wanted}")), "{head}");
}

/// The notes of `info` on the place of a mesh.
fn place_of(folder: &Path, file: &str) -> String {
    let found = printed(folder, &format!("info --json {file}"));
    let notes = found["notes"].as_array().unwrap().iter().filter_map(|note| note.as_str());
    let notes: Vec<&str> = notes.filter(|note| note.starts_with("lies at")).collect();
    notes.join("; ")
}

/// Files of other programs beside a mesh say where it lies; results say it themselves, in every format.
#[test]
fn a_place_that_files_beside_name_is_carried() {
    let folder = &scratch();
    tower(folder, "float", [0.0; 3]);
    let xml = "<ModelMetadata><SRS>EPSG:32633</SRS><SRSOrigin>500400,4600200,100</SRSOrigin></ModelMetadata>";
    std::fs::create_dir(folder.join("map")).unwrap();
    expect(folder, "convert in.ply map/tile.obj --translate 500400,4600200,100", 0);
    std::fs::write(folder.join("metadata.xml"), xml).unwrap();
    let lies_at = |file: &str| place_of(folder, file);
    let whole = "lies at EPSG:32633, offset 500400 4600200 100";
    assert_eq!(lies_at("in.ply"), format!("{whole} (metadata.xml)"));
    for command in [
        "convert in.ply out.ply",
        "convert in.ply out.obj",
        "convert in.ply out.glb",
        "convert in.ply out.stl",
        "convert in.ply text.stl --format ascii",
        "simplify in.ply small.ply --triangles 2",
        "simplify in.ply grid.glb --method cluster --grid 1",
    ] {
        let said = expect(folder, command, 0);
        assert!(said.contains("metadata.xml"), "{command}: {said}");
        // The file beside it counts once.
        assert_eq!(lies_at(command.split(' ').nth(2).unwrap()), whole, "{command}");
    }
    let text = std::fs::read(folder.join("out.ply")).unwrap();
    let text = String::from_utf8_lossy(&text);
    assert!(text.contains("comment crs EPSG:32633\ncomment offset: 500400 4600200 100 "), "{text}");
    let said = expect(folder, "tiles in.ply web", 0);
    assert!(said.contains("metadata.xml"), "{said}");
    expect(folder, "extract web back.ply --max-error 0", 0);
    assert_eq!(lies_at("back.ply"), whole);
    // With what --recentre subtracts, scaled and turned with the mesh, and again from a file that has it.
    for (words, wanted) in [
        ("in.ply --translate 7000,0,0 --recentre", "507400 4600210 100"),
        ("out.glb --translate 7000,0,0 --recentre", "507400 4600210 100"),
        ("in.ply --scale 2", "1000800 9200400 200"),
        ("out.stl --up y", "500400 -100 4600200"),
    ] {
        let (input, options) = words.split_once(' ').unwrap();
        expect(folder, &format!("convert {input} moved.ply --force {options}"), 0);
        assert_eq!(lies_at("moved.ply"), format!("lies at EPSG:32633, offset {wanted}"), "{words}");
    }
    // A mesh whose coordinates are those of the map already is not moved.
    std::fs::copy(folder.join("metadata.xml"), folder.join("map/metadata.xml")).unwrap();
    assert_eq!(lies_at("map/tile.obj"), "lies at EPSG:32633, offset 0 0 0 (metadata.xml)");
    // glTF has y upwards, maps have z.
    std::fs::create_dir(folder.join("up")).unwrap();
    std::fs::rename(folder.join("metadata.xml"), folder.join("up/metadata.xml")).unwrap();
    expect(folder, "convert in.ply up/tile.glb --up z", 0);
    let said = expect(folder, "convert up/tile.glb turned.ply --up y", 0);
    assert!(!said.contains("axes stay"), "{said}");
    assert_eq!(lies_at("turned.ply"), whole);
    let said = expect(folder, "convert up/tile.glb as_it_is.ply", 0);
    assert!(said.contains("axes stay as they are, y upwards, where z should be"), "{said}");
    // A place that is not understood is none, and named.
    for broken in [xml.replace("100", "nan"), xml.replace(",100", ""), xml[..60].to_owned()] {
        std::fs::write(folder.join("metadata.xml"), &broken).unwrap();
        let said = expect(folder, "convert in.ply out.ply --force", 0);
        assert!(said.contains("is not understood"), "{broken}: {said}");
        let out = std::fs::read(folder.join("out.ply")).unwrap();
        assert!(!String::from_utf8_lossy(&out).contains("offset: "), "{broken}");
    }
}

#[test]
fn a_place_in_comments_of_other_programs_is_read() {
    let folder = &scratch();
    tower(folder, "float", [0.0; 3]);
    let plain = std::fs::read_to_string(folder.join("in.ply")).unwrap();
    for (comments, wanted) in [
        ("epsg 32650|offsetx 100.5|offsety 2000|offsetz 10", "EPSG:32650, offset 100.5 2000 10"),
        ("CRS: EPSG:28992 (Amersfoort / RD New)", "EPSG:28992, offset 0 0 0"),
        (r#"crs PROJCS["x",AUTHORITY["EPSG","25832"]]"#, "EPSG:25832, offset 0 0 0"),
    ] {
        let lines = format!("comment {}\nelement vertex", comments.replace('|', "\ncomment "));
        std::fs::write(folder.join("other.ply"), plain.replace("element vertex", &lines)).unwrap();
        assert_eq!(place_of(folder, "other.ply"), format!("lies at {wanted}"), "{comments}");
    }
}

#[test]
fn what_was_placed_belongs_to_a_job() {
    let folder = &scratch();
    tower(folder, "float", [0.0; 3]);
    expect(folder, "simplify in.ply out.ply --triangles 2 --scale 3 --until partition -q", 0);
    let output = run(folder, "simplify in.ply out.ply --triangles 2 --scale 4 -q");
    assert!(!output.status.success(), "another scale is another job");
    expect(folder, "simplify in.ply out.ply --triangles 3 --scale 3 --restart -q --verify", 0);
    let (_, rows) = shown(folder, "out.ply");
    assert!(near(&sides(&rows), &[3.0, 30.0, 6.0]), "{rows:?}");
    for wrong in [
        "--scale 0",
        "--scale inf",
        "--translate 1,2",
        "--transform 1,0,0,0,0,1,0,0,0,0,0,0,0,0,0,1",
    ] {
        expect(folder, &format!("convert in.ply no.ply {wrong}"), 2);
    }
}

/// Boxes along the axes from the origin: x red and 4 long, y green and 2, z blue and 6; y stretched.
fn axes(stretch: f64) -> String {
    let mut rows = Vec::new();
    let mut triangles = Vec::new();
    for (axis, length) in [4.0, 2.0 * stretch, 6.0].into_iter().enumerate() {
        let first = rows.len() as u32;
        for i in 0..8 {
            let side = |k: usize| match (i >> k & 1, k == axis) {
                (0, _) => -0.3,
                (_, true) => length,
                (_, false) => 0.3,
            };
            let colour = [0, 1, 2].map(|k| if k == axis { 255 } else { 0 });
            let [r, g, b] = colour;
            rows.push(format!("{} {} {} {r} {g} {b}", side(0), side(1), side(2)));
        }
        let faces =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in faces {
            triangles.extend([[a, b, c], [a, c, d]].map(|t: [u32; 3]| t.map(|v| first + v)));
        }
    }
    let colours = "uchar red, uchar green, uchar blue";
    ply_text(colours, rows.into_iter(), &triangles)
}

#[test]
fn a_named_side_is_the_same_in_any_format_and_shape() {
    let at = &scratch();
    std::fs::write(at.join("axes.ply"), axes(1.0)).unwrap();
    std::fs::write(at.join("long.ply"), axes(4.0)).unwrap();
    expect(at, "convert axes.ply axes.glb --up z", 0);
    let picture = |file: &str, view: &str| {
        let options = "--color vertex --unlit --size 60x60 --force";
        expect(at, &format!("render {file} -o p.png --view {view} {options}"), 0);
        image::open(at.join("p.png")).unwrap().to_rgb8()
    };
    for view in ["front", "back", "left", "right", "top", "bottom"] {
        let [a, b] = ["axes.ply", "axes.glb"].map(|file| picture(file, view));
        let differs =
            |p: &image::Rgb<u8>, q: &image::Rgb<u8>| (0..3).any(|k| p.0[k].abs_diff(q.0[k]) > 60);
        let n = a.pixels().zip(b.pixels()).filter(|(p, q)| differs(p, q)).count();
        assert!(n < 90, "{view}: {n} of 3600 pixels differ");
    }
    // From the front, z stands upright and y points away, however long it is.
    for file in ["axes.ply", "long.ply"] {
        let front = picture(file, "front");
        let is_blue = |p: &image::Rgb<u8>| p.0[2] > 150 && p.0[0] < 90 && p.0[1] < 90;
        let blue: Vec<(u32, u32)> = front
            .enumerate_pixels()
            .filter(|(_, _, p)| is_blue(p))
            .map(|(x, y, _)| (x, y))
            .collect();
        let span = |k: fn(&(u32, u32)) -> u32| {
            blue.iter().map(k).max().unwrap() - blue.iter().map(k).min().unwrap()
        };
        assert!(span(|p| p.1) > 3 * span(|p| p.0), "{file}: {blue:?}");
    }
}
