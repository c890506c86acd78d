//! Hashes and smooth noise: the randomness of every synthetic mesh, as pure functions of place and seed.
//!
//! Nothing here has a state, so any vertex can be computed alone, by any thread, in any order. Only
//! additions, multiplications, divisions and roots are used: their results are the same on every machine.

use stonecut_mesh::scatter::hash;

/// A hash of a number under a seed.
pub(super) fn hash2(value: u64, seed: u64) -> u64 {
    hash(value ^ hash(seed))
}

/// The hash as three independent values in [-1, 1).
pub(super) fn signed3(hash: u64) -> [f64; 3] {
    let field = |shift: u32| ((hash >> shift) & 0x1F_FFFF) as f64 / f64::from(1u32 << 20) - 1.0;
    [field(0), field(21), field(42)]
}

/// Nearly normal noise of variance 1: the scaled sum of three uniform values.
pub(super) fn gauss(hash: u64) -> f64 {
    let [a, b, c] = signed3(hash);
    a + b + c
}

/// A smooth step from 0 at `from` to 1 at `to`.
pub(super) fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The hash of a lattice point; 32 bits, because noise spends most of its time here.
#[inline(always)]
fn lattice(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x8DA6_B343)
        ^ (y as u32).wrapping_mul(0xD816_3841)
        ^ (z as u32).wrapping_mul(0xCB1A_B31F)
        ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// The offset of a point from a lattice point, projected on that point's random gradient.
#[inline(always)]
fn slope(h: u32, x: f64, y: f64, z: f64) -> f64 {
    let field = |shift: u32| f64::from((h >> shift) & 0x3FF) * (2.0 / 1023.0) - 1.0;
    field(0) * x + field(10) * y + field(20) * z
}

/// The lattice point at or below `x` and the rest in [0, 1].
///
/// Not `f64::floor`: without SSE4.1 that is a call, and noise would take twice the time.
#[inline(always)]
fn split(x: f64) -> (i32, f64) {
    let whole = x as i32;
    let below = whole.wrapping_sub(i32::from(x < f64::from(whole)));
    (below, x - f64::from(below))
}

#[inline(always)]
fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[inline(always)]
fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Gradient noise in space: smooth, mean 0, mostly within [-1, 1], one feature per unit of length.
///
/// Source: Perlin 2002 (docs/references.md), with hashed instead of tabled gradients, so that it never
/// repeats.
pub(super) fn noise3(p: [f64; 3], seed: u32) -> f64 {
    let [(i, x), (j, y), (k, z)] = p.map(split);
    let [i1, j1, k1] = [i, j, k].map(|n| n.wrapping_add(1));
    let [u, v, w] = [fade(x), fade(y), fade(z)];
    let corner = |i, j, k, x, y, z| slope(lattice(i, j, k, seed), x, y, z);
    let low = mix(
        mix(corner(i, j, k, x, y, z), corner(i1, j, k, x - 1.0, y, z), u),
        mix(corner(i, j1, k, x, y - 1.0, z), corner(i1, j1, k, x - 1.0, y - 1.0, z), u),
        v,
    );
    let high = mix(
        mix(corner(i, j, k1, x, y, z - 1.0), corner(i1, j, k1, x - 1.0, y, z - 1.0), u),
        mix(
            corner(i, j1, k1, x, y - 1.0, z - 1.0),
            corner(i1, j1, k1, x - 1.0, y - 1.0, z - 1.0),
            u,
        ),
        v,
    );
    1.4 * mix(low, high, w)
}

/// Adds `weight` times `noise3` along a row of points `step` apart in x, from `start`, to `row`.
///
/// Along x within a lattice cell only two linear functions and their blend are left, so a long row costs a
/// tenth of single points.
pub(super) fn add_noise3_row(row: &mut [f32], start: [f64; 3], step: f64, seed: u32, weight: f64) {
    let ([j, k], [y, z]) = {
        let [(j, y), (k, z)] = [start[1], start[2]].map(split);
        ([j, k], [y, z])
    };
    let (v, w) = (fade(y), fade(z));
    // What the four lattice points at one x give: value at the point itself and slope along x.
    let plane = |i: i32| {
        let corner = |dj: i32, dk: i32| {
            let h = lattice(i, j.wrapping_add(dj), k.wrapping_add(dk), seed);
            let (y, z) = (y - f64::from(dj), z - f64::from(dk));
            [slope(h, 0.0, y, z), slope(h, 1.0, 0.0, 0.0)]
        };
        let [low, high] = [0, 1].map(|dk| {
            let (a, b) = (corner(0, dk), corner(1, dk));
            [mix(a[0], b[0], v), mix(a[1], b[1], v)]
        });
        [0, 1].map(|n| (1.4 * weight * mix(low[n], high[n], w)) as f32)
    };
    let mut at = 0;
    while at < row.len() {
        let (i, _) = split(start[0] + step * at as f64);
        let end = ((f64::from(i) + 1.0 - start[0]) / step).ceil().max(0.0) as usize;
        let end = end.clamp(at + 1, row.len());
        let ([a0, a1], [b0, b1]) = (plane(i), plane(i.wrapping_add(1)));
        let first = start[0] + step * at as f64 - f64::from(i);
        for (n, value) in row[at..end].iter_mut().enumerate() {
            let x = (first + step * n as f64) as f32;
            let u = x * x * x * (x * (x * 6.0 - 15.0) + 10.0);
            let (a, b) = (a0 + a1 * x, b0 + b1 * (x - 1.0));
            *value += a + (b - a) * u;
        }
        at = end;
    }
}

/// Gradient noise in the plane with its two derivatives: `[value, d/dx, d/dy]`.
///
/// Source: as `noise3`; the derivatives are those of the interpolated polynomial.
pub(super) fn noise2_slope(p: [f64; 2], seed: u32) -> [f64; 3] {
    let [(i, x), (j, y)] = p.map(split);
    let gradient = |i: i32, j: i32| {
        let h = lattice(i, j, 0, seed);
        let field = |shift: u32| f64::from((h >> shift) & 0x7FFF) * (2.0 / 32767.0) - 1.0;
        [field(0), field(15)]
    };
    let (i1, j1) = (i.wrapping_add(1), j.wrapping_add(1));
    let [ga, gb, gc, gd] = [gradient(i, j), gradient(i1, j), gradient(i, j1), gradient(i1, j1)];
    let a = ga[0] * x + ga[1] * y;
    let b = gb[0] * (x - 1.0) + gb[1] * y;
    let c = gc[0] * x + gc[1] * (y - 1.0);
    let d = gd[0] * (x - 1.0) + gd[1] * (y - 1.0);
    let (u, v) = (fade(x), fade(y));
    let steep = |t: f64| 30.0 * t * t * (t * (t - 2.0) + 1.0);
    let (du, dv) = (steep(x), steep(y));
    let e = a - b - c + d;
    let blend = |n: usize| {
        ga[n] + u * (gb[n] - ga[n]) + v * (gc[n] - ga[n]) + u * v * (ga[n] - gb[n] - gc[n] + gd[n])
    };
    [
        1.5 * (a + u * (b - a) + v * (c - a) + u * v * e),
        1.5 * (blend(0) + du * (b - a + v * e)),
        1.5 * (blend(1) + dv * (c - a + u * e)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_bounded_centred_and_repeatable() {
        let mut sum = 0.0;
        for n in 0..20_000u64 {
            let p = signed3(hash(n)).map(|x| 500.0 * x);
            let value = noise3(p, 7);
            assert_eq!(value, noise3(p, 7));
            assert!(value.abs() <= 2.5, "{value} at {p:?}");
            sum += value;
        }
        assert!((sum / 20_000.0).abs() < 0.02);
    }

    #[test]
    fn a_row_of_noise_is_noise() {
        for n in 0..200u64 {
            let start = signed3(hash(n)).map(|x| 90.0 * x);
            let mut row = vec![0.0; 300];
            add_noise3_row(&mut row, start, 0.07, 5, 2.0);
            for (i, value) in row.iter().enumerate() {
                let p = [start[0] + 0.07 * i as f64, start[1], start[2]];
                assert!((f64::from(*value) - 2.0 * noise3(p, 5)).abs() < 1e-4, "{value} at {p:?}");
            }
        }
    }

    #[test]
    fn slopes_are_those_of_finite_differences() {
        for n in 0..500u64 {
            let [x, y, _] = signed3(hash(n)).map(|x| 50.0 * x);
            let [_, dx, dy] = noise2_slope([x, y], 3);
            let h = 1e-6;
            let at = |x, y| noise2_slope([x, y], 3)[0];
            assert!(((at(x + h, y) - at(x - h, y)) / (2.0 * h) - dx).abs() < 1e-6);
            assert!(((at(x, y + h) - at(x, y - h)) / (2.0 * h) - dy).abs() < 1e-6);
        }
    }
}
