//! Points of a grid that lie in a triangle on a page; those of several triangles that lie in the same cell.
//!
//! Triangles at an edge share it: every point between them is in exactly one. Knows no colours.

use std::ops::Range;

/// Area of a triangle on a page.
pub(super) fn area(t: &[[f32; 2]; 3]) -> f64 {
    let [a, b, c] = t.map(|at| at.map(f64::from));
    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
}

/// The length of the longest edge.
pub(super) fn longest([a, b, c]: &[[f64; 2]; 3]) -> f64 {
    let length_sq = |p: &[f64; 2], q: &[f64; 2]| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2);
    length_sq(a, b).max(length_sq(b, c)).max(length_sq(c, a)).sqrt()
}

/// Calls `each` with the points of a grid of `side` by `side` points a texel that lie in a triangle, and their
/// barycentric coordinates, in the texels of some rows.
pub(super) fn each_point(
    t: &[[f64; 2]; 3],
    side: u32,
    rows: Range<u32>,
    mut each: impl FnMut(f64, f64, [f64; 3]),
) {
    let [a, b, c] = *t;
    let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if twice == 0.0 || !twice.is_finite() {
        return;
    }
    let n = f64::from(side);
    let at = |k: i64| (k as f64 + 0.5) / n;
    // The first point at or behind a coordinate.
    let from = |x: f64| (x * n - 0.5).ceil() as i64;
    let low = t.iter().fold(f64::INFINITY, |low, p| low.min(p[1]));
    let high = t.iter().fold(f64::NEG_INFINITY, |high, p| high.max(p[1]));
    let first = from(low).max(i64::from(rows.start) * i64::from(side));
    let end = from(high).min(i64::from(rows.end) * i64::from(side));
    for k in first..end {
        let y = at(k);
        let mut span = [f64::INFINITY, f64::NEG_INFINITY];
        for (p, q) in [(a, b), (b, c), (c, a)] {
            // Both triangles at an edge follow it from the same end.
            let (p, q) = if (p[1], p[0]) < (q[1], q[0]) { (p, q) } else { (q, p) };
            if p[1] <= y && y < q[1] {
                let x = p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0]);
                span = [span[0].min(x), span[1].max(x)];
            }
        }
        if span[0] > span[1] {
            continue;
        }
        for j in from(span[0])..from(span[1]) {
            let x = at(j);
            let v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice;
            let w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice;
            each(x, y, [1.0 - v - w, v, w]);
        }
    }
}

/// Calls `each` with every cell that any of `n` points lie in, row by row: its row, its column and the numbers of the points.
pub(super) fn each_cell(
    n: usize,
    cell: impl Fn(usize) -> [u32; 2],
    mut each: impl FnMut([u32; 2], &[u32]),
) {
    const NONE: u32 = u32::MAX;
    let all = |fold: fn(u32, u32) -> u32| (0..n).map(|i| cell(i)[0]).reduce(fold);
    let (Some(first), Some(last)) = (all(u32::min), all(u32::max)) else { return };
    // Columns of every row.
    let mut spans = vec![[NONE, 0]; (last - first) as usize + 1];
    for i in 0..n {
        let [row, column] = cell(i);
        let span = &mut spans[(row - first) as usize];
        *span = [span[0].min(column), span[1].max(column + 1)];
    }
    let mut starts = Vec::with_capacity(spans.len());
    let mut n_cells = 0;
    for [low, end] in &spans {
        starts.push(n_cells);
        n_cells += end.saturating_sub(*low) as usize;
    }
    // The first point of each cell, and behind each point the next of the same cell.
    let (mut heads, mut behind) = (vec![NONE; n_cells], vec![NONE; n]);
    for i in (0..n).rev() {
        let [row, column] = cell(i);
        let row = (row - first) as usize;
        let head = &mut heads[starts[row] + (column - spans[row][0]) as usize];
        (behind[i], *head) = (*head, i as u32);
    }
    let mut same = Vec::new();
    for ((row, span), start) in (first..).zip(&spans).zip(starts) {
        for (column, &head) in (span[0]..span[1]).zip(&heads[start..]) {
            let mut next = head;
            same.clear();
            while next != NONE {
                same.push(next);
                next = behind[next as usize];
            }
            if !same.is_empty() {
                each([row, column], &same);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 5 by 5 texels, cut along its diagonal at odd places.
    #[test]
    fn triangles_share_the_points_of_a_square() {
        let [a, b, c, d] = [[0.3, 0.2], [5.3, 0.2], [5.3, 5.2], [0.3, 5.2]];
        let mut found = Vec::new();
        for t in [[a, b, c], [a, c, d]] {
            each_point(&t, 2, 0..10, |x, y, weights| {
                let back = [0, 1].map(|k| (0..3).map(|i| weights[i] * t[i][k]).sum::<f64>());
                assert!((back[0] - x).abs() < 1e-9 && (back[1] - y).abs() < 1e-9);
                assert!(weights.iter().all(|&w| w > -1e-9), "{weights:?}");
                found.push([(2.0 * x) as i32, (2.0 * y) as i32]);
            });
        }
        let n = found.len();
        found.sort_unstable();
        found.dedup();
        assert_eq!((n, found.len()), (100, 100));
        // Rows of the middle only, and the same points there.
        let mut some = 0;
        for t in [[a, b, c], [a, c, d]] {
            each_point(&t, 2, 2..3, |_, y, _| {
                assert_eq!(y as u32, 2);
                some += 1;
            });
        }
        assert_eq!(some, 20);
    }

    #[test]
    fn points_come_cell_by_cell() {
        let cells = [[7, 3], [5, 9], [7, 3], [7, 1], [5, 2], [7, 3], [9, 0]];
        let mut found = Vec::new();
        each_cell(cells.len(), |i| cells[i], |cell, same| found.push((cell, same.to_vec())));
        let expected =
            [([5, 2], vec![4]), ([5, 9], vec![1]), ([7, 1], vec![3]), ([7, 3], vec![0, 2, 5])];
        assert_eq!(found[..4], expected);
        assert_eq!(found[4..], [([9, 0], vec![6])]);
        each_cell(0, |_| [0, 0], |_, _| panic!("none is there"));
    }
}
