//! Planes that large parts of a surface lie in exactly: the sea of a terrain, the faces of a part that was designed.
//!
//! A memoryless quadric forgets what was a plane: each collapse may leave it by a little. So planes that hold a share of
//! the area are found once, and every vertex knows by bits which of them its triangles lie in. Collapses keep them
//! (`cost::flats`) as long as that is possible. On scans nothing is found: there it costs a look at some thousand triangles.

use crate::vertex::{GONE, Vertex};
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub};

/// Triangles that tell which share of the area lies in a plane, at most; and of those the ones that propose planes: evenly
/// spread ones, and the largest.
const MOST_SAMPLES: usize = 16_384;
const EVENLY_SPREAD: usize = 4096;
const LARGEST: usize = 2048;
/// Planes, at most: one bit each.
const MOST_PLANES: usize = 32;
/// Least share of the area that lies in a plane, least number of sampled triangles in it, and of those that propose it.
const LEAST_SHARE: f64 = 0.002;
const LEAST_TRIANGLES: usize = 12;
const LEAST_PROPOSERS: usize = 4;
/// Triangles may propose a plane together if components of their unit normals agree to 1 in this, and the distances
/// of their planes to this share of the extent.
const NORMAL_STEPS: f64 = 64.0;
const OFFSET_STEPS: f64 = 1024.0;
/// The largest triangles of a group, each of which is tried as a first guess.
const GUESSES: usize = 3;
/// Times that a plane is fitted to what it holds.
const REFINEMENTS: usize = 3;
/// A triangle tells of a plane only if its longest edge is this many times what rounding explains.
const LEAST_LENGTH: f64 = 32.0;
/// A normal this near to an axis is the axis.
const NEAR_AXIS: f64 = 1e-4;
/// Planes at a smaller sine to each other meet nowhere for certain.
const PARALLEL: f64 = 0.02;

/// A plane: `normal . p = offset`.
#[derive(Clone, Debug)]
struct Plane {
    normal: Vec3,
    offset: f64,
    /// The axis that the normal is, if it is one: then a coordinate says all.
    axis: Option<usize>,
}

impl Plane {
    fn height(&self, p: Vec3) -> f64 {
        match self.axis {
            Some(k) => p[k] - self.offset,
            None => dot(self.normal, p) - self.offset,
        }
    }
}

/// A triangle that is looked at; long enough to tell of a plane.
struct Sample {
    corners: [Vec3; 3],
    /// Unit normal.
    unit: Vec3,
    area: f64,
    /// Longest edge, roughly.
    longest: f64,
}

impl Sample {
    /// `None` for a triangle without area, or one that rounding may have put into any plane.
    fn of(vertices: &[Vertex], t: &[u32; 3], tolerance: f64) -> Option<Sample> {
        let corners = t.map(|v| vertices[v as usize].position);
        let (b, c) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let n = cross(b, c);
        let length = length_sq(n).sqrt();
        let longest = length_sq(b).max(length_sq(c)).sqrt();
        let unit = scale(n, 1.0 / length);
        let is_long = longest >= LEAST_LENGTH * tolerance;
        (length > 0.0 && is_long).then_some(Sample { corners, unit, area: 0.5 * length, longest })
    }
}

/// Numbers of the samples that propose planes: evenly spread ones, and the largest.
fn proposers(samples: &[Sample]) -> Vec<usize> {
    let step = samples.len().div_ceil(EVENLY_SPREAD).max(1);
    let mut chosen: Vec<usize> = (0..samples.len()).step_by(step).collect();
    let mut by_area: Vec<usize> = (0..samples.len()).collect();
    if by_area.len() > LARGEST {
        by_area.select_nth_unstable_by(LARGEST, |&a, &b| {
            samples[b].area.total_cmp(&samples[a].area).then(a.cmp(&b))
        });
        by_area.truncate(LARGEST);
    }
    chosen.extend(by_area);
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// The planes of a surface, and the vertices whose triangles lie in them.
#[derive(Clone, Debug)]
pub(crate) struct Flats {
    planes: Vec<Plane>,
    /// Distance from a plane that rounding explains.
    tolerance: f64,
    /// Of each vertex: the planes that a triangle around it lies in.
    masks: Vec<u32>,
}

/// The place, line or plane in which all of some planes meet, relative to a point.
pub(crate) struct PlaneMeeting {
    /// Orthonormal normals; the first `rank` of them count.
    pub(crate) normals: [Vec3; 3],
    pub(crate) rank: usize,
    /// The nearest place of it.
    pub(crate) nearest: Vec3,
}

impl Flats {
    /// Finds the planes; `None` if there are none. `spacing` is the rounding of the coordinates.
    pub(crate) fn find(
        vertices: &[Vertex],
        triangles: &[[u32; 3]],
        spacing: f64,
    ) -> Option<Box<Flats>> {
        let tolerance = 2.0 * spacing;
        let step = triangles.len().div_ceil(MOST_SAMPLES).max(1);
        let alive = triangles.iter().filter(|t| t[0] != GONE).step_by(step);
        let samples: Vec<Sample> =
            alive.filter_map(|t| Sample::of(vertices, t, tolerance)).collect();
        let first = samples.first()?.corners[0];
        let corners = samples.iter().flat_map(|sample| &sample.corners);
        let extent = corners.fold(0.0f64, |most, p| most.max(length_sq(sub(*p, first)))).sqrt();
        if extent <= 0.0 || !extent.is_finite() || tolerance > extent / 1e4 {
            return None;
        }
        let total: f64 = samples.iter().map(|sample| sample.area).sum();
        let mut flats = Flats { planes: Vec::new(), tolerance, masks: Vec::new() };
        let proposers = proposers(&samples);
        let mut keyed: Vec<([i32; 4], usize)> = proposers
            .into_iter()
            .map(|i| {
                let Sample { corners, unit, .. } = &samples[i];
                let normal = unit.map(|x| (x * NORMAL_STEPS).round() as i32);
                let offset = dot(*unit, sub(corners[0], first)) / extent;
                ([normal[0], normal[1], normal[2], (offset * OFFSET_STEPS).round() as i32], i)
            })
            .collect();
        keyed.sort_unstable();
        for group in keyed.chunk_by(|a, b| a.0 == b.0) {
            if group.len() < LEAST_PROPOSERS || flats.planes.len() >= MOST_PLANES {
                continue;
            }
            let members: Vec<&Sample> = group.iter().map(|&(_, i)| &samples[i]).collect();
            let Some(plane) =
                flats.proposed(&members).and_then(|plane| flats.refined(plane, &samples))
            else {
                continue;
            };
            let inside = samples.iter().filter(|sample| flats.holds(&plane, sample));
            let (n, held) = inside.fold((0, 0.0), |(n, sum), sample| (n + 1, sum + sample.area));
            let is_known = flats.planes.iter().any(|known| {
                1.0 - dot(known.normal, plane.normal).abs() < 1e-6
                    && known.height(samples[group[0].1].corners[0]).abs() < 16.0 * tolerance
            });
            if n >= LEAST_TRIANGLES && held >= LEAST_SHARE * total && !is_known {
                flats.planes.push(plane);
            }
        }
        if flats.planes.is_empty() {
            return None;
        }
        flats.assign(vertices, triangles);
        Some(Box::new(flats))
    }

    fn is_long(&self, [a, b, c]: [Vec3; 3]) -> bool {
        let longest_sq = length_sq(sub(b, a)).max(length_sq(sub(c, a)));
        longest_sq >= (LEAST_LENGTH * self.tolerance).powi(2)
    }

    fn holds(&self, plane: &Plane, sample: &Sample) -> bool {
        sample.corners.iter().all(|&p| plane.height(p).abs() <= self.tolerance)
    }

    /// The plane of a large triangle that holds most others of its group, as far as its own rounding lets it.
    fn proposed(&self, members: &[&Sample]) -> Option<Plane> {
        let mut largest = members.to_vec();
        largest.sort_by(|a, b| b.area.total_cmp(&a.area));
        let mut best = None;
        let mut most = LEAST_PROPOSERS - 1;
        for guess in largest.iter().take(GUESSES) {
            let plane = fitted(&[guess])?;
            // The angle by which rounding may turn it.
            let tilt = 4.0 * self.tolerance * guess.longest / guess.area;
            let is_near = |p: &Vec3| {
                let off = length_sq(sub(*p, guess.corners[0])).sqrt();
                plane.height(*p).abs() <= self.tolerance + tilt * off
            };
            let inside: Vec<&Sample> =
                members.iter().copied().filter(|m| m.corners.iter().all(is_near)).collect();
            if inside.len() > most {
                most = inside.len();
                best = fitted(&inside);
            }
        }
        best
    }

    /// The plane fitted to all sampled triangles that it holds; `None` if those are too few.
    fn refined(&self, mut plane: Plane, samples: &[Sample]) -> Option<Plane> {
        for refinement in (0..REFINEMENTS).rev() {
            let reach = self.tolerance * (1 << refinement) as f64;
            let is_near = |p: &Vec3| plane.height(*p).abs() <= reach;
            let near: Vec<&Sample> =
                samples.iter().filter(|sample| sample.corners.iter().all(is_near)).collect();
            if near.len() < LEAST_TRIANGLES {
                return None;
            }
            plane = fitted(&near)?;
        }
        Some(plane)
    }

    /// Finds the planes of each vertex again, from where the corners of triangles lie.
    pub(crate) fn assign(&mut self, vertices: &[Vertex], triangles: &[[u32; 3]]) {
        let near = |vertex: &Vertex| {
            let is_in = |plane: &Plane| plane.height(vertex.position).abs() <= self.tolerance;
            self.planes.iter().rev().fold(0, |bits, plane| bits << 1 | u32::from(is_in(plane)))
        };
        let near: Vec<u32> = vertices.iter().map(near).collect();
        self.masks.clear();
        self.masks.resize(vertices.len(), 0);
        for t in triangles.iter().filter(|t| t[0] != GONE) {
            let held = t.iter().fold(u32::MAX, |bits, &v| bits & near[v as usize]);
            if held == 0 || !self.is_long(t.map(|v| vertices[v as usize].position)) {
                continue;
            }
            t.iter().for_each(|&v| self.masks[v as usize] |= held);
        }
    }

    /// The planes that triangles around a vertex lie in, a bit each.
    #[inline(always)]
    pub(crate) fn of(&self, v: u32) -> u32 {
        self.masks.get(v as usize).copied().unwrap_or(0)
    }

    fn planes_of(&self, mask: u32) -> impl Iterator<Item = (u32, &Plane)> {
        let bits = (0..self.planes.len()).map(|k| 1u32 << k);
        bits.zip(&self.planes).filter(move |(bit, _)| mask & bit != 0)
    }

    /// True if a point lies in all of some planes.
    pub(crate) fn contain(&self, mask: u32, p: Vec3) -> bool {
        self.planes_of(mask).all(|(_, plane)| plane.height(p).abs() <= self.tolerance)
    }

    /// Meeting of all planes of a mask, relative to `centre`; `None` if they do not.
    pub(crate) fn meeting(&self, mask: u32, centre: Vec3) -> Option<PlaneMeeting> {
        let mut found = PlaneMeeting { normals: [[0.0; 3]; 3], rank: 0, nearest: [0.0; 3] };
        for (_, plane) in self.planes_of(mask) {
            let (mut rest, mut wanted) = (plane.normal, -plane.height(centre));
            wanted -= dot(plane.normal, found.nearest);
            for known in &found.normals[..found.rank] {
                rest = sub(rest, scale(*known, dot(*known, plane.normal)));
            }
            let sine = length_sq(rest).sqrt();
            if sine > PARALLEL && found.rank < 3 {
                let unit = scale(rest, 1.0 / sine);
                found.nearest = add(found.nearest, scale(unit, wanted / sine));
                found.normals[found.rank] = unit;
                found.rank += 1;
            } else if wanted.abs() > 16.0 * self.tolerance {
                return None;
            }
        }
        Some(found)
    }

    /// Brings the survivor of a collapse into the planes of both ends that it is next to, with a bit for each of those;
    /// notes nothing. `reach` is the length of the edge.
    pub(crate) fn hold(&self, (v0, v1): (u32, u32), place: Vec3, reach: f64) -> (Vec3, u32) {
        let mask = self.of(v0) | self.of(v1);
        if mask == 0 {
            return (place, 0);
        }
        let near = 16.0 * self.tolerance + 1e-6 * reach;
        let kept = self.planes_of(mask).filter(|(_, plane)| plane.height(place).abs() <= near);
        let kept = kept.fold(0, |bits, (bit, _)| bits | bit);
        // Planes that hardly differ may meet far away.
        let (kept, mut held) = match self.meeting(kept, place) {
            Some(meeting) if length_sq(meeting.nearest) <= (near + reach) * (near + reach) => {
                (kept, add(place, meeting.nearest))
            }
            _ => (0, place),
        };
        for (_, plane) in self.planes_of(kept) {
            if let Some(k) = plane.axis {
                held[k] = plane.offset;
            }
        }
        (held, kept)
    }

    /// The same where the survivor stays at `v1`.
    pub(crate) fn hold_fixed(&mut self, (v0, v1): (u32, u32), place: Vec3) {
        let mask = self.of(v0) | self.of(v1);
        let kept = self.planes_of(mask).filter(|(_, p)| p.height(place).abs() <= self.tolerance);
        let kept = kept.fold(0, |bits, (bit, _)| bits | bit);
        self.set(v1, kept);
    }

    /// Notes the planes that a vertex lies in, a bit for each.
    pub(crate) fn set(&mut self, v: u32, mask: u32) {
        if let Some(known) = self.masks.get_mut(v as usize) {
            *known = mask;
        }
    }
}

/// The plane of least squares through the corners of triangles: the direction that their normals sum up to, tilted by the
/// linear part of the heights that are left.
fn fitted(triangles: &[&Sample]) -> Option<Plane> {
    // Whichever way they face.
    let first = triangles.first()?.unit;
    let sum = triangles.iter().fold([0.0; 3], |sum, sample| {
        add(sum, scale(sample.unit, sample.area * dot(sample.unit, first).signum()))
    });
    let unit = |v: Vec3| {
        let length = length_sq(v).sqrt();
        (length > 0.0 && length.is_finite()).then(|| scale(v, 1.0 / length))
    };
    let mut normal = unit(sum)?;
    let mut corners: Vec<Vec3> = triangles.iter().flat_map(|sample| sample.corners).collect();
    let origin = corners[0];
    let mean = corners.iter().fold([0.0; 3], |sum, &p| add(sum, sub(p, origin)));
    let mean = add(origin, scale(mean, 1.0 / corners.len() as f64));
    let (u, v) = across(normal)?;
    let (mut uu, mut uv, mut vv, mut uh, mut vh) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for &p in &corners {
        let off = sub(p, mean);
        let (x, y, height) = (dot(off, u), dot(off, v), dot(off, normal));
        (uu, uv, vv) = (uu + x * x, uv + x * y, vv + y * y);
        (uh, vh) = (uh + x * height, vh + y * height);
    }
    let determinant = uu * vv - uv * uv;
    if determinant > 1e-9 * (uu + vv) * (uu + vv) {
        let (a, b) = ((uh * vv - vh * uv) / determinant, (vh * uu - uh * uv) / determinant);
        normal = unit(sub(sub(normal, scale(u, a)), scale(v, b)))?;
    }
    if let Some(k) = (0..3).find(|&k| normal[k].abs() > 1.0 - 0.5 * NEAR_AXIS * NEAR_AXIS) {
        normal = std::array::from_fn(|i| f64::from(u8::from(i == k)));
        // The middle one: a coordinate that occurs, not a mean of many that are equal.
        let middle = corners.len() / 2;
        corners.select_nth_unstable_by(middle, |a, b| a[k].total_cmp(&b[k]));
        return Some(Plane { normal, offset: corners[middle][k], axis: Some(k) });
    }
    Some(Plane { normal, offset: dot(normal, mean), axis: None })
}

/// Two unit vectors that make a right-angled frame with a unit vector.
pub(crate) fn across(normal: Vec3) -> Option<(Vec3, Vec3)> {
    let least = (0..3).min_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs()))?;
    let axis: Vec3 = std::array::from_fn(|i| f64::from(u8::from(i == least)));
    let u = cross(normal, axis);
    let u = scale(u, 1.0 / length_sq(u).sqrt());
    Some((u, cross(normal, u)))
}
