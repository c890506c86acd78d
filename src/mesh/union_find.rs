//! Union-find over `u32` ids (4 bytes each).
//!
//! The root of a set is the least number in it: deterministic, and shallow on meshes whose neighbours stand
//! together. Used for components of surfaces and for corners of one vertex. It knows nothing of meshes.
//!
//! Source: union-find with path halving, Tarjan & van Leeuwen 1984 (docs/references.md).

/// The sets that 0 to n - 1 belong to.
#[derive(Default)]
pub struct Union {
    parent: Vec<u32>,
}

impl Union {
    /// Each of `n` numbers for itself.
    pub fn new(n: usize) -> Self {
        Union { parent: (0..n as u32).collect() }
    }

    /// Starts again with `n` numbers, keeping the memory.
    pub fn reset(&mut self, n: usize) {
        self.parent.clear();
        self.parent.extend(0..n as u32);
    }

    /// The least number of the set; the path to it becomes shorter.
    pub fn root(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let above = self.parent[self.parent[v as usize] as usize];
            self.parent[v as usize] = above;
            v = above;
        }
        v
    }

    /// Makes two sets one.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// For each number the root of its set.
    pub fn into_roots(mut self) -> Vec<u32> {
        // What is above a number is less than it, and final by then.
        for v in 0..self.parent.len() {
            self.parent[v] = self.parent[self.parent[v] as usize];
        }
        self.parent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_number_stands_for_its_set() {
        let mut union = Union::new(7);
        for (a, b) in [(5, 6), (6, 2), (4, 3), (3, 4)] {
            union.join(a, b);
        }
        assert_eq!(union.root(6), 2);
        assert_eq!(union.into_roots(), [0, 1, 2, 3, 3, 2, 2]);
    }
}
