//! Finds the labels of vertices that lie in patches, so that the kernel keeps their borders (`mesh::patches`); floats that are
//! whole numbers in patches are labels, too. Measurements in whole numbers lie in bands and have no borders.
//!
//! Looks at some of the triangles; nothing is read where vertices have neither labels nor such floats. Changes nothing but the schema.

use crate::ply::{BLOCK_ROWS, FaceBlock, MeshSource, VertexBlock, VertexRecords};
use stonecut_mesh::patches::{PatchCount, WholeValues};
use stonecut_mesh::property::read_scalar;
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;

/// Blocks of faces that are looked at, evenly spaced.
const MOST_BLOCKS: u64 = 8;

/// Notes in the schema of `source` which labels lie in patches; `labels` are properties that are labels whatever their type.
///
/// Memory: some megabytes. Time: at most a pass over the vertices, if they have labels.
pub fn survey_labels(source: &mut MeshSource, labels: &[String]) -> Result<()> {
    let schema = source.schema().clone();
    let mut is_label = schema.label_properties(labels);
    let mut may_be_label = schema.float_properties(labels);
    // A mark of those that stay where they are says nothing of the others.
    if let Some(i) = source.lock_property().and_then(|name| schema.own_property(name)) {
        (is_label[i], may_be_label[i]) = (false, false);
    }
    let mut block = VertexBlock::default();
    if may_be_label.contains(&true) && source.n_vertices() > 0 {
        // Measurements are not whole numbers.
        source.read_vertices(0, &mut block)?;
        let may_be = WholeValues::are_few_and_whole;
        keep(&mut may_be_label, &schema, &block.records, may_be);
    }
    if !is_label.contains(&true) && !may_be_label.contains(&true) {
        return Ok(());
    }
    let (triangles, is_all) = sample(source)?;
    let mut ids: Vec<u64> = triangles.iter().flatten().copied().collect();
    ids.sort_unstable();
    ids.dedup();
    let record_bytes = schema.record_bytes();
    let mut records = Vec::with_capacity(ids.len() * record_bytes);
    let mut of_source = VertexRecords::new(source);
    for id in &ids {
        records.extend_from_slice(of_source.get(*id)?);
    }
    let rows: Vec<[usize; 3]> =
        triangles.iter().map(|t| t.map(|v| ids.partition_point(|id| *id < v))).collect();
    keep(&mut may_be_label, &schema, &records, WholeValues::are_labels);
    let mut at = schema.position_bytes();
    let mut is_patchy = vec![false; is_label.len()];
    for (i, property) in schema.properties.iter().enumerate() {
        let end = at + property.scalar.bytes();
        if is_label[i] || may_be_label[i] {
            let mut count = PatchCount::default();
            let value = |row: usize| &records[row * record_bytes..][at..end];
            for row in &rows {
                let values = row.map(value);
                count.add(values, values.map(|bytes| read_scalar(property.scalar, bytes, 0)));
            }
            is_patchy[i] = count.is_patchy(&property.name, labels, is_all);
        }
        at = end;
    }
    source.note_patchy(&is_patchy);
    Ok(())
}

/// Keeps the marks of properties whose values in some records `are` what they must be.
fn keep(marks: &mut [bool], schema: &VertexSchema, records: &[u8], are: fn(&WholeValues) -> bool) {
    let mut at = schema.position_bytes();
    for (property, mark) in schema.properties.iter().zip(marks) {
        if *mark {
            let mut values = WholeValues::default();
            for record in records.chunks_exact(schema.record_bytes()) {
                values.add(read_scalar(property.scalar, record, at));
            }
            *mark = are(&values);
        }
        at += property.scalar.bytes();
    }
}

/// Some of the triangles, and whether those are all.
fn sample(source: &MeshSource) -> Result<(Vec<[u64; 3]>, bool)> {
    let n_blocks = source.n_face_blocks();
    let every = n_blocks.div_ceil(MOST_BLOCKS).max(1);
    let taken = n_blocks.div_ceil(every) * BLOCK_ROWS;
    let step = (taken.min(source.n_triangles()) as usize).div_ceil(PatchCount::SAMPLE).max(1);
    let (mut triangles, mut block) = (Vec::new(), FaceBlock::default());
    for index in (0..n_blocks).step_by(every as usize) {
        source.read_faces(index, &mut block)?;
        triangles.extend(block.triangles.iter().step_by(step));
    }
    Ok((triangles, every == 1 && step == 1))
}
