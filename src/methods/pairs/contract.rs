//! One contraction: the triangles that go, those that follow, and those that fall on each other's backs.

use super::quadric::PairQuadric;
use crate::surface::Surface;
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{Vec3, cross, dot, length_sq, normal, scale, sub, unit};

/// Least cosine between a triangle before and after.
const LEAST_TURN: f64 = 0.2;
/// Weight of planes along boundaries, as a share of the squared length of an edge.
const BOUNDARY_WEIGHT: f64 = 1.0;
/// Error of a triangle that goes with its back, as a share of its area times its longest side squared: points of it are
/// up to that far from what stays.
const LOST: f64 = 1.0 / 12.0;

/// Reasons against a contraction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// A triangle would turn over, or two come to lie on each other that face the same way.
    Fold,
    /// An edge would take a tube, a handle or a component along: those have their price in the collapse.
    Topology,
}

/// Triangles of a contraction.
#[derive(Debug, Default)]
pub(super) struct Contraction {
    /// Triangles that go or change.
    pub(super) hole: Vec<u32>,
    /// Those that changed.
    pub(super) filling: Vec<[u32; 3]>,
    /// True if a triangle has both vertices.
    pub(super) is_edge: bool,
    /// Triangles that go because they lie on each other's backs.
    pub(super) n_cancelled: usize,
    /// Error of these.
    pub(super) lost: f64,
}

/// A triangle around the new vertex: its other corners in order, whether that turned it round, its number, whether it is of `b`.
type Side = ([u32; 2], bool, u32, bool);

/// Finds out what becomes of the triangles around both vertices of a pair if they become the first one, at `place`.
pub(super) fn plan(
    surface: &Surface,
    [a, b]: [u32; 2],
    place: Vec3,
) -> Result<Contraction, Refusal> {
    let mut out = Contraction::default();
    let mut sides: Vec<Side> = Vec::new();
    let mut apexes = Vec::new();
    let mut rings = [Vec::new(), Vec::new()];
    // Fewer steps are not counted.
    let mut n_steps = 0;
    for (own, other, is_of_b) in [(a, b, false), (b, a, true)] {
        for triangle in surface.around(own) {
            n_steps += 1;
            let corners = surface.corners(triangle);
            rings[usize::from(is_of_b)].extend(corners);
            if corners.contains(&other) {
                if !is_of_b {
                    out.hole.push(triangle);
                    out.is_edge = true;
                    apexes.extend(corners.iter().filter(|&&v| v != a && v != b));
                }
                continue;
            }
            if turns(surface, corners, own, place) {
                return Err(Refusal::Fold);
            }
            sides.push(side(corners, own, triangle, is_of_b));
        }
    }
    count(n_steps);
    if out.is_edge && n_common(&mut rings, [a, b]) != n_different(&mut apexes) {
        return Err(Refusal::Topology);
    }
    let n_sides = sides.len();
    lay(surface, a, &mut sides, &mut out)?;
    // A vertex without a triangle left was the end of a component.
    if out.n_cancelled > 0 && (out.is_edge || out.n_cancelled == n_sides) {
        return Err(Refusal::Topology);
    }
    Ok(out)
}

/// The same where the first vertex is a hub, which stays where it is: nothing becomes of its triangles but where those of `b` come to
/// lie on them. What would take a walk around a hub to find out is refused.
pub(super) fn plan_at_hub(
    surface: &Surface,
    [hub, b]: [u32; 2],
    is_hub: impl Fn(u32) -> bool,
) -> Result<Contraction, Refusal> {
    let place = surface.positions[hub as usize];
    let mut out = Contraction::default();
    let (mut sides, mut apexes, mut ring) = (Vec::<Side>::new(), Vec::new(), Vec::new());
    for triangle in surface.around(b) {
        let corners = surface.corners(triangle);
        if corners.contains(&hub) {
            out.hole.push(triangle);
            out.is_edge = true;
            apexes.extend(corners.iter().filter(|&&v| v != hub && v != b));
            continue;
        }
        if turns(surface, corners, b, place) {
            return Err(Refusal::Fold);
        }
        ring.extend(corners.iter().filter(|&&v| v != b));
        sides.push(side(corners, b, triangle, true));
    }
    apexes.sort_unstable();
    ring.sort_unstable();
    ring.dedup();
    // A neighbour of both that is on no triangle with them.
    let is_common =
        |v: &u32| apexes.binary_search(v).is_err() && (is_hub(*v) || surface.has_edge(*v, hub));
    if out.is_edge && ring.iter().any(is_common) {
        return Err(Refusal::Topology);
    }
    for i in 0..sides.len() {
        let ends = sides[i].0;
        let Some(&end) = ends.iter().find(|v| !is_hub(**v)) else { return Err(Refusal::Topology) };
        for triangle in surface.around(end) {
            let corners = surface.corners(triangle);
            if corners.contains(&hub) && ends.iter().all(|v| corners.contains(v)) {
                sides.push(side(corners, hub, triangle, false));
            }
        }
    }
    lay(surface, hub, &mut sides, &mut out)?;
    if out.n_cancelled > 0 && out.is_edge {
        return Err(Refusal::Topology);
    }
    Ok(out)
}

/// A triangle as it is seen from a corner.
fn side(corners: [u32; 3], own: u32, triangle: u32, is_of_b: bool) -> Side {
    let at = corners.iter().position(|&v| v == own).unwrap_or(0);
    let (next, last) = (corners[(at + 1) % 3], corners[(at + 2) % 3]);
    ([next.min(last), next.max(last)], next > last, triangle, is_of_b)
}

/// Finds out which of the triangles around the new vertex `a` stay, and which lie on each other's backs and go.
fn lay(
    surface: &Surface,
    a: u32,
    sides: &mut Vec<Side>,
    out: &mut Contraction,
) -> Result<(), Refusal> {
    sides.sort_unstable();
    // Two sides of `b` find the same triangle of a hub where they are on it both.
    sides.dedup();
    for group in sides.chunk_by(|one, other| one.0 == other.0) {
        let n_turned = group.iter().filter(|side| side.1).count();
        let n_straight = group.len() - n_turned;
        if n_turned.abs_diff(n_straight) > 1 {
            return Err(Refusal::Fold);
        }
        // The first of those that are one more than the others stays.
        let (mut stays, stays_turned) = (n_turned != n_straight, n_turned > n_straight);
        for &([one, other], is_turned, triangle, is_of_b) in group {
            if stays && is_turned == stays_turned {
                stays = false;
                if is_of_b {
                    out.hole.push(triangle);
                    out.filling.push(if is_turned { [a, other, one] } else { [a, one, other] });
                }
                continue;
            }
            out.hole.push(triangle);
            out.n_cancelled += 1;
            out.lost += lost(surface, surface.corners(triangle));
        }
    }
    Ok(())
}

/// Vertices in both lists besides the two themselves.
fn n_common(rings: &mut [Vec<u32>; 2], pair: [u32; 2]) -> usize {
    for ring in rings.iter_mut() {
        ring.sort_unstable();
        ring.dedup();
        ring.retain(|v| !pair.contains(v));
    }
    rings[0].iter().filter(|v| rings[1].binary_search(v).is_ok()).count()
}

fn n_different(vertices: &mut Vec<u32>) -> usize {
    vertices.sort_unstable();
    vertices.dedup();
    vertices.len()
}

/// True if a triangle turns over, or loses its area, when one of its corners moves.
fn turns(surface: &Surface, corners: [u32; 3], moved: u32, place: Vec3) -> bool {
    let before = corners.map(|v| surface.positions[v as usize]);
    let mut after = before;
    for (corner, point) in corners.iter().zip(&mut after) {
        if *corner == moved {
            *point = place;
        }
    }
    let (was, is) = (normal(before), normal(after));
    let lengths = (length_sq(was) * length_sq(is)).sqrt();
    // What had no area before may turn.
    length_sq(was) > 0.0 && (lengths.is_nan() || dot(was, is) <= LEAST_TURN * lengths)
}

fn lost(surface: &Surface, corners: [u32; 3]) -> f64 {
    let [p, q, r] = corners.map(|v| surface.positions[v as usize]);
    let area = 0.5 * length_sq(normal([p, q, r])).sqrt();
    let longest = [sub(q, p), sub(r, q), sub(p, r)].map(length_sq).into_iter().fold(0.0, f64::max);
    LOST * area * longest
}

/// The quadric of every vertex: a third of the area of each triangle around it, and planes that stand on open edges.
pub(super) fn quadrics(surface: &Surface) -> Vec<PairQuadric> {
    let mut quadrics = vec![PairQuadric::default(); surface.positions.len()];
    let mut sides = Vec::with_capacity(3 * surface.n_alive());
    for corners in surface.alive() {
        let places = corners.map(|v| surface.positions[v as usize]);
        let weighted = normal(places);
        let Some(direction) = unit(weighted) else { continue };
        let weight = length_sq(weighted).sqrt() / 6.0;
        let quadric = PairQuadric::of_plane(places[0], direction, weight);
        for (k, &v) in corners.iter().enumerate() {
            quadrics[v as usize] = quadrics[v as usize].plus(&quadric);
            let next = corners[(k + 1) % 3];
            sides.push(([v.min(next), v.max(next)], direction));
        }
    }
    sides.sort_unstable_by_key(|side| side.0);
    for edge in sides.chunk_by(|one, other| one.0 == other.0) {
        let &[([a, b], direction)] = edge else { continue };
        let [p, q] = [a, b].map(|v| surface.positions[v as usize]);
        let Some(upright) = unit(cross(direction, sub(q, p))) else { continue };
        let weight = BOUNDARY_WEIGHT * length_sq(sub(q, p)) / 2.0;
        let quadric = PairQuadric::of_plane(scale(p, 1.0), upright, weight);
        for v in [a, b] {
            quadrics[v as usize] = quadrics[v as usize].plus(&quadric);
        }
    }
    quadrics
}
