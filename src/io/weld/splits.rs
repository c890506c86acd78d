//! Finds vertices of one part that lie on border edges of another: T-junctions.
//!
//! Looks at edges that are still open once vertices are joined, and at their ends. Edges go into all cubes of a grid that they
//! pass, vertices into their own.

use crate::borders::OpenBorders;
use crate::external_sort::{halves, whole};
use crate::open_options::StageOptions;
use crate::ply::MeshSource;
use crate::ply::raw::RawFile;
use crate::records::NumberRecords;
use crate::restaged::Numbers;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, scale, sub};
use stonecut_system::error::Result;

/// Cubes that an edge passes at most: the side of a cube is at least this share of the longest edge.
const MOST_CUBES: f64 = 1024.0;

/// An edge that is still open: old ends, new ends, face, positions.
#[derive(Clone, Copy)]
struct Edge {
    old: [u64; 2],
    new: [u64; 2],
    row: u64,
    places: [Vec3; 2],
}

const EDGE_WORDS: usize = 9;

impl Edge {
    fn record(&self) -> [u64; EDGE_WORDS] {
        let [a, b] = self.places.map(|place| place.map(f64::to_bits));
        let pair = |[p, q]: [u64; 2]| p << 32 | q;
        [pair(self.old), pair(self.new), self.row, a[0], a[1], a[2], b[0], b[1], b[2]]
    }

    fn of([old, new, row, a, b, c, d, e, f]: [u64; EDGE_WORDS]) -> Edge {
        let pair = |pair: u64| [pair >> 32, pair & u64::from(u32::MAX)];
        let places = [[a, b, c], [d, e, f]].map(|place| place.map(f64::from_bits));
        Edge { old: pair(old), new: pair(new), row, places }
    }
}

/// A vertex on an edge of a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Ends of the edge and the vertex, by their new numbers.
    pub ends: [u32; 2],
    pub vertex: u32,
    /// Share of the way from the first end to the second.
    pub share: f64,
}

/// NumberRecords of hits, ordered by face: `row`, ends, share, vertex.
pub(super) type Hits = NumberRecords<4>;

impl Hit {
    pub fn of([_, ends, share, vertex]: [u64; 4]) -> Hit {
        let [a, b] = halves(ends);
        Hit { ends: [a, b], vertex: vertex as u32, share: f64::from_bits(share) }
    }
}

/// Finds them.
pub(super) fn find(
    source: &MeshSource,
    borders: &OpenBorders,
    numbers: &mut Numbers,
    distance: f64,
    options: &StageOptions,
) -> Result<Hits> {
    let memory_bytes = (options.memory_bytes / 3) as usize;
    let edges = open_edges(source, borders, numbers, options)?;
    let mut edges = NumberRecords::<EDGE_WORDS>::new(edges)?;
    let (mut bounds, mut sum, mut longest) = (Bounds::EMPTY, 0.0, 0.0f64);
    while let Some(record) = edges.next() {
        let [a, b] = Edge::of(record).places;
        let length = length_sq(sub(b, a)).sqrt();
        (sum, longest) = (sum + length, longest.max(length));
        bounds.add(a);
        bounds.add(b);
        edges.pass()?;
    }
    let n = edges.len();
    let extent = longest_side(&bounds);
    let side = (2.0 * sum / n.max(1) as f64)
        .max(8.0 * distance)
        .max(longest / MOST_CUBES)
        .max(extent / f64::from(1u32 << 30))
        .max(f64::MIN_POSITIVE);
    let cube = |place: Vec3, shift: f64| -> [u32; 3] {
        // A cast saturates: what is below the box is in its first cube.
        std::array::from_fn(|axis| ((place[axis] + shift - bounds.low[axis]) / side) as u32)
    };
    let mut by_cube = options.sort::<5>(memory_bytes);
    edges.restart()?;
    let mut number = 0;
    while let Some(record) = edges.next() {
        let [a, b] = Edge::of(record).places;
        let way = sub(b, a);
        let n_pieces = (length_sq(way).sqrt() / side).ceil().clamp(1.0, 2.0 * MOST_CUBES) as u32;
        let at = |i: u32| add(a, scale(way, f64::from(i) / f64::from(n_pieces)));
        let [n0, n1] = halves(2 * number);
        for i in 0..n_pieces {
            let piece = Bounds::around(&[at(i), at(i + 1)]);
            let (low, high) = (cube(piece.low, -distance), cube(piece.high, distance));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    for z in low[2]..=high[2] {
                        by_cube.push([x, y, z, n0, n1])?;
                    }
                }
            }
        }
        for (end, place) in [a, b].into_iter().enumerate() {
            let [x, y, z] = cube(place, 0.0);
            // Behind all edges of the cube.
            let [n0, n1] = halves(2 * number + end as u64);
            by_cube.push([x, y, z, n0 | 1 << 31, n1])?;
        }
        number += 1;
        edges.pass()?;
    }
    let ends = ends_of_parts(source);
    let part = |v: u64| ends.partition_point(|&end| end <= v);
    let mut hits = options.sort::<8>(memory_bytes);
    let (mut current, mut here) = (None, Vec::<Edge>::new());
    let mut last = None;
    by_cube.drain(|record| {
        let [x, y, z, n0, n1] = record;
        // Edges come once for each of their pieces.
        if last.replace(record) == Some(record) {
            return Ok(());
        }
        if current.replace([x, y, z]) != Some([x, y, z]) {
            here.clear();
        }
        let number = whole(n0 & !(1 << 31), n1);
        let edge = Edge::of(edges.get(number / 2)?);
        if n0 >> 31 == 0 {
            here.push(edge);
            return Ok(());
        }
        let end = (number % 2) as usize;
        let (old, new, place) = (edge.old[end], edge.new[end], edge.places[end]);
        for edge in here.iter().filter(|edge| !edge.new.contains(&new)) {
            let Some(share) = share_of(place, edge.places, distance) else { continue };
            if part(old) == part(edge.old[0]) {
                continue;
            }
            let ([r0, r1], [s0, s1]) = (halves(edge.row), halves(share.to_bits()));
            let [a, b] = edge.new.map(|v| v as u32);
            hits.push([r0, r1, a, b, s0, s1, new as u32, 0])?;
        }
        Ok(())
    })?;
    let mut out = options.spool();
    let mut last = None;
    hits.drain(|hit| {
        if last.replace(hit) == Some(hit) {
            return Ok(());
        }
        let [r0, r1, a, b, s0, s1, vertex, _] = hit;
        let record = [whole(r0, r1), whole(a, b), whole(s0, s1), u64::from(vertex)];
        out.write(bytemuck::bytes_of(&record))
    })?;
    NumberRecords::new(out.finish(source.path())?)
}

/// Numbers of the first vertex behind each part.
pub(super) fn ends_of_parts(source: &MeshSource) -> Vec<u64> {
    let mut end = 0;
    let next = |part: &crate::ply::PartReport| {
        end += part.vertices;
        end
    };
    source.parts().iter().map(next).collect()
}

/// Share of the way along an edge at which a point lies on it, between its ends.
fn share_of(point: Vec3, [a, b]: [Vec3; 2], distance: f64) -> Option<f64> {
    let (way, to) = (sub(b, a), sub(point, a));
    let share = dot(way, to) / dot(way, way);
    let off = length_sq(sub(to, scale(way, share)));
    let is_inside = share > 0.0 && share < 1.0 && off <= distance * distance;
    let is_apart = [a, b].iter().all(|&end| length_sq(sub(point, end)) > distance * distance);
    (is_inside && is_apart).then_some(share)
}

/// Edges that are open once vertices are joined.
fn open_edges(
    source: &MeshSource,
    borders: &OpenBorders,
    numbers: &mut Numbers,
    options: &StageOptions,
) -> Result<RawFile> {
    let mut sort = options.sort::<6>((options.memory_bytes / 3) as usize);
    borders.each_edge(|edge| {
        let [a, b] = [numbers.get(edge.ends[0])?, numbers.get(edge.ends[1])?];
        let [r0, r1] = halves(edge.row);
        let [p, q] = edge.ends.map(|v| v as u32);
        if a == b { Ok(()) } else { sort.push([a.min(b), a.max(b), r0, r1, p, q]) }
    })?;
    let mut places = source.positions()?;
    let mut out = options.spool();
    let mut put = |[_, _, r0, r1, p, q]: [u32; 6]| {
        let old = [u64::from(p), u64::from(q)];
        let edge = Edge {
            old,
            new: [u64::from(numbers.get(old[0])?), u64::from(numbers.get(old[1])?)],
            row: whole(r0, r1),
            places: [
                source.placed_point(places.position(old[0])?),
                source.placed_point(places.position(old[1])?),
            ],
        };
        out.write(bytemuck::bytes_of(&edge.record()))
    };
    let (mut last, mut n) = (None::<[u32; 6]>, 0);
    sort.drain(|record| {
        if last.is_some_and(|last| last[..2] == record[..2]) {
            n += 1;
            return Ok(());
        }
        if let Some(one) = last.replace(record).filter(|_| n % 2 == 1) {
            put(one)?;
        }
        n = 1;
        Ok(())
    })?;
    if let Some(one) = last.filter(|_| n % 2 == 1) {
        put(one)?;
    }
    out.finish(source.path())
}

fn longest_side(bounds: &Bounds) -> f64 {
    sub(bounds.high, bounds.low).into_iter().fold(0.0, f64::max)
}
