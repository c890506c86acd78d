//! The table of marching cubes, made rather than typed: what the surface does in a cube, for each set of inside corners.
//!
//! On every face of the cube the crossed edges are joined in pairs so that each run of inside corners is cut off
//! alone. That is a rule of the face, the same seen from both cubes, so surfaces of neighbouring cubes meet without
//! cracks. The pairs close into loops of three to seven edges. A loop is cut into triangles without ever joining two
//! edges of one face: such a diagonal could be an edge of the neighbouring cube's triangles too, the one way in which
//! marching cubes gives non-manifold edges. A test holds that all 256 sets can be cut so.
//!
//! Source: Lorensen & Cline 1987 for the cubes, Nielson & Hamann 1991 for the faces' ambiguity (docs/references.md).

/// Corners of the cube's faces (bit 0: x, bit 1: y, bit 2: z), counter-clockwise seen from outside the cube.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// An edge of the cube: its lower corner and its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Edge {
    /// The end with the lower coordinates.
    pub(super) corner: u8,
    /// 0: x, 1: y, 2: z.
    pub(super) axis: u8,
}

/// Triangles of one set of inside corners; counter-clockwise seen from outside the solid.
pub(super) type Case = Vec<[Edge; 3]>;

/// The triangles of all sets of inside corners (bit n: corner n is inside).
pub(super) fn cases() -> Vec<Case> {
    (0..256).map(case).collect()
}

fn edge(a: usize, b: usize) -> Edge {
    Edge { corner: a.min(b) as u8, axis: (a ^ b).trailing_zeros() as u8 }
}

fn case(inside: usize) -> Case {
    // For each edge where a face's outline enters the inside: the edge where it leaves next.
    let mut next = Vec::new();
    for face in &FACES {
        let is_in = |n: usize| inside >> face[n % 4] & 1 == 1;
        for enter in (0..4).filter(|&n| !is_in(n) && is_in(n + 1)) {
            let exit =
                (enter + 1..).find(|&n| !is_in(n + 1)).expect("an outline that enters leaves");
            let side = |n: usize| edge(face[n % 4], face[(n + 1) % 4]);
            next.push((side(enter), side(exit)));
        }
    }
    next.sort_unstable();
    let mut triangles = Vec::new();
    while let Some(&(start, _)) = next.first() {
        let (mut ring, mut at) = (Vec::new(), start);
        while let Some(found) = next.iter().position(|(from, _)| *from == at) {
            ring.push(at);
            at = next.remove(found).1;
        }
        let (cost, cut) = triangulation(&ring, 0, ring.len() - 1);
        assert!(cost.is_finite(), "every loop can be cut without a diagonal in a face");
        triangles.extend(cut);
    }
    triangles
}

/// The cheapest cut of the part of a loop from `from` to `to`, by squared lengths of diagonals.
fn triangulation(ring: &[Edge], from: usize, to: usize) -> (f64, Case) {
    let mut best = (if to - from < 2 { 0.0 } else { f64::INFINITY }, Vec::new());
    for middle in from + 1..to {
        let (low, mut cut) = triangulation(ring, from, middle);
        let (high, rest) = triangulation(ring, middle, to);
        let cost = low + high + diagonal(ring, from, middle) + diagonal(ring, middle, to);
        if cost < best.0 {
            cut.push([ring[from], ring[middle], ring[to]]);
            cut.extend(rest);
            best = (cost, cut);
        }
    }
    best
}

/// Squared length between two edges' midpoints; 0 for neighbours in the loop, infinite within a face.
fn diagonal(ring: &[Edge], a: usize, b: usize) -> f64 {
    if b - a == 1 || b - a == ring.len() - 1 {
        return 0.0;
    }
    let ends = |edge: Edge| [edge.corner as usize, edge.corner as usize | 1 << edge.axis];
    let on = |face: &[usize; 4], n: usize| ends(ring[n]).iter().all(|end| face.contains(end));
    if FACES.iter().any(|face| on(face, a) && on(face, b)) {
        return f64::INFINITY;
    }
    let middle = |n: usize, axis: usize| {
        ends(ring[n]).iter().map(|end| 0.5 * (end >> axis & 1) as f64).sum::<f64>()
    };
    (0..3).map(|axis| (middle(a, axis) - middle(b, axis)).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_cubes_agree_and_no_diagonal_lies_in_a_face() {
        let mut n_triangles = 0;
        for (inside, case) in cases().iter().enumerate() {
            n_triangles += case.len();
            // Directed edges that no other triangle of the cube runs along backwards are the loops' own.
            let runs: Vec<_> =
                case.iter().flat_map(|t| [0, 1, 2].map(|n| (t[n], t[(n + 1) % 3]))).collect();
            let open = |(a, b): &(Edge, Edge)| !runs.contains(&(*b, *a));
            for (a, b) in runs.iter().filter(|run| open(run)) {
                let ends = |e: &Edge| [e.corner as usize, e.corner as usize | 1 << e.axis];
                let face = FACES
                    .iter()
                    .find(|f| [a, b].iter().all(|e| ends(e).iter().all(|c| f.contains(c))));
                let face = face.expect("a loop's edge lies in a face");
                // Seen from the other cube the face is mirrored, its loop the other way round.
                let axis = (face[0] ^ face[2] ^ 7).trailing_zeros();
                let over = |e: &Edge| Edge { corner: e.corner ^ (1 << axis), axis: e.axis };
                let across: usize = (0..8)
                    .map(|c| {
                        // The neighbour shares the face's corners; its others are chosen as outside.
                        let shared = face.contains(&(c ^ (1 << axis)));
                        usize::from(shared && inside >> (c ^ (1 << axis)) & 1 == 1) << c
                    })
                    .sum();
                let other = &cases()[across];
                let back =
                    |t: &[Edge; 3]| (0..3).any(|n| (t[n], t[(n + 1) % 3]) == (over(b), over(a)));
                assert!(other.iter().any(back), "set {inside}, edge {a:?} {b:?}");
            }
        }
        assert_eq!(n_triangles, 820);
    }
}
