//! Joins the vertices of glTF meshes that differ in nothing but their normal, out of core, into a PLY.
//!
//! Sorts as for STL: by place, colour and texture coordinates, by the first vertex of each, and by vertex for the
//! faces; joined vertices keep the order of the first. Charts stay apart: positions are often rounded, and joining
//! all that is in one place then ties sheets together that only lie close (docs/design/textures.md). A mesh that fits into the
//! memory is joined there (`held`), to the same bytes.

use super::held::Held;
use super::vertex_row::{MOST_APART, Open, VertexRow, are_same};
use crate::external_sort::{ExternalSort, halves, whole};
use crate::names::OBJECT;
use crate::open_options::{HardEdges, StageOptions};
use crate::ply::raw::{RawFile, Spool};
use crate::ply::row_window::RowWindow;
use stonecut_mesh::property::Scalar;
use stonecut_system::error::Result;

/// Words of a vertex by place: position, colour, texture coordinates, number, normal. Those of one by its first: two
/// numbers, normal, position, colour.
const BY_PLACE: usize = 14;
const BY_FIRST: usize = 14;

/// Bytes of faces that are written at once.
const WRITE_BYTES: usize = 1 << 16;

/// Parts of the faces.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FaceParts {
    /// Texture coordinates at corners.
    pub(super) texture: bool,
    /// Numbers of materials.
    pub(super) numbers: bool,
    /// Numbers of names.
    pub(super) names: bool,
}

/// Vertices and faces on their way.
///
/// Memory: that of the stage, or a third of it for each sort. Disk at peak: 112 bytes a vertex and 16 more, 40 a corner.
pub(super) struct Joiner<'a> {
    options: &'a StageOptions,
    has_colour: bool,
    has_normal: bool,
    has_alpha: bool,
    /// All of it, as long as it fits into the memory; then the sorts.
    held: Option<Held>,
    by_place: ExternalSort<BY_PLACE>,
    uvs: Spool,
    n_vertices: u64,
    low: [f64; 3],
    high: [f64; 3],
    by_vertex: ExternalSort<4>,
    /// Material, and name if there are any, of each face.
    labels: Spool,
    n_faces: u64,
    pub(super) has: FaceParts,
    pub(super) comments: Vec<String>,
}

impl<'a> Joiner<'a> {
    pub(super) fn new(options: &'a StageOptions, has_colour: bool, has_normal: bool) -> Self {
        Joiner {
            options,
            has_colour,
            has_normal,
            has_alpha: false,
            held: Some(Held::new(options.memory_bytes)),
            by_place: options.sort(memory_bytes(options)),
            uvs: options.spool(),
            n_vertices: 0,
            low: [f64::MAX; 3],
            high: [f64::MIN; 3],
            by_vertex: options.sort(memory_bytes(options)),
            labels: options.spool(),
            n_faces: 0,
            has: FaceParts::default(),
            comments: Vec::new(),
        }
    }

    pub(super) fn n_vertices(&self) -> u64 {
        self.n_vertices
    }

    pub(super) fn put_vertex(&mut self, row: &VertexRow) -> Result<()> {
        for (axis, &x) in row.position.iter().enumerate() {
            (self.low[axis], self.high[axis]) = (self.low[axis].min(x), self.high[axis].max(x));
        }
        self.has_alpha |= row.colour[3] != 255;
        self.n_vertices += 1;
        match &mut self.held {
            Some(held) if held.has_room() => {
                held.vertices.push(*row);
                return Ok(());
            }
            _ => self.spill()?,
        }
        self.sort_vertex(self.n_vertices - 1, row)
    }

    /// Gives what is held to the sorts.
    fn spill(&mut self) -> Result<()> {
        let Some(held) = self.held.take() else { return Ok(()) };
        for (number, row) in (0..).zip(&held.vertices) {
            self.sort_vertex(number, row)?;
        }
        for (face, corners) in (0..).zip(&held.corners) {
            self.sort_face(face, corners.map(u64::from))?;
        }
        Ok(())
    }

    fn sort_vertex(&mut self, number: u64, row: &VertexRow) -> Result<()> {
        // Adding 0 makes -0 and 0 the same place.
        let [x, y, z] = row.position.map(|x| halves((x + 0.0).to_bits()));
        let [a, b, c] = row.normal.map(f32::to_bits);
        let [u, v] = row.uv.map(|x| (x + 0.0).to_bits());
        let n = halves(number);
        self.uvs.write(row.uv.map(f32::to_le_bytes).as_flattened())?;
        let colour = u32::from_le_bytes(row.colour);
        self.by_place.push([x[0], x[1], y[0], y[1], z[0], z[1], colour, u, v, n[0], n[1], a, b, c])
    }

    /// Takes a face with the numbers of its material and of its name.
    pub(super) fn put_face(&mut self, corners: [u64; 3], labels: [i32; 2]) -> Result<()> {
        self.n_faces += 1;
        if self.has.numbers || self.has.names {
            let bytes = labels.map(i32::to_le_bytes);
            self.labels.write(&bytes.as_flattened()[..self.label_bytes()])?;
        }
        match &mut self.held {
            // A mesh in memory has fewer vertices than 32 bits can number.
            Some(held) if held.has_room() => {
                held.corners.push(corners.map(|vertex| vertex as u32));
                return Ok(());
            }
            _ => self.spill()?,
        }
        self.sort_face(self.n_faces - 1, corners)
    }

    fn sort_face(&mut self, face: u64, corners: [u64; 3]) -> Result<()> {
        for (k, vertex) in corners.into_iter().enumerate() {
            let ([high, low], [c, d]) = (halves(vertex), halves(3 * face + k as u64));
            self.by_vertex.push([high, low, c, d])?;
        }
        Ok(())
    }

    /// Bytes of the labels of a face.
    fn label_bytes(&self) -> usize {
        if self.has.names { 8 } else { 4 }
    }

    /// Floats keep 24 bits of the distance from the origin; see the reader of OBJ.
    fn coordinate(&self) -> Scalar {
        let extent = (0..3).map(|i| self.high[i] - self.low[i]).fold(0.0, f64::max);
        let far = (0..3).map(|i| self.high[i].abs().max(self.low[i].abs())).fold(0.0, f64::max);
        if far > 8.0 * extent || far > f64::from(f32::MAX) { Scalar::F64 } else { Scalar::F32 }
    }

    /// The joined mesh as a PLY, and how many of its vertices have the mean of normals along a hard edge.
    pub(super) fn finish(mut self, name: &RawFile) -> Result<(RawFile, u64)> {
        let (options, coordinate) = (self.options, self.coordinate());
        let (has, label_bytes) = (self.has, self.label_bytes());
        let (n_old, n_faces) = (self.n_vertices, self.n_faces);
        let keeps_normals = self.has_normal && options.hard_edges == HardEdges::Kept;
        let extras = Extras {
            coordinate,
            colour: self.has_colour,
            alpha: self.has_alpha,
            normal: self.has_normal,
            comments: std::mem::take(&mut self.comments),
        };
        if let Some(held) = self.held.take() {
            let Held { vertices, corners, .. } = &held;
            let joined = held.join(keeps_normals);
            let mut out = options.spool();
            out.write(extras.header(joined.len() as u64, n_faces, (false, has)).as_bytes())?;
            let mut row = Vec::new();
            for open in &joined {
                out.write(open.row(&extras, &mut row))?;
            }
            let labels = self.labels.finish(name.path())?;
            let mut faces = Faces::new(&labels, (has, label_bytes), false);
            for face in corners {
                let uvs = face.map(|corner| vertices[corner as usize].uv.map(f32::to_bits));
                faces.put(face.map(|corner| held.id(corner)), uvs, &mut out)?;
            }
            out.write(&faces.rows)?;
            let n_hard = joined.iter().filter(|open| open.is_hard).count() as u64;
            return Ok((out.finish(name.path())?, n_hard));
        }
        let mut by_first = options.sort::<BY_FIRST>(memory_bytes(options));
        // The place at work, and the number and the normal of each vertex that it has so far.
        let (mut last, mut firsts) = (None, Vec::<([u32; 2], [u32; 3])>::new());
        self.by_place.drain(|record| {
            let place: [u32; 9] = std::array::from_fn(|i| record[i]);
            let number = [record[9], record[10]];
            let normal = [record[11], record[12], record[13]];
            if last != Some(place) {
                firsts.clear();
            }
            last = Some(place);
            let known = match keeps_normals {
                false => firsts.first(),
                true => firsts
                    .iter()
                    .find(|(_, known)| are_same(*known, normal))
                    .or(firsts.get(MOST_APART - 1)),
            };
            let first = known.map_or(number, |(first, _)| *first);
            if known.is_none() {
                firsts.push((number, normal));
            }
            let mut out = [0; BY_FIRST];
            out[..2].copy_from_slice(&first);
            out[2..4].copy_from_slice(&number);
            out[4..7].copy_from_slice(&normal);
            out[7..].copy_from_slice(&place[..7]);
            by_first.push(out)
        })?;
        let mut ids = options.sort::<4>(memory_bytes(options));
        let mut vertices = options.spool();
        let (mut n_vertices, mut open, mut row) = (0u64, None::<Open>, Vec::new());
        let mut n_hard = 0;
        by_first.drain(|record| {
            let first = whole(record[0], record[1]);
            if open.as_ref().is_none_or(|open| open.first != first) {
                if let Some(open) = open.take() {
                    n_hard += u64::from(open.is_hard);
                    vertices.write(open.row(&extras, &mut row))?;
                }
                open = Some(Open::new(first, &record));
                n_vertices += 1;
            }
            if let Some(open) = &mut open {
                open.add([record[4], record[5], record[6]]);
            }
            let [high, low] = halves(n_vertices - 1);
            ids.push([record[2], record[3], high, low])
        })?;
        if let Some(open) = open {
            n_hard += u64::from(open.is_hard);
            vertices.write(open.row(&extras, &mut row))?;
        }
        let mut table = options.spool();
        ids.drain(|[_, _, high, low]| table.write(&whole(high, low).to_le_bytes()))?;
        let tables = [table.finish(name.path())?, self.uvs.finish(name.path())?];

        let mut by_corner = options.sort::<6>(memory_bytes(options));
        let (mut next, mut id, mut uv) = (0, 0, [0; 2]);
        let [mut ids, mut uvs] = tables.each_ref().map(|table| RowWindow::new(table, 8));
        let word = |row: &[u8]| u64::from_le_bytes(row.try_into().expect("8 bytes"));
        self.by_vertex.drain(|[high, low, c, d]| {
            // Corners come by vertex, and name only vertices that are there.
            let number = whole(high, low);
            debug_assert!(number < n_old, "checked by the reader");
            while next <= number {
                id = word(ids.get(next)?);
                let bits = word(uvs.get(next)?);
                uv = [bits as u32, (bits >> 32) as u32];
                next += 1;
            }
            let [id_high, id_low] = halves(id);
            by_corner.push([c, d, id_high, id_low, uv[0], uv[1]])
        })?;
        let is_wide = n_vertices > 1 << 32;
        let mut out = options.spool();
        out.write(extras.header(n_vertices, n_faces, (is_wide, has)).as_bytes())?;
        out.append_file(&vertices.finish(name.path())?)?;
        let labels = self.labels.finish(name.path())?;
        let mut faces = Faces::new(&labels, (has, label_bytes), is_wide);
        let (mut ids, mut uvs, mut k) = ([0; 3], [[0; 2]; 3], 0);
        by_corner.drain(|[_, _, high, low, u, v]| {
            (ids[k], uvs[k]) = (whole(high, low), [u, v]);
            k = (k + 1) % 3;
            if k == 0 { faces.put(ids, uvs, &mut out) } else { Ok(()) }
        })?;
        out.write(&faces.rows)?;
        Ok((out.finish(name.path())?, n_hard))
    }
}

/// Rows of faces.
struct Faces<'a> {
    labels: RowWindow<&'a RawFile>,
    has: FaceParts,
    is_wide: bool,
    /// Those that are not written yet.
    rows: Vec<u8>,
    face: u64,
}

impl<'a> Faces<'a> {
    fn new(labels: &'a RawFile, (has, label_bytes): (FaceParts, usize), is_wide: bool) -> Self {
        let labels = RowWindow::new(labels, label_bytes);
        Faces { labels, has, is_wide, rows: Vec::new(), face: 0 }
    }

    /// Takes the next face: its vertices, and the bits of their texture coordinates. Writes all that are there now and then.
    fn put(&mut self, ids: [u64; 3], uvs: [[u32; 2]; 3], out: &mut Spool) -> Result<()> {
        if self.rows.len() > WRITE_BYTES {
            out.write(&self.rows)?;
            self.rows.clear();
        }
        self.rows.push(3);
        match self.is_wide {
            true => self.rows.extend_from_slice(ids.map(u64::to_le_bytes).as_flattened()),
            false => {
                let ids = ids.map(|id| (id as u32).to_le_bytes());
                self.rows.extend_from_slice(ids.as_flattened());
            }
        }
        if self.has.texture {
            self.rows.push(6);
            let uvs = uvs.map(|uv| uv.map(u32::to_le_bytes));
            self.rows.extend_from_slice(uvs.as_flattened().as_flattened());
        }
        if self.has.numbers || self.has.names {
            let labels = self.labels.get(self.face)?;
            self.rows.extend_from_slice(if self.has.numbers { labels } else { &labels[4..] });
        }
        self.face += 1;
        Ok(())
    }
}

fn memory_bytes(options: &StageOptions) -> usize {
    (options.memory_bytes / 3) as usize
}

impl Open {
    fn new(first: u64, record: &[u32; BY_FIRST]) -> Open {
        let position = [7, 9, 11].map(|i| f64::from_bits(whole(record[i], record[i + 1])));
        let normal = [record[4], record[5], record[6]];
        Open::at(first, position, (record[13].to_le_bytes(), normal))
    }

    /// Its row, written into `row`.
    fn row<'a>(&self, extras: &Extras, row: &'a mut Vec<u8>) -> &'a [u8] {
        row.clear();
        for x in self.position {
            match extras.coordinate {
                Scalar::F64 => row.extend_from_slice(&x.to_le_bytes()),
                _ => row.extend_from_slice(&(x as f32).to_le_bytes()),
            }
        }
        if extras.normal {
            let length = self.normal.iter().map(|x| x * x).sum::<f64>().sqrt();
            for x in self.normal {
                let x = if length > 0.0 { (x / length) as f32 } else { 0.0 };
                row.extend_from_slice(&x.to_le_bytes());
            }
        }
        if extras.colour {
            row.extend_from_slice(&self.colour[..if extras.alpha { 4 } else { 3 }]);
        }
        row
    }
}

/// Properties of the vertices.
struct Extras {
    coordinate: Scalar,
    colour: bool,
    alpha: bool,
    normal: bool,
    comments: Vec<String>,
}

impl Extras {
    fn header(&self, n_vertices: u64, n_faces: u64, (is_wide, has): (bool, FaceParts)) -> String {
        let mut text = "ply\nformat binary_little_endian 1.0\n".to_owned();
        self.comments.iter().for_each(|comment| text.push_str(&format!("comment {comment}\n")));
        text.push_str(&format!("element vertex {n_vertices}\n"));
        let mut put = |kind: &str, names: &[&str]| {
            names.iter().for_each(|name| text.push_str(&format!("property {kind} {name}\n")));
        };
        put(crate::ply::type_name(self.coordinate), &["x", "y", "z"]);
        put("float", if self.normal { &["nx", "ny", "nz"] } else { &[] });
        put("uchar", if self.colour { &["red", "green", "blue"] } else { &[] });
        put("uchar", if self.colour && self.alpha { &["alpha"] } else { &[] });
        let index = if is_wide { "uint64" } else { "uint" };
        text.push_str(&format!(
            "element face {n_faces}\nproperty list uchar {index} vertex_indices\n"
        ));
        text.push_str(if has.texture { "property list uchar float texcoord\n" } else { "" });
        text.push_str(if has.numbers { "property int texnumber\n" } else { "" });
        if has.names {
            text.push_str(&format!("property int {OBJECT}\n"));
        }
        text.push_str("end_header\n");
        text
    }
}
