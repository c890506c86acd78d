//! Building blocks: surfaces whose topology is known, open and closed, one-sided, with handles, hubs and books.

use super::choices::Choices;
use stonecut::mesh::Mesh;

type Faces = Vec<[u32; 3]>;

/// Adds a block somewhere; most are small.
pub fn add(mesh: &mut Mesh, choices: &mut Choices) {
    let (mut points, faces) = match choices.below(19) {
        0 => (vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]),
        1 => grid(choices, false, false, 1.0),
        2 => grid(choices, true, false, 1.0),
        3 => grid(choices, true, true, 1.0),
        4 => moebius(choices),
        5 => tetrahedron(),
        6 => pillow(choices),
        7 => octahedron(),
        8 => cube(),
        9 => hub(choices, false),
        10 => hub(choices, true),
        11 => book(choices),
        12 => bow_tie(choices),
        13 => soup(choices),
        14 => box_with_handle(choices),
        15 => needle_row(choices),
        16 => double_sheet(choices),
        17 => grid(choices, true, false, 0.05),
        _ => grid(choices, false, false, 0.0),
    };
    // Coarse places, so that blocks touch.
    let size = choices.of(&[1.0, 1.0, 1.0, 0.25, 4.0, 1.0 / 64.0]);
    let at: [f64; 3] = std::array::from_fn(|_| choices.below(4) as f64);
    let turn = choices.below(3);
    for p in &mut points {
        p.rotate_left(turn);
        *p = std::array::from_fn(|k| p[k] * size + at[k]);
    }
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(points);
    mesh.triangles.extend(faces.into_iter().map(|t| t.map(|v| v + first)));
}

/// A grid of quads; a tube if it is `round`, a torus if it is `closed` too. `depth` scales bumps, or the
/// radius of a tube.
fn grid(choices: &mut Choices, round: bool, closed: bool, depth: f64) -> (Vec<[f64; 3]>, Faces) {
    let least = |wraps: bool| if wraps { 3 } else { 1 };
    let (n, m) = (choices.within(least(closed)..7), choices.within(least(round)..7));
    let is_bumpy = choices.one_in(2);
    let (rows, columns) = (n + usize::from(!closed), m + usize::from(!round));
    let mut points = Vec::new();
    for i in 0..rows {
        for j in 0..columns {
            let bump = if is_bumpy { 0.3 * choices.unit() } else { 0.0 };
            let (s, t) = (i as f64 / n as f64, j as f64 / m as f64);
            let (a, b) = (std::f64::consts::TAU * s, std::f64::consts::TAU * t);
            points.push(match (round, closed) {
                (false, _) => [s, t, depth * bump],
                (true, false) => {
                    let r = depth * (0.5 + bump);
                    [r * b.cos(), r * b.sin(), s]
                }
                (true, true) => {
                    let r = 0.3 + 0.3 * bump;
                    [(1.0 + r * b.cos()) * a.cos(), (1.0 + r * b.cos()) * a.sin(), r * b.sin()]
                }
            });
        }
    }
    let at = |i: usize, j: usize| (i % rows * columns + j % columns) as u32;
    let mut faces = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            match is_bumpy && (i + j) % 2 == 1 {
                true => faces.extend([[a, b, d], [b, c, d]]),
                false => faces.extend([[a, b, c], [a, c, d]]),
            }
        }
    }
    (points, faces)
}

fn moebius(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let n = choices.within(3..9);
    let mut points = Vec::new();
    for i in 0..n {
        let a = std::f64::consts::TAU * i as f64 / n as f64;
        for side in [-0.3, 0.3] {
            let r = 1.0 + side * (a / 2.0).cos();
            points.push([r * a.cos(), r * a.sin(), side * (a / 2.0).sin()]);
        }
    }
    let mut faces = Vec::new();
    for i in 0..n {
        // The last quad joins the sides crosswise.
        let (a, b) = (2 * i as u32, 2 * i as u32 + 1);
        let (c, d) = if i + 1 == n { (1, 0) } else { (a + 2, b + 2) };
        faces.extend([[a, c, b], [b, c, d]]);
    }
    (points, faces)
}

fn tetrahedron() -> (Vec<[f64; 3]>, Faces) {
    let points = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (points, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
}

/// Two triangles, or two fans, back to back over the same edges.
fn pillow(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let points = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.25]];
    if choices.one_in(2) {
        return (points[..3].to_vec(), vec![[0, 1, 2], [0, 2, 1]]);
    }
    (points, vec![[0, 1, 2], [1, 3, 2], [0, 2, 1], [1, 2, 3]])
}

fn octahedron() -> (Vec<[f64; 3]>, Faces) {
    let points = (0..6).map(|i| {
        let mut p = [0.0; 3];
        p[i / 2] = if i % 2 == 0 { 1.0 } else { -1.0 };
        p
    });
    let faces = (0..8u32).map(|i| {
        let t = [i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2 & 1)];
        if i.count_ones() % 2 == 0 { t } else { [t[0], t[2], t[1]] }
    });
    (points.collect(), faces.collect())
}

fn cube() -> (Vec<[f64; 3]>, Faces) {
    let points = (0..8).map(|i| [0, 1, 2].map(|k| f64::from(i >> k & 1))).collect();
    let quads: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    (points, faces.collect())
}

/// A fan around one vertex, or a double cone.
fn hub(choices: &mut Choices, closed: bool) -> (Vec<[f64; 3]>, Faces) {
    let most = if choices.one_in(50) { 230 } else { 14 };
    let n = choices.within(3..most) as u32;
    let gap = u32::from(!closed && choices.one_in(2));
    let mut points = vec![[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]];
    for i in 0..n {
        let a = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        points.push([a.cos(), a.sin(), 0.0]);
    }
    let at = |i: u32| 2 + i % n;
    let mut faces: Faces = (0..n - gap).map(|i| [0, at(i), at(i + 1)]).collect();
    if closed {
        faces.extend((0..n).map(|i| [1, at(i + 1), at(i)]));
    }
    (points, faces)
}

/// Several triangles on one edge.
fn book(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let n = choices.within(3..7) as u32;
    let mut points = vec![[0.0; 3], [0.0, 0.0, 1.0]];
    for i in 0..n {
        points.push([f64::from(i).cos(), f64::from(i).sin(), 0.5]);
    }
    (points, (0..n).map(|i| if i % 2 == 0 { [0, 1, 2 + i] } else { [1, 0, 2 + i] }).collect())
}

/// Fans that meet in one vertex.
fn bow_tie(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let n = choices.within(2..5) as u32;
    let mut points = vec![[0.0; 3]];
    let mut faces = Vec::new();
    for fan in 0..n {
        let first = points.len() as u32;
        for i in 0..3 {
            let a = f64::from(fan) * 1.7 + f64::from(i) * 0.4;
            points.push([a.cos(), a.sin(), f64::from(fan)]);
        }
        faces.extend([[0, first, first + 1], [0, first + 1, first + 2]]);
        if choices.one_in(2) {
            faces.extend([[0, first + 2, first], [first, first + 2, first + 1]]);
        }
    }
    (points, faces)
}

fn soup(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let n = choices.within(3..9);
    let points = (0..n).map(|_| std::array::from_fn(|_| choices.below(4) as f64)).collect();
    let faces =
        (0..choices.within(1..16)).map(|_| std::array::from_fn(|_| choices.below(n) as u32));
    (points, faces.collect())
}

/// A thin closed strip bent to a ring: a torus of three edges around, or a longer prism with open ends.
fn box_with_handle(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let n = choices.within(3..12) as u32;
    let radius = choices.of(&[0.1, 0.01, 0.4]);
    let is_ring = choices.one_in(2);
    let mut points = Vec::new();
    for i in 0..n {
        let a = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        for k in 0..3 {
            let b = std::f64::consts::TAU * f64::from(k) / 3.0;
            let r = 1.0 + radius * b.cos();
            points.push(match is_ring {
                true => [r * a.cos(), r * a.sin(), radius * b.sin()],
                false => [f64::from(i), radius * b.cos(), radius * b.sin()],
            });
        }
    }
    let mut faces = Vec::new();
    for i in 0..n - u32::from(!is_ring) {
        for k in 0..3 {
            let (a, b) = (3 * i + k, 3 * i + (k + 1) % 3);
            let (c, d) = (3 * ((i + 1) % n) + k, 3 * ((i + 1) % n) + (k + 1) % 3);
            faces.extend([[a, c, b], [b, c, d]]);
        }
    }
    (points, faces)
}

/// Triangles of no or nearly no height in a row.
fn needle_row(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let n = choices.within(3..10) as u32;
    let height = choices.of(&[0.0, 1e-12, 1e-4]);
    let points = (0..n).map(|i| [f64::from(i), if i % 2 == 0 { 0.0 } else { height }, 0.0]);
    (points.collect(), (0..n - 2).map(|i| [i, i + 1 + i % 2, i + 2 - i % 2]).collect())
}

/// Two parallel sheets close to each other that share some vertices.
fn double_sheet(choices: &mut Choices) -> (Vec<[f64; 3]>, Faces) {
    let (mut points, mut faces) = grid(choices, false, false, 1.0);
    let (n, gap) = (points.len() as u32, choices.of(&[0.0, 1e-3]));
    let is_shared: Vec<bool> = points.iter().map(|_| choices.one_in(4)).collect();
    points.extend(points.clone().iter().map(|p| [p[0], p[1], p[2] - gap]));
    let other = |v: u32| if is_shared[v as usize] { v } else { v + n };
    faces.extend(faces.clone().into_iter().map(|[a, b, c]| [other(a), other(c), other(b)]));
    (points, faces)
}
