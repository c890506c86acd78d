//! The mesh between two rounds in memory, and the joining of simplified cells into it.

use crate::kernel::Simplified;
use crate::mesh::Mesh;
use crate::mesh::global_vertex::GlobalVertex;
use crate::store::cells::IdMap;

/// A mesh whose vertices know which vertex of the input they are.
#[derive(Default)]
pub(super) struct WholeMesh {
    /// Input vertex of each vertex, in 4 bytes.
    pub(super) ids: Vec<u32>,
    pub(super) mesh: Mesh,
}

/// One simplified cell.
pub(super) struct Left {
    /// Input vertex of each vertex that went into the kernel.
    pub(super) ids: Vec<GlobalVertex>,
    pub(super) simplified: Simplified,
}

impl WholeMesh {
    /// Joins cells, in their order; a vertex that several of them hold becomes one again.
    pub(super) fn join(cells: Vec<Left>) -> WholeMesh {
        let meshes = || cells.iter().map(|cell| &cell.simplified.mesh);
        let n_vertices = meshes().map(|mesh| mesh.positions.len()).sum();
        let n_triangles = meshes().map(|mesh| mesh.triangles.len()).sum();
        let n_channels = meshes().map(|mesh| mesh.n_channels).max().unwrap_or(0);
        let mut map = IdMap::with_capacity(n_vertices);
        let mut ids = Vec::with_capacity(n_vertices);
        let mut mesh = Mesh {
            positions: Vec::with_capacity(n_vertices),
            channels: Vec::with_capacity(n_vertices * n_channels),
            n_channels,
            triangles: Vec::with_capacity(n_triangles),
            ..Mesh::default()
        };
        let mut local = Vec::new();
        for Left { ids: inputs, simplified } in cells {
            local.clear();
            for (v, &source) in (0u32..).zip(&simplified.source) {
                let (index, is_new) = map.insert(inputs[source as usize], &mut ids);
                if is_new {
                    mesh.positions.push(simplified.mesh.positions[v as usize]);
                    mesh.channels.extend_from_slice(simplified.mesh.channels_of(v));
                }
                local.push(index);
            }
            let triangles = simplified.mesh.triangles.iter();
            mesh.triangles.extend(triangles.map(|t| t.map(|v| local[v as usize])));
            mesh.relief.extend_from_slice(&simplified.mesh.relief);
        }
        WholeMesh { ids: ids.into_iter().map(GlobalVertex::narrow).collect(), mesh }
    }

    /// Brings the vertices into the order of a key of their ids, and of these.
    pub(super) fn in_order(self, key: impl Fn(u32) -> u32) -> WholeMesh {
        let WholeMesh { ids, mesh } = self;
        let key = |id: &u32| (key(*id), *id);
        if ids.is_sorted_by_key(key) {
            return WholeMesh { ids, mesh };
        }
        let mut order: Vec<u32> = (0..ids.len() as u32).collect();
        order.sort_unstable_by_key(|&v| key(&ids[v as usize]));
        let mut place = vec![0u32; ids.len()];
        (0u32..).zip(&order).for_each(|(new, &old)| place[old as usize] = new);
        let channels = order.iter().flat_map(|&v| mesh.channels_of(v).iter().copied()).collect();
        WholeMesh {
            ids: order.iter().map(|&v| ids[v as usize]).collect(),
            mesh: Mesh {
                positions: order.iter().map(|&v| mesh.positions[v as usize]).collect(),
                channels,
                n_channels: mesh.n_channels,
                triangles: mesh.triangles.iter().map(|t| t.map(|v| place[v as usize])).collect(),
                relief: mesh.relief,
                ..Mesh::default()
            },
        }
    }
}
