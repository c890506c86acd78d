//! The simplification kernel: mesh in, mesh and statistics out.
//!
//! It knows no files, threads, clock or logging, and its result depends on nothing but its arguments.
//! `simplify_mesh` is the whole interface; the stages call it once per cell and once for the finish.
//!
//! docs/algorithm.md explains the method with its equations. Read `schedule::levels` first, then `drain`, `cost::quadric` and `collapse`.

mod collapse;
mod cost;
mod fit;
mod quality;
#[doc(hidden)]
pub mod reference;
pub(crate) mod repair;
mod schedule;
mod simd;
mod surface;
mod topology;

pub use cost::attributes::MAX_WEIGHTED;
pub use fit::{AUTO_FIT_RATIO, Fit, FitStatistics};
pub use quality::{Quality, QualityAt};
pub use schedule::stepwise::Stepwise;

use crate::mesh::Mesh;
use fit::samples::Samples;
use quality::Probes;

/// More triangles than this cannot be simplified at once: the numbers of triangles, corners and places in rings
/// are 32 bits wide, with one bit of a corner taken, and room for what is added.
pub const MAX_TRIANGLES: u64 = 1 << 29;
/// More vertices cannot be either: two bits of an id in the queue are taken. Cuts and mending add vertices.
pub const MAX_VERTICES: u64 = (1 << 30) - (1 << 24);
const _: () = assert!(usize::BITS == 64, "sizes of meshes are counted in usize");

/// When the kernel stops collapsing.
#[derive(Clone, Debug, PartialEq)]
pub enum Stop {
    /// At most this many triangles, at least two fewer if the topology allows it: cheapest first.
    Triangles(u64),
    /// Ascending cost thresholds, drained one after the other; `Statistics::level_counts` tells how many
    /// triangles were left after each. A run over a prefix of the levels gives the same mesh as a longer
    /// run had at that point. `Stepwise` goes the same way level by level.
    ///
    /// Costs are in units^4 (squared distance times area) and mean the same in every cell.
    Costs(Vec<f64>),
    /// As `Costs`, for thresholds so close together that seeding a queue for each would cost more than the
    /// collapses: one queue over the whole mesh serves them all.
    CloseCosts(Vec<f64>),
}

/// How `simplify_mesh` works; every value is final.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// When to stop.
    pub stop: Stop,
    /// What may happen to the topology.
    pub topology: Topology,
    /// Whether the vertices are moved at the end so that the error falls; only with `Placement::Optimal`.
    pub fit: Fit,
    /// Where the vertex goes that survives a collapse.
    pub placement: Placement,
    /// Boundary vertices of different components that are at most this far apart, in input units, may
    /// become one; 0: none. Under `Topology::Error` only, and only where neither is locked.
    pub merge_distance: f64,
    /// For each channel, how many input units of distance a difference of 1 weighs as much as; 0, or none
    /// given: it rides along. At most `MAX_WEIGHTED` count.
    pub weights: Vec<f32>,
    /// For each channel, whether its values are only ever interpolated along edges: texture coordinates, which
    /// mean nothing outside of their chart. Others may be extrapolated to where the survivor is.
    pub confined: Vec<bool>,
    /// The channel that is the same all over a region of the surface and changes at its border, if there is
    /// one: moving a border costs what moving a boundary of the surface does.
    pub region: Option<usize>,
    /// What moving any other attribute seam costs, as a share of that.
    pub seam_share: f32,
    /// Estimates the quality of the result; its time was not measured.
    pub estimate: bool,
}

/// Where the vertex goes that survives a collapse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placement {
    /// Where the error is least, the enclosed volume preserved.
    #[default]
    Optimal,
    /// To the better one of both ends: every vertex of the result is one of the input, bit for bit.
    Subset,
    /// To the middle of the edge.
    Midpoint,
}

/// What may happen to components, holes and handles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Topology {
    /// Nothing: a target that cannot be met without is not met.
    Keep,
    /// What is smaller than the current error: components vanish (never with a locked vertex, nor where
    /// they are far from larger ones in proportion to the error), holes of three edges close, thin tubes
    /// and handles are cut and capped. First, boundaries whose edges coincide are joined, sheets that only
    /// touch are taken apart, and doubled triangles dropped.
    #[default]
    Error,
}

impl Default for Options {
    /// Collapses nothing; the stages set the stop.
    fn default() -> Self {
        Options {
            stop: Stop::Triangles(u64::MAX),
            topology: Topology::default(),
            fit: Fit::default(),
            placement: Placement::default(),
            merge_distance: 0.0,
            weights: Vec::new(),
            confined: Vec::new(),
            region: None,
            seam_share: 0.0,
            estimate: false,
        }
    }
}

/// What a run of the kernel did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Collapses carried out.
    pub collapses: u64,
    /// Refused collapses by reason, in a fixed order of reasons.
    pub rejects: Vec<(&'static str, u64)>,
    /// What was cleaned, and changes of topology made under `Topology::Error`, by kind, in a fixed order.
    pub changes: Vec<(&'static str, u64)>,
    /// Charts of a texture whose last triangle has gone.
    pub charts_vanished: u64,
    /// Vertices on attribute seams at the end.
    pub seam_vertices: u64,
    /// Triangles left after each cost level of `Stop::Costs`.
    pub level_counts: Vec<u64>,
    /// Whether the stop was reached (false: nothing legal is left to collapse).
    pub reached: bool,
    /// What the fit did, if there was one.
    pub fit: Option<FitStatistics>,
    /// How well the result stands for what was given, where `Options::estimate` asks for it.
    pub quality: Option<Quality>,
    /// The same on the way down to a count, largest first.
    pub curve: Vec<QualityAt>,
}

/// The outcome of `simplify_mesh`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simplified {
    /// The simplified mesh; only referenced vertices, in ascending order of `source`.
    pub mesh: Mesh,
    /// For each vertex of `mesh`, the input vertex that survived as it (`v1` of its collapses).
    /// A locked vertex that the input's triangles use always survives, bit for bit.
    pub source: Vec<u32>,
    /// Counters.
    pub statistics: Statistics,
}

/// Simplifies a mesh by edge collapse; vertices with `locked[v]` stay exactly where they are.
///
/// `locked` has one entry a vertex; all of them `false` if nothing is shared with other cells. Panics above
/// `MAX_TRIANGLES` and `MAX_VERTICES`, and if a corner or a length does not fit the vertices.
pub fn simplify_mesh(mesh: Mesh, locked: &[bool], options: &Options) -> Simplified {
    run(mesh, locked, options, simd::Simd::detect())
}

/// As `simplify_mesh`, without instructions that only some processors have: gives the same result, and is
/// there for tests that hold both against each other.
#[doc(hidden)]
pub fn simplify_mesh_portably(mesh: Mesh, locked: &[bool], options: &Options) -> Simplified {
    run(mesh, locked, options, simd::Simd::Portable)
}

/// Makes a surface of the mesh and mends it.
fn start(
    mesh: Mesh,
    locked: &[bool],
    options: &Options,
    simd: simd::Simd,
) -> schedule::levels::Driver {
    let (n, n_triangles) = (mesh.positions.len(), mesh.triangles.len());
    assert!(n_triangles as u64 <= MAX_TRIANGLES, "{n_triangles} triangles are too many at once");
    assert!(n as u64 <= MAX_VERTICES, "{n} vertices are too many at once");
    assert!(locked.len() == n && mesh.channels.len() == n * mesh.n_channels, "lengths agree");
    let mut surface =
        surface::Surface::new(mesh, locked, (&options.weights, &options.confined), simd);
    surface.placement = options.placement;
    let flat = std::mem::take(&mut surface.flat);
    let cleaned = repair::clean::clean(&mut surface, &flat, simd);
    drop(flat);
    surface::validate::validate(&surface);
    let mut approached = 0;
    if options.merge_distance > 0.0 && options.topology == Topology::Error {
        approached = repair::pair_boundaries::approach(&mut surface, options.merge_distance, simd);
    }
    if options.topology == Topology::Error && !options.confined.contains(&true) {
        repair::weld::lock_coincident(&mut surface);
    } else {
        repair::weld::coincident(&mut surface, options.topology, &options.confined, simd);
    }
    if let Some(wedges) = &mut surface.wedges {
        wedges.region = options.region.filter(|&channel| channel < surface.n_channels);
        wedges.seam_share = f64::from(options.seam_share);
    }
    let mut driver = schedule::levels::Driver::new(surface, simd, options.topology);
    driver.changes.add_cleaned(cleaned, approached);
    if options.estimate {
        driver.probes = Some(Probes::take(&driver.surface));
    }
    driver.mend();
    driver
}

fn run(mesh: Mesh, locked: &[bool], options: &Options, simd: simd::Simd) -> Simplified {
    let mut driver = start(mesh, locked, options, simd);
    let mut statistics = Statistics::default();
    match &options.stop {
        Stop::Triangles(target) => {
            let is_free = options.placement == Placement::Optimal;
            if is_free && options.fit.applies(driver.surface.n_alive, *target) {
                driver.samples = Some(Samples::take(&driver.surface, *target));
            }
            statistics.reached = driver.reach(*target);
            if let Some(samples) = driver.samples.take() {
                statistics.fit = Some(fit::fit(&mut driver.surface, samples, simd));
            }
        }
        Stop::Costs(levels) => {
            for &level in levels {
                driver.level(level);
                statistics.level_counts.push(driver.surface.n_alive);
            }
            statistics.reached = true;
        }
        Stop::CloseCosts(levels) => {
            statistics.level_counts = driver.close_levels(levels);
            statistics.reached = true;
        }
    }
    finish(driver, statistics)
}

/// Sums up what was done and takes the mesh out of the surface.
fn finish(mut driver: schedule::levels::Driver, mut statistics: Statistics) -> Simplified {
    if let Some(mut probes) = driver.probes.take() {
        let removed_error = driver.changes.removed_error;
        statistics.quality = Some(probes.sum_up(&driver.surface, removed_error, 1));
        statistics.curve = std::mem::take(&mut driver.curve);
    }
    statistics.collapses = driver.total_collapses();
    statistics.rejects = driver.rejects.named();
    statistics.changes = driver.changes.named();
    if let Some(wedges) = &driver.surface.wedges {
        statistics.charts_vanished = wedges.n_charts_vanished(&driver.surface.triangles);
        statistics.seam_vertices = wedges.n_seam_vertices(&driver.surface);
    }
    surface::validate::validate(&driver.surface);
    let (mesh, source) = driver.surface.into_mesh();
    Simplified { mesh, source, statistics }
}

/// Peak memory of `simplify_mesh` in bytes, the mesh it is given included.
///
/// Measured: 60 to 63 bytes a triangle beyond the input, 70 on dirty scans (docs/results/kernel.md). What
/// mending adds is up to the caller, who knows the input.
pub fn peak_bytes(n_vertices: u64, n_triangles: u64, n_channels: usize) -> u64 {
    102 * n_triangles + n_vertices * (24 + 8 * n_channels as u64)
}

/// What the fit adds to `peak_bytes`: its samples. The rest of its memory takes the place of what the collapses
/// have freed by then.
pub fn fit_bytes(fit: Fit, n_triangles: u64, target: u64) -> u64 {
    if fit.applies(n_triangles, target) { fit::samples::bytes(n_triangles, target) } else { 0 }
}

/// What weighted channels add to `peak_bytes`.
pub fn attribute_bytes(n_vertices: u64, n_weighted: usize) -> u64 {
    match n_weighted {
        0 => 0,
        n => {
            n_vertices
                * 32
                * cost::attribute_lanes::numbers(n.min(MAX_WEIGHTED)).div_ceil(8).max(2) as u64
        }
    }
}

/// What attribute seams add to `peak_bytes`: a wedge for each corner, values for each vertex.
pub fn wedge_bytes(n_vertices: u64, n_triangles: u64, n_channels: usize) -> u64 {
    12 * n_triangles + n_vertices * (9 + 4 * n_channels as u64)
}

/// Drops vertices that no triangle uses; the second value tells where each kept vertex was.
fn compact(mesh: Mesh) -> (Mesh, Vec<u32>) {
    const UNUSED: u32 = u32::MAX;
    let mut place = vec![UNUSED; mesh.positions.len()];
    for triangle in &mesh.triangles {
        for &v in triangle {
            place[v as usize] = 0;
        }
    }
    let mut source = Vec::new();
    for (v, place) in place.iter_mut().enumerate().filter(|(_, place)| **place != UNUSED) {
        *place = source.len() as u32;
        source.push(v as u32);
    }
    let compacted = Mesh {
        positions: source.iter().map(|&v| mesh.positions[v as usize]).collect(),
        channels: source.iter().flat_map(|&v| mesh.channels_of(v).iter().copied()).collect(),
        n_channels: mesh.n_channels,
        triangles: mesh.triangles.iter().map(|t| t.map(|v| place[v as usize])).collect(),
    };
    (compacted, source)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::vec3;

    /// A bumpy sheet of 2 n^2 triangles.
    pub(super) fn sheet(n: usize) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..=n {
            for j in 0..=n {
                let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
                let z = 0.1 * (9.0 * x).sin() * (7.0 * y).cos() + 0.01 * (61.0 * x * y).sin();
                mesh.positions.push([x + 1e5, y - 3e4, z]);
            }
        }
        let at = |i: usize, j: usize| (i * (n + 1) + j) as u32;
        for i in 0..n {
            for j in 0..n {
                mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        mesh
    }

    #[test]
    fn portable_lanes_give_the_same_bytes() {
        // Large enough for levels of blocks.
        let mesh = sheet(260);
        let locked = vec![false; mesh.positions.len()];
        for target in [60_000, 3_000] {
            let (stop, fit) = (Stop::Triangles(target), Fit::On);
            let options = Options { stop, fit, ..Options::default() };
            let portable = run(mesh.clone(), &locked, &options, simd::Simd::Portable);
            let fastest = run(mesh.clone(), &locked, &options, simd::Simd::detect());
            assert_eq!(portable, fastest);
            assert!(portable.statistics.reached);
        }
    }

    #[test]
    fn a_prefix_of_close_levels_gives_the_same_counts() {
        let mesh = sheet(90);
        let locked = vec![false; mesh.positions.len()];
        let levels: Vec<f64> = (0..20).map(|k| 1e-12 * 1.5f64.powi(k)).collect();
        let counts = |n: usize| {
            let options =
                Options { stop: Stop::CloseCosts(levels[..n].to_vec()), ..Options::default() };
            let result = simplify_mesh(mesh.clone(), &locked, &options);
            let counts = result.statistics.level_counts;
            assert_eq!(counts.last(), Some(&(result.mesh.triangles.len() as u64)));
            counts
        };
        let all = counts(levels.len());
        assert!(all[0] > 3 * all[19] / 2, "the levels do something: {all:?}");
        assert_eq!(counts(7), all[..7]);
    }

    /// A sheet and a tetrahedron, far smaller than the error will be, so high above its middle.
    fn sheet_and_speck(height: f64) -> (Mesh, u32) {
        let mut mesh = sheet(40);
        let first = mesh.positions.len() as u32;
        let [x, y, z] = mesh.positions[20 * 41 + 20];
        let (z, e) = (z + height, 1e-4);
        mesh.positions.extend([[x, y, z], [x + e, y, z], [x, y + e, z], [x, y, z + e]]);
        let corners = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        mesh.triangles.extend(corners.map(|t: [u32; 3]| t.map(|v| v + first)));
        (mesh, first)
    }

    fn specks_left(mesh: Mesh, locked: &[bool], first: u32, options: &Options) -> usize {
        let result = simplify_mesh(mesh, locked, options);
        result.source.iter().filter(|&&v| v >= first).count()
    }

    #[test]
    fn specks_vanish_only_if_asked() {
        let (mesh, first) = sheet_and_speck(1e-3);
        let mut locked = vec![false; mesh.positions.len()];
        for (topology, left) in [(Topology::Keep, 4), (Topology::Error, 0)] {
            let options = Options { stop: Stop::Triangles(300), topology, ..Options::default() };
            assert_eq!(specks_left(mesh.clone(), &locked, first, &options), left);
        }
        locked[first as usize] = true;
        let options = Options { stop: Stop::Triangles(300), ..Options::default() };
        let left = specks_left(mesh, &locked, first, &options);
        assert_eq!(left, 4, "a locked vertex holds it");
    }

    #[test]
    fn specks_far_from_everything_stay_until_the_error_is_as_large() {
        let (mesh, first) = sheet_and_speck(0.2);
        let locked = vec![false; mesh.positions.len()];
        for (target, left) in [(300, 4), (4, 0)] {
            let options = Options { stop: Stop::Triangles(target), ..Options::default() };
            assert_eq!(specks_left(mesh.clone(), &locked, first, &options), left, "{target}");
        }
    }

    #[test]
    fn the_rim_of_a_thin_sheet_does_not_recede() {
        // A pillow: two sheets, next to nothing apart, with a common rim.
        let n = 40;
        let mut mesh = Mesh::default();
        let mut id = std::collections::BTreeMap::new();
        for side in [0usize, 1] {
            let mut vertex = |i: usize, j: usize| {
                let is_rim = i == 0 || j == 0 || i == n || j == n;
                let key = (i, j, if is_rim { 0 } else { side });
                *id.entry(key).or_insert_with(|| {
                    let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
                    let z = 0.05 * (5.0 * x).sin() * (4.0 * y).cos() + 1e-6 * key.2 as f64;
                    mesh.positions.push([x, y, z]);
                    mesh.positions.len() as u32 - 1
                })
            };
            for i in 0..n {
                for j in 0..n {
                    let q =
                        [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                    for t in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
                        mesh.triangles.push(if side == 0 { [t[0], t[2], t[1]] } else { t });
                    }
                }
            }
        }
        let locked = vec![false; mesh.positions.len()];
        let options = Options { stop: Stop::Triangles(300), ..Options::default() };
        let result = simplify_mesh(mesh, &locked, &options).mesh;
        for axis in 0..2 {
            let along = || result.positions.iter().map(|p| p[axis]);
            let (low, high) = (along().fold(1.0, f64::min), along().fold(0.0, f64::max));
            assert!(low.abs() < 0.01 && (high - 1.0).abs() < 0.01, "{low} to {high}");
        }
        // Nearly all of both sheets is left.
        let area = |t: &[u32; 3]| {
            let corners = t.map(|v| result.positions[v as usize]);
            0.5 * vec3::length_sq(vec3::normal(corners)).sqrt()
        };
        let total: f64 = result.triangles.iter().map(area).sum();
        assert!(total > 1.98, "{total}");
    }

    #[test]
    fn charts_that_touch_are_joined_unless_locked() {
        // Each row of quads is a chart of its own, as if split along texture seams.
        let whole = sheet(24);
        let mut split = Mesh::default();
        for row in whole.triangles.chunks(2 * 24) {
            let first = split.positions.len() as u32;
            let lowest = row.iter().flatten().min().copied().unwrap_or(0);
            let n = 2 * 25;
            split.positions.extend_from_slice(&whole.positions[lowest as usize..][..n]);
            split.triangles.extend(row.iter().map(|t| t.map(|v| v - lowest + first)));
        }
        for lock in [false, true] {
            let locked = vec![lock; split.positions.len()];
            let options = Options { stop: Stop::Triangles(2000), ..Options::default() };
            let result = simplify_mesh(split.clone(), &locked, &options);
            let expected = if lock { split.positions.len() } else { whole.positions.len() };
            assert_eq!(result.source.len(), expected);
        }
    }
}
