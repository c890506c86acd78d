//! Stage 4: the result becomes one file; vertices once, faces once, by rename.
//!
//! Vertices have numbers in the order of the first cell that holds them. Where texture coordinates came
//! from corners, `join` makes one vertex of what lies in one place, and faces have coordinates again.
//! `shape` says what of a record is written, `normals` computes it anew if asked.

mod join;
mod normals;
mod shape;

use crate::cells::{SurvivorPack, Survivors};
use crate::config::Normals;
use crate::error::Result;
use crate::formats::{MeshSink, OutputFormat};
use crate::ply::{OutputHeader, Place, TexturedTriangle};
use crate::run::Run;
use join::Joined;
use normals::Recomputed;
use shape::Shape;
use std::collections::HashMap;

/// Triangles that go to the file together.
const CHUNK: usize = 65_536;

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

/// In which form a result is written.
#[derive(Clone, Copy, Debug, Default)]
pub struct Form {
    /// Kind and encoding of the file.
    pub format: OutputFormat,
    /// Texture coordinates go back to corners: the last two properties, or with an image's number (true)
    /// three.
    pub corners: Option<bool>,
    /// What becomes of normals.
    pub normals: Normals,
}

/// Writes all cells of `result` as one mesh; a vertex that several cells hold is written once.
///
/// Vertices come in the order of their first cell. With texture at corners, vertices in one place are one
/// again, with what the first of them carries. Memory: one cell, 48 bytes per shared vertex (twice that with
/// new normals), and with texture at corners a quarter of the run's for sorting; disk then 72 bytes a vertex.
pub fn write(
    result: &SurvivorPack,
    place: Place,
    header: OutputHeader,
    form: Form,
    run: &Run,
) -> Result<Written> {
    let layout = result.layout();
    let info = result.info();
    let mut uses = index_vertices(result)?;
    let joined = match form.corners {
        Some(_) => Some(Joined::new(result, &uses, run)?),
        None => None,
    };
    let n_vertices = joined.as_ref().map_or(uses.n_vertices, |joined| joined.n_vertices);
    let n_texture = form.corners.map_or(0, |with_image| if with_image { 3 } else { 2 });
    let shape = Shape::new(&layout.schema, n_texture, form.normals);
    let normals = match form.normals {
        Normals::Recompute => Some(Recomputed::new(result, run)?),
        Normals::Keep | Normals::Drop => None,
    };
    let header = OutputHeader {
        schema: shape.schema.clone(),
        n_vertices,
        n_faces: info.triangles,
        corner_texture: form.corners,
        ..header
    };
    let mut writer = MeshSink::create(place, header, form.format)?;
    let (mut first, mut n_written) = (0, 0);
    let (mut records, mut encoded) = (Vec::new(), Vec::new());
    for cell in 0..info.cells.len() {
        run.progress.check()?;
        let part = result.load(cell)?;
        let own = own_vertices(&part, cell as u32, &uses);
        let numbers = numbers_of(first, own.len(), joined.as_ref())?;
        let directions = normals.as_ref().map(|normals| normals.of(&part));
        records.clear();
        for (&vertex, &number) in own.iter().zip(&numbers) {
            if number == n_written {
                n_written += 1;
                encoded.clear();
                encode(result, &part, vertex, &mut encoded);
                let normal = directions.as_ref().map(|list| list[vertex]);
                shape.put(&encoded, normal, &mut records);
            }
            if part.shared[vertex] {
                uses.shared.insert(part.ids[vertex], (cell as u32, number));
            }
        }
        first += own.len() as u64;
        writer.write_vertices(&records)?;
        run.progress.add(info.cells[cell].triangles / 2);
    }
    first = 0;
    for cell in 0..info.cells.len() {
        run.progress.check()?;
        let part = result.load(cell)?;
        let own = own_vertices(&part, cell as u32, &uses);
        let own_numbers = numbers_of(first, own.len(), joined.as_ref())?;
        first += own.len() as u64;
        let mut numbers = vec![0; part.ids.len()];
        for (id, number) in part.ids.iter().zip(&mut numbers) {
            *number = uses.shared.get(id).map_or(0, |known| known.1);
        }
        for (&vertex, &number) in own.iter().zip(&own_numbers) {
            numbers[vertex] = number;
        }
        let corners = |t: &[u32; 3]| t.map(|v| numbers[v as usize]);
        match form.corners {
            None => {
                let triangles: Vec<[u64; 3]> = part.mesh.triangles.iter().map(corners).collect();
                writer.write_faces(&triangles)?;
            }
            Some(with_image) => {
                let texture = texture(result, &part, n_texture);
                for chunk in part.mesh.triangles.chunks(CHUNK) {
                    let textured = chunk.iter().map(|t| TexturedTriangle {
                        corners: corners(t),
                        texture: t.map(|v| {
                            let [s, t, _] = texture[v as usize];
                            [s, t].map(f32::from_bits)
                        }),
                        image: if with_image { texture[t[0] as usize][2] as i32 } else { 0 },
                    });
                    writer.write_textured_faces(&textured.collect::<Vec<_>>())?;
                }
            }
        }
        run.progress.add(info.cells[cell].triangles.div_ceil(2));
    }
    Ok(Written { vertices: n_vertices, triangles: info.triangles, bytes: writer.finish()? })
}

/// Appends the record of a vertex.
fn encode(result: &SurvivorPack, part: &Survivors, vertex: usize, out: &mut Vec<u8>) {
    let layout = result.layout();
    let record_bytes = layout.schema.record_bytes();
    let record = &part.records[vertex * record_bytes..(vertex + 1) * record_bytes];
    let channels = part.mesh.channels_of(vertex as u32);
    layout.codec.encode(part.mesh.positions[vertex], channels, record, out);
}

/// The last `n_words` of every vertex's properties: texture coordinates and perhaps an image's number.
fn texture(result: &SurvivorPack, part: &Survivors, n_words: usize) -> Vec<[u32; 3]> {
    let mut encoded = Vec::new();
    let words = |vertex| {
        encoded.clear();
        encode(result, part, vertex, &mut encoded);
        let mut words = [0; 3];
        let bytes = &encoded[encoded.len() - 4 * n_words..];
        for (word, bytes) in words.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        words
    };
    (0..part.ids.len()).map(words).collect()
}

/// For every shared vertex, the first cell that holds it and its number.
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

/// The vertices of a cell that no earlier cell holds, in order: they have consecutive numbers.
fn own_vertices(part: &Survivors, cell: u32, uses: &FirstUses) -> Vec<usize> {
    let is_own =
        |v: &usize| !part.shared[*v] || uses.shared.get(&part.ids[*v]).is_none_or(|u| u.0 == cell);
    (0..part.ids.len()).filter(is_own).collect()
}

/// Numbers in the output of `n` vertices from number `first`.
fn numbers_of(first: u64, n: usize, joined: Option<&Joined>) -> Result<Vec<u64>> {
    match joined {
        None => Ok((first..first + n as u64).collect()),
        Some(joined) => joined.numbers(first, n),
    }
}
