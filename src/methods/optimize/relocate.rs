//! Vertices go where the samples around them want them.
//!
//! Vertices of one colour share no edge, so what one of them changes no other sees: a colour is judged in parallel and
//! made at once.

use super::patch::Fan;
use super::surface::{Facing, Surface, turned};
use super::work::Work;
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_blocks;

/// Vertices that go to a thread together.
const BLOCK: usize = 512;

/// Least gain of a move, as a share of the energy around the vertex.
const LEAST_GAIN: f64 = 1e-4;

/// Steps of a vertex in a pass.
const STEPS: u32 = 1;

/// A vertex that moves, with its samples.
struct Moved {
    vertex: u32,
    place: Vec3,
    lying: Vec<(u32, u32, f32)>,
}

/// Moves every vertex that gains by it, once; gives their number.
pub(super) fn all(surface: &mut Surface, work: Work) -> Result<u64> {
    let mut n = 0;
    for colour in colours(surface) {
        let mut moved = Vec::new();
        let means = (work.threads, work.progress);
        in_blocks((colour.len(), BLOCK), means, &mut moved, |some, out| {
            out.extend(colour[some].iter().filter_map(|&v| better(surface, v, work)));
            Ok(())
        })?;
        n += moved.len() as u64;
        for Moved { vertex, place, lying } in moved {
            surface.places[vertex as usize] = place;
            let around = surface.around[vertex as usize].clone();
            surface.take_off(&around);
            for (sample, triangle, distance_sq) in lying {
                surface.put_on(sample, triangle, distance_sq);
            }
        }
    }
    Ok(n)
}

/// Free vertices in sets without an edge between two of one set.
fn colours(surface: &Surface) -> Vec<Vec<u32>> {
    let mut colour = vec![u8::MAX; surface.places.len()];
    let mut out: Vec<Vec<u32>> = Vec::new();
    for v in 0..surface.places.len() as u32 {
        if surface.is_fixed[v as usize] {
            continue;
        }
        let mut taken = [false; u8::MAX as usize];
        for w in surface.neighbours(v) {
            if let Some(taken) = taken.get_mut(colour[w as usize] as usize) {
                *taken = true;
            }
        }
        // A vertex with neighbours of every colour stays; it would need more than 254 of them.
        let Some(free) = taken.iter().position(|&taken| !taken) else { continue };
        colour[v as usize] = free as u8;
        if free == out.len() {
            out.push(Vec::new());
        }
        out[free].push(v);
    }
    out
}

/// A better place for a vertex, if there is one.
fn better(surface: &Surface, v: u32, work: Work) -> Option<Moved> {
    let around = &surface.around[v as usize];
    let (samples, hints) = surface.on(around);
    let distances = surface.energy(&samples);
    if samples.is_empty() || distances <= surface.floor_sq * surface.weight(&samples) {
        return None;
    }
    let points = surface.points(&samples);
    let rims: Vec<[u32; 2]> = around
        .iter()
        .map(|&t| {
            let [_, b, c] = turned(surface.triangles[t as usize], v);
            [b, c]
        })
        .collect();
    let at = |v: u32| surface.places[v as usize];
    let fan = Fan {
        rims: rims.iter().map(|rim| rim.map(at)).collect(),
        ends: rims.iter().map(|rim| at(rim[0])).collect(),
        spring: work.spring,
    };
    let before = at(v);
    let found = fan.place(&points, &hints, before, STEPS);
    let gains = found.energy < (1.0 - LEAST_GAIN) * found.first;
    if !gains {
        return None;
    }
    let facets = fan.facets(found.place);
    let new: Vec<Facing> = rims
        .iter()
        .zip(&facets)
        .map(|(&[b, c], &corners)| Facing { vertices: [v, b, c], corners })
        .collect();
    if !surface.is_sound(&new, around) || !surface.stays_near(&samples, &new, around) {
        return None;
    }
    let lying = samples
        .iter()
        .zip(&found.settled.lying)
        .map(|(&s, lying)| (s, around[lying.facet as usize], lying.distance_sq as f32));
    Some(Moved { vertex: v, place: found.place, lying: lying.collect() })
}
