//! Edges between two triangles are swapped for the other diagonal.

use super::patch::settle;
use super::surface::{Facing, Surface, turned};
use super::work::Work;
use stonecut_mesh::vec3::{Vec3, length_sq, sub};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_blocks;

/// Edges that go to a thread together.
const BLOCK: usize = 2048;

/// Rounds over all edges at most: a swap takes its neighbours' chance until the next.
const ROUNDS: u32 = 3;

/// Least gain of a swap, as a share of the energy of both triangles.
const LEAST_GAIN: f64 = 0.01;

/// Swaps every edge that gains by it, the largest gains first; gives their number.
pub(super) fn all(surface: &mut Surface, work: Work) -> Result<u64> {
    let mut n = 0;
    for _ in 0..ROUNDS {
        let edges = surface.inner_edges();
        let mut wanted: Vec<(f64, [u32; 2])> = Vec::new();
        let means = (work.threads, work.progress);
        in_blocks((edges.len(), BLOCK), means, &mut wanted, |some, out| {
            let gains = |&edge: &[u32; 2]| Some((gain(surface, edge, work)?, edge));
            out.extend(edges[some].iter().filter_map(gains));
            Ok(())
        })?;
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut is_touched = vec![false; surface.triangles.len()];
        let mut n_round = 0;
        for (_, edge) in wanted {
            let Some(swap) = Swap::of(surface, edge) else { continue };
            if swap.sides.iter().any(|&t| is_touched[t as usize]) || !swap.is_sound(surface) {
                continue;
            }
            swap.make(surface);
            swap.sides.iter().for_each(|&t| is_touched[t as usize] = true);
            n_round += 1;
        }
        n += n_round;
        if n_round * 1000 < surface.triangles.len() as u64 {
            break;
        }
    }
    Ok(n)
}

/// The other diagonal of two triangles.
struct Swap {
    sides: [u32; 2],
    /// Corners of both triangles afterwards.
    corners: [[u32; 3]; 2],
}

impl Swap {
    /// The swap of an edge, if that makes no double edge and no vertex with two triangles.
    fn of(surface: &Surface, [a, b]: [u32; 2]) -> Option<Swap> {
        let sides = surface.sides(a, b)?;
        let c = turned(surface.triangles[sides[0] as usize], a)[2];
        let d = turned(surface.triangles[sides[1] as usize], b)[2];
        let remains = |v: u32| {
            let least = if surface.is_fixed[v as usize] { 3 } else { 4 };
            surface.has_around(v, least)
        };
        let is_legal = c != d && remains(a) && remains(b) && !surface.has_edge(c, d);
        is_legal.then_some(Swap { sides, corners: [[c, a, d], [d, b, c]] })
    }

    fn facets(&self, surface: &Surface) -> [[Vec3; 3]; 2] {
        self.corners.map(|corners| corners.map(|v| surface.places[v as usize]))
    }

    fn is_sound(&self, surface: &Surface) -> bool {
        let facets = self.facets(surface);
        let new = [0, 1].map(|k| Facing { vertices: self.corners[k], corners: facets[k] });
        let (samples, _) = surface.on(&self.sides);
        surface.is_sound(&new, &self.sides) && surface.stays_near(&samples, &new, &self.sides)
    }

    fn make(&self, surface: &mut Surface) {
        let (samples, _) = surface.on(&self.sides);
        let points = surface.points(&samples);
        for (&t, &corners) in self.sides.iter().zip(&self.corners) {
            surface.change(t, corners);
        }
        surface.take_off(&self.sides);
        surface.lay((&samples, &points), &self.sides, &self.corners);
    }
}

/// The gain of a swap, if it has one.
fn gain(surface: &Surface, edge: [u32; 2], work: Work) -> Option<f64> {
    let swap = Swap::of(surface, edge)?;
    let (samples, _) = surface.on(&swap.sides);
    let before = surface.energy(&samples);
    if before <= surface.floor_sq * surface.weight(&samples) {
        return None;
    }
    let after = settle(&surface.points(&samples), &[], &swap.facets(surface)).energy;
    let [[c, _, d], _] = swap.corners;
    let length =
        |[a, b]: [u32; 2]| length_sq(sub(surface.places[a as usize], surface.places[b as usize]));
    let gain = before - after + work.spring * (length(edge) - length([c, d]));
    (gain > LEAST_GAIN * before && gain > 0.0 && swap.is_sound(surface)).then_some(gain)
}
