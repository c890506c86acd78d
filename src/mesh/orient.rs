//! Turns triangles over that disagree with their neighbours, where most of a component agrees.
//!
//! Some programs write faces of either sense of rotation. Where two neighbours run the same way along their edge, no collapse
//! around it is legal and no edge can be mended. Changes no place and no edge, only senses of rotation.

/// One vertex in this many is looked at to see if anything has to be done.
const LOOKED_AT: u32 = 8;

/// Bytes that `orient` takes for each triangle where something is found: sides, and pairs of neighbours.
pub const TRIANGLE_BYTES: u64 = 84;

/// Triangles that were turned, and components that cannot be turned right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Oriented {
    /// Triangles.
    pub turned: u64,
    /// Components of which some neighbours disagree whatever is turned, as on a Moebius band.
    pub one_sided: u64,
}

/// Turns triangles so that neighbours agree; of each component those that are fewer.
///
/// Edges of more than two triangles do not connect. A component that cannot be turned right as a whole is left unless fewer edges
/// disagree afterwards. Memory: `TRIANGLE_BYTES` a triangle where something is found, else one a vertex.
///
/// `is_locked`: whether there may be more triangles at a vertex, in other cells. If neighbours disagree only at edges between such
/// vertices, nothing is turned: where bodies meet that have a copy each of the wall between them, two of the four triangles at an edge are a body's.
pub fn orient(
    triangles: &mut [[u32; 3]],
    n_vertices: usize,
    is_locked: impl Fn(u32) -> bool,
) -> Oriented {
    match disagrees(triangles, n_vertices) {
        true => orient_all(triangles, is_locked),
        false => Oriented::default(),
    }
}

/// As `orient`, for meshes of which only few neighbours may disagree: looks at all of them.
pub fn orient_all(triangles: &mut [[u32; 3]], is_locked: impl Fn(u32) -> bool) -> Oriented {
    let neighbours = neighbours(triangles);
    let is_known = |a: [u32; 3], b: [u32; 3]| a.iter().any(|v| b.contains(v) && !is_locked(*v));
    let mut is_turned: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut component = Vec::new();
    let mut oriented = Oriented::default();
    for seed in 0..triangles.len() as u32 {
        if is_turned[seed as usize].is_some() {
            continue;
        }
        component.clear();
        component.push(seed);
        is_turned[seed as usize] = Some(false);
        // Sides of triangles that disagree with the neighbour, before and afterwards.
        let (mut before, mut after, mut turned, mut at) = (0u64, 0u64, 0, 0);
        let mut is_sure = false;
        while let Some(&t) = component.get(at) {
            at += 1;
            let own = is_turned[t as usize] == Some(true);
            turned += usize::from(own);
            let around = neighbours[t as usize];
            for (other, agrees) in around.into_iter().take_while(|&(other, _)| other != u32::MAX) {
                let wanted = own == agrees;
                match is_turned[other as usize] {
                    None => {
                        is_turned[other as usize] = Some(wanted);
                        component.push(other);
                    }
                    Some(is) => after += u64::from(is != wanted),
                }
                before += u64::from(!agrees);
                is_sure |= !agrees && is_known(triangles[t as usize], triangles[other as usize]);
            }
        }
        let is_minority = 2 * turned <= component.len();
        oriented.one_sided += u64::from(after > 0);
        if after >= before || !is_sure {
            continue;
        }
        for &t in &component {
            if (is_turned[t as usize] == Some(true)) == is_minority {
                triangles[t as usize].swap(1, 2);
                oriented.turned += 1;
            }
        }
    }
    oriented
}

/// True if neighbours run the same way along an edge at one of the vertices that are looked at.
///
/// Around an inner vertex every neighbour follows once and precedes once.
fn disagrees(triangles: &[[u32; 3]], n_vertices: usize) -> bool {
    let n = n_vertices.div_ceil(LOOKED_AT as usize);
    // All neighbours, each twice around an inner vertex; those that follow minus those that precede.
    let mut around = vec![(0u32, 0u32); n];
    for &[a, b, c] in triangles {
        for (v, after, before) in [(a, b, c), (b, c, a), (c, a, b)] {
            if v % LOOKED_AT == 0 {
                let (all, sum) = &mut around[(v / LOOKED_AT) as usize];
                *all ^= after ^ before;
                *sum = sum.wrapping_add(after).wrapping_sub(before);
            }
        }
    }
    around.iter().any(|&(all, sum)| all == 0 && sum != 0)
}

/// For each triangle the others at its edges of two triangles, and whether they agree, in order; then `u32::MAX`.
fn neighbours(triangles: &[[u32; 3]]) -> Vec<[(u32, bool); 3]> {
    let sides = || {
        (0u32..).zip(triangles).flat_map(|(t, &[a, b, c])| {
            [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), (a.max(b), t, a < b)))
        })
    };
    // Sides by their lesser vertex: first the ends of its places, which become their beginnings.
    let n = triangles.iter().flatten().max().map_or(0, |&v| v as usize + 1);
    let mut first = vec![0u32; n + 1];
    sides().for_each(|(v, _)| first[v as usize] += 1);
    (1..=n).for_each(|v| first[v] += first[v - 1]);
    let mut sorted = vec![(0, 0, false); 3 * triangles.len()];
    for (v, side) in sides() {
        first[v as usize] -= 1;
        sorted[first[v as usize] as usize] = side;
    }
    let mut neighbours = vec![[(u32::MAX, false); 3]; triangles.len()];
    let mut add = |t: u32, neighbour| {
        let free = neighbours[t as usize].iter_mut().find(|(other, _)| *other == u32::MAX);
        *free.expect("a triangle has three sides") = neighbour;
    };
    for v in 0..n {
        let sides = &mut sorted[first[v] as usize..first[v + 1] as usize];
        sides.sort_unstable();
        for edge in sides.chunk_by(|a, b| a.0 == b.0) {
            if let &[(_, s, ahead), (_, t, other)] = edge
                && s != t
            {
                add(s, (t, ahead != other));
                add(t, (s, ahead != other));
            }
        }
    }
    neighbours.iter_mut().for_each(|around| around.sort_unstable());
    neighbours
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mesh;

    /// A closed ball of 2 n (n - 1) triangles.
    fn ball(n: u32) -> Mesh {
        let mut positions = vec![[0.0, 0.0, 1.0]];
        for row in 1..n {
            let (s, c) = (std::f64::consts::PI * f64::from(row) / f64::from(n)).sin_cos();
            positions.extend((0..n).map(|k| {
                let (y, x) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
                [s * x, s * y, c]
            }));
        }
        positions.push([0.0, 0.0, -1.0]);
        let at = |row: u32, k: u32| 1 + row * n + k % n;
        let mut triangles = Vec::new();
        for k in 0..n {
            triangles.push([0, at(0, k), at(0, k + 1)]);
            for row in 0..n - 2 {
                let [a, b, c, d] = [at(row, k), at(row, k + 1), at(row + 1, k), at(row + 1, k + 1)];
                triangles.extend([[a, c, b], [b, c, d]]);
            }
            triangles.push([at(n - 2, k), (n - 1) * n + 1, at(n - 2, k + 1)]);
        }
        Mesh::new(positions, triangles)
    }

    #[test]
    fn the_fewer_are_turned() {
        let right = ball(24);
        assert_eq!(
            orient(&mut right.triangles.clone(), right.positions.len(), |_| false).turned,
            0
        );
        for (every, n_turned) in [(7, None), (1, Some(0))] {
            let mut mesh = right.clone();
            mesh.triangles.iter_mut().step_by(every).for_each(|t| t.swap(1, 2));
            let all_over = mesh.triangles.clone();
            let n = orient(&mut mesh.triangles, mesh.positions.len(), |_| false).turned;
            assert_eq!(n, n_turned.unwrap_or(right.triangles.len().div_ceil(7) as u64));
            let expected = if every == 1 { &all_over } else { &right.triangles };
            assert_eq!(&mesh.triangles, expected);
        }
    }

    #[test]
    fn bodies_that_meet_at_the_border_of_a_cell_are_left() {
        // Two walls that belong to two bodies; what else there is at the edge 0 - 1, and at 0 - 2 and 1 - 3, other cells have.
        let walls = [[0, 1, 2], [0, 1, 3], [1, 4, 2], [1, 5, 3]];
        for (locked, n_turned) in [(6, 0), (0, 2)] {
            let mut triangles = walls;
            let oriented = orient_all(&mut triangles, |v| v < locked);
            assert_eq!(oriented.turned, n_turned);
            assert_eq!(triangles == walls, n_turned == 0);
        }
    }

    #[test]
    fn a_moebius_band_is_left() {
        // Squares along a band whose ends meet upside down.
        let n = 20u32;
        let place = |v: u32| [f64::from(v / 2), f64::from(v % 2), 0.0];
        let squares = (0..n).flat_map(|k| {
            let (a, b) = (2 * k, 2 * k + 1);
            let [c, d] = if k + 1 == n { [1, 0] } else { [a + 2, b + 2] };
            [[a, c, b], [b, c, d]]
        });
        let band = Mesh::new((0..2 * n).map(place).collect(), squares.collect());
        let mut mesh = band.clone();
        assert_eq!(
            orient_all(&mut mesh.triangles, |_| false),
            Oriented { turned: 0, one_sided: 1 }
        );
        assert_eq!(mesh.triangles, band.triangles);
    }
}
