//! Stage 4: the result becomes one file; vertices once, faces once, by rename.

use crate::cells::{SurvivorPack, Survivors};
use crate::error::Result;
use crate::formats::{MeshSink, OutputFormat};
use crate::ply::{OutputHeader, Place, TexturedTriangle};
use crate::run::Run;
use std::collections::HashMap;

/// What was written.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Written {
    /// Vertices in the output.
    pub vertices: u64,
    /// Triangles in the output.
    pub triangles: u64,
    /// Bytes of the output.
    pub bytes: u64,
}

/// Writes all cells of `result` as one mesh; a vertex that several cells hold is written once.
///
/// Vertices come in the order of their first cell. Memory: one cell, and 48 bytes per shared vertex.
pub fn write(
    result: &SurvivorPack,
    place: Place,
    header: OutputHeader,
    format: OutputFormat,
    run: &Run,
) -> Result<Written> {
    let layout = result.layout();
    let info = result.info();
    let first_uses = index_vertices(result)?;
    let n_vertices = first_uses.n_vertices;
    let header = OutputHeader { n_vertices, n_faces: info.triangles, ..header };
    let mut writer = MeshSink::create(place, header, format)?;
    let record_bytes = layout.schema.record_bytes();
    let mut records = Vec::new();
    for cell in 0..info.cells.len() {
        run.progress.check()?;
        let part = result.load(cell)?;
        records.clear();
        for vertex in 0..part.ids.len() {
            if part.shared[vertex] && first_uses.shared[&part.ids[vertex]].0 != cell as u32 {
                continue;
            }
            let record = &part.records[vertex * record_bytes..(vertex + 1) * record_bytes];
            let channels = part.mesh.channels_of(vertex as u32);
            layout.codec.encode(part.mesh.positions[vertex], channels, record, &mut records);
        }
        writer.write_vertices(&records)?;
        run.progress.add(info.cells[cell].triangles / 2);
    }
    let mut next = 0;
    for cell in 0..info.cells.len() {
        run.progress.check()?;
        let part = result.load(cell)?;
        let numbers = number(&part, cell as u32, &mut next, &first_uses);
        let triangles: Vec<[u64; 3]> =
            part.mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect();
        writer.write_faces(&triangles)?;
        run.progress.add(info.cells[cell].triangles.div_ceil(2));
    }
    let bytes = writer.finish()?;
    Ok(Written { vertices: n_vertices, triangles: info.triangles, bytes })
}

/// Writes a result of one cell whose texture coordinates were moved from corners to vertices, as it was:
/// vertices in one place are one again, with what the first of them carries, and corners have coordinates.
///
/// Memory: the result, and 32 bytes a vertex.
pub fn write_corners(
    result: &SurvivorPack,
    place: Place,
    header: OutputHeader,
    (format, with_image): (OutputFormat, bool),
    run: &Run,
) -> Result<Written> {
    let layout = result.layout();
    let (record_bytes, position_bytes) =
        (layout.schema.record_bytes(), layout.schema.position_bytes());
    let part = result.load(0)?;
    let n_dropped = if with_image { 3 } else { 2 };
    let at = record_bytes - 4 * n_dropped;
    let (mut records, mut kept) = (Vec::new(), Vec::new());
    let (mut number, mut numbers) = (HashMap::new(), Vec::with_capacity(part.ids.len()));
    for vertex in 0..part.ids.len() {
        let record = &part.records[vertex * record_bytes..(vertex + 1) * record_bytes];
        let channels = part.mesh.channels_of(vertex as u32);
        let start = records.len();
        layout.codec.encode(part.mesh.positions[vertex], channels, record, &mut records);
        let n = number.len() as u64;
        let own = *number.entry(records[start..start + position_bytes].to_vec()).or_insert(n);
        if own == n {
            kept.extend_from_slice(&records[start..start + at]);
        }
        numbers.push(own);
    }
    let mut schema = layout.schema.clone();
    schema.properties.truncate(schema.properties.len() - n_dropped);
    let (vertices, triangles) = (number.len() as u64, part.mesh.triangles.len() as u64);
    drop(number);
    let mut writer = MeshSink::create(
        place,
        OutputHeader {
            schema,
            n_vertices: vertices,
            n_faces: triangles,
            corner_texture: Some(with_image),
            ..header
        },
        format,
    )?;
    writer.write_vertices(&kept)?;
    let word = |v: u32, i: usize| {
        let at = v as usize * record_bytes + at + 4 * i;
        [records[at], records[at + 1], records[at + 2], records[at + 3]]
    };
    for chunk in part.mesh.triangles.chunks(65_536) {
        run.progress.check()?;
        let textured = chunk.iter().map(|t| TexturedTriangle {
            corners: t.map(|v| numbers[v as usize]),
            texture: t.map(|v| [word(v, 0), word(v, 1)].map(f32::from_le_bytes)),
            image: if with_image { i32::from_le_bytes(word(t[0], 2)) } else { 0 },
        });
        writer.write_textured_faces(&textured.collect::<Vec<_>>())?;
        run.progress.add(chunk.len() as u64);
    }
    Ok(Written { vertices, triangles, bytes: writer.finish()? })
}

/// For every shared vertex, the first cell that holds it and its number in the output.
struct FirstUses {
    shared: HashMap<u64, (u32, u64)>,
    n_vertices: u64,
}

fn index_vertices(result: &SurvivorPack) -> Result<FirstUses> {
    let mut uses = FirstUses { shared: HashMap::new(), n_vertices: 0 };
    for cell in 0..result.info().cells.len() {
        let part = result.load(cell)?;
        for (&id, &shared) in part.ids.iter().zip(&part.shared) {
            if shared {
                let mut is_new = false;
                uses.shared.entry(id).or_insert_with(|| {
                    is_new = true;
                    (cell as u32, uses.n_vertices)
                });
                uses.n_vertices += u64::from(is_new);
            } else {
                uses.n_vertices += 1;
            }
        }
    }
    Ok(uses)
}

/// Output numbers of a cell's vertices, in the order in which they were written.
fn number(part: &Survivors, cell: u32, next: &mut u64, uses: &FirstUses) -> Vec<u64> {
    let mut numbers = Vec::with_capacity(part.ids.len());
    for (id, &shared) in part.ids.iter().zip(&part.shared) {
        let known = if shared { uses.shared.get(id).copied() } else { None };
        match known {
            Some((first_cell, number)) if first_cell != cell => numbers.push(number),
            _ => {
                numbers.push(*next);
                *next += 1;
            }
        }
    }
    numbers
}
