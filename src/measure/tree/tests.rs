//! Answers are those of a plain search, bit for bit, and their work hardly grows.

#![allow(clippy::unwrap_used)] // A test fails by panicking.
#![allow(clippy::print_stdout)] // Figures for whoever asks with --nocapture.

use super::*;

fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

fn soup(n: usize, size: f64, far: f64, seed: u64) -> Vec<[Vector; 3]> {
    let mut state = seed;
    (0..n)
        .map(|_| {
            let at = [0; 3].map(|_| random(&mut state) + far);
            [0; 3].map(|_| at.map(|x| x + size * (random(&mut state) - 0.5)))
        })
        .collect()
}

fn brute(point: Vector, soup: &[[Vector; 3]]) -> f64 {
    let distance = |t: &[Vector; 3]| triangle::closest(point, &triangle::canonical(*t)).0;
    soup.iter().map(distance).fold(f64::INFINITY, f64::min)
}

#[test]
fn answers_equal_a_plain_search_bit_for_bit() {
    for (n, size, far) in [
        (0, 0.1, 0.0),
        (1, 0.1, 0.0),
        (8, 1.0, 0.0),
        (9, 0.1, 1e7),
        (700, 0.05, 0.0),
        (700, 0.0, 5.0),
        (3000, 0.5, 1e6),
    ] {
        let soup = soup(n, size, far, 42);
        let tree = Tree::build(n, |i| soup[i]);
        assert_eq!(tree.len(), n);
        let mut state = 7;
        let mut hint = 0;
        for i in 0..300 {
            let reach = if i % 3 == 0 { 1e12 } else { 1.2 };
            let p = [0; 3].map(|_| far + reach * (random(&mut state) - 0.1));
            let plain = brute(p, &soup);
            let found = tree.nearest(p, Nearest::NONE);
            assert_eq!(found.distance_sq, plain, "{n} {size} {far}");
            assert_eq!(found.is_found(), n > 0);
            let (guess, accepts) = (Nearest::NONE, |_: &[Vector; 3]| true);
            let narrow =
                TreeSearch { tree: &tree, point: p, guess, enough_sq: -1.0, accepts, look: || {} };
            assert_eq!(narrow.run(), found, "wide registers change nothing");
            assert_eq!(tree.nearest(p, tree.guess(p, hint)), found, "a guess changes nothing");
            hint = found.slot;
            let within = tree.nearest_unless_within(p, Nearest::NONE, plain * 1.5);
            assert!(within.distance_sq <= plain * 1.5);
            let enough = plain * 0.5;
            assert_eq!(tree.nearest_unless_within(p, Nearest::NONE, enough), found);
        }
    }
}

#[test]
fn of_equally_near_triangles_the_first_by_corners_wins() {
    // Four triangles around a common corner; the query stands on it.
    let ring = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
    let fan: Vec<[Vector; 3]> = (0..4)
        .map(|i| {
            let (a, b): ([f64; 2], [f64; 2]) = (ring[i], ring[(i + 1) % 4]);
            [[0.0; 3], [a[0], a[1], 0.0], [b[0], b[1], 0.0]]
        })
        .collect();
    for first in 0..4 {
        let tree = Tree::build(4, |i| triangle::rotate(fan[(i + first) % 4], i % 3));
        let found = tree.nearest([0.0, 0.0, 0.0], Nearest::NONE);
        let least = fan
            .iter()
            .map(|t| triangle::canonical(*t))
            .fold([[f64::INFINITY; 3]; 3], |least, t| if t < least { t } else { least });
        assert_eq!(*tree.corners(found.slot), least);
    }
}

/// Families of triangles whose upright boxes hold each other, `n` of each.
fn overlapping(n: usize) -> Vec<(&'static str, Vec<[Vector; 3]>)> {
    let turn = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
    let rim = |i: usize| [turn(i).cos(), turn(i).sin(), 0.0];
    let over = |p: Vector, z: f64| [p[0], p[1], z];
    let slanted = |p: Vector| {
        let d = [0.48, 0.6, 0.64];
        [0, 1, 2].map(|k| 1e-2 * p[k] + d[k] * p[2])
    };
    let all = |f: &dyn Fn(usize) -> [Vector; 3]| (0..n).map(f).collect::<Vec<_>>();
    let one = [[0.1, 0.2, 0.3], [1.0, 0.0, 0.1], [0.0, 1.0, 0.4]];
    vec![
        ("flat fan", all(&|i| [[0.0; 3], rim(i), rim(i + 1)])),
        ("cone", all(&|i| [[0.0, 0.0, 1.5], rim(i), rim(i + 1)])),
        ("pages", all(&|i| [[0.0; 3], [0.0, 0.0, 1.0], rim(i)])),
        (
            "half a book",
            all(&|i| {
                let a = 0.5 * turn(i) + 0.1;
                [[0.0; 3], [0.0, 0.0, 1.0], [a.cos(), a.sin(), 0.3]]
            }),
        ),
        (
            "slanted tube",
            all(&|i| [over(rim(i), 0.0), over(rim(i + 1), 0.0), over(rim(i), 1.0)].map(slanted)),
        ),
        (
            "star",
            all(&|i| {
                let p = [0.5 * turn(i).cos(), 0.5 * turn(i).sin(), 0.0];
                let w = [-1e-6 * p[1], 1e-6 * p[0], 0.0];
                [0, 1, 2].map(|j| [0, 1, 2].map(|k| [p[k] + w[k], p[k] - w[k], -2.0 * p[k]][j]))
            }),
        ),
        ("one many times", all(&|_| one)),
        ("one both ways round", all(&|i| if i % 2 == 0 { one } else { [one[0], one[2], one[1]] })),
    ]
}

fn queries(soup: &[[Vector; 3]], n: usize) -> Vec<Vector> {
    let mut state = 11;
    let on = |i: usize, state: &mut u64| {
        let t = &soup[i * 7919 % soup.len()];
        let (u, v) = (random(state), random(state));
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        triangle::point_at(t, [1.0 - u - v, u, v])
    };
    (0..n)
        .map(|i| match i % 4 {
            0 | 1 => on(i, &mut state),
            2 => on(i, &mut state).map(|x| x + 1e-4 * (random(&mut state) - 0.5)),
            _ => [0; 3].map(|_| 6.0 * random(&mut state) - 3.0),
        })
        .collect()
}

#[test]
fn triangles_that_overlap_are_found_as_by_a_plain_search() {
    for (name, soup) in overlapping(700) {
        let tree = Tree::build(soup.len(), |i| soup[i]);
        let mut corners = soup.iter().flatten().copied().collect::<Vec<_>>();
        corners.truncate(30);
        let mut hint = 0;
        for p in queries(&soup, 300).into_iter().chain(corners) {
            let found = tree.nearest(p, Nearest::NONE);
            assert_eq!(found.distance_sq, brute(p, &soup), "{name} at {p:?}");
            assert_eq!(tree.nearest(p, tree.guess(p, hint)), found, "{name} at {p:?}");
            let t = triangle::canonical(soup[tree.id(found.slot) as usize]);
            assert_eq!(t, *tree.corners(found.slot), "{name}");
            hint = found.slot;
        }
    }
}

/// Looks at boxes and triangles, not seconds: a query takes about as many at four times the triangles.
#[test]
fn the_work_of_a_query_hardly_grows() {
    let mean = |soup: &[[Vector; 3]]| {
        let tree = Tree::build(soup.len(), |i| soup[i]);
        let queries = queries(soup, 400);
        queries.iter().map(|&p| tree.looks(p)).sum::<u64>() as f64 / 400.0
    };
    for (few, many) in overlapping(4000).iter().zip(&overlapping(16_000)) {
        let (a, b) = (mean(&few.1), mean(&many.1));
        println!("{}: {a:.0} -> {b:.0} looks a query", few.0);
        // Needles that cross in one point and share no corner: nothing but the root is promised.
        let growth = if few.0 == "star" { 2.5 } else { 1.5 };
        // Fewer than 64 are what a query takes among triangles that do not overlap.
        assert!(b < growth * a.max(64.0), "{}: {a} looks a query become {b}", few.0);
        assert!(b < 1000.0, "{}: {b} looks a query", few.0);
    }
}
