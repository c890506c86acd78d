//! What is rendered, block by block: a mesh in memory or one on disk.

use crate::error::Result;
use crate::io::ply::{BLOCK_ROWS, FaceBlock, MeshSource, VertexBlock};
use crate::mesh::Mesh;
use crate::mesh::property::Scalar;

/// A block of vertices as the renderer wants them.
#[derive(Default)]
pub(super) struct Points {
    /// Positions in object space.
    pub(super) positions: Vec<[f64; 3]>,
    /// sRGB colours; empty where the scene has none or none are wanted.
    pub(super) colors: Vec<[u8; 3]>,
    scratch: VertexBlock,
}

/// A block of triangles.
#[derive(Default)]
pub(super) struct Faces {
    /// Corner ids.
    pub(super) triangles: Vec<[u64; 3]>,
    scratch: FaceBlock,
}

/// Anything that can be rendered; blocks can be read from any thread and hold at most `BLOCK_ROWS` rows.
pub(super) trait Scene: Sync {
    /// Number of vertices.
    fn n_vertices(&self) -> u64;
    /// Number of triangles.
    fn n_triangles(&self) -> u64;
    /// Reads vertices `block * BLOCK_ROWS` and following.
    fn points(&self, block: u64, out: &mut Points) -> Result<()>;
    /// Reads a block of triangles.
    fn faces(&self, block: u64, out: &mut Faces) -> Result<()>;
    /// Whether vertices have colours.
    fn is_colored(&self) -> bool;

    /// Number of vertex blocks.
    fn n_point_blocks(&self) -> u64 {
        self.n_vertices().div_ceil(BLOCK_ROWS)
    }

    /// Number of face blocks.
    fn n_face_blocks(&self) -> u64 {
        self.n_triangles().div_ceil(BLOCK_ROWS)
    }
}

/// A mesh in memory; `color` is the channel at which red, green and blue in [0, 255] begin.
pub(super) struct InMemory<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) color: Option<usize>,
}

impl Scene for InMemory<'_> {
    fn n_vertices(&self) -> u64 {
        self.mesh.positions.len() as u64
    }

    fn n_triangles(&self) -> u64 {
        self.mesh.triangles.len() as u64
    }

    fn points(&self, block: u64, out: &mut Points) -> Result<()> {
        let rows = rows(block, self.mesh.positions.len());
        out.positions.clear();
        out.positions.extend_from_slice(&self.mesh.positions[rows.clone()]);
        out.colors.clear();
        if let Some(first) = self.color {
            out.colors.extend(rows.map(|v| {
                let channels = &self.mesh.channels_of(v as u32)[first..first + 3];
                [0, 1, 2].map(|i| channels[i].round().clamp(0.0, 255.0) as u8)
            }));
        }
        Ok(())
    }

    fn faces(&self, block: u64, out: &mut Faces) -> Result<()> {
        let rows = rows(block, self.mesh.triangles.len());
        out.triangles.clear();
        out.triangles.extend(self.mesh.triangles[rows].iter().map(|t| t.map(u64::from)));
        Ok(())
    }

    fn is_colored(&self) -> bool {
        self.color.is_some()
    }
}

/// A mesh on disk.
pub(super) struct OnDisk<'a> {
    source: &'a MeshSource,
    /// Byte offsets of red, green and blue in a vertex record, and their type.
    color: Option<([usize; 3], Scalar)>,
}

impl<'a> OnDisk<'a> {
    /// The scene of a source; without its colours unless they are wanted.
    pub(super) fn new(source: &'a MeshSource, colored: bool) -> Self {
        let find = |name: &str| {
            let schema = source.schema();
            let mut offset = schema.position_bytes();
            for property in &schema.properties {
                if property.name == name || property.name == format!("diffuse_{name}") {
                    return Some((offset, property.scalar));
                }
                offset += property.scalar.bytes();
            }
            None
        };
        let color = match (find("red"), find("green"), find("blue")) {
            (Some((r, scalar)), Some((g, _)), Some((b, _)))
                if colored && matches!(scalar, Scalar::U8 | Scalar::U16 | Scalar::F32) =>
            {
                Some(([r, g, b], scalar))
            }
            _ => None,
        };
        OnDisk { source, color }
    }
}

impl Scene for OnDisk<'_> {
    fn n_vertices(&self) -> u64 {
        self.source.n_vertices()
    }

    fn n_triangles(&self) -> u64 {
        self.source.n_triangles()
    }

    fn n_face_blocks(&self) -> u64 {
        self.source.n_face_blocks()
    }

    fn points(&self, block: u64, out: &mut Points) -> Result<()> {
        self.source.read_vertices(block, &mut out.scratch)?;
        let schema = self.source.schema();
        let records = out.scratch.records.chunks_exact(schema.record_bytes());
        out.positions.clear();
        out.positions.extend(records.clone().map(|record| schema.position(record)));
        out.colors.clear();
        if let Some((offsets, scalar)) = self.color {
            out.colors.extend(records.map(|record| {
                offsets.map(|at| match scalar {
                    Scalar::U8 => record[at],
                    Scalar::U16 => record[at + 1],
                    _ => {
                        let bytes = [record[at], record[at + 1], record[at + 2], record[at + 3]];
                        (255.0 * f32::from_le_bytes(bytes)).clamp(0.0, 255.0) as u8
                    }
                })
            }));
        }
        Ok(())
    }

    fn faces(&self, block: u64, out: &mut Faces) -> Result<()> {
        self.source.read_faces(block, &mut out.scratch)?;
        std::mem::swap(&mut out.triangles, &mut out.scratch.triangles);
        Ok(())
    }

    fn is_colored(&self) -> bool {
        self.color.is_some()
    }
}

fn rows(block: u64, n: usize) -> std::ops::Range<usize> {
    let from = (block * BLOCK_ROWS) as usize;
    from.min(n)..(from + BLOCK_ROWS as usize).min(n)
}
