//! Values that are missing at some vertices: NaN and infinite ones.

use crate::dirty::sheet;
use stonecut::Mesh;
use stonecut::kernel::{Options, Stop, simplify_mesh};

/// A bump with two channels, a ramp and the height, of which every `gap`th value is missing.
fn bump(gap: usize) -> Mesh {
    let mut mesh = sheet(60, |_, _| false);
    mesh.n_channels = 2;
    for (v, p) in mesh.positions.iter_mut().enumerate() {
        let (u, w) = (p[0] - 0.5, p[1] - 0.5);
        p[2] = 0.3 * (1.0 - 2.0 * (u * u + w * w));
        let missing = [f32::NAN, f32::INFINITY][v / 7 % 2];
        let value =
            |x: f64, k: usize| if (v + 3 * k).is_multiple_of(gap) { missing } else { x as f32 };
        mesh.channels.extend([value(p[0], 0), value(p[2], 1)]);
    }
    mesh
}

#[test]
fn missing_values_neither_spread_nor_cost_shape() {
    for weights in [vec![], vec![0.2, 0.2]] {
        let options = |n: u64| Options {
            stop: Stop::Triangles(n),
            weights: weights.clone(),
            ..Options::default()
        };
        for (gap, n) in [(50, 1500), (50, 300), (5, 300)] {
            let mesh = bump(gap);
            let locked = vec![false; mesh.positions.len()];
            let result = simplify_mesh(mesh, &locked, &options(n)).mesh;
            let mut n_missing = 0;
            for (p, values) in result.positions.iter().zip(result.channels.chunks_exact(2)) {
                let (u, w) = (p[0] - 0.5, p[1] - 0.5);
                let off = p[2] - 0.3 * (1.0 - 2.0 * (u * u + w * w));
                assert!(off.abs() < 0.01, "{gap} {n}: {p:?} is {off} away");
                for (value, expected) in values.iter().zip([p[0], p[2]]) {
                    match value.is_finite() {
                        true => assert!(
                            (f64::from(*value) - expected).abs() < 0.12,
                            "{gap} {n} {p:?}: {values:?}"
                        ),
                        false => n_missing += 1,
                    }
                }
            }
            // They count as what is beside them, which costs a little.
            let most = 2 * result.channels.len() / gap;
            assert!(
                n_missing <= most,
                "{weights:?} {gap} {n}: {n_missing} of {}",
                result.channels.len()
            );
        }
    }
}
