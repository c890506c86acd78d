//! Places where the bound is tighter than elsewhere: there an earlier run of the same kind went beyond it.

use crate::options::Tight;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::Vec3;

/// Boxes of the grid along each axis.
const GRID: usize = 32;

/// The balls, by the boxes of a grid that they meet.
///
/// Memory: 40 bytes a ball, 4 for each box it meets (of 32,768), 128 KiB.
pub(crate) struct TightPlaces<'a> {
    places: &'a [Tight],
    bounds: Bounds,
    /// Numbers of the balls in each box.
    boxes: Vec<Vec<u32>>,
}

impl<'a> TightPlaces<'a> {
    pub(crate) fn new(places: &'a [Tight]) -> Self {
        let mut bounds = Bounds::EMPTY;
        for one in places {
            bounds.add(one.place.map(|x| x - one.radius));
            bounds.add(one.place.map(|x| x + one.radius));
        }
        let n_boxes = if places.is_empty() { 0 } else { GRID * GRID * GRID };
        let mut out = TightPlaces { places, bounds, boxes: vec![Vec::new(); n_boxes] };
        for (i, one) in places.iter().enumerate() {
            let low = out.place_of(one.place.map(|x| x - one.radius));
            let high = out.place_of(one.place.map(|x| x + one.radius));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    for z in low[2]..=high[2] {
                        out.boxes[(x * GRID + y) * GRID + z].push(i as u32);
                    }
                }
            }
        }
        out
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// The box that a point is in, or the nearest one.
    fn place_of(&self, point: Vec3) -> [usize; 3] {
        std::array::from_fn(|k| {
            let side = self.bounds.high[k] - self.bounds.low[k];
            let share = (point[k] - self.bounds.low[k]) / side.max(f64::MIN_POSITIVE);
            ((share * GRID as f64) as usize).min(GRID - 1)
        })
    }

    /// The largest margin at a point, in input units; `None` outside of all balls.
    pub(crate) fn margin(&self, point: Vec3) -> Option<f64> {
        if self.boxes.is_empty() {
            return None;
        }
        let [x, y, z] = self.place_of(point);
        let near = self.boxes[(x * GRID + y) * GRID + z].iter();
        let margins = near.map(|&i| &self.places[i as usize]).filter(|one| {
            let off_sq: f64 = (0..3).map(|k| (point[k] - one.place[k]).powi(2)).sum();
            off_sq <= one.radius * one.radius
        });
        margins.map(|one| one.margin).reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_margin_around_a_point_is_found_as_by_a_plain_search() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let places: Vec<Tight> = (0..300)
            .map(|_| Tight {
                place: [next(), next(), next()],
                radius: 0.2 * next() * next(),
                margin: next(),
            })
            .collect();
        let found = TightPlaces::new(&places);
        for _ in 0..2000 {
            let point = [next(), next(), next()].map(|x| 1.4 * x - 0.2);
            let is_in = |one: &&Tight| {
                (0..3).map(|k| (point[k] - one.place[k]).powi(2)).sum::<f64>().sqrt() <= one.radius
            };
            let plain = places.iter().filter(is_in).map(|one| one.margin).reduce(f64::max);
            assert_eq!(found.margin(point), plain);
        }
        assert_eq!(TightPlaces::new(&[]).margin([0.0; 3]), None);
    }
}
