//! Position of the viewer: from a direction, a sphere of interest, or the mesh's own shape.
//!
//! Camera space: x right, y up, z towards the viewer, origin at the point looked at.

use super::vector::symmetric_eigen;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::unit;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, scale, sub};

/// Tangent of half the vertical angle of view: about 24 degrees in all, a portrait lens.
const TAN_HALF_VIEW: f64 = 0.21;
/// Share of the picture that is left free around the mesh.
const MARGIN: f64 = 0.06;

/// Sums over vertices that tell size, place and main directions of a mesh.
#[derive(Clone, Debug)]
pub(super) struct Extent {
    n: f64,
    origin: Option<Vec3>,
    sum: Vec3,
    products: [[f64; 3]; 3],
    /// The bounding box.
    pub(super) bounds: Bounds,
}

impl Default for Extent {
    fn default() -> Self {
        Extent {
            n: 0.0,
            origin: None,
            sum: [0.0; 3],
            products: [[0.0; 3]; 3],
            bounds: Bounds::EMPTY,
        }
    }
}

impl Extent {
    /// Counts a vertex in.
    pub(super) fn add(&mut self, point: Vec3) {
        // Sums are taken about the first vertex: scans lie far from the origin.
        let p = sub(point, *self.origin.get_or_insert(point));
        self.n += 1.0;
        self.sum = add(self.sum, p);
        for i in 0..3 {
            for j in 0..3 {
                self.products[i][j] += p[i] * p[j];
            }
        }
        self.bounds.add(point);
    }

    /// Half the diagonal of the bounding box; 0 for an empty mesh.
    pub(super) fn radius(&self) -> f64 {
        0.5 * self.bounds.diagonal()
    }

    /// The middle of the bounding box; the origin for an empty mesh.
    pub(super) fn middle(&self) -> Vec3 {
        if self.n == 0.0 { [0.0; 3] } else { self.bounds.middle() }
    }

    /// Standard deviations along the main directions with these, largest first.
    fn main_directions(&self) -> [(f64, Vec3); 3] {
        let n = self.n.max(1.0);
        let covariance =
            |i: usize, j: usize| self.products[i][j] / n - self.sum[i] / n * self.sum[j] / n;
        let matrix = std::array::from_fn(|i| std::array::from_fn(|j| covariance(i, j)));
        let mut main = symmetric_eigen(matrix).map(|(value, axis)| (value.max(0.0).sqrt(), axis));
        main.sort_by(|a, b| b.0.total_cmp(&a.0));
        main
    }

    /// Returns the direction up, and the direction towards the viewer from which the mesh shows most of itself.
    ///
    /// Flat things (terrain, a floor of a building) are looked at from above at a slant. Others stand
    /// upright along y or z, whichever they are longer in, and are seen from the side that has the
    /// least depth, turned by a third of a right angle.
    pub(super) fn natural_view(&self) -> (Vec3, Vec3) {
        let main = self.main_directions();
        if main[2].0 < 0.25 * main[1].0 {
            let largest =
                (0..3).fold(
                    0,
                    |best, i| {
                        if main[2].1[i].abs() > main[2].1[best].abs() { i } else { best }
                    },
                );
            let up = scale(main[2].1, main[2].1[largest].signum());
            let mut front = main[1].1;
            // Of two opposite directions the one more towards the usual front, -y (or +z).
            if front[1] - front[2] > 0.0 {
                front = scale(front, -1.0);
            }
            let side = cross(up, front);
            let level = add(scale(front, 0.92), scale(side, 0.38));
            return (up, add(scale(level, 0.8), scale(up, 0.6)));
        }
        let size = sub(self.bounds.high, self.bounds.low);
        let (up, front) = if size[1] > size[2] {
            ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
        } else {
            ([0.0, 0.0, 1.0], [0.0, -1.0, 0.0])
        };
        let side = cross(up, front);
        // A mesh much deeper than wide shows more from its side.
        let depth = |axis: Vec3| dot(axis, size).abs();
        let turned = depth(front) > 1.6 * depth(side);
        let (a, b) = if turned { (0.4, 0.9) } else { (0.88, 0.48) };
        let level = add(scale(front, a), scale(side, b));
        (up, add(level, scale(up, 0.28)))
    }
}

/// The axis that a direction is nearest to.
pub(super) fn nearest_axis(direction: Vec3) -> Vec3 {
    let size = direction.map(f64::abs);
    let largest = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
    let mut axis = [0.0; 3];
    axis[largest] = if direction[largest] < 0.0 { -1.0 } else { 1.0 };
    axis
}

/// A perspective view. Lengths in the picture are samples (pixels times the supersampling).
#[derive(Clone, Debug)]
pub(super) struct Camera {
    /// Point that is looked at: the origin of camera space.
    pub(super) target: Vec3,
    /// Right, up and towards the viewer.
    pub(super) axes: [Vec3; 3],
    /// Distance of the eye from the target.
    pub(super) distance: f64,
    /// Nothing nearer to the eye than this is drawn.
    pub(super) near: f64,
    /// Focal length in samples.
    pub(super) focal: f64,
    /// Place of the target in the picture, in samples.
    pub(super) centre: [f64; 2],
    /// Direction up for the light.
    pub(super) world_up: Vec3,
}

impl Camera {
    /// A camera looking at `target` from `direction`, as yet at no distance.
    pub(super) fn facing(target: Vec3, direction: Vec3, up: Vec3, size: [usize; 2]) -> Self {
        let back = unit(direction).unwrap_or([0.0, 0.0, 1.0]);
        // Looking straight along `up`, the picture's upright is y, or -z.
        let right = unit(cross(up, back))
            .filter(|_| dot(up, back).abs() < 0.999)
            .or_else(|| unit(cross([0.0, 1.0, 0.0], back)))
            .or_else(|| unit(cross([0.0, 0.0, -1.0], back)))
            .unwrap_or([1.0, 0.0, 0.0]);
        let up_in_view = cross(back, right);
        let half = size.map(|n| 0.5 * n as f64);
        Camera {
            target,
            axes: [right, up_in_view, back],
            distance: 1.0,
            near: 1e-6,
            focal: half[1] / TAN_HALF_VIEW,
            centre: half,
            world_up: up,
        }
    }

    /// Camera space that is object space, moved to `target`; for looking things up, not for drawing.
    pub(super) fn upright(target: Vec3) -> Self {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Camera { axes, ..Camera::facing(target, axes[2], axes[1], [1, 1]) }
    }

    /// A point in camera space.
    pub(super) fn place(&self, point: Vec3) -> Vec3 {
        let p = sub(point, self.target);
        self.axes.map(|axis| dot(axis, p))
    }

    /// The point of object space at camera-space `p`.
    pub(super) fn unplace(&self, p: Vec3) -> Vec3 {
        let [x, y, z] = self.axes;
        add(self.target, add(scale(x, p[0]), add(scale(y, p[1]), scale(z, p[2]))))
    }

    /// Moves the camera so that a sphere about the target just fills the picture.
    pub(super) fn frame_sphere(&mut self, radius: f64) {
        let half = self.centre[0].min(self.centre[1]) / self.focal;
        let sine = half / (1.0 + half * half).sqrt();
        self.distance = radius / sine;
        // What stands in front of the place of interest is cut away, but not what belongs to it.
        self.near = (self.distance - 3.0 * radius).max(0.01 * self.distance);
    }

    /// Moves the camera so that everything counted in `silhouette` fits.
    pub(super) fn frame(&mut self, silhouette: &Silhouette) {
        let [a, b, c, d] = silhouette.reach;
        if a + b <= 0.0 && c + d <= 0.0 {
            self.frame_sphere(1.0);
            return;
        }
        let [tan_x, tan_y] = silhouette.tangents;
        let distance = (0.5 * (a + b) / tan_x).max(0.5 * (c + d) / tan_y);
        // Moved sideways first, so that the mesh stands in the middle.
        let aside = [0.5 * (a - b), 0.5 * (c - d), 0.0];
        self.target = self.unplace(aside);
        self.distance = distance.max(1e-300);
        self.near = 1e-3 * self.distance;
    }

    /// A silhouette to be filled for `frame`.
    pub(super) fn silhouette(&self) -> Silhouette {
        let tangents = self.centre.map(|half| half / self.focal * (1.0 - MARGIN));
        Silhouette { tangents, reach: [f64::NEG_INFINITY; 4] }
    }
}

/// Extent of a mesh towards the four sides of a picture, perspective included.
#[derive(Clone, Debug)]
pub(super) struct Silhouette {
    tangents: [f64; 2],
    reach: [f64; 4],
}

impl Silhouette {
    /// Counts in a vertex given in camera space.
    pub(super) fn add(&mut self, p: Vec3) {
        let [tan_x, tan_y] = self.tangents;
        let sides =
            [p[0] + p[2] * tan_x, p[2] * tan_x - p[0], p[1] + p[2] * tan_y, p[2] * tan_y - p[1]];
        for (reach, side) in self.reach.iter_mut().zip(sides) {
            *reach = reach.max(side);
        }
    }
}
