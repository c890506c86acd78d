//! Boxes of tiles: a kd-tree over a sample of vertices, whose leaves hold equally many.

use stonecut_mesh::bounds::Bounds;

/// Boxes that fill space, numbered from one corner to the other; each may reach into its neighbours.
pub(super) struct Boxes {
    root: Node,
    n_boxes: u64,
}

enum Node {
    /// Places with less than `at` on an axis lie in `low`; boxes below reach at most `reach` across.
    Cut { axis: usize, at: f64, reach: f64, low: Box<Node>, high: Box<Node> },
    /// A box, with the margin by which it reaches into its neighbours.
    Leaf { number: u32, grown: Bounds },
}

impl Boxes {
    /// Cuts `bounds` into boxes with equally many of `points`; `overlap` is the margin as a share of a box's sides.
    pub(super) fn new(points: &mut [[f64; 3]], bounds: &Bounds, n: u64, overlap: f64) -> Boxes {
        let mut n_boxes = 0;
        let root = Node::new(points, *bounds, (n, overlap), &mut n_boxes);
        Boxes { root, n_boxes: u64::from(n_boxes) }
    }

    /// Number of boxes; fewer than were asked for where points are too few.
    pub(super) fn n_boxes(&self) -> u64 {
        self.n_boxes
    }

    /// The box that a place lies in, margins aside.
    pub(super) fn home(&self, p: [f64; 3]) -> u32 {
        let mut node = &self.root;
        loop {
            match node {
                Node::Leaf { number, .. } => return *number,
                Node::Cut { axis, at, low, high, .. } => {
                    node = if p[*axis] < *at { low } else { high };
                }
            }
        }
    }

    /// Hands on its own box and all that reach as far as a place, in ascending order.
    pub(super) fn all(&self, p: [f64; 3], found: &mut Vec<u32>) {
        found.clear();
        self.root.all(p, true, found);
    }
}

impl Node {
    fn new(
        points: &mut [[f64; 3]],
        own: Bounds,
        (n, overlap): (u64, f64),
        n_boxes: &mut u32,
    ) -> Node {
        let side = |axis: usize| own.high[axis] - own.low[axis];
        let axis = (1..3).fold(0, |longest, k| if side(k) > side(longest) { k } else { longest });
        let n_low = n / 2;
        let middle = (points.len() as u64 * n_low / n.max(1)) as usize;
        let at = (middle > 0 && n > 1).then(|| {
            points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis]
        });
        // A cut through a side leaves something on both of its sides only inside of it.
        let Some(at) = at.filter(|&at| own.low[axis] < at && at < own.high[axis]) else {
            let number = *n_boxes;
            *n_boxes += 1;
            let reach = |k: usize| overlap * side(k);
            let low = [0, 1, 2].map(|k| own.low[k] - reach(k));
            let high = [0, 1, 2].map(|k| own.high[k] + reach(k));
            return Node::Leaf { number, grown: Bounds { low, high } };
        };
        let (mut below, mut above) = (own, own);
        (below.high[axis], above.low[axis]) = (at, at);
        let (first, second) = points.split_at_mut(middle);
        let low = Box::new(Node::new(first, below, (n_low, overlap), n_boxes));
        let high = Box::new(Node::new(second, above, (n - n_low, overlap), n_boxes));
        // No side below is longer than those of this box.
        let reach = overlap * side(axis);
        Node::Cut { axis, at, reach, low, high }
    }

    fn all(&self, p: [f64; 3], is_home: bool, found: &mut Vec<u32>) {
        match self {
            Node::Leaf { number, grown } => {
                if is_home || (0..3).all(|k| grown.low[k] <= p[k] && p[k] <= grown.high[k]) {
                    found.push(*number);
                }
            }
            Node::Cut { axis, at, reach, low, high } => {
                let is_low = p[*axis] < *at;
                if p[*axis] < at + reach {
                    low.all(p, is_home && is_low, found);
                }
                if p[*axis] >= at - reach {
                    high.all(p, is_home && !is_low, found);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_hold_equally_many_and_reach_into_their_neighbours() {
        let points: Vec<[f64; 3]> =
            (0..4096).map(|i| [f64::from(i % 64), f64::from(i / 64), 0.0]).collect();
        let bounds = Bounds::around(&points);
        let boxes = Boxes::new(&mut points.clone(), &bounds, 7, 0.0);
        assert_eq!(boxes.n_boxes(), 7);
        let mut counts = [0; 7];
        let mut found = Vec::new();
        for &p in &points {
            counts[boxes.home(p) as usize] += 1;
            boxes.all(p, &mut found);
            assert!(found.contains(&boxes.home(p)));
        }
        assert!(counts.iter().all(|n| (450..700).contains(n)), "{counts:?}");
        let grown = Boxes::new(&mut points.clone(), &bounds, 2, 0.125);
        let seen = |x: f64| {
            let mut found = Vec::new();
            grown.all([x, 1.0, 0.0], &mut found);
            found
        };
        assert_eq!(
            [seen(10.0), seen(30.0), seen(34.0), seen(60.0)],
            [vec![0], vec![0, 1], vec![0, 1], vec![1]]
        );
    }
}
