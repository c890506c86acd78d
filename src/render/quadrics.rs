//! Error quadrics made visible: level sets of a vertex's quadric are ellipsoids.
//!
//! The quadric of a vertex is that of its present triangles, A = sum of n n^T / (2 |n|) with n the cross
//! product. x^T A x = c is an ellipsoid about the vertex, flat where the surface is flat (moving along
//! it costs nothing), long along a crease, small and round at a corner. Its axes are A's eigenvectors,
//! its half-axes sqrt(c / eigenvalue), cut off where nothing resists.

use super::shade::tone;
use super::vector::symmetric_eigen;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::unit;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, normal, scale, sub};

/// Half-axes are at most this many mean edge lengths of the vertex.
const LONGEST: f64 = 0.85;
/// Half-axes are at least this many mean edge lengths, or flat ones could not be seen.
const SHORTEST: f64 = 0.06;
/// The level: cost of moving against the surface by this share of a mean edge length.
const LEVEL: f64 = 0.30;
/// Times each of the octahedron's edges is halved: 8 * 4^4 facets an ellipsoid.
const HALVINGS: u32 = 4;

/// A triangle to be drawn over a mesh, in object space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    pub(super) corners: [Vec3; 3],
    pub(super) normals: [Vec3; 3],
    pub(super) color: [f32; 3],
}

/// A vertex's quadric and surroundings.
#[derive(Clone, Copy, Debug, Default)]
struct Quadric {
    matrix: [[f64; 3]; 3],
    edge_sum: f64,
    n_edges: f64,
    /// The least cost of moving to a neighbour: what removing the vertex would do.
    importance: f64,
}

/// The ellipsoids of the `n` most important vertices: those dearest to remove, no two of them touching.
pub(super) fn ellipsoids(mesh: &Mesh, n: usize) -> Vec<Facet> {
    if n == 0 {
        return Vec::new();
    }
    let quadrics = quadrics(mesh);
    let mut order: Vec<usize> =
        (0..quadrics.len()).filter(|&v| quadrics[v].n_edges > 0.0).collect();
    order.sort_by(|&a, &b| {
        quadrics[b].importance.total_cmp(&quadrics[a].importance).then(a.cmp(&b))
    });
    let mut chosen: Vec<(Vec3, f64)> = Vec::new();
    let mut facets = Vec::new();
    for vertex in order {
        if chosen.len() == n {
            break;
        }
        let place = mesh.positions[vertex];
        let edge = quadrics[vertex].edge_sum / quadrics[vertex].n_edges;
        let apart = |(other, reach): &(Vec3, f64)| {
            let d = sub(*other, place);
            dot(d, d).sqrt() > LONGEST * (edge + reach)
        };
        if chosen.iter().all(apart) {
            chosen.push((place, edge));
            ellipsoid(place, &quadrics[vertex], edge, &mut facets);
        }
    }
    facets
}

fn quadrics(mesh: &Mesh) -> Vec<Quadric> {
    let mut quadrics =
        vec![Quadric { importance: f64::INFINITY, ..Quadric::default() }; mesh.positions.len()];
    for t in 0..mesh.triangles.len() {
        let corners = mesh.corners(t);
        let n = normal(corners);
        let length = dot(n, n).sqrt();
        let has_area = length > 0.0;
        if !has_area {
            continue;
        }
        for v in mesh.triangles[t] {
            let quadric = &mut quadrics[v as usize];
            for i in 0..3 {
                for j in 0..3 {
                    quadric.matrix[i][j] += n[i] * n[j] / (2.0 * length);
                }
            }
        }
    }
    for ids in &mesh.triangles {
        for (a, b) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
            let (a, b) = (ids[a] as usize, ids[b] as usize);
            let edge = sub(mesh.positions[b], mesh.positions[a]);
            let quadric = &mut quadrics[a];
            let cost: f64 = (0..3).map(|i| edge[i] * dot(quadric.matrix[i], edge)).sum();
            quadric.importance = quadric.importance.min(cost);
            quadric.edge_sum += dot(edge, edge).sqrt();
            quadric.n_edges += 1.0;
        }
    }
    quadrics
}

fn ellipsoid(place: Vec3, quadric: &Quadric, edge: f64, out: &mut Vec<Facet>) {
    let eigen = symmetric_eigen(quadric.matrix);
    let (eigenvalues, axes) = (eigen.map(|(value, _)| value), eigen.map(|(_, axis)| axis));
    let largest = eigenvalues.into_iter().fold(f64::MIN_POSITIVE, f64::max);
    let half: [f64; 3] = std::array::from_fn(|i| {
        let relative = (eigenvalues[i] / largest).max(1e-12);
        (LEVEL * edge / relative.sqrt()).clamp(SHORTEST * edge, LONGEST * edge)
    });
    // Blue where one direction resists (a face), orange with two (a crease), red with three (a corner).
    let mut relative: [f64; 3] = std::array::from_fn(|i| eigenvalues[i].max(0.0) / largest);
    relative.sort_by(f64::total_cmp);
    let (crease, corner) = (relative[1].powf(0.35), relative[0].powf(0.35));
    let [face_blue, orange, red] = [[0.27, 0.51, 0.86], [0.96, 0.62, 0.20], [0.84, 0.22, 0.24]];
    let blend = |a: Vec3, b: Vec3, t: f64| add(a, scale(sub(b, a), t.clamp(0.0, 1.0)));
    let color = tone(blend(blend(face_blue, orange, crease), red, 1.5 * corner), 1.0);
    let at = |unit_point: Vec3| {
        let place_at = |i: usize| scale(axes[i], half[i] * unit_point[i]);
        let normal_at = |i: usize| scale(axes[i], unit_point[i] / half[i]);
        let sum = |f: &dyn Fn(usize) -> Vec3| add(f(0), add(f(1), f(2)));
        let outward = unit(sum(&normal_at)).unwrap_or([0.0, 0.0, 1.0]);
        (add(place, sum(&place_at)), outward)
    };
    // A mirrored frame would turn every facet inside out.
    let mirrored = dot(cross(axes[0], axes[1]), axes[2]) < 0.0;
    for octant in 0..8u32 {
        let sign = [0, 1, 2].map(|i| if octant >> i & 1 == 0 { 1.0 } else { -1.0 });
        let tips = [0, 1, 2].map(|i| {
            let mut tip = [0.0; 3];
            tip[i] = sign[i];
            tip
        });
        let inward = (sign[0] * sign[1] * sign[2] < 0.0) != mirrored;
        let tips = if inward { [tips[0], tips[2], tips[1]] } else { tips };
        halve(tips, HALVINGS, &mut |triangle| {
            let [a, b, c] = triangle.map(at);
            out.push(Facet { corners: [a.0, b.0, c.0], normals: [a.1, b.1, c.1], color });
        });
    }
}

/// Splits a triangle on the unit sphere into four, `times` times over.
fn halve(triangle: [Vec3; 3], times: u32, emit: &mut impl FnMut([Vec3; 3])) {
    if times == 0 {
        emit(triangle);
        return;
    }
    let [a, b, c] = triangle;
    let middle = |p: Vec3, q: Vec3| unit(add(p, q)).unwrap_or(p);
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
        halve(part, times - 1, emit);
    }
}
