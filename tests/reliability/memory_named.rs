//! A refusal for want of memory names a size, and that size is enough: given back, it is not refused again.

#![allow(clippy::unwrap_used, clippy::panic)] // A test fails by panicking.

use crate::common::{expect, run};
use std::path::Path;

/// The size that a refusal names.
fn named(said: &str) -> String {
    let after = said.split("--memory ").nth(1).unwrap_or_else(|| panic!("no size: {said}"));
    after.chars().take_while(char::is_ascii_alphanumeric).collect()
}

/// Runs a command with too little memory, then with what it names.
fn is_enough(folder: &Path, command: &str, too_little: &str) {
    let said = expect(folder, &format!("{command} --memory {too_little}"), 6);
    is_not_refused(folder, command, &said);
}

/// Runs a command with the memory that a refusal names.
fn is_not_refused(folder: &Path, command: &str, said: &str) {
    let memory = named(said);
    let output = run(folder, &format!("{command} --memory {memory}"));
    let again = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_ne!(output.status.code(), Some(6), "{command}\n{said}\n{again}");
}

#[test]
fn what_is_named_is_enough() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    expect(at, "synth statue in.ply --triangles 30k", 0);
    expect(at, "simplify in.ply small.ply --triangles 4k", 0);
    for (command, too_little) in [
        ("measure in.ply small.ply --samples 20k", "41MiB"),
        ("measure in.ply in.ply --samples 20k --near in.ply --within 0.01", "41MiB"),
        ("measure in.ply in.ply --samples 20k --heatmap h.ply --force", "44MiB"),
        ("measure in.ply small.ply --samples 500k", "44MiB"),
        ("measure in.ply small.ply --samples 20k --appearance --views 1", "60MiB"),
        ("render in.ply -o p.png --size 300x200 --force", "30MiB"),
        ("convert in.ply o.glb --force", "8MiB"),
        ("tiles in.ply t --dry-run", "41MiB"),
        ("simplify in.ply o.ply --triangles 4k --dry-run", "41MiB"),
        ("simplify in.ply o.ply --triangles 5k --method retile --force", "45MiB"),
        ("compare cluster in.ply --ratio 10% -o c.html --samples 10k --force", "60MiB"),
    ] {
        is_enough(at, command, too_little);
    }
}

/// Two large triangles that are cut into many thousand before there is anything to choose from.
#[test]
fn a_surface_of_long_triangles_names_enough_for_their_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut text = String::new();
    for (x, y) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
        text.push_str(&format!("v {x} {y} 0\n"));
    }
    // More triangles than are asked for, beside the large ones.
    for i in 0..2000 {
        text.push_str(&format!(
            "v {} 2 0\nv {} 2.001 0\n",
            f64::from(i) * 1e-3,
            f64::from(i) * 1e-3
        ));
    }
    text.push_str("f 1 2 3\nf 1 3 4\n");
    for i in 0..1999 {
        let a = 5 + 2 * i;
        text.push_str(&format!("f {} {} {}\nf {} {} {}\n", a, a + 2, a + 1, a + 1, a + 2, a + 3));
    }
    std::fs::write(at.join("in.obj"), text).unwrap();
    let command = "simplify in.obj o.ply --triangles 3k --method retile --force";
    // More than the plan asks for, less than the pieces take.
    let said = expect(at, &format!("{command} --memory 48MiB"), 6);
    assert!(said.contains("cuts long triangles"), "{said}");
    is_not_refused(at, command, &said);
}

/// The memory of a picture is known before anything is read.
#[test]
fn a_picture_beyond_the_memory_is_refused_with_a_size_that_fits() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    expect(at, "synth statue in.ply --triangles 2k", 0);
    let said = expect(at, "render in.ply -o p.png --size 16000x16000 --memory 1GiB", 6);
    let size = said.split("or make it ").nth(1).unwrap_or_else(|| panic!("{said}")).trim();
    let (width, height) = size.split_once('x').unwrap();
    let sides = [width, height].map(|n| n.parse::<u32>().unwrap());
    assert!(sides.iter().all(|n| (1000..3000).contains(n)), "{said}");
    let said = expect(at, "render in.ply -o p.png --size 200x100 --memory 30MiB", 6);
    let size = said.split("or make it ").nth(1).unwrap_or_else(|| panic!("{said}")).trim();
    expect(at, &format!("render in.ply -o p.png --size {size} --memory 30MiB"), 0);
}
