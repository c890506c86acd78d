//! Points that stand for the original: drawn out of its cells, each with the area around it, kept in memory.
//!
//! Where few triangles of the original come on one of the result, a triangle has three points, with which squared distances
//! to planes are exact. Where more do, its middle; where far more do, neighbours that face the same way become one
//! point, their mean. The distance to a plane is linear, so a mean stands for all of them. Threads and memory do
//! not show.

use std::sync::{Mutex, PoisonError};
use stonecut_io::ply::MeshSource;
use stonecut_measure::sample::order_along_curve;
use stonecut_measure::sums::Sum;
use stonecut_measure::temp_store::{Cutting, Scratch};
use stonecut_measure::triangle;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, scale, sub, unit};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::load_bytes;
use stonecut_system::error::Result;
use stonecut_system::parallel::{Weighted, largest_first};
use stonecut_system::progress::Progress;

/// Points for each triangle of the result that are enough.
const ENOUGH: u64 = 32;

/// Points for each triangle of the result at most: neighbours that cannot be merged make more than enough.
pub(super) const MOST: u64 = 2 * ENOUGH;

/// With fewer triangles of the original for one of the result, each has three points instead of one.
const THREE_POINTS: u64 = 12;

/// Weights of two of the corners at these points, which integrate to second order.
const INSIDE: f64 = 1.0 / 6.0;

/// Cosine between the normals of points that become one, at least.
const ALIKE: f64 = 0.7;

/// A point that stands for a part of the original around it, and the direction that its surface faces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    at: [f32; 3],
    /// Area.
    weight: f32,
    normal: [i8; 4],
}

impl Sample {
    /// A point on a surface with a normal of length 1.
    pub fn new(at: Vec3, normal: Vec3, weight: f64) -> Sample {
        let [x, y, z] = normal.map(|x| (127.0 * x).round() as i8);
        Sample { at: at.map(|x| x as f32), weight: weight as f32, normal: [x, y, z, 0] }
    }

    pub(super) fn at(&self) -> Vec3 {
        self.at.map(f64::from)
    }

    pub(super) fn weight(&self) -> f64 {
        f64::from(self.weight)
    }

    pub(super) fn normal(&self) -> Vec3 {
        [0, 1, 2].map(|k| f64::from(self.normal[k]) / 127.0)
    }
}

/// Means of drawing points.
#[derive(Clone, Copy)]
pub struct Drawing<'a> {
    /// Triangles of the result.
    pub n_triangles: u64,
    /// The place that points are relative to (`centre`), so that 32 bits are enough for them.
    pub origin: Vec3,
    /// Cells of the original.
    pub cutting: Cutting<'a>,
    /// Its request to stop.
    pub progress: &'a Progress,
}

/// A part of the surface: weighted sums.
#[derive(Clone, Copy)]
struct Part {
    at: Vec3,
    normal: Vec3,
    area: f64,
}

/// Rules by which neighbours become one.
#[derive(Clone, Copy)]
struct Merging {
    /// Area of a point, about.
    area: f64,
    /// True if triangles have three points each.
    is_three: bool,
}

/// Draws the points of a surface, relative to `origin`.
///
/// Memory: 48 bytes a point beside the points, and a cell for each thread as the budget of `cutting` allows. Disk: about 20
/// bytes a triangle.
pub fn draw(source: &MeshSource, drawing: Drawing) -> Result<Vec<Sample>> {
    let Drawing { n_triangles, cutting, progress, .. } = drawing;
    let scratch = Scratch::cut(source, cutting, progress)?;
    let diagonal = scratch.partition().bounds.diagonal();
    let area = Mutex::new(Sum::new(diagonal * diagonal));
    each_cell(&scratch, drawing, |_, mesh| {
        let mut sum = Sum::new(diagonal * diagonal);
        (0..mesh.triangles.len()).for_each(|t| sum.add(triangle::area(&mesh.corners(t))));
        area.lock().unwrap_or_else(PoisonError::into_inner).merge(&sum);
        Ok(())
    })?;
    let area = area.into_inner().unwrap_or_else(PoisonError::into_inner).value();
    let is_three = source.n_triangles() < THREE_POINTS * n_triangles;
    let merging = Merging { area: area / (ENOUGH * n_triangles.max(1)) as f64, is_three };
    let parts = Mutex::new(vec![Vec::new(); scratch.store().n_cells()]);
    each_cell(&scratch, drawing, |cell, mesh| {
        let points = merging.points(mesh, drawing.origin);
        parts.lock().unwrap_or_else(PoisonError::into_inner)[cell] = points;
        Ok(())
    })?;
    drop(scratch);
    let all = parts.into_inner().unwrap_or_else(PoisonError::into_inner).concat();
    let points: Vec<Vec3> = all.iter().map(Sample::at).collect();
    Ok(order_along_curve(&points).into_iter().map(|i| all[i as usize]).collect())
}

impl Merging {
    /// The points of a cell.
    fn points(self, mesh: &Mesh, origin: Vec3) -> Vec<Sample> {
        let middles: Vec<Vec3> =
            (0..mesh.triangles.len()).map(|t| middle(&mesh.corners(t))).collect();
        let mut out = Vec::new();
        let mut open: Option<Part> = None;
        let mut close = |part: Part| {
            let at = sub(scale(part.at, 1.0 / part.area), origin);
            out.extend(unit(part.normal).map(|normal| Sample::new(at, normal, part.area)));
        };
        for t in order_along_curve(&middles) {
            let corners = mesh.corners(t as usize);
            let area = triangle::area(&corners);
            let Some(normal) = unit(triangle::area_normal(&corners)).filter(|_| area > 0.0) else {
                continue;
            };
            let part = |at: Vec3, area: f64| Part {
                at: scale(at, area),
                normal: scale(normal, area),
                area,
            };
            if self.is_three {
                for k in 0..3 {
                    let mut weights = [INSIDE; 3];
                    weights[k] = 1.0 - 2.0 * INSIDE;
                    close(part(triangle::point_at(&corners, weights), area / 3.0));
                }
                continue;
            }
            let one = part(middle(&corners), area);
            open = Some(match open {
                Some(before) if self.goes_with(&before, &one) => before.and(&one),
                other => {
                    other.into_iter().for_each(&mut close);
                    one
                }
            });
        }
        open.into_iter().for_each(&mut close);
        out
    }

    /// True if two parts become one point: together they are no larger than wanted, near each other, and alike.
    fn goes_with(self, a: &Part, b: &Part) -> bool {
        let area = a.area + b.area;
        let apart = sub(scale(a.at, 1.0 / a.area), scale(b.at, 1.0 / b.area));
        let alike =
            dot(a.normal, b.normal) >= ALIKE * (length_sq(a.normal) * length_sq(b.normal)).sqrt();
        area <= self.area && length_sq(apart) <= 2.0 * self.area && alike
    }
}

impl Part {
    fn and(&self, other: &Part) -> Part {
        Part {
            at: add(self.at, other.at),
            normal: add(self.normal, other.normal),
            area: self.area + other.area,
        }
    }
}

fn middle(corners: &[Vec3; 3]) -> Vec3 {
    triangle::point_at(corners, [1.0 / 3.0; 3])
}

fn each_cell(
    scratch: &Scratch,
    drawing: Drawing,
    look: impl Fn(usize, &Mesh) -> Result<()> + Sync,
) -> Result<()> {
    let store = scratch.store();
    let job = |item: usize| {
        let tally = store.info().cells[item];
        // Middles, their order, points.
        let own = 100 * tally.triangles;
        Weighted { item, bytes: load_bytes(tally, store.layout()) + own }
    };
    let jobs = (0..store.n_cells()).map(job).collect();
    let soon = |cell: usize| store.expect(CellId::at(cell));
    let Cutting { threads, memory_bytes, .. } = drawing.cutting;
    largest_first(jobs, threads, memory_bytes, drawing.progress, soon, |cell| {
        look(cell, &store.load(CellId::at(cell))?.mesh)
    })
}
