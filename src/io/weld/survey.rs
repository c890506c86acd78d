//! Finds out from counts and a sample whether a mesh has copies of vertices within rounding, and how far they are apart.
//!
//! A closed mesh has half as many vertices as triangles; each open edge adds half a vertex. So counts alone acquit nearly
//! every scan. Otherwise one pass takes all vertices of some cells of a fine grid, chosen by hash, and looks for the
//! nearest other vertex of each; of several files, of another file.

use super::splits::ends_of_parts;
use crate::borders::OpenBorders;
use crate::open_edges::open_among;
use crate::open_options::Weld;
use crate::ply::{FaceBlock, MeshSource};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{Vec3, length_sq, sub};
use stonecut_system::error::Result;
use xxhash_rust::xxh3::xxh3_64;

/// From this many vertices a triangle on, triangles hardly have a vertex in common.
const LOOSE: f64 = 1.5;
/// Vertices that open edges explain, as a share of all, below which copies are not looked for.
const FEW_OPEN: f64 = 0.02;
/// Most vertices of a mesh whose triangles are not loose.
const MOST_VERTICES: u64 = 1 << 27;
/// Copies lie within this share of the diagonal: six digits of text, or a float and some arithmetic.
const ROUNDING: f64 = 1e-5;
/// They are this much nearer than the ends of the shorter edges.
const SHARE_OF_EDGE: f64 = 0.05;
/// Distance that was asked for, as a share of the mean edge at most: neighbours on one boundary must not meet.
const ASKED_SHARE_OF_EDGE: f64 = 0.1;
/// The same of borders of parts, whose copies are known to be rounded; a share of the shorter edges.
const PARTS_SHARE_OF_EDGE: f64 = 0.25;
/// Of copies that are rounded to steps at random the farthest are 1.6 times as far apart as 95 % are; files have their own steps
/// besides, as large as their boxes make them.
const PARTS_SPREAD: f64 = 4.0;
/// A vertex that was put on an edge is this many steps of its digits away from it at most, since the ends are rounded, too.
const STEPS_OFF_EDGE: f64 = 2.0;
/// Steps above this share of the shorter edges are those of a lattice.
const STEP_OF_EDGE: f64 = 0.02;
/// Vertices in the sample, about, and in one cell at most.
const SAMPLE: u64 = 1 << 16;
const MOST_IN_CELL: usize = 512;
/// Share of the sample that must have a copy before loose triangles are joined.
const LOOSE_NEAR: f64 = 0.25;
/// Share of loose vertices that must have copies near by only, if most copies are exact: text that was rounded has some
/// percent of them, a scan in which two places are near by chance less than one.
const LOOSE_INEXACT: f64 = 0.02;
/// The same of vertices at open edges. Of a mesh that was written patch by patch nearly all have one. Of a scan some percent do,
/// by chance: joining 3,024 of 390,782 vertices of the Legion of Honor made edges of three triangles and turned senses.
const OPEN_NEAR: f64 = 0.5;
/// Blocks of faces that edges are taken from, and triangles of each.
const EDGE_BLOCKS: u64 = 32;
const EDGE_TRIANGLES: usize = 512;
/// Copies of a place may be farther from each other than each from its nearest.
const SPREAD: f64 = 10.0;

/// Outcome of a survey.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    /// Distance within which vertices are to be joined; 0 for none.
    pub distance: f64,
    /// Distance from an edge of another part within which a vertex splits it.
    pub split_distance: f64,
    /// True if triangles hardly have a vertex in common, so that all edges are open.
    pub is_loose: bool,
    /// True if all copies are exact.
    pub is_exact: bool,
    /// Neighbours beyond rounding.
    pub suggested: Option<Suggested>,
    /// Box of all vertices.
    pub bounds: Bounds,
}

/// A distance that would join what rounding alone does not explain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Suggested {
    /// Distance of neighbours.
    pub distance: f64,
    /// Distance to ask for.
    pub wider: f64,
}

/// Edges of some triangles.
struct EdgeLengths {
    /// A tenth are shorter.
    short: f64,
    middle: f64,
}

/// Looks for copies; `None` where counts or the sample rule them out.
pub(super) fn survey(source: &MeshSource) -> Result<Option<Found>> {
    let (n_vertices, n_triangles) = (source.n_vertices(), source.n_triangles());
    let by_open_edges = n_vertices as f64 - 0.5 * n_triangles as f64;
    let is_loose = n_vertices as f64 >= LOOSE * n_triangles as f64;
    let is_open = by_open_edges >= FEW_OPEN * n_vertices as f64 && n_vertices <= MOST_VERTICES;
    if n_triangles < 2 || !(is_loose || is_open) {
        return Ok(None);
    }
    let Some(edges) = edges(source)? else { return Ok(None) };
    let mut sample = Sample::take(n_vertices, edges.middle, |each| each_position(source, each))?;
    let limit = sample.limit(source, &edges);
    if !is_loose {
        // Copies in exactly one place are the kernel's; what an edge connects is a small triangle.
        if sample.nearest(limit, |_, _| true).last().is_none_or(|&far| far == 0.0) {
            return Ok(None);
        }
        sample.keep(&open_among(source, &sample.ids())?);
    }
    let n = sample.vertices.len();
    let near = sample.nearest(limit, |_, _| true);
    let is_exact = near.last().is_none_or(|&far| far == 0.0);
    let enough = if is_loose { LOOSE_NEAR } else { OPEN_NEAR } * n as f64;
    let found = Found { is_loose, is_exact, bounds: sample.bounds, ..Found::default() };
    if near.is_empty() || (near.len() as f64) < enough || (is_exact && !is_loose) {
        return Ok(is_loose.then(|| Found { suggested: sample.suggest(&edges), ..found }));
    }
    // Where most copies are exact, what lies near besides is another part of the surface.
    let is_mostly_exact = near[near.len() / 2] == 0.0;
    if is_mostly_exact && !is_loose {
        return Ok(None);
    }
    let inexact = &near[near.partition_point(|&distance| distance == 0.0)..];
    let is_some = inexact.len() as f64 >= LOOSE_INEXACT * near.len() as f64;
    let far = match (is_mostly_exact, is_some) {
        (true, false) => 0.0,
        (true, true) => inexact[(inexact.len() - 1) * 99 / 100],
        (false, _) => near[(near.len() - 1) * 99 / 100],
    };
    // What was rounded more coarsely than rounding explains.
    let suggested = if is_exact { sample.suggest(&edges) } else { None };
    let far = far.max(f64::MIN_POSITIVE);
    let step = source.schema().rounding() * largest(&sample.bounds);
    let distance = (SPREAD * far).max(8.0 * step).min(limit);
    // Where only a part of the copies is within what rounding explains, joining that part would tear the surface.
    let is_cut = is_loose && !is_mostly_exact && SPREAD * far > limit;
    let whole = if is_cut { sample.suggest(&edges) } else { None };
    let distance = whole.map_or(distance, |near| distance.max(near.wider));
    Ok(Some(Found { distance, suggested, ..found }))
}

/// Joins within a distance that was given, at most a share of the edges.
pub(super) fn asked(source: &MeshSource, distance: f64) -> Result<Found> {
    let (n_vertices, n_triangles) = (source.n_vertices(), source.n_triangles());
    let mut bounds = Bounds::EMPTY;
    each_position(source, |_, position| bounds.add(position))?;
    let Some(edges) = edges(source)? else { return Ok(Found { bounds, ..Found::default() }) };
    Ok(Found {
        distance: distance.min(ASKED_SHARE_OF_EDGE * edges.middle),
        is_loose: n_vertices as f64 >= LOOSE * n_triangles as f64,
        bounds,
        ..Found::default()
    })
}

/// Distance for the borders of parts: copies in different files are as far apart as their digits or quantisation make them,
/// which a sample of the vertices at open edges shows.
pub(super) fn of_parts(source: &MeshSource, borders: &OpenBorders, how: Weld) -> Result<Found> {
    let mut bounds = Bounds::EMPTY;
    borders.each_vertex(source, |_, position| {
        bounds.add(position);
        Ok(())
    })?;
    let found = Found { bounds, ..Found::default() };
    let Some(edges) = edges(source)? else { return Ok(found) };
    let limit = PARTS_SHARE_OF_EDGE * edges.short;
    let floats = (4.0 * f64::from(f32::EPSILON) * largest(&bounds)).min(limit);
    let distance = match how {
        Weld::Off => 0.0,
        Weld::Distance(distance) => distance.min(ASKED_SHARE_OF_EDGE * edges.middle),
        Weld::Auto => {
            let sample = Sample::take(borders.n_vertices(), edges.middle, |each| {
                borders.each_vertex(source, |v, position| {
                    each(v, position);
                    Ok(())
                })
            })?;
            // Within a file equal places are rounded alike, so that what is near is another place: a second sheet, a slit.
            let ends = ends_of_parts(source);
            let part = |v: u64| ends.partition_point(|&end| end <= v);
            let near = sample.nearest(0.5 * limit, |a, b| part(a) != part(b));
            let far = near.get(near.len() * 98 / 100).copied().unwrap_or(0.0);
            let grain = borders.grain.max(source.schema().rounding() * largest(&bounds));
            let of_type = 4.0 * grain;
            let distance = (PARTS_SPREAD * far).max(of_type).min(limit);
            // A vertex on an edge has been computed, most often as a float, and then rounded, whatever its copies say.
            let step = sample.decimal_step(grain);
            let step = step.filter(|&step| step <= STEP_OF_EDGE * edges.short).unwrap_or(0.0);
            let split_distance = distance.max(floats).max(STEPS_OFF_EDGE * step);
            return Ok(Found { distance, split_distance, ..found });
        }
    };
    Ok(Found { distance, split_distance: distance, ..found })
}

/// Calls `each` with every vertex and its position.
pub(super) fn each_position(source: &MeshSource, mut each: impl FnMut(u64, Vec3)) -> Result<()> {
    source.each_vertex(|vertex, record| {
        each(vertex, source.schema().position(record));
        Ok(())
    })
}

/// Lengths of the edges of triangles here and there; `None` if they have none.
fn edges(source: &MeshSource) -> Result<Option<EdgeLengths>> {
    let n_blocks = source.n_face_blocks();
    let step = n_blocks.div_ceil(EDGE_BLOCKS).max(1);
    let mut block = FaceBlock::default();
    let mut lengths = Vec::new();
    let mut places = source.positions()?;
    for index in (0..n_blocks).step_by(step as usize) {
        source.read_faces(index, &mut block)?;
        for t in block.triangles.iter().take(EDGE_TRIANGLES) {
            let mut corners = [[0.0; 3]; 3];
            for (place, &v) in corners.iter_mut().zip(t) {
                *place = source.placed_point(places.position(v)?);
            }
            let [a, b, c] = corners;
            lengths.extend([sub(b, a), sub(c, b), sub(a, c)].map(|edge| length_sq(edge).sqrt()));
        }
    }
    lengths.retain(|&length| length > 0.0 && length.is_finite());
    lengths.sort_by(f64::total_cmp);
    let n = lengths.len();
    Ok((n > 0).then(|| EdgeLengths { short: lengths[n / 10], middle: lengths[n / 2] }))
}

/// All vertices of some cells of a grid.
struct Sample {
    /// Cell, number and position, sorted.
    vertices: Vec<(u64, u64, Vec3)>,
    bounds: Bounds,
}

impl Sample {
    /// Of `n` vertices that `all` passes to what it is given.
    fn take(
        n: u64,
        edge: f64,
        all: impl FnOnce(&mut dyn FnMut(u64, Vec3)) -> Result<()>,
    ) -> Result<Sample> {
        let one_in = n.div_ceil(SAMPLE).max(1);
        let side = 4.0 * edge;
        let (mut vertices, mut bounds) = (Vec::new(), Bounds::EMPTY);
        all(&mut |v, position| {
            bounds.add(position);
            let cell = position.map(|x| ((x / side).floor() as i64).to_le_bytes());
            let hash = xxh3_64(cell.as_flattened());
            if hash.is_multiple_of(one_in) && vertices.len() < 8 * SAMPLE as usize {
                vertices.push((hash, v, position));
            }
        })?;
        vertices.sort_unstable_by_key(|&(cell, v, _)| (cell, v));
        Ok(Sample { vertices, bounds })
    }

    fn ids(&self) -> Vec<u64> {
        let mut ids: Vec<u64> = self.vertices.iter().map(|&(_, v, _)| v).collect();
        ids.sort_unstable();
        ids
    }

    /// Keeps the vertices with these numbers, which are sorted.
    fn keep(&mut self, ids: &[u64]) {
        self.vertices.retain(|(_, v, _)| ids.binary_search(v).is_ok());
    }

    /// Largest distance that rounding explains.
    fn limit(&self, source: &MeshSource, edges: &EdgeLengths) -> f64 {
        let step = source.schema().rounding() * largest(&self.bounds);
        let diagonal = length_sq(sub(self.bounds.high, self.bounds.low)).sqrt();
        (ROUNDING * diagonal + 8.0 * step).min(SHARE_OF_EDGE * edges.short)
    }

    /// The step of the decimal digits that all coordinates have, of which `grain` is left; `None` if they are others.
    fn decimal_step(&self, grain: f64) -> Option<f64> {
        let is_one = |step: &f64| {
            let off = |x: &f64| (x / step - (x / step).round()).abs() * step;
            self.vertices.iter().flat_map(|(_, _, place)| place).all(|x| off(x) <= 4.0 * grain)
        };
        let steps =
            (0..=9).map(|digits| 10f64.powi(-digits)).take_while(|&step| step > 64.0 * grain);
        if self.vertices.is_empty() { None } else { steps.into_iter().find(is_one) }
    }

    /// Distances of vertices from the nearest one that `counts`, up to `limit`; ascending.
    fn nearest(&self, limit: f64, counts: impl Fn(u64, u64) -> bool) -> Vec<f64> {
        let mut out = Vec::new();
        for cell in self.vertices.chunk_by(|a, b| a.0 == b.0) {
            let cell = &cell[..cell.len().min(MOST_IN_CELL)];
            for (i, a) in cell.iter().enumerate() {
                let others = cell.iter().enumerate().filter(|&(k, b)| k != i && counts(a.1, b.1));
                let nearest =
                    others.map(|(_, b)| length_sq(sub(a.2, b.2))).fold(f64::INFINITY, f64::min);
                if nearest <= limit * limit {
                    out.push(nearest.sqrt());
                }
            }
        }
        out.sort_by(f64::total_cmp);
        out
    }

    /// A distance that would join most of the vertices, far below the length of edges.
    fn suggest(&self, edges: &EdgeLengths) -> Option<Suggested> {
        let limit = 0.5 * ASKED_SHARE_OF_EDGE * edges.short;
        let near = self.nearest(limit, |_, _| true);
        let is_most = 2 * near.len() > self.vertices.len();
        let distance = *near.get(near.len().saturating_sub(1) * 99 / 100)?;
        let wider = (2.5 * distance).min(ASKED_SHARE_OF_EDGE * edges.middle);
        (is_most && distance > 0.0).then_some(Suggested { distance, wider })
    }
}

/// Largest coordinate of a box, by amount.
fn largest(bounds: &Bounds) -> f64 {
    let corners = [bounds.low, bounds.high];
    corners.as_flattened().iter().fold(0.0, |most, x| f64::max(most, x.abs()))
}
