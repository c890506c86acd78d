//! A direction across a normal as its turn around it: two bytes of a sample instead of twelve.

use stonecut_mesh::vec3::{Vec3, add, dot, scale, unit};

/// Steps of a turn around the normal.
const STEPS: f64 = 65_536.0;

/// Two directions across a normal that looks towards the viewer, and across each other (Frisvad 2012).
fn basis([x, y, z]: Vec3) -> [Vec3; 2] {
    // What looks straight away from the viewer is not seen.
    let a = 1.0 / (1.0 + z).max(1e-6);
    let b = -x * y * a;
    [[1.0 - x * x * a, b, -x], [b, 1.0 - y * y * a, -y]]
}

/// The turn of a tangent around a normal towards the viewer, in 65,536 steps.
pub(super) fn turn_of(normal: [f32; 3], tangent: [f32; 3]) -> u16 {
    let Some(normal) = unit(normal.map(f64::from)) else { return 0 };
    let tangent = tangent.map(f64::from);
    let [first, second] = basis(normal);
    let angle = dot(tangent, second).atan2(dot(tangent, first));
    (angle / std::f64::consts::TAU * STEPS).round() as i32 as u16
}

/// The tangent of a turn around a normal of length 1, across it.
pub(super) fn tangent_of(normal: Vec3, turn: u16) -> Vec3 {
    let angle = std::f64::consts::TAU * f64::from(turn) / STEPS;
    let [first, second] = basis(normal);
    add(scale(first, angle.cos()), scale(second, angle.sin()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_lead_back_to_their_tangents() {
        for normal in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.6, 0.64], [0.6, -0.8, 0.0]] {
            for across in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.3, 0.2, 0.9]] {
                let up = dot(normal, across);
                let across = unit([0, 1, 2].map(|k| across[k] - up * normal[k])).unwrap();
                let back =
                    tangent_of(normal, turn_of(normal.map(|x| x as f32), across.map(|x| x as f32)));
                assert!(dot(back, across) > 1.0 - 1e-8 && dot(back, normal).abs() < 1e-6);
            }
        }
    }
}
