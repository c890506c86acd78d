//! On smooth closed meshes no triangle of the result faces against the original surface.

use crate::common::meshes;
use stonecut::Mesh;
use stonecut::kernel::{Fit, Options, Placement, Stop, simplify_mesh};
use stonecut::mesh::vec3::{Vec3, cross, dot, sub};

/// A smooth closed surface with its own outward direction.
struct Smooth {
    name: &'static str,
    mesh: Mesh,
    /// Along the outward normal of the surface near a point.
    outward: fn(Vec3) -> Vec3,
}

const TUBE: f64 = 0.35;

fn torus(n: usize) -> Smooth {
    let mesh = meshes::torus(n, n, |_, _| TUBE);
    let outward = |p: Vec3| {
        let length = p[0].hypot(p[1]);
        sub(p, [p[0] / length, p[1] / length, 0.0])
    };
    Smooth { name: "torus", mesh, outward }
}

/// A cube's surface of `n` x `n` quads a side, blown up to an ellipsoid of these half axes.
const AXES: Vec3 = [1.0, 0.6, 1.7];

fn ellipsoid(n: usize) -> Smooth {
    let mut mesh = Mesh::default();
    let mut known = std::collections::BTreeMap::new();
    let mut vertex = |mesh: &mut Mesh, place: [i64; 3]| {
        *known.entry(place).or_insert_with(|| {
            let p = place.map(|x| 2.0 * x as f64 / n as f64 - 1.0);
            let length = dot(p, p).sqrt();
            mesh.positions.push([0, 1, 2].map(|k| AXES[k] * p[k] / length));
            mesh.positions.len() as u32 - 1
        })
    };
    let n = n as i64;
    for axis in 0..3 {
        for side in [0, n] {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let place = |i: i64, j: i64| {
                    let mut place = [side; 3];
                    (place[(axis + 1) % 3], place[(axis + 2) % 3]) = (i, j);
                    place
                };
                let mut quad =
                    [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| place(i, j));
                if side == 0 {
                    quad.reverse();
                }
                let [a, b, c, d] = quad.map(|place| vertex(&mut mesh, place));
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    let outward = |p: Vec3| [0, 1, 2].map(|k| p[k] / (AXES[k] * AXES[k]));
    Smooth { name: "ellipsoid", mesh, outward }
}

fn facing_against(mesh: &Mesh, outward: fn(Vec3) -> Vec3) -> usize {
    let against = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let centre = [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0);
        dot(cross(sub(b, a), sub(c, a)), outward(centre)) <= 0.0
    };
    mesh.triangles.iter().filter(against).count()
}

#[test]
fn smooth_closed_meshes_keep_their_facing() {
    for Smooth { name, mesh, outward } in [torus(160), ellipsoid(70)] {
        assert_eq!(facing_against(&mesh, outward), 0, "{name} itself");
        let n = mesh.triangles.len() as u64;
        for (placement, fit, share) in [
            (Placement::Optimal, Fit::Auto, 10),
            (Placement::Optimal, Fit::Auto, 100),
            (Placement::Optimal, Fit::On, 10),
            (Placement::Optimal, Fit::On, 30),
            (Placement::Subset, Fit::Auto, 10),
            (Placement::Midpoint, Fit::Auto, 10),
        ] {
            let stop = Stop::Triangles(n / share);
            let options = Options { stop, placement, fit, ..Options::default() };
            let result = simplify_mesh(mesh.clone(), &vec![false; mesh.positions.len()], &options);
            assert!(result.statistics.reached);
            let n = facing_against(&result.mesh, outward);
            assert_eq!(n, 0, "{name}, 1/{share}, {placement:?}, {fit:?}");
        }
    }
}
