//! Re-tiling: vertices spread evenly over the surface, joined by nearly equilateral triangles (Turk 1992). In memory.
//!
//! In its modern form (Valette & Chassery 2004): the vertices of the surface, made fine enough, are put into as many clusters as
//! the result is to have vertices, whose borders move until each is compact; each cluster becomes a vertex, and where three
//! meet there is a triangle. Turk moves points apart and triangulates around them; a centroidal Voronoi tessellation
//! spreads them more evenly, and its dual needs no triangulation.

mod clusters;
mod density;
mod dual;
mod needles;
mod place;
mod refine;
mod seeds;
mod shape;

use super::load::{LoadedMesh, load, load_bytes, load_channels, records_of};
use super::{MANIFOLD_TRIANGLE_BYTES, Made, MethodReport, RetilingReport};
use clusters::{CLUSTER_BYTES, Clusters, FURTHER_PASSES, NONE, PASSES, SETTLING_PASSES};
use dual::Dual;
use refine::{Surface, VERTEX_BYTES};
use shape::shapes;
use std::collections::{BTreeSet, HashMap};
use stonecut_io::ply::MeshSource;
use stonecut_mesh::Mesh;
use stonecut_mesh::blend::of_ends;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::outward::closed_volume;
use stonecut_mesh::vec3::{Vec3, length_sq, sub};
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// Longest edge of the surface, in distances of evenly spread vertices of the result.
const LONGEST: f64 = 0.25;
/// The same where sizes differ: the smallest clusters have to be made of enough vertices.
const LONGEST_GRADED: f64 = 0.175;
/// Rounds that mend the surface or the count, at most.
const ROUNDS: usize = 24;
/// Rounds in which clusters may be made two for a surface's sake.
const MENDING_ROUNDS: usize = 20;
/// Mending goes on while a round leaves at most this share of the faults, or where at most one cluster in `FEW` is at
/// fault: on noisy scans, of thin tubes and specks, each one mended makes another.
const LEFT: f64 = 0.8;
const FEW: usize = 25;

/// Settings of a run.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// Triangles wanted, at most.
    pub target: u64,
    /// Power of the curvature by which weights grow; 0 for triangles of one size.
    pub gradation: f64,
    /// Memory for the run, in bytes.
    pub memory_bytes: u64,
    /// The source's `kernel_codec`.
    pub codec: &'a VertexCodec,
}

/// Memory that a run needs in bytes, if the surface is as fine as an even one would be.
pub fn need(source: &MeshSource, codec: &VertexCodec, target: u64, gradation: f64) -> u64 {
    let longest = if gradation > 0.0 { LONGEST_GRADED } else { LONGEST };
    let fine = (target as f64 / (longest * longest)) as u64;
    let per_vertex = VERTEX_BYTES + 4 * codec.n_channels() as u64;
    let mesh = 60 + MANIFOLD_TRIANGLE_BYTES;
    let result =
        target / 2 * (CLUSTER_BYTES + source.schema().record_bytes() as u64) + mesh * target;
    (source.n_vertices().max(fine) * per_vertex + result).max(load_bytes(source))
}

/// Re-tiles a mesh.
///
/// Errors: those of reading; `NoMemory` where long triangles need more vertices than there is memory for; `Usage` for more
/// vertices than can be numbered.
pub fn retile(source: &MeshSource, settings: Settings, progress: &Progress) -> Result<Made> {
    if source.n_vertices().max(source.n_triangles()) > u64::from(u32::MAX) / 6 {
        return Err(Error::Usage(format!(
            "--method retile takes at most {} triangles; take --method collapse first",
            u32::MAX / 6
        )));
    }
    progress.begin("retile", 1, 2, source.n_triangles());
    let LoadedMesh { positions, triangles, faults } = load(source, progress)?;
    let given = Mesh::new(positions, triangles);
    let input_volume = closed_volume(&given);
    let Mesh { positions, triangles, .. } = given;
    let bounds = Bounds::around(&positions);
    bounds
        .hold("--method retile", [1e-100, 1e36])
        .map_err(|what| Error::bad_input(source.path(), what))?;
    let n_given = positions.len();
    let area = Surface::area(&positions, &triangles);
    // Clusters of a closed surface are half as many as triangles, and two more for each sphere.
    let n_clusters = (settings.target / 2 + 2).max(4) as usize;
    // Evenly spread points are the corners of equilateral triangles.
    let spacing = (2.0 * area / (3.0f64.sqrt() * n_clusters as f64)).sqrt();
    let is_graded = settings.gradation > 0.0;
    let longest = spacing * if is_graded { LONGEST_GRADED } else { LONGEST };
    let per_vertex = VERTEX_BYTES + 4 * settings.codec.n_channels() as u64;
    if area <= 0.0 || !area.is_finite() {
        return Ok(Made { faults, bounds, ..Made::default() });
    }
    let mut surface = Surface::refined(
        positions,
        triangles,
        longest,
        (settings.memory_bytes, per_vertex),
        progress,
    )?;
    progress.add(source.n_triangles() / 4);
    let (mut owner, mut n) = seeds::seed(&surface, n_clusters, spacing, None, progress)?;
    if is_graded {
        let mut clusters = Clusters::new(&surface, owner, n);
        clusters.grow();
        clusters.minimise(PASSES, progress)?;
        let (n_even, even) = (clusters.len(), clusters.owner);
        let dual = Dual::new(&surface.triangles, &even);
        let sizes =
            density::grade(&mut surface, &even, n_even, &dual.triangles, settings.gradation);
        (owner, n) = seeds::seed(&surface, n_clusters, spacing, Some(&sizes), progress)?;
    }
    let mut clusters = Clusters::new(&surface, owner, n);
    clusters.grow();
    progress.add(source.n_triangles() / 4);
    let (mut dual, n_mended) = settle(&surface, &mut clusters, settings.target, progress)?;
    progress.add(source.n_triangles() / 4);
    let n_dropped = dual.drop_pillows();
    let mut made = made(source, &surface, n_given, &clusters, &dual, settings.codec, progress)?;
    made.take_apart();
    let (angles, edges) = shapes(&made.mesh);
    (made.faults, made.bounds, made.input_volume) = (faults, bounds, input_volume);
    made.report = MethodReport::Retiling(RetilingReport {
        angles,
        edges,
        surface_vertices: surface.positions.len() as u64,
        passes: clusters.n_passes,
        split_for_topology: n_mended,
        dropped_triangles: n_dropped,
        copied_vertices: made.copied_vertices.unwrap_or(0),
    });
    progress.add(source.n_triangles() - 3 * (source.n_triangles() / 4));
    Ok(made)
}

/// Moves borders until nothing changes; splits clusters whose dual is not a surface, and splits or dissolves as many as the
/// count asks for. Returns the dual, and how many were split for a surface's sake.
fn settle(
    surface: &Surface,
    clusters: &mut Clusters,
    target: u64,
    progress: &Progress,
) -> Result<(Dual, u64)> {
    // Clusters that were made two for a surface's sake, and these are small.
    let mut mended = BTreeSet::new();
    let (mut n_mended, mut n_faulty) = (0, usize::MAX);
    for round in 0.. {
        clusters.minimise(if round == 0 { PASSES } else { FURTHER_PASSES }, progress)?;
        if clusters.connect() > 0 && round < ROUNDS {
            clusters
                .minimise(if round == 0 { FURTHER_PASSES } else { SETTLING_PASSES }, progress)?;
            clusters.connect();
        }
        let dual = Dual::new(&surface.triangles, &clusters.owner);
        let n = dual.triangles.len() as u64;
        if n > target {
            // Each takes two triangles along, as a rule; those without triangles none.
            let most = (n - target).div_ceil(2) as usize * (1 + round.saturating_sub(ROUNDS));
            let mut is_used = vec![false; clusters.len()];
            dual.triangles.iter().flatten().for_each(|&c| is_used[c as usize] = true);
            let mut smallest = first_by(clusters.weights(), most, |c, _| {
                is_used[c as usize] && (round >= ROUNDS || !mended.contains(&c))
            });
            if smallest.is_empty() {
                smallest = first_by(clusters.weights(), most, |c, _| is_used[c as usize]);
            }
            clusters.dissolve(&smallest);
            continue;
        }
        if round >= ROUNDS {
            return Ok((dual, n_mended));
        }
        let are_few = FEW * dual.faulty.len() <= clusters.len();
        let pays = are_few || (dual.faulty.len() as f64) < LEFT * n_faulty as f64;
        if !dual.faulty.is_empty() && round < MENDING_ROUNDS && pays {
            n_faulty = dual.faulty.len();
            let of_split = clusters.split(&dual.faulty);
            n_mended += of_split.len() as u64 / 2;
            let is_split = !of_split.is_empty();
            mended.extend(of_split);
            if is_split {
                continue;
            }
        }
        let n_short = ((target - n) / 2) as usize;
        let negative: Vec<f64> = clusters.energies().iter().map(|energy| -energy).collect();
        let largest = first_by(&negative, n_short, |_, energy| energy < 0.0);
        if clusters.split(&largest).is_empty() {
            return Ok((dual, n_mended));
        }
    }
    unreachable!("the last round returns")
}

/// The numbers of the `n` lowest values of those that count.
fn first_by(values: &[f64], n: usize, counts: impl Fn(u32, f64) -> bool) -> Vec<u32> {
    let mut order: Vec<u32> =
        (0..values.len() as u32).filter(|&i| counts(i, values[i as usize])).collect();
    let value = |i: u32| values[i as usize];
    order.sort_unstable_by(|&i, &j| value(i).total_cmp(&value(j)).then(i.cmp(&j)));
    order.truncate(n);
    order
}

/// Makes the mesh: clusters that triangles use, in the order of their first vertex, with the mean of what their vertices
/// carry and the labels of the one that is nearest.
fn made(
    source: &MeshSource,
    surface: &Surface,
    n_given: usize,
    clusters: &Clusters,
    dual: &Dual,
    codec: &VertexCodec,
    progress: &Progress,
) -> Result<Made> {
    let places = place::place(surface, clusters, &dual.triangles);
    let mut is_used = vec![false; clusters.len()];
    dual.triangles.iter().flatten().for_each(|&c| is_used[c as usize] = true);
    let mut numbers = vec![NONE; clusters.len()];
    let mut positions: Vec<Vec3> = Vec::new();
    for &c in clusters.owner.iter().filter(|c| **c != NONE) {
        if is_used[c as usize] && numbers[c as usize] == NONE {
            numbers[c as usize] = positions.len() as u32;
            positions.push(places[c as usize]);
        }
    }
    let mut triangles: Vec<[u32; 3]> =
        dual.triangles.iter().map(|t| t.map(|c| numbers[c as usize])).collect();
    triangles.sort_unstable_by_key(|t| t.iter().min().copied());
    let mut out = Made { mesh: Mesh::new(positions, triangles), ..Made::default() };
    if source.schema().properties.is_empty() {
        return Ok(out);
    }
    let n_channels = codec.n_channels();
    let mut channels = load_channels(source, codec, progress)?;
    channels.resize(n_channels * surface.positions.len(), 0.0);
    // Middles come after the ends of their edges.
    let mut origin: Vec<u32> = (0..n_given as u32).collect();
    for &[a, b] in &surface.ends {
        let vertex = origin.len();
        origin.push(origin[a as usize]);
        for k in 0..n_channels {
            let of = |v: u32| channels[v as usize * n_channels + k];
            let middle = 0.5 * (of(a) + of(b));
            channels[vertex * n_channels + k] =
                if middle.is_finite() { middle } else { of_ends(of(a), of(b), 0.5) };
        }
    }
    let n_out = out.mesh.positions.len();
    let mut sums = vec![0.0f64; n_channels * n_out];
    let mut weights = vec![0.0f64; n_out];
    // Weights of values that are missing: NaN or infinite.
    let mut missing: HashMap<usize, f64> = HashMap::new();
    let mut nearest = vec![(f64::INFINITY, 0u32); n_out];
    for (v, &cluster) in clusters.owner.iter().enumerate().filter(|(_, c)| **c != NONE) {
        let number = numbers[cluster as usize] as usize;
        let Some(place) = out.mesh.positions.get(number) else { continue };
        let weight = surface.weights[v].max(f64::MIN_POSITIVE);
        weights[number] += weight;
        for k in 0..n_channels {
            let value = f64::from(channels[v * n_channels + k]);
            if value.is_finite() {
                sums[number * n_channels + k] += weight * value;
            } else {
                *missing.entry(number * n_channels + k).or_insert(0.0) += weight;
            }
        }
        let away = length_sq(sub(surface.positions[v], *place));
        if away < nearest[number].0 {
            nearest[number] = (away, origin[v]);
        }
    }
    let mean = |(i, sum): (usize, &f64)| {
        let weight = weights[i / n_channels.max(1)];
        // None at all: NaN.
        let known = missing.get(&i).map_or(weight, |missing| (weight - missing).max(0.0));
        (sum / known) as f32
    };
    out.mesh.n_channels = n_channels;
    out.mesh.channels = sums.iter().enumerate().map(mean).collect();
    let nearest: Vec<u32> = nearest.iter().map(|near| near.1).collect();
    out.records = records_of(source, &nearest, progress)?;
    Ok(out)
}
