//! What is counted of a mesh before and after: edges, fans, components, Euler characteristic.

/// Counts of a set of triangles, improper ones left out.
#[derive(Debug, Default, PartialEq)]
pub struct Census {
    /// No edge has more than two triangles, and no side occurs twice.
    pub is_edge_manifold: bool,
    /// The triangles of every vertex form one fan.
    pub is_vertex_manifold: bool,
    /// No edge has a single triangle.
    pub is_closed: bool,
    pub n_triangles: usize,
    pub n_vertices: usize,
    pub n_components: usize,
    /// Triangles of the component that has most.
    pub n_largest: usize,
    /// Vertices - edges + triangles.
    pub euler: i64,
}

impl Census {
    /// Takes stock; `name` tells which vertices count as one.
    pub fn of(triangles: &[[u32; 3]], n_names: usize, name: impl Fn(u32) -> u32) -> Census {
        let named = triangles.iter().map(|t| t.map(&name));
        let faces: Vec<[u32; 3]> =
            named.filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).collect();
        let mut sides: Vec<(u64, bool, u32)> = Vec::with_capacity(3 * faces.len());
        for (i, t) in faces.iter().enumerate() {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let key = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
                sides.push((key, a < b, i as u32));
            }
        }
        sides.sort_unstable();
        let mut census = Census {
            is_edge_manifold: true,
            is_closed: true,
            n_triangles: faces.len(),
            ..Census::default()
        };
        // Corners that hang together over edges of two triangles.
        let mut fans = Sets::new(3 * faces.len());
        let mut parts = Sets::new(n_names);
        let corner = |i: u32, v: u32| {
            let t = faces[i as usize];
            3 * i + u32::from(t[1] == v) + 2 * u32::from(t[2] == v)
        };
        let mut n_edges = 0;
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            n_edges += 1;
            let (a, b) = ((same[0].0 >> 32) as u32, same[0].0 as u32);
            parts.join(a, b);
            census.is_closed &= same.len() != 1;
            let fits = same.len() == 1 || same.len() == 2 && same[0].1 != same[1].1;
            census.is_edge_manifold &= fits;
            for pair in same.windows(2) {
                for v in [a, b] {
                    fans.join(corner(pair[0].2, v), corner(pair[1].2, v));
                }
            }
        }
        let mut is_used = vec![false; n_names];
        let mut fan_of = vec![u32::MAX; n_names];
        census.is_vertex_manifold = census.is_edge_manifold;
        for (i, t) in faces.iter().enumerate() {
            for (k, &v) in t.iter().enumerate() {
                is_used[v as usize] = true;
                let fan = fans.root((3 * i + k) as u32);
                let known = &mut fan_of[v as usize];
                census.is_vertex_manifold &= *known == u32::MAX || *known == fan;
                *known = fan;
            }
        }
        for v in (0..n_names as u32).filter(|&v| is_used[v as usize]) {
            census.n_vertices += 1;
            census.n_components += usize::from(parts.root(v) == v);
        }
        let mut sizes = vec![0; n_names];
        faces.iter().for_each(|t| sizes[parts.root(t[0]) as usize] += 1);
        census.n_largest = sizes.into_iter().max().unwrap_or(0);
        census.euler = census.n_vertices as i64 - n_edges + faces.len() as i64;
        census
    }
}

/// Union-find.
struct Sets(Vec<u32>);

impl Sets {
    fn new(n: usize) -> Self {
        Sets((0..n as u32).collect())
    }

    fn root(&mut self, mut v: u32) -> u32 {
        while self.0[v as usize] != v {
            self.0[v as usize] = self.0[self.0[v as usize] as usize];
            v = self.0[v as usize];
        }
        v
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// For each vertex the first one in exactly the same place.
pub fn places(positions: &[[f64; 3]]) -> Vec<u32> {
    let key = |v: u32| positions[v as usize].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (key(v), v));
    let mut first = vec![0; positions.len()];
    for same in order.chunk_by(|&a, &b| key(a) == key(b)) {
        same.iter().for_each(|&v| first[v as usize] = same[0]);
    }
    first
}
