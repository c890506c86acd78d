//! Stage 4: the result becomes one file; vertices once, faces once, by rename.
//!
//! Vertices have numbers in the order of the first cell that holds them. Where texture coordinates came
//! from corners, or values from faces, `join` makes one vertex of what lies in one place, and faces have
//! them again (`faces`).
//! `store/shape` says what of a record is written, `normals` recomputes it if asked.

mod faces;
mod join;
mod map;
mod normals;
mod numbering;

use faces::BackToFaces;
use join::Joined;
pub use join::sort_memory_bytes;
pub use map::{MAP, MAP_DISK_BYTES, MapCounts, write_map};
use normals::Recomputed;
pub use numbering::shared_bytes;
use numbering::{encode, index_vertices, own_vertices};
use stonecut_io::ply::{OutputHeader, Place, TexturedTriangle};
use stonecut_io::{MeshSink, NUMBER, OBJECT, OutputFormat, OutputKind};
use stonecut_mesh::codec::TEXTURE_NAMES;
use stonecut_mesh::face_properties::{FacePolicy, FacePropertyPlan};
pub use stonecut_mesh::property::REACH;
use stonecut_mesh::record::VertexSchema;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::SurvivorPack;
use stonecut_store::config::Normals;
pub use stonecut_store::shape::Shape;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Triangles that go to the file together.
const CHUNK: usize = 65_536;

/// Bytes of records that go to the file together.
const RECORD_BYTES: usize = 4 << 20;

/// Result of writing.
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
#[derive(Clone, Debug, Default)]
pub struct Form {
    /// Kind and encoding of the file.
    pub format: OutputFormat,
    /// Properties that go back from vertices to faces; `texture` if the kind of file takes it at corners.
    pub faces: FacePropertyPlan,
    /// Fate of normals.
    pub normals: Normals,
    /// True if each vertex is written with its distance from the input, as property `error`.
    pub has_reach: bool,
}

impl Form {
    /// Returns whether what came from faces goes back to them.
    fn goes_back(&self) -> bool {
        let takes_corners = self.format.kind.is_none_or(|kind| kind != OutputKind::Stl);
        self.faces.is_moved() && (takes_corners || !self.faces.texture)
    }

    /// Losses of what all faces have in common, where nothing goes back to them: no vertex has it.
    fn lost_constants(&self) -> impl Iterator<Item = Loss> {
        let is_lost = self.faces.is_moved() && !self.goes_back();
        let constants = self.faces.written().filter(move |property| {
            let name = property.property.name.as_str();
            // Numbers of images and names mean nothing without these, which are named themselves.
            is_lost && property.how == FacePolicy::Constant && name != NUMBER && name != OBJECT
        });
        constants.map(|property| {
            let what = format!("property of faces '{}'", property.property.name);
            Loss::new(LossKind::Attributes, what, "the format has no place for it").whole()
        })
    }

    /// Returns whether vertices in one place were one in the input. Where texture is at vertices, they have to
    /// stay apart.
    fn joins(&self, schema: &VertexSchema) -> bool {
        let n_own = schema.properties.len() - self.faces.vertex_properties().len();
        let is_textured = |pair: &[&str; 2]| {
            pair.iter().all(|name| schema.own_property(name).is_some_and(|i| i < n_own))
        };
        self.goes_back() && !TEXTURE_NAMES.iter().any(is_textured)
    }
}

/// Writes all cells of `result` as one mesh; a vertex that several cells hold is written once.
///
/// Vertices come in the order of their first cell. Where faces carried something, vertices in one place are
/// one again, with what the first of them carries. Memory: one cell, `shared_bytes` for shared vertices (twice that
/// with new normals), and to join a quarter of the run's for sorting; disk then 72 bytes a vertex.
pub fn write(
    result: &SurvivorPack,
    place: Place,
    header: OutputHeader,
    form: Form,
    run: &StageContext,
) -> Result<Written> {
    let layout = result.layout();
    let info = result.info();
    let mut uses = index_vertices(result)?;
    let back = BackToFaces::new(&layout.schema, &form.faces, form.goes_back());
    let joined = match form.joins(&layout.schema) {
        true => Some(Joined::new(result, &uses, run)?),
        false => None,
    };
    let n_vertices = joined.as_ref().map_or(uses.n_vertices, |joined| joined.n_vertices);
    let shape = Shape::new(&layout.schema, back.n_properties, form.normals, form.has_reach);
    let reach_channel = layout.reach_channel();
    let normals = match form.normals {
        Normals::Recompute => Some(Recomputed::new(result, run)?),
        Normals::Keep | Normals::Drop => None,
    };
    let header = OutputHeader {
        schema: shape.schema.clone(),
        n_vertices,
        n_faces: info.triangles,
        faces: back.schema.clone(),
        ..header
    };
    let mut writer = MeshSink::create(place, header, form.format)?;
    let (mut first, mut n_written) = (0, 0);
    let (mut records, mut encoded) = (Vec::new(), Vec::new());
    for cell in CellId::first(info.cells.len()) {
        run.progress.check()?;
        let part = result.load_recorded(cell)?;
        let own = own_vertices(&part, cell, &uses);
        let numbers = numbers_of(first, own.len(), joined.as_ref())?;
        let directions = normals.as_ref().map(|normals| normals.of(&part));
        records.clear();
        for (&vertex, &number) in own.iter().zip(&numbers) {
            if number == n_written {
                n_written += 1;
                encoded.clear();
                encode(result, &part, vertex, &mut encoded);
                let normal = directions.as_ref().map(|list| list[vertex]);
                let channels = part.mesh.channels_of(vertex as u32);
                let reach = reach_channel.map_or(0.0, |channel| channels[channel]);
                shape.put(&encoded, normal, reach, &mut records);
                if records.len() >= RECORD_BYTES {
                    writer.write_vertices(&records)?;
                    records.clear();
                }
            }
            if part.shared[vertex] {
                uses.shared.insert(part.ids[vertex], (cell, number));
            }
        }
        first += own.len() as u64;
        writer.write_vertices(&records)?;
        run.progress.add(info.cells[cell].triangles / 2);
    }
    first = 0;
    for cell in CellId::first(info.cells.len()) {
        run.progress.check()?;
        let part = result.load(cell)?;
        let own = own_vertices(&part, cell, &uses);
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
        let mut of_cell = back.of_cell(result, &part);
        for chunk in part.mesh.triangles.chunks(CHUNK) {
            if back.schema.is_empty() {
                let triangles: Vec<[u64; 3]> = chunk.iter().map(corners).collect();
                writer.write_faces(&triangles)?;
            } else {
                let faces = of_cell.faces(chunk);
                let textured = chunk.iter().zip(&faces.texture).map(|(t, &texture)| {
                    TexturedTriangle { corners: corners(t), texture, ..TexturedTriangle::default() }
                });
                writer.write_full_faces(&textured.collect::<Vec<_>>(), &faces.values)?;
            }
        }
        run.progress.add(info.cells[cell].triangles.div_ceil(2));
    }
    run.progress.lose_all(&writer.losses());
    form.lost_constants().for_each(|loss| run.progress.lose(loss));
    Ok(Written { vertices: n_vertices, triangles: info.triangles, bytes: writer.finish()? })
}

/// Numbers in the output of `n` vertices from number `first`.
fn numbers_of(first: u64, n: usize, joined: Option<&Joined>) -> Result<Vec<u64>> {
    match joined {
        None => Ok((first..first + n as u64).collect()),
        Some(joined) => joined.numbers(first, n),
    }
}
