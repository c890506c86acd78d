//! Bounds of steps between sheets whose distance is known.

use super::*;

fn sheet(n: usize, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let at = |i: usize| {
        let (x, y) = ((i % (n + 1)) as f64 / n as f64, (i / (n + 1)) as f64 / n as f64);
        [x, y, height(x, y)]
    };
    let positions = (0..(n + 1) * (n + 1)).map(at).collect();
    let mut triangles = Vec::new();
    for i in 0..n * n {
        let a = (i / n * (n + 1) + i % n) as u32;
        let n = n as u32;
        triangles.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
    }
    Mesh::new(positions, triangles)
}

#[test]
fn a_bound_is_never_below_the_distance_and_not_far_above() {
    let flat = sheet(4, |_, _| 0.0);
    let spike = |x: f64, y: f64| if (x, y) == (0.5, 0.5) { 0.3 } else { 0.0 };
    for (fine, far) in [
        (sheet(16, |_, _| 0.0), 0.0),
        (sheet(16, spike), 0.3),
        (sheet(16, |_, _| 0.02), 0.02),
        (sheet(50, |x, y| 0.1 * x * y), 0.1),
    ] {
        // Where every vertex went; nothing; what is wrong; what is wrong for a part and missing for another.
        let near = |a: [f64; 3], mesh: &Mesh| {
            let off = |b: &[f64; 3]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
            let all = (0u32..).zip(&mesh.positions);
            all.min_by(|a, b| off(a.1).total_cmp(&off(b.1))).unwrap().0
        };
        let right: Vec<u32> = fine.positions.iter().map(|&p| near(p, &flat)).collect();
        let wrong = vec![3; fine.positions.len()];
        let mixed =
            (0u32..).zip(&right).map(|(i, &v)| [v, 0, u32::MAX, 7][i as usize % 4]).collect();
        for followed in [right, Vec::new(), wrong, mixed] {
            let bound = deviation(&fine, &flat, &followed, 1.25);
            // Corners on edges of the other mesh may name triangles that do not hold the piece: the last halving counts.
            assert!(bound >= far && bound <= 1.27 * far + 0.5 / 1024.0, "{bound} {far}");
        }
        // The other way round: large triangles over small ones.
        let back: Vec<u32> = flat.positions.iter().map(|&p| near(p, &fine)).collect();
        let bound = deviation(&flat, &fine, &back, 1.25);
        assert!(bound >= far && bound <= 1.27 * far + 0.5 / 1024.0, "{bound} {far}");
    }
}

#[test]
fn wide_registers_change_no_bit() {
    let height = |x: f64, y: f64| 0.1 * (7.0 * x).sin() * (5.0 * y).cos();
    let (fine, coarse) = (sheet(40, height), sheet(10, height));
    let hints: Vec<u32> = (0..41 * 41).map(|v| (v / 41 + 2) / 4 * 11 + (v % 41 + 2) / 4).collect();
    let (n, around) = (coarse.positions.len(), Around::vertices(&coarse));
    let patches = Patches::new(&fine, &hints, n);
    let forward = Forward { fine: &fine, coarse: &coarse, around: &around };
    let wide = Covered::find(&forward, &patches, &hints);
    let mut narrow = Covered { most: vec![f64::INFINITY; fine.triangles.len()], rest: Vec::new() };
    narrow.whole(&forward, &patches);
    let over_stars = narrow.most.iter().zip(&wide.most).filter(|(narrow, _)| narrow.is_finite());
    assert!(over_stars.clone().count() > fine.triangles.len() / 2);
    assert!(over_stars.clone().all(|(narrow, wide)| narrow == wide));
    for limit in [1e-3, 1e-2, 3e-2] {
        let [mut wide, mut narrow] =
            [0; 2].map(|_| within::Within::new(&fine, (&patches, n), &hints, limit));
        for t in 0..coarse.triangles.len() {
            let (places, own) = (coarse.corners(t), coarse.triangles[t]);
            assert!(wide.look(&places, own) == narrow.look_wide(&places, own), "{limit} {t}");
        }
    }
}

#[test]
fn nothing_done_is_no_distance() {
    let sheet = sheet(9, |x, y| x * y);
    assert!(deviation(&sheet, &sheet.clone(), &[], 1.25) < 1e-12);
}

#[test]
fn what_the_mesh_does_not_cover_counts() {
    // A strip is missing in the middle of the mesh: all vertices of its version, and most of its places, are on it.
    let mut fine = sheet(16, |_, _| 0.0);
    let positions = fine.positions.clone();
    fine.triangles.retain(|t| {
        let x: f64 = t.iter().map(|&v| positions[v as usize][0]).sum::<f64>() / 3.0;
        !(0.375..0.625).contains(&x)
    });
    for n in [1, 2, 8] {
        let coarse = sheet(n, |_, _| 0.0);
        let near = |a: &[f64; 3]| {
            let off = |b: &[f64; 3]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
            let all = (0u32..).zip(&coarse.positions);
            all.min_by(|a, b| off(a.1).total_cmp(&off(b.1))).unwrap().0
        };
        let followed: Vec<u32> = fine.positions.iter().map(near).collect();
        for followed in [followed, Vec::new()] {
            let bound = deviation(&fine, &coarse, &followed, 1.25);
            let near = 0.125..=1.27 * 0.125 + 0.5 / 1024.0;
            assert!(near.contains(&bound), "{n}: {bound}");
        }
    }
}

#[test]
fn borders_that_have_moved_and_holes_count() {
    let fine = sheet(16, |_, _| 0.0);
    let near = |a: &[f64; 3], mesh: &Mesh| {
        let off = |b: &[f64; 3]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        let all = (0u32..).zip(&mesh.positions);
        all.min_by(|a, b| off(a.1).total_cmp(&off(b.1))).unwrap().0
    };
    let follow = |fine: &Mesh, coarse: &Mesh| -> Vec<u32> {
        fine.positions.iter().map(|p| near(p, coarse)).collect()
    };
    // A larger and a smaller sheet: a corner is farthest off.
    for (n, size) in [(1, 1.05), (4, 1.05), (8, 1.002), (4, 0.95)] {
        let mut coarse = sheet(n, |_, _| 0.0);
        coarse.positions.iter_mut().for_each(|p| *p = p.map(|x| x * size));
        let far = 2f64.sqrt() * (size - 1.0).abs();
        let bound = deviation(&fine, &coarse, &follow(&fine, &coarse), 1.25);
        assert!(bound >= far && bound <= 1.27 * far + 0.5 / 1024.0, "{n} {size}: {bound} {far}");
    }
    // What is around a vertex is missing: its middle is 0.7 sides from the rest.
    let middle = 8 * 17 + 8;
    let mut open = fine;
    open.triangles.retain(|t| !t.contains(&middle));
    let far = 0.5f64.sqrt() / 16.0;
    for n in [1, 4, 8] {
        let coarse = sheet(n, |_, _| 0.0);
        let bound = deviation(&open, &coarse, &follow(&open, &coarse), 1.25);
        assert!(bound >= far && bound <= 1.27 * far + 0.5 / 1024.0, "{n}: {bound} {far}");
    }
}

/// ```text
///   3---2   Both triangles go into vertex 0 with all their corners, so their border is that of the patch; into vertices
///   | / |   0 and 1 with a corner each, and two common ones, only what is loose there counts.
///   0---1
/// ```
#[test]
fn borders_of_patches() {
    let mesh = Mesh::new(vec![[0.0; 3]; 4], vec![[0, 1, 2], [0, 2, 3]]);
    let edges = |hints: [u32; 4], v: u32| {
        let patches = Patches::new(&mesh, &hints, 4);
        let border = patches.border(v).unwrap();
        let named = |edges: &[[u16; 2]]| {
            let name = |k: u16| patches.vertices(v)[usize::from(k)];
            let mut named: Vec<[u32; 2]> = edges.iter().map(|edge| edge.map(name)).collect();
            named.sort_unstable();
            named
        };
        (named(border.rim), named(border.loose))
    };
    assert_eq!(edges([0; 4], 0), (vec![], vec![[0, 1], [1, 2], [2, 3], [3, 0]]));
    assert_eq!(edges([0; 4], 1), (vec![], vec![]));
    assert_eq!(edges([0, 1, 2, 2], 0), (vec![[1, 2], [2, 3]], vec![[0, 1], [3, 0]]));
    assert_eq!(edges([0, 1, 2, 2], 1), (vec![[2, 0]], vec![[0, 1], [1, 2]]));
    assert_eq!(edges([0, 1, 2, 2], 2), (vec![[0, 1]], vec![[1, 2], [2, 3], [3, 0]]));
}
