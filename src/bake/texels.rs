//! Fills the texels of all charts: points of the result, their places on the original, the colours there.
//!
//! A texel is the mean of a few points spread evenly over it, in linear light, weighted by opacity; points outside of the
//! chart do not count. A chart, or some rows of a large one, is filled as a whole, so a texel is written once, and its
//! colour does not depend on what is worked on together. Charts come in the order of their places in space, so that the
//! original is visited region by region.

use super::directions::{Direction, Frames, mean_directions};
use super::grid::{area, each_cell, each_point, longest};
use super::nearest::{CellCache, Seekers};
use super::original::Hit;
use super::pages::{Canvas, Texel};
use super::same::Own;
use super::settings::NONE;
use super::sheets::{Canvases, Places, mean, plain_pixel};
use super::side::steps_on;
use super::spots::{Point, Scene, find_spots, plain_lights};
use std::ops::Range;
use stonecut_measure::triangle::{self, Vector};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::morton::spread;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_render::texture::{Light, Spot, multiply, pixel_of};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;

/// Bytes of a point under way: the point, its places, and where it is listed.
const POINT_BYTES: u64 = 250;

/// Bytes of a look into an image: a spot, its colour, and a run of one.
const LOOK_BYTES: u64 = 64;

/// Points of a batch where no cell and no image is ever loaded twice.
const SMALL_BATCH: u64 = 1 << 18;

/// Parts of a batch, about: what threads fill is used again for the next part.
const BANDS: u64 = 16;

/// Half of the height in texels below which a triangle gets two points for a side at least: it may lie between others.
const THIN: f64 = 0.75;

/// Points of the side of a square whose points look for places together.
const SQUARE_POINTS: u32 = 8;

/// A place that faces the result may be farther than the nearest one by this share of the triangle's longest edge.
const GRACE: f64 = 0.25;

/// Linear light of a black colour at most.
const BLACK: f32 = 0.004;

/// Findings on the way.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    /// True if any texel lets light through.
    pub has_alpha: bool,
    /// True if any point has a colour that is not black.
    pub has_colour: bool,
    /// For each triangle whether it lets a share of the light through; empty if none does.
    pub blends: Vec<bool>,
    /// Sum of the angles between normal maps and the result, over all texels, in millionths of a degree.
    pub tilt: u128,
    /// Texels of that sum.
    pub n_tilted: u64,
}

impl Seen {
    /// Mean angle between normal maps and the result, in degrees.
    pub fn mean_degrees(&self) -> f64 {
        self.tilt as f64 / 1e6 / self.n_tilted.max(1) as f64
    }
}

/// Rows of a chart that are filled together.
#[derive(Clone, Debug)]
struct Band {
    /// Place of the chart's triangles in `Work::order`.
    triangles: Range<usize>,
    page: u32,
    rows: Range<u32>,
    n_points: u64,
}

/// All charts.
struct Work {
    /// Triangles, chart by chart.
    order: Vec<u32>,
    /// Bands in the order in which they are filled.
    bands: Vec<Band>,
}

/// Memory that every batch uses again: the system takes longer to give it than it takes to fill it.
#[derive(Default)]
struct Buffers {
    points: Vec<Point>,
    hits: Vec<Hit>,
    lights: Vec<Light>,
    spots: Vec<Spot>,
    starts: Vec<u32>,
}

/// Points of several bands.
struct Batch<'a> {
    scene: &'a Scene<'a>,
    /// Texels of the side of a square whose points look for places together.
    square: u32,
    points: Vec<Point>,
}

impl Seekers for Batch<'_> {
    fn n(&self) -> usize {
        self.points.len()
    }

    fn point(&self, i: usize) -> Vector {
        self.points[i].at
    }

    fn square(&self, i: usize) -> u64 {
        let Point { row, column, .. } = self.points[i];
        u64::from(row / self.square) << 32 | u64::from(column / self.square)
    }

    fn normal(&self, i: usize) -> Vector {
        triangle::area_normal(&self.scene.mesh.corners(self.points[i].triangle as usize))
    }

    fn steps(&self, i: usize) -> [Vector; 2] {
        if self.scene.looks == 1 {
            return [[0.0; 3]; 2];
        }
        let t = self.points[i].triangle as usize;
        steps_on(self.scene.mesh, t, self.scene.charts.corners[t])
    }

    fn grace(&self, i: usize) -> f64 {
        let [a, b, c] = self.scene.mesh.corners(self.points[i].triangle as usize);
        let sq = length_sq(sub(b, a)).max(length_sq(sub(c, b))).max(length_sq(sub(a, c)));
        GRACE * sq.sqrt()
    }
}

impl Own for Batch<'_> {
    fn corners(&self, i: usize) -> [Vector; 3] {
        self.scene.mesh.corners(self.points[i].triangle as usize)
    }

    fn weights(&self, i: usize) -> [f64; 3] {
        let [v, w] = self.points[i].weights.map(f64::from);
        [1.0 - v - w, v, w]
    }
}

/// Fills the texels of all charts.
///
/// Memory: cells and images within their budgets, and `batch_bytes` for points, those of a row of the largest page at
/// least.
pub(super) fn fill(scene: &Scene, cells: &mut CellCache, canvases: &mut Canvases) -> Result<Seen> {
    let point_bytes = POINT_BYTES + LOOK_BYTES * u64::from(scene.looks * scene.looks);
    let within = (scene.batch_bytes / point_bytes).max(1);
    // What fits into the caches of the processor is faster, unless cells or images are loaded for each batch.
    let stays = cells.holds_all(scene.original) && scene.images.holds_all();
    let most_points = if stays { within.min(SMALL_BATCH) } else { within };
    let work = Work::new(scene, most_points / BANDS);
    let mut buffers = Buffers::default();
    let mut seen = Seen::default();
    let all_points: u64 = work.bands.iter().map(|band| band.n_points).sum();
    let (mut first, mut points_done, mut counted) = (0, 0, 0);
    while first < work.bands.len() {
        scene.progress.check()?;
        let (mut end, mut n_points) = (first, 0);
        while end < work.bands.len()
            && (end == first || n_points + work.bands[end].n_points <= most_points)
        {
            n_points += work.bands[end].n_points;
            end += 1;
        }
        let bands = &work.bands[first..end];
        work.fill_bands(scene, bands, (cells, canvases), &mut buffers, &mut seen)?;
        first = end;
        points_done += n_points;
        let share = points_done as f64 / all_points.max(1) as f64;
        let done = (share * scene.counted as f64) as u64;
        scene.progress.add(done - counted);
        counted = done;
    }
    Ok(seen)
}

impl Work {
    fn new(scene: &Scene, most_points: u64) -> Work {
        let charts = scene.charts;
        // Triangles at an edge have a point each in its texels.
        let per_texel = f64::from(scene.side * scene.side * scene.looks);
        let mut order: Vec<u32> =
            (0..charts.chart.len() as u32).filter(|&t| charts.chart[t as usize] != NONE).collect();
        order.sort_by_key(|&t| (charts.chart[t as usize], t));
        let mut around = Bounds::EMPTY;
        scene.mesh.positions.iter().for_each(|&p| around.add(p));
        let scale = 1023.0 / around.side();
        let mut placed = Vec::new();
        let chart_of = |at: usize| order.get(at).map(|&t| charts.chart[t as usize]);
        let mut start = 0;
        while start < order.len() {
            let mut end = start;
            while end < order.len() && chart_of(end) == chart_of(start) {
                end += 1;
            }
            let (mut own, mut texels, mut rows) = (Bounds::EMPTY, 0.0, [f32::MAX, 0f32]);
            for &t in &order[start..end] {
                let t = t as usize;
                scene.mesh.corners(t).iter().for_each(|&corner| own.add(corner));
                texels += area(&charts.corners[t]);
                for [_, y] in charts.corners[t] {
                    rows = [rows[0].min(y), rows[1].max(y)];
                }
            }
            let middle = own.middle();
            let cell =
                [0, 1, 2].map(|k| spread(((middle[k] - around.low[k]) * scale).max(0.0) as u32));
            let key = cell[0] << 2 | cell[1] << 1 | cell[2];
            let page = charts.page[order[start] as usize];
            let height = charts.pages[page as usize][1];
            let rows =
                (rows[0].max(0.0) as u32).min(height)..(rows[1].ceil() as u32 + 1).min(height);
            let n_points = (texels * per_texel) as u64 + 4 * (end - start) as u64;
            let n_bands = n_points.div_ceil(most_points.max(1)).clamp(1, rows.len().max(1) as u64);
            let step = (rows.len() as u64).div_ceil(n_bands).max(1) as usize;
            for first in rows.clone().step_by(step) {
                let rows = first..(first + step as u32).min(rows.end);
                let n_points = n_points / n_bands + 1;
                placed.push((
                    key,
                    placed.len(),
                    Band { triangles: start..end, page, rows, n_points },
                ));
            }
            start = end;
        }
        placed.sort_by_key(|&(key, number, _)| (key, number));
        Work { order, bands: placed.into_iter().map(|(_, _, band)| band).collect() }
    }

    fn fill_bands(
        &self,
        scene: &Scene,
        bands: &[Band],
        (cells, canvases): (&mut CellCache, &mut Canvases),
        buffers: &mut Buffers,
        seen: &mut Seen,
    ) -> Result<()> {
        let square = (SQUARE_POINTS / scene.side).max(1);
        buffers.points.clear();
        let points = std::mem::take(&mut buffers.points);
        let mut batch = Batch { scene, square, points };
        let mut ends = Vec::new();
        in_order(
            bands.len() as u64,
            scene.threads,
            scene.progress,
            |i, points: &mut Vec<Point>| {
                points.clear();
                self.points(scene, &bands[i as usize], points);
                Ok(())
            },
            |_, points| {
                batch.points.append(points);
                ends.push(batch.points.len());
                Ok(())
            },
        )?;
        let mut patches = Vec::new();
        for own in batch.points.chunk_by(|a, b| a.triangle == b.triangle) {
            let start = patches.last().map_or(0, |patch: &Range<usize>| patch.end);
            patches.push(start..start + own.len());
        }
        let means = (scene.threads, scene.progress);
        let hits = &mut buffers.hits;
        hits.clear();
        hits.resize(batch.n(), Hit::NONE);
        if let Some(within) = scene.same_within {
            patches = scene.original.same((&batch, within), &patches, cells, means, hits)?;
        }
        scene.original.nearest_by_patches(&batch, &patches, cells, means, hits)?;
        let from = |i: usize| if i == 0 { 0 } else { ends[i - 1] };
        let (spots, starts) = (&mut buffers.spots, &mut buffers.starts);
        find_spots(scene, (&batch.points, hits), (spots, starts));
        if let Some(canvas) = &mut canvases.normals {
            places(scene, &buffers.spots).bend(hits)?;
            let (mesh, normals) = (scene.mesh, scene.normals);
            let frames = Frames { mesh, normals, tangents: &scene.charts.tangents };
            let direction = |i: usize| {
                let Point { triangle, weights, .. } = batch.points[i];
                frames.direction(triangle, weights, &hits[i])
            };
            in_order(
                bands.len() as u64,
                scene.threads,
                scene.progress,
                |i, (texels, tilts): &mut (Vec<Texel>, Vec<u32>)| {
                    let i = i as usize;
                    let own = from(i)..ends[i];
                    let found: Vec<Direction> = own.clone().map(direction).collect();
                    tilts.clear();
                    of_texels(&batch.points[own], texels, |same| {
                        let (pixel, tilt) =
                            mean_directions(same.iter().map(|&i| found[i as usize]));
                        tilts.push(tilt);
                        pixel
                    });
                    Ok(())
                },
                |i, (texels, tilts)| {
                    seen.tilt += tilts.iter().map(|&tilt| u128::from(tilt)).sum::<u128>();
                    seen.n_tilted += tilts.len() as u64;
                    canvas.put(bands[i as usize].page, texels)
                },
            )?;
        }
        buffers.points = batch.points;
        let Buffers { points, hits, lights, spots, starts } = buffers;
        let filled = Filled { scene, bands, ends: &ends, points, starts };
        if let Some(canvas) = &mut canvases.emission {
            places(scene, spots).emission(lights)?;
            filled.put(lights, canvas, pixel_of)?;
        }
        if let Some(canvas) = &mut canvases.surface {
            places(scene, spots).surface(lights)?;
            filled.put(lights, canvas, plain_pixel)?;
        }
        let Some(canvas) = &mut canvases.colours else { return Ok(()) };
        plain_lights(scene, (hits, starts), lights);
        let looks = (scene.palette, scene.images);
        multiply(lights, spots, looks, scene.threads, scene.progress)?;
        seen.has_colour |= lights.iter().any(|light| light[..3].iter().any(|x| *x > BLACK));
        if filled.put(lights, canvas, pixel_of)? {
            seen.has_alpha = true;
            filled.mark((lights, spots), &mut seen.blends);
        }
        Ok(())
    }

    /// Points of the texels of a band. A triangle that lies between all points has one in its middle.
    fn points(&self, scene: &Scene, band: &Band, out: &mut Vec<Point>) {
        let width = scene.charts.pages[band.page as usize][0];
        for &t in &self.order[band.triangles.clone()] {
            let flat = scene.charts.corners[t as usize].map(|at| at.map(f64::from));
            let corners = scene.mesh.corners(t as usize);
            let has_quarters = scene.looks > 1;
            let own = out.len();
            // Points of the upper half of a row of texels, the next of them, and the beginning and place of this half.
            let (mut upper, mut next, mut half, mut last) = (own..own, own, own, f64::NAN);
            let mut put = |x: f64, y: f64, weights: [f64; 3]| {
                let (row, column) = (y as u32, (x.max(0.0) as u32).min(width - 1));
                if !band.rows.contains(&row) {
                    return;
                }
                let at = triangle::point_at(&corners, weights);
                let weights = [weights[1] as f32, weights[2] as f32];
                let mut point = Point { at, weights, triangle: t, looks: 0, row, column };
                if !has_quarters {
                    out.push(point);
                    return;
                }
                if y != last {
                    let is_lower = out.get(half).is_some_and(|point| point.row == row);
                    upper = if is_lower { half..out.len() } else { out.len()..out.len() };
                    (next, half, last) = (upper.start, out.len(), y);
                }
                while next < upper.end && out[next].column < column {
                    next += 1;
                }
                let at_left = if half < out.len() { out.len() - 1 } else { upper.end };
                let other =
                    if next < upper.end && out[next].column == column { next } else { at_left };
                point.looks = 1 << (2 * u8::from(y.fract() > 0.5) + u8::from(x.fract() > 0.5));
                match out.get_mut(other).filter(|other| [other.row, other.column] == [row, column])
                {
                    Some(other) => {
                        other.looks |= point.looks;
                        (0..3).for_each(|k| other.at[k] += at[k]);
                    }
                    None => out.push(point),
                }
            };
            let mut n = 0;
            let area = area(&scene.charts.corners[t as usize]);
            let is_small = area < 2.0;
            let side = scene.side * scene.looks;
            let side = if area < THIN * longest(&flat) { side.max(2) } else { side };
            // Small ones are looked at as a whole, so that the count does not depend on the rows.
            let rows = if is_small { 0..u32::MAX } else { band.rows.clone() };
            each_point(&flat, side, rows, |x, y, weights| {
                n += 1;
                put(x, y, weights);
            });
            if n == 0 && is_small {
                let third = 1.0 / 3.0;
                let middle = [0, 1].map(|k| third * (flat[0][k] + flat[1][k] + flat[2][k]));
                put(middle[0], middle[1], [third; 3]);
            }
            for point in &mut out[own..] {
                let n = f64::from(point.looks.count_ones().max(1));
                point.at = point.at.map(|x| x / n);
            }
        }
    }
}

/// Points of a batch whose values are known.
struct Filled<'a> {
    scene: &'a Scene<'a>,
    bands: &'a [Band],
    /// Ends of the bands' points.
    ends: &'a [usize],
    points: &'a [Point],
    /// The first of the values of each point, and their number.
    starts: &'a [u32],
}

impl Filled<'_> {
    /// Puts the texels of all points on pages; `pixel` gets the mean of the points of one. Returns if any lets light through.
    fn put(
        &self,
        values: &[Light],
        canvas: &mut Canvas,
        pixel: impl Fn(Light) -> [u8; 4] + Sync,
    ) -> Result<bool> {
        let mut has_alpha = false;
        in_order(
            self.bands.len() as u64,
            self.scene.threads,
            self.scene.progress,
            |i, texels: &mut Vec<Texel>| {
                let i = i as usize;
                let own = if i == 0 { 0 } else { self.ends[i - 1] }..self.ends[i];
                let starts = &self.starts[own.start..=own.end];
                let of = |i: u32| {
                    let range = starts[i as usize]..starts[i as usize + 1];
                    &values[range.start as usize..range.end as usize]
                };
                of_texels(&self.points[own], texels, |same| {
                    let own = match same {
                        // Nearly all, where a page is as dense as the images.
                        &[i] if of(i).len() == 1 => of(i)[0],
                        _ => mean(same.iter().flat_map(|&i| of(i)).copied()),
                    };
                    pixel(own)
                });
                Ok(())
            },
            |i, texels| {
                has_alpha |= texels.iter().any(|texel| texel.pixel[3] < 255);
                canvas.put(self.bands[i as usize].page, texels)
            },
        )?;
        Ok(has_alpha)
    }
}

impl Filled<'_> {
    /// Marks triangles of which a point lets a share of the light through.
    fn mark(&self, (lights, spots): (&[Light], &[Spot]), blends: &mut Vec<bool>) {
        let is_clear = |&i: &usize| {
            pixel_of(lights[i])[3] < 255 && self.scene.palette.blends(spots[i].material)
        };
        for (point, range) in self.points.iter().zip(self.starts.windows(2)) {
            if (range[0] as usize..range[1] as usize).any(|i| is_clear(&i)) {
                blends.resize(self.scene.mesh.triangles.len(), false);
                blends[point.triangle as usize] = true;
            }
        }
    }
}

/// Spots for pages besides colours.
fn places<'a>(scene: &'a Scene, spots: &'a [Spot]) -> Places<'a> {
    let Scene { palette, images, threads, progress, .. } = *scene;
    Places { spots, palette, images, threads, progress }
}

/// Makes the texels that points lie in; `pixel` gets the numbers of the points of each.
fn of_texels(points: &[Point], out: &mut Vec<Texel>, mut pixel: impl FnMut(&[u32]) -> [u8; 4]) {
    out.clear();
    let cell = |i: usize| [points[i].row, points[i].column];
    each_cell(points.len(), cell, |[row, column], same| {
        out.push(Texel { row, column, pixel: pixel(same) });
    });
}
