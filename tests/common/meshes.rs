//! Meshes that several tests are made of, and PLY files as text.

use stonecut::Mesh;

/// The squares of a grid: `x` from 0 to `n`, faster than `y` from 0 to `m`.
pub fn squares(n: usize, m: usize) -> impl Iterator<Item = (usize, usize)> + Clone {
    (0..m).flat_map(move |y| (0..n).map(move |x| (x, y)))
}

/// Two triangles for each square, along the same diagonal; `at` numbers its corners.
pub fn halves(
    squares: impl Iterator<Item = (usize, usize)>,
    at: impl Fn(usize, usize) -> u32,
) -> Vec<[u32; 3]> {
    let halves = |(x, y)| {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        [[a, b, c], [a, c, d]]
    };
    squares.flat_map(halves).collect()
}

/// The triangles of `n` by `n` squares, whose vertices are in rows.
pub fn sheet_triangles(n: usize) -> Vec<[u32; 3]> {
    halves(squares(n, n), |x, y| (y * (n + 1) + x) as u32)
}

/// `n` by `n` squares over the unit square.
pub fn sheet(n: usize, place: impl Fn(f64, f64) -> [f64; 3]) -> Mesh {
    let share = |i: usize| i as f64 / n as f64;
    let positions = squares(n + 1, n + 1).map(|(x, y)| place(share(x), share(y)));
    Mesh::new(positions.collect(), sheet_triangles(n))
}

/// The height of a bumpy sheet.
pub fn bumps(u: f64, v: f64) -> f64 {
    0.05 * (11.0 * u).sin() * (7.0 * v).cos() + 0.01 * (53.0 * u * v).sin()
}

/// A tube of `n` by `m` squares around a ring; `radius` by the angles around the axis and around the ring.
pub fn torus(n: usize, m: usize, radius: impl Fn(f64, f64) -> f64) -> Mesh {
    let turn = |i: usize, n: usize| i as f64 * (std::f64::consts::TAU / n as f64);
    let positions = squares(m, n).map(|(j, i)| {
        let (a, b) = (turn(i, n), turn(j, m));
        let r = radius(a, b);
        let ring = 1.0 + r * b.cos();
        [ring * a.cos(), ring * a.sin(), r * b.sin()]
    });
    let places = squares(m, n).map(|(j, i)| (i, j));
    Mesh::new(positions.collect(), halves(places, |i, j| ((i % n) * m + j % m) as u32))
}

/// Triangles without a common vertex.
pub fn soup(triangles: &[[[f64; 3]; 3]]) -> Mesh {
    let corners = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    Mesh::new(triangles.concat(), corners.collect())
}

/// An ASCII PLY with float coordinates; `properties` are those of vertices besides, as "uchar red, int part", `rows` the numbers
/// of each vertex.
pub fn ply_text(
    properties: &str,
    rows: impl ExactSizeIterator<Item = String>,
    triangles: &[[u32; 3]],
) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    let more = properties.split(", ").filter(|property| !property.is_empty());
    for property in ["float x", "float y", "float z"].into_iter().chain(more) {
        text += &format!("property {property}\n");
    }
    let n_faces = triangles.len();
    text +=
        &format!("element face {n_faces}\nproperty list uchar int vertex_indices\nend_header\n");
    rows.for_each(|row| text += &(row + "\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text
}
