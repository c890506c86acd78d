//! What the kernel does with meshes that are not clean, and how it stops.

use crate::common::meshes::{self, bumps, halves, squares};
use std::collections::{BTreeMap, BTreeSet};

use stonecut::Mesh;
use stonecut::kernel::{Options, Placement, Simplified, Stop, Topology, simplify_mesh};

/// A height field of `n` x `n` quads, the quads for which `is_hole` left out.
pub fn sheet(n: usize, is_hole: impl Fn(usize, usize) -> bool) -> Mesh {
    let mut mesh = meshes::sheet(n, |u, v| [u, v, bumps(u, v)]);
    let filled = squares(n, n).filter(|&(x, y)| !is_hole(x, y));
    mesh.triangles = halves(filled, |x, y| (y * (n + 1) + x) as u32);
    mesh
}

pub fn run(mesh: &Mesh, triangles: u64, topology: Topology) -> Simplified {
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
        mesh.triangles.extend(halves(squares(2 * n, 2 * n), at));
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
    let all = [
        "bound",
        "boundary",
        "flip",
        "link_condition",
        "locked",
        "non_manifold",
        "self_intersection",
        "sliver",
    ];
    assert_eq!(names, BTreeSet::from(all), "every refusal is named, also if it never came up");
    assert!(rejects["non_manifold"] > 0);
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
    meshes::torus(n, m, |_, _| radius)
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

/// The mesh in charts of texture: each has vertices of its own, the place in an image of its own, and the chart's number as
/// channels 0 to 2.
fn in_charts(mesh: &Mesh, chart: impl Fn([f64; 3]) -> u32) -> Mesh {
    let mut split = Mesh { n_channels: 3, ..Mesh::default() };
    let mut known = BTreeMap::new();
    for t in &mesh.triangles {
        let corners = t.map(|v| mesh.positions[v as usize]);
        let middle = [0, 1, 2].map(|k| corners.iter().map(|p| p[k]).sum::<f64>() / 3.0);
        let chart = chart(middle);
        split.triangles.push(t.map(|v| {
            *known.entry((chart, v)).or_insert_with(|| {
                let p = mesh.positions[v as usize];
                split.positions.push(p);
                split.channels.extend([p[0] as f32, p[1] as f32, chart as f32]);
                split.positions.len() as u32 - 1
            })
        }));
    }
    split
}

/// Simplifies a mesh in charts; no vertex of the result may belong to two charts, or two to one source.
fn run_charts(mesh: &Mesh, triangles: u64) -> Simplified {
    let options = Options {
        stop: Stop::Triangles(triangles),
        weights: vec![0.05, 0.05, 0.0],
        confined: vec![true; 3],
        region: Some(2),
        ..Options::default()
    };
    let result = simplify_mesh(mesh.clone(), &vec![false; mesh.positions.len()], &options);
    for t in &result.mesh.triangles {
        let chart = |v: u32| result.mesh.channels_of(v)[2];
        assert!(t.iter().all(|&v| chart(v) == chart(t[0])), "a triangle lies in one chart");
    }
    let sources: BTreeSet<u32> = result.source.iter().copied().collect();
    assert_eq!(sources.len(), result.source.len());
    result
}

/// The mesh with one vertex in each place.
fn in_one_chart(mesh: &Mesh) -> Mesh {
    let mut joined = Mesh::default();
    let mut known = BTreeMap::new();
    let place: Vec<u32> = (mesh.positions.iter())
        .map(|p| {
            *known.entry(p.map(f64::to_bits)).or_insert_with(|| {
                joined.positions.push(*p);
                joined.positions.len() as u32 - 1
            })
        })
        .collect();
    joined.triangles = mesh.triangles.iter().map(|t| t.map(|v| place[v as usize])).collect();
    joined
}

#[test]
fn a_thin_tube_with_seams_is_cut_and_stays_closed() {
    let turns = |p: [f64; 3]| (p[1].atan2(p[0]) * 4.0).floor() as i32;
    // Along the tube, so that every cut meets seams; and around it, too.
    let along = |p: [f64; 3]| u32::from(p[2] > 0.0);
    let both = |p: [f64; 3]| 2 * (turns(p) + 20) as u32 + u32::from(p[2] > 0.0);
    for chart in [&along as &dyn Fn([f64; 3]) -> u32, &both] {
        // A sheet gives up vertices that a cut may use again.
        let mut whole = torus(120, 4, 0.01);
        append(&mut whole, &sheet(24, |_, _| false), 1.0, [0.0, 0.0, 2.0]);
        let mesh = in_charts(&whole, chart);
        let result = run_charts(&mesh, 30);
        assert!(result.statistics.reached, "{} triangles", result.mesh.triangles.len());
        assert!(count(&result, "handles_cut") > 0);
        let welded = in_one_chart(&result.mesh);
        assert!(edges(&welded).values().all(|&n| n <= 2));
    }
}

#[test]
fn textured_sheets_that_touch_are_taken_apart() {
    // A chart may pass from one sheet to the other over the row that they share.
    for chart in [|p: [f64; 3]| u32::from(p[0] > 1.0), |p: [f64; 3]| u32::from(p[1] * p[2] > 0.0)] {
        let mesh = in_charts(&touching(10), chart);
        let result = run_charts(&mesh, 200);
        assert!(result.statistics.reached);
        assert!(count(&result, "vertices_split") > 0);
        let plain = run(&touching(10), 200, Topology::Error);
        // A collapse inside a sheet frees two triangles, one at its border one: either may be the last.
        assert!(plain.mesh.triangles.len().abs_diff(result.mesh.triangles.len()) <= 1);
    }
}

/// Adds a vertex in the middle between two; returns its number.
fn add_middle(mesh: &mut Mesh, a: u32, b: u32) -> u32 {
    let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
    mesh.positions.push([0, 1, 2].map(|k| 0.5 * (p[k] + q[k])));
    mesh.positions.len() as u32 - 1
}

#[test]
fn triangles_without_area_vanish_first() {
    // A vertex in the middle of an edge, so that the triangle over it has no area.
    let mut mesh = sheet(20, |_, _| false);
    let before = mesh.triangles.len();
    for i in (0..before).step_by(37) {
        let [a, b, c] = mesh.triangles[i];
        let middle = add_middle(&mut mesh, a, b);
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

fn count(result: &Simplified, name: &str) -> u64 {
    let found = result.statistics.changes.iter().find(|(known, _)| *known == name);
    found.unwrap_or_else(|| panic!("{name} is not counted")).1
}

/// Directed edges that more than one triangle has.
fn repeated_sides(mesh: &Mesh) -> usize {
    let mut seen = BTreeSet::new();
    let sides = mesh.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
    sides.filter(|&side| !seen.insert(side)).count()
}

#[test]
fn doubled_triangles_in_a_sheet_are_dropped_and_its_boundary_kept() {
    // Inside of a sheet, in one of two that are taken apart, turned over, and twice under other names.
    let sheet = sheet(12, |_, _| false);
    let mut touching = touching(6);
    let n = touching.triangles.len();
    let doubles = [touching.triangles[n / 4 - 3], touching.triangles[3 * n / 4 + 7]];
    let [a, b, c] = touching.triangles[20];
    touching.triangles.extend([doubles[0], doubles[1], doubles[1], [b, a, c]]);
    let mut inside = sheet.clone();
    let t = sheet.triangles[100];
    inside.triangles.extend([t, [t[1], t[2], t[0]], [t[1], t[0], t[2]]]);
    let first = inside.positions.len() as u32;
    // All of this one's corners are on the boundary: what is inside of a sheet is nobody's double.
    inside.positions.extend(sheet.triangles[2 * 11].map(|v| sheet.positions[v as usize]));
    inside.triangles.push([first, first + 1, first + 2]);
    for (mesh, doubled, clean) in [(touching, 4, n), (inside, 4, sheet.triangles.len())] {
        let cleaned = run(&mesh, u64::MAX, Topology::Error);
        assert_eq!(count(&cleaned, "duplicate_triangles_removed"), doubled);
        assert_eq!(cleaned.mesh.triangles.len(), clean);
        for triangles in [mesh.triangles.len() / 2, mesh.triangles.len() / 8] {
            let result = run(&mesh, triangles as u64, Topology::Error);
            assert!(result.statistics.reached);
            assert_eq!(n_edges(&result.mesh, |n| n > 2), 0);
            assert_eq!(repeated_sides(&result.mesh), 0);
        }
    }
    // Doubles of the index kind go under the strict policy, too.
    let mut mesh = sheet.clone();
    mesh.triangles.push([t[2], t[1], t[0]]);
    let kept = run(&mesh, u64::MAX, Topology::Keep);
    assert_eq!(count(&kept, "duplicate_triangles_removed"), 1);
    assert_eq!(kept.mesh.triangles.len(), sheet.triangles.len());
}

#[test]
fn bodies_that_touch_in_a_face_stay_closed() {
    // Two tetrahedra over one triangle, each with its own side of it.
    let up = |z: f64| [0.3, 0.3, z];
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], up(1.0), up(-1.0)];
    let mut mesh = Mesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    mesh.triangles.extend([[0, 1, 2], [1, 0, 4], [2, 1, 4], [0, 2, 4]]);
    let result = run(&mesh, u64::MAX, Topology::Keep);
    assert_eq!(count(&result, "duplicate_triangles_removed"), 0);
    assert_eq!(result.mesh.triangles.len(), 8);
    // A flap on one of them is another thing.
    mesh.triangles.push([1, 0, 3]);
    let result = run(&mesh, u64::MAX, Topology::Keep);
    assert_eq!(count(&result, "duplicate_triangles_removed"), 1);
    assert_eq!(result.mesh.triangles.len(), 8);
}

#[test]
fn a_fan_that_lost_a_double_is_no_longer_taken_for_closed() {
    // Around vertex 0 twice: the second turn has its first triangle in the place of that of the first turn.
    let at = |x: f64, y: f64, z: f64| [x, y, z];
    let positions = vec![
        at(0.0, 0.0, 0.0),
        at(1.0, 0.0, 0.0),
        at(0.0, 1.0, 0.0),
        at(-1.0, -1.0, 0.0),
        at(1.0, 0.0, 0.0),
        at(0.0, 1.0, 0.0),
        at(-1.0, -1.0, 0.5),
    ];
    let mesh = Mesh::new(positions, (1..=6).map(|i| [0, i, i % 6 + 1]).collect());
    for triangles in [u64::MAX, 4, 2] {
        let result = run(&mesh, triangles, Topology::Error);
        assert_eq!(repeated_sides(&result.mesh), 0);
        assert_eq!(n_edges(&result.mesh, |n| n > 2), 0);
    }
}

fn double_areas(mesh: &Mesh) -> Vec<f64> {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        n.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    mesh.triangles.iter().map(of).collect()
}

#[test]
fn triangles_without_area_are_cleaned_before_any_collapse() {
    // A vertex in the middle of an inner edge on one side of it only: the triangle between has no area. And one
    // on the outer boundary, whose longest edge is open.
    let mut mesh = sheet(20, |_, _| false);
    let clean = mesh.triangles.len();
    let n_flat = 5;
    for i in 0..n_flat {
        let edge = 2 * (20 * (3 * i + 2) + 7);
        // The diagonal of the quad: from corner 0 to corner 2 of its first triangle.
        let [a, b, c] = mesh.triangles[edge];
        let middle = add_middle(&mut mesh, a, c);
        mesh.triangles[edge] = [a, b, middle];
        mesh.triangles.extend([[middle, b, c], [a, middle, c]]);
    }
    let [a, b, c] = mesh.triangles[0];
    let middle = add_middle(&mut mesh, a, b);
    mesh.triangles[0] = [a, middle, c];
    mesh.triangles.extend([[middle, b, c], [a, b, middle]]);
    for topology in [Topology::Keep, Topology::Error] {
        let result = run(&mesh, u64::MAX, topology);
        assert_eq!(result.statistics.collapses, 0);
        assert_eq!(count(&result, "degenerate_triangles_removed"), n_flat as u64 + 1);
        assert_eq!(result.mesh.triangles.len(), clean + 2 * n_flat + 1);
        assert!(double_areas(&result.mesh).into_iter().all(|area| area > 1e-9));
        assert_eq!(n_edges(&result.mesh, |n| n == 1), 4 * 20 + 1);
        assert_eq!(n_edges(&result.mesh, |n| n > 2), 0);
    }
}

#[test]
fn triangles_without_area_that_hang_at_the_edges_of_a_closed_body_do_not_open_it() {
    let mut mesh = torus(60, 30, 0.3);
    let clean = mesh.triangles.len();
    for i in (0..clean).step_by(23) {
        let [a, b, _] = mesh.triangles[i];
        let middle = add_middle(&mut mesh, a, b);
        mesh.triangles.push([a, b, middle]);
    }
    for topology in [Topology::Keep, Topology::Error] {
        let result = run(&mesh, clean as u64 / 3, topology);
        assert!(result.statistics.reached);
        assert_eq!(n_edges(&result.mesh, |n| n != 2), 0);
    }
}

#[test]
fn sheets_with_a_gap_merge_if_it_is_within_the_distance() {
    // The right one has its boundary a gap of 0.004 away, and half as many vertices along it.
    let left = sheet(20, |_, _| false);
    let mut mesh = left.clone();
    let (first, n) = (left.positions.len() as u32, 10);
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (x as f64 / n as f64, y as f64 / n as f64);
            let z = left.positions[2 * y * 21 + 20][2];
            mesh.positions.push([1.004 + u, v, z * (1.0 - u)]);
        }
    }
    let at = |x: usize, y: usize| first + (y * (n + 1) + x) as u32;
    mesh.triangles.extend(halves(squares(n, n), at));
    let merged = |merge_distance: f64, triangles: u64, locked: bool| {
        let stop = Stop::Triangles(triangles);
        let options = Options { stop, merge_distance, ..Options::default() };
        let locked = vec![locked; mesh.positions.len()];
        let result = simplify_mesh(mesh.clone(), &locked, &options);
        let n_components = {
            let mut parent: Vec<usize> = (0..result.mesh.positions.len()).collect();
            let root = |parent: &[usize], mut v: usize| {
                while parent[v] != v {
                    v = parent[v];
                }
                v
            };
            for t in &result.mesh.triangles {
                for k in 0..2 {
                    let a = root(&parent, t[k] as usize);
                    let b = root(&parent, t[k + 1] as usize);
                    parent[a] = b;
                }
            }
            (0..parent.len()).filter(|&v| parent[v] == v).count()
        };
        assert_eq!(n_edges(&result.mesh, |n| n > 2), 0);
        (count(&result, "boundary_pairs_merged"), n_components, result)
    };
    assert_eq!(merged(0.0, 200, false).1, 2);
    assert_eq!(merged(0.003, 200, false).1, 2, "the gap is wider");
    assert_eq!(merged(0.005, 200, true).0, 0, "what is locked stays");
    let (n_pairs, n_components, result) = merged(0.005, 200, false);
    assert_eq!((n_pairs, n_components), (11, 1));
    assert!(result.statistics.reached);
    assert_eq!(merged(0.005, 200, false).2, result);
    // Not along the seam: only the outline of both together is open, once three-edge holes have closed.
    let open = edges(&result.mesh).into_iter().filter(|&(_, n)| n == 1);
    let inner = open.filter(|([a, b], _)| {
        let near = |v: u32| {
            let p = result.mesh.positions[v as usize];
            (0.9..1.1).contains(&p[0]) && (0.05..0.95).contains(&p[1])
        };
        near(*a) && near(*b)
    });
    assert_eq!(inner.count(), 0);
}

/// Connected components of a mesh, by shared vertices.
fn components(mesh: &Mesh) -> u64 {
    stonecut::mesh::topology_counts::of_triangles(mesh.positions.len(), &mesh.triangles).components
}

/// Joins the triangles of another mesh to a mesh, moved and scaled.
pub fn append(mesh: &mut Mesh, other: &Mesh, scale: f64, offset: [f64; 3]) {
    let first = mesh.positions.len() as u32;
    let moved = |p: &[f64; 3]| std::array::from_fn(|k| p[k] * scale + offset[k]);
    mesh.positions.extend(other.positions.iter().map(moved));
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
}

#[test]
fn a_neck_between_two_lobes_is_not_cut() {
    // A surface of revolution: two balls on one axis, joined by a neck of four sides that gets ever thinner.
    //   ( ball )=====neck=====( ball )
    let (n, m) = (80, 4);
    let mut mesh = Mesh::default();
    for i in 0..n {
        let x = i as f64 / (n - 1) as f64 * 6.0 - 3.0;
        let lobe = (1.0 - (x.abs() - 2.0).powi(2)).max(0.0).sqrt();
        let radius = lobe.max(0.02);
        for j in 0..m {
            let a = j as f64 * std::f64::consts::TAU / m as f64;
            mesh.positions.push([x, radius * a.cos(), radius * a.sin()]);
        }
    }
    let at = |i: usize, j: usize| (i * m + j % m) as u32;
    mesh.triangles.extend(halves(squares(m, n - 1).map(|(j, i)| (i, j)), at));
    for (i, turned) in [(0, false), (n - 1, true)] {
        for t in [[at(i, 0), at(i, 1), at(i, 2)], [at(i, 0), at(i, 2), at(i, 3)]] {
            mesh.triangles.push(if turned { [t[0], t[2], t[1]] } else { t });
        }
    }
    assert_eq!(components(&mesh), 1);
    for target in [300, 150, 80, 40] {
        let result = run(&mesh, target, Topology::Error);
        assert_eq!(components(&result.mesh), 1, "to {target}");
    }
}

#[test]
fn specks_do_not_take_the_triangles_of_the_surface() {
    // Three quarters of the triangles are tetrahedra, far smaller than a triangle of the result will be, in a
    // cloud above the sheet.
    let sheet = sheet(60, |_, _| false);
    let tetrahedron = Mesh {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        ..Mesh::default()
    };
    let mut mesh = sheet.clone();
    let side = 1e-5;
    for i in 0..5400 {
        let x = [0.754_877, 0.569_840, 0.430_16].map(|a| (f64::from(i) * a).fract());
        append(&mut mesh, &tetrahedron, side, [x[0], x[1], 0.05 + 0.1 * x[2]]);
    }
    let result = run(&mesh, 2000, Topology::Error);
    assert!(result.statistics.reached);
    let of_sheet = result.source.iter().filter(|&&v| (v as usize) < sheet.positions.len()).count();
    assert!(of_sheet > 900, "{of_sheet} vertices of the sheet for 2000 triangles");
}

/// Every ninth triangle the wrong way round: no collapse would be legal beside it.
#[test]
fn triangles_of_the_wrong_sense_are_turned() {
    let mut mesh = torus(60, 24, 0.4);
    let right = run(&mesh, 300, Topology::Keep);
    mesh.triangles.iter_mut().step_by(9).for_each(|t| t.swap(1, 2));
    let result = run(&mesh, 300, Topology::Keep);
    assert_eq!(count(&result, "triangles_turned"), mesh.triangles.len().div_ceil(9) as u64);
    assert_eq!(result.mesh.triangles.len(), right.mesh.triangles.len());
    let mut ways = BTreeSet::new();
    for t in &result.mesh.triangles {
        let sides = [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
        assert!(sides.into_iter().all(|side| ways.insert(side)), "{t:?} runs against a neighbour");
    }
}
