//! Sizes of components: what is too small to stay, and the numbers that help to decide on that.

use serde::{Deserialize, Serialize};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_store::cells::Pieces;
use stonecut_store::config::MinComponent;
use stonecut_system::units::show_count;

/// Least size of a component that stays; zeros leave every component.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Least {
    /// Triangles.
    pub triangles: u64,
    /// Diagonal of its bounding box, in input units.
    pub diameter: f64,
}

impl Least {
    /// Applies `--min-component` to a scan with a box of this diagonal.
    pub fn of(min: MinComponent, diagonal: f64) -> Least {
        match min {
            MinComponent::Triangles(triangles) => Least { triangles, ..Least::default() },
            MinComponent::Size(diameter) => Least { diameter, ..Least::default() },
            MinComponent::Share(share) => Least { diameter: share * diagonal, ..Least::default() },
        }
    }

    /// Returns whether a component of this size goes.
    pub fn drops(&self, triangles: u64, bounds: Bounds) -> bool {
        triangles < self.triangles || bounds.diagonal() < self.diameter
    }
}

/// The limits of `ComponentSizes::below`.
const LIMITS: [u64; 4] = [30, 100, 300, 1000];

/// Number of components below a size, and their contents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Below {
    /// Components of fewer triangles than this.
    pub limit: u64,
    /// Their number.
    pub components: u64,
    /// Triangles of all of them.
    pub triangles: u64,
}

/// Components by size. Connected by vertices, or by vertices in exactly the same place.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ComponentSizes {
    /// All components of the input.
    pub found: u64,
    /// Triangles of the largest.
    pub largest: u64,
    /// Numbers of those below 30, 100, 300 and 1000 triangles.
    pub below: Vec<Below>,
    /// Components that were dropped because they are too small.
    #[serde(default)]
    pub dropped: u64,
    /// Their triangles.
    #[serde(default)]
    pub dropped_triangles: u64,
}

impl ComponentSizes {
    /// Nothing found yet.
    pub fn none() -> ComponentSizes {
        let below = LIMITS.map(|limit| Below { limit, ..Below::default() }).to_vec();
        ComponentSizes { below, ..ComponentSizes::default() }
    }

    /// Counts a component; tells whether it goes. What holds no triangle is none.
    pub fn count(&mut self, triangles: u64, bounds: Bounds, least: Least) -> bool {
        if triangles == 0 {
            return false;
        }
        self.found += 1;
        self.largest = self.largest.max(triangles);
        for below in self.below.iter_mut().filter(|below| triangles < below.limit) {
            below.components += 1;
            below.triangles += triangles;
        }
        let goes = least.drops(triangles, bounds);
        if goes {
            self.dropped += 1;
            self.dropped_triangles += triangles;
        }
        goes
    }

    /// Adds what was counted elsewhere.
    pub fn add(&mut self, other: &ComponentSizes) {
        self.found += other.found;
        self.largest = self.largest.max(other.largest);
        for (below, other) in self.below.iter_mut().zip(&other.below) {
            below.components += other.components;
            below.triangles += other.triangles;
        }
        self.dropped += other.dropped;
        self.dropped_triangles += other.dropped_triangles;
    }
}

/// The histogram for people: `30: 12 (with 200), 100: ...`.
pub fn below_list(sizes: &ComponentSizes) -> String {
    let list = sizes.below.iter().map(|below| {
        let (components, triangles) = (show_count(below.components), show_count(below.triangles));
        format!("{}: {components} (with {triangles})", below.limit)
    });
    list.collect::<Vec<_>>().join(", ")
}

/// The sizes of the components of a mesh in memory. Memory: 16 bytes a vertex, 64 a component.
pub fn sizes_in_memory(mesh: &Mesh) -> ComponentSizes {
    let pieces = Pieces::find(mesh);
    let mut sizes = ComponentSizes::none();
    let mut triangles = vec![0; pieces.n];
    mesh.triangles.iter().for_each(|t| triangles[pieces.of_vertex[t[0] as usize] as usize] += 1);
    for n in triangles {
        sizes.count(n, Bounds::EMPTY, Least::default());
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_of_the_diagonal_of_the_scan() {
        assert_eq!(Least::of(MinComponent::Share(0.01), 50.0).diameter, 0.5);
        assert_eq!(Least::of(MinComponent::Size(2.0), 50.0).diameter, 2.0);
        assert_eq!(Least::of(MinComponent::Triangles(7), 50.0).triangles, 7);
    }

    #[test]
    fn a_component_goes_below_either_limit_and_stays_at_it() {
        let bounds = Bounds::from([[1.0, 1.0, 1.0], [1.0, 4.0, 5.0]]);
        assert_eq!(bounds.diagonal(), 5.0);
        assert_eq!(Bounds::EMPTY.diagonal(), 0.0);
        let drops = |triangles, diameter| Least { triangles, diameter }.drops(30, bounds);
        assert!(!drops(0, 0.0) && !drops(30, 5.0));
        assert!(drops(31, 0.0) && drops(0, 5.1));
    }

    #[test]
    fn sizes_add_up() {
        let least = Least { triangles: 100, diameter: 0.0 };
        let (mut all, mut a, mut b) =
            (ComponentSizes::none(), ComponentSizes::none(), ComponentSizes::none());
        for (i, n) in [1, 29, 30, 99, 100, 999, 1000, 5000, 0].into_iter().enumerate() {
            assert_eq!(all.count(n, Bounds::EMPTY, least), n > 0 && n < 100, "{n}");
            if i % 2 == 0 { &mut a } else { &mut b }.count(n, Bounds::EMPTY, least);
        }
        a.add(&b);
        assert_eq!(a, all);
        assert_eq!((all.found, all.largest, all.dropped, all.dropped_triangles), (8, 5000, 4, 159));
        let below: Vec<_> =
            all.below.iter().map(|b| (b.limit, b.components, b.triangles)).collect();
        assert_eq!(below, [(30, 2, 30), (100, 4, 159), (300, 5, 259), (1000, 6, 1258)]);
    }
}
