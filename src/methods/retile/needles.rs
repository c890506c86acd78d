//! Surfaces of needles, fans and strips of them above all: edges are halved where that takes area, not where they are long.
//!
//! Halving every long edge cuts a needle into thousands, each narrower than a cluster could ever be. Here vertices that are
//! much nearer to each other than vertices of the result become one first, and of what is left the largest triangles are
//! halved: as many vertices as an even surface of that area has. Only where halving the edges would take many times as many
//! (`is_of_needles`), so that other surfaces stay as they are.

use super::clusters::NONE;
use super::refine::{Surface, TooMany};
use crate::key_table::KeyTable;
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{add, length_sq, normal, scale, sub};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Triangles made by halving for each of the input and of an even surface, beyond which a surface is one of needles. Halving
/// makes up to 12 of each where the sides of triangles are as 1 to 2.
const MOST_PIECES: f64 = 32.0;
/// Vertices at one edge that are nearer than this share of the longest edge become one.
const APART: f64 = 0.25;
/// Triangles of less area than this share of the square of the longest edge stay whole.
const SMALL: f64 = 0.125;
/// Passes at most; each halves the largest triangles.
const PASSES: usize = 64;
/// Passes end where fewer than one in this number of the vertices is new: what one pass halves at the tip of a cone, the next
/// one joins, for ever.
const LEAST_ADDED: usize = 1000;

impl Surface {
    /// True if halving all edges longer than `longest` would make many times the triangles of an even surface.
    pub(super) fn is_of_needles(&self, longest: f64) -> bool {
        let rounds = |side_sq: f64| (0.5 * (side_sq / (longest * longest)).log2()).ceil().max(0.0);
        // While all sides are too long a pass makes four of each; then three, since the cut across a needle's quad is long.
        let pieces = |t: &[u32; 3]| {
            let mut sides_sq = self.sides_sq(*t);
            sides_sq.sort_unstable_by(f64::total_cmp);
            let (all, both) = (rounds(sides_sq[2]), rounds(sides_sq[0]));
            4f64.powf(both) * 3f64.powf(all - both)
        };
        let n_pieces: f64 = self.triangles.iter().map(pieces).sum();
        let even = Surface::area(&self.positions, &self.triangles) / (longest * longest);
        n_pieces > MOST_PIECES * (self.triangles.len() as f64 + even)
    }

    /// Joins vertices that are near each other and halves triangles that are large, in turn, until hardly any is. Returns the
    /// passes that takes.
    pub(super) fn cut_needles(
        &mut self,
        longest: f64,
        most: u64,
        progress: &Progress,
    ) -> Result<Result<usize, TooMany>> {
        for pass in 1..=PASSES {
            progress.check()?;
            self.join_near(APART * longest);
            match self.halve_large(longest, most) {
                Ok(n_added) if n_added * LEAST_ADDED > self.positions.len() => {}
                Ok(_) => return Ok(Ok(pass)),
                Err(TooMany) => return Ok(Err(TooMany)),
            }
        }
        Ok(Ok(PASSES))
    }

    /// Squared lengths of the edges of a triangle, each from the corner of its number.
    fn sides_sq(&self, t: [u32; 3]) -> [f64; 3] {
        let at = t.map(|v| self.positions[v as usize]);
        [0, 1, 2].map(|k| length_sq(sub(at[(k + 1) % 3], at[k])))
    }

    /// Makes vertices one with the first one in order that edges lead to without leaving a ball of this radius around it.
    fn join_near(&mut self, radius: f64) {
        self.join();
        count(self.neighbours.len());
        let mut of = vec![NONE; self.positions.len()];
        let mut stack = Vec::new();
        for centre in 0..of.len() as u32 {
            if of[centre as usize] != NONE {
                continue;
            }
            of[centre as usize] = centre;
            stack.push(centre);
            let middle = self.positions[centre as usize];
            while let Some(v) = stack.pop() {
                for &w in self.neighbours(v) {
                    let away_sq = length_sq(sub(self.positions[w as usize], middle));
                    if of[w as usize] == NONE && away_sq < radius * radius {
                        of[w as usize] = centre;
                        stack.push(w);
                    }
                }
            }
        }
        self.triangles.iter_mut().for_each(|t| *t = t.map(|v| of[v as usize]));
        self.triangles.retain(|&[a, b, c]| a != b && b != c && c != a);
    }

    /// Halves the longest edge of each large triangle, once. Returns how many vertices that adds.
    fn halve_large(&mut self, longest: f64, most: u64) -> Result<usize, TooMany> {
        let most = most.min(u64::from(u32::MAX) / 6);
        let key = |v: u32, w: u32| u64::from(v.min(w)) << 32 | u64::from(v.max(w));
        count(self.triangles.len());
        let n_before = self.positions.len();
        let mut middles = KeyTable::<u64>::default();
        for &t in &self.triangles {
            let sides_sq = self.sides_sq(t);
            let k = (0..3).fold(0, |k, i| if sides_sq[i] > sides_sq[k] { i } else { k });
            let twice_area = length_sq(normal(t.map(|v| self.positions[v as usize]))).sqrt();
            let is_large = twice_area > 2.0 * SMALL * longest * longest;
            if is_large && sides_sq[k] > longest * longest {
                let number = u64::from(middles.number(key(t[k], t[(k + 1) % 3])));
                if n_before as u64 + number >= most {
                    return Err(TooMany);
                }
            }
        }
        for &edge in middles.keys() {
            let ends = [(edge >> 32) as u32, edge as u32];
            let [p, q] = ends.map(|v| self.positions[v as usize]);
            self.positions.push(scale(add(p, q), 0.5));
            self.ends.push(ends);
        }
        let mut fine = Vec::with_capacity(self.triangles.len() + 2 * middles.keys().len());
        for &t in &self.triangles {
            let middle = |k: usize| middles.find(key(t[k], t[(k + 1) % 3]));
            let middle = [0, 1, 2].map(|k| middle(k).map(|number| n_before as u32 + number));
            self.cut(t, middle, &mut fine);
        }
        // Numbers of neighbours, six a triangle, are 32 bits wide.
        if fine.len() as u64 > u64::from(u32::MAX) / 6 {
            return Err(TooMany);
        }
        self.triangles = fine;
        Ok(self.positions.len() - n_before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::vec3::Vec3;

    /// Two cones with one rim. The last of 14 passes had added a handful of vertices each; with other numbers that went on for ever.
    #[test]
    fn passes_end_where_they_add_next_to_nothing() {
        let n = 500;
        let rim = (0..n).map(|i| {
            let (y, x) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
            [x, y, 0.0]
        });
        let positions = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]].into_iter().chain(rim).collect();
        let around = |i: u32| [[0, 2 + i, 2 + (i + 1) % n], [1, 2 + (i + 1) % n, 2 + i]];
        let mut bicone = Surface::new(positions, (0..n).flat_map(around).collect());
        let n_passes = bicone.cut_needles(0.025, 200_000, &Progress::default()).unwrap().unwrap();
        assert!(n_passes < 13, "{n_passes}");
        assert!((50_000..200_000).contains(&bicone.ends.len()), "{}", bicone.ends.len());
    }

    /// A strip of needles takes about as many vertices as a square of two triangles, and is as large.
    ///
    /// ```text
    ///   ________
    ///  |/|/|/|/|
    ///  |/|/|/|/|
    /// ```
    #[test]
    fn needles_take_area_and_even_triangles_are_not_of_them() {
        let strip = |n: u32| {
            let positions: Vec<Vec3> = (0..2 * n + 2)
                .map(|v| [f64::from(v / 2) / f64::from(n), f64::from(v % 2), 0.0])
                .collect();
            let triangles = (0..n)
                .flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]])
                .collect();
            Surface::new(positions, triangles)
        };
        assert!(!strip(1).is_of_needles(0.05) && !strip(20).is_of_needles(0.05));
        let mut needles = strip(1000);
        assert!(needles.is_of_needles(0.05));
        needles.cut_needles(0.05, 100_000, &Progress::default()).unwrap().unwrap();
        let n_added = needles.ends.len();
        assert!((400..20_000).contains(&n_added), "{n_added}");
        let area = Surface::area(&needles.positions, &needles.triangles);
        assert!((area - 1.0).abs() < 0.03, "{area}");
        let longest = needles.triangles.iter().flat_map(|&t| needles.sides_sq(t));
        assert!(longest.fold(0.0, f64::max) < 0.03);
        let mut few = strip(1000);
        assert!(matches!(few.cut_needles(0.05, 2100, &Progress::default()), Ok(Err(TooMany))));
    }
}
