//! Sheets that meet along a curve keep their common edges; what is too short for a curve comes apart.

use crate::common::meshes::{halves, squares};
use std::collections::BTreeMap;
use stonecut::Mesh;
use stonecut::kernel::{Bound, Options, Stop, Topology, simplify_mesh};

/// Three bumpy pages of `length` x `width` squares that meet in a bent line.
///
/// ```text
///         |
///         |          three triangles at each edge of the line
///        / \
///       /   \
/// ```
fn book(length: usize, width: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let line = |i: usize| {
        let x = i as f64 / 32.0;
        [x, 0.1 * (3.0 * x).sin(), 0.0]
    };
    mesh.positions.extend((0..=length).map(line));
    for page in 0..3 {
        let (s, c) = (f64::from(page) * std::f64::consts::TAU / 3.0).sin_cos();
        let first = mesh.positions.len();
        for j in 1..=width {
            mesh.positions.extend((0..=length).map(|i| {
                let ([x, y, z], off) = (line(i), j as f64 / 32.0);
                let bump = 0.05 * off * (7.0 * x).sin() * (5.0 * off).cos();
                [x, y + off * c - bump * s, z + off * s + bump * c]
            }));
        }
        let at = |i: usize, j: usize| match j {
            0 => i as u32,
            _ => (first + (j - 1) * (length + 1) + i) as u32,
        };
        let mut triangles = halves(squares(length, width), at);
        // Two pages run one way along the line, one the other way.
        triangles.iter_mut().filter(|_| page == 0).for_each(|t| t.swap(1, 2));
        mesh.triangles.extend(triangles);
    }
    mesh
}

/// Counts of edges by the number of triangles at them.
fn edges(mesh: &Mesh) -> BTreeMap<usize, usize> {
    let mut edges: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let mut counts = BTreeMap::new();
    edges.values().for_each(|&n| *counts.entry(n).or_default() += 1);
    counts
}

fn simplify(mesh: &Mesh, locked: &[bool], topology: Topology) -> Mesh {
    let stop = Stop::Triangles(mesh.triangles.len() as u64 / 10);
    let result =
        simplify_mesh(mesh.clone(), locked, &Options { stop, topology, ..Options::default() });
    assert!(result.statistics.reached);
    result.mesh
}

#[test]
fn pages_stay_bound() {
    let mesh = book(96, 24);
    let free = vec![false; mesh.positions.len()];
    for topology in [Topology::Error, Topology::Keep] {
        let result = simplify(&mesh, &free, topology);
        let counts = edges(&result);
        let on_line = counts[&3];
        assert!((24..80).contains(&on_line), "{on_line} of 96 edges are left");
        assert!(counts.keys().all(|&n| n <= 3), "{counts:?}");
        // Both ends of the line, and what lies on it, are still there.
        let ends = [mesh.positions[0], mesh.positions[96]];
        assert!(ends.iter().all(|end| result.positions.contains(end)));
    }
}

/// The same with flat pages and a straight line; 6 triangles are enough for it.
fn flat_book(n: usize) -> Mesh {
    let mut mesh = book(n, n);
    for (k, p) in mesh.positions.iter_mut().enumerate() {
        let (row, x) = (k / (n + 1), (k % (n + 1)) as f64);
        let page = row.saturating_sub(1) / n;
        let off = if row == 0 { 0.0 } else { ((row - 1) % n + 1) as f64 };
        let (s, c) = (page as f64 * std::f64::consts::TAU / 3.0).sin_cos();
        *p = [x, off * c, off * s];
    }
    mesh
}

#[test]
fn a_straight_line_of_flat_pages_becomes_as_short_as_it_can() {
    let mesh = flat_book(40);
    let free = vec![false; mesh.positions.len()];
    let bound = Bound { distance: 0.1, channel: None, patience: 1.0 };
    for (bound, most) in [(None, 20), (Some(bound), 40)] {
        let stop = Stop::Triangles(most);
        let options = Options { stop, bound, ..Options::default() };
        let result = simplify_mesh(mesh.clone(), &free, &options);
        assert!(result.statistics.reached, "{} triangles", result.mesh.triangles.len());
        let at = |v: u32| result.mesh.positions[v as usize];
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(at);
            let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
            let n =
                [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            0.5 * n.iter().map(|x| x * x).sum::<f64>().sqrt()
        };
        let area: f64 = result.mesh.triangles.iter().map(area).sum();
        assert!((area / 4800.0 - 1.0).abs() < 0.01, "{area}");
        assert!(edges(&result.mesh)[&3] <= 6);
    }
}

#[test]
fn a_line_goes_on_beyond_locked_vertices() {
    // Each piece between locked rows is as short as noise.
    let mesh = book(40, 12);
    let locked: Vec<bool> =
        mesh.positions.iter().map(|p| (p[0] * 32.0).round() % 5.0 == 0.0).collect();
    let result = simplify_mesh(
        mesh.clone(),
        &locked,
        &Options { stop: Stop::Triangles(1400), ..Options::default() },
    );
    let counts = edges(&result.mesh);
    assert_eq!(counts.get(&3), Some(&40), "no piece is long enough to become shorter");
    assert_eq!(
        result.statistics.changes.iter().find(|(name, _)| *name == "vertices_split"),
        Some(&("vertices_split", 0))
    );
}

#[test]
fn short_lines_come_apart() {
    // Longer in all than wide, but the line is of ten edges with two loose ends.
    let mesh = book(10, 30);
    let result = simplify(&mesh, &vec![false; mesh.positions.len()], Topology::Error);
    assert_eq!(edges(&result).get(&3), None);
}

/// A box of `size` squares from `first` on, whose vertices are its own.
fn add_box(mesh: &mut Mesh, first: [usize; 3], size: [usize; 3]) {
    let mut numbers = BTreeMap::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for end in [0, size[axis]] {
            let corners: Vec<u32> = squares(size[u] + 1, size[v] + 1)
                .map(|(x, y)| {
                    let mut place = first;
                    (place[axis], place[u], place[v]) =
                        (first[axis] + end, first[u] + x, first[v] + y);
                    *numbers.entry(place).or_insert_with(|| {
                        mesh.positions.push(place.map(|x| x as f64 / 16.0));
                        mesh.positions.len() as u32 - 1
                    })
                })
                .collect();
            let mut triangles =
                halves(squares(size[u], size[v]), |x, y| corners[y * (size[u] + 1) + x]);
            triangles.iter_mut().filter(|_| end == 0).for_each(|t| t.swap(1, 2));
            mesh.triangles.extend(triangles);
        }
    }
}

fn volume(mesh: &Mesh) -> f64 {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
    };
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        cross(b, c).iter().zip(a).map(|(x, y)| x * y).sum::<f64>() / 6.0
    };
    mesh.triangles.iter().map(of).sum()
}

/// Vertices in one place become one, as in files without numbers of vertices.
fn merge_places(mesh: &mut Mesh) {
    let mut numbers = BTreeMap::new();
    let mut positions = Vec::new();
    let number: Vec<u32> = (mesh.positions.iter())
        .map(|place| {
            *numbers.entry(place.map(f64::to_bits)).or_insert_with(|| {
                positions.push(*place);
                positions.len() as u32 - 1
            })
        })
        .collect();
    mesh.triangles.iter_mut().flatten().for_each(|v| *v = number[*v as usize]);
    *mesh = Mesh::new(positions, std::mem::take(&mut mesh.triangles));
}

#[test]
fn bodies_around_an_edge_come_apart() {
    // Four bodies, of which two each have a copy of the wall between them; all of them meet in the line in the middle.
    let mut mesh = Mesh::default();
    for (x, y) in squares(2, 2) {
        add_box(&mut mesh, [12 * x, 12 * y, 0], [12, 12, 40]);
    }
    merge_places(&mut mesh);
    let before = volume(&mesh);
    for share in [5, 20, 50] {
        let stop = Stop::Triangles(mesh.triangles.len() as u64 / share);
        let free = vec![false; mesh.positions.len()];
        let result = simplify_mesh(mesh.clone(), &free, &Options { stop, ..Options::default() });
        let after = volume(&result.mesh);
        assert!(result.statistics.reached && (after / before - 1.0).abs() < 1e-3, "{after}");
        assert_eq!(edges(&result.mesh).keys().copied().collect::<Vec<_>>(), [2], "1 in {share}");
    }
}

#[test]
fn bodies_stay_whole_where_their_walls_are_held() {
    // No edge of the wall may collapse, since its copies meet: there are not enough others.
    let mut mesh = Mesh::default();
    add_box(&mut mesh, [0, 0, 0], [16, 16, 16]);
    add_box(&mut mesh, [16, 0, 0], [16, 16, 16]);
    let stop = Stop::Triangles(mesh.triangles.len() as u64 / 10);
    let free = vec![false; mesh.positions.len()];
    let options = Options { stop, no_self_intersections: true, ..Options::default() };
    let result = simplify_mesh(mesh, &free, &options);
    let after = volume(&result.mesh);
    assert!(!result.statistics.reached && (after / 2.0 - 1.0).abs() < 1e-3, "{after}");
}
