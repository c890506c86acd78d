//! Meshes to render, block by block: in memory or on disk.

use super::view::{Coloring, View};
use stonecut_io::ply::{BLOCK_ROWS, FaceBlock, FaceLooks, MeshSource, VertexBlock};
use stonecut_mesh::Mesh;
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::property::{Origin, Scalar, read_scalar};
use stonecut_mesh::viridis::viridis;
use stonecut_system::error::Result;

/// A block of vertices as the renderer wants them.
#[derive(Default)]
pub(super) struct Points {
    /// Positions in object space.
    pub(super) positions: Vec<[f64; 3]>,
    /// sRGB colours; empty where the scene has none or none are wanted.
    pub(super) colors: Vec<[u8; 3]>,
    /// Normals of the file, in object space; empty where it has none or none are wanted.
    pub(super) normals: Vec<[f32; 3]>,
    scratch: VertexBlock,
}

/// A block of triangles.
#[derive(Default)]
pub(super) struct Faces {
    /// Corner ids.
    pub(super) triangles: Vec<[u64; 3]>,
    /// Their texture coordinates and materials; empty where none are wanted.
    pub(super) looks: FaceLooks,
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
    /// Returns whether vertices have colours.
    fn is_colored(&self) -> bool;
    /// Returns whether colours of vertices multiply those of materials and images.
    fn is_tinted(&self) -> bool {
        false
    }
    /// Returns whether vertices come with normals.
    fn has_normals(&self) -> bool {
        false
    }

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
    paint: Paint,
    /// With what faces have of materials.
    has_looks: bool,
    /// Byte offsets and types of the components of normals, if they are wanted and there.
    normal: Option<[(usize, Scalar); 3]>,
}

/// Place of the colour in a vertex record.
enum Paint {
    None,
    Rgb(ColourPlace),
    /// Byte offset and type of a number, and the end of its scale.
    Number(usize, Scalar, f64),
}

/// Byte offset and type of a property in the vertex records of a source.
pub(super) fn find(source: &MeshSource, name: &str) -> Option<(usize, Scalar)> {
    let schema = source.schema();
    let mut offset = schema.position_bytes();
    for property in &schema.properties {
        if property.origin == Origin::Vertex && property.name == name {
            return Some((offset, property.scalar));
        }
        offset += property.scalar.bytes();
    }
    None
}

impl<'a> OnDisk<'a> {
    /// The scene of a source without colours.
    pub(super) fn plain(source: &'a MeshSource) -> Self {
        OnDisk { source, paint: Paint::None, has_looks: false, normal: None }
    }

    /// The scene of a source with the colours that `view` wants, as far as it has them.
    pub(super) fn new(source: &'a MeshSource, view: &View) -> Self {
        let paint = match (&view.scale, view.coloring) {
            (Some(scale), _) => match find(source, &scale.property) {
                Some((at, scalar)) => Paint::Number(at, scalar, scale.top),
                None => Paint::None,
            },
            (None, Coloring::Plain) => Paint::None,
            (None, Coloring::Vertex { .. } | Coloring::Texture) => {
                ColourPlace::find(source.schema()).map_or(Paint::None, Paint::Rgb)
            }
        };
        let has_looks = view.scale.is_none() && view.coloring == Coloring::Texture;
        OnDisk { source, paint, has_looks, normal: None }
    }

    /// The same with the places of faces in images and the normals of vertices, for normal maps.
    pub(super) fn with_frames(self) -> Self {
        let [x, y, z] = ["nx", "ny", "nz"].map(|name| find(self.source, name));
        let normal = x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]);
        OnDisk { has_looks: true, normal, ..self }
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
        out.normals.clear();
        if let Some(places) = self.normal {
            let value =
                |record: &[u8]| places.map(|(at, scalar)| read_scalar(scalar, record, at) as f32);
            out.normals.extend(records.clone().map(value));
        }
        out.colors.clear();
        match self.paint {
            Paint::None => {}
            Paint::Number(at, scalar, top) => {
                out.colors
                    .extend(records.map(|record| viridis(read_scalar(scalar, record, at), top)));
            }
            Paint::Rgb(colour) => out.colors.extend(records.map(|record| colour.bytes(record))),
        }
        Ok(())
    }

    fn faces(&self, block: u64, out: &mut Faces) -> Result<()> {
        if self.has_looks {
            self.source.read_faces_with_looks(block, &mut out.scratch, &mut out.looks)?;
        } else {
            self.source.read_faces(block, &mut out.scratch)?;
        }
        std::mem::swap(&mut out.triangles, &mut out.scratch.triangles);
        Ok(())
    }

    fn is_colored(&self) -> bool {
        !matches!(self.paint, Paint::None)
    }

    fn is_tinted(&self) -> bool {
        let is_colour = matches!(self.paint, Paint::Rgb(_));
        self.has_looks && is_colour && !self.source.images_hide_colours()
    }

    fn has_normals(&self) -> bool {
        self.normal.is_some()
    }
}

fn rows(block: u64, n: usize) -> std::ops::Range<usize> {
    let from = (block * BLOCK_ROWS) as usize;
    from.min(n)..(from + BLOCK_ROWS as usize).min(n)
}
