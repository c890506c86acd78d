//! Results that are printed or computed with: holes filled, sheets turned one way, nothing through itself.

use crate::common::{check, count, expect, glb_json, meshes, report, run, scratch, write_ply};
use std::collections::BTreeSet;
use stonecut::kernel::{Options, Stop, simplify_mesh};
use stonecut::measure::intersections::in_memory;
use stonecut::mesh::Mesh;
use stonecut::mesh::property::Scalar;
use stonecut::system::progress::Progress;

/// Sides of triangles without one that runs the other way, and pairs of triangles that meet.
fn faults(mesh: &Mesh) -> (usize, u64) {
    let sides: Vec<[u32; 2]> =
        mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    let all: BTreeSet<[u32; 2]> = sides.iter().copied().collect();
    assert_eq!(all.len(), sides.len());
    let n_open = sides.iter().filter(|[a, b]| !all.contains(&[*b, *a])).count();
    (n_open, in_memory(mesh, 1, &Progress::default()).unwrap().self_intersections)
}

fn volume(mesh: &Mesh) -> f64 {
    let at = |v: u32| mesh.positions[v as usize];
    let of = |&[a, b, c]: &[u32; 3]| {
        let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (at(a), at(b), at(c));
        ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    };
    mesh.triangles.iter().map(of).sum::<f64>() / 6.0
}

/// A tube with a wall, its ends open, so that each end has two loops in one plane.
///
/// ```text
///   .-----.
///  / .---. \
/// | |     | |    radii 1 and 0.6, height 2
///  \ '---' /
///   '-----'
/// ```
fn tube(n: usize, m: usize) -> Mesh {
    let mut positions = Vec::new();
    for radius in [1.0, 0.6] {
        for row in 0..=m {
            positions.extend((0..n).map(|k| {
                let (y, x) = (std::f64::consts::TAU * k as f64 / n as f64).sin_cos();
                [radius * x, radius * y, 2.0 * row as f64 / m as f64]
            }));
        }
    }
    let mut triangles = Vec::new();
    for wall in 0..2 {
        for (row, k) in (0..m).flat_map(|row| (0..n).map(move |k| (row, k))) {
            let at = |r: usize, k: usize| ((wall * (m + 1) + r) * n + k % n) as u32;
            let [a, b, c, d] = [at(row, k), at(row, k + 1), at(row + 1, k + 1), at(row + 1, k)];
            let halves = [[a, b, c], [a, c, d]];
            triangles.extend(halves.map(|[a, b, c]| if wall == 0 { [a, b, c] } else { [a, c, b] }));
        }
    }
    Mesh::new(positions, triangles)
}

#[test]
fn loops_within_loops_get_the_ring_between_them() {
    // By least area, and by ears.
    for n in [24, 90] {
        let mesh = tube(n, 12);
        let locked = vec![false; mesh.positions.len()];
        let to = |triangles: usize, close: f64| {
            let stop = Stop::Triangles(triangles as u64);
            simplify_mesh(mesh.clone(), &locked, &Options { stop, close, ..Options::default() })
        };
        let filled = to(mesh.triangles.len() + 4 * n, f64::INFINITY);
        assert_eq!(filled.mesh.triangles.len(), mesh.triangles.len() + 4 * n);
        assert_eq!(faults(&filled.mesh), (0, 0));
        let area = 0.5 * n as f64 * (std::f64::consts::TAU / n as f64).sin() * (1.0 - 0.36);
        assert!((volume(&filled.mesh) / (2.0 * area) - 1.0).abs() < 1e-9);
        let small = to(mesh.triangles.len() / 4, f64::INFINITY);
        assert_eq!(faults(&small.mesh), (0, 0));
        assert!(small.statistics.changes.contains(&("holes_filled", 4)));
        assert!(small.statistics.changes.contains(&("holes_left", 0)));
        // The inner loops alone, whose discs lie across the tube.
        let inner = to(mesh.triangles.len() / 2, 1.8);
        assert!(inner.statistics.changes.contains(&("holes_filled", 2)));
        assert!(inner.statistics.changes.contains(&("holes_left_large", 2)));
    }
}

/// A torus without every triangle that has a vertex whose number is a multiple of `every`.
fn holed(every: u32) -> Mesh {
    let mut mesh = meshes::torus(120, 60, |_, _| 0.5);
    mesh.triangles.retain(|t| t.iter().all(|v| v % every != 0));
    mesh
}

#[test]
fn holes_are_filled_through_cells_and_large_ones_named() {
    let at = &scratch();
    let mesh = holed(97);
    write_ply(&at.join("in.ply"), Scalar::F32, &mesh.positions, &mesh.triangles);
    assert!(count(&check(at, "in.ply"), "boundary_edges") > 300);
    for cells in ["", "--cell-triangles 2000"] {
        let words =
            format!("simplify in.ply out.ply --ratio 20% --close --report r.json --force {cells}");
        let told = expect(at, &words, 0);
        assert_eq!(count(&check(at, "out.ply"), "boundary_edges"), 0, "{cells}");
        let changes = &report(at)["changes"];
        assert!(count(changes, "holes_filled") > 50, "{changes}");
        assert_eq!(count(changes, "holes_left"), 0, "{cells}");
        assert!(told.contains("0 left"), "{told}");
    }
    expect(
        at,
        "simplify in.ply out.ply --ratio 20% --close=0.1% --topology keep --report r.json --force",
        0,
    );
    let changes = &report(at)["changes"];
    assert_eq!(count(changes, "holes_filled"), 0);
    assert!(count(changes, "holes_left_large") > 50);
    expect(at, "simplify in.ply out.ply --ratio 20% --close --max-error 1 --force", 2);
    expect(at, "simplify in.ply out.ply --ratio 20% --close=x --force", 2);
}

#[test]
fn for_print_stands_for_its_options() {
    let at = &scratch();
    let mut mesh = holed(89);
    // A speck.
    let n = mesh.positions.len() as u32;
    mesh.positions.extend([[9.0, 9.0, 9.0], [9.01, 9.0, 9.0], [9.0, 9.01, 9.0]]);
    mesh.triangles.push([n, n + 1, n + 2]);
    mesh.triangles.iter_mut().step_by(5).for_each(|t| t.swap(0, 1));
    write_ply(&at.join("in.ply"), Scalar::F32, &mesh.positions, &mesh.triangles);
    let same = "--close=all --orient --no-self-intersections --min-component size=1%";
    for (out, options) in [("a.ply", "--for print"), ("b.ply", same)] {
        expect(
            at,
            &format!("simplify in.ply {out} --ratio 10% {options} --report r.json --force"),
            0,
        );
    }
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(bytes("a.ply") == bytes("b.ply"));
    assert!(count(&report(at)["changes"], "triangles_turned") > 0);
    assert_eq!(count(&report(at)["changes"], "components_left_one_sided"), 0);
    let info = run(at, "info a.ply --check --self-intersections --json");
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    for key in ["self_intersections", "boundary_edges", "non_manifold_edges"] {
        assert_eq!(count(&info, key), 0, "{key}");
    }
    expect(at, "simplify in.ply c.ply --ratio 10% --for simulation", 0);
    expect(at, "simplify in.ply d.ply --ratio 10% --for print --method retile", 2);
}

#[test]
fn a_body_inside_out_is_turned_in_one_cell_and_said_in_many() {
    let at = &scratch();
    let mut mesh = meshes::torus(80, 50, |_, _| 0.3);
    if volume(&mesh) > 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    write_ply(&at.join("in.ply"), Scalar::F64, &mesh.positions, &mesh.triangles);
    let command = "simplify in.ply o.ply --ratio 100% --orient --force --report r.json";
    expect(at, command, 0);
    assert_eq!(count(&report(at)["solid"], "bodies_inside_out"), 0);
    // Its normals turn with it.
    expect(at, "simplify in.ply n.ply --ratio 100% --normals recompute", 0);
    expect(at, "simplify n.ply m.ply --ratio 100% --orient", 0);
    let source = stonecut::io::ply::MeshSource::open(&at.join("m.ply")).unwrap();
    let mut outermost = (0.0, 0.0);
    let each = |_: u64, record: &[u8]| {
        let x = source.schema().position(record)[0];
        let nx = record[source.schema().position_bytes()..].first_chunk().unwrap();
        if x > outermost.0 {
            outermost = (x, f32::from_le_bytes(*nx));
        }
        Ok(())
    };
    source.each_vertex(each).unwrap();
    assert!(outermost.1 > 0.9, "{outermost:?}");
    let said = expect(at, &format!("{command} --cell-triangles 1000"), 3);
    assert!(said.contains("1 closed bodies inside out"), "{said}");
    assert_eq!(report(at)["solid"]["met"], false);
}

#[test]
fn what_is_left_is_said_and_ends_with_code_3() {
    // Two rings through each other.
    let at = &scratch();
    let mut mesh = meshes::torus(40, 20, |_, _| 0.5);
    let (n, other) = (mesh.positions.len() as u32, mesh.clone());
    mesh.positions.extend(other.positions.iter().map(|[x, y, z]| [x + 1.2, *z, *y]));
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + n)));
    mesh.triangles.truncate(mesh.triangles.len() - 6);
    write_ply(&at.join("in.ply"), Scalar::F32, &mesh.positions, &mesh.triangles);
    let options = "--topology keep --no-self-intersections --report r.json --force -q";
    for out in ["out.ply", "out.glb"] {
        let told = expect(at, &format!("simplify in.ply {out} --ratio 50% {options}"), 3);
        assert!(told.contains("pairs of triangles that meet; ask for more triangles"), "{told}");
    }
    // Steps of 16 bits could let sheets meet.
    assert_eq!(glb_json(&at.join("out.glb"))["accessors"][0]["componentType"], 5126);
    let solid = &report(at)["solid"];
    assert!(count(solid, "self_intersections") > 20 && solid["met"] == false, "{solid}");
    assert!(count(solid, "open_edges") > 3 && count(solid, "open_loops") == 1, "{solid}");
    let close = "--topology keep --close=1% --report r.json --force";
    let told = expect(at, &format!("simplify in.ply out.ply --ratio 50% {close}"), 0);
    assert!(told.contains("give --close=all to fill"), "{told}");
    assert_eq!(count(&report(at)["solid"], "larger_holes"), 1);
    let info = run(at, "info out.ply --check").stdout;
    assert!(String::from_utf8_lossy(&info).contains("without area"));
}

#[test]
fn one_sided_components_are_counted() {
    let n = 60u32;
    let place = |v: u32| {
        let (k, side) = (v / 2, f64::from(v % 2) - 0.5);
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
        let (s, c) = (std::f64::consts::PI * f64::from(k) / f64::from(n)).sin_cos();
        [(2.0 + side * c) * cos, (2.0 + side * c) * sin, side * s]
    };
    let squares = (0..n).flat_map(|k| {
        let (a, b) = (2 * k, 2 * k + 1);
        let [c, d] = if k + 1 == n { [1, 0] } else { [a + 2, b + 2] };
        [[a, c, b], [b, c, d]]
    });
    let mesh = Mesh::new((0..2 * n).map(place).collect(), squares.collect());
    let locked = vec![false; mesh.positions.len()];
    let options = Options { stop: Stop::Triangles(60), orient: true, ..Options::default() };
    let changes = simplify_mesh(mesh, &locked, &options).statistics.changes;
    assert!(changes.contains(&("components_left_one_sided", 1)), "{changes:?}");
}

#[test]
fn what_meets_is_cut_out_and_closed() {
    // A spike through the other side of the tube, and one through a hole there, so that its filling would meet it.
    for has_hole in [false, true] {
        let mut mesh = meshes::torus(60, 30, |_, _| 0.5);
        let spike = (0..mesh.positions.len())
            .max_by(|&a, &b| mesh.positions[a][0].total_cmp(&mesh.positions[b][0]))
            .unwrap();
        mesh.positions[spike][0] -= 1.2;
        let tip = mesh.positions[spike];
        let middle = [tip[0] + 0.2, tip[1], tip[2]];
        let distance = |v: u32| {
            (0..3).map(|k| (mesh.positions[v as usize][k] - middle[k]).powi(2)).sum::<f64>()
        };
        if has_hole {
            let near: BTreeSet<u32> = (0..mesh.positions.len() as u32)
                .filter(|&v| v as usize != spike && distance(v) < 0.02)
                .collect();
            assert!(near.len() > 1);
            mesh.triangles.retain(|t| !t.iter().any(|v| near.contains(v)));
        }
        let (n_open, n_pairs) = faults(&mesh);
        assert_eq!((n_open > 0, n_pairs > 0), (has_hole, !has_hole));
        let locked = vec![false; mesh.positions.len()];
        let options = Options {
            stop: Stop::Triangles(3200),
            close: f64::INFINITY,
            no_self_intersections: true,
            ..Options::default()
        };
        let done = simplify_mesh(mesh, &locked, &options);
        assert_eq!(faults(&done.mesh), (0, 0), "{has_hole}");
    }
}

#[test]
fn bodies_that_cross_stay_whole() {
    // No cut at their seam can close both without taking most of them away.
    let mut mesh = meshes::torus(24, 12, |_, _| 0.5);
    let (n, other) = (mesh.positions.len() as u32, mesh.clone());
    mesh.positions.extend(other.positions.iter().map(|[x, y, z]| [x + 1.21, *z + 0.03, *y]));
    mesh.triangles.extend(other.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| v + n)));
    let (whole, locked) = (volume(&mesh), vec![false; mesh.positions.len()]);
    let options = Options {
        stop: Stop::Triangles(400),
        close: f64::INFINITY,
        no_self_intersections: true,
        ..Options::default()
    };
    let done = simplify_mesh(mesh, &locked, &options);
    assert!((volume(&done.mesh) / whole - 1.0).abs() < 0.05, "{}", volume(&done.mesh) / whole);
    assert!(faults(&done.mesh).1 > 0);
}

/// A unit cube of 12 n^2 triangles, welded, its least corner at `x` on the axis.
fn cube(n: u32, x: f64) -> Mesh {
    let mut numbers = std::collections::BTreeMap::new();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (axis, end) in (0..3).flat_map(|axis| [(axis, 0), (axis, n)]) {
        let mut at = |i: u32, k: u32| {
            let mut place = [0; 3];
            (place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3]) = (end, i, k);
            *numbers.entry(place).or_insert_with(|| {
                let place = place.map(|p| f64::from(p) / f64::from(n));
                positions.push([x + place[0], place[1], place[2]]);
                positions.len() as u32 - 1
            })
        };
        for (i, k) in (0..n).flat_map(|i| (0..n).map(move |k| (i, k))) {
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            let halves = [[a, b, c], [a, c, d]];
            triangles.extend(halves.map(|[a, b, c]| if end == 0 { [a, c, b] } else { [a, b, c] }));
        }
    }
    Mesh::new(positions, triangles)
}

#[test]
fn bodies_with_a_face_in_common_keep_their_volume() {
    // Every pair of the common face is a place to cut at; all cuts together take a hundredth at most.
    let (mut mesh, other) = (cube(16, 0.0), cube(16, 1.0));
    let n = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions);
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + n)));
    let locked = vec![false; mesh.positions.len()];
    let options = Options {
        stop: Stop::Triangles(3 * mesh.triangles.len() as u64 / 10),
        close: f64::INFINITY,
        no_self_intersections: true,
        ..Options::default()
    };
    let done = simplify_mesh(mesh, &locked, &options);
    assert!((volume(&done.mesh) / 2.0 - 1.0).abs() < 0.02, "{}", volume(&done.mesh));
}

#[test]
fn walls_that_two_bodies_have_twice_are_simplified_too() {
    // The copies have other diagonals, so every edge of the grid on the wall has four different triangles.
    let (mut mesh, other) = (cube(16, 0.0), cube(16, 1.0));
    let place = |[x, y, z]: &[f64; 3]| [*x, 1.0 - y, *z];
    let first = mesh.positions.clone();
    let found = |p: [f64; 3]| first.iter().position(|q| *q == p);
    let mut number = Vec::new();
    for p in other.positions.iter().map(place) {
        number.push(found(p).unwrap_or_else(|| {
            mesh.positions.push(p);
            mesh.positions.len() - 1
        }) as u32);
    }
    let turned = |&[a, b, c]: &[u32; 3]| [a, c, b].map(|v| number[v as usize]);
    mesh.triangles.extend(other.triangles.iter().map(turned));
    let locked = vec![false; mesh.positions.len()];
    let stop = Stop::Triangles(mesh.triangles.len() as u64 / 20);
    let done = simplify_mesh(mesh, &locked, &Options { stop, ..Options::default() });
    assert!((volume(&done.mesh) - 2.0).abs() < 0.01, "{}", volume(&done.mesh));
    assert!(done.mesh.triangles.len() < 310, "{}", done.mesh.triangles.len());
}

#[test]
fn sheets_that_touch_move_apart_and_crumbs_go() {
    // Two rings that touch in a corner of both, and a speck.
    let mut mesh = meshes::torus(40, 20, |_, _| 0.5);
    let (n, other) = (mesh.positions.len() as u32, mesh.clone());
    let most = other.positions.iter().map(|p| p[0]).fold(0.0, f64::max);
    mesh.positions.extend(other.positions.iter().map(|[x, y, z]| [2.0 * most - x, *y, *z]));
    mesh.triangles.extend(other.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| v + n)));
    let [o, x, y, z] = [[9.0, 9.0, 9.0], [9.1, 9.0, 9.0], [9.0, 9.1, 9.0], [9.0, 9.0, 9.1]];
    mesh.positions.extend([o, x, y, z]);
    let speck = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
    mesh.triangles.extend(speck.map(|t: [u32; 3]| t.map(|v| v + 2 * n)));
    let n_places = |mesh: &Mesh| {
        let places = mesh.positions.iter().map(|place| place.map(|x| (x as f32).to_bits()));
        places.collect::<BTreeSet<_>>().len()
    };
    assert_eq!(n_places(&mesh), mesh.positions.len() - 1);
    let locked = vec![false; mesh.positions.len()];
    let options = Options {
        stop: Stop::Triangles(mesh.triangles.len() as u64 - 20),
        close: f64::INFINITY,
        no_self_intersections: true,
        crumbs: 0.2,
        ..Options::default()
    };
    let done = simplify_mesh(mesh, &locked, &options);
    assert_eq!(n_places(&done.mesh), done.mesh.positions.len());
    assert_eq!(faults(&done.mesh), (0, 0));
    assert!(done.statistics.changes.contains(&("crumbs_removed", 1)));
}

#[test]
fn nothing_is_cut_out_of_a_ring_of_doubles_far_from_the_origin() {
    // As floats its vertices lie in a few places.
    let mut mesh = meshes::torus(40, 20, |_, _| 0.5);
    mesh.positions.iter_mut().for_each(|p| *p = p.map(|x| x + 1e7));
    let locked = vec![false; mesh.positions.len()];
    let options = Options {
        stop: Stop::Triangles(400),
        close: f64::INFINITY,
        no_self_intersections: true,
        ..Options::default()
    };
    let done = simplify_mesh(mesh, &locked, &options);
    assert!(done.statistics.changes.contains(&("triangles_cut_out", 0)));
    assert_eq!(done.mesh.triangles.len(), 400);
}

#[test]
fn coarse_floats_do_not_add_up() {
    // Steps of 1/32 between floats, edges of about 0.6.
    let off = 300_000.0;
    let mut mesh = meshes::torus(96, 48, |_, _| 0.5);
    let single = |x: f64| f64::from((8.0 * x + off) as f32);
    mesh.positions.iter_mut().for_each(|p| *p = p.map(single));
    let locked = vec![false; mesh.positions.len()];
    let away = |no_self_intersections: bool| {
        let stop = Stop::Triangles(mesh.triangles.len() as u64 / 10);
        let options = Options { stop, no_self_intersections, ..Options::default() };
        let done = simplify_mesh(mesh.clone(), &locked, &options).mesh;
        if no_self_intersections {
            assert!(done.positions.iter().flatten().all(|&x| f64::from(x as f32) == x));
            assert_eq!(faults(&done), (0, 0));
        }
        let from_ring = |p: &[f64; 3]| {
            let [x, y, z] = p.map(|x| (x - off) / 8.0);
            ((x.hypot(y) - 1.0).hypot(z) - 0.5).powi(2)
        };
        (done.positions.iter().map(from_ring).sum::<f64>() / done.positions.len() as f64).sqrt()
    };
    let (free, guarded) = (away(false), away(true));
    assert!(guarded < 1.5 * free, "{guarded} with the guard, {free} without");
}

#[test]
fn bodies_inside_out_are_turned_and_counted() {
    let mut mesh = meshes::torus(40, 20, |_, _| 0.5);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    assert!(volume(&mesh) < 0.0);
    let locked = vec![false; mesh.positions.len()];
    let options = Options { stop: Stop::Triangles(400), orient: true, ..Options::default() };
    let done = simplify_mesh(mesh, &locked, &options);
    assert!(volume(&done.mesh) > 0.0);
    assert!(done.statistics.changes.contains(&("bodies_turned", 1)));
}

/// The ring of a hub of thousands of triangles holds some that are gone.
#[test]
fn a_cone_of_thousands_of_triangles_is_tried_without_a_fault() {
    let at = &scratch();
    let n = 5000;
    let mut text = "v 0 0 1\n".to_owned();
    for i in 0..n {
        let (sin, cos) = (f64::from(i) / f64::from(n) * std::f64::consts::TAU).sin_cos();
        text += &format!("v {cos} {sin} 0\nf 1 {} {}\n", i + 2, (i + 1) % n + 2);
    }
    std::fs::write(at.join("in.obj"), text).unwrap();
    let code = run(at, "simplify in.obj out.ply --ratio 50% --for print").status.code();
    assert!(matches!(code, Some(0 | 3)), "{code:?}");
}
