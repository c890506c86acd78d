//! A progressive mesh for a browser: the steps told so that they can be taken and taken back without a search.
//!
//! A split names the corners that go to the new vertex instead of a place in an order, so that no order is needed.
//! Positions have 16 bits an axis, colours 8 bits a channel; nothing else that vertices carry is there. docs/format.md has
//! the bytes, web/slides.js reads them.

use super::read::Refiner;
use super::replay::Replay;
use super::rows::Rows;
use super::step_reader::Taken;
use super::steps::{Other, Split};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;

/// The first bytes; the last one is the version.
const MAGIC: [u8; 8] = *b"stncuts2";

/// Places on an axis.
const PLACES: f64 = 65_535.0;

/// Steps of a progressive mesh as they are gathered.
#[derive(Default)]
struct Slides {
    /// Positions in the order in which steps name them.
    positions: Vec<[f32; 3]>,
    /// Types and places of the channels of a colour in a record.
    channels: Option<ColourPlace>,
    /// Colours beside the positions, if there are any.
    colours: Vec<[u8; 3]>,
    record: Vec<u8>,
    steps: Vec<u8>,
    n_steps: u32,
    n_vertices: u32,
    n_triangles: u32,
}

/// Writes all of a progressive mesh that was opened, for a browser.
///
/// Memory: that of the finest mesh, and about 60 bytes a step. Errors: those of `Refiner::refine`.
pub fn slides(mut mesh: Refiner, check: &dyn Fn() -> Result<()>) -> Result<Vec<u8>> {
    mesh.base(check)?;
    let rows = mesh.rows().clone();
    let base = (mesh.replay.keys.len() as u32, mesh.replay.triangles.len() as u32);
    let channels = ColourPlace::find(&rows.schema);
    let mut slides =
        Slides { channels, n_vertices: base.0, n_triangles: base.1, ..Slides::default() };
    for v in 0..base.0 {
        slides.add_place(mesh.replay.row(v), &rows);
    }
    let corners = mesh.replay.triangles.clone();
    mesh.refine_watched(u64::MAX, check, &mut |replay, step| {
        slides.add(replay, step, &rows);
        Ok(())
    })?;
    Ok(slides.bytes(base, &corners))
}

impl Slides {
    /// Appends the position and the colour of a row.
    fn add_place(&mut self, row: &[u8], rows: &Rows) {
        self.positions.push(rows.position(row).map(|x| x as f32));
        let Some(channels) = self.channels else { return };
        self.record.clear();
        rows.put_record(row, &mut self.record);
        self.colours.push(channels.bytes(&self.record));
    }

    fn add(&mut self, replay: &Replay, step: &Taken, rows: &Rows) {
        match step {
            Taken::Split(split) => self.add_split(replay, split, rows),
            Taken::Other(other) => self.add_other(replay, other, rows),
        }
        self.n_steps += 1;
    }

    /// 0, the split vertex from the last one back, the number of corners, these as differences, the new triangles.
    fn add_split(&mut self, replay: &Replay, split: &Split, rows: &Rows) {
        self.put(0);
        self.put(self.n_vertices - split.kept);
        split.rows.iter().for_each(|row| self.add_place(row, rows));
        self.n_vertices += 1;
        let corner = |&t: &u32| {
            let k = replay.triangles[t as usize].iter().position(|&v| v == split.kept);
            3 * t + k.unwrap_or(0) as u32
        };
        let corners: Vec<u32> = split.fan.iter().map(corner).collect();
        self.put_corners(&corners);
        self.put_triangles(split.gone.iter().map(|&(corners, _)| corners));
    }

    /// 1, the number of new vertices, the new triangles, the number of triangles that go, these, the number of vertices whose
    /// corners go to another one, and for each this other one, the number of corners, these.
    fn add_other(&mut self, replay: &Replay, other: &Other, rows: &Rows) {
        self.put(1);
        let n_new = other.keys.len() as u32;
        self.put(n_new);
        for i in 0..n_new as usize {
            self.add_place(&other.rows[i * replay.stride..][..replay.stride], rows);
        }
        self.n_vertices += n_new;
        let first = self.n_triangles;
        self.put_triangles(other.triangles.iter().map(|&(corners, _)| corners));
        let Some((cycle, new, mut caps)) = other.join else {
            self.put(0);
            self.put(0);
            return;
        };
        caps.sort_unstable();
        self.put_corners(&caps);
        self.put(3);
        for (from, to) in new.into_iter().zip(cycle) {
            let known = replay.has_vertex(from).then(|| replay.corners_of(from));
            let added = (0..).zip(&other.triangles).flat_map(|(i, (corners, _))| {
                (0..3)
                    .filter(move |&k| corners[k as usize] == from)
                    .map(move |k| 3 * (first + i) + k)
            });
            let mut corners: Vec<u32> = known.into_iter().flatten().chain(added).collect();
            corners.retain(|corner| !caps.contains(&(corner / 3)));
            corners.sort_unstable();
            self.put(to);
            self.put_corners(&corners);
        }
    }

    /// Seven bits a byte, the lowest first.
    fn put(&mut self, mut value: u32) {
        while value >= 128 {
            self.steps.push(value as u8 | 128);
            value >>= 7;
        }
        self.steps.push(value as u8);
    }

    /// Ascending numbers: how many, then each as the difference from the one before.
    fn put_corners(&mut self, corners: &[u32]) {
        self.put(corners.len() as u32);
        let mut last = 0;
        for &corner in corners {
            self.put(corner.wrapping_sub(last));
            last = corner;
        }
    }

    fn put_triangles(&mut self, triangles: impl ExactSizeIterator<Item = [u32; 3]>) {
        self.put(triangles.len() as u32);
        self.n_triangles += triangles.len() as u32;
        for v in triangles.flatten() {
            self.put(self.n_vertices - 1 - v);
        }
    }

    fn bytes(self, base: (u32, u32), corners: &[[u32; 3]]) -> Vec<u8> {
        let points: Vec<Vec3> = self.positions.iter().map(|p| p.map(f64::from)).collect();
        let bounds = Bounds::around(&points).or_origin();
        let side = bounds.side();
        let step = if side > 0.0 { side / PLACES } else { 1.0 };
        let mut out = MAGIC.to_vec();
        let numbers = [base.0, base.1, self.n_vertices, self.n_triangles, self.n_steps];
        let has_colours = u32::from(self.channels.is_some());
        let numbers = numbers.into_iter().chain([points.len() as u32, has_colours, 0]);
        out.extend(numbers.flat_map(u32::to_le_bytes));
        out.extend(
            [bounds.low[0], bounds.low[1], bounds.low[2], step]
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        );
        for point in &points {
            for (x, low) in point.iter().zip(&bounds.low) {
                out.extend((((x - low) / step).round() as u16).to_le_bytes());
            }
        }
        // Numbers of four bytes begin where their width divides the offset.
        out.resize(out.len().next_multiple_of(4), 0);
        out.extend(self.colours.iter().flatten());
        out.resize(out.len().next_multiple_of(4), 0);
        out.extend(corners.iter().flatten().flat_map(|v| v.to_le_bytes()));
        out.extend(self.steps);
        out
    }
}
