//! Several meshes staged as one PLY: vertices and faces one part after the other, then written again with the union of
//! their properties and materials.
//!
//! Small parts are opened side by side, large ones one at a time. Disk: the joined mesh and one part; twice that where the layouts of
//! parts differ. Does not join vertices (`weld`).

use super::inputs::left_out;
use super::looks::{Looks, content};
use super::places::{Places, is_place};
use super::schemas::{SchemaUnion, widest};
use super::sizes::odd_sizes;
use super::{InputPaths, InputSet, MeshPart};
use crate::borders::{BorderSpools, OpenBorders};
use crate::materials::NUMBER;
use crate::names::NameUse;
use crate::open::open_part;
use crate::open_options::StageOptions;
use crate::ply::raw::{RawFile, Spool};
use crate::ply::source::Staged;
use crate::ply::{FaceSchema, MeshSource, OutputHeader, PartReport, TextureInfo};
use crate::restaged::{
    FaceRows, RowLayout, corner, each_row, each_row_of_pieces, face_rows, set_corner, staged_file,
};
use crate::sidecars::Georeference;
use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::property::{Scalar, read_scalar, write_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Ledger, Loss};
use stonecut_system::parallel;
use stonecut_system::progress::Progress;

/// Bytes that are read at once.
const WINDOW: usize = 1 << 20;

/// Layout of the rows of a part in the spools.
struct Rows {
    schema: VertexSchema,
    faces: FaceSchema,
    n_vertices: u64,
    vertex_bytes: u64,
    face_bytes: u64,
    /// New numbers of its materials; empty where it has none.
    numbers: Vec<i32>,
}

struct Gathered {
    vertices: Spool,
    faces: Spool,
    borders: BorderSpools,
    rows: Vec<Rows>,
    coordinate: Scalar,
    of_vertices: SchemaUnion,
    of_faces: SchemaUnion,
    texture: Option<TextureInfo>,
    looks: Looks,
    comments: Option<Vec<String>>,
    obj_infos: Option<Vec<String>>,
    formats: HashSet<&'static str>,
    /// Parts by what is in them.
    known: HashMap<[(u64, u64); 2], usize>,
    reports: Vec<PartReport>,
    boxes: Vec<Bounds>,
    places: Places,
    n_vertices: u64,
    n_faces: u64,
    given_bytes: u64,
    staged: Staged,
    notes: Ledger,
}

/// Parts that are opened side by side at most, and the share of the memory that the file of such a part may take.
const MOST_AT_ONCE: usize = 4;
const SMALL_PART: u64 = 32;

/// A part as it was read: rows whose numbers count from its own beginning.
struct ReadPart {
    source: MeshSource,
    vertices: RawFile,
    faces: FaceRows,
    layout: FaceSchema,
    borders: OpenBorders,
    bounds: Bounds,
    /// Lengths and checksums of vertices and faces.
    content: [(u64, u64); 2],
    /// The place that files beside it name.
    found: Option<Georeference>,
}

/// Opens all parts and stages them as one mesh; vertices are not joined yet.
///
/// Errors: those of a part, under its name; with `skip_bad` such a part is left out and named.
pub(crate) fn stage(
    input: &InputPaths,
    options: &StageOptions,
) -> Result<(MeshSource, OpenBorders)> {
    let set = input.set()?;
    let mut all = Gathered::new(options);
    let threads = options.threads.get().min(MOST_AT_ONCE);
    let mut share = options.clone();
    share.memory_bytes /= threads as u64;
    share.parse_bytes /= threads as u64;
    let is_small = |part: &MeshPart| {
        let n_bytes = std::fs::metadata(&part.path).map_or(u64::MAX, |file| file.len());
        part.bytes.as_ref().map_or(n_bytes, |b| b.end - b.start)
            <= options.memory_bytes / SMALL_PART
    };
    let mut take = |part: &MeshPart, ahead: Option<ReadPart>| {
        // Large ones are read by themselves, and so are those that went wrong: less memory may have been the reason.
        let read = ahead.map_or_else(|| read_part(part, None, options), Ok);
        match read.and_then(|read| all.add(part, read, options)) {
            Err(error @ Error::BadInput { .. }) if options.read.skip_bad && set.parts.len() > 1 => {
                all.staged.losses.lose(left_out(&error.to_string()));
                Ok(())
            }
            added => added,
        }
    };
    if threads == 1 {
        set.parts.iter().try_for_each(|part| take(part, None))?;
    } else {
        parallel::in_order(
            set.parts.len() as u64,
            threads,
            &Progress::default(),
            |i, slot: &mut Option<ReadPart>| {
                let part = &set.parts[i as usize];
                *slot = if is_small(part) { read_part(part, None, &share).ok() } else { None };
                Ok(())
            },
            |i, slot| take(&set.parts[i as usize], slot.take()),
        )?;
    }
    set.losses.entries().iter().for_each(|loss| all.staged.losses.lose(loss.clone()));
    all.finish(input, set, options)
}

/// Reads a part, moved by `shift` in its own axes.
fn read_part(part: &MeshPart, shift: Option<[f64; 3]>, options: &StageOptions) -> Result<ReadPart> {
    let (source, found) = open(part, shift, options)?;
    let Some(faces) = face_rows(&source, options)? else {
        let what =
            "a face of more than 127 corners cannot be joined with other files; convert it first";
        return Err(Error::bad_input(source.path(), what));
    };
    let (vertices, bounds) = vertices_of(&source, options)?;
    let layout =
        FaceSchema { texture: source.has_corner_texture(), properties: source.face_properties() };
    let rows = (&faces.rows, RowLayout::of(&layout));
    let borders = OpenBorders::of((&vertices, source.schema()), rows, options)?;
    let sum = |file: &RawFile| content(file, 0, file.len());
    let content = [sum(&vertices)?, sum(&faces.rows)?];
    Ok(ReadPart { source, vertices, faces, layout, borders, bounds, content, found })
}

fn open(
    part: &MeshPart,
    shift: Option<[f64; 3]>,
    options: &StageOptions,
) -> Result<(MeshSource, Option<Georeference>)> {
    let mut options = options.clone();
    // A tile is turned as its tree says, whatever becomes of the whole.
    let is_tile = !part.placing.is_none();
    let turns_up = if is_tile { &part.placing } else { &options.read.placing }.turns_up;
    options.read.placing = part.placing.clone();
    options.read.placing.turns_up = turns_up;
    if options.read.names == NameUse::Carried {
        options.read.names = NameUse::GivenUp("not carried from several files");
    }
    shift.into_iter().for_each(|shift| options.read.placing.shift(shift));
    let mut source = open_part(&part.path, part.bytes.clone(), &options)?;
    // The place of a tile is that of its tree.
    let found = if is_tile { None } else { source.locate(&part.path) };
    source.place(&options.read.placing)?;
    source.require_faces()?;
    // Refuses numbers of more than 32 bits.
    OutputHeader::new(source.schema().clone(), source.n_vertices(), 0).index_type()?;
    Ok((source, found))
}

impl Gathered {
    fn new(options: &StageOptions) -> Gathered {
        Gathered {
            vertices: options.spool(),
            faces: options.spool(),
            borders: BorderSpools::new(options),
            rows: Vec::new(),
            coordinate: Scalar::F32,
            of_vertices: SchemaUnion::default(),
            of_faces: SchemaUnion::default(),
            texture: None,
            looks: Looks::default(),
            comments: None,
            obj_infos: None,
            formats: HashSet::new(),
            known: HashMap::new(),
            reports: Vec::new(),
            boxes: Vec::new(),
            places: Places::default(),
            n_vertices: 0,
            n_faces: 0,
            given_bytes: 0,
            staged: Staged::default(),
            notes: Ledger::default(),
        }
    }

    /// Appends a part.
    fn add(&mut self, part: &MeshPart, read: ReadPart, options: &StageOptions) -> Result<()> {
        let shift = self.places.shift(&read.source, read.found.as_ref())?;
        let read = if shift.is_some() { read_part(part, shift, options)? } else { read };
        let ReadPart { source, vertices, faces, layout, borders, bounds, content, found } = read;
        self.places.add(&source, found, shift.is_some());
        if let Some(known) = self.known.get(&content) {
            let (path, known) = (part.path.display(), self.reports[*known].path.as_str());
            let remark = format!("{path}: is the same mesh as {known}, and left out");
            self.notes.lose(Loss::remark(remark));
            return Ok(());
        }
        let base = self.n_vertices;
        // Refuses numbers of more than 32 bits.
        OutputHeader::new(source.schema().clone(), base + source.n_vertices(), 0).index_type()?;
        let schema = source.schema().clone();
        let numbers = match source.materials() {
            Some(materials) => self.looks.add(materials)?,
            None => Vec::new(),
        };
        // Nothing fails for a fault of the part from here on.
        self.known.insert(content, self.reports.len());
        self.coordinate = widest(self.coordinate, schema.coordinate);
        self.of_vertices.add(&schema.properties);
        self.of_faces.add(&layout.properties);
        if layout.texture {
            let own = TextureInfo { files: Vec::new(), property: "texcoord".to_owned() };
            let files = &mut self.texture.get_or_insert(own).files;
            for name in source.texture().map(|texture| texture.files).unwrap_or_default() {
                if !files.contains(&name) {
                    files.push(name);
                }
            }
        }
        for (all, own) in [
            (&mut self.comments, source.plain_comments()),
            (&mut self.obj_infos, source.obj_infos().to_vec()),
        ] {
            // What only some files say is not true of all.
            match all {
                Some(all) => all.retain(|line| own.contains(line) || is_place(line)),
                None => *all = Some(own),
            }
        }
        // Tiles of a tree are turned to z upwards, which a glTF file is not.
        let is_placed = !part.placing.is_none();
        self.formats.insert(if is_placed { "3D Tiles" } else { source.file_format() });
        self.given_bytes += source.given_bytes();
        self.vertices.append_file(&vertices)?;
        let add_base = |row: &mut [u8]| {
            for i in 0..usize::from(row[0]) {
                set_corner(row, i, corner(row, i) + base as u32);
            }
            Ok(())
        };
        let range = 0..faces.rows.len();
        each_row_of_pieces(&faces.rows, range, RowLayout::of(&layout), add_base, |rows| {
            self.faces.write(rows)
        })?;
        self.borders.append(&borders, base, self.n_faces)?;
        let n_vertices = source.n_vertices();
        self.n_vertices += n_vertices;
        self.n_faces += faces.n_faces;
        self.reports.push(PartReport {
            path: part.path.display().to_string(),
            vertices: n_vertices,
            triangles: source.n_triangles(),
        });
        self.boxes.push(bounds);
        self.rows.push(Rows {
            schema,
            faces: layout,
            n_vertices,
            vertex_bytes: vertices.len(),
            face_bytes: faces.rows.len(),
            numbers,
        });
        let faults = source.faults();
        let all = &mut self.staged.faults;
        all.bad_vertices += faults.bad_vertices;
        all.missing_vertices += faults.missing_vertices;
        all.missing_faces += faults.missing_faces;
        all.bad_faces += faults.bad_faces + faces.n_bad;
        self.staged.unreferenced_vertices += source.unreferenced_vertices();
        for path in source.beside() {
            // Many parts have one file that says the place of all.
            if self.staged.beside.last() != Some(path) {
                self.staged.beside.push(path.clone());
            }
        }
        source.notes().iter().for_each(|note| self.notes.lose(note.clone()));
        source.losses().entries().iter().for_each(|l| self.staged.losses.lose(l.clone()));
        Ok(())
    }

    /// All parts as one file.
    fn finish(
        mut self,
        input: &InputPaths,
        set: &InputSet,
        options: &StageOptions,
    ) -> Result<(MeshSource, OpenBorders)> {
        if self.rows.is_empty() {
            return Err(Error::bad_input(&**input, "none of these files can be read"));
        }
        let has_materials = self.rows.iter().any(|rows| !rows.numbers.is_empty());
        if has_materials {
            self.of_faces.require(NUMBER, Scalar::I32);
        }
        let mut remarks = Vec::from_iter(self.of_vertices.drop_partial_normals());
        remarks.extend(self.of_vertices.lacking("vertices"));
        remarks.extend(self.of_faces.lacking("faces"));
        remarks.extend(odd_sizes(&self.boxes, &self.reports));
        if let Some(first) = set.repeated.first() {
            let n = set.repeated.len();
            let path = first.display();
            remarks.push(format!("{path}: named more than once and taken once ({n} such in all)"));
        }
        remarks.extend(self.places.remark(&self.reports[0].path));
        for remark in remarks {
            self.notes.lose(Loss::remark(remark));
        }
        let schema = VertexSchema {
            coordinate: self.coordinate,
            properties: self.of_vertices.properties.clone(),
        };
        let faces = FaceSchema {
            texture: self.rows.iter().any(|rows| rows.faces.texture),
            properties: self.of_faces.properties.clone(),
        };
        let header = OutputHeader {
            comments: self.places.comments(self.comments.take().unwrap_or_default()),
            obj_infos: self.obj_infos.take().unwrap_or_default(),
            faces: faces.clone(),
            ..OutputHeader::new(schema, self.n_vertices, self.n_faces)
        };
        let path: &Path = input;
        let borders = std::mem::replace(&mut self.borders, BorderSpools::new(options));
        let borders = borders.finish(path, std::mem::take(&mut self.boxes))?;
        let mut vertices = std::mem::replace(&mut self.vertices, options.spool()).finish(path)?;
        let stays = |rows: &Rows| {
            let conversion = self.of_vertices.conversion(&rows.schema.properties);
            rows.schema.coordinate == self.coordinate && conversion.is_none()
        };
        if !self.rows.iter().all(stays) {
            let (mut out, mut at) = (options.spool(), 0);
            for rows in &self.rows {
                self.put_vertices(rows, &vertices, at, &mut out)?;
                at += rows.vertex_bytes;
            }
            vertices = out.finish(path)?;
        }
        let number_at = number_place(&faces).filter(|_| has_materials);
        let mut face_rows = std::mem::replace(&mut self.faces, options.spool()).finish(path)?;
        if !self.rows.iter().all(|rows| self.faces_stay(rows, &faces, number_at)) {
            let (mut out, mut at) = (options.spool(), 0);
            for rows in &self.rows {
                let place = number_at.map(|place| (place, &rows.numbers[..]));
                self.put_faces((rows, &faces, place), (&face_rows, at), &mut out)?;
                at += rows.face_bytes;
            }
            face_rows = out.finish(path)?;
        }
        let file = staged_file(path, &header, vertices, face_rows)?;
        let one_format = (self.formats.len() == 1).then(|| self.formats.iter().next().copied());
        let texture_names = self.looks.image_names();
        if let Some(texture) = &mut self.texture
            && !texture_names.is_empty()
        {
            texture.files = texture_names;
        }
        let staged = Staged {
            given_bytes: Some(self.given_bytes),
            texture: self.texture.filter(|_| faces.texture),
            materials: self.looks.finish().map(Arc::new),
            format: Some(one_format.flatten().unwrap_or("several formats")),
            notes: self.notes.entries().to_vec(),
            parts: self.reports,
            ..self.staged
        };
        let mut read = options.read.clone();
        read.temp_dir = Some(options.temp_dir.clone());
        let mut source = MeshSource::from_staged(file, read, staged)?;
        self.places.found.iter().for_each(|found| source.note_place(found));
        Ok((source, borders))
    }

    /// Writes the vertices of a part.
    fn put_vertices(&self, rows: &Rows, from: &RawFile, at: u64, out: &mut Spool) -> Result<()> {
        let (own, to) = (&rows.schema, self.coordinate);
        let conversion = self.of_vertices.conversion(&own.properties);
        let n_bytes = own.record_bytes();
        let wide = VertexSchema { coordinate: to, properties: Vec::new() };
        let mut row = Vec::new();
        let end = at + rows.n_vertices * n_bytes as u64;
        from.each_piece(at..end, (WINDOW / n_bytes).max(1) * n_bytes, |bytes| {
            if conversion.is_none() && own.coordinate == to {
                return out.write(bytes);
            }
            for record in bytes.chunks_exact(n_bytes) {
                row.clear();
                wide.encode_position(own.position(record), &mut row);
                let values = &record[own.position_bytes()..];
                match &conversion {
                    Some(conversion) => conversion.put(values, &mut row),
                    None => row.extend_from_slice(values),
                }
                out.write(&row)?;
            }
            Ok(())
        })
    }

    /// Writes the faces of a part.
    fn put_faces(
        &self,
        (rows, to, number): (&Rows, &FaceSchema, Option<(usize, &[i32])>),
        (from, at): (&RawFile, u64),
        out: &mut Spool,
    ) -> Result<()> {
        let conversion = self.of_faces.conversion(&rows.faces.properties);
        let has_number = rows.faces.properties.iter().any(|p| p.name == NUMBER);
        let layout = RowLayout::of(&rows.faces);
        let mut row = Vec::new();
        each_row(from, at..at + rows.face_bytes, layout, |own| {
            let n = own[0];
            let [corners, texture, _] = layout.ends(n);
            row.clear();
            row.extend_from_slice(&own[..corners]);
            if rows.faces.texture {
                row.extend_from_slice(&own[corners..texture]);
            } else if to.texture {
                row.push(2 * n);
                row.resize(row.len() + 8 * usize::from(n), 0);
            }
            let values = row.len();
            match &conversion {
                Some(conversion) => conversion.put(&own[texture..], &mut row),
                None => row.extend_from_slice(&own[texture..]),
            }
            if let Some((place, numbers)) = number {
                let place = values + place;
                let old = if has_number { read_scalar(Scalar::I32, &row, place) } else { 0.0 };
                let new = numbers.get(old as usize).filter(|_| old >= 0.0);
                write_scalar(Scalar::I32, &mut row, place, f64::from(new.copied().unwrap_or(-1)));
            }
            out.write(&row)
        })
    }

    /// Returns whether the faces of a part are written as they are.
    fn faces_stay(&self, rows: &Rows, to: &FaceSchema, number: Option<usize>) -> bool {
        let is_same = self.of_faces.conversion(&rows.faces.properties).is_none()
            && rows.faces.texture == to.texture;
        let are_same = |numbers: &[i32]| {
            !numbers.is_empty() && numbers.iter().zip(0..).all(|(n, old)| *n == old)
        };
        is_same && (number.is_none() || are_same(&rows.numbers))
    }
}

/// Place of the number of a material among the values of a face.
fn number_place(faces: &FaceSchema) -> Option<usize> {
    let i = faces.properties.iter().position(|p| p.name == NUMBER)?;
    let before = faces.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
    (faces.properties[i].scalar == Scalar::I32).then_some(before)
}

/// The vertices of a part, and their box.
fn vertices_of(source: &MeshSource, options: &StageOptions) -> Result<(RawFile, Bounds)> {
    let schema = source.schema();
    let mut out = options.spool();
    let mut bounds = Bounds::EMPTY;
    source.each_vertex_block(|block| {
        let records = block.records.chunks_exact(schema.record_bytes());
        records.for_each(|record| bounds.add(schema.position(record)));
        out.write(&block.records)
    })?;
    Ok((out.finish(source.path())?, bounds))
}
