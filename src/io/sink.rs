//! The output of a run, whatever its format: one writer for each kind, and the images and materials beside it.

use super::gltf::{GlbWriter, Positions};
use super::materials::TexturePlan;
use super::obj::ObjWriter;
use super::output_format::{OutputFormat, OutputKind};
use super::rounding::Rounding;
use super::stl::StlWriter;
use crate::error::Result;
use crate::io::ply::{Encoding, OutputHeader, Place, PlyFormat, PlyWriter, TexturedTriangle};
use crate::mesh::codec::TEXTURE_NAMES;
use crate::mesh::colours::ColourPlace;
use crate::mesh::record::VertexSchema;
use crate::system::disk::Disk;

/// Writes a mesh in any format: all vertices, then all faces; the file appears when it is finished.
pub struct MeshSink {
    writer: Writer,
    /// Files that come before the mesh, and the disk that they are written through.
    textures: Option<(TexturePlan, Disk)>,
    /// Faces whose texture coordinates no OBJ or GLB can hold.
    n_not_finite: u64,
    /// Properties of vertices that the format does not have.
    lost: Vec<String>,
    /// The colour of vertices, where the format has only shares of white.
    colour: Option<(ColourPlace, usize)>,
    /// Vertices whose colour was clamped.
    n_clamped: u64,
    schema: VertexSchema,
    rounding: Option<Rounding>,
}

/// Properties of vertices that a kind of file does not have. Normals of STL are those of its facets.
fn lost_properties(schema: &VertexSchema, kind: OutputKind) -> Vec<String> {
    const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
    const COLOURS: [&str; 9] =
        ["red", "green", "blue", "diffuse_red", "diffuse_green", "diffuse_blue", "r", "g", "b"];
    let alpha = ColourPlace::find(schema).and_then(|place| place.alpha_name());
    let is_kept = |name: &str| match kind {
        OutputKind::Ply => true,
        OutputKind::Stl => NORMALS.contains(&name),
        OutputKind::Glb if alpha == Some(name) => true,
        OutputKind::Obj | OutputKind::Glb => {
            NORMALS.contains(&name)
                || COLOURS.contains(&name)
                || TEXTURE_NAMES.as_flattened().contains(&name)
        }
    };
    let names = schema.properties.iter().map(|property| property.name.clone());
    names.filter(|name| !is_kept(name)).collect()
}

/// One writer for each kind of file.
enum Writer {
    Ply(Box<PlyWriter>),
    Stl(Box<StlWriter>),
    Obj(Box<ObjWriter>),
    Glb(Box<GlbWriter>),
}

impl MeshSink {
    /// Creates the output under a temporary name in its folder.
    ///
    /// STL and GLB spool the positions, 12 to 48 bytes a vertex, to a nameless file in that folder.
    pub fn create(
        place: impl Into<Place>,
        header: OutputHeader,
        format: OutputFormat,
    ) -> Result<Self> {
        let place = place.into();
        let encoding = format.encoding.unwrap_or(Encoding::BinaryLittleEndian);
        let textures = header.textures.clone().map(|plan| (plan, place.disk.clone()));
        let kind = format.check(&place.path)?;
        let lost = lost_properties(&header.schema, kind);
        let colour = ColourPlace::find(&header.schema)
            .filter(|_| matches!(kind, OutputKind::Obj | OutputKind::Glb))
            .map(|place| (place, header.schema.record_bytes()));
        let schema = header.schema.clone();
        let rounding = Rounding::of(&schema, kind, format);
        let writer = match kind {
            OutputKind::Ply => {
                let ply =
                    PlyFormat { encoding, coordinate: format.coordinate, index: format.index };
                Writer::Ply(Box::new(PlyWriter::create_as(place, header, ply)?))
            }
            OutputKind::Stl => Writer::Stl(Box::new(StlWriter::create(place, header, encoding)?)),
            OutputKind::Obj => Writer::Obj(Box::new(ObjWriter::create(place, header)?)),
            OutputKind::Glb => {
                let positions = match format.coordinate {
                    Some(_) => Positions::Floats,
                    None => Positions::Steps,
                };
                Writer::Glb(Box::new(GlbWriter::create_as(place, header, positions)?))
            }
        };
        Ok(MeshSink {
            writer,
            textures,
            n_not_finite: 0,
            lost,
            colour,
            n_clamped: 0,
            schema,
            rounding,
        })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        if let Some((colour, n_bytes)) = &self.colour {
            let rows = records.chunks_exact(*n_bytes);
            self.n_clamped += rows.filter(|row| colour.is_clamped(row)).count() as u64;
        }
        if let Some(rounding) = &mut self.rounding {
            rounding.add_vertices(&self.schema, records);
        }
        match &mut self.writer {
            Writer::Ply(sink) => sink.write_vertices(records),
            Writer::Stl(sink) => sink.write_vertices(records),
            Writer::Obj(sink) => sink.write_vertices(records),
            Writer::Glb(sink) => sink.write_vertices(records),
        }
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        if let Some(rounding) = &mut self.rounding {
            rounding.add_faces(triangles.iter().copied());
        }
        match &mut self.writer {
            Writer::Ply(sink) => sink.write_faces(triangles),
            Writer::Stl(sink) => sink.write_faces(triangles),
            Writer::Obj(sink) => sink.write_faces(triangles),
            Writer::Glb(sink) => sink.write_faces(triangles),
        }
    }

    /// Appends triangles with what the header says of faces, `values` being their packed properties. PLY takes
    /// it all, OBJ and GLB texture and `texnumber`, STL nothing.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        if let Writer::Obj(_) | Writer::Glb(_) = self.writer {
            let is_bad =
                |t: &&TexturedTriangle| !t.texture.as_flattened().iter().all(|x| x.is_finite());
            self.n_not_finite += triangles.iter().filter(is_bad).count() as u64;
        }
        if let (Some(rounding), false) = (&mut self.rounding, matches!(self.writer, Writer::Stl(_)))
        {
            rounding.add_faces(triangles.iter().map(|t| t.corners));
        }
        match &mut self.writer {
            Writer::Ply(sink) => sink.write_full_faces(triangles, values),
            Writer::Obj(sink) => sink.write_full_faces(triangles, values),
            Writer::Glb(sink) => sink.write_full_faces(triangles, values),
            Writer::Stl(_) => {
                self.write_faces(&triangles.iter().map(|t| t.corners).collect::<Vec<_>>())
            }
        }
    }

    /// The same for indices of 32 bits, which PLY takes as they are.
    pub fn write_faces_u32(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        match &mut self.writer {
            Writer::Ply(sink) if self.rounding.is_none() => sink.write_faces_u32(triangles),
            _ => {
                let wide: Vec<[u64; 3]> = triangles.iter().map(|t| t.map(u64::from)).collect();
                self.write_faces(&wide)
            }
        }
    }

    /// Words on what the format could not hold, so far.
    pub fn losses(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if !self.lost.is_empty() {
            lines.push(format!(
                "the format has no place for properties of vertices: {} (PLY has)",
                self.lost.join(", ")
            ));
        }
        if self.n_clamped > 0 {
            lines.push(format!(
                "{} vertices have colours outside of black to white: clamped",
                self.n_clamped
            ));
        }
        if self.n_not_finite > 0 {
            lines.push(format!(
                "{} faces have texture coordinates that are not finite: 0 was written for them",
                self.n_not_finite
            ));
        }
        lines.extend(self.rounding.as_ref().and_then(Rounding::note));
        lines
    }

    /// Writes what stands beside the mesh, then syncs and renames it; returns the file's length in bytes.
    pub fn finish(self) -> Result<u64> {
        let beside = match &self.textures {
            Some((plan, disk)) => Some(plan.write_sides(disk)?),
            None => None,
        };
        let bytes = match self.writer {
            Writer::Ply(sink) => sink.finish(),
            Writer::Stl(sink) => sink.finish(),
            Writer::Obj(sink) => sink.finish(),
            Writer::Glb(sink) => sink.finish(),
        }?;
        if let Some(beside) = beside {
            beside.keep();
        }
        Ok(bytes)
    }
}
