//! Self-intersections: known cases, soups against exact clipping, cells against memory, threads, memory, the command.

use crate::common::meshes::soup;
use crate::common::{expect, run, scratch, write_ply};
use std::path::Path;
use stonecut::Mesh;
use stonecut::io::ply::MeshSource;
use stonecut::measure::check;
use stonecut::measure::intersections::{SelfIntersections, in_memory};
use stonecut::measure::temp_store::Cutting;
use stonecut::mesh::property::Scalar;
use stonecut::system::progress::Progress;

type Point = [f64; 3];

fn count(mesh: &Mesh) -> SelfIntersections {
    in_memory(mesh, 2, &Progress::default()).unwrap()
}

/// Pairs and overlaps among some triangles.
fn pairs(triangles: &[[Point; 3]]) -> (u64, u64) {
    let found = count(&soup(triangles));
    (found.self_intersections, found.coplanar_overlaps)
}

const FLOOR: [Point; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

#[test]
fn pairs_of_triangles_are_told_apart() {
    let cases: [(&str, [Point; 3], (u64, u64)); 21] = [
        ("crossing", [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]], (1, 0)),
        ("beside", [[3.0, 3.0, -1.0], [3.0, 3.0, 1.0], [9.0, 9.0, 0.5]], (0, 0)),
        ("above", [[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [1.0, 2.0, 2.0]], (0, 0)),
        ("a corner within", [[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [2.0, 1.0, 1.0]], (1, 0)),
        ("a corner on an edge", [[2.0, 2.0, 0.0], [3.0, 3.0, 1.0], [4.0, 3.0, 1.0]], (1, 0)),
        ("edges that cross", [[2.0, 2.0, -1.0], [2.0, 2.0, 1.0], [9.0, 9.0, 0.0]], (1, 0)),
        ("an edge within", [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 1.0]], (1, 0)),
        ("only a corner", [[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], (0, 0)),
        ("a corner, upright", [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -1.0, 1.0]], (0, 0)),
        ("a corner, across", [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]], (1, 0)),
        ("a corner, touching", [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, -1.0]], (1, 0)),
        ("a corner, along", [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, -1.0]], (1, 0)),
        ("a corner, along in plane", [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, -1.0, 0.0]], (1, 0)),
        ("a corner, opposite", [[0.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, -1.0, 0.0]], (0, 0)),
        ("a corner, on it", [[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [-1.0, 2.0, 0.0]], (1, 1)),
        ("a corner, within it", [[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [2.0, 1.0, 0.0]], (1, 1)),
        ("an edge", [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, 0.0, 1.0]], (0, 0)),
        ("an edge, flat", [[4.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, -1.0, 0.0]], (0, 0)),
        ("an edge, folded", [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 9.0, 0.0]], (1, 1)),
        ("the same, turned over", [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [4.0, 0.0, 0.0]], (1, 1)),
        ("in plane, touching", [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [2.0, -1.0, 0.0]], (1, 0)),
    ];
    for (name, triangle, wanted) in cases {
        for turn in 0..3 {
            let mut other = triangle;
            other.rotate_left(turn);
            assert_eq!(pairs(&[FLOOR, other]), wanted, "{name}, turned {turn}");
            other.swap(0, 1);
            assert_eq!(pairs(&[other, FLOOR]), wanted, "{name}, turned {turn}, mirrored");
            assert_eq!(exact(&FLOOR, &other), wanted, "{name} by clipping");
        }
    }
    let overlap = [[1.0, 1.0, 0.0], [9.0, 1.0, 0.0], [1.0, 9.0, 0.0]];
    assert_eq!(pairs(&[FLOOR, overlap]), (1, 1));
    let apart = [[3.0, 3.0, 0.0], [9.0, 3.0, 0.0], [3.0, 9.0, 0.0]];
    assert_eq!(pairs(&[FLOOR, apart]), (0, 0));
}

/// A corner next to a slanted plane, by units in the last place; rounding gets half of these wrong.
#[test]
fn the_last_bit_decides() {
    let wall = [[24.0, 24.0, 0.0], [-30.0, -30.0, 7.0], [-30.0, -30.0, -7.0]];
    let place = |i: i32| 0.5 + f64::from(i) * f64::EPSILON / 2.0;
    for (i, j) in (0..256).map(|n| (n % 16, n / 16)) {
        let tip = [place(i), place(j), 0.0];
        let touches = u64::from(i <= j);
        for scale in [1.0, 2f64.powi(900), 2f64.powi(-900)] {
            let spike = [tip, [3.0, -3.0, 1.0], [3.0, -3.0, -1.0]];
            let both = [wall, spike].map(|t| t.map(|p| p.map(|x| x * scale)));
            assert_eq!(pairs(&both), (touches, 0), "{i} {j} {scale:e}");
        }
    }
}

#[test]
fn triangles_without_area_are_left_out() {
    let line = [[-1.0, 1.0, -1.0], [1.0, 1.0, 0.0], [3.0, 1.0, 1.0]];
    let point = [[1.0, 1.0, 0.0]; 3];
    let found = count(&soup(&[FLOOR, line, point]));
    assert_eq!((found.self_intersections, found.collinear_triangles), (0, 2));
    assert_eq!(count(&Mesh::default()), SelfIntersections::default());
}

/// A closed box of n x n squares a side, each side with vertices that no other side uses.
fn unwelded_box(n: u32, low: Point, high: Point) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for end in [0, n] {
            let first = positions.len() as u32;
            for (i, j) in (0..(n + 1).pow(2)).map(|k| (k % (n + 1), k / (n + 1))) {
                let mut place = [end; 3];
                (place[(axis + 1) % 3], place[(axis + 2) % 3]) = (i, j);
                positions.push(
                    [0, 1, 2]
                        .map(|k| low[k] + (high[k] - low[k]) * f64::from(place[k]) / f64::from(n)),
                );
            }
            for (i, j) in (0..n.pow(2)).map(|k| (k % n, k / n)) {
                let at = |i, j| first + j * (n + 1) + i;
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    Mesh::new(positions, triangles)
}

fn joined(a: &Mesh, b: &Mesh) -> Mesh {
    let n = a.positions.len() as u32;
    let moved = b.triangles.iter().map(|t| t.map(|v| v + n));
    let triangles = a.triangles.iter().copied().chain(moved).collect();
    Mesh::new([&a.positions[..], &b.positions].concat(), triangles)
}

fn sphere(n: u32, centre: Point, radius: f64) -> Mesh {
    let mut mesh = unwelded_box(n, [-1.0; 3], [1.0; 3]);
    for p in &mut mesh.positions {
        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        *p = [0, 1, 2].map(|k| centre[k] + radius * p[k] / length);
    }
    mesh
}

/// All pairs of a mesh, decided two by two: the same predicate, without trees.
fn two_by_two(mesh: &Mesh) -> SelfIntersections {
    let n = mesh.triangles.len();
    let (mut sum, mut is_in) = (SelfIntersections::default(), vec![false; n]);
    let corners: Vec<_> = (0..n).map(|i| mesh.corners(i)).collect();
    for i in 0..n {
        for j in 0..i {
            let apart = (0..3).any(|k| {
                let side = |t: usize, pick: fn(f64, f64) -> f64| {
                    pick(pick(corners[t][0][k], corners[t][1][k]), corners[t][2][k])
                };
                side(i, f64::max) < side(j, f64::min) || side(j, f64::max) < side(i, f64::min)
            });
            if apart {
                continue;
            }
            let (pairs, overlaps) = pairs(&[corners[i], corners[j]]);
            sum.self_intersections += pairs;
            sum.coplanar_overlaps += overlaps;
            is_in[i] |= pairs > 0;
            is_in[j] |= pairs > 0;
        }
    }
    sum.self_intersecting_triangles = is_in.iter().filter(|&&is| is).count() as u64;
    sum
}

#[test]
fn sound_surfaces_have_none_and_spheres_what_all_pairs_say() {
    for n in [1, 2, 9] {
        assert_eq!(
            count(&unwelded_box(n, [0.0; 3], [1.0, 2.0, 3.0])),
            SelfIntersections::default()
        );
    }
    let one = sphere(12, [0.0; 3], 1.0);
    assert_eq!(count(&one), SelfIntersections::default());
    let both = joined(&one, &sphere(11, [0.7, 0.2, 0.1], 1.0));
    let found = count(&both);
    assert_eq!(found, two_by_two(&both));
    assert!(found.self_intersections > 50 && found.coplanar_overlaps == 0, "{found:?}");
    // The same sphere twice: every triangle lies on its double.
    let twice = count(&joined(&one, &one));
    let n = one.triangles.len() as u64;
    assert_eq!((twice.coplanar_overlaps, twice.self_intersecting_triangles), (n, 2 * n));
}

/// A generator of numbers below `n`.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % n
    }

    fn unit(&mut self) -> f64 {
        self.roll(1 << 30) as f64 / (1u64 << 30) as f64
    }
}

/// A point with integer coordinates over a common divisor.
type Ratio = [i128; 4];

fn reduced(p: Ratio) -> Ratio {
    fn divisor(a: i128, b: i128) -> i128 {
        if b == 0 { a.abs() } else { divisor(b, a % b) }
    }
    let common = p.into_iter().fold(0, divisor) * if p[3] < 0 { -1 } else { 1 };
    p.map(|x| x / common)
}

/// What is left of a convex polygon where `plane` is not negative.
fn clip(polygon: &[Ratio], plane: Ratio) -> Vec<Ratio> {
    let height = |p: &Ratio| (0..4).map(|k| plane[k] * p[k]).sum::<i128>();
    let mut out = Vec::new();
    for (i, p) in polygon.iter().enumerate() {
        let q = &polygon[(i + 1) % polygon.len()];
        let (a, b) = (height(p), height(q));
        if a >= 0 {
            out.push(*p);
        }
        if (a < 0 && b > 0) || (a > 0 && b < 0) {
            out.push(reduced([0, 1, 2, 3].map(|k| (p[k] * b - q[k] * a) * b.signum())));
        }
    }
    out.dedup();
    out
}

fn minus(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

fn cross(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

fn plane(normal: [i128; 3], through: [i128; 3]) -> Ratio {
    let [x, y, z] = normal;
    [x, y, z, -(0..3).map(|k| normal[k] * through[k]).sum::<i128>()]
}

/// Pairs and overlaps of two triangles with integer corners, by clipping one against the other in rational numbers.
fn exact(a: &[Point; 3], b: &[Point; 3]) -> (u64, u64) {
    let whole = |t: &[Point; 3]| t.map(|p| p.map(|x| x as i128));
    let (a, b) = (whole(a), whole(b));
    let normal = |t: [[i128; 3]; 3]| cross(minus(t[1], t[0]), minus(t[2], t[0]));
    let up = normal(b);
    if normal(a) == [0; 3] || up == [0; 3] {
        return (0, 0);
    }
    let mut left: Vec<Ratio> = a.map(|[x, y, z]| [x, y, z, 1]).to_vec();
    left = clip(&left, plane(up, b[0]));
    left = clip(&left, plane(up.map(|x| -x), b[0]));
    for i in 0..3 {
        left = clip(&left, plane(cross(up, minus(b[(i + 1) % 3], b[i])), b[i]));
    }
    let distinct = |p: &Ratio, q: &Ratio| (0..3).any(|k| p[k] * q[3] != q[k] * p[3]);
    let shared: Vec<Ratio> =
        a.iter().filter(|p| b.contains(p)).map(|&[x, y, z]| [x, y, z, 1]).collect();
    let direction = |p: &Ratio, q: &Ratio| [0, 1, 2].map(|k| q[k] * p[3] - p[k] * q[3]);
    let is_area = left.len() > 2
        && left.iter().any(|p| {
            left.iter().any(|q| cross(direction(&left[0], p), direction(&left[0], q)) != [0; 3])
        });
    let is_elsewhere = match &shared[..] {
        [] => !left.is_empty(),
        [p] => left.iter().any(|q| distinct(p, q)),
        [p, q] => left.iter().any(|r| cross(direction(p, q), direction(p, r)) != [0; 3]),
        _ => true,
    };
    (u64::from(is_elsewhere), u64::from(is_area))
}

#[test]
fn soups_on_a_coarse_grid_agree_with_clipping_in_rational_numbers() {
    let mut dice = Dice(7);
    let (mut all, mut overlaps, mut shared) = (0, 0, 0);
    for round in 0..40u64 {
        // Coarse grids make corners, edges and planes coincide.
        let size = 2 + round % 5;
        let depth = if round % 3 == 0 { 1 } else { size };
        let triangles: Vec<[Point; 3]> = (0..40)
            .map(|_| [(); 3].map(|()| [size, size, depth].map(|n| dice.roll(n) as f64)))
            .collect();
        let mut wanted = SelfIntersections::default();
        let mut is_in = vec![false; triangles.len()];
        for i in 0..triangles.len() {
            for j in 0..i {
                let (pair, overlap) = exact(&triangles[i], &triangles[j]);
                assert_eq!(pairs(&[triangles[i], triangles[j]]), (pair, overlap), "{triangles:?}");
                assert_eq!(exact(&triangles[j], &triangles[i]), (pair, overlap));
                wanted.self_intersections += pair;
                wanted.coplanar_overlaps += overlap;
                is_in[i] |= pair > 0;
                is_in[j] |= pair > 0;
                let n = triangles[i].iter().filter(|p| triangles[j].contains(p)).count();
                shared += usize::from(n > 0 && pair == 1);
            }
        }
        wanted.self_intersecting_triangles = is_in.iter().filter(|&&is| is).count() as u64;
        let found = count(&soup(&triangles));
        wanted.collinear_triangles = found.collinear_triangles;
        assert_eq!(found, wanted);
        all += wanted.self_intersections;
        overlaps += wanted.coplanar_overlaps;
    }
    assert!(all > 5000 && overlaps > 500 && shared > 500, "{all} {overlaps} {shared}");
}

fn write(mesh: &Mesh, path: &Path) {
    write_ply(path, Scalar::F64, &mesh.positions, &mesh.triangles);
}

/// A rough sheet with a tube through it and a few triangles across everything, in a shuffled order of vertices.
fn scene(dice: &mut Dice) -> Mesh {
    let mut mesh = unwelded_box(30, [0.0; 3], [8.0, 6.0, 1.0]);
    mesh.positions.iter_mut().flatten().for_each(|x| *x += 0.1 * dice.unit());
    mesh = joined(&mesh, &sphere(20, [4.0, 3.0, 0.5], 1.1));
    let far = |dice: &mut Dice| [9.0 * dice.unit(), 7.0 * dice.unit(), 2.0 * dice.unit() - 0.5];
    let large: Vec<[Point; 3]> = (0..12).map(|_| [(); 3].map(|()| far(dice))).collect();
    shuffled(&joined(&mesh, &soup(&large)), dice)
}

fn shuffled(mesh: &Mesh, dice: &mut Dice) -> Mesh {
    let n = mesh.positions.len();
    let mut places: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        places.swap(i, dice.roll(i as u64 + 1) as usize);
    }
    let mut positions = mesh.positions.clone();
    for (i, &place) in places.iter().enumerate() {
        positions[place as usize] = mesh.positions[i];
    }
    let triangles = mesh.triangles.iter().map(|t| t.map(|v| places[v as usize])).collect();
    Mesh::new(positions, triangles)
}

/// Counts in cells of about `cell_triangles`.
fn in_cells(
    path: &Path,
    cell_triangles: u64,
    threads: usize,
    memory_bytes: u64,
) -> SelfIntersections {
    let source = MeshSource::open(path).unwrap();
    let temp_dir = path.parent().unwrap();
    let cutting = Cutting { cell_triangles, temp_dir, threads, memory_bytes, disk: None };
    let checked = check::check(&source, cutting, true, &Progress::default()).unwrap();
    checked.intersections.unwrap()
}

#[test]
fn cells_threads_and_memory_do_not_show() {
    let folder = tempfile::tempdir().unwrap();
    let mut dice = Dice(3);
    // In the second one nearly all triangles are large against their cells, so that they come in batches.
    let needles: Vec<[Point; 3]> = (0..600)
        .map(|_| {
            let middle = [(); 3].map(|()| 6.0 * dice.unit());
            [(); 3].map(|()| middle.map(|x| x + 3.0 * dice.unit()))
        })
        .collect();
    // In the third one cells lie on each other, in planes, with corners in the same places.
    let planes: Vec<[Point; 3]> =
        (0..300).map(|_| [(); 3].map(|()| [9, 9, 2].map(|n| dice.roll(n) as f64))).collect();
    for (name, mesh, is_whole) in [
        ("scene", scene(&mut dice), false),
        ("needles", soup(&needles), true),
        ("planes", soup(&planes), true),
    ] {
        let path = folder.path().join(format!("{name}.ply"));
        write(&mesh, &path);
        let wanted = count(&mesh);
        assert!(wanted.self_intersections > 500, "{name}: {wanted:?}");
        if is_whole {
            let all = SelfIntersections {
                collinear_triangles: wanted.collinear_triangles,
                ..two_by_two(&mesh)
            };
            assert_eq!(wanted, all, "{name}");
        }
        for threads in [1, 3] {
            assert_eq!(in_memory(&mesh, threads, &Progress::default()).unwrap(), wanted);
        }
        for (cell_triangles, threads, memory) in
            [(300, 1, 1 << 30), (300, 3, 1 << 30), (40, 2, 1 << 16), (2000, 2, 1 << 16)]
        {
            let found = in_cells(&path, cell_triangles, threads, memory);
            assert_eq!(found, wanted, "{name} in cells of {cell_triangles}, {memory} bytes");
        }
    }
}

#[test]
fn the_command_counts_only_when_asked_to() {
    let at = &scratch();
    let both = joined(&sphere(30, [0.0; 3], 1.0), &sphere(31, [0.7, 0.2, 0.1], 1.0));
    write(&both, &at.join("in.ply"));
    let wanted = count(&both);
    let printed = |arguments: &str| {
        let output = run(at, arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    for memory in ["1GiB", "300k"] {
        let options = format!("--check --self-intersections --memory {memory} --json");
        let json: serde_json::Value =
            serde_json::from_str(&printed(&format!("info in.ply {options}"))).unwrap();
        let key = |name: &str| json[name].as_u64().unwrap();
        assert_eq!(key("self_intersections"), wanted.self_intersections);
        assert_eq!(key("self_intersecting_triangles"), wanted.self_intersecting_triangles);
        assert_eq!((key("coplanar_overlaps"), key("collinear_triangles")), (0, 0));
    }
    assert!(!printed("info in.ply --check --json").contains("intersect"));
    let table = printed("info in.ply --check --self-intersections");
    let line = format!("{} pairs of triangles", wanted.self_intersections);
    assert!(table.contains(&line), "{table}");
    expect(at, "info in.ply --self-intersections", 2);
}

/// Small nasty meshes whose triangles must not meet more often than before.
#[test]
fn the_kernel_lets_no_more_pairs_meet() {
    use crate::nasty::{case::Case, choices::Choices, judge::Depth, verdict};
    let mut n = 0;
    for seed in 0..1500 {
        let case = Case::new(&mut Choices::from_seed(seed));
        if case.options.no_self_intersections {
            n += 1;
            let outcome = verdict(&case, Depth::OneRun);
            assert!(outcome.is_ok(), "seed {seed}: {:?}", outcome.err());
        }
    }
    assert!(n > 100, "{n} cases");
}
