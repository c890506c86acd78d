//! Vertices that no face uses have no part in the size of a mesh.

use crate::common::{expect, scratch};

/// Squares on a side.
const N: usize = 24;

/// A sheet on a map with a hole of four squares in its middle, and vertices that no face uses.
fn sheet(unused: &[&str]) -> String {
    let mut rows: Vec<String> = Vec::new();
    for i in 0..(N + 1) * (N + 1) {
        let (x, y) = (i % (N + 1), i / (N + 1));
        rows.push(format!("{} {} {}", 500_000 + x, 5_200_000 + y, (x * x + y) % 7));
    }
    rows.extend(unused.iter().map(|&row| row.to_owned()));
    let n_vertices = rows.len();
    for i in (0..N * N).filter(|i| !((i % N).abs_diff(11) < 2 && (i / N).abs_diff(11) < 2)) {
        let a = i / N * (N + 1) + i % N;
        let (b, c, d) = (a + 1, a + N + 1, a + N + 2);
        rows.extend([format!("3 {a} {b} {d}"), format!("3 {a} {d} {c}")]);
    }
    format!(
        "ply\nformat ascii 1.0\nelement vertex {n_vertices}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n{}\n",
        rows.len() - n_vertices,
        rows.join("\n")
    )
}

#[test]
fn a_vertex_far_away_that_no_face_uses_changes_nothing() {
    let at = &scratch();
    std::fs::write(at.join("clean.ply"), sheet(&[])).unwrap();
    std::fs::write(at.join("far.ply"), sheet(&["0 0 0"])).unwrap();
    for command in [
        "simplify IN.ply OUT.ply --ratio 50% --close --cell-triangles 1k",
        "simplify IN.ply OUT.ply --ratio 50% --min-component size=1%",
        "simplify IN.ply OUT.ply --ratio 50% --recentre --format float",
        "convert IN.ply OUT.ply --recentre",
    ] {
        let [clean, far] = ["clean", "far"].map(|name| {
            expect(at, &command.replace("IN", name).replace("OUT", &format!("{name}_out")), 0);
            let bytes = std::fs::read(at.join(format!("{name}_out.ply"))).unwrap();
            std::fs::remove_file(at.join(format!("{name}_out.ply"))).unwrap();
            bytes
        });
        // Cells are cut by a sample of all vertices, so that two results through cells are like each other only in their faces.
        let n_faces = |bytes: &[u8]| {
            let head = String::from_utf8_lossy(&bytes[..bytes.len().min(600)]).into_owned();
            head.lines().find(|line| line.starts_with("element face")).map(str::to_owned)
        };
        match command.contains("--cell-triangles") {
            true => assert_eq!(n_faces(&clean), n_faces(&far), "{command}"),
            false => assert!(clean == far, "{command}"),
        }
    }
}

/// Its one pass sees vertices before it knows the faces, so the box of a grid is that of all of them.
#[test]
fn a_grid_over_vertices_that_no_face_uses_says_what_to_do() {
    let at = &scratch();
    std::fs::write(at.join("far.ply"), sheet(&["0 0 0"])).unwrap();
    let said = expect(at, "simplify far.ply out.ply --ratio 50% --method cluster", 3);
    assert!(
        said.contains("vertices without a face") && said.contains("stonecut convert"),
        "{said}"
    );
    expect(at, "convert far.ply used.ply", 0);
    expect(at, "simplify used.ply out.ply --ratio 50% --method cluster", 0);
}
