//! A mesh on the way between the ends of a progressive mesh: vertices, triangles, and the triangles of each vertex.
//!
//! The writer and the reader take the same steps on it, so that a step can be told relative to what is there. It checks
//! nothing: `steps` does, where bytes come in.

use stonecut_mesh::corners::others;

/// The end of a list; a vertex or a triangle that is gone.
pub(super) const NONE: u32 = u32::MAX;

/// A vertex with more triangles than this has no order around it.
const MOST_AROUND: usize = 200;

/// A mesh whose vertices and triangles are numbered in the order in which they appeared.
///
/// Memory: a row and 8 bytes a vertex, 28 bytes a triangle.
#[derive(Clone)]
pub(super) struct Replay {
    /// Bytes of a row.
    pub(super) stride: usize,
    /// Values of each vertex, packed.
    pub(super) rows: Vec<u8>,
    /// Place of each vertex in the order of the output.
    pub(super) keys: Vec<u32>,
    /// First corner in the list of each vertex.
    heads: Vec<u32>,
    /// Corners of each triangle; the first is `NONE` if it is gone.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Place of each triangle in the order of the output.
    pub(super) triangle_keys: Vec<u32>,
    /// The next corner of the same vertex, for each corner.
    next: Vec<[u32; 3]>,
    /// Triangles that are there.
    pub(super) n_triangles: u64,
}

/// Order of the triangles around a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Each follows the one before it, the first the last.
    Closed,
    /// Each follows the one before it.
    Open,
    /// None that was looked for.
    None,
}

/// The triangles around a vertex, in order if they have one.
pub(super) struct Around {
    pub(super) order: Order,
    pub(super) triangles: Vec<u32>,
    /// The vertices around it: one more than triangles if open, none without an order.
    pub(super) rim: Vec<u32>,
}

/// Ranks of the vertices that were there when they were made; those that came later have their numbers.
#[derive(Default)]
pub(super) struct Ranks {
    of_vertex: Vec<u32>,
    vertices: Vec<u32>,
}

impl Ranks {
    pub(super) fn of(&self, vertex: u32) -> u32 {
        self.of_vertex.get(vertex as usize).copied().unwrap_or(vertex)
    }

    pub(super) fn vertex(&self, rank: u32) -> u32 {
        self.vertices.get(rank as usize).copied().unwrap_or(rank)
    }
}

impl Around {
    /// The vertices on both sides of some triangles that follow each other.
    pub(super) fn sides(&self, start: usize, length: usize) -> Option<[u32; 2]> {
        let n = self.rim.len();
        let end = match self.order {
            Order::Closed if n > 0 => (start + length) % n,
            _ => start + length,
        };
        Some([*self.rim.get(start)?, *self.rim.get(end)?])
    }

    /// Numbers in `triangles` of `length` that follow each other.
    pub(super) fn arc(&self, start: usize, length: usize) -> impl Iterator<Item = usize> {
        let n = self.triangles.len().max(1);
        (start..start + length).map(move |i| i % n)
    }
}

impl Replay {
    pub(super) fn new(stride: usize) -> Replay {
        Replay {
            stride,
            rows: Vec::new(),
            keys: Vec::new(),
            heads: Vec::new(),
            triangles: Vec::new(),
            triangle_keys: Vec::new(),
            next: Vec::new(),
            n_triangles: 0,
        }
    }

    /// Memory in bytes.
    pub(super) fn bytes(&self) -> u64 {
        (self.rows.len() + 8 * self.keys.len() + 28 * self.triangles.len()) as u64
    }

    pub(super) fn row(&self, v: u32) -> &[u8] {
        &self.rows[v as usize * self.stride..][..self.stride]
    }

    pub(super) fn set_row(&mut self, v: u32, row: &[u8]) {
        self.rows[v as usize * self.stride..][..self.stride].copy_from_slice(row);
    }

    /// Returns whether a vertex has triangles.
    pub(super) fn has_vertex(&self, v: u32) -> bool {
        self.heads.get(v as usize).is_some_and(|&head| head != NONE)
    }

    /// Returns whether a triangle is there.
    pub(super) fn has_triangle(&self, t: u32) -> bool {
        self.triangles.get(t as usize).is_some_and(|t| t[0] != NONE)
    }

    pub(super) fn add_vertex(&mut self, row: &[u8], key: u32) -> u32 {
        self.rows.extend_from_slice(row);
        self.keys.push(key);
        self.heads.push(NONE);
        self.heads.len() as u32 - 1
    }

    /// Adds a triangle; its corners must be vertices.
    pub(super) fn add_triangle(&mut self, corners: [u32; 3], key: u32) -> u32 {
        let t = self.triangles.len() as u32;
        let mut next = [NONE; 3];
        for (k, (next, v)) in (0..).zip(next.iter_mut().zip(corners)) {
            *next = std::mem::replace(&mut self.heads[v as usize], 3 * t + k);
        }
        self.triangles.push(corners);
        self.triangle_keys.push(key);
        self.next.push(next);
        self.n_triangles += 1;
        t
    }

    /// Ranks of the vertices: those with the most triangles around them first, between equals in their order. For compact files:
    /// vertices that many others vanished into are split first.
    pub(super) fn ranks(&self) -> Ranks {
        const CLASSES: usize = 12;
        let mut counts = vec![0u8; self.keys.len()];
        for v in self.triangles.iter().filter(|t| t[0] != NONE).flatten() {
            let count = &mut counts[*v as usize];
            *count = (*count + 1).min(CLASSES as u8 - 1);
        }
        let mut starts = [0u32; CLASSES + 1];
        counts.iter().for_each(|&n| starts[CLASSES - usize::from(n)] += 1);
        (1..=CLASSES).for_each(|i| starts[i] += starts[i - 1]);
        let (mut of_vertex, mut vertices) = (vec![0; counts.len()], vec![0; counts.len()]);
        for (v, &n) in (0..).zip(&counts) {
            let rank = &mut starts[CLASSES - 1 - usize::from(n)];
            (of_vertex[v as usize], vertices[*rank as usize]) = (*rank, v);
            *rank += 1;
        }
        Ranks { of_vertex, vertices }
    }

    fn remove_triangle(&mut self, t: u32) {
        for k in 0..3 {
            let v = self.triangles[t as usize][k as usize];
            let (own, after) = (3 * t + k, self.next[t as usize][k as usize]);
            if self.heads[v as usize] == own {
                self.heads[v as usize] = after;
                continue;
            }
            let mut at = self.heads[v as usize];
            while at != NONE {
                let next = &mut self.next[at as usize / 3][at as usize % 3];
                if *next == own {
                    *next = after;
                    break;
                }
                at = *next;
            }
        }
        self.triangles[t as usize][0] = NONE;
        self.n_triangles -= 1;
    }

    pub(super) fn corners_of(&self, v: u32) -> impl Iterator<Item = u32> {
        let mut at = self.heads[v as usize];
        std::iter::from_fn(move || {
            let now = at;
            if now != NONE {
                at = self.next[now as usize / 3][now as usize % 3];
            }
            (now != NONE).then_some(now)
        })
    }

    /// The triangles around a vertex.
    pub(super) fn around(&self, v: u32) -> Around {
        let triangles: Vec<u32> = self.corners_of(v).map(|corner| corner / 3).collect();
        let n = triangles.len();
        let none = |triangles| Around { order: Order::None, triangles, rim: Vec::new() };
        if n == 0 || n > MOST_AROUND {
            return none(triangles);
        }
        let ends: Vec<(u32, u32)> =
            triangles.iter().map(|&t| others(self.triangles[t as usize], v)).collect();
        let is_start = |i: &usize| !ends.iter().any(|&(_, c)| c == ends[*i].0);
        let first = (0..n).find(is_start);
        let (mut order, mut rim) = (Vec::with_capacity(n), Vec::with_capacity(n + 1));
        let mut is_used = [false; MOST_AROUND];
        let mut at = first.unwrap_or(0);
        loop {
            is_used[at] = true;
            order.push(triangles[at]);
            rim.push(ends[at].0);
            let last = ends[at].1;
            match ends.iter().position(|&(b, _)| b == last) {
                Some(next) if !is_used[next] => at = next,
                _ => {
                    let is_whole = order.len() == n;
                    return match first {
                        None if is_whole && last == rim[0] => {
                            Around { order: Order::Closed, triangles: order, rim }
                        }
                        Some(_) if is_whole && !rim.contains(&last) => {
                            rim.push(last);
                            Around { order: Order::Open, triangles: order, rim }
                        }
                        _ => none(triangles),
                    };
                }
            }
        }
    }

    /// Gives the corners of `from` in triangles that `moves` tells of to `to`; both are vertices.
    pub(super) fn move_corners(&mut self, from: u32, to: u32, moves: impl Fn(u32) -> bool) {
        let mut at = std::mem::replace(&mut self.heads[from as usize], NONE);
        while at != NONE {
            let (t, k) = (at as usize / 3, at as usize % 3);
            let owner = if moves(t as u32) { to } else { from };
            self.triangles[t][k] = owner;
            let head = std::mem::replace(&mut self.heads[owner as usize], at);
            at = std::mem::replace(&mut self.next[t][k], head);
        }
    }

    /// Takes a cut back: both caps go, and the vertices of one side become those of the other.
    pub(super) fn join(&mut self, cycle: [u32; 3], new: [u32; 3], caps: [u32; 2]) {
        caps.into_iter().for_each(|t| self.remove_triangle(t));
        for (from, to) in new.into_iter().zip(cycle) {
            self.move_corners(from, to, |_| true);
        }
    }
}
