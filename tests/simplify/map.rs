//! Maps of vertices lead where vertices went, through rounds, stops and joined copies; values are carried over by them.

use crate::common::meshes::{soup, torus};
use crate::common::{expect, scratch, write_ply};
use std::path::Path;
use stonecut::config::{Config, Target};
use stonecut::io::npy::{self, NpyArray};
use stonecut::io::ply::{BLOCK_ROWS, MeshSource, VertexBlock};
use stonecut::mesh::Mesh;
use stonecut::mesh::property::Scalar;
use stonecut::mesh::vec3::{length_sq, sub};
use stonecut::pipeline::in_memory::{Input, simplify};
use stonecut::system::progress::Progress;

fn bumpy(n: usize) -> Mesh {
    torus(n, n, |u, v| 0.4 + 0.02 * (5.0 * u).sin() * (7.0 * v).cos())
}

fn write(folder: &Path, mesh: &Mesh) {
    write_ply(&folder.join("in.ply"), Scalar::F64, &mesh.positions, &mesh.triangles);
}

fn positions(path: &Path) -> Vec<[f64; 3]> {
    let source = MeshSource::open(path).unwrap();
    assert!(source.n_vertices() <= BLOCK_ROWS);
    let mut block = VertexBlock::default();
    source.read_vertices(0, &mut block).unwrap();
    let rows = block.records.chunks_exact(source.schema().record_bytes());
    rows.map(|row| source.schema().position(row)).collect()
}

fn column(array: &NpyArray, column: u64) -> Vec<f64> {
    let mut out = Vec::new();
    let each = |_, bits| {
        out.push(array.element.value(bits));
        Ok(())
    };
    array.each(column, each).unwrap();
    out
}

/// To the result, and back.
fn map(path: &Path) -> [Vec<f64>; 2] {
    let there = NpyArray::open(path, 0).unwrap();
    let back = NpyArray::open(path, there.end()).unwrap();
    [column(&there, 0), column(&back, 0)]
}

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// Rounds, new cells between them, and a finish; again with other threads, in two parts, with more than fits into memory.
#[test]
fn every_vertex_leads_to_one_near_it_whatever_ran_at_once() {
    let folder = &scratch();
    let mesh = bumpy(90);
    write(folder, &mesh);
    let options = "--ratio 40% --cell-triangles 1000 --threads 1";
    expect(folder, &format!("simplify in.ply plain.ply {options}"), 0);
    expect(folder, &format!("simplify in.ply out.ply {options} --map m.npy"), 0);
    assert!(bytes(folder, "plain.ply") == bytes(folder, "out.ply"));
    let [there, back] = map(&folder.join("m.npy"));
    let result = positions(&folder.join("out.ply"));
    assert_eq!((there.len(), back.len()), (mesh.positions.len(), result.len()));
    let (mut nearest, mut sum) = (vec![f64::INFINITY; result.len()], 0.0);
    for (from, &to) in mesh.positions.iter().zip(&there) {
        // Nothing of a torus vanishes.
        let away = length_sq(sub(*from, result[to as usize])).sqrt();
        // Three edges of the result; on the mean a third of one.
        assert!(away < 0.5, "{away}");
        sum += away;
        nearest[to as usize] = nearest[to as usize].min(away);
    }
    assert!(sum / (there.len() as f64) < 0.05, "{sum}");
    for ((&from, place), nearest) in back.iter().zip(&result).zip(&nearest) {
        let away = length_sq(sub(mesh.positions[from as usize], *place)).sqrt();
        assert_eq!(away, *nearest);
    }
    let options = "--ratio 40% --cell-triangles 1000 --threads 3 --memory 300MiB --map again.npy";
    expect(folder, &format!("simplify in.ply again.ply {options} --until simplify"), 0);
    let without = "--ratio 40% --cell-triangles 1000";
    let said = expect(folder, &format!("simplify in.ply again.ply {without}"), 8);
    assert!(said.contains("map"), "{said}");
    expect(folder, &format!("simplify in.ply again.ply {options}"), 0);
    assert!(bytes(folder, "m.npy") == bytes(folder, "again.npy"));
}

/// The same for arrays, in one call of the kernel and through cells in memory.
#[test]
fn rows_of_arrays_lead_where_their_vertices_went() {
    let Mesh { positions, triangles, .. } = bumpy(60);
    for cell_triangles in [100_000, 500] {
        let config = Config {
            cell_triangles,
            map: Some("of arrays".into()),
            ..Config::new("in", "out.ply", Target::Ratio(0.2))
        };
        let input = Input {
            positions: positions.clone(),
            triangles: triangles.clone(),
            ..Input::default()
        };
        let made = simplify(input, &config, &Progress::default()).unwrap();
        assert_eq!(made.map.len(), positions.len());
        let away = |(from, &to): (&[f64; 3], &u32)| {
            length_sq(sub(*from, made.positions[to as usize])).sqrt()
        };
        let sum: f64 = positions.iter().zip(&made.map).map(away).sum();
        assert!(sum / (positions.len() as f64) < 0.1, "{sum}");
        for (number, &source) in made.source.iter().enumerate() {
            assert_eq!(made.map[source as usize] as usize, number);
        }
    }
}

#[test]
fn vertices_that_stay_lead_to_themselves() {
    let folder = &scratch();
    let mesh = bumpy(40);
    write(folder, &mesh);
    let options = "--ratio 20% --cell-triangles 1000 --placement subset --map m.npy";
    expect(folder, &format!("simplify in.ply out.ply {options}"), 0);
    let [there, back] = map(&folder.join("m.npy"));
    for (number, place) in positions(&folder.join("out.ply")).iter().enumerate() {
        let from = back[number] as usize;
        assert_eq!((mesh.positions[from], there[from] as usize), (*place, number));
    }
}

/// A triangle a corner of its own, and one that has no area: its vertices became none.
#[test]
fn copies_become_what_one_of_them_did() {
    let folder = &scratch();
    let whole = bumpy(40);
    let corners = whole.triangles.iter().map(|t| t.map(|v| whole.positions[v as usize]));
    let mut mesh = soup(&corners.collect::<Vec<_>>());
    let n = mesh.positions.len();
    mesh.positions.push([9.0; 3]);
    // In one finish the kernel joins copies, through cells they are joined before.
    for cells in [1000, 100_000] {
        write(folder, &mesh);
        let options = format!("--ratio 20% --cell-triangles {cells} --map m.npy --force");
        expect(folder, &format!("simplify in.ply out.ply {options}"), 0);
        let [there, back] = map(&folder.join("m.npy"));
        let result = positions(&folder.join("out.ply"));
        assert_eq!((there.len(), back.len(), there[n]), (n + 1, result.len(), -1.0));
        let mut seen = std::collections::HashMap::new();
        for (from, &to) in mesh.positions.iter().zip(&there).take(n) {
            let away = length_sq(sub(*from, result[to as usize])).sqrt();
            assert!(away < 1.0, "{away}");
            let first = *seen.entry(from.map(f64::to_bits)).or_insert(to);
            assert_eq!(first, to, "{cells}");
        }
        assert!(back.iter().all(|&from| from >= 0.0));
    }
}

#[test]
fn values_go_to_the_result_and_back() {
    let folder = &scratch();
    let array = |name: &str, kind: &str, shape: &[u64], rows: &[Vec<u8>]| {
        let bytes = [npy::header(kind, shape), rows.concat()].concat();
        std::fs::write(folder.join(name), bytes).unwrap();
    };
    let numbers = |list: &[i64]| list.iter().map(|n| n.to_le_bytes().to_vec()).collect::<Vec<_>>();
    array("there", "<i8", &[6], &numbers(&[2, 0, 0, -1, 2, 2]));
    array("back", "<i8", &[3], &numbers(&[1, 3, 4]));
    std::fs::write(folder.join("m.npy"), [bytes(folder, "there"), bytes(folder, "back")].concat())
        .unwrap();
    let floats = [[1.0f32, 10.0], [2.0, 20.0], [4.0, 40.0], [9.0, 9.0], [2.0, 30.0], [6.0, 50.0]];
    let rows: Vec<Vec<u8>> = floats.iter().map(|r| r.map(f32::to_le_bytes).concat()).collect();
    array("f.npy", "<f4", &[6, 2], &rows);
    array("labels.npy", "|u1", &[6], &[vec![7, 3, 5, 9, 8, 8]]);
    expect(folder, "transfer m.npy f.npy -o means.npy", 0);
    let means = NpyArray::open(&folder.join("means.npy"), 0).unwrap();
    assert_eq!((means.element.name(), means.shape), ("<f4".to_owned(), [3, 2]));
    let [x, y] = [0, 1].map(|k| column(&means, k));
    assert_eq!((x, y), (vec![3.0, 9.0, 3.0], vec![30.0, 9.0, 30.0]));
    let get = |name: &str| column(&NpyArray::open(&folder.join(name), 0).unwrap(), 0);
    expect(folder, "transfer m.npy labels.npy -o most.npy", 0);
    assert_eq!(get("most.npy"), [3.0, 9.0, 8.0]);
    expect(folder, "transfer m.npy labels.npy -o mean.npy --by mean", 0);
    assert_eq!(get("mean.npy"), [4.0, 9.0, 8.0]);
    let said = expect(folder, "transfer m.npy most.npy -o spread.npy --to input", 0);
    assert!(said.contains("6 rows, 1 of them without"), "{said}");
    assert_eq!(get("spread.npy"), [8.0, 3.0, 3.0, 0.0, 8.0, 8.0]);
    let said = expect(folder, "transfer m.npy most.npy -o no.npy", 2);
    assert!(said.contains("3 rows, and the input of the map 6"), "{said}");
    assert!(expect(folder, "transfer f.npy f.npy -o no.npy", 4).contains("not a map"));
}

/// A map of six vertices that became three.
const SOUND: ([i64; 6], [i64; 3]) = ([2, 0, 0, -1, 2, 2], [1, 3, 4]);

fn write_map(path: &Path, (there, back): (&[i64], &[i64])) {
    let array = |list: &[i64]| {
        let rows = list.iter().flat_map(|n| n.to_le_bytes());
        npy::header("<i8", &[list.len() as u64]).into_iter().chain(rows).collect::<Vec<u8>>()
    };
    std::fs::write(path, [array(there), array(back)].concat()).unwrap();
}

#[test]
fn maps_that_do_not_hold_are_refused_by_row() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("v.npy"), [npy::header("|u1", &[6]), vec![1; 6]].concat()).unwrap();
    let (there, back) = SOUND;
    let refused = |code: i32, word: &str| {
        let said = expect(folder, "transfer m.npy v.npy -o no.npy", code);
        assert!(said.contains("m.npy") && said.contains(word), "{said}");
        assert!(!folder.join("no.npy").exists());
    };
    for (at, number, word) in [
        (3, 3, "row 3 of its first array is 3: not -1, and not a vertex of the result"),
        (3, -2, "row 3 of its first array is -2"),
        (1, 1, "row 0 of its second array names vertex 1, which did not become"),
    ] {
        let mut forged = there;
        forged[at] = number;
        write_map(&folder.join("m.npy"), (&forged, &back));
        refused(4, word);
    }
    for (at, number, word) in [
        (2, 6, "row 2 of its second array is 6"),
        (0, -1, "row 0 of its second array names vertex -1"),
        (2, 1, "row 2 of its second array names vertex 1"),
    ] {
        let mut forged = back;
        forged[at] = number;
        write_map(&folder.join("m.npy"), (&there, &forged));
        refused(4, word);
    }
    write_map(&folder.join("m.npy"), (&there, &back));
    let whole = bytes(folder, "m.npy");
    std::fs::write(folder.join("m.npy"), [&whole[..], b"x"].concat()).unwrap();
    refused(4, "ends with its second array");
    std::fs::write(folder.join("m.npy"), &whole[..whole.len() - 8]).unwrap();
    refused(4, "second array");
    std::fs::write(folder.join("m.npy"), whole).unwrap();
    let said = expect(folder, "transfer m.npy v.npy -o no.npy --memory 1KiB", 6);
    assert!(said.contains("give at least --memory 48MiB"), "{said}");
    expect(folder, "transfer m.npy v.npy -o yes.npy --memory 48MiB", 0);
}

#[test]
fn rows_of_many_columns_are_carried_as_columns_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_map(&folder.join("m.npy"), (&SOUND.0, &SOUND.1));
    let n = 3000usize;
    let value = |row: usize, column: usize| ((row * 7 + column * 3) % 251) as u8;
    let rows = (0..6).flat_map(|row| (0..n).map(move |column| value(row, column)));
    let values: Vec<u8> = npy::header("|u1", &[6, n as u64]).into_iter().chain(rows).collect();
    std::fs::write(folder.join("v.npy"), values).unwrap();
    expect(folder, "transfer m.npy v.npy -o r.npy --memory 64MiB", 0);
    let most = NpyArray::open(&folder.join("r.npy"), 0).unwrap();
    assert_eq!(most.shape, [3, n as u64]);
    for at in [0, 1, 1234, n - 1] {
        let least = |rows: &[usize]| {
            rows.iter().map(|&row| f64::from(value(row, at))).fold(f64::INFINITY, f64::min)
        };
        let expected = [least(&[1, 2]), least(&[3]), least(&[0, 4, 5])];
        assert_eq!(column(&most, at as u64), expected, "{at}");
    }
    expect(folder, "transfer m.npy r.npy -o back.npy --to input", 0);
    let back = NpyArray::open(&folder.join("back.npy"), 0).unwrap();
    let [a, _, c] = column(&most, 77)[..] else { panic!("three rows") };
    assert_eq!((back.shape, column(&back, 77)), ([6, n as u64], vec![c, a, a, 0.0, c, c]));
}

#[test]
fn what_a_map_does_not_go_with_is_refused() {
    let folder = &scratch();
    write(folder, &bumpy(10));
    for (options, word) in [
        ("out.ply --ratio 50% --max-error 1", "--max-error"),
        ("out.ply --ratio 50% --optimize 2", "--map"),
        ("out.ply --grid 1 --method cluster", "--map"),
        ("out.ply --ratio 50% --progressive out.pm", "--progressive"),
        ("out.glb --ratio 50%", "PLY and OBJ"),
    ] {
        let said = expect(folder, &format!("simplify in.ply {options} --map m.npy"), 2);
        assert!(said.contains(word), "{options}: {said}");
    }
}
