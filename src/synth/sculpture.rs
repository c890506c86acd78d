//! The shape of the statue: a stone head, from large forms down to the marks of the chisel.
//!
//! A map from directions to points of space, so that any triangulation of the sphere becomes a closed
//! surface of genus 0. Lengths are millimetres, z is up, the face looks along -y.

use super::noise::{noise3, smoothstep};

/// A seeded stone head about two metres tall.
pub(super) struct Sculpture {
    seed: u32,
    /// How strongly tool marks show: they fade where the mesh is too coarse to sample them.
    marks: f64,
}

impl Sculpture {
    /// A head whose finest features suit a vertex spacing of `spacing` millimetres.
    pub(super) fn new(seed: u64, spacing: f64) -> Self {
        Sculpture {
            seed: seed as u32 ^ (seed >> 32) as u32,
            marks: 1.0 - smoothstep(6.0, 14.0, spacing),
        }
    }

    /// The surface point in a unit direction.
    pub(super) fn point(&self, d: [f64; 3]) -> [f64; 3] {
        let seed = self.seed;
        let p = [0.62 * d[0], 0.72 * d[1], d[2]];
        let lumps = noise3(p.map(|x| 2.3 * x), seed) * 0.08
            + noise3(p.map(|x| 9.0 * x), seed ^ 1) * 0.02
            + noise3(p.map(|x| 40.0 * x), seed ^ 2) * 0.004;
        let fold = 1.0 - noise3(p.map(|x| 3.7 * x), seed ^ 3).abs();
        let crease = 0.05 * fold * fold * fold * fold;
        let phase = 60.0 * (p[2] + 0.4 * p[0]) + 1.5 * noise3(p.map(|x| 6.0 * x), seed ^ 4);
        let groove = phase - phase.floor() - 0.5;
        let where_marked = smoothstep(-0.1, 0.2, noise3(p.map(|x| 3.0 * x), seed ^ 5));
        let chisel = self.marks * where_marked * 0.006 * (4.0 * groove * groove - 1.0);
        let radius = 1000.0 * (1.0 + lumps + crease + chisel);
        p.map(|x| radius * x)
    }

    /// The stone's colour at a surface point.
    pub(super) fn color(&self, point: [f64; 3]) -> [u8; 3] {
        let vein = noise3(point.map(|x| 0.004 * x), self.seed ^ 20);
        let grain = noise3(point.map(|x| 0.05 * x), self.seed ^ 21);
        let light = 0.72 + 0.12 * vein + 0.06 * grain;
        [1.0, 0.95, 0.86].map(|tint| (255.0 * (light * tint).clamp(0.0, 1.0)) as u8)
    }
}
