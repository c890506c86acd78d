//! What the kernel does with meshes that are not clean, and how it stops.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use std::collections::{BTreeMap, BTreeSet};

use stonecut::Mesh;
use stonecut::kernel::{Options, Placement, Simplified, Stop, Topology, simplify_mesh};

/// A height field of `n` x `n` quads, the quads for which `is_hole` left out.
fn sheet(n: usize, is_hole: impl Fn(usize, usize) -> bool) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (x as f64 / n as f64, y as f64 / n as f64);
            let z = 0.05 * (11.0 * u).sin() * (7.0 * v).cos() + 0.01 * (53.0 * u * v).sin();
            mesh.positions.push([u, v, z]);
        }
    }
    let at = |x: usize, y: usize| (y * (n + 1) + x) as u32;
    for y in 0..n {
        for x in (0..n).filter(|&x| !is_hole(x, y)) {
            mesh.triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            mesh.triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    mesh
}

fn run(mesh: &Mesh, triangles: u64, topology: Topology) -> Simplified {
    let options = Options { stop: Stop::Triangles(triangles), topology, ..Options::default() };
    simplify_mesh(mesh.clone(), &vec![false; mesh.positions.len()], &options)
}

/// Edges by the number of triangles on them.
fn edges(mesh: &Mesh) -> BTreeMap<[u32; 2], u32> {
    let mut edges = BTreeMap::new();
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    edges
}

fn n_edges(mesh: &Mesh, wanted: impl Fn(u32) -> bool) -> usize {
    edges(mesh).values().filter(|&&n| wanted(n)).count()
}

/// Two sheets over one another that have the middle row of vertices in common.
///
/// ```text
///   \   /
///    \ /      seen along the common row: four triangles at each of its edges
///    / \
///   /   \
/// ```
fn touching(n: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let mut middle = Vec::new();
    for side in [-1.0, 1.0] {
        let mut ids = Vec::new();
        for y in 0..=2 * n {
            for x in 0..=2 * n {
                let off = (y as f64 - n as f64) / n as f64;
                if y == n && side > 0.0 {
                    ids.push(middle[x]);
                    continue;
                }
                if y == n {
                    middle.push(mesh.positions.len() as u32);
                }
                ids.push(mesh.positions.len() as u32);
                mesh.positions.push([x as f64 / n as f64, off, side * off]);
            }
        }
        let at = |x: usize, y: usize| ids[y * (2 * n + 1) + x];
        for y in 0..2 * n {
            for x in 0..2 * n {
                mesh.triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
                mesh.triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
            }
        }
    }
    mesh
}

#[test]
fn sheets_that_touch_are_taken_apart_or_left_as_found() {
    let mesh = touching(10);
    let non_manifold = n_edges(&mesh, |n| n > 2);
    assert_eq!(non_manifold, 20);
    let result = run(&mesh, 200, Topology::Error);
    assert!(result.statistics.reached);
    assert_eq!(n_edges(&result.mesh, |n| n > 2), 0);
    let kept = run(&mesh, 200, Topology::Keep);
    assert_eq!(n_edges(&kept.mesh, |n| n > 2), non_manifold, "complex vertices are left as found");
    let rejects: BTreeMap<_, _> = kept.statistics.rejects.iter().copied().collect();
    let names: BTreeSet<_> = rejects.keys().copied().collect();
    let all = ["boundary", "flip", "link condition", "locked", "non-manifold", "sliver"];
    assert_eq!(
        names,
        all.into_iter().collect(),
        "every refusal is named, also if it never came up"
    );
    assert!(rejects["non-manifold"] > 0);
}

#[test]
fn charts_with_slits_are_joined_over_their_edges() {
    // Each row of quads with vertices of its own.
    let whole = sheet(24, |_, _| false);
    let mut split = Mesh::default();
    for row in whole.triangles.chunks(2 * 24) {
        let first = split.positions.len() as u32;
        let lowest = row.iter().flatten().min().copied().unwrap();
        split.positions.extend_from_slice(&whole.positions[lowest as usize..][..50]);
        split.triangles.extend(row.iter().map(|t| t.map(|v| v - lowest + first)));
    }
    // A triangle that is there twice, under other names, must not keep its neighbours from joining.
    let copy = split.triangles[100].map(|v| split.positions[v as usize]);
    let first = split.positions.len() as u32;
    split.positions.extend(copy);
    split.triangles.push([first, first + 1, first + 2]);
    let result = run(&split, 2000, Topology::Error);
    assert_eq!(result.mesh.triangles.len(), whole.triangles.len(), "the double is gone");
    assert_eq!(n_edges(&result.mesh, |n| n == 1), 4 * 24, "only the outer boundary is open");
    assert_eq!(result.source.len(), whole.positions.len());
}

#[test]
fn small_holes_close_only_if_asked() {
    // Every third quad of every third row is missing.
    let mesh = sheet(30, |x, y| x % 3 == 1 && y % 3 == 1);
    // Components of the boundary: a closed sheet with k holes has k + 1 of them.
    let euler = |mesh: &Mesh| {
        mesh.positions.len() as i64 - edges(mesh).len() as i64 + mesh.triangles.len() as i64
    };
    assert_eq!(euler(&mesh), 1 - 100);
    assert_eq!(euler(&run(&mesh, 40, Topology::Keep).mesh), -99);
    let relaxed = run(&mesh, 40, Topology::Error);
    assert!(euler(&relaxed.mesh) > -99, "{}", euler(&relaxed.mesh));
    assert_eq!(n_edges(&relaxed.mesh, |n| n > 2), 0);
}

/// A closed tube of `n` x `m` quads around a ring: a torus, thin where `radius` is small.
fn torus(n: usize, m: usize, radius: f64) -> Mesh {
    let turn = std::f64::consts::TAU;
    let mut mesh = Mesh::default();
    for i in 0..n {
        for j in 0..m {
            let (a, b) = (i as f64 * turn / n as f64, j as f64 * turn / m as f64);
            let ring = 1.0 + radius * b.cos();
            mesh.positions.push([ring * a.cos(), ring * a.sin(), radius * b.sin()]);
        }
    }
    let at = |i: usize, j: usize| ((i % n) * m + j % m) as u32;
    for i in 0..n {
        for j in 0..m {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

#[test]
fn a_thin_tube_is_cut_only_if_asked() {
    let mesh = torus(120, 4, 0.01);
    let euler = |mesh: &Mesh| {
        mesh.positions.len() as i64 - edges(mesh).len() as i64 + mesh.triangles.len() as i64
    };
    assert_eq!(euler(&mesh), 0);
    let kept = run(&mesh, 8, Topology::Keep);
    assert_eq!(euler(&kept.mesh), 0);
    assert!(!kept.statistics.reached, "a torus needs 14 triangles");
    let cut = run(&mesh, 8, Topology::Error);
    assert!(cut.statistics.reached);
    assert_eq!(n_edges(&cut.mesh, |n| n != 2), 0);
}

#[test]
fn triangles_without_area_vanish_first() {
    // A vertex in the middle of an edge, so that the triangle over it has no area.
    let mut mesh = sheet(20, |_, _| false);
    let before = mesh.triangles.len();
    for i in (0..before).step_by(37) {
        let [a, b, c] = mesh.triangles[i];
        let middle = mesh.positions.len() as u32;
        let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
        mesh.positions.push([0, 1, 2].map(|k| 0.5 * (p[k] + q[k])));
        mesh.triangles[i] = [middle, b, c];
        mesh.triangles.push([a, middle, c]);
        mesh.triangles.push([a, b, middle]);
    }
    let result = run(&mesh, before as u64, Topology::Error);
    assert!(result.statistics.reached);
    let flat = result.mesh.triangles.iter().filter(|t| {
        let [a, b, c] = t.map(|v| result.mesh.positions[v as usize]);
        let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        n.iter().map(|x| x * x).sum::<f64>().sqrt() < 1e-9
    });
    assert_eq!(flat.count(), 0);
}

#[test]
fn subset_placement_keeps_input_vertices_bit_for_bit() {
    let mut mesh = sheet(40, |x, y| x > 30 && y > 30);
    mesh.n_channels = 2;
    mesh.channels = (0..2 * mesh.positions.len()).map(|i| (i as f32 * 0.37).sin()).collect();
    let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v % 97 == 0).collect();
    for placement in [Placement::Subset, Placement::Midpoint] {
        let options = Options { stop: Stop::Triangles(300), placement, ..Options::default() };
        let result = simplify_mesh(mesh.clone(), &locked, &options);
        assert!(result.statistics.reached);
        let moved = result.source.iter().enumerate().filter(|&(new, &old)| {
            result.mesh.positions[new] != mesh.positions[old as usize]
                || result.mesh.channels_of(new as u32) != mesh.channels_of(old)
        });
        assert_eq!(moved.count() == 0, placement == Placement::Subset);
    }
}
