//! Survivors that are vertices of the input, with all that these have.

use crate::common::{expect, scratch};
use stonecut::io::ply::MeshSource;

/// Squares on a side.
const N: usize = 24;

#[test]
fn vertices_beside_faces_with_labels_keep_their_own_numbers() {
    let at = &scratch();
    let mut rows: Vec<String> = Vec::new();
    for id in 0..(N + 1) * (N + 1) {
        let (x, y) = (id % (N + 1), id / (N + 1));
        rows.push(format!("{x} {y} {} {id}", (0.3 * x as f64).sin() * (0.2 * y as f64).cos()));
    }
    let n_vertices = rows.len();
    for i in 0..N * N {
        let a = i / N * (N + 1) + i % N;
        let (b, c, d) = (a + 1, a + N + 1, a + N + 2);
        let part = (i % N + i / N) / 12;
        rows.extend([format!("3 {a} {b} {d} {part}"), format!("3 {a} {d} {c} {part}")]);
    }
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex {n_vertices}\nproperty double x\nproperty double y\nproperty double z\n\
         property int id\nelement face {}\nproperty list uchar int vertex_indices\nproperty int part\nend_header\n{}\n",
        rows.len() - n_vertices,
        rows.join("\n")
    );
    std::fs::write(at.join("in.ply"), text).unwrap();
    expect(at, "simplify in.ply out.ply --ratio 20% --placement subset", 0);
    let source = MeshSource::open(&at.join("out.ply")).unwrap();
    let (mut n, mut n_wrong) = (0, 0);
    let each = |_: u64, record: &[u8]| {
        let [x, y, _] = source.schema().position(record);
        let id = &record[source.schema().position_bytes()..][..4];
        let id = i32::from_le_bytes(id.try_into().unwrap()) as usize;
        let place = [id % (N + 1), id / (N + 1)].map(|x| x as f64);
        (n, n_wrong) = (n + 1, n_wrong + usize::from(place != [x, y]));
        Ok(())
    };
    source.each_vertex(each).unwrap();
    assert!(n > 100 && n_wrong == 0, "{n_wrong} of {n}");
}
