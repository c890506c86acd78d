//! Smaller triangles where the surface is bent.

use super::clusters::NONE;
use super::refine::Surface;
use stonecut_mesh::vec3::{add, length_sq, normal, scale};

/// Smallest and largest size of a cluster, before they are made to fit the count.
const SIZES: [f32; 2] = [0.4, 2.5];
/// Times that curvatures are averaged with those of the neighbours.
const SMOOTHINGS: usize = 2;

/// For each vertex the distance of seeds relative to the mean; multiplies the weights of the surface accordingly.
///
/// A cluster's curvature is the spread of the normals in it, over its diameter. Weights are the power `gradation` of it
/// (Valette & Chassery 2004), with which the distance of seeds falls like its quarter. Vertices of no cluster have the mean.
pub(super) fn grade(
    surface: &mut Surface,
    owner: &[u32],
    n: usize,
    dual: &[[u32; 3]],
    gradation: f64,
) -> Vec<f32> {
    let (mut area, mut sum) = (vec![0.0; n], vec![[0.0; 3]; n]);
    for t in &surface.triangles {
        let weighted = scale(normal(t.map(|v| surface.positions[v as usize])), 1.0 / 6.0);
        for c in t.map(|v| owner[v as usize]).into_iter().filter(|c| *c != NONE) {
            area[c as usize] += length_sq(weighted).sqrt();
            sum[c as usize] = add(sum[c as usize], weighted);
        }
    }
    let curvature = |c: usize| {
        let spread = 1.0 - length_sq(sum[c]).sqrt() / f64::max(area[c], f64::MIN_POSITIVE);
        (spread.max(0.0) / f64::max(area[c], f64::MIN_POSITIVE)).sqrt()
    };
    let mut curvatures: Vec<f64> = (0..n).map(curvature).collect();
    for _ in 0..SMOOTHINGS {
        let mut sums: Vec<(f64, f64)> = curvatures.iter().map(|x| (*x, 1.0)).collect();
        for t in dual {
            for k in 0..3 {
                let other = curvatures[t[(k + 1) % 3] as usize];
                let sum = &mut sums[t[k] as usize];
                *sum = (sum.0 + other, sum.1 + 1.0);
            }
        }
        curvatures = sums.into_iter().map(|(sum, n)| sum / n).collect();
    }
    let mut sorted: Vec<f64> =
        curvatures.iter().zip(&area).filter(|(_, a)| **a > 0.0).map(|(x, _)| *x).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let size = |x: &f64| match median > 0.0 {
        true => ((x / median).max(1e-9).powf(-gradation / 4.0) as f32).clamp(SIZES[0], SIZES[1]),
        false => 1.0,
    };
    let mut sizes: Vec<f32> = curvatures.iter().map(size).collect();
    let whole: f64 = area.iter().sum();
    let needed: f64 = area.iter().zip(&sizes).map(|(a, s)| a / f64::from(s * s)).sum();
    let fit = (needed / whole.max(f64::MIN_POSITIVE)).sqrt() as f32;
    sizes.iter_mut().for_each(|size| *size *= fit);
    let of = |c: u32| if c == NONE { 1.0 } else { sizes[c as usize] };
    for (weight, &c) in surface.weights.iter_mut().zip(owner) {
        *weight *= f64::from(of(c)).powi(-4);
    }
    owner.iter().map(|&c| of(c)).collect()
}
