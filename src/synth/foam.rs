//! `foam`: cells of a foam, each wall once, with the two regions that it parts as labels of its faces.
//!
//! Kelvin's foam: truncated octahedra around the points of a body-centred lattice, the Voronoi diagram of those points. All
//! cells are alike but for their place, so corners, edges and walls of one cell (`Pattern`) are those of all. Three shears
//! one after the other curve the walls. Each is a smooth function of the place that keeps volumes and folds nothing: curves that walls share agree,
//! and every region has a volume of exactly 4, but for what flat triangles cut off.
//!
//! Coordinates of sites are three integers that are all even or all odd; those of corners are twice as fine. A block is a
//! site with what it owns: of the cells that meet at a corner, an edge or a wall the first one, by z, y and x.

use super::noise::{hash2, noise3};
use super::sliced::{BlockCounts, Sliced};
use super::surface::Vertex;

/// A site, or a place in half steps between sites.
type Site = [i64; 3];

/// Sites beyond the foam that may own a corner of it; even.
const MARGIN: i64 = 2;

/// Reach and width of the two shears in each direction, in distances of sites along an axis.
const SHEARS: [(f64, f64); 2] = [(0.5, 3.0), (0.06, 0.8)];

/// Sides of a wall as pieces of an edge, in all: a foam of N triangles has this times the fourth root of N.
const REFINEMENT: f64 = 0.37;

/// A foam of `cells` pairs of cells along each axis; edges are cut into `n` pieces.
pub(super) struct Foam {
    cells: [i64; 3],
    n: u64,
    pattern: Pattern,
    seed: u64,
    colored: bool,
}

/// Corners, edges and walls that the cell at the origin owns.
struct Pattern {
    corners: Vec<Part>,
    edges: Vec<Part>,
    walls: Vec<Wall>,
}

/// A corner or an edge.
struct Part {
    /// Its place, or its ends.
    at: Vec<Site>,
    /// Sites whose cells meet there.
    cells: Vec<Site>,
}

/// A wall towards the cell at `to`; corners counter-clockwise, seen from there.
struct Wall {
    to: Site,
    at: Vec<Site>,
    /// Owner and number of each corner.
    corners: Vec<(Site, usize)>,
    /// Owner and number of the edge from each corner to the next; true if it runs the other way.
    sides: Vec<(Site, usize, bool)>,
}

fn plus(a: Site, b: Site) -> Site {
    [0, 1, 2].map(|k| a[k] + b[k])
}

fn minus(a: Site, b: Site) -> Site {
    [0, 1, 2].map(|k| a[k] - b[k])
}

/// A place as the cell at `site` sees it.
fn seen_from(site: Site, at: Site) -> Site {
    minus(at, site.map(|x| 2 * x))
}

/// The order of owners.
fn rank(site: &Site) -> Site {
    [site[2], site[1], site[0]]
}

fn is_corner(at: Site) -> bool {
    let mut sizes = at.map(i64::abs);
    sizes.sort_unstable();
    sizes == [0, 1, 2]
}

/// Returns whether two corners are ends of one edge.
fn are_joined(a: Site, b: Site) -> bool {
    minus(a, b).iter().map(|x| x * x).sum::<i64>() == 2
}

fn is_site(at: &Site) -> bool {
    at.iter().all(|x| (x - at[0]) % 2 == 0)
}

/// All places from -2 to 2 along each axis.
fn around() -> impl Iterator<Item = Site> {
    (0..125).map(|i| [i % 5 - 2, i / 5 % 5 - 2, i / 25 - 2])
}

/// Sites near the origin whose cells have all of these corners, the owner first.
fn cells_at(corners: &[Site]) -> Vec<Site> {
    let has_all = |s: &Site| corners.iter().all(|&at| is_corner(seen_from(*s, at)));
    let mut cells: Vec<Site> = around().filter(is_site).filter(has_all).collect();
    cells.sort_unstable_by_key(rank);
    cells
}

impl Pattern {
    fn new() -> Pattern {
        let all: Vec<Site> = around().filter(|&at| is_corner(at)).collect();
        let owned = |at: Vec<Site>| {
            let cells = cells_at(&at);
            (cells[0] == [0; 3]).then_some(Part { at, cells })
        };
        let corners: Vec<Part> = all.iter().filter_map(|&at| owned(vec![at])).collect();
        let pairs = all.iter().flat_map(|&a| all.iter().map(move |&b| (a, b)));
        let joined = pairs.filter(|&(a, b)| a < b && are_joined(a, b));
        let edges: Vec<Part> = joined.filter_map(|(a, b)| owned(vec![a, b])).collect();
        let find = |parts: &[Part], at: &[Site]| {
            let owner = cells_at(at)[0];
            let at: Vec<Site> = at.iter().map(|&at| seen_from(owner, at)).collect();
            let place = parts.iter().position(|part| part.at == at);
            (owner, place.expect("what a cell has, some cell owns"))
        };
        let behind = |to: &Site| rank(to) > [0; 3];
        let wall = |to: Site| {
            let mut left = all.clone();
            left.retain(|&at| is_corner(seen_from(to, at)));
            let mut at: Vec<Site> = Vec::new();
            while let Some(next) =
                left.iter().position(|&c| at.last().is_none_or(|&last| are_joined(last, c)))
            {
                at.push(left.swap_remove(next));
            }
            if at.len() < 4 {
                return None;
            }
            let [u, v] = [minus(at[1], at[0]), minus(at[2], at[1])];
            let normal = [0, 1, 2].map(|k| {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                u[i] * v[j] - u[j] * v[i]
            });
            if (0..3).map(|k| normal[k] * to[k]).sum::<i64>() < 0 {
                at.reverse();
            }
            let next = |i: usize| at[(i + 1) % at.len()];
            let sides = (0..at.len()).map(|i| {
                let ends = [at[i].min(next(i)), at[i].max(next(i))];
                let (owner, number) = find(&edges, &ends);
                (owner, number, at[i] > next(i))
            });
            let (sides, found) = (sides.collect(), at.iter().map(|&at| find(&corners, &[at])));
            Some(Wall { to, corners: found.collect(), sides, at })
        };
        let walls = around().filter(is_site).filter(behind).filter_map(wall).collect();
        Pattern { corners, edges, walls }
    }
}

/// Parts of the foam that a site owns: the number of each part's first vertex, counted from the site's own, or `None` where
/// the part does not belong to the foam; corners, edges and walls one after the other.
struct Owned {
    first: Vec<Option<u64>>,
    n_vertices: u64,
}

impl Foam {
    /// The foam whose number of triangles is the least one from `n_triangles` on, among some near the best sizes.
    pub(super) fn new(n_triangles: u64, seed: u64, colored: bool) -> Foam {
        let wanted = n_triangles as f64;
        let n = (REFINEMENT * wanted.sqrt().sqrt()).max(1.0);
        let mut side = 1;
        while 72.0 * n * n * ((side + 1) as f64).powi(3) <= wanted {
            side += 1;
        }
        let sides = (side - 1).max(1)..=side + 1;
        let sizes = sides.flat_map(|m| [[m, m, m], [m + 1, m, m], [m + 1, m + 1, m]]);
        let pattern = Pattern::new();
        let mut foam = Foam { cells: [1; 3], n: 1, pattern, seed, colored };
        let best = sizes.map(|cells| {
            foam.cells = cells;
            let coarse = foam.n_coarse();
            let mut n = (wanted / coarse as f64).sqrt().ceil().max(1.0) as u64;
            n += u64::from(n * n * coarse < n_triangles);
            (n * n * coarse, cells, n)
        });
        let (_, cells, n) = best.min().expect("there are six sizes");
        Foam { cells, n, ..foam }
    }

    /// Triangles if no edge is cut.
    fn n_coarse(&self) -> u64 {
        let mut count = 0;
        for site in (0..self.n_blocks()).map(|block| self.site(block)) {
            let walls = self.pattern.walls.iter().filter(|wall| self.has_wall(site, wall));
            count += walls.map(|wall| wall.at.len() as u64).sum::<u64>();
        }
        count
    }

    fn sites_along(&self, axis: usize) -> u64 {
        (self.cells[axis] + MARGIN) as u64
    }

    fn site(&self, block: u64) -> Site {
        let (nx, ny) = (self.sites_along(0), self.sites_along(1));
        let z = (block / nx / ny) as i64 - MARGIN;
        let odd = z & 1;
        let along = |i: u64| 2 * i as i64 - MARGIN + odd;
        [along(block % nx), along(block / nx % ny), z]
    }

    fn block(&self, site: Site) -> usize {
        let [x, y, z] = site.map(|x| (x + MARGIN) as u64);
        ((z * self.sites_along(1) + y / 2) * self.sites_along(0) + x / 2) as usize
    }

    fn holds(&self, site: Site) -> bool {
        (0..3).all(|k| (0..2 * self.cells[k]).contains(&site[k]))
    }

    fn has_wall(&self, site: Site, wall: &Wall) -> bool {
        self.holds(site) || self.holds(plus(site, wall.to))
    }

    /// The number of a region, 0 outside.
    fn label(&self, site: Site) -> u32 {
        let [x, y, z] = site;
        let number = (z * self.cells[1] + y / 2) * self.cells[0] + x / 2 + 1;
        if self.holds(site) { number as u32 } else { 0 }
    }

    fn owned(&self, site: Site) -> Owned {
        let mut owned = Owned { first: Vec::new(), n_vertices: 0 };
        let mut add = |is_there: bool, n: u64| {
            owned.first.push(is_there.then_some(owned.n_vertices));
            owned.n_vertices += if is_there { n } else { 0 };
        };
        let touches = |part: &Part| part.cells.iter().any(|&cell| self.holds(plus(site, cell)));
        let Pattern { corners, edges, walls } = &self.pattern;
        corners.iter().for_each(|corner| add(touches(corner), 1));
        edges.iter().for_each(|edge| add(touches(edge), self.n - 1));
        let within = |wall: &Wall| 1 + wall.at.len() as u64 * self.n * (self.n - 1) / 2;
        walls.iter().for_each(|wall| add(self.has_wall(site, wall), within(wall)));
        owned
    }

    /// Walls that a site owns: the first vertex of each, the wall, its labels behind and in front, and whether to turn it so
    /// that the outside is in front.
    fn walls<'a>(
        &'a self,
        site: Site,
        owned: &'a Owned,
    ) -> impl Iterator<Item = (u64, &'a Wall, [u32; 2], bool)> {
        let skipped = self.pattern.corners.len() + self.pattern.edges.len();
        let there = owned.first[skipped..].iter().zip(&self.pattern.walls);
        there.filter_map(move |(first, wall)| {
            let [own, other] = [self.label(site), self.label(plus(site, wall.to))];
            let is_turned = own == 0;
            first.map(|first| match is_turned {
                true => (first, wall, [other, own], true),
                false => (first, wall, [own, other], false),
            })
        })
    }

    /// A vertex: a place in the lattice, carried away by the shears.
    fn vertex(&self, site: Site, local: [f64; 3]) -> Vertex {
        let flat = [0, 1, 2].map(|k| site[k] as f64 + 0.5 * local[k]);
        let mut at = flat;
        for axis in 0..3 {
            let (u, v) = (at[(axis + 1) % 3], at[(axis + 2) % 3]);
            for (i, (reach, width)) in (0..).zip(SHEARS) {
                // Any plane through the noise but one of its lattice, where it is weak.
                let seed = hash2(3 * i + axis as u64, self.seed) as u32;
                at[axis] += reach * noise3([u / width, v / width, 0.37], seed);
            }
        }
        let color = if self.colored {
            let tone = 0.5 + 0.5 * noise3(at.map(|x| 0.8 * x), self.seed as u32);
            [0.9 - 0.3 * tone, 0.75 - 0.2 * tone, 0.5 + 0.3 * tone].map(|c| (255.0 * c) as u8)
        } else {
            [0; 3]
        };
        let uv = [0, 1].map(|k| ((flat[k] + 1.0) / (2 * self.cells[k] + 2) as f64) as f32);
        Vertex { position: at.map(|x| x as f32), color, uv }
    }
}

/// A place between two others: `part` of `whole` steps from the first.
fn between(a: [f64; 3], b: [f64; 3], part: u64, whole: u64) -> [f64; 3] {
    let t = part as f64 / whole as f64;
    [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t)
}

impl Sliced for Foam {
    fn n_blocks(&self) -> u64 {
        let layers = (2 * (self.cells[2] + MARGIN)) as u64;
        layers * self.sites_along(1) * self.sites_along(0)
    }

    fn count(&self, block: u64) -> BlockCounts {
        let site = self.site(block);
        let owned = self.owned(site);
        let corners = self.walls(site, &owned).map(|(_, wall, ..)| wall.at.len() as u64);
        let faces = self.n * self.n * corners.sum::<u64>();
        BlockCounts { vertices: [owned.n_vertices, 0], faces }
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        let site = self.site(block);
        let owned = self.owned(site);
        let place = |at: Site| at.map(|x| x as f64);
        let parts = self.pattern.corners.iter().chain(&self.pattern.edges);
        for (part, _) in parts.zip(&owned.first).filter(|(_, first)| first.is_some()) {
            match *part.at.as_slice() {
                [a, b] => {
                    let inner = 1..self.n;
                    let points = inner.map(|i| between(place(a), place(b), i, self.n));
                    out.extend(points.map(|point| self.vertex(site, point)));
                }
                _ => out.push(self.vertex(site, place(part.at[0]))),
            }
        }
        for (_, wall, ..) in self.walls(site, &owned) {
            let sides = wall.at.len();
            let middle = [0, 1, 2]
                .map(|k| wall.at.iter().map(|at| at[k]).sum::<i64>() as f64 / sides as f64);
            out.push(self.vertex(site, middle));
            for ring in 1..self.n {
                for side in 0..sides {
                    let [a, b] = [wall.at[side], wall.at[(side + 1) % sides]]
                        .map(|corner| between(middle, place(corner), ring, self.n));
                    let points = (0..ring).map(|i| between(a, b, i, ring));
                    out.extend(points.map(|point| self.vertex(site, point)));
                }
            }
        }
    }

    fn faces(&self, block: u64, first: &[[u64; 2]], out: &mut Vec<[u64; 3]>) {
        let site = self.site(block);
        let owned = self.owned(site);
        let n = self.n;
        let mut rim: Vec<u64> = Vec::new();
        for (inner, wall, _, is_turned) in self.walls(site, &owned) {
            let sides = wall.at.len() as u64;
            let inner = first[block as usize][0] + inner;
            let first_of = |owner: Site, part: usize| {
                let owner = plus(site, owner);
                let held = self.owned(owner).first[part].expect("a wall has all of its rim");
                first[self.block(owner)][0] + held
            };
            rim.clear();
            for (&(at, corner), &(owner, edge, is_back)) in wall.corners.iter().zip(&wall.sides) {
                rim.push(first_of(at, corner));
                let start = first_of(owner, self.pattern.corners.len() + edge);
                rim.extend((1..n).map(|i| start + if is_back { n - 1 - i } else { i - 1 }));
            }
            // Rings of points around the middle, the last one the rim.
            let point = |ring: u64, i: u64| match ring {
                0 => inner,
                ring if ring == n => rim[(i % (sides * n)) as usize],
                ring => inner + 1 + sides * ring * (ring - 1) / 2 + i % (sides * ring),
            };
            let mut put = |a, b, c| out.push(if is_turned { [a, c, b] } else { [a, b, c] });
            for ring in 0..n {
                for side in 0..sides {
                    let (low, high) = (side * ring, side * (ring + 1));
                    for i in 0..=ring {
                        put(
                            point(ring, low + i),
                            point(ring + 1, high + i),
                            point(ring + 1, high + i + 1),
                        );
                    }
                    for i in 0..ring {
                        put(
                            point(ring, low + i),
                            point(ring + 1, high + i + 1),
                            point(ring, low + i + 1),
                        );
                    }
                }
            }
        }
    }

    fn labels(&self, block: u64, out: &mut Vec<[u32; 2]>) {
        let site = self.site(block);
        for (_, wall, labels, _) in self.walls(site, &self.owned(site)) {
            let n = wall.at.len() * (self.n * self.n) as usize;
            out.resize(out.len() + n, labels);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_owns_a_share_of_what_it_touches() {
        let pattern = Pattern::new();
        // 24 corners of four cells, 36 edges of three, 14 walls of two.
        assert_eq!((pattern.corners.len(), pattern.edges.len()), (6, 12));
        assert!(pattern.corners.iter().all(|corner| corner.cells.len() == 4));
        assert!(pattern.edges.iter().all(|edge| edge.cells.len() == 3));
        let mut sides: Vec<usize> = pattern.walls.iter().map(|wall| wall.at.len()).collect();
        sides.sort_unstable();
        assert_eq!(sides, [4, 4, 4, 6, 6, 6, 6]);
    }
}
