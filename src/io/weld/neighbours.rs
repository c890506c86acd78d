//! Finds vertices within a distance of each other, out of core.
//!
//! A sort puts vertices into cubes of many times the distance, those near a wall into the cubes behind it too. In every
//! cube they come ordered by position; each joins the first vertex within the distance that has joined none, or becomes
//! one that others join. A cluster no wider than the distance is seen whole, and alike, in every cube that it touches.

use crate::external_sort::{ExternalSort, halves, whole};
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use crate::records::NumberRecords;
use std::collections::VecDeque;
use std::path::Path;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{Vec3, length_sq, sub};
use stonecut_system::error::Result;

/// Side of a cube, in distances: one vertex in five lies near a wall.
const SIDE: f64 = 32.0;
/// Cubes along the longest axis at most.
const MOST_CUBES: f64 = (1u64 << 30) as f64;

/// Numbers of a vertex, of the one that it joins, and the bits of the position of both. Ascending, each vertex once.
pub(super) type Pairs<'a> = NumberRecords<5, &'a RawFile>;

/// Stands for the vertex itself, behind all others: others join it.
pub(super) const ITSELF_LAST: u64 = u64::MAX;

/// In the number of a vertex: it is at no open edge, and joins those of other parts only.
pub(super) const INSIDE: u64 = 1 << 40;

/// Vertices on their way into cubes: cube, position, number.
pub(super) struct Neighbours {
    sort: ExternalSort<11>,
    low: Vec3,
    side: f64,
    distance: f64,
    /// Number of the first vertex behind each part.
    ends: Vec<u64>,
}

/// A vertex that others may join.
struct First {
    vertex: u64,
    position: Vec3,
}

impl Neighbours {
    pub fn new(sort: ExternalSort<11>, bounds: &Bounds, distance: f64) -> Neighbours {
        let sides = sub(bounds.high, bounds.low);
        let longest = sides.into_iter().fold(0.0, f64::max);
        let side = (SIDE * distance).max(longest / MOST_CUBES);
        Neighbours { sort, low: bounds.low, side, distance, ends: Vec::new() }
    }

    /// The same of several parts.
    pub fn of_parts(self, ends: Vec<u64>) -> Neighbours {
        Neighbours { ends, ..self }
    }

    /// The records of all `Pairs`, under a name for messages.
    pub fn pairs(self, name: &Path, options: &StageOptions) -> Result<RawFile> {
        let mut pairs = options.sort::<10>((options.memory_bytes / 3) as usize);
        self.finish(|v, first, position| {
            let ([v0, v1], [f0, f1]) = (halves(v), halves(first));
            let [[x0, x1], [y0, y1], [z0, z1]] = position.map(|x| halves(x.to_bits()));
            let [l0, l1] = halves(ITSELF_LAST);
            pairs.push([v0, v1, f0, f1, x0, x1, y0, y1, z0, z1])?;
            pairs.push([f0, f1, l0, l1, x0, x1, y0, y1, z0, z1])
        })?;
        let (mut out, mut last) = (options.spool(), None);
        pairs.drain(|[v0, v1, f0, f1, x0, x1, y0, y1, z0, z1]| {
            let v = whole(v0, v1);
            // One that others join comes once for each of them.
            if last.replace(v) == Some(v) {
                return Ok(());
            }
            let [x, y, z] = [whole(x0, x1), whole(y0, y1), whole(z0, z1)];
            out.write(bytemuck::bytes_of(&[v, whole(f0, f1), x, y, z]))
        })?;
        out.finish(name)
    }

    fn cube(&self, x: f64, axis: usize) -> u32 {
        // A cast saturates: what is below the box is in its first cube.
        ((x - self.low[axis]) / self.side) as u32
    }

    pub fn push(&mut self, vertex: u64, position: Vec3) -> Result<()> {
        let axes: [[u32; 2]; 3] = std::array::from_fn(|axis| {
            let x = position[axis];
            [self.cube(x - self.distance, axis), self.cube(x + self.distance, axis)]
        });
        let [p, q, r] = position.map(|x| halves(ascending(x)));
        let v = halves(vertex);
        for i in axes[0][0]..=axes[0][1] {
            for j in axes[1][0]..=axes[1][1] {
                for k in axes[2][0]..=axes[2][1] {
                    self.sort.push([i, j, k, p[0], p[1], q[0], q[1], r[0], r[1], v[0], v[1]])?;
                }
            }
        }
        Ok(())
    }

    /// Calls `each` with every vertex that joins another one, that one, and its position.
    fn finish(self, mut each: impl FnMut(u64, u64, Vec3) -> Result<()>) -> Result<()> {
        let Neighbours { sort, low, side, distance, ends } = self;
        let part = |v: u64| ends.partition_point(|&end| end <= v & !INSIDE);
        let may_join = |v: u64, other: u64| (v | other) & INSIDE == 0 || part(v) != part(other);
        let home = |position: Vec3| -> [u32; 3] {
            std::array::from_fn(|axis| ((position[axis] - low[axis]) / side) as u32)
        };
        let mut firsts: VecDeque<First> = VecDeque::new();
        let mut current = None;
        sort.drain(|[i, j, k, p0, p1, q0, q1, r0, r1, v0, v1]| {
            let cube = [i, j, k];
            if current != Some(cube) {
                current = Some(cube);
                firsts.clear();
            }
            let position = [whole(p0, p1), whole(q0, q1), whole(r0, r1)].map(from_ascending);
            let vertex = whole(v0, v1);
            while firsts.front().is_some_and(|first| first.position[0] < position[0] - distance) {
                firsts.pop_front();
            }
            let is_near = |first: &&First| {
                length_sq(sub(position, first.position)) <= distance * distance
                    && may_join(vertex, first.vertex)
            };
            match firsts.iter().find(is_near) {
                Some(first) if home(position) == cube => {
                    each(vertex & !INSIDE, first.vertex & !INSIDE, first.position)
                }
                Some(_) => Ok(()),
                None => {
                    firsts.push_back(First { vertex, position });
                    Ok(())
                }
            }
        })
    }
}

/// Bits that are ordered as the numbers are.
fn ascending(x: f64) -> u64 {
    // Adding 0 makes -0 and 0 the same place.
    let bits = (x + 0.0).to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

fn from_ascending(bits: u64) -> f64 {
    f64::from_bits(if bits >> 63 == 1 { bits & !(1 << 63) } else { !bits })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_ordered_as_numbers_are() {
        let numbers = [-1e300, -2.0, -1.0, -1e-300, 0.0, 1e-300, 1.0, 2.0, 1e300];
        let bits = numbers.map(ascending);
        assert!(bits.is_sorted());
        assert_eq!(bits.map(from_ascending), numbers);
        assert_eq!(ascending(-0.0), ascending(0.0));
    }

    #[test]
    fn clusters_are_joined_across_the_walls_of_cubes() {
        // Pairs 0.5 apart on a line whose every eighth step lies on a wall.
        let points: Vec<Vec3> = (0..100)
            .flat_map(|i| {
                [[4.0 * f64::from(i) - 0.25, 1.0, 2.0], [4.0 * f64::from(i) + 0.25, 1.0, 2.0]]
            })
            .collect();
        let sort = ExternalSort::new(&std::env::temp_dir(), 0);
        let mut neighbours = Neighbours::new(sort, &Bounds::around(&points), 1.0);
        for (v, &point) in points.iter().enumerate() {
            neighbours.push(v as u64, point).unwrap();
        }
        let mut joined = Vec::new();
        neighbours
            .finish(|v, into, position| {
                assert_eq!(position, points[into as usize]);
                joined.push((v, into));
                Ok(())
            })
            .unwrap();
        joined.sort_unstable();
        assert_eq!(joined, (0..100).map(|i| (2 * i + 1, 2 * i)).collect::<Vec<_>>());
    }
}
