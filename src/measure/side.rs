//! Results of one direction of a measurement.
//!
//! Sums are added to sample by sample, in any order, by any number of threads; `finish` turns them into
//! the numbers of the report. Does not search anything itself.

use super::carried::Values;
use super::colour::{self, LARGEST_DELTA_E};
use super::sums::{Distances, Sum};
use super::triangle::{self, Vector};

/// The surface's own normal, of any length, and what it carries.
pub type Look = (Vector, Values);

/// Differences of texture coordinates and the scale of their sums; larger ones count as this.
const LARGEST_TEXTURE: f64 = 1e6;

/// Bins of the distribution in the report, from 0 to the maximum.
const HISTOGRAM_BINS: usize = 64;

/// Statistics of a set of distances in input units; infinite where there was no surface to measure
/// against, which JSON shows as null.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The root mean square.
    pub rms: f64,
    /// The 99.9th percentile of the distances of the samples.
    pub p999: f64,
    /// The maximum.
    pub max: f64,
    /// Number of samples.
    pub samples: u64,
}

/// One direction of a measurement: samples of one surface against the other.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Side {
    /// Distances. Mean, root mean square and percentile are over area-uniform samples alone, which
    /// vertices would bias towards fine triangles; the maximum is over samples and vertices.
    #[serde(flatten)]
    pub distance: Spread,
    /// Number of vertices that the maximum includes.
    pub vertices: u64,
    /// Mean angle between the normals at a sample and at its nearest point, in degrees.
    pub normal_degrees: Option<f64>,
    /// Mean colour difference between a sample and its nearest point: CIELAB, Delta E 1976.
    pub color_delta_e: Option<f64>,
    /// Its root mean square.
    pub color_rms_delta_e: Option<f64>,
    /// `color_delta_e` by the name it had before schema version 1.
    pub colour_delta_e: Option<f64>,
    /// `color_rms_delta_e` by the name it had before schema version 1.
    pub colour_rms_delta_e: Option<f64>,
    /// Mean angle between the normals that the vertices carry, in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carried_normal_degrees: Option<f64>,
    /// Mean distance of texture coordinates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture_mean: Option<f64>,
    /// Its root mean square.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture_rms: Option<f64>,
    /// The samples within the region asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near: Option<Spread>,
    /// The samples outside of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub far: Option<Spread>,
    /// Samples by distance, in equal bins from 0 to `max`.
    pub histogram: Vec<u64>,
    /// The sample or vertex with the largest distance.
    pub worst: Option<[f64; 3]>,
}

/// Everything gathered about one direction so far.
#[derive(Clone, Debug)]
pub struct SideSums {
    pub distances: Distances,
    angle: Sum,
    n_angles: u64,
    delta_e: Sum,
    delta_e_sq: Sum,
    n_delta_e: u64,
    carried_angle: Sum,
    n_carried_angles: u64,
    texture: Sum,
    texture_sq: Sum,
    n_texture: u64,
    near: Option<[Distances; 2]>,
    pub n_vertices: u64,
    /// The largest distance so far and where: samples and vertices.
    worst: Option<(f64, [f64; 3])>,
}

impl SideSums {
    /// Nothing gathered; `reach` is at least every distance that may come.
    pub fn new(reach: f64, with_region: bool) -> Self {
        let distances = || Distances::new(reach);
        SideSums {
            distances: distances(),
            angle: Sum::new(180.0),
            n_angles: 0,
            delta_e: Sum::new(LARGEST_DELTA_E),
            delta_e_sq: Sum::new(LARGEST_DELTA_E * LARGEST_DELTA_E),
            n_delta_e: 0,
            carried_angle: Sum::new(180.0),
            n_carried_angles: 0,
            texture: Sum::new(LARGEST_TEXTURE),
            texture_sq: Sum::new(LARGEST_TEXTURE * LARGEST_TEXTURE),
            n_texture: 0,
            near: with_region.then(|| [distances(), distances()]),
            n_vertices: 0,
            worst: None,
        }
    }

    /// Adds the distance of a sample; `near` says whether it lies in the region, if there is one.
    /// Distances that rounding of the coordinates explains are 0.
    pub fn add_sample(&mut self, point: [f64; 3], distance_sq: f64, near: Option<bool>) {
        let largest = point.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let rounding = 4.0 * f64::EPSILON * largest;
        let is_rounding = distance_sq <= rounding * rounding;
        let distance_sq = if is_rounding { 0.0 } else { distance_sq };
        self.distances.add_sq(distance_sq);
        self.offer_worst(point, distance_sq);
        if let (Some([inside, outside]), Some(near)) = (&mut self.near, near) {
            (if near { inside } else { outside }).add_sq(distance_sq);
        }
    }

    /// Compares normal and colour of a sample with those of its nearest point.
    pub fn add_looks(&mut self, here: Look, there: Look) {
        if let Some(radians) = triangle::angle(here.0, there.0) {
            self.angle.add(radians.to_degrees());
            self.n_angles += 1;
        }
        if let (Some(here), Some(there)) = (here.1.lab, there.1.lab) {
            let delta_e = colour::delta_e(here.map(f64::from), there.map(f64::from));
            self.delta_e.add(delta_e);
            self.delta_e_sq.add(delta_e * delta_e);
            self.n_delta_e += 1;
        }
        if let (Some(here), Some(there)) = (here.1.normal, there.1.normal)
            && let Some(radians) = triangle::angle(here.map(f64::from), there.map(f64::from))
        {
            self.carried_angle.add(radians.to_degrees());
            self.n_carried_angles += 1;
        }
        if let (Some(here), Some(there)) = (here.1.texture, there.1.texture) {
            let [u, v] = [0, 1].map(|k| f64::from(here[k]) - f64::from(there[k]));
            let distance = (u * u + v * v).sqrt();
            // Files may hold NaN and infinities as texture coordinates: there is no distance to them.
            if distance.is_finite() {
                let distance = distance.min(LARGEST_TEXTURE);
                self.texture.add(distance);
                self.texture_sq.add(distance * distance);
                self.n_texture += 1;
            }
        }
    }

    /// Holds a point against the maximum; of equally far points the one with the least coordinates stays.
    pub fn offer_worst(&mut self, point: [f64; 3], distance_sq: f64) {
        let beaten = match self.worst {
            None => true,
            Some((worst_sq, at)) => {
                distance_sq > worst_sq || (distance_sq == worst_sq && point < at)
            }
        };
        if beaten {
            self.worst = Some((distance_sq, point));
        }
    }

    /// The largest squared distance so far; 0 without any.
    pub fn worst_sq(&self) -> f64 {
        self.worst.map_or(0.0, |(worst_sq, _)| worst_sq)
    }

    /// Adds what another thread, batch or cell has gathered.
    pub fn merge(&mut self, other: &SideSums) {
        self.distances.merge(&other.distances);
        self.angle.merge(&other.angle);
        self.n_angles += other.n_angles;
        self.delta_e.merge(&other.delta_e);
        self.delta_e_sq.merge(&other.delta_e_sq);
        self.n_delta_e += other.n_delta_e;
        self.carried_angle.merge(&other.carried_angle);
        self.n_carried_angles += other.n_carried_angles;
        self.texture.merge(&other.texture);
        self.texture_sq.merge(&other.texture_sq);
        self.n_texture += other.n_texture;
        if let (Some(own), Some(others)) = (&mut self.near, &other.near) {
            own.iter_mut().zip(others).for_each(|(a, b)| a.merge(b));
        }
        self.n_vertices += other.n_vertices;
        if let Some((worst_sq, point)) = other.worst {
            self.offer_worst(point, worst_sq);
        }
    }

    /// The numbers of the report. Against an empty surface every distance is infinite.
    pub fn finish(mut self, target_is_empty: bool) -> Side {
        let anything = !self.distances.is_empty() || self.n_vertices > 0;
        let mut distance = spread(&mut self.distances);
        distance.max = self.worst_sq().sqrt();
        if target_is_empty && anything {
            let infinite = f64::INFINITY;
            let samples = distance.samples;
            let (mean, rms, p999, max) = (infinite, infinite, infinite, infinite);
            distance = Spread { mean, rms, p999, max, samples };
        }
        let mean = |sum: &Sum, n: u64| (n > 0).then(|| sum.value() / n as f64);
        let [near, far] = match self.near {
            Some(both) => both.map(|mut distances| Some(spread(&mut distances))),
            None => [None, None],
        };
        let finite = distance.max.is_finite();
        let color_delta_e = mean(&self.delta_e, self.n_delta_e);
        let color_rms_delta_e = mean(&self.delta_e_sq, self.n_delta_e).map(f64::sqrt);
        Side {
            histogram: if finite {
                self.distances.histogram(HISTOGRAM_BINS, distance.max)
            } else {
                Vec::new()
            },
            distance,
            vertices: self.n_vertices,
            normal_degrees: mean(&self.angle, self.n_angles),
            color_delta_e,
            color_rms_delta_e,
            colour_delta_e: color_delta_e,
            colour_rms_delta_e: color_rms_delta_e,
            carried_normal_degrees: mean(&self.carried_angle, self.n_carried_angles),
            texture_mean: mean(&self.texture, self.n_texture),
            texture_rms: mean(&self.texture_sq, self.n_texture).map(f64::sqrt),
            near,
            far,
            worst: self.worst.map(|(_, point)| point).filter(|_| finite),
        }
    }
}

fn spread(distances: &mut Distances) -> Spread {
    Spread {
        mean: distances.mean(),
        rms: distances.rms(),
        p999: distances.quantile(0.999),
        max: distances.max(),
        samples: distances.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_coordinates_that_are_not_numbers_do_not_count() {
        let mut sums = SideSums::new(1.0, false);
        let look = |texture: [f32; 2]| {
            ([0.0, 0.0, 1.0], Values { texture: Some(texture), ..Values::default() })
        };
        let none = [[f32::NAN, 0.0], [0.0, f32::INFINITY], [f32::NEG_INFINITY, f32::NAN]];
        for texture in none.into_iter().chain([[0.3, 0.4], [0.0, 0.0]]) {
            sums.add_looks(look([0.0, 0.0]), look(texture));
        }
        let side = sums.finish(false);
        assert!((side.texture_mean.unwrap() - 0.25).abs() < 1e-6, "{side:?}");
        assert!((side.texture_rms.unwrap() - (0.5f64 * 0.25).sqrt()).abs() < 1e-6, "{side:?}");
    }
}
