//! The expected size of an output, and whether its format can hold it.

use crate::config::{Config, Normals, Target};
use crate::error::Result;
use crate::io::ply::{FaceSchema, MeshSource, VertexBlock};
use crate::io::{Expected, expected_bytes, refuse_too_large};
use crate::mesh::property::{Property, Scalar};
use crate::mesh::record::VertexSchema;
use crate::stages::write;

/// Vertices of the input by which the length of a text is expected.
const SAMPLED_VERTICES: usize = 512;

/// Expected bytes of the output, and of what its folder holds besides while it is written.
pub(in crate::pipeline) fn output(
    source: &MeshSource,
    config: &Config,
    n_vertices: u64,
    n_faces: u64,
) -> Result<(u64, u64)> {
    let kind = config.kind()?;
    let mut block = VertexBlock::default();
    source.read_vertices(source.n_vertex_blocks() / 2, &mut block)?;
    let record_bytes = source.schema().record_bytes();
    let n_rows = block.records.len() / record_bytes;
    let step = (n_rows / SAMPLED_VERTICES).max(1);
    let carry = source.carried().filter(|carry| carry.is_moved());
    let moved = carry.map_or(0, |carry| carry.vertex_properties().len());
    // What went from faces to vertices comes last, and goes back.
    let mut schema = source.schema().clone();
    schema.properties.truncate(schema.properties.len() - moved);
    let own_bytes = schema.record_bytes();
    let rows = block.records.chunks_exact(record_bytes).step_by(step);
    let mut sample: Vec<u8> = rows.flat_map(|row| &row[..own_bytes]).copied().collect();
    if config.attributes.normals == Normals::Recompute && !schema.properties.iter().any(is_normal) {
        (schema, sample) = with_normals(schema, &sample);
    }
    if config.error_field {
        let rows = sample.chunks_exact(schema.record_bytes());
        sample = rows.flat_map(|row| [row, &1f32.to_le_bytes()].concat()).collect();
        schema.properties.push(Property::new(write::REACH, Scalar::F32));
    }
    let faces = match carry {
        Some(carry) => FaceSchema {
            texture: carry.texture,
            properties: carry.written().map(|p| p.property.clone()).collect(),
        },
        None => FaceSchema::default(),
    };
    let expected =
        Expected { schema: &schema, faces: &faces, n_vertices, n_faces, sample: &sample };
    let (bytes, spool) = expected_bytes(&expected, kind, config.format);
    // How far a bound leads is known afterwards.
    if !matches!(config.target, Target::MaxError(_)) {
        refuse_too_large(kind, (n_faces, bytes), &config.output)?;
    }
    let comments = source.comments().iter().chain(source.obj_infos());
    Ok((bytes + comments.map(|line| line.len() as u64 + 9).sum::<u64>(), spool))
}

fn is_normal(property: &Property) -> bool {
    property.name == "nx"
}

/// The same records with room for a normal behind each.
fn with_normals(mut schema: VertexSchema, sample: &[u8]) -> (VertexSchema, Vec<u8>) {
    let component = 1.0 / 3f32.sqrt();
    let normal: Vec<u8> = [component; 3].iter().flat_map(|x| x.to_le_bytes()).collect();
    let rows = sample.chunks_exact(schema.record_bytes());
    let wider = rows.flat_map(|row| [row, &normal].concat()).collect();
    let new = ["nx", "ny", "nz"];
    let new = new.map(|name| Property::new(name, Scalar::F32));
    schema.properties.extend(new);
    (schema, wider)
}
