//! Distance of two surfaces, both ways: the error of a simplification, measured.
//!
//! Points spread evenly over one surface, and all its vertices, look for the exactly nearest point of the
//! other. `two_sided` does so for meshes in memory. Results depend on the two surfaces, the number of
//! samples and the seed alone: not on threads, not on the order of vertices and triangles, not on cells.
//! Changes no mesh and repairs nothing.

// Three axes (and eight lanes) run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

pub mod appearance;
pub mod carried;
mod certificate;
mod certify;
pub mod check;
pub mod colour;
pub mod compare;
mod deviation;
mod enclose;
pub mod heatmap;
pub mod intersections;
pub mod labelled_regions;
pub mod load;
mod nearest_in_cells;
mod out_of_core;
mod parts;
pub mod plan;
pub mod region;
pub mod sample;
pub mod shapes;
mod side;
pub mod solid;
pub mod step;
pub mod sums;
pub mod temp_store;
pub mod tileset;
mod tilted;
pub mod tree;
pub mod triangle;
mod unit;
mod vertex_distances;
pub mod wide;

pub use carried::Carried;
pub use certificate::{Beyond, Certificate, Certify, LEAST_TOLERANCE, On, Verdict};
pub use colour::ColourChannels;
pub use deviation::Deviation;
pub use enclose::{enclose, measured_and_enclosed, within};
pub use out_of_core::{Measured, distances, two_sided_parts};
pub use parts::{Parts, Place};
pub use region::{Region, TriangleSizes};
pub use side::{Side, Spread};
pub use unit::Unit;
pub use vertex_distances::vertex_distances;

use carried::Values;
use sample::{Density, Sample};
use side::SideSums;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;
use stonecut_system::parallel;
use stonecut_system::progress::Progress;
use sums::Sum;
use tree::Tree;
use triangle::Vector;

/// Samples a side by default.
pub const DEFAULT_SAMPLES: u64 = 1_000_000;

/// Samples worked on at a time by one thread: 3 MiB with all that is known of them, and enough to sort them
/// usefully.
const BLOCK_SAMPLES: u64 = 16_384;

/// Most triangles or vertices worked on at a time by one thread.
const BLOCK_ROWS: u64 = 65_536;

/// Queries between two looks at the wish to stop.
const STOP_QUERIES: usize = 256;

/// Options of a measurement; every value is final.
#[derive(Clone, Debug)]
pub struct Options {
    /// Samples on each surface; the true number deviates by less than its square root.
    pub samples: u64,
    /// Chooses among equally good sets of samples.
    pub seed: u64,
    /// Threads to work on; they do not show in the result.
    pub threads: usize,
    /// Channels of colours and the like, if both meshes have some: of the original, of the simplified.
    pub colours: Option<[Carried; 2]>,
    /// Counts the samples within it apart.
    pub region: Option<Region>,
    /// Also enclose the Hausdorff distance; `two_sided` alone does not.
    pub certify: Option<Certify>,
    /// Leaves out, in memory, to count the connectivity and to find surfaces without area.
    pub distances_only: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            samples: DEFAULT_SAMPLES,
            seed: 0,
            threads: stonecut_system::memory::cores(),
            colours: None,
            region: None,
            certify: None,
            distances_only: false,
        }
    }
}

/// Measures the deviation of `simplified` from `original`, both in memory.
///
/// Memory: about 120 bytes a triangle of either mesh (one at a time), 8 bytes a sample.
/// Coordinates of any size are welcome; beyond 1e18 and below 1e-18 they take a copy of both meshes.
/// Fails only if `progress` asks to stop.
pub fn two_sided(
    original: &Mesh,
    simplified: &Mesh,
    options: &Options,
    progress: &Progress,
) -> Result<Deviation> {
    let boxes = [Bounds::of(original), Bounds::of(simplified)];
    let unit = Unit::around(&boxes[0].joined(&boxes[1]));
    if !unit.is_own() {
        let turned = [original, simplified].map(|mesh| {
            let mut mesh = mesh.clone();
            unit.turn(&mut mesh);
            mesh
        });
        let options = Options {
            region: options.region.as_ref().map(|region| region.in_unit(unit)),
            ..options.clone()
        };
        let deviation = two_sided(&turned[0], &turned[1], &options, progress)?;
        return Ok(unit.deviation(deviation));
    }
    measure_in_own_unit(original, simplified, options, progress).map(|(deviation, _)| deviation)
}

/// Measures both ways; also gives back the trees over both meshes where a certificate is to follow.
fn measure_in_own_unit(
    original: &Mesh,
    simplified: &Mesh,
    options: &Options,
    progress: &Progress,
) -> Result<(Deviation, [Option<Tree>; 2])> {
    let boxes = [Bounds::of(original), Bounds::of(simplified)];
    // No two points of the two surfaces are farther apart than the diagonal of the common box.
    let reach = boxes[0].joined(&boxes[1]).diagonal() * (1.0 + 1e-12);
    let colours = options.colours;
    let surfaces = [
        Surface { mesh: original, colour: colours.map(|c| c[0]) },
        Surface { mesh: simplified, colour: colours.map(|c| c[1]) },
    ];
    // Both ways take as many samples, so each is half of the work, which is counted in triangles.
    let scale = (reach, original.triangles.len() as u64);
    let kept = |tree: Tree| options.certify.map(|_| tree);
    let (forward, tree) = one_sided(surfaces[0], surfaces[1], scale, options, progress)?;
    let over_simplified = kept(tree);
    let (backward, tree) = one_sided(surfaces[1], surfaces[0], scale, options, progress)?;
    let deviation = Deviation::new(forward, backward, boxes[0].diagonal());
    Ok((deviation, [kept(tree), over_simplified]))
}

/// A mesh and what is known of its colours and the like.
#[derive(Clone, Copy)]
struct Surface<'a> {
    mesh: &'a Mesh,
    colour: Option<Carried>,
}

impl Surface<'_> {
    /// The area, as a sum that does not depend on the order of the triangles; `diagonal` is that of a box
    /// around the whole surface, of which this may be a part.
    fn area(&self, diagonal: f64) -> Sum {
        let mut area = Sum::new(diagonal * diagonal);
        for i in 0..self.mesh.triangles.len() {
            area.add(triangle::area(&triangle::canonical(self.mesh.corners(i))));
        }
        area
    }

    /// Returns the attributes at a point of a triangle given in canonical order.
    fn values(&self, vertices: [u32; 3], weights: [f64; 3]) -> Values {
        self.colour.map_or(Values::default(), |c| c.at(self.mesh, vertices, weights))
    }

    /// Returns the attributes at the point of `nearest` (the triangle at `slot` of `tree`, over this mesh) next to `point`.
    fn values_next_to(&self, tree: &Tree, slot: u32, point: Vector) -> Values {
        if self.colour.is_none() {
            return Values::default();
        }
        let (_, weights) = triangle::closest(point, tree.corners(slot));
        let (_, vertices) = self.canonical(tree.id(slot) as usize);
        self.values(vertices, weights)
    }

    /// The normal of the surface at one of its samples, and what it carries there.
    fn look(&self, triangle: usize, sample: &Sample) -> (Vector, Values) {
        let (corners, vertices) = self.canonical(triangle);
        let [u, v] = sample.weights.map(f64::from);
        (triangle::area_normal(&corners), self.values(vertices, [1.0 - u - v, u, v]))
    }

    /// Corner positions and corner vertices in canonical order.
    fn canonical(&self, triangle: usize) -> ([Vector; 3], [u32; 3]) {
        let corners = self.mesh.corners(triangle);
        let first = triangle::rotation(&corners);
        let vertices = triangle::rotate(self.mesh.triangles[triangle], first);
        (triangle::rotate(corners, first), vertices)
    }
}

/// Returns for each of two meshes that are compared whether it has triangles, and none of them an area: there is nothing to
/// take a mean over.
///
/// Memory: a copy of both where coordinates are beyond 1e18 or below 1e-18.
pub fn are_flat(meshes: [&Mesh; 2]) -> [bool; 2] {
    let boxes = meshes.map(Bounds::of);
    let unit = Unit::around(&boxes[0].joined(&boxes[1]));
    meshes.map(|mesh| {
        let turned = (!unit.is_own()).then(|| {
            let mut mesh = mesh.clone();
            unit.turn(&mut mesh);
            mesh
        });
        let mesh = turned.as_ref().unwrap_or(mesh);
        let area = Surface { mesh, colour: None }.area(Bounds::of(mesh).diagonal());
        !mesh.triangles.is_empty() && area.value() == 0.0
    })
}

/// One direction under way: everything a block of samples or vertices needs.
struct Direction<'a> {
    source: Surface<'a>,
    target: Surface<'a>,
    tree: &'a Tree,
    density: Density,
    region: Option<&'a Region>,
    reach: f64,
    /// Bits of the largest squared distance so far, of all threads: lets vertices be passed over early.
    worst_sq: &'a AtomicU64,
    progress: &'a Progress,
    /// Work that a sample counts for: units of work, and the number of samples that they are for.
    units: (u64, u64),
}

fn one_sided(
    source: Surface,
    target: Surface,
    (reach, units): (f64, u64),
    options: &Options,
    progress: &Progress,
) -> Result<(Side, Tree)> {
    let n_triangles = source.mesh.triangles.len();
    let corners_of = |i| target.mesh.corners(i);
    let tree = Tree::build_until(target.mesh.triangles.len(), corners_of, progress)?;
    let area = source.area(Bounds::of(source.mesh).diagonal());
    let worst_sq = AtomicU64::new(0);
    let direction = Direction {
        source,
        target,
        tree: &tree,
        density: Density::new(options.samples, area.value(), options.seed),
        region: options.region.as_ref(),
        reach,
        worst_sq: &worst_sq,
        progress,
        units: (units, 2 * options.samples.max(1)),
    };
    let new_sums = || SideSums::new(reach, options.region.is_some());
    let mut sums = new_sums();
    let per_block = n_triangles as u64 * BLOCK_SAMPLES / options.samples.max(1);
    let per_block = per_block.clamp(16, BLOCK_ROWS) as usize;
    let n_blocks = n_triangles.div_ceil(per_block) as u64;
    let mut merge = |_, block: &mut Option<SideSums>| {
        block.iter().for_each(|block| sums.merge(block));
        Ok(())
    };
    let measure = |block, out: &mut Option<SideSums>| {
        let own = out.insert(new_sums());
        direction.measure_samples(rows(block, per_block, n_triangles), own)
    };
    parallel::in_order(n_blocks, options.threads, progress, measure, &mut merge)?;
    let used = used_vertices(source.mesh);
    let per_block = BLOCK_ROWS as usize;
    let n_blocks = used.len().div_ceil(per_block) as u64;
    let measure = |block, out: &mut Option<SideSums>| {
        let own = out.insert(new_sums());
        direction.measure_vertices(&used, rows(block, per_block, used.len()), own)
    };
    parallel::in_order(n_blocks, options.threads, progress, measure, &mut merge)?;
    Ok((sums.finish(tree.is_empty()), tree))
}

fn rows(block: u64, per_block: usize, n: usize) -> Range<usize> {
    let first = block as usize * per_block;
    first..(first + per_block).min(n)
}

fn used_vertices(mesh: &Mesh) -> Vec<bool> {
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    used
}

impl Direction<'_> {
    fn measure_samples(&self, triangles: Range<usize>, sums: &mut SideSums) -> Result<()> {
        let first = triangles.start;
        let corners_of = |i| self.source.canonical(i).0;
        self.density.in_runs(triangles, corners_of, BLOCK_SAMPLES as usize, |samples| {
            sample::sort_along_curve(samples);
            let mut slot = u32::MAX;
            for (i, sample) in samples.iter().enumerate() {
                if i % STOP_QUERIES == 0 {
                    self.progress.check()?;
                }
                let found = self.tree.nearest(sample.point, self.tree.guess(sample.point, slot));
                let near = self.region.map(|region| region.contains(sample.point));
                if !found.is_found() {
                    sums.add_sample(sample.point, 0.0, near);
                    continue;
                }
                slot = found.slot;
                sums.add_sample(sample.point, found.distance_sq, near);
                self.compare(first + sample.triangle as usize, sample, slot, sums);
            }
            self.worst_sq.fetch_max(sums.worst_sq().to_bits(), Ordering::Relaxed);
            let (units, per_samples) = self.units;
            self.progress.add(samples.len() as u64 * units / per_samples);
            Ok(())
        })
    }

    /// Compares normals and colours at a sample and at its nearest point.
    fn compare(&self, from: usize, sample: &Sample, slot: u32, sums: &mut SideSums) {
        let here = self.source.look(from, sample);
        let there = triangle::area_normal(self.tree.corners(slot));
        sums.add_looks(here, (there, self.target.values_next_to(self.tree, slot, sample.point)));
    }

    /// Holds vertices against the maximum. One that is seen to lie closer than the worst point so far is
    /// not looked at further, so most cost one distance to the triangle that the last one found.
    fn measure_vertices(
        &self,
        used: &[bool],
        vertices: Range<usize>,
        sums: &mut SideSums,
    ) -> Result<()> {
        let mut slot = u32::MAX;
        let mut worst_sq = f64::from_bits(self.worst_sq.load(Ordering::Relaxed));
        for v in vertices {
            if v % STOP_QUERIES == 0 {
                self.progress.check()?;
            }
            if !used[v] {
                continue;
            }
            sums.n_vertices += 1;
            let point = self.source.mesh.positions[v];
            // Strictly less is enough to pass over: an equal distance may still have the lesser place.
            let enough_sq = worst_sq.next_down();
            let guess = self.tree.guess(point, slot);
            let found = self.tree.nearest_unless_within(point, guess, enough_sq);
            if !found.is_found() {
                continue;
            }
            slot = found.slot;
            if found.distance_sq >= worst_sq {
                worst_sq = found.distance_sq;
                sums.offer_worst(point, worst_sq);
                self.worst_sq.fetch_max(worst_sq.to_bits(), Ordering::Relaxed);
            }
        }
        debug_assert!(sums.worst_sq().sqrt() <= self.reach);
        Ok(())
    }
}
