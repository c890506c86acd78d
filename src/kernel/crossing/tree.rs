//! Boxes of triangles in a tree that follows the surface: eight in a row have one box, eight of these the next.
//!
//! Triangles lie near each other in memory, so a row is a region. A box only grows until the tree is built again.

use super::screen::{Around, eight, splat};
use crate::simd::unchecked::prefetch;
use crate::simd::{Job, Lanes, Simd};
use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::vec3::Vec3;

/// Boxes side by side: as many as have one box in the level above.
const ROW: usize = 8;

/// A box along the axes, relative to the centre of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hull {
    low: [f32; 3],
    high: [f32; 3],
}

impl Hull {
    /// The box of nothing: touches none.
    pub(crate) const EMPTY: Hull = Hull { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    pub(super) fn join(&mut self, other: &Hull) {
        for k in 0..3 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
    }

    /// Returns whether two boxes have a common point.
    pub(super) fn touches(&self, other: &Hull) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    fn holds(&self, other: &Hull) -> bool {
        (0..3).all(|k| self.low[k] <= other.low[k] && other.high[k] <= self.high[k])
    }
}

/// Eight boxes, number by number, so that all are looked at together.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Row {
    low: [[f32; ROW]; 3],
    high: [[f32; ROW]; 3],
}

impl Row {
    const EMPTY: Row = Row { low: [[f32::INFINITY; ROW]; 3], high: [[f32::NEG_INFINITY; ROW]; 3] };

    fn get(&self, i: usize) -> Hull {
        Hull { low: self.low.map(|x| x[i]), high: self.high.map(|x| x[i]) }
    }

    fn set(&mut self, i: usize, hull: &Hull) {
        for k in 0..3 {
            (self.low[k][i], self.high[k][i]) = (hull.low[k], hull.high[k]);
        }
    }

    fn hull(&self) -> Hull {
        let least = |x: [f32; ROW]| x.into_iter().fold(f32::INFINITY, f32::min);
        let most = |x: [f32; ROW]| x.into_iter().fold(f32::NEG_INFINITY, f32::max);
        Hull { low: self.low.map(least), high: self.high.map(most) }
    }

    /// Fetches it into the cache.
    #[inline(always)]
    fn fetch(&self) {
        prefetch(&self.low, 0);
        prefetch(&self.low, 2);
        prefetch(&self.high, 1);
    }

    /// The boxes of eight triangles by their corners.
    #[inline(always)]
    fn of<L: Lanes>(corners: &[[L; 3]]) -> Row {
        let mut row = Row::EMPTY;
        for k in 0..3 {
            let (mut low, mut high) = (corners[0][k], corners[0][k]);
            for corner in &corners[1..] {
                (low, high) = (low.lesser(corner[k]), high.greater(corner[k]));
            }
            (row.low[k], row.high[k]) = (low.store(), high.store());
        }
        row
    }

    /// A bit for each box that touches another.
    #[inline(always)]
    fn touching<L: Lanes>(&self, hull: &Splat<L>) -> u32 {
        let mut apart = 0;
        for k in 0..3 {
            let (low, high) = (L::load(&self.low[k]), L::load(&self.high[k]));
            apart |= hull.high[k].below(low) | high.below(hull.low[k]);
        }
        !apart & 0xFF
    }
}

/// A box eight times.
struct Splat<L> {
    low: [L; 3],
    high: [L; 3],
}

impl<L: Lanes> Splat<L> {
    #[inline(always)]
    fn of(hull: &Hull) -> Self {
        Splat { low: splat(hull.low), high: splat(hull.high) }
    }
}

/// A few boxes, to hold others against.
#[derive(Clone, Default)]
pub(super) struct Hulls(Vec<Row>);

impl Hulls {
    /// Takes these boxes instead of those before.
    pub(super) fn fill(&mut self, hulls: impl Iterator<Item = Hull>) -> Hull {
        self.0.clear();
        let mut all = Hull::EMPTY;
        for (i, hull) in hulls.enumerate() {
            if i % ROW == 0 {
                self.0.push(Row::EMPTY);
            }
            if let Some(row) = self.0.last_mut() {
                row.set(i % ROW, &hull);
            }
            all.join(&hull);
        }
        all
    }

    /// Takes the boxes of triangles around a place, relative to `centre`; gives back the box of all.
    #[inline(always)]
    pub(super) fn take_around<L: Lanes>(
        &mut self,
        (surface, centre): (&Surface, &Vec3),
        around: &Around,
        place: &Vec3,
    ) -> Hull {
        self.0.clear();
        let mut at = [0.0; 3];
        for k in 0..3 {
            at[k] = (place[k] - centre[k]) as f32;
        }
        let place: [L; 3] = splat(at);
        let (mut low, mut high) = (place, place);
        for (b, c) in around.eights() {
            let b = L::relative(eight(surface, b), [centre; 8], 1.0);
            let c = L::relative(eight(surface, c), [centre; 8], 1.0);
            let row = Row::of(&[place, b, c]);
            for k in 0..3 {
                low[k] = low[k].lesser(L::load(&row.low[k]));
                high[k] = high[k].greater(L::load(&row.high[k]));
            }
            self.0.push(row);
        }
        let mut whole = Hull::EMPTY;
        for k in 0..3 {
            whole.low[k] = low[k].least();
            whole.high[k] = -L::splat(0.0).minus(high[k]).least();
        }
        whole
    }

    /// The number of boxes, the last ones of a row included.
    pub(super) fn len(&self) -> usize {
        ROW * self.0.len()
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// A box.
    pub(super) fn get(&self, i: usize) -> Hull {
        self.0[i / ROW].get(i % ROW)
    }

    /// Bits of the first 32 that touch a box.
    #[inline(always)]
    pub(super) fn bits<L: Lanes>(&self, hull: &Hull) -> u32 {
        let hull = Splat::<L>::of(hull);
        let mut bits = 0;
        for (i, row) in self.0.iter().take(4).enumerate() {
            bits |= row.touching(&hull) << (ROW * i);
        }
        bits
    }

    /// The numbers of those that touch a box.
    #[inline(always)]
    pub(super) fn touching<L: Lanes>(&self, hull: &Hull) -> impl Iterator<Item = usize> {
        let hull = Splat::<L>::of(hull);
        let rows = self.0.iter().enumerate();
        rows.flat_map(move |(row, boxes)| bits(boxes.touching(&hull)).map(move |i| row * ROW + i))
    }
}

/// Boxes of all triangles, relative to a centre.
struct Rows<'a> {
    surface: &'a Surface,
    centre: &'a Vec3,
}

impl Job for Rows<'_> {
    type Output = Vec<Row>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<Row> {
        let Rows { surface, centre } = self;
        let mut rows = Vec::with_capacity(surface.triangles.len().div_ceil(ROW));
        for triangles in surface.triangles.chunks(ROW) {
            let is_there = |i: usize| triangles.get(i).is_some_and(|t| t[0] != GONE);
            let mut ids = [[0; ROW]; 3];
            for i in (0..ROW).filter(|&i| is_there(i)) {
                for (ids, v) in ids.iter_mut().zip(triangles[i]) {
                    ids[i] = v;
                }
            }
            let a = L::relative(eight(surface, &ids[0]), [centre; 8], 1.0);
            let b = L::relative(eight(surface, &ids[1]), [centre; 8], 1.0);
            let c = L::relative(eight(surface, &ids[2]), [centre; 8], 1.0);
            let mut row = Row::of(&[a, b, c]);
            (0..ROW).filter(|&i| !is_there(i)).for_each(|i| row.set(i, &Hull::EMPTY));
            rows.push(row);
        }
        rows
    }
}

/// The places of the bits that are set.
fn bits(mut left: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (left != 0).then(|| left.trailing_zeros() as usize);
        left &= left.wrapping_sub(1);
        place
    })
}

/// The boxes. About 28 bytes a triangle.
#[derive(Clone)]
pub(crate) struct Tree {
    centre: Vec3,
    n: usize,
    /// Rows of boxes of triangles, then of the boxes of the rows of the level before; the last has one row.
    levels: Vec<Vec<Row>>,
    /// Scratch space of a search: rows of a level.
    open: Vec<u32>,
}

impl Tree {
    /// A tree without triangles. Rounding relative to `centre` never parts boxes that touch: it keeps the order of numbers.
    pub(crate) fn new(centre: Vec3) -> Tree {
        Tree { centre, n: 0, levels: vec![vec![Row::EMPTY]], open: Vec::new() }
    }

    /// A tree of the triangles of a surface that has vertices.
    pub(crate) fn of_surface(surface: &Surface, centre: Vec3, simd: Simd) -> Tree {
        let mut tree = Tree::new(centre);
        let rows = simd.run(Rows { surface, centre: &centre });
        if rows.is_empty() {
            return tree;
        }
        tree.n = surface.triangles.len();
        tree.levels = vec![rows];
        while let Some(below) = tree.levels.last().filter(|level| level.len() > 1) {
            let row = |below: &[Row]| {
                let mut row = Row::EMPTY;
                below.iter().enumerate().for_each(|(i, below)| row.set(i, &below.hull()));
                row
            };
            let level = below.chunks(ROW).map(row).collect();
            tree.levels.push(level);
        }
        tree
    }

    /// The place that boxes are relative to.
    pub(super) fn centre(&self) -> Vec3 {
        self.centre
    }

    /// The number of triangles that it has boxes of.
    pub(super) fn len(&self) -> usize {
        self.n
    }

    /// Memory that it holds, in bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.levels.iter().map(|level| size_of_val(&level[..]) as u64).sum()
    }

    /// The box around points.
    pub(crate) fn hull(&self, points: &[Vec3]) -> Hull {
        let mut hull = Hull::EMPTY;
        for point in points {
            let at: [f32; 3] = std::array::from_fn(|k| (point[k] - self.centre[k]) as f32);
            hull.join(&Hull { low: at, high: at });
        }
        hull
    }

    /// The box of a triangle.
    pub(super) fn of(&self, triangle: u32) -> Hull {
        self.levels[0][triangle as usize / ROW].get(triangle as usize % ROW)
    }

    /// Appends the box of the next triangle.
    pub(crate) fn push(&mut self, hull: Hull) {
        let mut rows = self.n / ROW + 1;
        self.n += 1;
        for level in 0.. {
            if level == self.levels.len() {
                // The row that was the top is the first of two now.
                let mut row = Row::EMPTY;
                row.set(0, &self.levels[level - 1][0].hull());
                self.levels.push(vec![row]);
            }
            if self.levels[level].len() < rows {
                self.levels[level].resize(rows, Row::EMPTY);
            }
            if self.levels[level].len() == 1 {
                break;
            }
            rows = rows.div_ceil(ROW);
        }
        self.set(self.n as u32 - 1, hull);
    }

    /// Takes over the box of a triangle that has changed.
    pub(crate) fn set(&mut self, triangle: u32, hull: Hull) {
        let mut place = triangle as usize;
        self.levels[0][place / ROW].set(place % ROW, &hull);
        for level in &mut self.levels[1..] {
            place /= ROW;
            let row = &mut level[place / ROW];
            let mut whole = row.get(place % ROW);
            if whole.holds(&hull) {
                break;
            }
            whole.join(&hull);
            row.set(place % ROW, &whole);
        }
    }

    /// Lists the triangles whose boxes touch another.
    #[inline(always)]
    pub(crate) fn touching<L: Lanes>(&mut self, hull: &Hull, found: &mut Vec<u32>) {
        let Tree { levels, open, .. } = self;
        let hull = Splat::<L>::of(hull);
        open.clear();
        open.push(0);
        // Level by level, so that what is fetched is there when it is looked at; without branches on what touches, which nothing
        // predicts.
        for (level, rows) in levels.iter().enumerate().rev() {
            if level == 0 {
                open.reverse();
            }
            found.clear();
            found.resize(ROW * open.len(), 0);
            let mut n = 0;
            for &row in open.iter() {
                let touching = rows[row as usize].touching(&hull);
                let below = std::array::from_fn(|i| row * ROW as u32 + i as u32);
                found[n..n + ROW].copy_from_slice(&L::packed(&below, touching));
                n += touching.count_ones() as usize;
            }
            found.truncate(n);
            if let Some(level) = level.checked_sub(1) {
                found.iter().for_each(|&below| levels[level][below as usize].fetch());
                std::mem::swap(open, found);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::simd::Portable;

    #[test]
    fn a_search_finds_what_a_plain_one_finds_after_boxes_have_moved() {
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        for n in [0, 1, 7, 8, 9, 64, 65, 600] {
            let mut tree = Tree::new([0.5; 3]);
            let mut plain: Vec<Hull> = Vec::new();
            for _ in 0..n {
                let at = [next(), next(), next()];
                let hull = tree.hull(&[at, at.map(|x| x + 0.1 * next())]);
                tree.push(hull);
                plain.push(hull);
            }
            for _ in 0..n {
                let triangle = (next() * n as f64) as usize;
                let at = [next(), next(), next()];
                let hull = if next() < 0.2 {
                    Hull::EMPTY
                } else {
                    tree.hull(&[at, at.map(|x| x + 0.1 * next())])
                };
                tree.set(triangle as u32, hull);
                plain[triangle] = hull;
                let from = [next(), next(), next()];
                let wanted = tree.hull(&[from, from.map(|x| x + 0.3 * next())]);
                let mut found = Vec::new();
                tree.touching::<Portable>(&wanted, &mut found);
                found.sort_unstable();
                let touches = |a: &Hull, b: &Hull| {
                    (0..3).all(|k| a.low[k] <= b.high[k] && b.low[k] <= a.high[k])
                };
                let expected: Vec<u32> =
                    (0..n as u32).filter(|&i| touches(&plain[i as usize], &wanted)).collect();
                assert_eq!(found, expected);
                let mut some = Hulls::default();
                some.fill(plain.iter().copied());
                assert!(
                    some.touching::<Portable>(&wanted).eq(expected.iter().map(|&i| i as usize))
                );
            }
        }
    }
}
