//! Surfaces of which three sheets meet along a curve: they stay together, in one cell and in many, with labels or without.

use crate::common::expect;
use std::collections::BTreeMap;
use std::path::Path;
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};

/// Meridians, and parallels of which one is the equator.
const N: usize = 96;
const M: usize = 48;
/// Rings of the wall.
const K: usize = 16;

/// The radius of the ball, and of its equator.
fn radius(around: f64, down: f64) -> f64 {
    1.0 + 0.1 * (5.0 * around).sin() * down.sin()
}

/// A dented ball with a wall inside: the labels of its halves and of the wall, whose rim has vertices of its own if it is apart.
///
/// ```text
///     .--1--.
///    /       \
///   |----3----|      three triangles at each edge of the equator
///    \       /
///     '--2--'
/// ```
fn write_ball(path: &Path, labels: Option<[u32; 3]>, is_apart: bool) {
    let angle = |j: usize| std::f64::consts::TAU * j as f64 / N as f64;
    let mut places = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]];
    for i in 1..M {
        let down = std::f64::consts::PI * i as f64 / M as f64;
        places.extend((0..N).map(|j| {
            let r = radius(angle(j), down);
            [r * down.sin() * angle(j).cos(), r * down.sin() * angle(j).sin(), r * down.cos()]
        }));
    }
    for k in 1..K {
        let share = 1.0 - k as f64 / K as f64;
        places.extend((0..N).map(|j| {
            let r = share * radius(angle(j), std::f64::consts::FRAC_PI_2);
            [
                r * angle(j).cos(),
                r * angle(j).sin(),
                0.05 * (3.0 * share * 3.2).sin() * (1.0 - share),
            ]
        }));
    }
    let (rim, equator) = (places.len(), 3 + (M / 2 - 1) * N);
    if is_apart {
        places.extend_from_within(equator..equator + N);
    }
    let on_ball = |i: usize, j: usize| match i {
        0 => 0,
        M => 1,
        _ => 3 + (i - 1) * N + j % N,
    };
    let on_wall = |k: usize, j: usize| match k {
        0 if is_apart => rim + j % N,
        0 => on_ball(M / 2, j),
        K => 2,
        _ => 3 + (M - 1) * N + (k - 1) * N + j % N,
    };
    let mut faces = Vec::new();
    let mut square = |[a, b, c, d]: [usize; 4], sheet: usize| {
        let halves = [[a, b, c], [a, c, d]].into_iter();
        faces.extend(
            halves.filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).map(|t| (t, sheet)),
        );
    };
    for j in 0..N {
        for i in 0..M {
            let corners =
                [on_ball(i, j), on_ball(i + 1, j), on_ball(i + 1, j + 1), on_ball(i, j + 1)];
            square(corners, usize::from(i >= M / 2));
        }
        for k in 0..K {
            square([on_wall(k, j), on_wall(k + 1, j), on_wall(k + 1, j + 1), on_wall(k, j + 1)], 2);
        }
    }
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", places.len());
    text += "property double x\nproperty double y\nproperty double z\n";
    text += &format!("element face {}\nproperty list uchar int vertex_indices\n", faces.len());
    text += if labels.is_some() { "property int label\nend_header\n" } else { "end_header\n" };
    for [x, y, z] in places {
        text += &format!("{x} {y} {z}\n");
    }
    for ([a, b, c], sheet) in faces {
        let label = labels.map_or(String::new(), |labels| format!(" {}", labels[sheet]));
        text += &format!("3 {a} {b} {c}{label}\n");
    }
    std::fs::write(path, text).unwrap();
}

/// Edges between places, and the number of triangles at each.
fn edges(path: &Path) -> BTreeMap<[[u64; 3]; 2], u32> {
    let source = MeshSource::open(path).unwrap();
    let schema = source.schema();
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    source.read_vertices(0, &mut vertices).unwrap();
    let records = vertices.records.chunks_exact(schema.record_bytes());
    let places: Vec<_> = records.map(|record| schema.position(record).map(f64::to_bits)).collect();
    source.read_faces(0, &mut faces).unwrap();
    let mut edges = BTreeMap::new();
    for &[a, b, c] in &faces.triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let mut edge = [places[p as usize], places[q as usize]];
            edge.sort_unstable();
            *edges.entry(edge).or_default() += 1;
        }
    }
    edges
}

#[test]
fn a_wall_stays_joined_to_the_ball_around_it() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = [
        (None, false),
        (Some([1, 2, 3]), false),
        // The halves of the ball are one sheet, and the wall another that ends on it.
        (Some([1, 1, 3]), false),
        (None, true),
    ];
    for (labels, is_apart) in kinds {
        write_ball(&folder.path().join("ball.ply"), labels, is_apart);
        for (options, least) in [
            ("--ratio 20%", 30),
            ("--ratio 5%", 16),
            ("--ratio 2%", 8),
            ("--ratio 10% --topology keep", 20),
            ("--ratio 5% --cell-triangles 2k", 16),
            ("--ratio 20% --cell-triangles 1k", 30),
        ] {
            // Vertices in one place are joined where all of them are known.
            if is_apart && options.contains("cell") {
                continue;
            }
            let words = format!("simplify ball.ply small.ply {options} --force --restart");
            expect(folder.path(), &words, 0);
            let edges = edges(&folder.path().join("small.ply"));
            let n = |wanted: fn(u32) -> bool| edges.values().filter(|n| wanted(**n)).count();
            assert_eq!(n(|n| n == 1 || n > 3), 0, "{options}, {labels:?}, {is_apart}: closed");
            let on_curve = edges.iter().filter(|(_, n)| **n == 3);
            let mut at: BTreeMap<[u64; 3], u32> = BTreeMap::new();
            for (ends, _) in on_curve {
                for end in ends {
                    *at.entry(*end).or_default() += 1;
                    let [x, y, z] = end.map(f64::from_bits);
                    let off = x.hypot(y) - radius(y.atan2(x), std::f64::consts::FRAC_PI_2);
                    assert!(off.hypot(z) < 0.03, "{options}: {off} {z} off the curve");
                }
            }
            assert!(at.len() >= least && at.len() < N, "{options}: {} of {N} are left", at.len());
            assert!(at.values().all(|n| *n == 2), "{options}: one closed curve");
        }
    }
}
