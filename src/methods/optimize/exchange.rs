//! Triangles move from places where they gain little to places where they gain much: an edge collapses, another is split.
//!
//! Each collapse frees a vertex and two triangles, and each split takes what one collapse has freed, so the count stays
//! after every pair.

use super::patch::{Fan, Placed, settle};
use super::surface::{Facing, Surface, turned};
use super::work::Work;
use stonecut_mesh::vec3::{Vec3, add, scale};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;

/// Edges that go to a thread together.
const BLOCK: usize = 1024;

/// A split has to gain this many times what its collapse costs: what is judged by some samples is a little uncertain.
const MARGIN: f64 = 1.2;

/// Steps of the vertex that a collapse or a split leaves.
const STEPS: u32 = 2;

/// A change of the energy by a collapse or a split of the edge from `a` to `b`, and the place of the vertex it leaves.
#[derive(Clone, Copy)]
struct Judged {
    change: f64,
    a: u32,
    b: u32,
    place: Vec3,
}

/// Makes pairs of a split and a collapse as long as they gain; gives their number.
pub(super) fn all(surface: &mut Surface, work: Work) -> Result<u64> {
    let edges = surface.inner_edges();
    let mut collapses = Vec::new();
    let mut splits = Vec::new();
    in_order(
        edges.len().div_ceil(BLOCK) as u64,
        work.threads,
        work.progress,
        |block, (collapses, splits): &mut (Vec<Judged>, Vec<Judged>)| {
            collapses.clear();
            splits.clear();
            let from = block as usize * BLOCK;
            for &edge in &edges[from..edges.len().min(from + BLOCK)] {
                collapses.extend(judge_collapse(surface, edge));
                splits.extend(judge_split(surface, edge));
            }
            Ok(())
        },
        |_, (some_collapses, some_splits)| {
            collapses.append(some_collapses);
            splits.append(some_splits);
            Ok(())
        },
    )?;
    let sort = |list: &mut Vec<Judged>| {
        list.sort_by(|x, y| x.change.total_cmp(&y.change).then((x.a, x.b).cmp(&(y.a, y.b))));
    };
    // The least costs first; of splits, whose changes are gains below 0, the largest gains.
    sort(&mut collapses);
    sort(&mut splits);
    let mut is_touched = vec![false; surface.triangles.len()];
    let mut collapses = collapses.into_iter();
    let mut n = 0;
    'splits: for split in splits {
        let Some(sides) = surface.sides(split.a, split.b) else { continue };
        if touches(&is_touched, &sides) {
            continue;
        }
        let (collapse, patch) = loop {
            let Some(collapse) = collapses.next() else { break 'splits };
            let pays = -split.change > MARGIN * collapse.change;
            if !pays {
                break 'splits;
            }
            let patch = both_stars(surface, collapse.a, collapse.b);
            // A collapse that only lies where the split is does not get another chance in this round.
            let is_free = !touches(&is_touched, &patch) && !patch.iter().any(|t| sides.contains(t));
            if is_free && is_legal(surface, collapse.a, collapse.b) && is_sound(surface, collapse) {
                break (collapse, patch);
            }
        };
        patch.iter().chain(&sides).for_each(|&t| is_touched[t as usize] = true);
        let (vertex, freed) = make_collapse(surface, collapse);
        make_split(surface, split, vertex, freed);
        n += 1;
    }
    Ok(n)
}

fn touches(is_touched: &[bool], triangles: &[u32]) -> bool {
    triangles.iter().any(|&t| is_touched[t as usize])
}

/// Triangles around either end of an edge, in ascending order.
fn both_stars(surface: &Surface, a: u32, b: u32) -> Vec<u32> {
    let mut out = surface.around[a as usize].clone();
    out.extend(&surface.around[b as usize]);
    out.sort_unstable();
    out.dedup();
    out
}

/// True if `a`, which is free, can go into `b`, which is not a hub: the link condition, and no vertex is left with two triangles.
fn is_legal(surface: &Surface, a: u32, b: u32) -> bool {
    if surface.is_hub[b as usize] {
        return false;
    }
    let Some([left, right]) = surface.sides(a, b) else { return false };
    let c = turned(surface.triangles[left as usize], a)[2];
    let d = turned(surface.triangles[right as usize], b)[2];
    let remains = |v: u32| {
        let least = if surface.is_fixed[v as usize] { 2 } else { 4 };
        surface.has_around(v, least)
    };
    let others = surface.neighbours(b);
    let n_common = surface.neighbours(a).iter().filter(|v| others.contains(v)).count();
    !surface.is_fixed[a as usize] && n_common == 2 && c != d && remains(c) && remains(d)
}

/// The triangles that a collapse of `a` into `b` leaves: their numbers and corners, `b` first.
fn left_by(surface: &Surface, a: u32, b: u32) -> (Vec<u32>, Vec<[u32; 3]>) {
    let (mut numbers, mut corners) = (Vec::new(), Vec::new());
    for t in both_stars(surface, a, b) {
        let triangle = surface.triangles[t as usize];
        if triangle.contains(&a) && triangle.contains(&b) {
            continue;
        }
        numbers.push(t);
        corners.push(turned(triangle.map(|v| if v == a { b } else { v }), b));
    }
    (numbers, corners)
}

fn facing(surface: &Surface, corners: &[[u32; 3]], place: Vec3) -> Vec<Facing> {
    let facet = |&vertices: &[u32; 3]| {
        let [_, b, c] = vertices.map(|v| surface.places[v as usize]);
        Facing { vertices, corners: [place, b, c] }
    };
    corners.iter().map(facet).collect()
}

fn is_sound(surface: &Surface, Judged { a, b, place, .. }: Judged) -> bool {
    let (_, corners) = left_by(surface, a, b);
    let new = facing(surface, &corners, place);
    let patch = both_stars(surface, a, b);
    let (samples, _) = surface.on(&patch);
    surface.is_sound(&new, &patch) && surface.stays_near(&samples, &new, &patch)
}

/// The cost of collapsing an edge; the fixed one of its ends stays.
fn judge_collapse(surface: &Surface, [a, b]: [u32; 2]) -> Option<Judged> {
    let (a, b) = if surface.is_fixed[a as usize] { (b, a) } else { (a, b) };
    if !is_legal(surface, a, b) {
        return None;
    }
    let patch = both_stars(surface, a, b);
    let (samples, _) = surface.on(&patch);
    let points = surface.points(&samples);
    let before = surface.energy(&samples);
    let (_, corners) = left_by(surface, a, b);
    let at = |v: u32| surface.places[v as usize];
    let fan = Fan {
        rims: corners.iter().map(|&[_, c, d]| [at(c), at(d)]).collect(),
        ends: Vec::new(),
        spring: 0.0,
    };
    let (place, after) = match surface.is_fixed[b as usize] {
        true => (at(b), settle(&points, &[], &fan.facets(at(b))).energy),
        false => {
            let found = fan.place(&points, &[], scale(add(at(a), at(b)), 0.5), STEPS);
            (found.place, found.energy)
        }
    };
    Some(Judged { change: after - before, a, b, place })
}

/// Takes `a` and both triangles at the edge out of the surface; gives their numbers.
fn make_collapse(surface: &mut Surface, Judged { a, b, place, .. }: Judged) -> (u32, [u32; 2]) {
    let freed = surface.sides(a, b).expect("the edge was found legal just now");
    let patch = both_stars(surface, a, b);
    let (samples, _) = surface.on(&patch);
    let points = surface.points(&samples);
    let (numbers, corners) = left_by(surface, a, b);
    surface.places[b as usize] = place;
    surface.take_off(&patch);
    for t in freed {
        for v in surface.triangles[t as usize] {
            surface.around[v as usize].retain(|&other| other != t);
        }
    }
    for (&t, &corners) in numbers.iter().zip(&corners) {
        if surface.triangles[t as usize].contains(&a) {
            surface.change(t, corners);
        }
    }
    surface.lay((&samples, &points), &numbers, &corners);
    (a, freed)
}

/// The corners of the four triangles of a split edge, those of the new vertex first.
fn split_corners(surface: &Surface, a: u32, b: u32, new: u32) -> Option<([u32; 2], [[u32; 3]; 4])> {
    let sides = surface.sides(a, b)?;
    let c = turned(surface.triangles[sides[0] as usize], a)[2];
    let d = turned(surface.triangles[sides[1] as usize], b)[2];
    Some((sides, [[new, c, a], [new, b, c], [new, d, b], [new, a, d]]))
}

/// The gain of splitting an edge, as a change below 0.
fn judge_split(surface: &Surface, [a, b]: [u32; 2]) -> Option<Judged> {
    // The number of the new vertex is not known yet and stands for nothing but the free corner.
    let (sides, corners) = split_corners(surface, a, b, u32::MAX)?;
    let (samples, _) = surface.on(&sides);
    if samples.is_empty() {
        return None;
    }
    let points = surface.points(&samples);
    let at = |v: u32| surface.places[v as usize];
    let fan = Fan {
        rims: corners.iter().map(|&[_, c, d]| [at(c), at(d)]).collect(),
        ends: Vec::new(),
        spring: 0.0,
    };
    let middle = scale(add(at(a), at(b)), 0.5);
    let Placed { place, energy, .. } = fan.place(&points, &[], middle, STEPS);
    let change = energy - surface.energy(&samples);
    let new: Vec<Facing> = corners
        .iter()
        .zip(fan.facets(place))
        .map(|(&vertices, corners)| Facing { vertices, corners })
        .collect();
    let is_good = change < 0.0
        && surface.is_sound(&new, &sides)
        && surface.stays_near(&samples, &new, &sides);
    is_good.then_some(Judged { change, a, b, place })
}

/// Splits an edge by a vertex and with two triangles that are free.
fn make_split(surface: &mut Surface, split: Judged, vertex: u32, freed: [u32; 2]) {
    let Judged { a, b, place, .. } = split;
    let (sides, corners) =
        split_corners(surface, a, b, vertex).expect("the collapse has touched neither side");
    let (samples, _) = surface.on(&sides);
    let points = surface.points(&samples);
    surface.places[vertex as usize] = place;
    surface.take_off(&sides);
    let numbers = [sides[0], freed[0], sides[1], freed[1]];
    for (&t, &corners) in numbers.iter().zip(&corners) {
        surface.change(t, corners);
    }
    surface.lay((&samples, &points), &numbers, &corners);
}
