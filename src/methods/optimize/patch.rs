//! A few triangles that are not there yet, and the samples that would lie on them: the judge of all moves.
//!
//! Knows nothing of the surface around.

use stonecut_measure::triangle;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, normal, scale, sub, unit};

/// Resistance of a vertex against moves that no sample asks for, as a share of the trace of the normal equations.
const DAMPING: f64 = 2e-3;

/// A step that does not gain is tried again at half its length, this often.
const HALVINGS: u32 = 2;

/// A sample that lies inside of a triangle, no higher above it than this share of the root of its double area, is not
/// looked for on others; two of them are seldom as near.
const CLOSE: f64 = 0.14;

/// A sample.
#[derive(Clone, Copy)]
pub(super) struct Point {
    pub at: Vec3,
    pub weight: f64,
}

/// A sample on a triangle of a patch.
#[derive(Clone, Copy)]
pub(super) struct Lying {
    /// Number of the triangle in the patch.
    pub facet: u32,
    pub distance_sq: f64,
    weights: [f64; 3],
}

/// Energy of the samples, and the facet that each lies on.
pub(super) struct Settled {
    pub energy: f64,
    pub lying: Vec<Lying>,
}

/// A triangle as it is looked at from samples.
struct Facet {
    first: Vec3,
    normal: Vec3,
    /// Products with them are the weights of the second and the third corner.
    duals: [Vec3; 2],
    close_sq: f64,
}

impl Facet {
    fn new([a, b, c]: [Vec3; 3]) -> Facet {
        let (u, w) = (sub(b, a), sub(c, a));
        let n = cross(u, w);
        let n_sq = length_sq(n);
        let share = if n_sq > 0.0 { 1.0 / n_sq } else { f64::NAN };
        Facet {
            first: a,
            normal: unit(n).unwrap_or_default(),
            duals: [scale(cross(w, n), share), scale(cross(n, u), share)],
            close_sq: CLOSE * CLOSE * n_sq.sqrt(),
        }
    }

    /// Lays a point on the inside, if it lies above or below that.
    fn inside(&self, point: Vec3) -> Option<(f64, [f64; 3])> {
        let off = sub(point, self.first);
        let [v, w] = self.duals.map(|dual| dot(dual, off));
        let height = dot(self.normal, off);
        (v > 0.0 && w > 0.0 && v + w < 1.0).then_some((height * height, [1.0 - v - w, v, w]))
    }
}

/// Lays samples on the nearest of some triangles, looking first where `hints` say, if there are any.
pub(super) fn settle(points: &[Point], hints: &[u32], corners: &[[Vec3; 3]]) -> Settled {
    let facets: Vec<Facet> = corners.iter().map(|&corners| Facet::new(corners)).collect();
    let mut energy = 0.0;
    let mut lying = Vec::with_capacity(points.len());
    for (i, &Point { at, weight }) in points.iter().enumerate() {
        let hint = hints.get(i).map_or(0, |&hint| hint as usize);
        // The hint, then all others in their order.
        let order =
            (0..facets.len()).map(|k| if k == 0 { hint } else { k - usize::from(k <= hint) });
        let close = order.clone().find_map(|k| {
            let (distance_sq, weights) = facets[k].inside(at)?;
            let is_close = distance_sq <= facets[k].close_sq;
            is_close.then_some(Lying { facet: k as u32, distance_sq, weights })
        });
        let best = close.unwrap_or_else(|| nearest(at, &facets, corners, order));
        energy += weight * best.distance_sq;
        lying.push(best);
    }
    Settled { energy, lying }
}

/// The nearest of all triangles.
fn nearest(
    point: Vec3,
    facets: &[Facet],
    corners: &[[Vec3; 3]],
    order: impl Iterator<Item = usize>,
) -> Lying {
    let mut best = Lying { facet: 0, distance_sq: f64::INFINITY, weights: [1.0, 0.0, 0.0] };
    for k in order {
        let height = dot(facets[k].normal, sub(point, facets[k].first));
        if height * height < best.distance_sq {
            let (distance_sq, weights) = triangle::closest(point, &corners[k]);
            if distance_sq < best.distance_sq {
                best = Lying { facet: k as u32, distance_sq, weights };
            }
        }
    }
    best
}

/// A place that was found for a vertex.
pub(super) struct Placed {
    pub place: Vec3,
    /// The samples there.
    pub settled: Settled,
    pub energy: f64,
    /// Energy at the place where the search began.
    pub first: f64,
}

/// A fan of triangles around a vertex that is to be placed.
pub(super) struct Fan {
    /// The two other corners of each triangle.
    pub rims: Vec<[Vec3; 2]>,
    /// Ends of the springs at the vertex.
    pub ends: Vec<Vec3>,
    /// Energy of a spring over its squared length.
    pub spring: f64,
}

impl Fan {
    pub fn facets(&self, place: Vec3) -> Vec<[Vec3; 3]> {
        self.rims.iter().map(|&[b, c]| [place, b, c]).collect()
    }

    pub fn spring_energy(&self, place: Vec3) -> f64 {
        self.spring * self.ends.iter().map(|&end| length_sq(sub(end, place))).sum::<f64>()
    }

    /// Looks for the place of least energy from `start`, in at most this many steps; the energies of the found place and of
    /// `start` are with those of the springs.
    pub fn place(&self, points: &[Point], hints: &[u32], start: Vec3, steps: u32) -> Placed {
        let mut place = start;
        let mut settled = settle(points, hints, &self.facets(place));
        let first = settled.energy + self.spring_energy(place);
        let mut energy = first;
        let mut found_hints: Vec<u32>;
        for _ in 0..steps {
            let Some(mut shift) = self.step(points, place, &settled) else { break };
            found_hints = settled.lying.iter().map(|lying| lying.facet).collect();
            let mut has_gained = false;
            for _ in 0..=HALVINGS {
                let there = add(place, shift);
                let tried = settle(points, &found_hints, &self.facets(there));
                let with_springs = tried.energy + self.spring_energy(there);
                if with_springs < energy {
                    has_gained = true;
                    (place, energy, settled) = (there, with_springs, tried);
                    break;
                }
                shift = scale(shift, 0.5);
            }
            if !has_gained {
                break;
            }
        }
        Placed { place, settled, energy, first }
    }

    /// A Gauss-Newton step: each sample sees its distance along its own direction to the surface.
    fn step(&self, points: &[Point], place: Vec3, settled: &Settled) -> Option<Vec3> {
        let (mut m, mut q) = ([[0.0; 3]; 3], [0.0; 3]);
        for (&Point { at: point, weight }, lying) in points.iter().zip(&settled.lying) {
            let share = lying.weights[0];
            if share <= 0.0 {
                continue;
            }
            let [b, c] = self.rims[lying.facet as usize];
            let facet = [place, b, c];
            let off = sub(point, triangle::point_at(&facet, lying.weights));
            let Some(n) = unit(normal(facet)) else { continue };
            // On a triangle the direction is its normal, however small the distance is.
            let is_inside = lying.weights.iter().all(|&w| w > 0.0);
            let direction = if is_inside { n } else { unit(off).unwrap_or(n) };
            let distance = dot(direction, off);
            for i in 0..3 {
                for j in 0..3 {
                    m[i][j] += weight * share * share * direction[i] * direction[j];
                }
                q[i] += weight * share * distance * direction[i];
            }
        }
        let trace = m[0][0] + m[1][1] + m[2][2];
        let is_seen = trace > 0.0;
        if !is_seen {
            return None;
        }
        let own = DAMPING * trace + self.spring * self.ends.len() as f64;
        for i in 0..3 {
            m[i][i] += own;
            let pull: f64 = self.ends.iter().map(|end| end[i] - place[i]).sum();
            q[i] += self.spring * pull;
        }
        solve(m, q)
    }
}

/// Solves a symmetric system of three equations.
fn solve(m: [[f64; 3]; 3], q: Vec3) -> Option<Vec3> {
    let (a, b, c) = (cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]));
    let determinant = dot(m[0], a);
    let solved = scale(add(add(scale(a, q[0]), scale(b, q[1])), scale(c, q[2])), 1.0 / determinant);
    solved.iter().all(|x| x.is_finite()).then_some(solved)
}
