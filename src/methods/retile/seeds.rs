//! Seeds of clusters, apart from each other along the surface: vertices in a shuffled order, each taken if none is near
//! (Cook 1986), with a distance that shrinks until there are enough.

use super::clusters::NONE;
use super::refine::Surface;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use stonecut_mesh::scatter::mix;
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Distance of the first seeds, in distances of evenly spread points.
const FIRST: f64 = 0.95;
/// Share that is left of the distance with every pass.
const SHRINK: f64 = 0.93;
/// Passes at most.
const PASSES: usize = 60;

/// Gives each vertex to the seed nearest along edges; `NONE` where none is near. Returns the number of seeds, `n` unless the
/// surface has too few vertices.
///
/// `spacing` is the distance of evenly spread points, in input units; `sizes` what it is multiplied by at each vertex, if
/// it differs.
pub(super) fn seed(
    surface: &Surface,
    n: usize,
    spacing: f64,
    sizes: Option<&[f32]>,
    progress: &Progress,
) -> Result<(Vec<u32>, usize)> {
    let n_vertices = surface.positions.len();
    let mut order: Vec<u32> =
        (0..n_vertices as u32).filter(|&v| !surface.neighbours(v).is_empty()).collect();
    order.sort_unstable_by_key(|&v| (shuffled(v), v));
    let size = |v: u32| sizes.map_or(1.0, |sizes| sizes[v as usize]);
    let mut owner = vec![NONE; n_vertices];
    let mut distance = vec![f32::INFINITY; n_vertices];
    let mut queue = BinaryHeap::new();
    let mut n_seeds = 0;
    let mut reach = (FIRST * spacing) as f32;
    for _ in 0..PASSES {
        count(order.len());
        for (i, &vertex) in order.iter().enumerate() {
            if i % 4096 == 0 {
                progress.check()?;
            }
            let limit = reach * size(vertex);
            if distance[vertex as usize] <= limit {
                continue;
            }
            if n_seeds == n {
                return Ok((owner, n_seeds));
            }
            distance[vertex as usize] = 0.0;
            owner[vertex as usize] = n_seeds as u32;
            queue.push(Reverse((0u32, vertex)));
            // The bits of floats that are not negative are in the order of the floats.
            while let Some(Reverse((bits, v))) = queue.pop() {
                let so_far = f32::from_bits(bits);
                if so_far > distance[v as usize] {
                    continue;
                }
                count(surface.neighbours(v).len());
                for &w in surface.neighbours(v) {
                    let edge = sub(surface.positions[w as usize], surface.positions[v as usize]);
                    let farther = so_far + length_sq(edge).sqrt() as f32;
                    if farther < distance[w as usize] && farther <= limit {
                        distance[w as usize] = farther;
                        owner[w as usize] = n_seeds as u32;
                        queue.push(Reverse((farther.to_bits(), w)));
                    }
                }
            }
            n_seeds += 1;
        }
        reach *= SHRINK as f32;
    }
    Ok((owner, n_seeds))
}

/// A number without order, of SplitMix64 (Steele, Lea & Flood 2014).
fn shuffled(vertex: u32) -> u64 {
    mix((u64::from(vertex) + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15))
}
