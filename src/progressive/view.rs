//! A mesh for an eye: finer where it sees an error, coarse behind it and where the surface faces away.
//!
//! Of all steps those are taken whose error the eye sees, and those that they depend on. A step depends on earlier ones that
//! gave the triangles around its vertices, and around their neighbours, away or added some, so that what is taken is a run of legal splits: one connected mesh, without
//! cracks. Reads the file twice: first to choose, then to take the chosen steps beside the whole.
//!
//! Source: Xia & Varshney 1996, Hoppe 1997 (docs/references.md).

use super::read::Refiner;
use super::replay::{NONE, Replay};
use super::rows::Rows;
use super::step_reader::Taken;
use super::steps::{Other, Split};
use stonecut_mesh::vec3::{Vec3, cross, dot, length_sq, scale, sub, triangle_distance_sq};
use stonecut_system::error::{Error, Result};

/// An eye and what it may see of an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Place of the eye, in input units.
    pub eye: Vec3,
    /// A place in the middle of the picture.
    pub target: Vec3,
    /// Angle between the upper and the lower edge of the picture, in degrees, above 0 and below 180.
    pub degrees: f64,
    /// Largest error that is not seen, in pixels.
    pub pixels: f64,
    /// Pixels between the upper and the lower edge.
    pub height: f64,
}

/// Counts of what was taken for a view.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Viewed {
    /// Steps of the file.
    pub steps: u64,
    /// Steps whose error is seen.
    pub seen: u64,
    /// Steps that were taken: these and what they depend on.
    pub taken: u64,
}

/// The least share of an error that counts where it points at the eye: it shows in the shading.
const LEAST_SHARE: f64 = 0.25;

/// Brings a progressive mesh to the mesh for a view. `open` opens the file, twice.
///
/// Memory: twice that of the finest mesh, and about 60 bytes a step. Errors: those of `Refiner::refine`.
pub fn refine_for_view(
    open: &dyn Fn() -> Result<Refiner>,
    view: &View,
    check: &dyn Fn() -> Result<()>,
) -> Result<(Refiner, Viewed)> {
    let mut whole = open()?;
    let rows = whole.rows().clone();
    let sight = ViewSight::new(view);
    let mut graph = Graph::default();
    whole.refine_watched(u64::MAX, check, &mut |replay, step| {
        graph.add(replay, step, sight.sees_step(&rows, replay, step));
        Ok(())
    })?;
    drop(whole);
    let steps = graph.is_needed.len() as u64;
    let seen = graph.is_needed.iter().filter(|&&needed| needed).count() as u64;
    let is_needed = graph.closed();
    let taken = is_needed.iter().filter(|&&needed| needed).count() as u64;
    let mut whole = open()?;
    whole.base(check)?;
    let mut part = Part::new(whole.replay.clone());
    let mut number = 0;
    whole.refine_watched(u64::MAX, check, &mut |replay, step| {
        let is_needed = is_needed.get(number).copied().unwrap_or_default();
        number += 1;
        part.take(replay, step, is_needed)
    })?;
    whole.replay = part.mesh;
    Ok((whole, Viewed { steps, seen, taken }))
}

/// A view, prepared.
struct ViewSight {
    eye: Vec3,
    forward: Vec3,
    /// Half the angle of the cone around the picture's corners.
    half: f64,
    /// Pixels of a length of 1 at a distance of 1.
    scale: f64,
    pixels: f64,
}

impl ViewSight {
    fn new(view: &View) -> ViewSight {
        let forward = sub(view.target, view.eye);
        let length = length_sq(forward).sqrt();
        let tan = (view.degrees.to_radians() / 2.0).tan();
        ViewSight {
            eye: view.eye,
            forward: scale(forward, 1.0 / length.max(f64::MIN_POSITIVE)),
            half: (tan * std::f64::consts::SQRT_2).atan(),
            scale: view.height / (2.0 * tan),
            pixels: view.pixels,
        }
    }

    /// Returns whether an error of this length is seen on triangles within `radius` of a place.
    fn sees(&self, place: Vec3, radius: f64, error: f64, triangles: &[[Vec3; 3]]) -> bool {
        let to = sub(place, self.eye);
        let distance = length_sq(to).sqrt();
        if distance > radius {
            let angle = (dot(to, self.forward) / distance).clamp(-1.0, 1.0).acos();
            if angle > self.half + (radius / distance).asin() {
                return false;
            }
        }
        let nearest = (distance - radius).max(1e-3 * radius).max(f64::MIN_POSITIVE);
        let pixels = error / nearest * self.scale;
        if pixels <= self.pixels {
            return false;
        }
        // Which way the triangles face; how much of an error along their normals shows sideways.
        let (mut front, mut back, mut most) = (false, false, LEAST_SHARE);
        for &t in triangles {
            let normal = cross(sub(t[1], t[0]), sub(t[2], t[0]));
            let to = sub(t[0], self.eye);
            let lengths = (length_sq(normal) * length_sq(to)).sqrt();
            if lengths > 0.0 {
                let cosine = dot(normal, to) / lengths;
                front |= cosine < 0.0;
                back |= cosine >= 0.0;
                most = f64::max(most, (1.0 - cosine * cosine).max(0.0).sqrt());
            }
        }
        match (front, back) {
            (false, true) => false,
            (true, false) => pixels * most > self.pixels,
            // A silhouette; or triangles without area, of which nothing is known.
            _ => true,
        }
    }

    fn sees_step(&self, rows: &Rows, replay: &Replay, step: &Taken) -> bool {
        match step {
            Taken::Split(split) => self.sees_split(rows, replay, split),
            Taken::Other(other) => self.sees_other(rows, replay, other),
        }
    }

    /// The error is the distance between the triangles before and after, both ways, at their corners.
    fn sees_split(&self, rows: &Rows, replay: &Replay, split: &Split) -> bool {
        let place = |v: u32| rows.position(replay.row(v));
        let before = place(split.kept);
        let [of_new, of_kept] = [0, 1].map(|k| rows.position(&split.rows[k]));
        let new = replay.keys.len() as u32;
        let around = replay.around(split.kept);
        let corners = |t: u32| replay.triangles[t as usize];
        let old: Vec<[Vec3; 3]> = around.triangles.iter().map(|&t| corners(t).map(place)).collect();
        let after = |t: [u32; 3], own: Vec3| {
            t.map(|v| match v {
                v if v == new => of_new,
                v if v == split.kept => own,
                v => place(v),
            })
        };
        let mut fine: Vec<[Vec3; 3]> = around
            .triangles
            .iter()
            .map(|t| {
                let is_moved = split.fan.binary_search(t).is_ok();
                after(corners(*t), if is_moved { of_new } else { of_kept })
            })
            .collect();
        fine.extend(split.gone.iter().map(|&(t, _)| after(t, of_kept)));
        let from = |p: Vec3, triangles: &[[Vec3; 3]]| {
            let distances = triangles.iter().map(|&t| triangle_distance_sq(p, t));
            distances.fold(f64::INFINITY, f64::min)
        };
        let error = from(of_new, &old).max(from(of_kept, &old)).max(from(before, &fine));
        let error = match error.is_finite() {
            true => error.sqrt(),
            false => length_sq(sub(of_new, of_kept)).sqrt(),
        };
        let radius = fine.iter().flatten().map(|&p| length_sq(sub(p, before)));
        let radius = radius.fold(0.0, f64::max).sqrt();
        fine.extend(old);
        self.sees(before, radius, error, &fine)
    }

    /// The error is the size of what appears, or of the opening of a tube.
    fn sees_other(&self, rows: &Rows, replay: &Replay, other: &Other) -> bool {
        let stride = rows.stride();
        let n = replay.keys.len() as u32;
        let place = |v: u32| match v.checked_sub(n) {
            Some(i) => rows.position(&other.rows[i as usize * stride..][..stride]),
            None => rows.position(replay.row(v)),
        };
        let mut places: Vec<Vec3> =
            other.triangles.iter().flat_map(|(t, _)| t.map(place)).collect();
        places.extend(other.join.iter().flat_map(|(cycle, ..)| cycle.map(place)));
        let Some(&first) = places.first() else { return false };
        let radius = places.iter().map(|&p| length_sq(sub(p, first))).fold(0.0, f64::max).sqrt();
        self.sees(first, radius, radius, &[])
    }
}

/// Steps, and the earlier ones that each depends on.
#[derive(Default)]
struct Graph {
    is_needed: Vec<bool>,
    needs: Vec<u32>,
    /// End of each step's part of `needs`.
    ends: Vec<usize>,
    /// Last step that gave triangles of a vertex away, or made it; those that added some since.
    last: Vec<u32>,
    added: Vec<Vec<u32>>,
}

impl Graph {
    fn add(&mut self, replay: &Replay, step: &Taken, is_seen: bool) {
        let number = self.is_needed.len() as u32;
        let new = replay.keys.len() as u32;
        let (mut centres, mut rims): (Vec<u32>, Vec<u32>) = Default::default();
        // All vertices around have to be as they were in the whole: two that are still one would make a double edge.
        let mut near = Vec::new();
        match step {
            Taken::Split(split) => {
                centres.extend([split.kept, new]);
                let corners = split.gone.iter().flat_map(|(t, _)| t);
                rims.extend(corners.copied().filter(|&v| v != split.kept && v != new));
                let around = replay.around(split.kept).triangles;
                near.extend(around.iter().flat_map(|&t| replay.triangles[t as usize]));
                near.sort_unstable();
                near.dedup();
            }
            Taken::Other(other) => {
                centres.extend((new..).take(other.keys.len()));
                centres.extend(other.triangles.iter().flat_map(|(t, _)| t));
                if let Some((cycle, of_side, caps)) = &other.join {
                    centres.extend(cycle.iter().chain(of_side));
                    let corners = caps.iter().filter_map(|&t| replay.triangles.get(t as usize));
                    centres.extend(corners.flatten().filter(|&&v| v != NONE));
                }
            }
        }
        let most =
            centres.iter().chain(&rims).chain(&near).fold(0, |most, &v| most.max(v as usize + 1));
        if self.last.len() < most {
            self.last.resize(most, NONE);
            self.added.resize(most, Vec::new());
        }
        let start = self.needs.len();
        for &v in centres.iter().chain(&rims).chain(&near) {
            self.needs.extend(Some(self.last[v as usize]).filter(|&last| last != NONE));
        }
        for &v in &centres {
            self.needs.append(&mut self.added[v as usize]);
            self.last[v as usize] = number;
        }
        rims.iter().for_each(|&v| self.added[v as usize].push(number));
        self.needs[start..].sort_unstable();
        let mut unique = start;
        for i in start..self.needs.len() {
            if i == start || self.needs[i] != self.needs[i - 1] {
                self.needs[unique] = self.needs[i];
                unique += 1;
            }
        }
        self.needs.truncate(unique);
        self.is_needed.push(is_seen);
        self.ends.push(self.needs.len());
    }

    /// Steps that are needed, with all that they depend on.
    fn closed(mut self) -> Vec<bool> {
        for i in (0..self.is_needed.len()).rev() {
            if self.is_needed[i] {
                let start = i.checked_sub(1).map_or(0, |before| self.ends[before]);
                for &need in &self.needs[start..self.ends[i]] {
                    // A step may touch a vertex twice.
                    if need as usize != i {
                        self.is_needed[need as usize] = true;
                    }
                }
            }
        }
        self.is_needed
    }
}

/// The mesh of the chosen steps, beside the whole one.
struct Part {
    mesh: Replay,
    /// Numbers in it of vertices and triangles of the whole.
    vertex: Vec<u32>,
    triangle: Vec<u32>,
}

impl Part {
    /// Begins with the coarsest mesh, which both have.
    fn new(mesh: Replay) -> Part {
        let vertex = (0..mesh.keys.len() as u32).collect();
        let triangle = (0..mesh.triangles.len() as u32).collect();
        Part { mesh, vertex, triangle }
    }

    fn of_vertex(&self, v: u32) -> Result<u32> {
        let found = self.vertex.get(v as usize).copied().filter(|&v| v != NONE);
        found.ok_or_else(|| Error::Internal(format!("a step for a view needs vertex {v}")))
    }

    fn of_triangle(&self, t: u32) -> Result<u32> {
        let found = self.triangle.get(t as usize).copied().filter(|&t| t != NONE);
        found.ok_or_else(|| Error::Internal(format!("a step for a view needs triangle {t}")))
    }

    /// Takes a step of the whole, or only counts what it adds there.
    fn take(&mut self, whole: &Replay, step: &Taken, is_needed: bool) -> Result<()> {
        self.vertex.resize(whole.keys.len(), NONE);
        self.triangle.resize(whole.triangles.len(), NONE);
        if !is_needed {
            return Ok(());
        }
        let mut gone = Vec::new();
        let mine = match step {
            Taken::Split(split) => {
                let kept = self.of_vertex(split.kept)?;
                self.vertex.push(self.mesh.keys.len() as u32);
                let mut fan = Vec::with_capacity(split.fan.len());
                for &t in &split.fan {
                    let t = self.of_triangle(t)?;
                    if !self.mesh.triangles[t as usize].contains(&kept) {
                        return Err(Error::Internal(format!("triangle {t} has no vertex {kept}")));
                    }
                    fan.push(t);
                }
                fan.sort_unstable();
                for &(t, key) in &split.gone {
                    gone.push((self.of_corners(t)?, key));
                }
                let (keys, rows) = (split.keys, split.rows.clone());
                Taken::Split(Split { kept, fan, gone: gone.clone(), keys, rows })
            }
            Taken::Other(other) => {
                let first = self.mesh.keys.len() as u32;
                self.vertex.extend((first..).take(other.keys.len()));
                for &(t, key) in &other.triangles {
                    gone.push((self.of_corners(t)?, key));
                }
                let first = self.mesh.triangles.len() as u32;
                self.triangle.extend((first..).take(gone.len()));
                let join = match other.join {
                    None => None,
                    Some((cycle, new, caps)) => Some((
                        self.of_corners(cycle)?,
                        self.of_corners(new)?,
                        [self.of_triangle(caps[0])?, self.of_triangle(caps[1])?],
                    )),
                };
                let (rows, keys) = (other.rows.clone(), other.keys.clone());
                Taken::Other(Other { rows, keys, triangles: gone.clone(), join })
            }
        };
        if let Taken::Split(_) = mine {
            let first = self.mesh.triangles.len() as u32;
            self.triangle.extend((first..).take(gone.len()));
        }
        mine.carry_out(&mut self.mesh);
        Ok(())
    }

    fn of_corners(&self, t: [u32; 3]) -> Result<[u32; 3]> {
        Ok([self.of_vertex(t[0])?, self.of_vertex(t[1])?, self.of_vertex(t[2])?])
    }
}
