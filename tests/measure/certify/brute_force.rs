//! The certificate against brute force: random soups and torn sheets.

use super::{Vector, certify, dot, sheet, soup, sub};
use stonecut::Mesh;

fn between(a: Vector, b: Vector, t: f64) -> Vector {
    [0, 1, 2].map(|k| (1.0 - t) * a[k] + t * b[k])
}

/// Distance from a point to a triangle in another way than the library's: the foot in the plane if it is inside,
/// else the nearest of the three edges.
fn distance(p: Vector, t: &[Vector; 3]) -> f64 {
    let mut best = f64::INFINITY;
    for i in 0..3 {
        let (a, b) = (t[i], t[(i + 1) % 3]);
        let edge = sub(b, a);
        let length_sq = dot(edge, edge);
        let s =
            if length_sq > 0.0 { (dot(sub(p, a), edge) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
        let off = sub(p, between(a, b, s));
        best = best.min(dot(off, off).sqrt());
    }
    let (u, v, w) = (sub(t[1], t[0]), sub(t[2], t[0]), sub(p, t[0]));
    let (uu, uv, vv, wu, wv) = (dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v));
    let det = uu * vv - uv * uv;
    if det > 1e-12 * uu * vv {
        let (s, r) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
        if s >= 0.0 && r >= 0.0 && s + r <= 1.0 {
            let off = [0, 1, 2].map(|k| w[k] - s * u[k] - r * v[k]);
            best = best.min(dot(off, off).sqrt());
        }
    }
    best
}

/// An interval that holds the true distance, by dense subdivision: the distance at a centroid, and that plus the
/// radius, over ever smaller parts of every triangle.
pub(super) fn brute_force(meshes: [&Mesh; 2], most_parts: usize) -> [f64; 2] {
    let (mut lower, mut upper) = (0f64, 0f64);
    for way in 0..2 {
        let (source, target) = (meshes[way], meshes[1 - way]);
        let target: Vec<[Vector; 3]> =
            (0..target.triangles.len()).map(|i| target.corners(i)).collect();
        let far = |p: Vector| target.iter().map(|t| distance(p, t)).fold(f64::INFINITY, f64::min);
        let bounds = |t: &[Vector; 3], lower: &mut f64| {
            let c = [0, 1, 2].map(|k| (t[0][k] + t[1][k] + t[2][k]) / 3.0);
            let radius = t.iter().map(|p| dot(sub(*p, c), sub(*p, c)).sqrt()).fold(0.0, f64::max);
            let d = far(c);
            *lower = lower.max(d);
            d + radius
        };
        let mut parts: Vec<(f64, [Vector; 3])> = Vec::new();
        for i in 0..source.triangles.len() {
            let t = source.corners(i);
            t.iter().for_each(|&p| lower = lower.max(far(p)));
            parts.push((bounds(&t, &mut lower), t));
        }
        for _ in 0..most_parts {
            let Some(worst) = (0..parts.len()).max_by(|&a, &b| parts[a].0.total_cmp(&parts[b].0))
            else {
                break;
            };
            if parts[worst].0 <= lower * 1.002 {
                break;
            }
            let (_, t) = parts.swap_remove(worst);
            let m = [0, 1, 2].map(|i| between(t[i], t[(i + 1) % 3], 0.5));
            for part in [[t[0], m[0], m[2]], [m[0], t[1], m[1]], [m[2], m[1], t[2]], m] {
                let bound = bounds(&part, &mut lower);
                if bound > lower {
                    parts.push((bound, part));
                }
            }
        }
        upper = upper.max(parts.iter().map(|part| part.0).fold(lower, f64::max));
    }
    [lower, upper]
}

struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        self.0 >> 33
    }

    fn number(&mut self) -> f64 {
        self.bits() as f64 / (1u64 << 31) as f64
    }

    fn below(&mut self, n: u64) -> u64 {
        self.bits() % n
    }
}

/// One of several kinds of small surfaces.
fn random_mesh(random: &mut Random, kind: u64) -> Mesh {
    let n = 1 + random.below(6) as usize;
    let mut triangles = Vec::new();
    for _ in 0..n {
        let mut point = || -> Vector {
            match kind {
                // Ties everywhere.
                0 => [0; 3].map(|_| random.below(3) as f64),
                // Nearly flat.
                1 => [random.number(), random.number(), 0.02 * random.number()],
                // Far from the origin.
                2 => [0; 3].map(|_| 1e6 + random.number()),
                _ => [0; 3].map(|_| random.number()),
            }
        };
        let (a, b, c) = (point(), point(), point());
        triangles.push(match random.below(12) {
            0 => [a, a, b],
            1 => [a, b, between(a, b, 0.25)],
            2 => [a; 3],
            _ => [a, b, c],
        });
    }
    soup(&triangles)
}

#[test]
fn small_random_pairs_agree_with_brute_force() {
    let mut random = Random(16);
    let (mut widest, mut n_narrow) = (0f64, 0);
    for i in 0..10_000 {
        let kind = random.below(4);
        let a = random_mesh(&mut random, kind);
        let b = match random.below(3) {
            // The same, moved a little.
            0 => {
                let mut b = a.clone();
                let most = [0.3, 1e-3, 1e-7][random.below(3) as usize];
                for x in b.positions.iter_mut().flatten() {
                    *x += most * (random.number() - 0.5);
                }
                b
            }
            _ => random_mesh(&mut random, kind),
        };
        let tolerance = [0.1, 0.01, 1e-3][random.below(3) as usize];
        let [lower, upper] = brute_force([&a, &b], 400);
        let found = certify(&a, &b, tolerance);
        let what = format!("pair {i}: {lower} to {upper}, {found:?} {a:?} {b:?}");
        // Rounding of the brute force itself.
        let slack = 1e-12 + if kind == 2 { 1e-8 } else { 0.0 };
        assert!(found.certified, "{what}");
        assert!(found.lower <= upper + slack && found.upper >= lower - slack, "{what}");
        assert!(found.upper - found.lower <= tolerance * found.upper + 2e-5, "{what}");
        let is_narrow = upper <= 1.01 * lower;
        n_narrow += usize::from(is_narrow);
        widest = widest.max(if lower > 0.0 { upper / lower } else { 1.0 });
    }
    println!(
        "{n_narrow} of 10000 pairs known to 1 % by brute force, the worst to a factor of {widest:.3}"
    );
    assert!(n_narrow > 5000, "{n_narrow}");
}

/// A sheet whose vertices were moved, with holes, folds, steep places, or triangles that come twice.
fn torn(random: &mut Random, n: u32) -> Mesh {
    let mut mesh = sheet(n, 1.0, 0.0, random.below(2) == 0);
    let aside = [0.0, 0.1, 1.5][random.below(3) as usize] / f64::from(n);
    let up = [0.02, 0.3][random.below(2) as usize];
    for p in &mut mesh.positions {
        let by = [aside, aside, up].map(|most| most * (random.number() - 0.5));
        *p = [p[0] + by[0], p[1] + by[1], p[2] + by[2]];
    }
    let gone = [0, 0, 20][random.below(3) as usize];
    mesh.triangles.retain(|_| random.below(100) >= gone);
    if random.below(8) == 0 {
        mesh.triangles.extend_from_within(..mesh.triangles.len() / 2);
    }
    mesh
}

#[test]
fn surfaces_that_hang_together_agree_with_brute_force() {
    let mut random = Random(18);
    for i in 0..1_000 {
        let (n, m) = (1 + random.below(2), 2 + random.below(4));
        let [a, b] = [n, m].map(|n| torn(&mut random, n as u32));
        if a.triangles.is_empty() || b.triangles.is_empty() {
            continue;
        }
        let [lower, upper] = brute_force([&a, &b], 300);
        let found = certify(&a, &b, 0.01);
        let what = format!("pair {i}: {lower} to {upper}, {found:?} {a:?} {b:?}");
        assert!(found.certified && found.lower <= upper && found.upper >= lower - 1e-12, "{what}");
    }
}
