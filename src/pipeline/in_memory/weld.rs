//! Copies of vertices in arrays that become one before everything else, as `io` does it for files.
//!
//! The mesh goes through the same survey and the same sort as a PLY file in memory, whose vertices carry their rows.
//! Joined vertices are where their mean is, with the attributes of the first of them.

use crate::config::Config;
use crate::error::Result;
use crate::io::ply::raw::RawFile;
use crate::io::ply::{MeshSource, ReadOptions};
use crate::io::{StageOptions, Weld, WeldOptions, weld_vertices};

/// A mesh without copies.
pub(super) struct Welded {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Row of each vertex in the arrays.
    pub(super) ids: Vec<u32>,
    /// Vertex that each row of the arrays became, if any were joined and `config` asks for a map.
    pub(super) numbers: Option<Vec<u32>>,
}

/// Joins copies as `config` says; `auto` looks only where triangles hardly have a vertex in common.
///
/// Memory: 41 bytes a triangle and 28 a vertex, and what the joined mesh takes.
pub(super) fn weld(
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    config: &Config,
) -> Result<Welded> {
    let is_loose = 2 * positions.len() >= 3 * triangles.len();
    let is_asked = match config.weld {
        Weld::Off => false,
        Weld::Auto => is_loose,
        Weld::Distance(_) => true,
    };
    if !is_asked {
        let ids = (0..positions.len() as u32).collect();
        return Ok(Welded { positions, triangles, ids, numbers: None });
    }
    let (n_vertices, n_triangles) = (positions.len(), triangles.len());
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {n_vertices}\nproperty double x\nproperty double y\n\
         property double z\nproperty uint row\nelement face {n_triangles}\n\
         property list uchar uint vertex_indices\nend_header\n"
    )
    .into_bytes();
    for (row, position) in (0u32..).zip(&positions) {
        position.iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
        bytes.extend_from_slice(&row.to_le_bytes());
    }
    for t in &triangles {
        bytes.push(3);
        t.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    let source = MeshSource::from_bytes("arrays", bytes, ReadOptions::default())?;
    let mut stage = StageOptions::new(std::env::temp_dir()).within(config.memory_bytes);
    let labels = Vec::new();
    stage.weld = Some(WeldOptions {
        how: config.weld,
        exact_above: 0,
        labels,
        keeps_numbers: config.map.is_some(),
    });
    let source = weld_vertices(source, &stage)?;
    if source.weld().is_none_or(|weld| weld.joined == 0) {
        let ids = (0..positions.len() as u32).collect();
        return Ok(Welded { positions, triangles, ids, numbers: None });
    }
    drop((positions, triangles));
    let mut welded = Welded {
        positions: Vec::new(),
        triangles: Vec::new(),
        ids: Vec::new(),
        numbers: source.joined_numbers().map(joined_numbers).transpose()?,
    };
    let schema = source.schema();
    source.each_vertex(|_, record| {
        welded.positions.push(schema.position(record));
        let row = record[schema.position_bytes()..].first_chunk::<4>();
        welded.ids.push(u32::from_le_bytes(*row.expect("a row is four bytes")));
        Ok(())
    })?;
    source.each_face_block(|faces| {
        welded.triangles.extend(faces.triangles.iter().map(|t| t.map(|v| v as u32)));
        Ok(())
    })?;
    Ok(welded)
}

fn joined_numbers(file: &RawFile) -> Result<Vec<u32>> {
    let mut numbers = vec![[0; 4]; (file.len() / 4) as usize];
    file.read_exact_at(numbers.as_flattened_mut(), 0)?;
    Ok(numbers.into_iter().map(u32::from_le_bytes).collect())
}
