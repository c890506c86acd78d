//! Triangles around hubs, laid flat: two of them overlap where their sectors of the circle around the hub do.
//!
//! Held against each other by place (`flatten::Grid`), thousands of needles that meet in one point would all be compared with
//! each other. Knows nothing of charts.

use super::settings::NONE;
use std::collections::{BTreeMap, HashMap};
use stonecut_mesh::steps::HUB;

/// Sectors may overlap by this part of a quarter turn.
const TOLERANCE: f64 = 1e-9;

/// For each triangle the place among its corners of the vertex with the most triangles, if these are more than `HUB`, and
/// that vertex.
pub(super) fn hubs(triangles: &[[u32; 3]], n_vertices: usize) -> Vec<(u32, u8)> {
    let mut n_around = vec![0u32; n_vertices];
    triangles.iter().flatten().for_each(|&v| n_around[v as usize] += 1);
    let hub = |t: &[u32; 3]| {
        let n = |k: usize| n_around[t[k] as usize];
        let most = (1..3).fold(0, |most, k| if n(k) > n(most) { k } else { most });
        if n(most) as usize > HUB { (t[most], most as u8) } else { (NONE, 0) }
    };
    triangles.iter().map(hub).collect()
}

/// Sectors that triangles take up around hubs.
#[derive(Default)]
pub(super) struct Sectors {
    /// For each hub the ends of sectors by their starts, as bits that are in the order of the numbers.
    of_hubs: HashMap<u32, BTreeMap<u64, f64>>,
}

impl Sectors {
    /// True if a sector of a hub overlaps none that was taken before.
    pub(super) fn is_free(&self, hub: u32, sector: [f64; 2]) -> bool {
        let Some(taken) = self.of_hubs.get(&hub) else { return true };
        parts(sector).into_iter().flatten().all(|[start, end]| {
            let before = taken.range(..=start.to_bits()).next_back();
            let after = taken.range(start.to_bits()..).next();
            before.is_none_or(|(_, &other_end)| other_end <= start + TOLERANCE)
                && after.is_none_or(|(&bits, _)| f64::from_bits(bits) >= end - TOLERANCE)
        })
    }

    /// Takes a sector up.
    pub(super) fn take(&mut self, hub: u32, sector: [f64; 2]) {
        let taken = self.of_hubs.entry(hub).or_default();
        for [start, end] in parts(sector).into_iter().flatten() {
            let known = taken.entry(start.to_bits()).or_insert(end);
            *known = known.max(end);
        }
    }
}

/// The sector of a triangle at one of its corners, from 0 to 4, against the clock.
pub(super) fn sector(t: &[[f64; 2]; 3], corner: u8) -> [f64; 2] {
    let k = usize::from(corner);
    let to = |other: usize| [t[other][0] - t[k][0], t[other][1] - t[k][1]];
    let (b, c) = (to((k + 1) % 3), to((k + 2) % 3));
    let is_turned = b[0] * c[1] - b[1] * c[0] < 0.0;
    if is_turned { [angle(c), angle(b)] } else { [angle(b), angle(c)] }
}

/// Rises with the angle of a direction, by 1 in a quarter turn: the same bits on every machine, unlike the angle.
fn angle([x, y]: [f64; 2]) -> f64 {
    let size = x.abs() + y.abs();
    let part = if size > 0.0 { y / size } else { 0.0 };
    match (x >= 0.0, y >= 0.0) {
        // Not -0, whose bits come last.
        (true, true) => part.abs(),
        (false, _) => 2.0 - part,
        (true, false) => 4.0 + part,
    }
}

/// A sector in one part, or in two where it holds the direction that angles begin with.
fn parts([start, end]: [f64; 2]) -> [Option<[f64; 2]>; 2] {
    if start <= end { [Some([start, end]), None] } else { [Some([start, 4.0]), Some([0.0, end])] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan of 8 around the origin, begun anywhere, is free; what lies over one of them is not.
    #[test]
    fn a_fan_is_free_and_what_lies_over_it_is_not() {
        let rim = |i: usize| {
            let (y, x) = (std::f64::consts::TAU * (i % 8) as f64 / 8.0 + 0.3).sin_cos();
            [x, y]
        };
        let mut sectors = Sectors::default();
        for i in [3, 4, 2, 7, 0, 1, 5] {
            let t = sector(&[rim(i), rim(i + 1), [0.0; 2]], 2);
            assert!(sectors.is_free(9, t), "{i}");
            sectors.take(9, t);
        }
        assert!(sectors.is_free(9, sector(&[[0.0; 2], rim(6), rim(7)], 0)));
        assert!(sectors.is_free(9, sector(&[[0.0; 2], rim(7), rim(6)], 0)), "turned over");
        for (a, b) in [(0, 1), (6, 8), (5, 7), (1, 3), (7, 8)] {
            assert!(!sectors.is_free(9, sector(&[[0.0; 2], rim(a), rim(b)], 0)), "{a} to {b}");
            assert!(sectors.is_free(8, sector(&[[0.0; 2], rim(a), rim(b)], 0)));
        }
        let triangles: Vec<[u32; 3]> = (0..300).map(|i| [i + 1, 0, i + 2]).collect();
        assert!(hubs(&triangles, 302).iter().all(|&hub| hub == (0, 1)));
        assert!(hubs(&triangles[..256], 302).iter().all(|&(hub, _)| hub == NONE));
    }
}
