//! What happens to scans: corners swapped and doubled, vertices split and merged, coordinates flattened.

use super::choices::Choices;
use stonecut::mesh::Mesh;

/// Spoils a mesh in one random way; does nothing to one that is too small for it.
pub fn spoil(mesh: &mut Mesh, choices: &mut Choices) {
    let (n, n_t) = (mesh.positions.len(), mesh.triangles.len());
    if n == 0 || n_t == 0 {
        return;
    }
    let (t, v, w) = (choices.below(n_t), choices.below(n), choices.below(n));
    match choices.below(17) {
        0 => drop(mesh.triangles.swap_remove(t)),
        1 => {
            // A hole: all that uses a vertex.
            mesh.triangles.retain(|t| !t.contains(&(v as u32)));
        }
        2 => mesh.triangles.push(mesh.triangles[t]),
        3 => {
            let [a, b, c] = mesh.triangles[t];
            mesh.triangles.push([a, c, b]);
        }
        4 => mesh.triangles[t].swap(0, 1),
        5 => {
            // Two vertices become one, wherever they are.
            mesh.triangles
                .iter_mut()
                .flatten()
                .filter(|x| **x == v as u32)
                .for_each(|x| *x = w as u32);
        }
        6 => mesh.positions[v] = mesh.positions[w],
        7 => {
            // One corner gets a vertex of its own in the same place.
            let corner = choices.below(3);
            mesh.positions.push(mesh.positions[mesh.triangles[t][corner] as usize]);
            mesh.triangles[t][corner] = n as u32;
        }
        8 => {
            // A T-junction: one side of an edge gets a vertex in its middle.
            let [a, b, c] = mesh.triangles[t];
            let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
            mesh.positions.push([0, 1, 2].map(|k| 0.5 * (p[k] + q[k])));
            mesh.triangles[t] = [a, n as u32, c];
            mesh.triangles.push([n as u32, b, c]);
            if choices.one_in(2) {
                mesh.triangles.push([a, b, n as u32]);
            }
        }
        9 => mesh.triangles.push([v as u32, w as u32, choices.below(n) as u32]),
        10 => {
            for _ in 0..choices.within(1..4) {
                mesh.positions.push([choices.unit(), choices.unit(), choices.unit()]);
            }
        }
        11 => shatter(mesh),
        12 => cut(mesh, choices),
        13 => mesh.positions.iter_mut().for_each(|p| *p = p.map(|x| (x * 2.0).round() * 0.5)),
        14 => {
            let axis = choices.below(3);
            mesh.positions.iter_mut().for_each(|p| p[axis] = 0.0);
        }
        15 => {
            for _ in 0..n_t {
                let (i, j) = (choices.below(n_t), choices.below(n_t));
                mesh.triangles.swap(i, j);
                mesh.triangles[i].rotate_left(1);
            }
        }
        _ => {
            for p in &mut mesh.positions {
                *p = p.map(|x| x + 1e-3 * (choices.unit() - 0.5));
            }
        }
    }
}

/// Every triangle for itself, as in an STL file.
fn shatter(mesh: &mut Mesh) {
    mesh.positions = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]).collect();
    mesh.triangles =
        (0..mesh.positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
}

/// Splits the vertices along a plane, or around charts.
pub fn cut(mesh: &mut Mesh, choices: &mut Choices) {
    let (axis, size) = (choices.below(3), choices.of(&[1.0, 0.5, 2.0]));
    let chart = |t: &[u32; 3]| {
        let sum: f64 = t.iter().map(|&v| mesh.positions[v as usize][axis]).sum();
        (sum / (3.0 * size)).floor() as i64
    };
    let charts: Vec<i64> = mesh.triangles.iter().map(chart).collect();
    let mut known = std::collections::BTreeMap::new();
    let mut positions = Vec::new();
    for (t, chart) in mesh.triangles.iter_mut().zip(charts) {
        *t = t.map(|v| {
            *known.entry((chart, v)).or_insert_with(|| {
                positions.push(mesh.positions[v as usize]);
                positions.len() as u32 - 1
            })
        });
    }
    mesh.positions = positions;
}

/// Extreme sizes and places.
pub fn stretch(mesh: &mut Mesh, choices: &mut Choices) {
    let factors: [f64; 3] = match choices.below(8) {
        0 => [1e-30; 3],
        1 => [1e30; 3],
        2 => [1e-9; 3],
        3 => [1e12, 1.0, 1e-12],
        4 => [0.0, 1.0, 1.0],
        5 => [0.0, 0.0, 1.0],
        6 => [0.0; 3],
        _ => [1.0; 3],
    };
    let offset = choices.of(&[0.0, 0.0, 0.0, 1.0, 1e6, -1e15, 1e30]);
    for p in &mut mesh.positions {
        *p = std::array::from_fn(|k| p[k] * factors[k] + offset);
    }
}
