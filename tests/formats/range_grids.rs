//! Range grids: scans as rows and columns of posts, read as meshes.

use crate::common::real_scan;
use crate::dialects::read_all;
use stonecut::io::StageOptions;
use stonecut::io::ply::MeshSource;

const COLUMNS: usize = 9;
const ROWS: usize = 6;

/// A grid in one of three encodings, with the height of each post; `None`: it has no vertex. `spoil` changes the lists.
fn grid(
    format: &str,
    height: impl Fn(usize, usize) -> Option<f32>,
    size: [usize; 2],
    spoil: impl Fn(usize, &mut Vec<i32>),
) -> Vec<u8> {
    let (mut vertices, mut lists) = (Vec::new(), Vec::new());
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let mut list = Vec::new();
            if let Some(z) = height(column, row) {
                list.push(vertices.len() as i32);
                vertices.push([column as f32, 1.5 * row as f32, z]);
            }
            spoil(lists.len(), &mut list);
            lists.push(list);
        }
    }
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nobj_info num_cols {}\nobj_info num_rows {}\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nelement range_grid {}\nproperty list uchar int vertex_indices\nend_header\n",
        size[0],
        size[1],
        vertices.len(),
        lists.len()
    )
    .into_bytes();
    let is_big = format == "binary_big_endian";
    if format == "ascii" {
        for [x, y, z] in vertices {
            bytes.extend(format!("{x} {y} {z}\n").bytes());
        }
        for list in lists {
            let words: Vec<String> = list.iter().map(i32::to_string).collect();
            bytes.extend(format!("{} {}\n", list.len(), words.join(" ")).bytes());
        }
        return bytes;
    }
    for value in vertices.as_flattened() {
        bytes.extend(if is_big { value.to_be_bytes() } else { value.to_le_bytes() });
    }
    for list in lists {
        bytes.push(list.len() as u8);
        for value in list {
            bytes.extend(if is_big { value.to_be_bytes() } else { value.to_le_bytes() });
        }
    }
    bytes
}

fn open(bytes: Vec<u8>, skip_bad: bool) -> stonecut::Result<MeshSource> {
    let mut options = StageOptions::new(std::env::temp_dir());
    options.read.skip_bad = skip_bad;
    MeshSource::staged_from_bytes("scan.ply", bytes, &options)
}

/// Twice the area of all triangles as they are seen from above; those that face down count below 0.
fn area(places: &[[f64; 3]], triangles: &[[u64; 3]]) -> f64 {
    let of = |t: &[u64; 3]| {
        let [a, b, c] = t.map(|v| places[v as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    triangles.iter().map(of).sum()
}

const SIZE: [usize; 2] = [COLUMNS, ROWS];

#[test]
fn neighbouring_posts_are_triangles() {
    let wave = |c: usize, r: usize| Some(0.3 * ((c * c + 3 * r) % 5) as f32);
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let source = open(grid(format, wave, SIZE, |_, _| {}), false).unwrap();
        assert_eq!(source.n_triangles(), 2 * 8 * 5, "{format}");
        let (places, triangles) = read_all(&source).unwrap();
        assert_eq!(area(&places, &triangles), 2.0 * 8.0 * 1.5 * 5.0, "{format}");
        assert_eq!(source.obj_infos(), ["num_cols 9", "num_rows 6"]);

        // Of the four squares around a post without a vertex three corners are left.
        let holed = |c, r| if (c, r) == (3, 2) { None } else { wave(c, r) };
        let source = open(grid(format, holed, SIZE, |_, _| {}), false).unwrap();
        assert_eq!(source.n_triangles(), 2 * 8 * 5 - 4, "{format}");
        let (places, triangles) = read_all(&source).unwrap();
        assert_eq!(area(&places, &triangles), 2.0 * (8.0 * 1.5 * 5.0 - 2.0 * 1.5), "{format}");
    }
}

#[test]
fn squares_are_split_along_the_shorter_diagonal() {
    let step = |c: usize, r: usize| Some([0.0, 1.0, 2.0][(c + r).saturating_sub(4).min(2)]);
    let (places, triangles) =
        read_all(&open(grid("ascii", step, SIZE, |_, _| {}), false).unwrap()).unwrap();
    let is_middle = |v: &&u64| places[**v as usize][2] == 1.0;
    // Five edges lead along the middle of the step, over two triangles each.
    let along = triangles.iter().filter(|t| t.iter().filter(is_middle).count() == 2).count();
    assert_eq!(along, 2 * 5);
}

#[test]
fn a_surface_does_not_hang_on_to_the_one_behind_it() {
    // An edge along a column, one along a row, and a slope that is not one.
    for (height, n) in [
        ((|c, _| if c < 4 { 0.0 } else { 30.0 }) as fn(usize, usize) -> f32, 2 * 7 * 5),
        (|_, r| if r < 3 { 0.0 } else { 30.0 }, 2 * 8 * 4),
        // Six squares lie across the jump; at its corner one of them has three posts on one side.
        (|c, r| if c < 4 && r < 3 { 30.0 } else { 0.0 }, 2 * (8 * 5 - 6) + 1),
        (|c, r| 2.0 * (c + r) as f32, 2 * 8 * 5),
    ] {
        let bytes = grid("binary_little_endian", |c, r| Some(height(c, r)), SIZE, |_, _| {});
        assert_eq!(open(bytes, false).unwrap().n_triangles(), n);
    }
}

#[test]
fn what_is_wrong_with_a_grid_is_named() {
    let flat = |_: usize, _: usize| Some(0.0);
    let fails = |bytes| open(bytes, false).unwrap_err().to_string();
    let message = fails(grid("ascii", flat, [9, 7], |_, _| {}));
    assert!(message.contains("num_cols") && message.contains("9 x 7"), "{message}");

    let two = |place, list: &mut Vec<i32>| {
        if place == 10 {
            list.push(3)
        }
    };
    let message = fails(grid("binary_little_endian", flat, SIZE, two));
    for part in ["range_grid", "row 10", "byte offset", "2 vertices"] {
        assert!(message.contains(part), "{message}");
    }
    for bad in [54, -1] {
        let wild = |place, list: &mut Vec<i32>| {
            if place == 20 {
                list[0] = bad;
            }
        };
        let message = fails(grid("ascii", flat, SIZE, wild));
        for part in ["range_grid", "row 20", "line "] {
            assert!(message.contains(part), "{message}");
        }
        let source = open(grid("ascii", flat, SIZE, wild), true).unwrap();
        assert_eq!((source.n_triangles(), source.faults().bad_faces), (2 * 8 * 5 - 4, 1));
    }
    let mut cut = grid("binary_little_endian", flat, SIZE, |_, _| {});
    cut.truncate(cut.len() - 7);
    // The last post is gone and half of the one before it: one square loses both triangles, one loses one.
    let source = open(cut.clone(), true).unwrap();
    assert_eq!((source.n_triangles(), source.faults().bad_faces), (2 * 8 * 5 - 3, 2));
    assert!(fails(cut).contains("the file ends here"));

    // Without columns and rows they are points.
    let text = String::from_utf8(grid("ascii", flat, SIZE, |_, _| {})).unwrap();
    let source = open(text.replace("num_cols", "columns").into_bytes(), false).unwrap();
    assert_eq!((source.n_vertices(), source.n_triangles()), (54, 0));
    let message = source.require_faces().unwrap_err().to_string();
    assert!(message.contains("num_cols"), "{message}");
}

#[test]
fn a_real_scan_is_a_mesh() {
    let Some(path) = real_scan("bun000_range_grid_ascii.ply") else { return };
    let source = MeshSource::open_staged(&path, &StageOptions::new(std::env::temp_dir())).unwrap();
    let (places, triangles) = read_all(&source).unwrap();
    assert_eq!(places.len(), 40_256);
    // Two triangles a vertex but for its rims; it looks towards the scanner.
    assert!((74_000..79_000).contains(&triangles.len()), "{}", triangles.len());
    assert!(area(&places, &triangles) > 0.0);
}
