//! Parts that lie on each other: vertices inside of them are joined as those at borders are.
//!
//! Borders that fit together leave nothing to look for, unless one part covers another. Otherwise vertices at borders lie inside of other parts: if most of
//! them have a copy there, the parts hold the same triangles, and all vertices in common boxes are joined.

use super::neighbours::{INSIDE, Neighbours, Pairs};
use super::splits::ends_of_parts;
use super::survey::Found;
use crate::borders::OpenBorders;
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use crate::ply::{MeshSource, VertexRecords};
use crate::records::NumberRecords;
use std::collections::BTreeSet;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;

/// Vertices at borders without a copy, as a share of all, up to which nothing is looked for, and their number.
const FEW: f64 = 0.01;
const FEWEST: u64 = 8;

/// One part covers another where their boxes have this share of the other's in common on each axis, and may hold its triangles:
/// a file again, or a whole beside its tiles.
const COVERED: f64 = 0.9;
/// The number of joined vertices grows by more than this factor where parts that cover others hold the same triangles.
const MANY_MORE: f64 = 1.1;

/// Relation of the parts of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Overlap {
    None,
    /// They hold the same triangles where they lie on each other.
    Copies,
    /// Vertices at borders lie in other parts' boxes without a copy there.
    Other {
        n_inside: u64,
        n_border: u64,
    },
}

/// Vertices to be joined, and what they say of the parts.
pub(super) struct JoinedPairs {
    /// The records of `Pairs`.
    pub pairs: RawFile,
    pub overlap: Overlap,
    /// Parts of which no vertex is joined.
    pub alone: Vec<usize>,
}

impl Overlap {
    /// Share of the vertices at borders from which on it is worth a line.
    pub const WORTH_A_LINE: f64 = 0.1;
}

/// Finds vertices to be joined, within parts that overlap too.
pub(super) fn pairs(
    source: &MeshSource,
    borders: &OpenBorders,
    found: &Found,
    options: &StageOptions,
) -> Result<JoinedPairs> {
    let boxes = boxes(source, borders, found.distance);
    let pairs = joined(source, borders, found, &[], options)?;
    let Lonely { ids, partners, alone } = lonely(source, borders, (&boxes, &pairs), options)?;
    let (n_inside, n_border) = (ids.len() / 8, borders.n_vertices());
    let is_few = n_inside < FEWEST.max((FEW * n_border as f64) as u64);
    let covering = covering(&boxes);
    if is_few && covering.is_empty() || found.distance <= 0.0 {
        return Ok(JoinedPairs { pairs, overlap: Overlap::None, alone });
    }
    let region = |own: &Bounds| OverlapRegion { free: *own, others: Vec::new() };
    let mut regions: Vec<OverlapRegion> = boxes.iter().map(region).collect();
    for (p, q) in partners.into_iter().chain(covering) {
        regions[p].add(boxes[q]);
        regions[q].add(boxes[p]);
    }
    let wider = joined(source, borders, found, &regions, options)?;
    let (mut ids, mut joined) = (NumberRecords::<1>::new(ids)?, Pairs::new(&wider)?);
    let mut n_found = 0;
    while let (Some([v]), Some([other, ..])) = (ids.next(), joined.next()) {
        n_found += u64::from(v == other);
        if v <= other { ids.pass()? } else { joined.pass()? }
    }
    let is_more = wider.len() as f64 > MANY_MORE * pairs.len() as f64;
    let (pairs, overlap) = match is_more || !is_few && 2 * n_found >= n_inside {
        true => (wider, Overlap::Copies),
        false if is_few => (pairs, Overlap::None),
        false => (pairs, Overlap::Other { n_inside, n_border }),
    };
    Ok(JoinedPairs { pairs, overlap, alone })
}

/// Boxes of the parts where they lie now, wider by the distance.
fn boxes(source: &MeshSource, borders: &OpenBorders, distance: f64) -> Vec<Bounds> {
    let place = |own: &Bounds| {
        let corner = |i: usize| -> Vec3 {
            std::array::from_fn(|axis| [own.low, own.high][i >> axis & 1][axis])
        };
        let corners: Vec<Vec3> = (0..8).map(|i| source.placed_point(corner(i))).collect();
        let mut placed = Bounds::around(&corners);
        placed.low = placed.low.map(|x| x - distance);
        placed.high = placed.high.map(|x| x + distance);
        placed
    };
    borders.boxes.iter().map(place).collect()
}

fn holds(bounds: &Bounds, place: Vec3) -> bool {
    (0..3).all(|axis| (bounds.low[axis]..=bounds.high[axis]).contains(&place[axis]))
}

/// Pairs among vertices at borders and, of each part, those in some regions.
fn joined(
    source: &MeshSource,
    borders: &OpenBorders,
    found: &Found,
    regions: &[OverlapRegion],
    options: &StageOptions,
) -> Result<RawFile> {
    let ends = ends_of_parts(source);
    let sort = options.sort((options.memory_bytes / 3) as usize);
    let mut neighbours =
        Neighbours::new(sort, &found.bounds, found.distance).of_parts(ends.clone());
    let mut next = 0;
    let mut inside = InsideOthers { records: VertexRecords::new(source), regions, ends, part: 0 };
    borders.each_vertex(source, |v, place| {
        inside.push(next..v, &mut neighbours)?;
        next = v + 1;
        neighbours.push(v, place)
    })?;
    inside.push(next..source.n_vertices(), &mut neighbours)?;
    neighbours.pairs(source.path(), options)
}

/// Boxes of other parts, in which vertices of a part are looked for.
struct OverlapRegion {
    /// The room in the part's box that meets none of them within its walls: most vertices lie there.
    free: Bounds,
    others: Vec<Bounds>,
}

impl OverlapRegion {
    fn add(&mut self, other: Bounds) {
        self.others.push(other);
        let Bounds { low, high } = self.free;
        if (0..3).any(|axis| other.high[axis] <= low[axis] || high[axis] <= other.low[axis]) {
            return;
        }
        // Cut off where least is lost, on one of six sides.
        let (mut most, mut free) = (f64::NEG_INFINITY, self.free);
        for axis in 0..3 {
            let (mut below, mut above) = (self.free, self.free);
            (below.high[axis], above.low[axis]) = (other.low[axis], other.high[axis]);
            for side in [below, above] {
                let share = (side.high[axis] - side.low[axis]) / (high[axis] - low[axis]);
                if share > most {
                    (most, free) = (share, side);
                }
            }
        }
        self.free = free;
    }

    fn holds(&self, place: Vec3) -> bool {
        let Bounds { low, high } = &self.free;
        let is_free = (0..3).all(|axis| low[axis] < place[axis] && place[axis] < high[axis]);
        !is_free && self.others.iter().any(|other| holds(other, place))
    }
}

/// Vertices of parts that lie in some regions.
struct InsideOthers<'a> {
    records: VertexRecords<'a>,
    /// Of each part; empty if there are none at all.
    regions: &'a [OverlapRegion],
    ends: Vec<u64>,
    part: usize,
}

impl InsideOthers<'_> {
    /// Pushes those of a range; ranges ascend.
    fn push(&mut self, range: std::ops::Range<u64>, neighbours: &mut Neighbours) -> Result<()> {
        let schema = self.records.source().schema();
        let mut v = range.start;
        while v < range.end && !self.regions.is_empty() {
            while self.ends[self.part] <= v {
                self.part += 1;
            }
            let (region, end) = (&self.regions[self.part], self.ends[self.part]);
            if region.others.is_empty() {
                v = end;
                continue;
            }
            let records = self.records.from(v)?.chunks_exact(schema.record_bytes());
            for record in records.take((end.min(range.end) - v) as usize) {
                let place = schema.position(record);
                if region.holds(place) {
                    neighbours.push(v | INSIDE, place)?;
                }
                v += 1;
            }
        }
        Ok(())
    }
}

/// Vertices at borders without a copy that lie in other parts' boxes: their numbers, and pairs of parts.
struct Lonely {
    ids: RawFile,
    partners: BTreeSet<(usize, usize)>,
    /// Parts that have vertices at borders, none of them with a copy.
    alone: Vec<usize>,
}

fn lonely(
    source: &MeshSource,
    borders: &OpenBorders,
    (boxes, pairs): (&[Bounds], &RawFile),
    options: &StageOptions,
) -> Result<Lonely> {
    let near = neighbours_of(boxes);
    let ends = ends_of_parts(source);
    let mut joined = Pairs::new(pairs)?;
    let (mut ids, mut partners, mut part) = (options.spool(), BTreeSet::new(), 0);
    let (mut has_copies, mut has_border) = (vec![false; boxes.len()], vec![false; boxes.len()]);
    borders.each_vertex(source, |v, place| {
        while joined.next().is_some_and(|[other, ..]| other < v) {
            joined.pass()?;
        }
        while ends[part] <= v {
            part += 1;
        }
        has_border[part] = true;
        if joined.next().is_some_and(|[other, ..]| other == v) {
            has_copies[part] = true;
            return Ok(());
        }
        let mut is_inside = false;
        for &other in near[part].iter().filter(|&&other| holds(&boxes[other], place)) {
            is_inside = true;
            partners.insert((part.min(other), part.max(other)));
        }
        if is_inside { ids.write(&v.to_le_bytes()) } else { Ok(()) }
    })?;
    let alone = (0..boxes.len()).filter(|&i| has_border[i] && !has_copies[i]).collect();
    Ok(Lonely { ids: ids.finish(source.path())?, partners, alone })
}

/// Pairs of boxes of which one covers the other.
fn covering(boxes: &[Bounds]) -> BTreeSet<(usize, usize)> {
    let covers = |a: &Bounds, b: &Bounds| {
        (0..3).all(|axis| {
            let common = a.high[axis].min(b.high[axis]) - a.low[axis].max(b.low[axis]);
            common >= COVERED * (b.high[axis] - b.low[axis])
        })
    };
    let near = neighbours_of(boxes).into_iter().enumerate();
    let all = near.flat_map(|(a, others)| others.into_iter().map(move |b| (a, b)));
    let found = all.filter(|&(a, b)| covers(&boxes[a], &boxes[b]));
    found.map(|(a, b)| (a.min(b), a.max(b))).collect()
}

/// Of each box those that it meets.
fn neighbours_of(boxes: &[Bounds]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by(|&a, &b| boxes[a].low[0].total_cmp(&boxes[b].low[0]));
    let mut out = vec![Vec::new(); boxes.len()];
    for (i, &a) in order.iter().enumerate() {
        for &b in order[i + 1..].iter().take_while(|&&b| boxes[b].low[0] <= boxes[a].high[0]) {
            let meets = |axis: usize| {
                boxes[a].low[axis] <= boxes[b].high[axis]
                    && boxes[b].low[axis] <= boxes[a].high[axis]
            };
            if meets(1) && meets(2) {
                out[a].push(b);
                out[b].push(a);
            }
        }
    }
    out
}
