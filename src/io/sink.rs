//! The output of a run, whatever its format: one writer for each kind, and the images and materials beside it.

use super::by_material::names_of;
use super::gltf::{GlbWriter, Positions};
use super::materials::{BARE_VERTICES, Map, MapKind, Material, NUMBER, TexturePlan};
use super::names::{NameTable, OBJECT, is_name, lost_comments};
use super::obj::ObjWriter;
use super::output_format::{OutputFormat, OutputKind};
use super::rounding::Rounding;
use super::stl::{StlWriter, colour_of_facets};
use crate::ply::{Encoding, OutputHeader, Place, PlyFormat, PlyWriter, TexturedTriangle};
use stonecut_mesh::codec::TEXTURE_NAMES;
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::property::{Origin, Scalar, read_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::disk::Disk;
use stonecut_system::error::Result;
use stonecut_system::losses::{Ledger, Loss, LossKind};

/// The remark on colours of vertices that a GLB does not get, since images hide them in PLY and OBJ.
pub fn hidden_colours() -> Loss {
    let (what, why) = ("colours of vertices under images", "not carried: glTF would multiply");
    Loss::new(LossKind::Colors, what, why).notice()
}

/// Writes a mesh in any format: all vertices, then all faces; the file appears when it is finished.
pub struct MeshSink {
    writer: Writer,
    /// Files that come before the mesh, and the disk that they are written through.
    textures: Option<(TexturePlan, Disk)>,
    /// Faces whose texture coordinates no OBJ or GLB can hold.
    n_not_finite: u64,
    /// Parts that the format has no place for.
    losses: Ledger,
    /// The colour of vertices, where the format has only shares of white.
    colour: Option<ColourPlace>,
    /// Vertices whose colour was clamped.
    n_clamped: u64,
    /// Place of an opacity of vertices that the format does not have, and the number of vertices that are not opaque.
    opacity: Option<(Scalar, usize, f64)>,
    n_not_opaque: u64,
    record_bytes: usize,
    schema: VertexSchema,
    rounding: Option<Rounding>,
    /// Places of images that coordinates get, where the format has no other place for them.
    placed: Option<PlacedImages>,
}

/// Scale and offset of the colour image of each material, and the place of a face's number among its packed values.
struct PlacedImages {
    by_number: Vec<([f64; 2], [f64; 2])>,
    number: (Scalar, usize),
    value_bytes: usize,
}

impl PlacedImages {
    /// Those of a PLY, if one is not as it is without options (`-s`, `-o`).
    fn of(header: &OutputHeader, kind: OutputKind) -> Option<PlacedImages> {
        const PLAIN: ([f64; 2], [f64; 2]) = ([1.0; 2], [0.0; 2]);
        let plan = header.textures.as_ref().filter(|_| kind == OutputKind::Ply)?;
        let place = |material: &Material| {
            let place = material.map(MapKind::Base).map(Map::place);
            place.map_or(PLAIN, |place| (place.scale, place.offset))
        };
        let by_number: Vec<_> = plan.materials.list.iter().map(place).collect();
        let number = header.faces.number_at().filter(|_| header.faces.texture)?;
        let value_bytes = header.faces.value_bytes();
        let is_any = by_number.iter().any(|place| *place != PLAIN);
        is_any.then_some(PlacedImages { by_number, number, value_bytes })
    }

    fn placed(&self, triangles: &[TexturedTriangle], values: &[u8]) -> Vec<TexturedTriangle> {
        let (scalar, at) = self.number;
        let place = |(triangle, values): (&TexturedTriangle, &[u8])| {
            let number = read_scalar(scalar, values, at);
            let place = self.by_number.get(number as usize).filter(|_| number >= 0.0);
            let Some((scale, offset)) = place else { return *triangle };
            let placed = |uv: [f32; 2]| {
                std::array::from_fn(|k| (f64::from(uv[k]) * scale[k] + offset[k]) as f32)
            };
            TexturedTriangle { texture: triangle.texture.map(placed), ..*triangle }
        };
        triangles.iter().zip(values.chunks_exact(self.value_bytes)).map(place).collect()
    }
}

/// Names of the components of colours.
const COLOURS: [&str; 9] =
    ["red", "green", "blue", "diffuse_red", "diffuse_green", "diffuse_blue", "r", "g", "b"];
/// Names of opacity; the last one only beside a colour of the same form.
const OPACITY: [&str; 3] = ["alpha", "diffuse_alpha", "a"];

fn is_opacity(name: &str, schema: &VertexSchema) -> bool {
    let has_letters = || ["r", "g", "b"].iter().all(|name| schema.own_property(name).is_some());
    OPACITY.contains(&name) && (name != "a" || has_letters())
}

/// Parts of vertices and faces that a kind of file does not have. Normals of STL are those of its facets.
fn lost_parts(header: &OutputHeader, (kind, encoding): (OutputKind, Encoding)) -> Ledger {
    const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
    let mut losses = Ledger::default();
    if kind == OutputKind::Ply {
        if header.n_bare > 0 && ColourPlace::find(&header.schema).is_some() {
            let loss = Loss::new(LossKind::Colors, BARE_VERTICES, "others have one: white");
            losses.lose(loss.count(header.n_bare));
        }
        return losses;
    }
    let is_stl = kind == OutputKind::Stl;
    let reason = format!("{} has no place for them", kind.name());
    let mut lose = |of: LossKind, what: &str, names: &[&str], (remedy, is_whole): (&str, bool)| {
        if !names.is_empty() {
            let what = format!("{what} ({})", names.join(", "));
            let loss = Loss::new(of, what, &reason).remedy(remedy);
            losses.lose(if is_whole { loss.whole() } else { loss });
        }
    };
    // What went from faces to vertices is still what faces had.
    let moved = [Origin::FaceMean, Origin::FaceLabel];
    let all = &header.schema.properties;
    let named = |is: &dyn Fn(Origin) -> bool| -> Vec<&str> {
        all.iter().filter(|p| is(p.origin)).map(|p| p.name.as_str()).collect()
    };
    let vertices = named(&|origin| origin == Origin::Vertex);
    let has = |names: &[&str]| names.iter().all(|name| vertices.contains(name));
    // Only one colour and one pair of coordinates are written.
    let colour = ColourPlace::find(&header.schema).map_or(&[][..], |place| place.names());
    let pair = TEXTURE_NAMES.iter().find(|pair| has(&pair[..]) && !header.faces.texture);
    let pair = pair.map_or(&[][..], |pair| &pair[..]);
    let of = |is: &dyn Fn(&str) -> bool| -> Vec<&str> {
        vertices.iter().copied().filter(|name| is(name)).collect()
    };
    let is_texture = |name: &str| TEXTURE_NAMES.as_flattened().contains(&name);
    let is_normal = |name: &str| NORMALS.contains(&name) && has(&NORMALS);
    let lost = of(&|name| COLOURS.contains(&name) && (is_stl || !colour.contains(&name)));
    // A component without its fellows, and a second pair or colour, is a number like any other.
    let others =
        |is_pair: bool| if is_stl && is_pair { "PLY, OBJ and GLB have" } else { "PLY has" };
    let lacks = (others(!colour.is_empty()), is_stl || colour.is_empty());
    lose(LossKind::Colors, "colours of vertices", &lost, lacks);
    let lost = of(&|name| is_texture(name) && (is_stl || !pair.contains(&name)));
    let is_whole = is_stl || (pair.is_empty() && !header.faces.texture);
    let lacks = (others(!pair.is_empty()), is_whole);
    lose(LossKind::TextureCoordinates, "texture coordinates", &lost, lacks);
    if is_stl && header.faces.texture {
        let what = "texture coordinates";
        lose(LossKind::TextureCoordinates, what, &["of corners"], (others(true), true));
    }
    let lost = of(&|name| {
        !COLOURS.contains(&name)
            && !is_texture(name)
            && !is_normal(name)
            && !is_opacity(name, &header.schema)
    });
    lose(LossKind::Attributes, "properties of vertices", &lost, ("PLY has", true));
    let mut faces = named(&|origin| moved.contains(&origin));
    faces.extend(header.faces.properties.iter().map(|p| p.name.as_str()));
    let of = |is: &dyn Fn(&str) -> bool| -> Vec<&str> {
        faces.iter().copied().filter(|name| is(name)).collect()
    };
    let has_colours = is_stl && colour_of_facets(&header.faces, encoding).is_some();
    let is_held = |name: &str| has_colours && ["red", "green", "blue"].contains(&name);
    let lost = of(&|name| COLOURS.contains(&name) && !is_held(name));
    lose(LossKind::Colors, "colours of faces", &lost, ("PLY has", !has_colours));
    // The number of an image means nothing without images, that of a name nothing without names.
    let has_names = !NameTable::of(&header.comments).is_empty();
    let lost =
        of(&|name| !COLOURS.contains(&name) && name != NUMBER && !(has_names && name == OBJECT));
    lose(LossKind::Attributes, "properties of faces", &lost, ("PLY has", true));
    if is_stl {
        let lost = lost_comments(&header.comments, &header.obj_infos, &reason);
        lost.into_iter().for_each(|loss| losses.lose(loss));
    }
    losses
}

/// Takes names of objects and groups out of the comments where the output has no place for them.
fn lost_names(header: &mut OutputHeader, kind: OutputKind) -> Ledger {
    let mut losses = Ledger::default();
    let names = NameTable::of(&header.comments);
    let reason = match kind {
        _ if names.is_empty() => return losses,
        OutputKind::Stl => "STL has no place for them",
        _ if names_of(header).is_empty() => "not carried",
        _ => return losses,
    };
    header.comments.retain(|comment| !is_name(comment));
    losses.lose(names.loss(reason));
    losses
}

/// Opacity of records, where a kind of file does not have it: type, place, and the value of what is opaque.
fn lost_opacity(schema: &VertexSchema, kind: OutputKind) -> Option<(Scalar, usize, f64)> {
    if kind == OutputKind::Ply {
        return None;
    }
    let colour = ColourPlace::find(schema).filter(|_| kind == OutputKind::Glb);
    let kept = colour.and_then(|place| place.alpha_name());
    let mut at = schema.position_bytes();
    for property in &schema.properties {
        let name = property.name.as_str();
        if is_opacity(name, schema) && kept != Some(name) {
            return Some((property.scalar, at, property.full()));
        }
        at += property.scalar.bytes();
    }
    None
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
        mut header: OutputHeader,
        format: OutputFormat,
    ) -> Result<Self> {
        let place = place.into();
        let encoding = format.encoding.unwrap_or(Encoding::BinaryLittleEndian);
        let textures = header.textures.clone().map(|plan| (plan, place.disk.clone()));
        let kind = format.check(&place.path)?;
        let mut losses = lost_parts(&header, (kind, encoding));
        losses.merge(&lost_names(&mut header, kind));
        let has_images = |plan: &TexturePlan| plan.materials.has_image(|map| map == MapKind::Base);
        let is_hidden =
            header.images_hide_colours && header.textures.as_ref().is_some_and(has_images);
        if kind == OutputKind::Glb && is_hidden && ColourPlace::find(&header.schema).is_some() {
            losses.lose(hidden_colours());
        }
        let (opacity, record_bytes) =
            (lost_opacity(&header.schema, kind), header.schema.record_bytes());
        let colour = ColourPlace::find(&header.schema)
            .filter(|_| matches!(kind, OutputKind::Obj | OutputKind::Glb));
        let schema = header.schema.clone();
        let rounding = Rounding::of(&schema, kind, format);
        let placed = PlacedImages::of(&header, kind);
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
            losses,
            colour,
            n_clamped: 0,
            opacity,
            n_not_opaque: 0,
            record_bytes,
            schema,
            rounding,
            placed,
        })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        if let Some(colour) = &self.colour {
            let rows = records.chunks_exact(self.record_bytes);
            self.n_clamped += rows.filter(|row| colour.is_clamped(row)).count() as u64;
        }
        if let Some(rounding) = &mut self.rounding {
            rounding.add_vertices(&self.schema, records);
        }
        if let Some((scalar, at, full)) = self.opacity {
            let rows = records.chunks_exact(self.record_bytes);
            let is_clear = |row: &&[u8]| read_scalar(scalar, row, at) < full * (1.0 - 0.5 / 255.0);
            self.n_not_opaque += rows.filter(is_clear).count() as u64;
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
    /// it all, OBJ and GLB texture, material and name, STL nothing.
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
        if let Some(rounding) = &mut self.rounding {
            rounding.add_faces(triangles.iter().map(|t| t.corners));
        }
        match &mut self.writer {
            Writer::Ply(sink) => match &self.placed {
                Some(images) => sink.write_full_faces(&images.placed(triangles, values), values),
                None => sink.write_full_faces(triangles, values),
            },
            Writer::Obj(sink) => sink.write_full_faces(triangles, values),
            Writer::Glb(sink) => sink.write_full_faces(triangles, values),
            Writer::Stl(sink) => sink.write_full_faces(triangles, values),
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

    /// Parts of vertices, faces, materials and images that the output does not have, so far.
    pub fn losses(&self) -> Ledger {
        let mut losses = self.losses.clone();
        if self.n_not_opaque > 0 {
            let what = "opacity of vertices";
            let loss = Loss::new(LossKind::Colors, what, "only PLY has a place for it");
            losses.lose(loss.count(self.n_not_opaque));
        }
        if let Writer::Stl(sink) = &self.writer
            && sink.n_rounded > 0
        {
            let what = "colours of faces";
            let loss = Loss::new(LossKind::Colors, what, "STL has 5 bits a channel: rounded");
            losses.lose(loss.count(sink.n_rounded).remedy("PLY has 8"));
        }
        if self.n_clamped > 0 {
            let what = "colours of vertices";
            let loss = Loss::new(LossKind::Colors, what, "outside of black to white: clamped");
            losses.lose(loss.count(self.n_clamped));
        }
        if self.n_not_finite > 0 {
            let what = "faces with texture coordinates that are not finite";
            let loss = Loss::new(LossKind::TextureCoordinates, what, "0 was written for them");
            losses.lose(loss.count(self.n_not_finite));
        }
        if let Some(line) = self.rounding.as_ref().and_then(Rounding::note) {
            let loss = Loss { kind: LossKind::Precision, ..Loss::remark(line) };
            let is_ruinous = self.rounding.as_ref().is_some_and(Rounding::is_ruinous);
            losses.lose(if is_ruinous { loss.whole() } else { loss });
        }
        if let Some((plan, _)) = &self.textures {
            losses.merge(&plan.losses);
        }
        losses
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
