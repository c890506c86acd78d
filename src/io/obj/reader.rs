//! OBJ: two passes over the text, one to learn what there is, one to write it as a PLY.
//!
//! Takes vertices, their colours, polygons, texture coordinates at corners, which material a face has (`named`) and which
//! object and group it is in; corner normals, lines and points have no place in a simplified mesh, and a note names them.

use super::named::{NO_MATERIAL, Named};
use super::rows::{face, has_texture, is_cut, vertex, wide};
use super::texture::TexturedFaces;
use crate::encodings;
use crate::extent::Extent;
use crate::materials::{BARE_FACES, BARE_REASON, Image, after_word};
use crate::names::{Name, NameList, OBJECT};
use crate::open_options::StageOptions;
use crate::ply::header::BYTE_ORDER_MARK;
use crate::ply::raw::RawFile;
use crate::ply::source::{Staged, TextureInfo};
use crate::text_lines::{Lines, without_comment, words};
use std::borrow::Cow;
use std::sync::Arc;
use stonecut_mesh::colours::{ColourSurvey, held, is_outside};
use stonecut_mesh::property::Scalar;
use stonecut_system::error::Result;
use stonecut_system::losses::{Ledger, Loss, LossKind, Severity};

/// Returns whether text begins like an OBJ file: its first word outside of comments is one of OBJ's.
pub fn looks_like(first: &[u8]) -> bool {
    const WORDS: [&[u8]; 12] =
        [b"v", b"vn", b"vt", b"vp", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl", b"l", b"p"];
    let first = first.strip_prefix(BYTE_ORDER_MARK).unwrap_or(first);
    let line = first
        .split(|b| matches!(b, b'\n' | b'\r'))
        .map(<[u8]>::trim_ascii)
        .find(|line| !line.is_empty() && !line.starts_with(b"#"));
    let word = line.and_then(|line| words(line).next());
    word.is_some_and(|word| WORDS.contains(&&*lower(word)))
}

/// The first word of a line as OBJ has it: in lower case.
fn lower(word: &[u8]) -> Cow<'_, [u8]> {
    match word.iter().any(u8::is_ascii_uppercase) {
        true => Cow::Owned(word.to_ascii_lowercase()),
        false => Cow::Borrowed(word),
    }
}

/// Findings of the first pass.
#[derive(Default)]
struct Summary {
    n_vertices: u64,
    n_faces: u64,
    /// Vertices with a colour, and with an opacity behind it.
    n_coloured: u64,
    n_opacities: u64,
    /// True if the first, and the last, of four numbers behind coordinates is not 1 somewhere.
    has_other_first: bool,
    has_other_last: bool,
    colours: ColourSurvey,
    extent: Extent,
    textured: bool,
    materials: Named,
    names: Names,
    comments: Vec<String>,
    /// Lines that a simplified mesh has no place for, as `LEFT_OUT` has them.
    n_left_out: [u64; 5],
    /// Other lines that are not read, and the word that the first begins with.
    n_unknown: u64,
    unknown: String,
    /// Comments in which ZBrush has the colours of vertices.
    n_painted: u64,
}

/// Kinds of lines that are counted in `Summary::n_left_out`, as messages name them.
const LEFT_OUT: [&str; 5] = [
    "normals of corners (vn)",
    "lines and points (l, p)",
    "smoothing groups (s)",
    "curves and surfaces (vp, curv, surf)",
    "numbers behind the coordinates of vertices (a weight, or unknown)",
];

const LEFT_OUT_KINDS: [(LossKind, Severity); 5] = [
    (LossKind::Normals, Severity::Notice),
    (LossKind::Elements, Severity::Partial),
    (LossKind::Normals, Severity::Notice),
    (LossKind::Elements, Severity::Partial),
    (LossKind::Attributes, Severity::Partial),
];

impl Summary {
    fn read(file: &RawFile, skip_bad: bool) -> Result<Self> {
        let mut summary = Summary::default();
        let (mut lines, mut line) = (Lines::of_obj(file), Vec::new());
        while lines.next(&mut line)? {
            let mut words = words(without_comment(&line));
            let first = words.next().map(lower);
            match first.as_deref() {
                Some(b"v") => {
                    let vertex = vertex(words, skip_bad).map_err(|what| lines.bad(what))?;
                    summary.n_vertices += 1;
                    summary.extent.add(vertex.position);
                    summary.n_left_out[4] += u64::from(vertex.has_more);
                    if let Some(colour) = vertex.colour {
                        summary.n_coloured += 1;
                        colour.iter().for_each(|&value| summary.colours.add(value));
                        if let Some(last) = vertex.opacity {
                            summary.n_opacities += 1;
                            summary.has_other_first |= colour[0] != 1.0;
                            summary.has_other_last |= last != 1.0;
                        }
                    }
                }
                Some(b"f" | b"fo") => {
                    summary.n_faces += 1;
                    summary.names.number();
                    summary.textured |= words.next().is_some_and(has_texture);
                }
                Some(word @ (b"mtllib" | b"usemtl")) => summary.materials.learn(word, &line),
                Some(b"vn") => summary.n_left_out[0] += 1,
                Some(b"l" | b"p") => summary.n_left_out[1] += 1,
                Some(word @ (b"o" | b"g")) => summary.names.begin(word, &line),
                // One group of all faces, or none, parts nothing.
                Some(b"s") => {
                    let is_group = |word: &[u8]| ![&b"off"[..], b"0", b"1"].contains(&word);
                    summary.n_left_out[2] += u64::from(words.next().is_some_and(is_group));
                }
                Some(b"vp" | b"curv" | b"curv2" | b"surf") => summary.n_left_out[3] += 1,
                Some(b"vt") => {}
                Some(word) => {
                    summary.n_unknown += 1;
                    if summary.unknown.is_empty() {
                        summary.unknown =
                            String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
                    }
                }
                None if line.trim_ascii_start().starts_with(b"#MRGB ") => summary.n_painted += 1,
                // Only a comment whose sign stands alone is kept.
                None if summary.n_vertices == 0 && summary.comments.len() < 1000 => {
                    let text = line.trim_ascii().strip_prefix(b"#").unwrap_or_default();
                    if text.first().is_none_or(u8::is_ascii_whitespace) && line.contains(&b'#') {
                        let text = text.trim_ascii();
                        summary.comments.push(String::from_utf8_lossy(text).into_owned());
                    }
                }
                _ => {}
            }
        }
        if summary.n_vertices == 0 {
            return Err(file.bad(
                "this is not an OBJ file with a mesh: no line of it begins with 'v'; export it again",
            ));
        }
        Ok(summary)
    }

    /// Enters the lines that have no place.
    fn enter_left_out(&self, losses: &mut Ledger) {
        for (number, (n, what)) in self.n_left_out.iter().zip(LEFT_OUT).enumerate() {
            if *n > 0 {
                let (kind, severity) = LEFT_OUT_KINDS[number];
                losses.lose(Loss::new(kind, what, "not carried").count(*n).severity(severity));
            }
        }
        if self.n_unknown > 0 {
            let loss =
                Loss::new(LossKind::Elements, "lines that begin otherwise", "not read").notice();
            losses.lose(loss.count(self.n_unknown).example(format!("'{}'", self.unknown)));
        }
        if self.n_painted > 0 {
            let severity = if self.n_coloured == 0 { Severity::Whole } else { Severity::Partial };
            let loss = Loss::new(LossKind::Colors, "colours in comments (#MRGB)", "not read");
            let remedy = "export the mesh as PLY, which has them at vertices";
            losses.lose(loss.count(self.n_painted).remedy(remedy).severity(severity));
        }
    }

    /// Returns whether vertices have a weight of 1 before their colour, not an opacity behind it.
    fn has_weights(&self) -> bool {
        self.has_other_last && !self.has_other_first
    }

    /// Returns whether faces get the number of their material.
    fn has_numbers(&self) -> bool {
        self.textured || self.materials.has_any()
    }
}

/// The names of objects and groups, and that of the faces to come.
#[derive(Default)]
struct Names {
    list: NameList,
    current: Name,
    /// Its number, once a face has it.
    number: Option<i32>,
}

impl Names {
    /// Takes a line `o` or `g`; several groups are one name, and an object ends the groups before it.
    fn begin(&mut self, word: &[u8], line: &[u8]) {
        let text = encodings::name(after_word(1, line));
        // A sign within a name is part of it.
        let text = text.split_once(" #").map_or(text.as_str(), |(name, _)| name);
        self.current = match word {
            b"o" => Name::new(text, ""),
            _ => Name { group: Name::new("", text).group, ..std::mem::take(&mut self.current) },
        };
        self.number = None;
    }

    /// The number of the name of a face.
    fn number(&mut self) -> i32 {
        *self.number.get_or_insert_with(|| self.list.number(&self.current))
    }

    /// Begins again at the top of the file.
    fn rewind(&mut self) {
        (self.current, self.number) = (Name::default(), None);
    }
}

/// Reads an OBJ file into a PLY.
pub fn read(file: &RawFile, options: &StageOptions) -> Result<(RawFile, Staged)> {
    let skip_bad = options.read.skip_bad;
    let mut summary = Summary::read(file, skip_bad)?;
    let mut staged = Staged::default();
    let mut names = std::mem::take(&mut summary.names);
    let given_up = names.list.settle(file.path(), (options.read.names, options.parse_bytes))?;
    given_up.into_iter().for_each(|loss| staged.losses.lose(loss));
    summary.comments.extend(names.list.comments());
    let has_names = names.list.has_numbers();
    names.rewind();
    let materials =
        summary.materials.describe(file.path(), (summary.textured, options.parse_bytes))?;
    summary.enter_left_out(&mut staged.losses);
    staged.losses.merge(&materials.losses);
    if summary.textured {
        let name = |image: &Image| image.name.clone();
        let mut files: Vec<String> = materials.images.iter().map(name).collect();
        if files.is_empty() {
            // Coordinates are worth as much as an image that is not known.
            files.extend(materials.list.iter().map(|material| material.name.clone()));
            files.extend(summary.materials.library());
        }
        staged.texture = Some(TextureInfo { files, property: "texcoord".to_owned() });
    }
    // The labels of a face: its material and its name, as far as there are any.
    let of_all =
        if summary.materials.has_any() || materials.list.is_empty() { NO_MATERIAL } else { 0 };
    let (mut material, mut labels) = (of_all, Vec::new());
    let mut texture = summary.textured.then(|| TexturedFaces::new(options));
    let label_bytes = 4 * (usize::from(summary.has_numbers()) + usize::from(has_names));
    let coordinate = summary.extent.coordinate();
    let coloured = summary.n_coloured > 0;
    let has_weights = summary.has_weights();
    // Colours go from 0 to 1, but some programs write 0 to 255.
    let white = f64::from(summary.colours.white_of_floats());
    let mut n_clamped = 0u64;

    let (mut vertices, mut faces) = (options.spool(), options.spool());
    let (mut n_vertices, mut n_faces, mut n_before, mut ends_cut) = (0, 0, 0, false);
    let (mut lines, mut line) = (Lines::of_obj(file), Vec::new());
    let mut row = Vec::new();
    while lines.next(&mut line)? {
        let mut words = words(without_comment(&line));
        let first = words.next().map(lower);
        match first.as_deref() {
            Some(b"v") => {
                let vertex = vertex(words, skip_bad).map_err(|what| lines.bad(what))?;
                let vertex = if has_weights { vertex.weighted() } else { vertex };
                if !skip_bad && vertex.position.iter().any(|v| !v.is_finite()) {
                    return Err(lines.bad(
                        "a vertex is not finite; repair the file, or drop such vertices and their \
                         faces with --skip-bad",
                    ));
                }
                row.clear();
                for value in vertex.position {
                    match coordinate {
                        Scalar::F64 => row.extend_from_slice(&value.to_le_bytes()),
                        _ => row.extend_from_slice(&(value as f32).to_le_bytes()),
                    }
                }
                if coloured {
                    let shares = vertex.colour.map(|colour| colour.map(|value| value / white));
                    n_clamped +=
                        u64::from(shares.is_some_and(|all| all.into_iter().any(is_outside)));
                    let shares = shares.unwrap_or([1.0; 3]);
                    row.extend(shares.map(|share| (255.0 * held(share)).round() as u8));
                }
                vertices.write(&row)?;
                n_vertices += 1;
            }
            Some(b"vt") => {
                if let Some(texture) = &mut texture {
                    texture.add_coordinates(words, skip_bad).map_err(|what| lines.bad(what))??;
                }
            }
            Some(b"usemtl") => {
                material = summary.materials.number(&line);
                labels.clear();
            }
            Some(word @ (b"o" | b"g")) if has_names => {
                names.begin(word, &line);
                labels.clear();
            }
            Some(b"f" | b"fo") => {
                match face(words.clone(), n_vertices, summary.n_vertices, &mut row) {
                    Ok(n_corners) => {
                        ends_cut = lines.has_no_end && is_cut(words.clone(), n_before);
                        n_before = n_corners;
                        if labels.is_empty() && summary.has_numbers() {
                            labels.extend_from_slice(&material.to_le_bytes());
                        }
                        if has_names && labels.len() < label_bytes {
                            labels.extend_from_slice(&names.number().to_le_bytes());
                        }
                        match &mut texture {
                            Some(texture) => texture.add_face(words, &labels)?,
                            None => row.extend_from_slice(&labels),
                        }
                        faces.write(&row)?;
                        n_faces += 1;
                    }
                    Err(_) if options.read.skip_bad => staged.faults.bad_faces += 1,
                    Err(what) => {
                        return Err(lines.bad(format!(
                            "{what}; export the mesh again, or drop such faces with --skip-bad"
                        )));
                    }
                }
            }
            _ => {}
        }
    }
    if ends_cut {
        let why =
            "it has no end, and fewer or shorter corners than the others: the file may be cut off";
        staged.losses.lose(Loss::new(LossKind::Geometry, "the last line, a face", why));
    }
    staged.n_bare = if coloured { summary.n_vertices - summary.n_coloured } else { 0 };
    let of_vertices = "colours of vertices";
    for (n, what, why) in [
        (n_clamped, of_vertices, format!("outside of 0 to {white}: clamped")),
        (
            if has_weights { 0 } else { summary.n_opacities },
            "opacity behind the colour of vertices",
            "not carried".to_owned(),
        ),
    ] {
        if n > 0 {
            staged.losses.lose(Loss::new(LossKind::Colors, what, why).count(n));
        }
    }
    for (n, what, why) in [
        (
            texture.as_ref().map_or(0, |texture| texture.n_not_finite),
            "texture coordinates (vt)",
            "not finite: OBJ and GLB get 0",
        ),
        (
            texture.as_ref().map_or(0, |texture| texture.n_thirds),
            "third texture coordinates (w of vt)",
            "not carried",
        ),
        (texture.as_ref().map_or(0, |texture| texture.n_bare(&materials)), BARE_FACES, BARE_REASON),
    ] {
        if n > 0 {
            staged.losses.lose(Loss::new(LossKind::TextureCoordinates, what, why).count(n));
        }
    }
    if summary.has_numbers() {
        staged.materials = Some(Arc::new(materials));
    }
    let header = header(&summary, (coordinate, coloured, has_names), n_faces);
    let vertices = vertices.finish(file.path())?;
    let mut faces = faces.finish(file.path())?;
    if let Some(texture) = texture {
        let index_bytes = if wide(summary.n_vertices) { 8 } else { 4 };
        let (joined, n_unknown) = texture.join(&faces, (index_bytes, label_bytes), n_faces)?;
        faces = joined;
        if n_unknown > 0 {
            let why = "texture coordinates that they name do not exist: 0";
            let loss = Loss::new(LossKind::TextureCoordinates, "corners of faces", why);
            staged.losses.lose(loss.count(n_unknown));
        }
    }
    let mut out = options.spool();
    out.write(header.as_bytes())?;
    out.append_file(&vertices)?;
    drop(vertices);
    out.append_file(&faces)?;
    Ok((out.finish(file.path())?, staged))
}

fn header(
    summary: &Summary,
    (coordinate, coloured, has_names): (Scalar, bool, bool),
    n_faces: u64,
) -> String {
    let mut text = "ply\nformat binary_little_endian 1.0\n".to_owned();
    for comment in &summary.comments {
        text.push_str(&format!("comment {}\n", comment.replace(['\n', '\r'], " ")));
    }
    text.push_str(&format!("element vertex {}\n", summary.n_vertices));
    let name = crate::ply::writer::type_name(coordinate);
    for axis in ["x", "y", "z"] {
        text.push_str(&format!("property {name} {axis}\n"));
    }
    if coloured {
        text.push_str("property uchar red\nproperty uchar green\nproperty uchar blue\n");
    }
    let index = if wide(summary.n_vertices) { "uint64" } else { "uint" };
    text.push_str(&format!("element face {n_faces}\nproperty list uint {index} vertex_indices\n"));
    if summary.textured {
        text.push_str("property list uint float texcoord\n");
    }
    if summary.has_numbers() {
        text.push_str("property int texnumber\n");
    }
    if has_names {
        text.push_str(&format!("property int {OBJECT}\n"));
    }
    text.push_str("end_header\n");
    text
}
