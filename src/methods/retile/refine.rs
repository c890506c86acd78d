//! The surface as fine as clusters need it: edges that are long beside a cluster are halved until none is.

use crate::key_table::KeyTable;
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{Vec3, add, length_sq, normal, scale, sub};
use stonecut_system::error::{Error, Result};
use stonecut_system::memory::BASE_BYTES;
use stonecut_system::progress::Progress;
use stonecut_system::units::memory_word;

/// The surface that is clustered: the vertices of the input, then the middles of edges.
///
/// Memory: 84 bytes a vertex and 12 a triangle, of which it has about two.
pub(super) struct Surface {
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Ends of the edge that each vertex beyond those of the input is the middle of.
    pub(super) ends: Vec<[u32; 2]>,
    /// A third of the area around each vertex, times its density.
    pub(super) weights: Vec<f64>,
    /// First place of the neighbours of each vertex; one more than there are vertices.
    first: Vec<u32>,
    pub(super) neighbours: Vec<u32>,
}

/// Memory for a vertex and its share of triangles, in bytes; with tables of owners, seeds and the queue.
pub(super) const VERTEX_BYTES: u64 = 24 + 24 + 8 + 8 + 4 + 28 + 32;

/// A vertex beyond those that the memory holds.
#[derive(Debug)]
pub(super) struct TooMany;

impl Surface {
    /// Halves all edges longer than `longest` (input units), or on a surface of needles the large triangles.
    ///
    /// Errors: `NoMemory` beyond the vertices that some memory holds, with a size that is enough.
    pub(super) fn refined(
        positions: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
        longest: f64,
        (memory_bytes, per_vertex): (u64, u64),
        progress: &Progress,
    ) -> Result<Surface> {
        let most = memory_bytes / per_vertex;
        let n_given = positions.len();
        let mut surface = Surface::new(positions, triangles);
        let too_many = |surface: &Surface| surface.too_many(longest, per_vertex);
        if surface.is_of_needles(longest) {
            surface.cut_needles(longest, most, progress)?.map_err(|TooMany| too_many(&surface))?;
        } else {
            while surface.halve(longest, most).map_err(|TooMany| too_many(&surface))? {
                progress.check()?;
            }
        }
        debug_assert_eq!(surface.positions.len(), n_given + surface.ends.len());
        surface.weigh();
        surface.join();
        Ok(surface)
    }

    /// A surface as it is given, without weights and neighbours.
    pub(super) fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Surface {
        Surface {
            positions,
            triangles,
            ends: Vec::new(),
            weights: Vec::new(),
            first: Vec::new(),
            neighbours: Vec::new(),
        }
    }

    /// Halves the edges that are too long, once; false if none is.
    ///
    /// Ends at the first vertex beyond `most`: one pass can make four times as many.
    fn halve(&mut self, longest: f64, most: u64) -> Result<bool, TooMany> {
        let most = most.min(u64::from(u32::MAX) / 6);
        let limit = longest * longest;
        let n_before = self.positions.len();
        let mut middles = KeyTable::<u64>::default();
        let mut fine = Vec::with_capacity(self.triangles.len());
        for &t in &self.triangles {
            let mut middle = [None; 3];
            for k in 0..3 {
                let (a, b) = (t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3]));
                let [p, q] = [a, b].map(|v| self.positions[v as usize]);
                if length_sq(sub(q, p)) <= limit {
                    continue;
                }
                let number = middles.number(u64::from(a) << 32 | u64::from(b)) as usize;
                if n_before + number == self.positions.len() {
                    if self.positions.len() as u64 >= most {
                        return Err(TooMany);
                    }
                    self.positions.push(scale(add(p, q), 0.5));
                    self.ends.push([a, b]);
                }
                middle[k] = Some((n_before + number) as u32);
            }
            self.cut(t, middle, &mut fine);
        }
        // Numbers of neighbours, six a triangle, are 32 bits wide.
        if fine.len() as u64 > u64::from(u32::MAX) / 6 {
            return Err(TooMany);
        }
        count(fine.len());
        self.triangles = fine;
        Ok(self.positions.len() > n_before)
    }

    /// A refusal that names a size with which there is none: each triangle is cut into at most four as often as its longest
    /// edge is halved, and adds half a vertex for each, or its three corners.
    fn too_many(&self, longest: f64, per_vertex: u64) -> Error {
        let vertices = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| self.positions[v as usize]);
            let long =
                length_sq(sub(b, a)).max(length_sq(sub(c, b))).max(length_sq(sub(a, c))).sqrt();
            let rounds = (long / longest).log2().ceil().max(0.0);
            1.5 * 4f64.powf(rounds)
        };
        let sum: f64 = self.triangles.iter().map(vertices).sum();
        let bytes = (self.positions.len() as f64 + sum) * per_vertex as f64 + BASE_BYTES as f64;
        Error::NoMemory(format!(
            "--method retile cuts long triangles to a quarter of an edge of the result: that takes more vertices than the \
             budget holds; ask for fewer triangles, or give --memory {}",
            memory_word(bytes as u64)
        ))
    }

    /// Cuts a triangle at the middles of its edges; edge `k` begins at corner `k`.
    pub(super) fn cut(&self, t: [u32; 3], middle: [Option<u32>; 3], out: &mut Vec<[u32; 3]>) {
        let turned = |k: usize| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
        let n_middles = middle.iter().flatten().count();
        match (n_middles, middle) {
            (_, [Some(ab), Some(bc), Some(ca)]) => {
                let [a, b, c] = t;
                out.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            (1, _) => {
                for (k, m) in middle.into_iter().enumerate() {
                    if let Some(m) = m {
                        let [a, b, c] = turned(k);
                        out.extend([[a, m, c], [m, b, c]]);
                    }
                }
            }
            (2, _) => {
                for k in 0..3 {
                    if let (Some(ab), Some(bc)) = (middle[k], middle[(k + 1) % 3]) {
                        let [a, b, c] = turned(k);
                        let length = |v: u32, w: u32| {
                            let [p, q] = [v, w].map(|v| self.positions[v as usize]);
                            length_sq(sub(p, q))
                        };
                        out.push([ab, b, bc]);
                        match length(a, bc) <= length(ab, c) {
                            true => out.extend([[a, ab, bc], [a, bc, c]]),
                            false => out.extend([[a, ab, c], [ab, bc, c]]),
                        }
                    }
                }
            }
            _ => out.push(t),
        }
    }

    fn weigh(&mut self) {
        self.weights = vec![0.0; self.positions.len()];
        for t in &self.triangles {
            let area = length_sq(normal(t.map(|v| self.positions[v as usize]))).sqrt() / 2.0;
            t.iter().for_each(|&v| self.weights[v as usize] += area / 3.0);
        }
    }

    /// Lists the neighbours of every vertex.
    pub(super) fn join(&mut self) {
        let mut n_around = vec![0u32; self.positions.len() + 1];
        self.triangles.iter().flatten().for_each(|&v| n_around[v as usize + 1] += 2);
        for v in 1..n_around.len() {
            n_around[v] += n_around[v - 1];
        }
        let mut place = n_around.clone();
        let mut all = vec![0u32; 6 * self.triangles.len()];
        for t in &self.triangles {
            for k in 0..3 {
                for w in [t[(k + 1) % 3], t[(k + 2) % 3]] {
                    let place = &mut place[t[k] as usize];
                    all[*place as usize] = w;
                    *place += 1;
                }
            }
        }
        drop(place);
        // Each once: two triangles tell of nearly every neighbour.
        let (mut first, mut n) = (Vec::with_capacity(n_around.len()), 0);
        for v in 0..self.positions.len() {
            let (start, end) = (n_around[v] as usize, n_around[v + 1] as usize);
            all[start..end].sort_unstable();
            first.push(n as u32);
            for i in start..end {
                // What is read lies at or behind what is written.
                let w = all[i];
                if n == first[v] as usize || all[n - 1] != w {
                    all[n] = w;
                    n += 1;
                }
            }
        }
        first.push(n as u32);
        all.truncate(n);
        all.shrink_to_fit();
        (self.first, self.neighbours) = (first, all);
    }

    pub(super) fn neighbours(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.neighbours[self.first[v] as usize..self.first[v + 1] as usize]
    }

    /// Area in input units squared, before densities.
    pub(super) fn area(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
        let twice = |t: &[u32; 3]| length_sq(normal(t.map(|v| positions[v as usize]))).sqrt();
        triangles.iter().map(twice).sum::<f64>() / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_edge_is_long_and_neighbours_agree() {
        let positions = vec![[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 3.0, 0.0], [9.0, 4.0, 2.0]];
        let triangles = vec![[0, 1, 2], [2, 1, 3]];
        let area = Surface::area(&positions, &triangles);
        let surface =
            Surface::refined(positions, triangles, 0.7, (1 << 20, 1), &Progress::default())
                .unwrap();
        assert!((Surface::area(&surface.positions, &surface.triangles) - area).abs() < 1e-9);
        assert!((surface.weights.iter().sum::<f64>() - area).abs() < 1e-9);
        let mut edges = std::collections::HashMap::<[u32; 2], i32>::new();
        for t in &surface.triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let [p, q] = [a, b].map(|v| surface.positions[v as usize]);
                assert!(length_sq(sub(p, q)) <= 0.49 + 1e-12);
                assert!(surface.neighbours(a).contains(&b) && surface.neighbours(b).contains(&a));
                *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        // No crack: a plane, open along a loop of edges that are in one triangle only.
        let n_open = edges.values().filter(|n| **n != 0).count() as i64;
        let n_vertices = surface.positions.len() as i64;
        assert_eq!(n_vertices - edges.len() as i64 + surface.triangles.len() as i64, 1);
        assert_eq!(3 * surface.triangles.len() as i64, 2 * edges.len() as i64 - n_open);
        for v in 0..surface.positions.len() as u32 {
            let around = surface.neighbours(v);
            assert!(around.windows(2).all(|pair| pair[0] < pair[1]));
        }
        let too_many = Surface::refined(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            vec![[0, 1, 2]],
            0.01,
            (100, 1),
            &Progress::default(),
        );
        assert!(matches!(too_many, Err(Error::NoMemory(_))));
    }

    /// A pass over a strip would make four times its vertices; it ends at the limit.
    #[test]
    fn a_pass_ends_at_the_first_vertex_too_many() {
        let n = 400u32;
        let positions: Vec<Vec3> =
            (0..2 * n).map(|v| [f64::from(v / 2), f64::from(v % 2), 0.0]).collect();
        let triangles = (0..2 * n - 2).map(|v| [v, v + 1, v + 2]).collect();
        let most = positions.len() + 10;
        let mut surface = Surface::new(positions, triangles);
        assert!(matches!(surface.halve(0.1, most as u64), Err(TooMany)));
        assert_eq!(surface.positions.len(), most);
    }
}
