//! Peers that know colours: `bench colours NAME IN.ply OUT.ply TRIANGLES --weight W`.
//!
//! Reads a coloured PLY, simplifies with one of meshoptimizer's functions, writes a coloured PLY that
//! `stonecut measure` takes. Positions go to the unit cube first, as meshoptimizer's weights suppose; colours
//! are sRGB from 0 to 1. Other tools are run by the commands in docs/results/attributes.md.

use crate::Outcome;
use meshopt::{SimplifyOptions, VertexDataAdapter};
use std::path::Path;
use stonecut::io::ply::{FaceBlock, MeshSource, OutputHeader, PlyWriter, VertexBlock};
use stonecut::mesh::property::{Property, Scalar};
use stonecut::mesh::record::VertexSchema;

const NAMES: [&str; 3] = ["red", "green", "blue"];

/// Simplifies; `name` is `meshopt` (vertices stay where they are) or `meshopt-update` (they move).
pub fn run(name: &str, input: &Path, output: &Path, target: u64, weight: f32) -> Outcome<()> {
    let source = MeshSource::open(input)?;
    let schema = source.schema().clone();
    let mut at = Vec::new();
    for wanted in NAMES {
        let i = schema.properties.iter().position(|p| p.name == wanted && p.scalar == Scalar::U8);
        let i = i.ok_or("the input has no colours of bytes")?;
        let before: usize = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
        at.push(schema.position_bytes() + before);
    }
    let (mut exact, mut colours) = (Vec::new(), Vec::new());
    let mut block = VertexBlock::default();
    for index in 0..source.n_vertex_blocks() {
        source.read_vertices(index, &mut block)?;
        for record in block.records.chunks_exact(schema.record_bytes()) {
            exact.push(schema.position(record));
            colours.push([0, 1, 2].map(|k| f32::from(record[at[k]]) / 255.0));
        }
    }
    let mut indices: Vec<u32> = Vec::new();
    let mut faces = FaceBlock::default();
    for index in 0..source.n_face_blocks() {
        source.read_faces(index, &mut faces)?;
        indices.extend(faces.triangles.iter().flatten().map(|&v| v as u32));
    }
    let bound = |k: usize, pick: fn(f64, f64) -> f64| exact.iter().map(|p| p[k]).reduce(pick);
    let low = [0, 1, 2].map(|k| bound(k, f64::min).unwrap_or(0.0));
    let high = [0, 1, 2].map(|k| bound(k, f64::max).unwrap_or(0.0));
    let side = (0..3).map(|k| high[k] - low[k]).fold(f64::MIN_POSITIVE, f64::max);
    let mut positions: Vec<[f32; 3]> =
        exact.iter().map(|p| [0, 1, 2].map(|k| ((p[k] - low[k]) / side) as f32)).collect();
    let (weights, n_indices) = ([weight; 3], 3 * target as usize);
    let left = match name {
        "meshopt" => {
            let vertices = VertexDataAdapter::new(bytemuck::cast_slice(&positions), 12, 0)?;
            meshopt::simplify_with_attributes_and_locks(
                &indices,
                &vertices,
                colours.as_flattened(),
                &weights,
                12,
                &vec![false; positions.len()],
                n_indices,
                f32::MAX,
                SimplifyOptions::None,
                None,
            )
        }
        "meshopt-update" => {
            let n = meshopt::simplify_with_update(
                &mut indices,
                &mut positions,
                colours.as_flattened_mut(),
                &weights,
                12,
                None,
                n_indices,
                f32::MAX,
                SimplifyOptions::None,
                None,
            );
            indices.truncate(n);
            indices
        }
        _ => return Err(format!("no library with colours is named {name}").into()),
    };
    let mut place = vec![u32::MAX; positions.len()];
    let (mut triangles, mut records, mut n_vertices) = (Vec::new(), Vec::new(), 0);
    let out = VertexSchema {
        coordinate: schema.coordinate,
        properties: NAMES.map(|n| Property::new(n, Scalar::U8)).to_vec(),
    };
    for corners in left.chunks_exact(3) {
        triangles.push([corners[0], corners[1], corners[2]].map(|v| {
            let place = &mut place[v as usize];
            if *place == u32::MAX {
                *place = n_vertices;
                n_vertices += 1;
                let p = positions[v as usize];
                let p = [0, 1, 2].map(|k| f64::from(p[k]) * side + low[k]);
                out.encode_position(p, &mut records);
                let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
                records.extend(colours[v as usize].map(byte));
            }
            *place
        }));
    }
    let header = OutputHeader::new(out, u64::from(n_vertices), triangles.len() as u64);
    let mut writer = PlyWriter::create(output, header)?;
    writer.write_vertices(&records)?;
    writer.write_faces_u32(&triangles)?;
    writer.finish()?;
    Ok(())
}
