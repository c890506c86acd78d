//! Finds all pairs of boxes that touch: a tree of halves over each list, gone through in pairs.
//!
//! Boxes keep the input's numbers, so nothing is rounded. Does not know triangles, cells or threads.

use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::steps::count;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Boxes in a leaf.
const LEAF: usize = 8;
/// Boxes between two looks at the wish to stop.
const STOP_ROWS: usize = 1 << 16;
/// Pairs of leaves between two looks at the wish to stop.
const STOP_PAIRS: u32 = 1 << 14;

/// A box and its number with the caller.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub bounds: Bounds,
    pub id: u32,
}

/// Boxes in the order of a tree that halves them `depth` times.
///
/// Memory: about 70 bytes a box.
pub(super) struct Boxes {
    items: Vec<Item>,
    /// The box of every node; the halves of node i are 2 i + 1 and 2 i + 2.
    hulls: Vec<Bounds>,
    depth: u32,
}

/// A node of a tree: its number, its level, its items.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    at: usize,
    level: u32,
    from: usize,
    to: usize,
}

impl Node {
    fn halves(self) -> [Node; 2] {
        let Node { at, level, from, to } = self;
        let middle = from + (to - from) / 2;
        let level = level + 1;
        [
            Node { at: 2 * at + 1, level, from, to: middle },
            Node { at: 2 * at + 2, level, from: middle, to },
        ]
    }
}

/// A part of the search for pairs.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoxTask(Node, Node);

impl Boxes {
    /// Bytes that the tree of `n` boxes takes at most.
    pub fn bytes(n: u64) -> u64 {
        n * size_of::<Item>() as u64 + (n / 2 + 2) * size_of::<Bounds>() as u64
    }

    /// Builds the tree.
    pub fn build(mut items: Vec<Item>, progress: &Progress) -> Result<Boxes> {
        let mut depth = 0;
        while items.len() >> depth >= LEAF {
            depth += 1;
        }
        let mut hulls = vec![Bounds::EMPTY; (2 << depth) - 1];
        let root = Node { at: 0, level: 0, from: 0, to: items.len() };
        sort(&mut items, root, depth, &mut hulls, progress)?;
        Ok(Boxes { items, hulls, depth })
    }

    /// The box of all.
    pub fn hull(&self) -> &Bounds {
        &self.hulls[0]
    }

    /// The numbers of all.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.items.iter().map(|item| item.id)
    }

    fn root(&self) -> Node {
        Node { at: 0, level: 0, from: 0, to: self.items.len() }
    }

    /// Cuts the search for pairs of these boxes among themselves into at least `n` tasks, if there are as many.
    pub fn tasks(&self, n: usize) -> Vec<BoxTask> {
        let mut tasks = vec![BoxTask(self.root(), self.root())];
        while tasks.len() < n {
            let mut finer = Vec::with_capacity(3 * tasks.len());
            tasks.iter().for_each(|&task| self.cut(self, true, task, &mut finer));
            if finer.len() == tasks.len() {
                break;
            }
            tasks = finer;
        }
        tasks
    }

    /// Calls `visit` for all touching pairs of a task of `tasks`, each once.
    pub fn pairs(
        &self,
        task: BoxTask,
        progress: &Progress,
        visit: impl FnMut(u32, u32),
    ) -> Result<()> {
        self.join(self, true, task, progress, visit)
    }

    /// Calls `visit` for all touching pairs of one of these boxes and one of the others.
    pub fn pairs_with(
        &self,
        other: &Boxes,
        progress: &Progress,
        visit: impl FnMut(u32, u32),
    ) -> Result<()> {
        self.join(other, false, BoxTask(self.root(), other.root()), progress, visit)
    }

    /// Appends what a task consists of; the task itself if it is of two leaves.
    fn cut(&self, other: &Boxes, is_same: bool, BoxTask(a, b): BoxTask, out: &mut Vec<BoxTask>) {
        if is_same && a.at == b.at {
            if a.level == self.depth {
                out.push(BoxTask(a, b));
                return;
            }
            let [left, right] = a.halves();
            out.extend([BoxTask(left, left), BoxTask(right, right)]);
            self.offer(other, BoxTask(left, right), out);
            return;
        }
        let (is_leaf, is_other_leaf) = (a.level == self.depth, b.level == other.depth);
        if is_leaf && is_other_leaf {
            out.push(BoxTask(a, b));
        } else if is_other_leaf || (!is_leaf && a.to - a.from >= b.to - b.from) {
            a.halves().into_iter().for_each(|half| self.offer(other, BoxTask(half, b), out));
        } else {
            b.halves().into_iter().for_each(|half| self.offer(other, BoxTask(a, half), out));
        }
    }

    fn offer(&self, other: &Boxes, task: BoxTask, out: &mut Vec<BoxTask>) {
        if self.hulls[task.0.at].touches(&other.hulls[task.1.at]) {
            out.push(task);
        }
    }

    fn join(
        &self,
        other: &Boxes,
        is_same: bool,
        task: BoxTask,
        progress: &Progress,
        mut visit: impl FnMut(u32, u32),
    ) -> Result<()> {
        let mut waiting = vec![task];
        let (mut n, mut n_visits) = (0, 0);
        while let Some(task) = waiting.pop() {
            let BoxTask(a, b) = task;
            if a.level < self.depth || b.level < other.depth {
                self.cut(other, is_same, task, &mut waiting);
                continue;
            }
            n += 1;
            if n % STOP_PAIRS == 0 {
                progress.check()?;
            }
            for (i, item) in self.items[a.from..a.to].iter().enumerate() {
                let first = if is_same && a.at == b.at { b.from + i + 1 } else { b.from };
                if !item.bounds.touches(&other.hulls[b.at]) {
                    continue;
                }
                for near in &other.items[first..b.to] {
                    if item.bounds.touches(&near.bounds) {
                        n_visits += 1;
                        visit(item.id, near.id);
                    }
                }
            }
        }
        count(n_visits);
        Ok(())
    }
}

/// Sorts the items below a node into the order of the tree.
fn sort(
    items: &mut [Item],
    node: Node,
    depth: u32,
    hulls: &mut [Bounds],
    progress: &Progress,
) -> Result<()> {
    if items.len() > STOP_ROWS {
        progress.check()?;
    }
    let hull = items.iter().fold(Bounds::EMPTY, |hull, item| hull.joined(&item.bounds));
    hulls[node.at] = hull;
    if node.level == depth {
        return Ok(());
    }
    // Twice the centre; a sum of finite numbers may be infinite, which does no harm to an order.
    let centre = |item: &Item, k: usize| item.bounds.low[k] + item.bounds.high[k];
    let extent = |k: usize| {
        let range = items.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |range, item| {
            let x = centre(item, k);
            (range.0.min(x), range.1.max(x))
        });
        range.1 - range.0
    };
    let extents = [0, 1, 2].map(extent);
    let axis = if extents[0] >= extents[1] && extents[0] >= extents[2] {
        0
    } else if extents[1] >= extents[2] {
        1
    } else {
        2
    };
    let [left, right] = node.halves();
    let middle = left.to - left.from;
    if middle < items.len() {
        items.select_nth_unstable_by(middle, |a, b| centre(a, axis).total_cmp(&centre(b, axis)));
    }
    let (low, high) = items.split_at_mut(middle);
    sort(low, left, depth, hulls, progress)?;
    sort(high, right, depth, hulls, progress)
}
