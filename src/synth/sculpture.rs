//! The shape of the statue: a great stone head, from large forms down to the marks of the chisel.
//!
//! A map from directions to points of space, so that any triangulation of the sphere becomes a closed
//! surface of genus 0. Lengths are millimetres, z is up, the face looks along -y. Features are given in
//! metres, as bumps pushed forward (-y) or sideways out of a rounded block.

use super::noise::{noise3, smoothstep};

/// One feature of the face, mirrored to both sides: centre (x, z) and half-widths seen from the front,
/// and how far it is pushed towards the viewer.
struct Feature {
    centre: [f64; 2],
    half: [f64; 2],
    push: f64,
}

const FACE: [Feature; 9] = [
    Feature { centre: [0.0, 0.43], half: [0.62, 0.17], push: 0.12 }, // brow
    Feature { centre: [0.24, 0.24], half: [0.20, 0.15], push: -0.13 }, // eye sockets
    Feature { centre: [0.23, 0.24], half: [0.10, 0.07], push: 0.035 }, // eyeballs
    Feature { centre: [0.36, -0.06], half: [0.18, 0.24], push: -0.07 }, // cheeks
    Feature { centre: [0.115, -0.06], half: [0.085, 0.08], push: 0.03 }, // nostrils
    Feature { centre: [0.0, -0.235], half: [0.25, 0.065], push: 0.085 }, // upper lip
    Feature { centre: [0.0, -0.345], half: [0.23, 0.065], push: 0.08 }, // lower lip
    Feature { centre: [0.0, -0.56], half: [0.36, 0.19], push: 0.13 }, // chin
    Feature { centre: [0.40, -0.42], half: [0.16, 0.26], push: -0.05 }, // jaw line
];

/// A seeded stone head about two metres tall.
pub(super) struct Sculpture {
    seed: u32,
    /// Strength of tool marks: they fade where the mesh is too coarse to sample them.
    marks: f64,
}

impl Sculpture {
    /// A head whose finest features suit a vertex spacing of `spacing` millimetres.
    pub(super) fn new(seed: u64, spacing: f64) -> Self {
        let seed = seed as u32 ^ (seed >> 32) as u32;
        Sculpture { seed, marks: 1.0 - smoothstep(5.0, 12.0, spacing) }
    }

    /// The surface point in a unit direction.
    pub(super) fn point(&self, d: [f64; 3]) -> [f64; 3] {
        let form = form(d);
        let relief = 1.0 + self.relief(form);
        // The base stands flat, whatever the relief.
        let z = (relief * form[2]).max(-0.93);
        [1000.0 * relief * form[0], 1000.0 * relief * form[1], 1000.0 * z]
    }

    /// Unevenness of the stone, as a share of the distance from the centre.
    fn relief(&self, p: [f64; 3]) -> f64 {
        let seed = self.seed;
        let at = |frequency: f64, salt: u32| noise3(p.map(|x| frequency * x), seed ^ salt);
        let broad = at(2.1, 0);
        let lumps = 0.022 * broad + 0.012 * at(6.3, 1) + 0.004 * at(23.0, 2) + 0.0012 * at(90.0, 3);
        // Cracks: thin grooves where a smooth field changes sign, only in part of the stone.
        let line = (at(3.1, 4) + 0.12 * at(17.0, 5)).abs();
        let cracked = smoothstep(-0.05, 0.25, at(1.7, 6));
        let crack = -0.016 * cracked * (1.0 - smoothstep(0.0, 0.03, line));
        // Flat facets knocked off: the part of a field above a level is cut away, leaving a crease.
        let chipped = -0.06 * (at(4.4, 7) - 0.42).max(0.0);
        // Claw-chisel marks: rows of rounded grooves with sharp ridges, in two directions by place.
        let tilt = if at(1.3, 8) > 0.0 { 0.45 } else { -0.7 };
        let phase = 55.0 * (p[2] + tilt * (p[0] + p[1])) + 1.2 * at(5.0, 9);
        let groove = phase - f64::from(phase as i32) - if phase < 0.0 { -0.5 } else { 0.5 };
        let worked = smoothstep(-0.15, 0.15, broad + 0.3 * at(8.0, 10)) * self.marks;
        let chisel = 0.0032 * worked * (4.0 * groove * groove - 1.0);
        lumps + crack + chipped + chisel
    }

    /// The stone's colour at a surface point.
    pub(super) fn color(&self, point: [f64; 3]) -> [u8; 3] {
        let at = |frequency: f64, salt: u32| {
            noise3(point.map(|x| 0.001 * frequency * x), self.seed ^ salt)
        };
        let (stain, grain) = (at(3.0, 20), at(45.0, 21));
        let lichen = smoothstep(0.28, 0.5, at(5.0, 22) + 0.35 * at(19.0, 23));
        let light = 0.74 + 0.10 * stain + 0.07 * grain;
        let stone = [1.0, 0.95, 0.86].map(|tint| light * tint);
        let growth = [0.70, 0.66, 0.46];
        std::array::from_fn(|i| {
            let mixed = stone[i] + 0.55 * lichen * (growth[i] - stone[i]);
            (255.0 * mixed.clamp(0.0, 1.0)) as u8
        })
    }
}

/// The head without its unevenness, in metres.
fn form(d: [f64; 3]) -> [f64; 3] {
    let [mut x, mut y, mut z] = block(d);
    let (side, front) = (x.abs(), smoothstep(0.02, 0.32, -y));
    let mut push = 0.0;
    for Feature { centre, half, push: amount } in &FACE {
        push += amount * bump((side - centre[0]) / half[0], (z - centre[1]) / half[1]);
    }
    // The nose widens and rises from the brow to its tip, then breaks off.
    let along = ((0.42 - z) / 0.50).clamp(0.0, 1.0);
    let nose = bump(side / (0.10 + 0.09 * along), 0.0);
    let nose_ends = smoothstep(-0.145, -0.075, z) * (1.0 - smoothstep(0.36, 0.52, z));
    push += nose * nose_ends * (0.06 + 0.17 * along);
    // Ears: long lobes on the sides, hollow within.
    let ear = bump((y - 0.10) / 0.15, (z - 0.02) / 0.46);
    let hollow = bump((y - 0.09) / 0.075, (z - 0.06) / 0.32);
    let outward = smoothstep(0.18, 0.40, side) * (0.12 * ear - 0.085 * hollow);
    y -= front * push;
    x += outward.copysign(x);
    // A forehead that leans back, a neck, a base that widens again.
    y += 0.16 * smoothstep(0.42, 1.0, z);
    let neck = smoothstep(-0.60, -0.74, z);
    let base = smoothstep(-0.80, -0.92, z);
    let slim = 1.0 - 0.17 * neck + 0.25 * base;
    x *= slim;
    y = (y - 0.06) * slim + 0.06;
    z = z.max(-1.2);
    [x, y, z]
}

/// A block with rounded edges: between an ellipsoid and a box.
fn block(d: [f64; 3]) -> [f64; 3] {
    let q = [d[0] / 0.52, d[1] / 0.50, d[2]];
    let squares = q.map(|x| x * x);
    let round = (squares[0] + squares[1] + squares[2]).sqrt();
    let boxy = squares.map(|x| x * x);
    let boxy = (boxy[0] + boxy[1] + boxy[2]).sqrt().sqrt();
    let radius = 0.45 / round + 0.55 / boxy;
    d.map(|x| radius * x)
}

/// A smooth hill of height 1 over the unit disc, 0 outside.
fn bump(u: f64, v: f64) -> f64 {
    let rest = (1.0 - u * u - v * v).max(0.0);
    rest * rest * (3.0 - 2.0 * rest)
}
