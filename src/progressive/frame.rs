//! Guesses of both ends of a split from the vertices around it, in axes along the surface there.
//!
//! For compact files: what is left to tell is small across the surface, and the numbers along it come in columns of their kind. The
//! weights of the guesses are least absolute deviations over the 430,000 splits of the dragon; they save 11 bits a vertex against differences along
//! the axes of space.

use super::replay::{Around, Replay};
use super::rows::Rows;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub};

/// Axes at a place, and what is guessed there.
pub(super) struct Frame {
    /// Along the split, along the surface across it, and normal to the surface.
    axes: [Vec3; 3],
    before: Vec3,
    /// Mean places, less `before`, of the vertices around: on the side of the new vertex, of the split one, and where both meet.
    of_new: Vec3,
    of_kept: Vec3,
    middle: Vec3,
}

impl Frame {
    /// The axes of space, and nothing but the place before.
    pub(super) fn plain(before: Vec3) -> Frame {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Frame { axes, before, of_new: [0.0; 3], of_kept: [0.0; 3], middle: [0.0; 3] }
    }

    /// The axes where a split gives `length` triangles, from `start` on, of those around a vertex to the new one.
    pub(super) fn new(
        rows: &Rows,
        replay: &Replay,
        (vertex, around): (u32, &Around),
        (start, length): (usize, usize),
    ) -> Frame {
        let place = |v: u32| rows.place(replay.row(v));
        let before = place(vertex);
        let n = around.rim.len();
        let Some(sides) = around.sides(start, length).filter(|_| n > 0) else {
            return Frame::plain(before);
        };
        let mean = |from: usize, count: usize| {
            let places = (from..from + count).map(|i| place(around.rim[i % n]));
            scale(places.fold([0.0; 3], add), 1.0 / count.max(1) as f64)
        };
        let of_new = mean(start, length + 1);
        let of_kept = mean(start + length, n.saturating_sub(length) + 1);
        let [a, b] = sides.map(place);
        let along = sub(of_kept, of_new);
        let normal = cross(along, sub(a, b));
        let (along_sq, normal_sq) = (length_sq(along), length_sq(normal));
        // Written so that NaN is plain.
        if !(along_sq > 0.0 && normal_sq > 0.0) {
            return Frame::plain(before);
        }
        let along = scale(along, 1.0 / along_sq.sqrt());
        let normal = scale(normal, 1.0 / normal_sq.sqrt());
        Frame {
            axes: [along, cross(normal, along), normal],
            before,
            of_new: sub(of_new, before),
            of_kept: sub(of_kept, before),
            middle: sub(scale(add(a, b), 0.5), before),
        }
    }

    fn inside(&self, x: Vec3) -> Vec3 {
        self.axes.map(|axis| dot(axis, x))
    }

    /// The split vertex, as guessed: components along the axes.
    fn kept(&self) -> Vec3 {
        let [n, k, m] = [self.of_new, self.of_kept, self.middle].map(|x| self.inside(x)[2]);
        [0.0, 0.0, 0.165 * (n + k) - 0.26 * m]
    }

    /// The new one, once the split one is at `kept`.
    fn new_end(&self, kept: Vec3) -> Vec3 {
        let moved = self.inside(sub(kept, self.before));
        let [n, k, m] = [self.of_new, self.of_kept, self.middle].map(|x| self.inside(x));
        [
            0.51 * n[0] - 0.07 * m[0] + 0.05 * moved[0],
            0.12 * (n[1] + k[1]) - 0.35 * moved[1],
            0.31 * (n[2] + k[2]) - 0.44 * m[2] - 0.59 * moved[2],
        ]
    }

    fn guess(&self, kept: Option<Vec3>) -> Vec3 {
        kept.map_or_else(|| self.kept(), |kept| self.new_end(kept))
    }

    /// Difference of a place from its guess, in steps along the axes; `kept`: of the new vertex, when the other one is there.
    pub(super) fn tell(&self, place: Vec3, kept: Option<Vec3>) -> [i32; 3] {
        let (at, guess) = (self.inside(sub(place, self.before)), self.guess(kept));
        [0, 1, 2].map(|k| (at[k] - guess[k]).round() as i32)
    }

    /// The place that was told; near to it by a step and a half.
    pub(super) fn hear(&self, told: [i32; 3], kept: Option<Vec3>) -> Vec3 {
        let guess = self.guess(kept);
        let at = [0, 1, 2].map(|k| guess[k] + f64::from(told[k]));
        (0..3).fold(self.before, |place, k| add(place, scale(self.axes[k], at[k])))
    }
}
