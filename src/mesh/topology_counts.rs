//! Counts of the topology of a mesh; one cell at a time, for meshes of any size.
//!
//! `count_cell` settles everything that one cell can know by itself; what touches a seam is handed to a
//! `TopologyCounter`, which settles it once all cells have come. `of_triangles` does both for a mesh in
//! memory. Looks at vertex ids alone: positions, and thereby welding, are none of its business.

use crate::global_vertex::GlobalVertex;
use crate::union_find::Union;
/// Connectivity in numbers, as `info --check` and `measure` report it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Topology {
    /// All vertices, used or not.
    pub vertices: u64,
    /// All triangles, degenerate ones included.
    pub triangles: u64,
    /// Edges of exactly one triangle.
    pub boundary_edges: u64,
    /// Edges of more than two triangles.
    pub non_manifold_edges: u64,
    /// Parts that share no vertex with each other; unused vertices are none.
    pub components: u64,
    /// Used vertices - edges + triangles that are not degenerate.
    pub euler_characteristic: i64,
    /// Triangles with a repeated corner. They count for nothing else.
    pub degenerate_triangles: u64,
    /// Triangles beyond the first on the same three vertices, whichever way round.
    pub duplicate_triangles: u64,
    /// Vertices of no triangle.
    pub unreferenced_vertices: u64,
    /// Edges of exactly two triangles that run along it in the same direction.
    pub inconsistent_edges: u64,
    /// Edges of at least three triangles of different corners: where three sheets meet.
    pub junction_edges: u64,
    /// Vertices with a number of such edges other than 0 and 2: where junctions meet or end.
    pub junction_points: u64,
}

/// Triangles of one cell, for `count_cell`. Each triangle of the mesh belongs to exactly one cell.
#[derive(Clone, Copy, Debug)]
pub struct CellPart<'a> {
    /// Corners, as places in `global` and `shared`.
    pub triangles: &'a [[u32; 3]],
    /// The number in the whole mesh of each vertex of the cell.
    pub global: &'a [GlobalVertex],
    /// True if triangles of other cells use this vertex too. True is always safe, and only costs memory.
    pub shared: &'a [bool],
}

/// Uses of an edge by triangles, one way and the other; saturating, as no more than "above 2" matters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Uses {
    ascending: u8,
    descending: u8,
    /// Triangles among them of different corners.
    distinct: u8,
}

/// Findings in one cell: numbers that are final, and lists for what other cells contribute to.
///
/// Memory: 24 bytes for each edge between two shared vertices, 16 for each shared vertex.
#[derive(Clone, Debug, Default)]
pub struct CellCounts {
    settled: Topology,
    n_edges: u64,
    n_used: u64,
    /// Edges between shared vertices, the smaller id first.
    edges: Vec<([GlobalVertex; 2], Uses)>,
    /// Triangles of three shared vertices, ids ascending.
    triangles: Vec<[GlobalVertex; 3]>,
    /// Shared vertices with junction edges of theirs that this cell settles.
    ends: Vec<(GlobalVertex, u32)>,
    /// Used shared vertices with one that they are connected to inside the cell (perhaps themselves).
    links: Vec<[GlobalVertex; 2]>,
}

/// Counts what it is given, cell by cell.
#[derive(Clone, Debug, Default)]
pub struct TopologyCounter {
    total: CellCounts,
    /// Length of `total.edges` beyond which equal edges are united.
    compact_at: usize,
}

/// Pending edges below this many are not worth uniting.
const COMPACT_LEAST: usize = 1 << 16;

impl Topology {
    fn add_edge(&mut self, uses: Uses) {
        match (uses.ascending, uses.descending) {
            (1, 0) | (0, 1) => self.boundary_edges += 1,
            (1, 1) => {}
            (2, 0) | (0, 2) => self.inconsistent_edges += 1,
            _ => self.non_manifold_edges += 1,
        }
        self.junction_edges += u64::from(uses.is_junction());
    }
}

impl Uses {
    fn add(&mut self, other: Uses) {
        self.ascending = self.ascending.saturating_add(other.ascending);
        self.descending = self.descending.saturating_add(other.descending);
        self.distinct = self.distinct.saturating_add(other.distinct);
    }

    fn is_junction(self) -> bool {
        self.distinct > 2
    }
}

/// The topology of a mesh in memory.
///
/// Memory: about 60 bytes a triangle while it runs. Indices must be below `n_vertices`.
pub fn of_triangles(n_vertices: usize, triangles: &[[u32; 3]]) -> Topology {
    let mut counter = TopologyCounter::default();
    counter.add(count(triangles, n_vertices, None));
    counter.finish(n_vertices as u64)
}

/// Counts a mesh in memory as the only cell.
///
/// Memory: about 60 bytes a triangle while it runs.
pub fn count_mesh(mesh: &crate::Mesh) -> CellCounts {
    count(&mesh.triangles, mesh.positions.len(), None)
}

/// Counts one cell; independent of every other, so cells may be counted in parallel.
///
/// Memory: about 60 bytes a triangle while it runs.
pub fn count_cell(part: &CellPart) -> CellCounts {
    assert_eq!(part.global.len(), part.shared.len(), "each vertex of a cell has an id and a flag");
    count(part.triangles, part.global.len(), Some(part))
}

fn count(triangles: &[[u32; 3]], n_vertices: usize, part: Option<&CellPart>) -> CellCounts {
    let mut counts = CellCounts::default();
    let is_shared = |v: u32| part.is_some_and(|part| part.shared[v as usize]);
    let global = |v: u32| part.map_or(GlobalVertex::in_memory(v), |part| part.global[v as usize]);
    counts.settled.triangles = triangles.len() as u64;
    let mut union = Union::new(n_vertices);
    let mut used = vec![false; n_vertices];
    for &[a, b, c] in triangles {
        if a == b || b == c || c == a {
            counts.settled.degenerate_triangles += 1;
            continue;
        }
        used[a as usize] = true;
        used[b as usize] = true;
        used[c as usize] = true;
        union.join(a, b);
        union.join(b, c);
    }
    let sound = || triangles.iter().filter(|[a, b, c]| a != b && b != c && c != a);
    count_edges(sound(), n_vertices, is_shared, global, &mut counts);
    count_duplicates(sound(), n_vertices, is_shared, global, &mut counts);
    // A component's shared vertex with the lowest place speaks for it on the seams.
    let mut speaker = vec![u32::MAX; n_vertices];
    for v in (0..n_vertices as u32).filter(|&v| used[v as usize]) {
        if is_shared(v) {
            let root = union.root(v) as usize;
            if speaker[root] == u32::MAX {
                speaker[root] = v;
            }
            counts.links.push([global(speaker[root]), global(v)]);
        } else {
            counts.n_used += 1;
        }
    }
    let silent_root = |v: u32, union: &mut Union| {
        used[v as usize] && union.root(v) == v && speaker[v as usize] == u32::MAX
    };
    counts.settled.components =
        (0..n_vertices as u32).filter(|&v| silent_root(v, &mut union)).count() as u64;
    counts
}

/// Gathers items by their smallest vertex, then hands over each vertex's items, sorted.
///
/// Two passes over the triangles and a list of one entry an item: no hashing, no sorting of the whole.
fn by_smallest_vertex<T: Copy + Default + Ord>(
    n_vertices: usize,
    items: impl Fn(&mut dyn FnMut(u32, T)),
    mut each: impl FnMut(u32, &[T]),
) {
    let mut ends = vec![0usize; n_vertices + 1];
    items(&mut |smallest, _| ends[smallest as usize + 1] += 1);
    let mut sum = 0;
    ends.iter_mut().for_each(|end| {
        sum += *end;
        *end = sum;
    });
    let mut sorted = vec![T::default(); ends[n_vertices]];
    // After this pass `ends[v]` is where the list of v ends; it began where that of v - 1 ends.
    items(&mut |smallest, item| {
        let place = &mut ends[smallest as usize];
        sorted[*place] = item;
        *place += 1;
    });
    let mut start = 0;
    for (v, &end) in ends.iter().take(n_vertices).enumerate() {
        sorted[start..end].sort_unstable();
        each(v as u32, &sorted[start..end]);
        start = end;
    }
}

fn count_edges<'a>(
    triangles: impl Iterator<Item = &'a [u32; 3]> + Clone,
    n_vertices: usize,
    is_shared: impl Fn(u32) -> bool,
    global: impl Fn(u32) -> GlobalVertex,
    counts: &mut CellCounts,
) {
    let edges = |out: &mut dyn FnMut(u32, (u32, bool))| {
        for &[a, b, c] in triangles.clone() {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                out(from.min(to), (from.max(to), from > to));
            }
        }
    };
    let is_seam = |low: u32, high: u32| is_shared(low) && is_shared(high);
    let few = |n: usize| n.min(usize::from(u8::MAX)) as u8;
    let mut ends: Vec<u32> = Vec::new();
    let mut settle = |[low, high]: [u32; 2], uses: Uses| {
        if is_seam(low, high) {
            let (x, y) = (global(low), global(high));
            // Another order of ids turns the directions round.
            let turned = Uses { ascending: uses.descending, descending: uses.ascending, ..uses };
            counts.edges.push(if x < y { ([x, y], uses) } else { ([y, x], turned) });
        } else {
            counts.n_edges += 1;
            counts.settled.add_edge(uses);
            ends.extend([low, high].into_iter().filter(|_| uses.is_junction()));
        }
    };
    // More than two triangles at an edge, or on a seam perhaps more: their third corners are compared.
    let mut crowded: Vec<([u32; 2], Uses)> = Vec::new();
    by_smallest_vertex(n_vertices, edges, |low, others| {
        for run in others.chunk_by(|x, y| x.0 == y.0) {
            let high = run[0].0;
            let descending = run.iter().filter(|(_, descending)| *descending).count();
            let uses = Uses {
                ascending: few(run.len() - descending),
                descending: few(descending),
                distinct: few(run.len()),
            };
            match run.len() > 2 || run.len() == 2 && is_seam(low, high) {
                true => crowded.push(([low, high], uses)),
                false => settle([low, high], uses),
            }
        }
    });
    let mut thirds: Vec<(u32, u32)> = Vec::new();
    for &[a, b, c] in triangles.filter(|_| !crowded.is_empty()) {
        for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
            let edge = [from.min(to), from.max(to)];
            if let Ok(at) = crowded.binary_search_by_key(&edge, |&(ends, _)| ends) {
                thirds.push((at as u32, third));
            }
        }
    }
    thirds.sort_unstable();
    thirds.dedup();
    for (run, &(edge, uses)) in thirds.chunk_by(|x, y| x.0 == y.0).zip(&crowded) {
        settle(edge, Uses { distinct: few(run.len()), ..uses });
    }
    ends.sort_unstable();
    for run in ends.chunk_by(|x, y| x == y) {
        match is_shared(run[0]) {
            true => counts.ends.push((global(run[0]), run.len() as u32)),
            false => counts.settled.junction_points += u64::from(run.len() != 2),
        }
    }
}

fn count_duplicates<'a>(
    triangles: impl Iterator<Item = &'a [u32; 3]> + Clone,
    n_vertices: usize,
    is_shared: impl Fn(u32) -> bool,
    global: impl Fn(u32) -> GlobalVertex,
    counts: &mut CellCounts,
) {
    let corner_sets = |out: &mut dyn FnMut(u32, [u32; 2])| {
        for &triangle in triangles.clone() {
            let mut t = triangle;
            t.sort_unstable();
            out(t[0], [t[1], t[2]]);
        }
    };
    by_smallest_vertex(n_vertices, corner_sets, |low, others| {
        for run in others.chunk_by(|x, y| x == y) {
            let [middle, high] = run[0];
            counts.settled.duplicate_triangles += run.len() as u64 - 1;
            if is_shared(low) && is_shared(middle) && is_shared(high) {
                let mut ids = [global(low), global(middle), global(high)];
                ids.sort_unstable();
                counts.triangles.push(ids);
            }
        }
    });
}

impl TopologyCounter {
    /// Adds one cell. The order of the cells does not show in the result.
    pub fn add(&mut self, cell: CellCounts) {
        let (total, settled) = (&mut self.total, &cell.settled);
        total.n_edges += cell.n_edges;
        total.n_used += cell.n_used;
        total.settled.triangles += settled.triangles;
        total.settled.boundary_edges += settled.boundary_edges;
        total.settled.non_manifold_edges += settled.non_manifold_edges;
        total.settled.components += settled.components;
        total.settled.degenerate_triangles += settled.degenerate_triangles;
        total.settled.duplicate_triangles += settled.duplicate_triangles;
        total.settled.inconsistent_edges += settled.inconsistent_edges;
        total.settled.junction_edges += settled.junction_edges;
        total.settled.junction_points += settled.junction_points;
        total.ends.extend(cell.ends);
        total.edges.extend(cell.edges);
        total.triangles.extend(cell.triangles);
        total.links.extend(cell.links);
        if total.edges.len() > self.compact_at.max(COMPACT_LEAST) {
            unite_edges(&mut total.edges);
            self.compact_at = 2 * total.edges.len();
        }
    }

    /// The numbers of the whole mesh, whose file holds `n_vertices` vertices.
    pub fn finish(self, n_vertices: u64) -> Topology {
        let CellCounts {
            settled: mut topology,
            n_edges,
            n_used,
            mut edges,
            mut triangles,
            mut links,
            mut ends,
        } = self.total;
        unite_edges(&mut edges);
        triangles.sort_unstable();
        // Cells counted triangles as different that have a copy in another one.
        for run in triangles.chunk_by(|a, b| a == b).filter(|run| run.len() > 1) {
            let [a, b, c] = run[0];
            topology.duplicate_triangles += run.len() as u64 - 1;
            for edge in [[a, b], [b, c], [a, c]] {
                if let Ok(at) = edges.binary_search_by_key(&edge, |&(ends, _)| ends) {
                    let more = (run.len() - 1).min(usize::from(u8::MAX)) as u8;
                    edges[at].1.distinct = edges[at].1.distinct.saturating_sub(more);
                }
            }
        }
        for &([a, b], uses) in &edges {
            topology.add_edge(uses);
            ends.extend([(a, 1), (b, 1)].into_iter().filter(|_| uses.is_junction()));
        }
        ends.sort_unstable();
        for run in ends.chunk_by(|a, b| a.0 == b.0) {
            let n: u32 = run.iter().map(|(_, n)| n).sum();
            topology.junction_points += u64::from(n != 2);
        }
        let n_edges = n_edges + edges.len() as u64;
        // Every used shared vertex stands second in some link, every first one too.
        let mut ids: Vec<GlobalVertex> = links.iter().map(|link| link[1]).collect();
        ids.sort_unstable();
        ids.dedup();
        links.retain(|[speaker, vertex]| speaker != vertex);
        let place = |id: GlobalVertex| {
            ids.binary_search(&id).expect("a speaker has a link to itself") as u32
        };
        let mut union = Union::new(ids.len());
        links.iter().for_each(|&[speaker, vertex]| union.join(place(speaker), place(vertex)));
        let n_roots = (0..ids.len() as u32).filter(|&v| union.root(v) == v).count() as u64;
        topology.components += n_roots;
        let n_used = n_used + ids.len() as u64;
        topology.vertices = n_vertices;
        topology.unreferenced_vertices = n_vertices.saturating_sub(n_used);
        let n_sound = topology.triangles - topology.degenerate_triangles;
        topology.euler_characteristic = n_used as i64 - n_edges as i64 + n_sound as i64;
        topology
    }
}

/// Sorts edges and makes one of those with the same ends.
fn unite_edges(edges: &mut Vec<([GlobalVertex; 2], Uses)>) {
    edges.sort_unstable_by_key(|&(ends, _)| ends);
    edges.dedup_by(|gone, kept| {
        let same = gone.0 == kept.0;
        if same {
            kept.1.add(gone.1);
        }
        same
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Splits triangles among `n_cells` cells by a hash of their number: seams everywhere.
    fn in_cells(n_vertices: usize, triangles: &[[u32; 3]], n_cells: usize) -> Topology {
        let cell_of = |i: usize| (i * 2_654_435_761) % 1013 % n_cells;
        let mut users = vec![Vec::new(); n_vertices];
        for (i, t) in triangles.iter().enumerate() {
            t.iter().for_each(|&v| users[v as usize].push(cell_of(i)));
        }
        let mut counter = TopologyCounter::default();
        for cell in 0..n_cells {
            // Local numbers run backwards, so that ids and places are ordered differently.
            let held: Vec<u32> = (0..n_vertices as u32)
                .rev()
                .filter(|&v| users[v as usize].contains(&cell))
                .collect();
            let global: Vec<GlobalVertex> =
                held.iter().copied().map(GlobalVertex::in_memory).collect();
            let local = |v: u32| held.iter().position(|&known| known == v).unwrap() as u32;
            let shared: Vec<bool> =
                held.iter().map(|&v| users[v as usize].iter().any(|&u| u != cell)).collect();
            let own: Vec<[u32; 3]> = (0..triangles.len())
                .filter(|&i| cell_of(i) == cell)
                .map(|i| triangles[i].map(local))
                .collect();
            counter.add(count_cell(&CellPart {
                triangles: &own,
                global: &global,
                shared: &shared,
            }));
        }
        counter.finish(n_vertices as u64)
    }

    fn check(n_vertices: usize, triangles: &[[u32; 3]], expected: Topology) {
        assert_eq!(of_triangles(n_vertices, triangles), expected);
        for n_cells in [1, 2, 3, 7] {
            assert_eq!(in_cells(n_vertices, triangles, n_cells), expected, "{n_cells} cells");
        }
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn a_tetrahedron_is_closed_and_has_genus_0() {
        let expected = Topology {
            vertices: 4,
            triangles: 4,
            components: 1,
            euler_characteristic: 2,
            ..Topology::default()
        };
        check(4, &TETRAHEDRON, expected);
    }

    #[test]
    fn faults_are_counted_each_in_its_place() {
        // A tetrahedron, one of its faces once more (turned round and rotated), a triangle with the
        // wrong orientation beside one more triangle, a degenerate one and two unused vertices:
        //
        //     6        4-5-6 and 5-6-7 both run from 5 to 6
        //    /|\
        //   4-+-7
        //    \|/
        //     5
        let mut triangles = TETRAHEDRON.to_vec();
        triangles.extend([[2, 0, 1], [4, 5, 6], [5, 6, 7], [8, 8, 4]]);
        let expected = Topology {
            vertices: 10,
            triangles: 8,
            boundary_edges: 4,
            non_manifold_edges: 3,
            components: 2,
            // 8 vertices - (6 + 5) edges + (5 + 2) triangles
            euler_characteristic: 4,
            degenerate_triangles: 1,
            duplicate_triangles: 1,
            unreferenced_vertices: 2,
            inconsistent_edges: 1,
            ..Topology::default()
        };
        check(10, &triangles, expected);
    }

    #[test]
    fn sheets_meet_at_junctions_and_junctions_at_points() {
        let mut wall = TETRAHEDRON.to_vec();
        wall.extend([[0, 1, 4], [1, 2, 4], [2, 0, 4]]);
        let found = of_triangles(5, &wall);
        // Three sheets meet along 0-1-2: the tetrahedra 0123 and 0124 with their common face.
        assert_eq!((found.junction_edges, found.junction_points), (3, 0));
        assert_eq!((found.non_manifold_edges, found.boundary_edges), (3, 0));
        check(5, &wall, found);
        // A fin on another edge: a junction that ends at a vertex without others.
        wall.extend([[0, 3, 5]]);
        let found = of_triangles(6, &wall);
        assert_eq!((found.junction_edges, found.junction_points), (4, 2));
        check(6, &wall, found);
        // The same face three times is not a junction.
        let found = of_triangles(3, &[[0, 1, 2], [1, 2, 0], [2, 1, 0]]);
        assert_eq!((found.junction_edges, found.non_manifold_edges), (0, 3));
        check(3, &[[0, 1, 2], [1, 2, 0], [2, 1, 0]], found);
    }

    #[test]
    fn a_torus_of_cells_equals_a_torus() {
        let (n, m) = (23u32, 17u32);
        let at = |i: u32, j: u32| (i % n) * m + j % m;
        let mut triangles = Vec::new();
        for i in 0..n {
            for j in 0..m {
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        let expected = Topology {
            vertices: u64::from(n * m),
            triangles: u64::from(2 * n * m),
            components: 1,
            ..Topology::default()
        };
        check((n * m) as usize, &triangles, expected);
        // A hole of one triangle costs 1 of the characteristic.
        triangles.pop();
        let expected =
            Topology { triangles: expected.triangles - 1, boundary_edges: 3, ..expected };
        check((n * m) as usize, &triangles, Topology { euler_characteristic: -1, ..expected });
    }

    #[test]
    fn nothing_has_no_topology() {
        check(0, &[], Topology::default());
    }
}
