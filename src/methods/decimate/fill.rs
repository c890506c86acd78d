//! Fills the loop that a removed vertex leaves, by splitting it in two until triangles are left (Schroeder et al. 1992,
//! section 3.3).
//!
//! A split is a line between two vertices of the loop. The plane through it at a right angle to the average plane must
//! have each half of the loop on its own side; of all such splits the one with the best aspect ratio is taken. A loop with
//! dents often has no such split: ears are cut from it instead, the best-shaped first (Meisters 1975).

use super::classify::{Around, Kind};
use crate::surface::Surface;
use stonecut_mesh::vec3::{Vec3, cross, dot, length_sq, normal, sub, unit};

/// Least aspect ratio of a split: distance of the nearest vertex of the loop from the plane, relative to the line's length.
const LEAST_ASPECT: f64 = 0.05;

/// Least shape of a triangle that is cut from a loop (`Splitter::shape`).
const LEAST_SHAPE: f64 = 1e-3;

/// Reason why a vertex stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// No sequence of legal splits fills the loop.
    Split,
    /// An edge or a triangle would be there twice.
    Topology,
}

/// Triangles that fill the loop around a vertex; fewer than it has.
pub(super) fn fill(surface: &Surface, around: &Around) -> Result<Vec<[u32; 3]>, Refusal> {
    let loop_of = &around.ring;
    let is_open = around.kind == Kind::Boundary;
    if loop_of.len() < 3 {
        return Err(Refusal::Topology);
    }
    let ends = [loop_of[0], loop_of[loop_of.len() - 1]];
    if is_open && surface.has_edge(ends[0], ends[1]) {
        return Err(Refusal::Topology);
    }
    let mut filling = Vec::with_capacity(loop_of.len() - 2);
    let splitter = Splitter { surface, normal: around.normal };
    match (around.kind, around.feature) {
        (Kind::InteriorEdge, Some((i, j))) => {
            let (one, other) = halves(loop_of, i, j);
            if one.len() < 3 || other.len() < 3 {
                return Err(Refusal::Split);
            }
            splitter.aspect(&one, &other).ok_or(Refusal::Split)?;
            if surface.has_edge(loop_of[i], loop_of[j]) {
                return Err(Refusal::Topology);
            }
            splitter.fill(&one, &mut filling)?;
            splitter.fill(&other, &mut filling)?;
        }
        _ => splitter.fill(loop_of, &mut filling)?,
    }
    // Of a tetrahedron the last face would be there twice.
    if loop_of.len() == 3 && !is_open {
        let [a, b, c] = filling[0];
        let mut others = surface.around(a).filter(|t| !around.triangles.contains(t));
        if others.any(|t| surface.corners(t).contains(&b) && surface.corners(t).contains(&c)) {
            return Err(Refusal::Topology);
        }
    }
    Ok(filling)
}

/// Both loops that the line between the places `i < j` makes.
fn halves(ring: &[u32], i: usize, j: usize) -> (Vec<u32>, Vec<u32>) {
    (ring[i..=j].to_vec(), [&ring[j..], &ring[..=i]].concat())
}

struct Splitter<'a> {
    surface: &'a Surface,
    normal: Vec3,
}

impl Splitter<'_> {
    fn at(&self, vertex: u32) -> Vec3 {
        self.surface.positions[vertex as usize]
    }

    /// Splits a loop; where that leads nowhere, cuts ears.
    fn fill(&self, ring: &[u32], out: &mut Vec<[u32; 3]>) -> Result<(), Refusal> {
        let n_before = out.len();
        self.split(ring, out).or_else(|_| {
            out.truncate(n_before);
            self.cut_ears(ring, out)
        })
    }

    /// Cuts triangles of three consecutive vertices from a loop, each upright and without another vertex in it, seen along
    /// the normal.
    fn cut_ears(&self, ring: &[u32], out: &mut Vec<[u32; 3]>) -> Result<(), Refusal> {
        let mut ring = ring.to_vec();
        while ring.len() > 3 {
            let n = ring.len();
            let (mut best, mut refusal) = (None, Refusal::Split);
            for i in 0..n {
                let ear = [ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]];
                let shape = self.shape(ear);
                if shape < LEAST_SHAPE || best.is_some_and(|(known, _)| known >= shape) {
                    continue;
                }
                if ring.iter().any(|v| !ear.contains(v) && self.is_within(*v, ear)) {
                    continue;
                }
                if self.surface.has_edge(ear[0], ear[2]) {
                    refusal = Refusal::Topology;
                    continue;
                }
                best = Some((shape, i));
            }
            let (_, i) = best.ok_or(refusal)?;
            out.push([ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]]);
            ring.remove(i);
        }
        let last = [ring[0], ring[1], ring[2]];
        out.push(last);
        if self.shape(last) < LEAST_SHAPE { Err(Refusal::Split) } else { Ok(()) }
    }

    /// Twice the area seen along the normal, relative to the squares of the edges: 0.58 for an equilateral triangle in the
    /// plane, negative for one that is turned over.
    fn shape(&self, triangle: [u32; 3]) -> f64 {
        let [a, b, c] = triangle.map(|v| self.at(v));
        let edges = length_sq(sub(b, a)) + length_sq(sub(c, b)) + length_sq(sub(a, c));
        dot(normal([a, b, c]), self.normal) / edges
    }

    /// True if a vertex lies in a triangle or on its edge, seen along the normal.
    fn is_within(&self, vertex: u32, triangle: [u32; 3]) -> bool {
        let p = self.at(vertex);
        let [a, b, c] = triangle.map(|v| self.at(v));
        let left = |from: Vec3, to: Vec3| dot(cross(sub(to, from), sub(p, from)), self.normal);
        left(a, b) >= 0.0 && left(b, c) >= 0.0 && left(c, a) >= 0.0
    }

    /// Splits a loop until triangles are left.
    fn split(&self, ring: &[u32], out: &mut Vec<[u32; 3]>) -> Result<(), Refusal> {
        if let [a, b, c] = *ring {
            let upright = dot(normal([a, b, c].map(|v| self.at(v))), self.normal) > 0.0;
            out.push([a, b, c]);
            return if upright { Ok(()) } else { Err(Refusal::Split) };
        }
        let n = ring.len();
        let mut splits: Vec<(f64, usize, usize)> = Vec::new();
        let mut refusal = Refusal::Split;
        for (i, j) in (0..n - 2).flat_map(|i| (i + 2..n).map(move |j| (i, j))) {
            if i == 0 && j == n - 1 {
                continue;
            }
            let (one, other) = halves(ring, i, j);
            let Some(aspect) = self.aspect(&one, &other) else { continue };
            if self.surface.has_edge(ring[i], ring[j]) {
                refusal = Refusal::Topology;
                continue;
            }
            splits.push((aspect, i, j));
        }
        splits.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        // The best, and where it leads nowhere one more: all of them would take time exponential in the loop.
        for &(_, i, j) in splits.iter().take(2) {
            let (one, other) = halves(ring, i, j);
            let n_before = out.len();
            let done = self.split(&one, out).and_then(|()| self.split(&other, out));
            match done {
                Ok(()) => return Ok(()),
                Err(why) => refusal = why,
            }
            out.truncate(n_before);
        }
        Err(refusal)
    }

    /// The aspect ratio of the split between two loops, which have their first and last vertices in common; `None` where
    /// the plane does not part them.
    fn aspect(&self, one: &[u32], other: &[u32]) -> Option<f64> {
        let (from, to) = (self.at(one[0]), self.at(one[one.len() - 1]));
        let along = sub(to, from);
        let across = unit(cross(along, self.normal))?;
        let height = |v: &u32| dot(sub(self.at(*v), from), across);
        let inner = |ring: &[u32]| ring[1..ring.len() - 1].iter().map(height).collect::<Vec<f64>>();
        let (above, below) = (inner(one), inner(other));
        // Counter-clockwise, the first loop lies to the right of its closing line.
        let nearest =
            (above.iter().copied()).chain(below.iter().map(|h| -h)).fold(f64::INFINITY, f64::min);
        let aspect = nearest / length_sq(along).sqrt();
        (aspect >= LEAST_ASPECT).then_some(aspect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan around vertex 0, with neighbours on a circle of radius 1 at these angles (in turns) and heights.
    fn fan(around: &[(f64, f64)]) -> Surface {
        let n = around.len() as u32;
        let mut positions = vec![[0.0; 3]];
        positions.extend(around.iter().map(|&(turn, z)| {
            let angle = turn * std::f64::consts::TAU;
            [angle.cos(), angle.sin(), z]
        }));
        Surface::new(positions, (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect())
    }

    fn area(surface: &Surface, filling: &[[u32; 3]]) -> f64 {
        filling.iter().map(|t| normal(t.map(|v| surface.positions[v as usize]))[2] / 2.0).sum()
    }

    #[test]
    fn a_flat_loop_is_filled_with_two_triangles_less_and_the_same_area() {
        for n in 3..12 {
            let surface =
                fan(&(0..n).map(|i| (f64::from(i) / f64::from(n), 0.0)).collect::<Vec<_>>());
            let around = Around::look(&surface, 0, 0.5);
            assert_eq!((around.kind, around.ring.len()), (Kind::Simple, n as usize));
            assert!(around.distance < 1e-12);
            let filling = fill(&surface, &around).unwrap();
            assert_eq!(filling.len(), n as usize - 2);
            let whole = f64::from(n) / 2.0 * (std::f64::consts::TAU / f64::from(n)).sin();
            assert!((area(&surface, &filling) - whole).abs() < 1e-12, "{n}");
        }
    }

    #[test]
    fn a_loop_with_dents_is_filled_without_leaving_it() {
        // A star with four points: hardly any line across has each side on its own.
        let mut surface = fan(&(0..8).map(|i| (f64::from(i) / 8.0, 0.0)).collect::<Vec<_>>());
        for dent in [2, 4, 6, 8] {
            surface.positions[dent] = surface.positions[dent].map(|x| 0.3 * x);
        }
        let around = Around::look(&surface, 0, 0.5);
        let filling = fill(&surface, &around).unwrap();
        let whole: f64 = area(&surface, &surface.alive().collect::<Vec<_>>());
        assert_eq!(filling.len(), 6);
        assert!((area(&surface, &filling) - whole).abs() < 1e-12);
    }

    #[test]
    fn a_crease_stays_where_it_is() {
        // A roof with its ridge from neighbour 1 over the vertex to neighbour 4.
        let surface = fan(&[
            (0.0, 0.0),
            (1.0 / 6.0, -0.9),
            (2.0 / 6.0, -0.9),
            (0.5, 0.0),
            (4.0 / 6.0, -0.9),
            (5.0 / 6.0, -0.9),
        ]);
        let around = Around::look(&surface, 0, 0.9);
        assert_eq!((around.kind, around.feature), (Kind::InteriorEdge, Some((0, 3))));
        assert!(around.distance < 1e-12);
        let filling = fill(&surface, &around).unwrap();
        assert_eq!(filling.len(), 4);
        assert_eq!(filling.iter().filter(|t| t.contains(&1) && t.contains(&4)).count(), 2);
    }

    #[test]
    fn kinds_are_told_apart() {
        let open = Surface::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.25, 0.0]],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        let around = Around::look(&open, 0, 0.5);
        assert_eq!((around.kind, &around.ring[..]), (Kind::Boundary, &[1, 2, 3][..]));
        let expected = 0.125 / (1.0f64 + 0.125 * 0.125).sqrt();
        assert!((around.distance - expected).abs() < 1e-12, "{}", around.distance);
        assert_eq!(fill(&open, &around).unwrap(), [[1, 2, 3]]);
        let tip = fan(&[(0.0, -3.0), (0.25, -3.0), (0.5, -3.0), (0.75, -3.0)]);
        assert_eq!(Around::look(&tip, 0, 0.5).kind, Kind::Corner);
        // Two fans that meet in one vertex.
        let two = Surface::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0]],
            vec![[0, 1, 2], [0, 3, 4]],
        );
        assert_eq!(Around::look(&two, 0, 0.5).kind, Kind::Complex);
    }

    #[test]
    fn a_tetrahedron_stays() {
        let positions = vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0]];
        let surface = Surface::new(positions, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]);
        let around = Around::look(&surface, 0, -1.0);
        assert_eq!(around.kind, Kind::Simple);
        assert_eq!(fill(&surface, &around), Err(Refusal::Topology));
    }
}
