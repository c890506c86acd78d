//! The kd-tree that says which cell a point belongs to.
//!
//! Points are quantised once to integers in the tree's own frame; every decision after that compares
//! integers. Frames of successive rounds are turned against each other, so that the seams of one round
//! cross those of the next instead of lying in them.
//!
//! docs/algorithm.md, section 10.

use crate::cell_id::CellId;
use serde::{Deserialize, Serialize};
use stonecut_mesh::bounds::Bounds;

/// Quantisation steps along the longest side of the bounding box.
const STEPS: f64 = (1u32 << 30) as f64;

/// A turned coordinate frame with integer coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TurnedFrame {
    axes: [[f64; 3]; 3],
    origin: [f64; 3],
    steps_per_unit: f64,
}

impl TurnedFrame {
    /// The frame of round `round` for points within `bounds`.
    pub fn new(round: u32, bounds: Bounds) -> TurnedFrame {
        let Bounds { low, high } = bounds;
        let origin = [0, 1, 2].map(|k| low[k] * 0.5 + high[k] * 0.5);
        let diagonal = bounds.diagonal();
        // Turned by any angle, the box stays within its diagonal. A single point still needs a scale.
        let steps_per_unit = if diagonal > 0.0 { STEPS / diagonal } else { 1.0 };
        TurnedFrame { axes: rotation(round), origin, steps_per_unit }
    }

    /// Integer coordinates of a point.
    #[inline]
    pub fn quantise(&self, point: [f64; 3]) -> [i32; 3] {
        let p = [0, 1, 2].map(|k| point[k] - self.origin[k]);
        self.axes.map(|a| floor((a[0] * p[0] + a[1] * p[1] + a[2] * p[2]) * self.steps_per_unit))
    }
}

/// The integer below; saturates. Without the call that `f64::floor` is on older processors.
#[inline]
pub(super) fn floor(x: f64) -> i32 {
    let towards_zero = x as i32;
    towards_zero.saturating_sub(i32::from(f64::from(towards_zero) > x))
}

/// Another rotation for each round; round 0 keeps the input's axes.
///
/// Quaternions of small integers: exact, the same on every machine, and for successive rounds about
/// different axes by angles that are not multiples of one another.
fn rotation(round: u32) -> [[f64; 3]; 3] {
    let [w, x, y, z]: [f64; 4] = match round % 4 {
        0 => [1.0, 0.0, 0.0, 0.0],
        1 => [7.0, 2.0, 1.0, 3.0],
        2 => [5.0, -1.0, 2.0, -3.0],
        _ => [6.0, 2.0, -3.0, 1.0],
    };
    let n = w * w + x * x + y * y + z * z;
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    .map(|row| row.map(|value| value / n))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Node {
    /// Coordinates below `split` along `axis` go to `low`, the others to `high`.
    axis: u8,
    split: i32,
    low: Child,
    high: Child,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Child {
    Node(u32),
    Cell(CellId),
}

/// Cells for `n_triangles` triangles, none of them planned above `cell_triangles`.
pub fn plan_cells(n_triangles: u64, cell_triangles: u64) -> u32 {
    n_triangles.div_ceil(cell_triangles.max(1)).clamp(1, u64::from(u32::MAX / 2)) as u32
}

/// Samples per planned cell; their cells then agree in size within about 3 %.
const SAMPLES_PER_CELL: u64 = 1024;

/// Returns the number of sample points (24 bytes each) for a tree for `n_cells` cells.
pub fn n_samples(n_vertices: u64, n_cells: u32) -> u64 {
    (u64::from(n_cells) * SAMPLES_PER_CELL).clamp(1, n_vertices.max(1))
}

/// Maps every point of space to one of `n_cells` cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "UncheckedTree")]
pub struct CellTree {
    frame: TurnedFrame,
    nodes: Vec<Node>,
    root: Child,
    n_cells: u32,
}

/// A tree as it was read from a record.
#[derive(Deserialize)]
struct UncheckedTree {
    frame: TurnedFrame,
    nodes: Vec<Node>,
    root: Child,
    n_cells: u32,
}

impl TryFrom<UncheckedTree> for CellTree {
    type Error = String;

    /// Refuses a tree in which a point would find no cell, or look for one without end.
    fn try_from(tree: UncheckedTree) -> Result<CellTree, String> {
        let UncheckedTree { frame, nodes, root, n_cells } = tree;
        let leads_on = |child: Child, above: Option<usize>| match child {
            Child::Cell(cell) => cell.0 < n_cells,
            // A node comes behind the one that leads to it.
            Child::Node(at) => {
                (at as usize) < nodes.len() && above.is_none_or(|above| at as usize > above)
            }
        };
        let is_sound = |(at, node): (usize, &Node)| {
            node.axis < 3 && leads_on(node.low, Some(at)) && leads_on(node.high, Some(at))
        };
        if !leads_on(root, None) || !nodes.iter().enumerate().all(is_sound) {
            return Err("its tree of cells leads nowhere".to_owned());
        }
        Ok(CellTree { frame, nodes, root, n_cells })
    }
}

impl CellTree {
    /// Cuts space so that each of at most `n_cells` cells holds about as many of `samples` as any other.
    ///
    /// Fewer cells come out where samples cannot be told apart. Time O(n log n); no memory beyond the samples.
    pub fn build(frame: TurnedFrame, samples: &[[f64; 3]], n_cells: u32) -> CellTree {
        let mut keys: Vec<[i32; 3]> = samples.iter().map(|&p| frame.quantise(p)).collect();
        let mut tree =
            CellTree { frame, nodes: Vec::new(), root: Child::Cell(CellId(0)), n_cells: 0 };
        tree.root = tree.cut(&mut keys, n_cells.max(1));
        tree
    }

    fn cut(&mut self, keys: &mut [[i32; 3]], n_cells: u32) -> Child {
        if n_cells > 1
            && let Some((axis, split, n_low)) = choose_cut(keys, n_cells)
        {
            let at = self.nodes.len();
            let open = Child::Cell(CellId(0));
            self.nodes.push(Node { axis, split, low: open, high: open });
            let (low, high) = keys.split_at_mut(n_low);
            let share =
                (f64::from(n_cells) * low.len() as f64 / (low.len() + high.len()) as f64).round();
            let low_cells = (share as u32).clamp(1, n_cells - 1);
            self.nodes[at].low = self.cut(low, low_cells);
            self.nodes[at].high = self.cut(high, n_cells - low_cells);
            return Child::Node(at as u32);
        }
        self.n_cells += 1;
        Child::Cell(CellId(self.n_cells - 1))
    }

    /// Number of cells.
    pub fn n_cells(&self) -> u32 {
        self.n_cells
    }

    /// The cell of a point.
    #[cfg(test)]
    fn cell_of(&self, point: [f64; 3]) -> CellId {
        self.finder().cell_of(point)
    }

    /// For many points one after the other.
    pub fn finder(&self) -> CellFinder<'_> {
        CellFinder { tree: self, cell: CellId(0), low: [i32::MAX; 3], high: [i32::MIN; 3] }
    }
}

/// Finds cells of points; fast where a point lies in the cell of the one before.
#[derive(Clone, Debug)]
pub struct CellFinder<'a> {
    tree: &'a CellTree,
    /// The cell of the last point, and its lowest and highest coordinates.
    cell: CellId,
    low: [i32; 3],
    high: [i32; 3],
}

impl CellFinder<'_> {
    /// The cell of a point.
    #[inline]
    pub fn cell_of(&mut self, point: [f64; 3]) -> CellId {
        let key = self.tree.frame.quantise(point);
        if !(0..3).all(|k| (self.low[k] <= key[k]) & (key[k] <= self.high[k])) {
            self.descend(key);
        }
        self.cell
    }

    fn descend(&mut self, key: [i32; 3]) {
        (self.low, self.high) = ([i32::MIN; 3], [i32::MAX; 3]);
        let mut child = self.tree.root;
        while let Child::Node(at) = child {
            let node = &self.tree.nodes[at as usize];
            let axis = node.axis as usize;
            if key[axis] < node.split {
                (child, self.high[axis]) = (node.low, node.split - 1);
            } else {
                (child, self.low[axis]) = (node.high, node.split);
            }
        }
        if let Child::Cell(cell) = child {
            self.cell = cell;
        }
    }
}

/// Axis, split and the number of keys below it; reorders `keys` accordingly. `None` if all keys are equal.
fn choose_cut(keys: &mut [[i32; 3]], n_cells: u32) -> Option<(u8, i32, usize)> {
    let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
    for key in keys.iter() {
        for k in 0..3 {
            low[k] = low[k].min(key[k]);
            high[k] = high[k].max(key[k]);
        }
    }
    // The longest side; ties go to the lower axis.
    let axis =
        (0..3).max_by_key(|&k| (i64::from(high[k]) - i64::from(low[k]), std::cmp::Reverse(k)))?;
    if keys.is_empty() || low[axis] == high[axis] {
        return None;
    }
    let rank = (keys.len() as u64 * u64::from(n_cells / 2) / u64::from(n_cells)) as usize;
    let (_, median, _) = keys.select_nth_unstable_by_key(rank.min(keys.len() - 1), |key| key[axis]);
    // At least one key must lie below the split.
    let split = median[axis].max(low[axis] + 1);
    let mut n_low = 0;
    for i in 0..keys.len() {
        if keys[i][axis] < split {
            keys.swap(i, n_low);
            n_low += 1;
        }
    }
    Some((axis as u8, split, n_low))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(n: usize) -> Vec<[f64; 3]> {
        // Three unrelated irrational steps: no two points alike, no direction preferred.
        (0..n)
            .map(|i| {
                [0.618_033_988, 0.754_877_666, 0.569_840_290]
                    .map(|s: f64| (i as f64 * s).fract() * 9.0)
            })
            .collect()
    }

    #[test]
    fn cells_are_even_in_every_frame() {
        let points = scattered(20_000);
        for round in 0..5 {
            let frame = TurnedFrame::new(round, Bounds::from([[0.0; 3], [9.0; 3]]));
            let tree = CellTree::build(frame, &points, 13);
            assert_eq!(tree.n_cells(), 13);
            let mut counts = vec![0; 13];
            points.iter().for_each(|&p| counts[tree.cell_of(p)] += 1);
            let even = 20_000 / 13;
            assert!(counts.iter().all(|&n| n > even * 8 / 10 && n < even * 12 / 10), "{counts:?}");
        }
    }

    #[test]
    fn the_order_of_points_does_not_matter() {
        let points = scattered(5_000);
        let tree =
            CellTree::build(TurnedFrame::new(1, Bounds::from([[0.0; 3], [9.0; 3]])), &points, 40);
        let mut finder = tree.finder();
        for p in &points {
            // Twice: once by descent, once in the cell of the point before.
            let near = p.map(|x| x + 1e-6);
            assert_eq!(
                [finder.cell_of(*p), finder.cell_of(near)],
                [tree.cell_of(*p), tree.cell_of(near)]
            );
        }
        for x in [-3.5, -3.0, -0.0, 2.0, 2.9, 1e300, -1e300, f64::from(i32::MIN) - 0.5] {
            assert_eq!(floor(x), x.floor() as i32, "{x}");
        }
    }

    #[test]
    fn a_forged_tree_is_refused() {
        let frame = TurnedFrame::new(0, Bounds::from([[0.0; 3], [9.0; 3]]));
        let tree = CellTree::build(frame, &scattered(500), 4);
        let good = serde_json::to_value(&tree).unwrap();
        assert_eq!(serde_json::from_value::<CellTree>(good.clone()).unwrap(), tree);
        let forge = |path: &str, value: serde_json::Value| {
            let mut forged = good.clone();
            *forged.pointer_mut(path).unwrap() = value;
            assert!(serde_json::from_value::<CellTree>(forged).is_err(), "{path}");
        };
        forge("/nodes/0/axis", 3.into());
        forge("/nodes/0/low", serde_json::json!({ "Node": 0 }));
        forge("/nodes/0/high", serde_json::json!({ "Node": 77 }));
        forge("/root", serde_json::json!({ "Node": 77 }));
        forge("/n_cells", 1.into());
        forge("/nodes", serde_json::json!([]));
    }

    #[test]
    fn points_that_cannot_be_told_apart_make_one_cell() {
        let frame = TurnedFrame::new(0, Bounds::from([[5.0; 3], [5.0; 3]]));
        let tree = CellTree::build(frame, &[[5.0; 3]; 100], 8);
        assert_eq!(tree.n_cells(), 1);
        assert_eq!(tree.cell_of([5.0; 3]), CellId(0));
        assert_eq!(CellTree::build(frame, &[], 8).n_cells(), 1);
    }
}
