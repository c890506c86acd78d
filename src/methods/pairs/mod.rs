//! Contraction of vertex pairs: edges, and pairs of vertices that are near without an edge (Garland & Heckbert 1997). In memory.
//!
//! The mesh is a set of triangles that may meet in any way. Contracting a pair across a gap makes its two vertices one: components
//! join, tunnels close, cracks heal. Triangles that come to lie on each other's backs go together, so a closed surface
//! stays closed. Edges keep the link condition, since the kernel has prices for handles, tubes and specks. The mesh is taken
//! apart at the end where it is not manifold. Pairs are found again whenever half of the triangles are gone, since gaps are
//! judged by the length of edges.
//!
//! Runs between two collapses (`pipeline/pairs`), so its memory is that of a result, not of an input.

mod contract;
mod near;
mod quadric;

use super::load::{LoadedMesh, load, load_channels, records_of};
use super::surface::Surface;
use super::{MANIFOLD_TRIANGLE_BYTES, Made, MethodReport, PairsReport};
use contract::{Contraction, plan, plan_at_hub};
use quadric::PairQuadric;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::blend::of_ends;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::steps::{HUB, count};
use stonecut_mesh::vec3::{Vec3, add, length_sq, scale, sub};
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// Contractions between two looks at the wish to stop.
const STEPS: u64 = 4096;
/// Pairs are found again at this share of the triangles.
const SHARE: f64 = 0.5;
/// Cost of an edge in a plane, as a share of weight times squared length: short edges first where nothing else counts.
const LENGTH_COST: f64 = 1e-6;
/// The new vertex lies at most this many lengths of the pair from its middle.
const REACH: f64 = 2.0;

/// Memory for each triangle and its half of a vertex, in bytes, without what vertices carry: positions, quadrics, lists, the
/// queue with entries that are out of date, and the search for pairs.
const TRIANGLE_BYTES: u64 = 400;

/// Memory that a run on `n_triangles` needs, in bytes.
pub fn need(n_triangles: u64, codec: &VertexCodec, record_bytes: usize) -> u64 {
    let carried = 4 * codec.n_channels() as u64 + record_bytes as u64;
    n_triangles * (TRIANGLE_BYTES + MANIFOLD_TRIANGLE_BYTES) + n_triangles / 2 * 2 * carried
}

/// Settings of a run.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// Triangles at which to stop.
    pub target: u64,
    /// The source's `kernel_codec`.
    pub codec: &'a VertexCodec,
}

/// Contracts pairs, least error first, until the target is met or no pair may be contracted.
///
/// Errors: those of reading; `Usage` for more triangles than corners can be numbered for.
pub fn contract_pairs(
    source: &MeshSource,
    settings: Settings,
    progress: &Progress,
) -> Result<Made> {
    if source.n_triangles() > Surface::MOST_TRIANGLES || source.n_vertices() > u64::from(u32::MAX) {
        return Err(Error::Usage(format!(
            "--pairs takes at most {} triangles; ask for fewer",
            Surface::MOST_TRIANGLES
        )));
    }
    let LoadedMesh { mut positions, triangles, faults } = load(source, progress)?;
    let bounds = Bounds::around(&positions);
    // Small numbers round less.
    let origin = match bounds.is_empty() {
        true => [0.0; 3],
        false => scale(add(bounds.low, bounds.high), 0.5),
    };
    positions.iter_mut().for_each(|p| *p = sub(*p, origin));
    let mut carried = CarriedChannels::load(source, settings.codec, progress)?;
    let mut run = Run::new(Surface::new(positions, triangles), settings.target);
    run.all(&mut carried, progress)?;
    let mut made = made(source, settings.codec, &run, carried, origin, progress)?;
    made.take_apart();
    (made.faults, made.bounds) = (faults, bounds);
    made.report = MethodReport::Pairs(PairsReport {
        triangles_before: source.n_triangles(),
        triangles_after: made.mesh.triangles.len() as u64,
        copied_vertices: made.copied_vertices.unwrap_or(0),
        ..run.report
    });
    Ok(made)
}

/// The load of the vertices: channels, and the vertex of the source that labels come from.
struct CarriedChannels {
    n_channels: usize,
    channels: Vec<f32>,
    origin: Vec<u32>,
}

impl CarriedChannels {
    fn load(
        source: &MeshSource,
        codec: &VertexCodec,
        progress: &Progress,
    ) -> Result<CarriedChannels> {
        let (n_channels, channels) = match source.schema().properties.is_empty() {
            true => (0, Vec::new()),
            false => (codec.n_channels(), load_channels(source, codec, progress)?),
        };
        let origin = (0..source.n_vertices() as u32).collect();
        Ok(CarriedChannels { n_channels, channels, origin })
    }

    /// Gives `a` what lies at this share of the way from it to `b`.
    fn blend(&mut self, a: u32, b: u32, share: f64) {
        if share > 0.5 {
            self.origin[a as usize] = self.origin[b as usize];
        }
        let [a, b] = [a, b].map(|v| v as usize * self.n_channels);
        for k in 0..self.n_channels {
            let (from, to) = (f64::from(self.channels[a + k]), f64::from(self.channels[b + k]));
            let value = (from + share * (to - from)) as f32;
            self.channels[a + k] = match value.is_finite() {
                true => value,
                false => of_ends(from as f32, to as f32, share as f32),
            };
        }
    }
}

/// A pair in the queue: bits of its cost, its vertices, and how often each had changed by then.
type Entry = Reverse<(u64, [u32; 2], [u32; 2])>;

/// A run: the mesh, and the pairs in the order of their cost.
struct Run {
    surface: Surface,
    target: u64,
    quadrics: Vec<PairQuadric>,
    /// Partners of each vertex without an edge, as they were found; the vertices may have gone into others since.
    partners: Vec<Vec<u32>>,
    /// The vertex that each one went into, or itself.
    into: Vec<u32>,
    changes: Vec<u32>,
    /// Vertices of more than `HUB` triangles. They stay where they are: then a contraction changes few of these.
    is_hub: Vec<bool>,
    queue: BinaryHeap<Entry>,
    report: PairsReport,
}

impl Run {
    fn new(surface: Surface, target: u64) -> Run {
        let n = surface.positions.len();
        Run {
            quadrics: contract::quadrics(&surface),
            surface,
            target,
            partners: vec![Vec::new(); n],
            into: (0..n as u32).collect(),
            changes: vec![0; n],
            is_hub: vec![false; n],
            queue: BinaryHeap::new(),
            report: PairsReport::default(),
        }
    }

    /// Contracts until the target is met, in stretches between which pairs are found again.
    fn all(&mut self, carried: &mut CarriedChannels, progress: &Progress) -> Result<()> {
        let n_given = self.surface.n_alive() as u64;
        progress.begin("pairs", 1, 2, n_given.saturating_sub(self.target));
        while self.surface.n_alive() as u64 > self.target {
            let before = self.surface.n_alive();
            let goal = self.target.max((SHARE * before as f64) as u64);
            self.find(progress)?;
            self.drain(goal, carried, progress)?;
            progress.add((before - self.surface.n_alive()) as u64);
            if self.surface.n_alive() as u64 > goal {
                break;
            }
        }
        Ok(())
    }

    /// Finds all pairs, and puts them and all edges into the queue.
    fn find(&mut self, progress: &Progress) -> Result<()> {
        progress.check()?;
        self.queue.clear();
        self.partners.iter_mut().for_each(Vec::clear);
        let mut n_around = vec![0; self.is_hub.len()];
        self.surface.alive().flatten().for_each(|v| n_around[v as usize] += 1);
        self.is_hub.iter_mut().zip(n_around).for_each(|(is_hub, n)| *is_hub = n > HUB);
        for [a, b] in near::pairs(&self.surface) {
            self.partners[a as usize].push(b);
            self.partners[b as usize].push(a);
            self.report.virtual_pairs += 1;
        }
        let mut edges: Vec<[u32; 2]> = self
            .surface
            .alive()
            .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        for a in 0..self.partners.len() as u32 {
            let higher = self.partners[a as usize].iter().filter(|&&b| b > a);
            edges.extend(higher.map(|&b| [a, b]));
        }
        edges.into_iter().for_each(|pair| self.enqueue(pair));
        Ok(())
    }

    /// The place of the vertex that a pair would become, and the error there.
    fn look(&self, [a, b]: [u32; 2]) -> (Vec3, f64) {
        if self.is_hub[a as usize] || self.is_hub[b as usize] {
            let [hub, other] = self.hub_first([a, b]).map(|v| v as usize);
            let [place, from] = [hub, other].map(|v| self.surface.positions[v]);
            // The error at a hub does not change, so it does not count.
            let quadric = &self.quadrics[other];
            let length_cost = LENGTH_COST * quadric.weight() * length_sq(sub(place, from));
            return (place, quadric.error(place) + length_cost);
        }
        let [p, q] = [a, b].map(|v| self.surface.positions[v as usize]);
        let sum = self.quadrics[a as usize].plus(&self.quadrics[b as usize]);
        let middle = scale(add(p, q), 0.5);
        let length_sq_of_pair = length_sq(sub(p, q));
        let mut place = sum.least(middle);
        if length_sq(sub(place, middle)) > REACH * REACH * length_sq_of_pair {
            place = middle;
        }
        let mut best = (place, sum.error(place));
        for other in [p, q] {
            let error = sum.error(other);
            if error < best.1 {
                best = (other, error);
            }
        }
        (best.0, best.1 + LENGTH_COST * sum.weight() * length_sq_of_pair)
    }

    fn enqueue(&mut self, pair: [u32; 2]) {
        let (_, cost) = self.look(pair);
        self.push(pair, cost);
    }

    fn push(&mut self, pair: [u32; 2], cost: f64) {
        // The bits of floats that are not negative are in the order of the floats.
        let changes = pair.map(|v| self.changes[v as usize]);
        self.queue.push(Reverse((cost.to_bits(), pair, changes)));
    }

    /// Contracts the cheapest pair again and again, until at most `goal` triangles are left or none may be contracted.
    fn drain(
        &mut self,
        goal: u64,
        carried: &mut CarriedChannels,
        progress: &Progress,
    ) -> Result<()> {
        let mut n_steps = 0u64;
        while self.surface.n_alive() as u64 > goal {
            let Some(Reverse((bits, pair, changes))) = self.queue.pop() else { break };
            if pair.map(|v| self.changes[v as usize]) != changes {
                continue;
            }
            n_steps += 1;
            if n_steps.is_multiple_of(STEPS) {
                progress.check()?;
            }
            let (place, cost) = self.look(pair);
            let pair = self.hub_first(pair);
            let planned = match pair.map(|v| self.is_hub[v as usize]) {
                [false, _] => plan(&self.surface, pair, place),
                [true, false] => plan_at_hub(&self.surface, pair, |v| self.is_hub[v as usize]),
                [true, true] => Err(contract::Refusal::Topology),
            };
            let Ok(contraction) = planned else {
                self.report.refused += 1;
                continue;
            };
            let whole = cost + contraction.lost;
            if whole > f64::from_bits(bits) * (1.0 + 1e-9) {
                self.push([pair[0].min(pair[1]), pair[0].max(pair[1])], whole);
                continue;
            }
            self.contract(pair, place, &contraction, carried);
        }
        Ok(())
    }

    /// The vertex that stays first: a hub, or the lower one.
    fn hub_first(&self, [a, b]: [u32; 2]) -> [u32; 2] {
        if self.is_hub[b as usize] && !self.is_hub[a as usize] { [b, a] } else { [a, b] }
    }

    fn contract(
        &mut self,
        [a, b]: [u32; 2],
        place: Vec3,
        contraction: &Contraction,
        carried: &mut CarriedChannels,
    ) {
        let [p, q] = [a, b].map(|v| self.surface.positions[v as usize]);
        let way = sub(q, p);
        let along = stonecut_mesh::vec3::dot(sub(place, p), way) / length_sq(way);
        // Two vertices in one place: what the first one carries.
        carried.blend(a, b, if along.is_finite() { along.clamp(0.0, 1.0) } else { 0.0 });
        if contraction.is_edge {
            self.report.contracted_edges += 1
        } else {
            self.report.contracted_pairs += 1
        }
        self.report.cancelled_triangles += contraction.n_cancelled as u64;
        self.surface.replace(&contraction.hole, &contraction.filling);
        self.surface.positions[a as usize] = place;
        let sum = self.quadrics[a as usize].plus(&self.quadrics[b as usize]);
        self.quadrics[a as usize] = sum;
        self.into[b as usize] = a;
        self.changes[b as usize] += 1;
        if self.is_hub[a as usize] {
            return self.follow_to_hub([a, b], contraction);
        }
        self.changes[a as usize] += 1;
        let of_b = std::mem::take(&mut self.partners[b as usize]);
        self.partners[a as usize].extend(of_b);
        if !self.surface.is_used(a) {
            return;
        }
        let mut ring: Vec<u32> =
            self.surface.around(a).flat_map(|t| self.surface.corners(t)).collect();
        let mut partners = std::mem::take(&mut self.partners[a as usize]);
        partners.iter_mut().for_each(|v| *v = self.followed(*v));
        partners.retain(|&v| self.surface.is_used(v));
        partners.sort_unstable();
        partners.dedup();
        ring.extend(&partners);
        ring.sort_unstable();
        ring.dedup();
        ring.retain(|&v| v != a);
        partners.retain(|&v| v != a);
        self.partners[a as usize] = partners;
        count(ring.len());
        for v in ring {
            self.enqueue([a.min(v), a.max(v)]);
        }
    }

    /// Puts the pairs of a hub into the queue that it has from a vertex that went into it. Its others are what they were.
    fn follow_to_hub(&mut self, [hub, b]: [u32; 2], contraction: &Contraction) {
        let mut new = std::mem::take(&mut self.partners[b as usize]);
        new.iter_mut().for_each(|v| *v = self.followed(*v));
        new.retain(|&v| v != hub && self.surface.is_used(v));
        self.partners[hub as usize].extend(&new);
        new.extend(contraction.filling.as_flattened().iter().filter(|&&v| v != hub));
        new.sort_unstable();
        new.dedup();
        for v in new {
            self.enqueue([hub.min(v), hub.max(v)]);
        }
    }

    /// The vertex that this one is now.
    fn followed(&self, mut vertex: u32) -> u32 {
        while self.into[vertex as usize] != vertex {
            vertex = self.into[vertex as usize];
        }
        vertex
    }
}

/// Copies out what is left: vertices in the order of the source, with the records of those that labels come from.
fn made(
    source: &MeshSource,
    codec: &VertexCodec,
    run: &Run,
    carried: CarriedChannels,
    origin: Vec3,
    progress: &Progress,
) -> Result<Made> {
    let surface = &run.surface;
    let mut numbers = vec![u32::MAX; surface.positions.len()];
    let mut made = Made::default();
    let mut wanted = Vec::new();
    for vertex in (0..surface.positions.len() as u32).filter(|&v| surface.is_used(v)) {
        let v = vertex as usize;
        numbers[v] = made.mesh.positions.len() as u32;
        made.mesh.positions.push(add(surface.positions[v], origin));
        let at = v * carried.n_channels;
        made.mesh.channels.extend_from_slice(&carried.channels[at..at + carried.n_channels]);
        wanted.push(carried.origin[v]);
    }
    made.mesh.triangles = surface.alive().map(|t| t.map(|v| numbers[v as usize])).collect();
    if source.schema().properties.is_empty() {
        return Ok(made);
    }
    made.mesh.n_channels = codec.n_channels();
    made.records = records_of(source, &wanted, progress)?;
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn carried(n: usize) -> CarriedChannels {
        CarriedChannels { n_channels: 0, channels: Vec::new(), origin: (0..n as u32).collect() }
    }

    /// Triangles in any order over few vertices, with doubled ones and edges of many: no vertex is left over, no panic.
    #[test]
    fn any_soup_is_contracted() {
        let mut random = 1u64;
        let mut draw = |n: u64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695);
            (random >> 33) % n
        };
        for round in 0..300 {
            let n = 4 + draw(20);
            let places: Vec<Vec3> = (0..n).map(|_| [0; 3].map(|_| draw(7) as f64)).collect();
            let triangles: Vec<[u32; 3]> = (0..2 + draw(60))
                .map(|_| [0; 3].map(|_| draw(n) as u32))
                .filter(|[a, b, c]| a != b && b != c && c != a)
                .collect();
            let target = draw(triangles.len() as u64 + 1);
            let mut run = Run::new(Surface::new(places, triangles), target);
            run.all(&mut carried(n as usize), &Progress::default()).unwrap();
            let (mut is_used, surface) = (vec![false; n as usize], &run.surface);
            for corners in surface.alive() {
                let [a, b, c] = corners;
                assert!(a != b && b != c && c != a, "soup {round}");
                corners.iter().for_each(|&v| is_used[v as usize] = true);
                let places = corners.map(|v| surface.positions[v as usize]);
                assert!(places.iter().flatten().all(|x| x.is_finite()), "soup {round}");
            }
            for (v, is_used) in (0..).zip(is_used) {
                assert_eq!(surface.is_used(v), is_used, "soup {round}: vertex {v}");
            }
        }
    }

    /// Every edge has as many triangles one way as the other.
    #[test]
    fn a_closed_surface_stays_closed() {
        // Two rough cubes, each face in four by four squares, whose nearest faces fit into each other.
        let mut known = std::collections::BTreeMap::new();
        let mut triangles = Vec::new();
        for (cube, axis, side) in [0, 1].into_iter().flat_map(|cube| {
            (0..3).flat_map(move |axis| [0, 4].into_iter().map(move |side| (cube, axis, side)))
        }) {
            let mut vertex = |u: i32, v: i32| {
                let mut at = [side; 3];
                (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (u, v);
                let number = known.len() as u32;
                *known.entry((cube, at)).or_insert(number)
            };
            for (u, v) in (0..4).flat_map(|u| (0..4).map(move |v| (u, v))) {
                let [a, b, c, d] =
                    [vertex(u, v), vertex(u + 1, v), vertex(u + 1, v + 1), vertex(u, v + 1)];
                let square =
                    if side == 4 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                triangles.extend(square);
            }
        }
        let mut places = vec![[0.0; 3]; known.len()];
        for ((cube, at), number) in known {
            let x = f64::from(at[0] + 4 * cube);
            let [y, z] = [at[1], at[2]].map(f64::from);
            let rough =
                [1.0, 2.0, 3.0].map(|k| 0.4 * (14.9 * k * x + 78.2 * y + 35.3 * z * k).sin());
            places[number as usize] = add([x + 0.02 * f64::from(cube), y, z], rough);
        }
        let n = places.len();
        let mut run = Run::new(Surface::new(places, triangles), 120);
        // Whatever it costs, what is opposite becomes one.
        let mut carried = carried(n);
        for [a, b] in near::pairs(&run.surface) {
            let [p, q] = [a, b].map(|v| run.surface.positions[v as usize]);
            let place = scale(add(p, q), 0.5);
            if length_sq(sub(p, q)) < 0.01
                && let Ok(contraction) = plan(&run.surface, [a, b], place)
            {
                run.contract([a, b], place, &contraction, &mut carried);
            }
        }
        run.all(&mut carried, &Progress::default()).unwrap();
        let mut sides = std::collections::BTreeMap::<[u32; 2], i32>::new();
        for [a, b, c] in run.surface.alive() {
            for [a, b] in [[a, b], [b, c], [c, a]] {
                *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        assert!(!sides.is_empty() && sides.values().all(|&n| n == 0), "{sides:?}");
        let facts = [
            run.report.virtual_pairs,
            run.report.contracted_edges,
            run.report.contracted_pairs,
            run.report.cancelled_triangles,
            run.report.refused,
        ];
        assert!(run.report.contracted_pairs > 0 && run.report.cancelled_triangles > 0, "{facts:?}");
    }
}
