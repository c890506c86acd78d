//! Turns bodies over that are inside out: closed components of negative volume that lie in no other one.
//!
//! A cavity is a closed component within another one and faces inwards; so what lies in a body that is turned faces in and out by
//! turns from there. What has an open side stays. Changes no place and no edge.

use crate::Mesh;
use crate::bounds::Bounds;
use crate::union_find::Union;
use crate::vec3::{Vec3, cross, dot, length_sq, place_bits, sub};
use std::collections::{BTreeMap, BTreeSet};

/// Turns bodies that are inside out and what is wrong within them; gives back the triangles that it turned, and how many bodies
/// they are.
pub fn turn_outward(mesh: &mut Mesh) -> (Vec<u32>, u64) {
    let bodies = Bodies::find(mesh);
    if bodies.volume.iter().all(|volume| *volume >= 0.0) {
        return (Vec::new(), 0);
    }
    let around = bodies.around(mesh);
    let is_inverted = |body: usize| bodies.volume[body] < 0.0 && around[body].is_empty();
    let is_turned: Vec<bool> = (0..around.len())
        .map(|body| {
            let is_within = around[body].iter().any(|&outer| is_inverted(outer as usize));
            let is_cavity = around[body].len() % 2 == 1;
            is_inverted(body) || is_within && (bodies.volume[body] < 0.0) != is_cavity
        })
        .collect();
    let of = |body: &u32| is_turned.get(*body as usize) == Some(&true);
    let turned: Vec<u32> = bodies
        .of_triangle
        .iter()
        .zip(0u32..)
        .filter(|(body, _)| of(body))
        .map(|(_, t)| t)
        .collect();
    turned.iter().for_each(|&t| mesh.triangles[t as usize].swap(1, 2));
    (turned, is_turned.into_iter().filter(|turned| *turned).count() as u64)
}

/// Volume that closed sides of triangles enclose, cavities taken off; of some that are open it depends on their place.
pub fn volume(triangles: impl Iterator<Item = [Vec3; 3]>) -> f64 {
    let mut origin = None;
    let six: f64 = triangles
        .map(|corners| {
            let origin = *origin.get_or_insert(corners[0]);
            let [a, b, c] = corners.map(|corner| sub(corner, origin));
            dot(a, cross(b, c))
        })
        .sum();
    (six / 6.0).abs()
}

/// Least volume, over area to the power of 1.5, of more than two sheets on each other: a plate has it whose thickness is 3e-5 of its
/// side, a ball 0.09.
const LEAST_OF_AREA: f64 = 1e-5;

/// The same, or `None` where the sides lie on each other.
pub fn solid_volume(triangles: impl Iterator<Item = [Vec3; 3]> + Clone) -> Option<f64> {
    let doubled: f64 =
        triangles.clone().map(|[a, b, c]| length_sq(cross(sub(b, a), sub(c, a))).sqrt()).sum();
    let volume = volume(triangles);
    (volume > LEAST_OF_AREA * (0.5 * doubled).powf(1.5)).then_some(volume)
}

/// Volume of a mesh without an open side; `None` for others.
pub fn closed_volume(mesh: &Mesh) -> Option<f64> {
    let open = open_sides(&mesh.triangles, |v| v, mesh.positions.len());
    if open.iter().any(|&open| open != 0) {
        return None;
    }
    solid_volume((0..mesh.triangles.len()).map(|t| mesh.corners(t)))
}

/// No body.
const NONE: u32 = u32::MAX;

/// Closed components.
struct Bodies {
    /// The body of each triangle, or `NONE`.
    of_triangle: Vec<u32>,
    /// Six times the volume of each.
    volume: Vec<f64>,
    /// The corner of each that is farthest along x.
    tip: Vec<Vec3>,
}

/// Spreads the bits of a number.
fn mix(v: u32) -> u64 {
    let x = (u64::from(v) + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9)
}

/// For each vertex a number that is not 0 if its triangles have an open side; 0 otherwise, but for chance of 1 in 2^64.
fn open_sides(triangles: &[[u32; 3]], id: impl Fn(u32) -> u32, n: usize) -> Vec<u64> {
    let mut sum = vec![0u64; n];
    for triangle in triangles {
        let [a, b, c] = triangle.map(&id);
        for (v, after, before) in [(a, b, c), (b, c, a), (c, a, b)] {
            let sum = &mut sum[v as usize];
            *sum = sum.wrapping_add(mix(after)).wrapping_sub(mix(before));
        }
    }
    sum
}

impl Bodies {
    fn find(mesh: &Mesh) -> Bodies {
        let n = mesh.positions.len();
        // Sides of one sheet that two vertices in one place part are closed.
        let mut id: Vec<u32> = (0..n as u32).collect();
        let mut open = open_sides(&mesh.triangles, |v| v, n);
        let mut places = BTreeMap::new();
        for v in (0..n).filter(|&v| open[v] != 0) {
            id[v] = *places.entry(place_bits(mesh.positions[v])).or_insert(v as u32);
        }
        if !places.is_empty() {
            open = open_sides(&mesh.triangles, |v| id[v as usize], n);
        }
        let mut parts = Union::new(n);
        for &[a, b, c] in &mesh.triangles {
            let [a, b, c] = [a, b, c].map(|v| id[v as usize]);
            parts.join(a, b);
            parts.join(b, c);
        }
        let root = parts.into_roots();
        let mut is_open = vec![false; n];
        open.iter().zip(&root).for_each(|(&open, &root)| is_open[root as usize] |= open != 0);
        let mut bodies = Bodies { of_triangle: Vec::new(), volume: Vec::new(), tip: Vec::new() };
        let mut bounds = Bounds::EMPTY;
        mesh.positions.iter().for_each(|p| bounds.add(*p));
        let middle = bounds.or_origin().middle();
        let mut number = vec![NONE; n];
        for triangle in &mesh.triangles {
            let root = root[id[triangle[0] as usize] as usize] as usize;
            if is_open[root] {
                bodies.of_triangle.push(NONE);
                continue;
            }
            if number[root] == NONE {
                number[root] = bodies.volume.len() as u32;
                bodies.volume.push(0.0);
                bodies.tip.push([f64::NEG_INFINITY; 3]);
            }
            let body = number[root] as usize;
            let corners = triangle.map(|v| mesh.positions[v as usize]);
            let [a, b, c] = corners.map(|p| sub(p, middle));
            bodies.volume[body] += dot(a, cross(b, c));
            let farther = |tip: Vec3, corner: Vec3| if corner[0] > tip[0] { corner } else { tip };
            bodies.tip[body] = corners.into_iter().fold(bodies.tip[body], farther);
            bodies.of_triangle.push(body as u32);
        }
        bodies
    }

    /// For each body those that it lies in: a ray from its tip along x, on which nothing of it lies, crosses them an odd number of times.
    fn around(&self, mesh: &Mesh) -> Vec<BTreeSet<u32>> {
        let mut by_y: Vec<u32> = (0..self.tip.len() as u32).collect();
        let y = |body: u32| self.tip[body as usize][1];
        by_y.sort_by(|&a, &b| y(a).total_cmp(&y(b)));
        let mut around = vec![BTreeSet::new(); self.tip.len()];
        for (triangle, &outer) in mesh.triangles.iter().zip(&self.of_triangle) {
            if outer == NONE {
                continue;
            }
            let corners = triangle.map(|v| mesh.positions[v as usize]);
            let low = corners.iter().fold(f64::INFINITY, |low, p| low.min(p[1]));
            let high = corners.iter().fold(f64::NEG_INFINITY, |high, p| high.max(p[1]));
            let first = by_y.partition_point(|&body| y(body) < low);
            for &body in by_y[first..].iter().take_while(|&&body| y(body) <= high) {
                if body != outer && is_crossed(corners, self.tip[body as usize]) {
                    let within: &mut BTreeSet<u32> = &mut around[body as usize];
                    if !within.remove(&outer) {
                        within.insert(outer);
                    }
                }
            }
        }
        around
    }
}

/// Returns whether a ray from a point along x crosses a triangle; of neighbours at the same edge, one.
fn is_crossed(corners: [Vec3; 3], point: Vec3) -> bool {
    let mut is_within = false;
    for (i, k) in [(0, 1), (1, 2), (2, 0)] {
        // Either way along the edge comes to the same numbers.
        let (mut a, mut b) = (corners[i], corners[k]);
        if (a[1], a[2]) > (b[1], b[2]) {
            (a, b) = (b, a);
        }
        let along = |at: f64| a[2] + (at - a[1]) / (b[1] - a[1]) * (b[2] - a[2]);
        if (a[1] > point[1]) != (b[1] > point[1]) && point[2] < along(point[1]) {
            is_within = !is_within;
        }
    }
    let [a, b, c] = corners;
    let normal = cross(sub(b, a), sub(c, a));
    // Behind the plane as seen from far along x.
    is_within && dot(normal, sub(point, a)) * normal[0] < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube around a place; `sign` is that of its volume.
    fn add_cube(mesh: &mut Mesh, middle: Vec3, half: f64, sign: f64) {
        let first = mesh.positions.len() as u32;
        for i in 0..8 {
            let side = |k: usize| if i >> k & 1 == 1 { half } else { -half };
            mesh.positions.push([0, 1, 2].map(|k| middle[k] + side(k)));
        }
        let faces =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in faces {
            for [a, b, c] in [[a, b, c], [a, c, d]] {
                let t = if sign > 0.0 { [a, b, c] } else { [a, c, b] };
                mesh.triangles.push(t.map(|v| first + v));
            }
        }
    }

    fn volumes(mesh: &Mesh) -> Vec<f64> {
        Bodies::find(mesh).volume.iter().map(|six| six / 6.0).collect()
    }

    #[test]
    fn bodies_are_turned_and_cavities_are_not() {
        let mut mesh = Mesh::default();
        // A ball with a cavity and a ball in that, as they should be; one inside out; one with its cavity, all inside out; one of
        // which only the outer side is.
        let all = [
            (0.0, 4.0, 1.0),
            (0.1, 3.0, -1.0),
            (0.2, 1.0, 1.0),
            (10.0, 2.0, -1.0),
            (20.0, 4.0, -1.0),
            (20.1, 3.0, 1.0),
            (30.0, 4.0, -1.0),
            (30.1, 3.0, -1.0),
        ];
        for (x, half, sign) in all {
            add_cube(&mut mesh, [x, 0.01 * x, 0.0], half, sign);
        }
        let (turned, n_bodies) = turn_outward(&mut mesh);
        assert_eq!((turned.len(), n_bodies), (4 * 12, 4));
        let signs: Vec<f64> = volumes(&mesh).into_iter().map(f64::signum).collect();
        assert_eq!(signs, [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0, -1.0]);
        assert_eq!(turn_outward(&mut mesh), (Vec::new(), 0));
    }

    #[test]
    fn a_volume_is_that_of_what_is_closed_and_not_flat() {
        let mut mesh = Mesh::default();
        add_cube(&mut mesh, [1e6; 3], 1.0, -1.0);
        assert_eq!(closed_volume(&mesh), Some(8.0));
        mesh.positions.iter_mut().for_each(|p| p[2] = 0.0);
        assert_eq!(closed_volume(&mesh), None);
        mesh.triangles.pop();
        assert_eq!(closed_volume(&mesh), None);
    }

    #[test]
    fn what_is_open_stays_and_what_is_split_does_not() {
        let mut mesh = Mesh::default();
        add_cube(&mut mesh, [0.0; 3], 1.0, -1.0);
        let mut open = mesh.clone();
        open.triangles.pop();
        assert_eq!(turn_outward(&mut open), (Vec::new(), 0));
        // Every triangle with its own corners.
        let positions = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]);
        let mut soup = Mesh::new(
            positions.collect(),
            (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        );
        assert_eq!(turn_outward(&mut soup).1, 1);
        assert_eq!(volumes(&soup).len(), 1);
    }
}
