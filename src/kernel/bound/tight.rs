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

/// Share of the bound that the first run keeps: between the points that the kernel looks at the surface is a little farther away.
const FIRST: f64 = 0.94;
/// Share of the bound that is kept in hand, beyond the excess, where it was exceeded.
const KEPT: f64 = 0.1;
/// Growth of the ball around a place that is beyond the bound within an earlier ball, over that ball's; the radius of a
/// first one is the size of the triangle there. Balls that are larger than they need be cost triangles (docs/design/bound.md).
const GROWTH: f64 = 1.5;
/// A tighter bound aims at this share of the one that was asked for.
const AIM: f64 = 0.98;
/// No run tightens the bound by more than this: one place does not say much of another.
const MOST_TIGHTENING: f64 = 0.5;

/// Tightening of the bound for runs of one kind, each after one that went beyond it.
#[derive(Clone, Debug)]
pub struct Tightened {
    /// Share of the bound that the run is given, everywhere.
    pub share: f64,
    /// The balls.
    pub places: Vec<Tight>,
    /// For each place how many balls, one in the other, had not helped there.
    depths: Vec<i32>,
}

impl Default for Tightened {
    /// Before the first run: tighter nowhere.
    fn default() -> Tightened {
        Tightened { share: FIRST, places: Vec::new(), depths: Vec::new() }
    }
}

impl Tightened {
    /// Tightens it as much as a run was beyond the bound, where the places are not known.
    pub fn tighten_everywhere(&mut self, bound: f64, found: f64) {
        self.share *= (AIM * bound / found).max(MOST_TIGHTENING);
    }

    /// Tightens it at the places that a run was beyond the bound: balls of the size of the triangle there, with the excess as margin.
    ///
    /// After rounds (`has_points`) points of the original stand for it, and there are places that they do not tell of: a first
    /// ball only takes all of what earlier rounds have used for lost.
    pub fn tighten(&mut self, bound: f64, beyond: impl Iterator<Item = Tight>, has_points: bool) {
        let known = self.places.len();
        for one in beyond {
            let earlier = self.places[..known].iter().zip(&self.depths).filter(|(tight, _)| {
                let off_sq: f64 = (0..3).map(|k| (one.place[k] - tight.place[k]).powi(2)).sum();
                off_sq <= tight.radius * tight.radius
            });
            let (before, depth) = earlier.fold((0.0f64, 0), |most, (tight, &n)| {
                (most.0.max(tight.margin), most.1.max(n + 1))
            });
            let excess = one.margin + KEPT * bound;
            let margin = if has_points && depth == 0 { 0.0 } else { before + excess };
            let radius = GROWTH.powi(depth) * one.radius;
            self.depths.push(depth);
            self.places.push(Tight { place: one.place, radius, margin });
        }
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

    #[test]
    fn what_is_beyond_the_bound_is_tightened_by_as_much() {
        for (share, found, next) in [(1.0, 1.25, 0.784), (0.8, 1e9, 0.4)] {
            let mut tightened = Tightened { share, ..Tightened::default() };
            tightened.tighten_everywhere(1.0, found);
            assert!((tightened.share - next).abs() < 1e-12, "{tightened:?}");
        }
    }

    /// Radii and margins after runs that were half of the bound beyond it at these places, on triangles of size 1.
    fn balls(runs: &[&[Vec3]], has_points: bool) -> Vec<[f64; 2]> {
        let mut tightened = Tightened::default();
        for places in runs {
            let beyond = places.iter().map(|&place| Tight { place, radius: 1.0, margin: 0.5 });
            tightened.tighten(1.0, beyond, has_points);
        }
        assert_eq!(tightened.share, FIRST);
        tightened.places.iter().map(|ball| [ball.radius, ball.margin]).collect()
    }

    #[test]
    fn balls_grow_where_they_did_not_help_and_once_a_run() {
        let near = [[0.0; 3], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]];
        let far = [50.0, 0.0, 0.0];
        let found = balls(&[&near, &[near[1], far], &[near[2]]], false);
        let (first, second, third) = ([1.0, 0.6], [GROWTH, 1.2], [GROWTH * GROWTH, 1.8]);
        let wanted = [first, first, first, second, first, third].concat();
        assert!(
            found.concat().iter().zip(&wanted).all(|(x, y)| (x - y).abs() < 1e-12),
            "{found:?}"
        );
        // After rounds a first ball only doubts the points.
        assert_eq!(balls(&[&near[..1], &near[..1]], true), [[1.0, 0.0], [GROWTH, 0.6]]);
    }
}
