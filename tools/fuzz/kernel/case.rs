//! A mesh with its locks and its options, as `simplify_mesh` takes them.

use super::choices::Choices;
use super::{blocks, spoil};
use stonecut::kernel::{Fit, Options, Placement, Stop, Topology};
use stonecut::mesh::Mesh;

/// What is judged.
#[derive(Clone, Debug)]
pub struct Case {
    pub mesh: Mesh,
    pub locked: Vec<bool>,
    pub options: Options,
}

impl Case {
    /// Makes a case of up to a few hundred triangles.
    pub fn new(choices: &mut Choices) -> Case {
        let mut mesh = Mesh::default();
        for _ in 0..choices.of(&[1, 1, 1, 2, 2, 3, 5]) {
            blocks::add(&mut mesh, choices);
        }
        for _ in 0..choices.of(&[0, 0, 1, 1, 2, 3, 6]) {
            spoil::spoil(&mut mesh, choices);
        }
        let has_charts = choices.one_in(4);
        if has_charts && choices.one_in(2) {
            spoil::cut(&mut mesh, choices);
        }
        add_channels(&mut mesh, choices, has_charts);
        if choices.one_in(6) {
            spoil::stretch(&mut mesh, choices);
        }
        let locked = locks(&mesh, choices);
        let options = options(&mesh, choices, has_charts);
        Case { mesh, locked, options }
    }
}

fn add_channels(mesh: &mut Mesh, choices: &mut Choices, has_charts: bool) {
    let n = match choices.below(10) {
        _ if has_charts => choices.within(1..4),
        0..5 => 0,
        9 => choices.within(4..18),
        _ => choices.within(1..4),
    };
    mesh.n_channels = n;
    let kinds: Vec<usize> = (0..n).map(|_| choices.below(7)).collect();
    for (v, p) in mesh.positions.iter().enumerate() {
        for &kind in &kinds {
            mesh.channels.push(match kind {
                0 => 7.0,
                1 => (p[0] + 2.0 * p[1] - p[2]) as f32,
                2 => choices.unit() as f32,
                3 => (p[0] * 2.0).floor() as f32,
                4 => v as f32,
                5 => choices.of(&[0.0, -0.0, 1e30, -1e30, 1e-30, 255.0]),
                _ => (v / 8) as f32,
            });
        }
    }
}

fn locks(mesh: &Mesh, choices: &mut Choices) -> Vec<bool> {
    let n = mesh.positions.len();
    match choices.below(8) {
        0 => {
            let share = choices.within(2..12);
            (0..n).map(|_| choices.one_in(share)).collect()
        }
        // As between cells: whatever a triangle on the other side of a plane uses, too.
        1 | 2 => {
            let (axis, at) = (choices.below(3), choices.below(8) as f64 * 0.5);
            mesh.positions.iter().map(|p| (p[axis] - at).abs() < 0.3).collect()
        }
        3 => vec![choices.one_in(3); n],
        4 => {
            let (axis, at) = (choices.below(3), choices.below(8) as f64 * 0.5);
            mesh.positions.iter().map(|p| p[axis] > at).collect()
        }
        _ => vec![false; n],
    }
}

fn options(mesh: &Mesh, choices: &mut Choices, has_charts: bool) -> Options {
    let n = mesh.triangles.len() as u64;
    let levels = |choices: &mut Choices| {
        let mut cost = choices.of(&[0.0, 1e-12, 1e-6, 1e-3, 1e-200, 1e100]);
        let factor = choices.of(&[1.0, 1.1, 2.0, 1e3]);
        (0..choices.within(0..6))
            .map(|_| {
                cost *= factor;
                cost
            })
            .collect()
    };
    let stop = match choices.below(12) {
        0 => Stop::Costs(levels(choices)),
        1 => Stop::CloseCosts(levels(choices)),
        2 => Stop::Triangles(u64::MAX),
        3 => Stop::Triangles(choices.of(&[0, 1, 2, 3, 4])),
        _ => Stop::Triangles(choices.below(n.max(1) as usize) as u64),
    };
    let n_channels = mesh.n_channels;
    let weights = match choices.below(3) {
        0 => Vec::new(),
        1 => (0..n_channels).map(|_| choices.of(&[0.0, 0.01, 1.0, 1e-20, 1e20])).collect(),
        _ => vec![choices.of(&[0.01, 0.5]); n_channels],
    };
    let confined = match choices.below(4) {
        _ if has_charts => (0..n_channels).map(|c| c == 0 || choices.one_in(2)).collect(),
        0 => (0..n_channels).map(|_| choices.one_in(2)).collect(),
        _ => Vec::new(),
    };
    Options {
        stop,
        topology: choices.of(&[Topology::Error, Topology::Error, Topology::Keep]),
        fit: choices.of(&[Fit::Off, Fit::On, Fit::Auto]),
        placement: choices.of(&[
            Placement::Optimal,
            Placement::Optimal,
            Placement::Optimal,
            Placement::Subset,
            Placement::Midpoint,
        ]),
        merge_distance: choices.of(&[0.0, 0.0, 0.0, 0.0, 0.1, 1.0, 1e-30, 1e30]),
        weights,
        confined,
        region: if choices.one_in(4) { Some(choices.below(3)) } else { None },
        seam_share: choices.of(&[0.0, 0.01, 1.0]),
        estimate: choices.one_in(4),
        no_self_intersections: choices.one_in(5),
        ..Options::default()
    }
}
