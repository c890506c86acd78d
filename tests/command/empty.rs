//! An empty result is never a success, advice that is given works, and what is typed is read strictly.

use crate::common::{expect, run, scratch};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// A sheet of n x n squares in double precision, ASCII; `change` may rewrite its vertices and faces.
fn sheet(n: usize, change: impl Fn(&mut Vec<String>, &mut Vec<String>)) -> String {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for y in 0..=n {
        for x in 0..=n {
            vertices.push(format!("{x} {y} {}", (x * y) as f64 * 0.01));
        }
    }
    for y in 0..n {
        for x in 0..n {
            let v = y * (n + 1) + x;
            faces.push(format!("3 {v} {} {}", v + 1, v + n + 2));
            faces.push(format!("3 {v} {} {}", v + n + 2, v + n + 1));
        }
    }
    change(&mut vertices, &mut faces);
    let mut text = String::from("ply\nformat ascii 1.0\n");
    let _ = write!(
        text,
        "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    );
    text + &vertices.join("\n") + "\n" + &faces.join("\n") + "\n"
}

#[test]
fn an_empty_result_is_never_a_success() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    let flat = sheet(20, |_, faces| faces.iter_mut().for_each(|face| *face = "3 7 7 9".to_owned()));
    std::fs::write(at.join("degenerate.ply"), flat).unwrap();
    let before = names(at);
    for (arguments, codes, word) in [
        ("simplify in.ply o.ply --triangles 0", &[2][..], "at least 1"),
        ("simplify in.ply o.ply --ratio 0.001%", &[2], "--ratio 0.001 % of"),
        ("simplify in.ply o.ply --ratio 0.0001%", &[2], "at least --triangles 1"),
        ("simplify degenerate.ply o.ply --ratio 50%", &[4], "degenerate"),
        ("simplify degenerate.ply o.ply --max-error 1", &[4], "degenerate"),
        ("convert degenerate.ply o.stl", &[4], "nothing was written"),
    ] {
        let output = run(at, arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(codes.contains(&output.status.code().unwrap()), "{arguments}: {output:?}");
        assert!(said.contains(word), "{arguments}: {said}");
        assert_eq!(names(at), before, "{arguments}");
    }
    // Few triangles are something, or an error: never a file without any.
    for n in 1..=4 {
        let output = run(at, &format!("simplify in.ply o.ply --triangles {n} --restart --force"));
        let has_output = at.join("o.ply").exists();
        match output.status.code() {
            Some(0 | 3) if has_output => {
                assert!(
                    crate::common::count(&crate::common::check(at, "o.ply"), "triangles") > 0,
                    "{n}"
                );
            }
            code => assert!(code == Some(3) && !has_output, "{n}: {output:?}"),
        }
    }
}

/// Triangles with three corners each, all on one line, and from `with_area` of them on with an area.
fn needles(n: usize, with_area: usize, direction: [f64; 3]) -> String {
    let along = |t: f64| direction.map(|d| (100.0 + d * t) as f32);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {n}\nproperty list uchar int vertex_indices\nend_header\n",
        3 * n
    );
    for i in 0..n {
        for (corner, t) in [0.0, 1.0, 2.5].into_iter().enumerate() {
            let [x, y, z] = along(3.0 * i as f64 + t);
            let up = if i < with_area && corner == 1 { 1e-3 } else { 0.0 };
            let _ = writeln!(text, "{x} {y} {}", z + up);
        }
    }
    for i in 0..n {
        let _ = writeln!(text, "3 {} {} {}", 3 * i, 3 * i + 1, 3 * i + 2);
    }
    text
}

/// Corners on a line are three, and still no surface: neither as input nor as result.
#[test]
fn a_flat_result_is_never_a_success() {
    let at = &scratch();
    // On an axis, exactly on a line, and on a line but for rounding; alone, and one small triangle among them.
    for direction in [[1.0, 0.0, 0.0], [1.0, 2.0, -3.0], [0.1, 0.7, 0.3]] {
        std::fs::write(at.join("flat.ply"), needles(3000, 0, direction)).unwrap();
        std::fs::write(at.join("hardly.ply"), needles(3000, 1, direction)).unwrap();
        let before = names(at);
        for options in [
            "--ratio 50%",
            "--ratio 100%",
            "--ratio 1% --cell-triangles 1000",
            "--ratio 50% --cell-triangles 1000",
            "--max-error 1",
            "--ratio 50% --min-component 1",
        ] {
            let said = expect(at, &format!("simplify flat.ply o.ply {options}"), 4);
            assert!(said.contains("have no area"), "{options}: {said}");
            assert_eq!(names(at), before, "{options}");
        }
        for options in ["--triangles 1", "--triangles 10 --cell-triangles 1000", "--ratio 50%"] {
            let output = run(at, &format!("simplify hardly.ply o.ply {options}"));
            let said = String::from_utf8_lossy(&output.stderr);
            match output.status.code() {
                Some(0 | 3) if at.join("o.ply").exists() => {
                    // What is left has an area: it can be measured.
                    expect(at, "measure o.ply o.ply", 0);
                    std::fs::remove_file(at.join("o.ply")).unwrap();
                }
                code => {
                    assert_eq!(code, Some(3), "{options}: {said}");
                    assert!(said.contains("nothing was written"), "{options}: {said}");
                }
            }
            assert_eq!(names(at), before, "{options}");
        }
    }
}

/// Broken inputs of every kind: the first run names the fault, leaves nothing, and both remedies work.
#[test]
fn the_advice_for_broken_inputs_works() {
    type Change = fn(&mut Vec<String>, &mut Vec<String>);
    let faults: [(&str, Change); 6] = [
        ("nan", |vertices, _| vertices[30] = "nan 1 2".to_owned()),
        ("infinity", |vertices, _| vertices[30] = "1 inf 2".to_owned()),
        ("huge", |vertices, _| vertices[30] = "1 2 1e300".to_owned()),
        ("negative", |_, faces| faces[40] = "3 1 -2 3".to_owned()),
        ("beyond", |_, faces| faces[40] = "3 1 2 99999999".to_owned()),
        ("last", |_, faces| *faces.last_mut().unwrap() = "3 1 2 441".to_owned()),
    ];
    for (name, change) in faults {
        let at = &scratch();
        std::fs::write(at.join("in.ply"), sheet(20, change)).unwrap();
        let before = names(at);
        let command = "simplify in.ply o.ply --ratio 50% -q";
        let output = run(at, command);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        if name == "huge" && output.status.code() == Some(0) {
            continue;
        }
        assert_eq!(output.status.code(), Some(4), "{name}: {said}");
        assert!(said.contains("--skip-bad"), "{name}: {said}");
        assert_eq!(names(at), before, "{name}: {said}");
        let output = run(at, &format!("{command} --skip-bad"));
        assert!(matches!(output.status.code(), Some(0 | 3)), "{name}: {output:?}");
        assert!(at.join("o.ply").exists(), "{name}");
        std::fs::remove_file(at.join("o.ply")).unwrap();
        expect(at, command, 4);
        std::fs::write(at.join("in.ply"), sheet(20, |_, _| {})).unwrap();
        expect(at, command, 0);
        // The same for a bound on the error, which runs several jobs in one.
        std::fs::remove_file(at.join("o.ply")).unwrap();
        std::fs::write(at.join("in.ply"), sheet(20, change)).unwrap();
        expect(at, "simplify in.ply o.ply --max-error 0.1 -q", 4);
        assert_eq!(names(at), before, "{name}: --max-error");
    }
}

#[test]
fn what_is_typed_is_read_strictly() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 2000 --color", 0);
    let before = names(at);
    for arguments in [
        "simplify in.ply o.ply --triangles 1.5",
        "simplify in.ply o.ply --triangles 0.5",
        "simplify in.ply o.ply --ratio 50% --label nosuch",
        "simplify in.ply o.ply --ratio 50% --memory 1.5",
        "synth terrain o.ply --triangles 3.7",
        "measure in.ply in.ply --samples 1.5",
        "measure in.ply in.ply --cell-triangles 12",
    ] {
        let said = expect(at, arguments, 2);
        assert!(!said.contains("panicked"), "{said}");
        assert_eq!(names(at), before, "{arguments}");
    }
    let said = expect(at, "simplify in.ply o.ply --ratio 50% --label nosuch", 2);
    assert!(said.contains("red"), "names what there is: {said}");
}

#[test]
fn advice_is_given_only_where_it_helps() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 100k", 0);
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = crate::common::stonecut()
        .current_dir(at)
        .args(["convert", "in.ply", "-"])
        .stdout(full)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{said}");
    assert!(said.contains("standard output") && !said.contains("--temp-dir"), "{said}");
    assert!(!said.contains("continue"), "{said}");
    std::fs::create_dir(at.join("empty")).unwrap();
    let said = expect(at, "simplify empty o.ply --ratio 50%", 4);
    assert!(said.contains("folder") && !said.contains("pipe it in"), "{said}");
}

/// Hundreds of missing images are one line that a person can read.
#[test]
fn a_message_names_the_first_few_of_many_images() {
    let at = &scratch();
    let (mut mesh, mut materials) = (String::from("mtllib in.mtl\n"), String::new());
    for i in 0..300 {
        let v = 3 * i + 1;
        let _ = write!(
            mesh,
            "v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m{i}\n\
             f {v}/{v} {}/{} {}/{}\n",
            v + 1,
            v + 1,
            v + 2,
            v + 2
        );
        // Every image twice.
        let _ = write!(materials, "newmtl m{i}\nmap_Kd image{}.png\n", i / 2);
    }
    std::fs::write(at.join("in.obj"), mesh).unwrap();
    std::fs::write(at.join("in.mtl"), materials).unwrap();
    for output in ["o.obj", "o.ply", "o.glb"] {
        let said = expect(at, &format!("convert in.obj {output}"), 3);
        assert!(said.contains("none of the images"), "{said}");
        assert!(said.contains("image0.png' (material 'm0') is not there, and 149 more"), "{said}");
        assert!(said.len() < 500, "{said}");
        let said = expect(at, &format!("convert in.obj {output} -q --force"), 3);
        assert!(said.starts_with("lost: none of the images"), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}
