//! Names out of files and paths reach a terminal escaped, in every message and table.

use crate::common::{scratch, stonecut};
use std::path::Path;

/// Clears the screen, rings, and begins a line that looks like one of ours.
const EVIL: &str = "\u{1b}[2J\u{7}\nstonecut: all is well";

/// Both streams of a command, and its exit code.
fn said(folder: &Path, arguments: &[&str]) -> (String, Option<i32>) {
    let out = stonecut().current_dir(folder).args(arguments).output().unwrap();
    let text = [out.stdout, out.stderr].concat();
    (String::from_utf8_lossy(&text).into_owned(), out.status.code())
}

/// Insists that nothing but newlines moves the cursor, and that no line begins as `EVIL` wants it to.
fn assert_harmless(text: &str) {
    let bad = text.chars().find(|c| c.is_control() && *c != '\n');
    assert_eq!(bad, None, "{text:?}");
    assert!(!text.lines().any(|line| line.starts_with("stonecut: all is well")), "{text}");
    assert!(text.len() < 20_000, "{} bytes", text.len());
}

#[test]
fn names_out_of_files_reach_the_terminal_escaped() {
    let at = &scratch();
    let name = format!("a{EVIL}.ply");
    let plain = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float \u{1b}[31mred\u{9b}2J\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n";
    std::fs::write(at.join(&name), plain).unwrap();
    for (arguments, code) in [
        (vec!["info", name.as_str()], 0),
        (vec!["info", "--check", name.as_str()], 0),
        (vec!["convert", name.as_str(), "o.obj"], 3),
        (vec!["convert", name.as_str(), "o\u{1b}[2J.stl"], 3),
        (vec!["info", EVIL], 4),
        (vec!["simplify", name.as_str(), "p.ply", "--triangles", EVIL], 2),
        (vec!["render", name.as_str(), "-o", "p\u{1b}[2J\n.png", "--size", "20x20"], 0),
    ] {
        let (text, found) = said(at, &arguments);
        assert_eq!(found, Some(code), "{arguments:?}\n{text}");
        assert_harmless(&text);
        if arguments[0] == "info" && code == 0 {
            assert!(text.contains("\\u{1b}[31mred\\u{9b}2J"), "{text}");
            assert!(text.contains("a\\u{1b}[2J\\u{7}\\nstonecut: all is well.ply"), "{text}");
        }
    }
}

#[test]
fn an_endless_name_is_cut() {
    let folder = tempfile::tempdir().unwrap();
    let name = "x".repeat(100_000);
    let document = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"extensionsRequired\":[\"{name}\"],\"extensionsUsed\":[\"{name}\"]}}"
    );
    std::fs::write(folder.path().join("a.gltf"), document).unwrap();
    let (text, code) = said(folder.path(), &["info", "a.gltf"]);
    assert_eq!(code, Some(4), "{text}");
    assert_harmless(&text);
    // The reason and the remedy stay.
    assert!(text.contains("it requires xxx") && text.contains("which is not read"), "{text}");
}
