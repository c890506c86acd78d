//! GLB and glTF in: all meshes of the scene in their places, as one PLY with texture coordinates at corners.
//!
//! Vertices that differ only in their normal become one, since glTF splits them along every hard edge; their normals
//! are averaged, unless a command keeps them apart (`HardEdges`). All is read a block at a time and joined by sorts on disk (`join`): the document alone, and a compressed
//! view, have to fit into memory.

use super::buffers::{Buffers, Inline};
use super::draco::DracoMeshes;
use super::elements::{BLOCK, Elements};
use super::instances::all_placed;
use super::join::{FaceParts, Joiner};
use super::json::{Document, Mesh, Node, Primitive};
use super::left_out::{self, KNOWN};
use super::materials_in::{self, Coordinates};
use super::opening::document;
use super::scene::NodePlacement;
use super::totals;
use super::vertex_row::VertexRow;
use crate::hard_edges;
use crate::materials::{BARE_FACES, BARE_REASON, MapKind, Materials};
use crate::names::{Name, NameList};
use crate::open_options::{HardEdges, StageOptions};
use crate::ply::Faults;
use crate::ply::raw::RawFile;
use crate::ply::source::{Staged, TextureInfo};
use std::sync::Arc;
use stonecut_mesh::colours::{held, is_outside, srgb_byte};
use stonecut_mesh::placing::offset_comment;
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Faces of one mesh in one place.
struct Piece<'a> {
    primitive: &'a Primitive,
    /// The number of its name.
    name: i32,
    /// The kind of its primitives, as they are read.
    mode: u32,
    at: NodePlacement,
    positions: Elements,
    normals: Option<Elements>,
    colours: Option<Elements>,
    texture: Option<(Elements, Coordinates)>,
    indices: Option<Elements>,
}

impl Piece<'_> {
    /// Sums `of` the kind of primitives and the number of indices over pieces.
    fn sum<'b>(pieces: impl Iterator<Item = &'b Self>, of: fn(u32, u64) -> u64) -> u64
    where
        Self: 'b,
    {
        let n_indices = |p: &Self| p.indices.as_ref().map_or(p.positions.count, |list| list.count);
        pieces.map(|p| of(p.primitive.mode.unwrap_or(TRIANGLES), n_indices(p))).sum()
    }
}

/// The colour of a piece whose vertices have none: white, through which its material is seen, or that material's where the
/// output has none. Images hide either.
fn bare_colour(piece: &Piece, shown: Option<&Materials>) -> [u8; 4] {
    match piece.primitive.material.and_then(|number| shown?.list.get(number)) {
        Some(material) if material.map(MapKind::Base).is_none() => {
            let [r, g, b, _] = material.base;
            let [r, g, b] = [r, g, b].map(|x| (255.0 * held(f64::from(x))).round() as u8);
            [r, g, b, 255]
        }
        _ => [255; 4],
    }
}

/// Reads a GLB or glTF file into a PLY.
pub(crate) fn read(file: RawFile, options: &StageOptions) -> Result<(RawFile, Staged)> {
    let file = Arc::new(file);
    let (document, binary) = document(&file, options)?;
    for name in &document.extensions_required {
        if !KNOWN.contains(&name.as_str()) && !name.starts_with("KHR_materials_") {
            return Err(file.bad(format!(
                "it requires {name}, which is not read; export it without, or let gltf-transform rewrite it"
            )));
        }
    }
    let inline = Inline::new(&file, &document, options)?;
    let mut buffers = Buffers::open(&file, &document, (binary, &inline), options)?;
    let (mut materials, coordinates) = materials_in::read(&file, &document, &mut buffers, &inline)?;
    let mut names = NameList::default();
    let found = (&mut materials, &mut names);
    let pieces = pieces((&file, &document), (&mut buffers, options), &coordinates, found)?;
    if pieces.is_empty() {
        return Err(file.bad("its scene has no triangles"));
    }
    let has_normals = pieces.iter().all(|piece| piece.normals.is_some());
    if !has_normals && pieces.iter().any(|piece| piece.normals.is_some()) {
        let what = "normals, which only some of the meshes have";
        materials.lose(Loss::new(LossKind::Normals, what, "not carried").notice());
    }
    let n_left_over: u64 = Piece::sum(pieces.iter(), totals::n_left_over);
    if n_left_over > 0 {
        materials.lose(Loss::remark(format!(
            "{n_left_over} indices at the end of primitives make no triangle, which takes three: left out"
        )));
    }
    let has_texture = pieces.iter().any(|piece| piece.texture.is_some());
    let has_numbers = !materials.list.is_empty();
    let has_colours = pieces.iter().any(|piece| piece.colours.is_some());
    let given_up = names.settle(file.path(), (options.read.names, options.parse_bytes))?;
    given_up.into_iter().for_each(|loss| materials.lose(loss));
    let mut joiner = Joiner::new(options, has_colours, has_normals);
    joiner.comments.extend(offset(&document).map(offset_comment));
    let copyright = document.asset.copyright.iter().map(|text| format!("copyright {text}"));
    let comments = document.asset.comments.iter().cloned().chain(copyright);
    joiner.comments.extend(comments.map(|line| line.replace(['\n', '\r'], " ")));
    joiner.comments.extend(names.comments());
    let has = FaceParts { texture: has_texture, numbers: has_numbers, names: names.has_numbers() };
    joiner.has = has;
    let (mut n_bad, mut n_not_finite, mut n_clamped, mut n_bare) = (0, 0, 0, 0);
    let shown = (has_colours && options.bare_as_material).then(|| materials.shown().into_owned());
    for piece in &pieces {
        let first = joiner.n_vertices();
        let bare = bare_colour(piece, shown.as_ref());
        let [not_finite, clamped, outside, coloured] =
            put_vertices(&file, (piece, bare), options, &mut joiner)?;
        let material = piece.primitive.material.and_then(|number| i32::try_from(number).ok());
        if material.is_some_and(|number| materials.has_base(number)) {
            materials.n_tinted += coloured;
        }
        if outside > 0 {
            materials.show_wrap(piece.primitive.material);
        }
        (n_not_finite, n_clamped) = (n_not_finite + not_finite, n_clamped + clamped);
        n_bare += if piece.colours.is_none() { piece.positions.count } else { 0 };
        n_bad += put_faces(&file, piece, (first, options.read.skip_bad), &mut joiner)?;
    }
    if n_not_finite > 0 {
        let why = "not finite: 0 stands for them";
        let loss = Loss::new(LossKind::TextureCoordinates, "texture coordinates", why);
        materials.lose(loss.count(n_not_finite));
    }
    if n_clamped > 0 {
        let loss = Loss::new(LossKind::Colors, "colours of vertices", "outside of 0 to 1: clamped");
        materials.lose(loss.count(n_clamped));
    }
    if shown.is_some() {
        for (number, material) in materials.list.iter_mut().enumerate() {
            let is_own = |piece: &&Piece| piece.primitive.material == Some(number);
            material.is_at_vertices = pieces.iter().filter(is_own).all(|p| p.colours.is_none());
        }
    }
    let is_bare = |piece: &&Piece| {
        let material = piece.primitive.material.and_then(|number| i32::try_from(number).ok());
        has_texture && piece.texture.is_none() && material.is_some_and(|m| materials.has_base(m))
    };
    let n_bare_faces: u64 = Piece::sum(pieces.iter().filter(is_bare), totals::n_triangles);
    if n_bare_faces > 0 {
        let loss = Loss::new(LossKind::TextureCoordinates, BARE_FACES, BARE_REASON);
        materials.lose(loss.count(n_bare_faces));
    }
    let faults = Faults { bad_faces: n_bad, ..Faults::default() };
    let n_bare = if has_colours && shown.is_none() { n_bare } else { 0 };
    let mut staged = Staged { faults, beside: buffers.beside(), n_bare, ..Staged::default() };
    if has_texture {
        let mut files: Vec<String> =
            materials.images.iter().map(|image| image.name.clone()).collect();
        if files.is_empty() {
            files.push("no image".to_owned());
        }
        staged.texture = Some(TextureInfo { files, property: "texcoord".to_owned() });
    }
    let (out, n_hard) = joiner.finish(&file)?;
    staged.losses.merge(&materials.losses);
    if let (HardEdges::Averaged(remedy), true) = (options.hard_edges, n_hard > 0) {
        staged.losses.lose(hard_edges::averaged(n_hard, remedy));
    }
    if has_numbers {
        staged.materials = Some(Arc::new(materials));
    }
    Ok((out, staged))
}

/// The offset that this program has subtracted when it wrote the file.
fn offset(document: &Document) -> Option<[f64; 3]> {
    let is_ours = document.asset.generator.starts_with("stonecut");
    document.nodes.iter().find_map(|node| node.extras.offset).filter(|_| is_ours)
}

/// A node is an object, its mesh a group; where both have the same name, they are an object alone.
fn name_of(node: Option<&Node>, mesh: &Mesh) -> Name {
    let own = node.and_then(|node| node.name.as_deref()).unwrap_or_default();
    let name = Name::new(own, mesh.name.as_deref().unwrap_or_default());
    match node.map(|node| &node.extras) {
        Some(extras) if name.object == name.group => Name {
            object: if extras.is_group && !extras.is_object_too {
                String::new()
            } else {
                name.object
            },
            group: if extras.is_group { name.group } else { String::new() },
        },
        _ => name,
    }
}

/// The kind of an attribute that is not read.
fn kind_of(attribute: &str) -> LossKind {
    match attribute.split('_').next() {
        Some("COLOR") => LossKind::Colors,
        Some("TEXCOORD") => LossKind::TextureCoordinates,
        Some("TANGENT") => LossKind::Normals,
        Some("JOINTS" | "WEIGHTS") => LossKind::Elements,
        _ => LossKind::Attributes,
    }
}

/// All primitives of the scene with their accessors, checked.
fn pieces<'a>(
    (file, document): (&RawFile, &'a Document),
    (buffers, options): (&mut Buffers, &StageOptions),
    coordinates: &[Coordinates],
    (materials, names): (&mut Materials, &mut NameList),
) -> Result<Vec<Piece<'a>>> {
    let (mut out, mut draco) = (Vec::new(), DracoMeshes::default());
    let placed = all_placed(file, document, (buffers, options.read.placing.turns_up))?;
    totals::hold(file, document, &placed, options)?;
    left_out::enter(document, &placed, materials);
    for placed in placed {
        let Some(mesh) = document.meshes.get(placed.mesh) else {
            return Err(
                file.bad(format!("mesh {}, which a node names, does not exist", placed.mesh))
            );
        };
        let name = name_of(document.nodes.get(placed.node), mesh);
        for primitive in &mesh.primitives {
            if !matches!(primitive.mode.unwrap_or(TRIANGLES), TRIANGLES | STRIP | FAN) {
                materials.lose(Loss::new(LossKind::Elements, "points and lines", "not carried"));
                continue;
            }
            let unpacked = draco.of((file, document), primitive, (buffers, options))?;
            let mode =
                if unpacked.is_some() { TRIANGLES } else { primitive.mode.unwrap_or(TRIANGLES) };
            let Some(&positions) = primitive.attributes.get("POSITION") else { continue };
            if let Some(material) = primitive.material.filter(|&m| m >= document.materials.len()) {
                return Err(file
                    .bad(format!("material {material}, which a primitive names, does not exist")));
            }
            let mut elements = |name: &str, number: usize, n: &[usize]| match unpacked
                .as_ref()
                .and_then(|unpacked| unpacked.attributes.get(name))
            {
                Some(known) if n.contains(&known.n_numbers) => Ok(known.clone()),
                _ => buffers.accessor(number, n),
            };
            let positions = elements("POSITION", positions, &[3])?;
            let mut attribute = |name: &str, n: &[usize]| -> Result<Option<Elements>> {
                let Some(&number) = primitive.attributes.get(name) else { return Ok(None) };
                let elements = elements(name, number, n)?;
                if elements.count != positions.count {
                    return Err(file.bad(format!(
                        "accessor {number} ({name}) has {} elements, the positions of its primitive {}",
                        elements.count, positions.count
                    )));
                }
                Ok(Some(elements))
            };
            let place = primitive.material.and_then(|material| coordinates.get(material).cloned());
            let place = place.unwrap_or_else(Coordinates::plain);
            let normals = attribute("NORMAL", &[3])?;
            let colours = attribute("COLOR_0", &[3, 4])?.map(Elements::into_colours);
            let texture = attribute(&format!("TEXCOORD_{}", place.set), &[2])?;
            for name in primitive.attributes.keys() {
                let used = format!("TEXCOORD_{}", place.set);
                if !["POSITION", "NORMAL", "COLOR_0", &used].contains(&name.as_str()) {
                    let what = format!("{name} of vertices");
                    materials.lose(Loss::new(kind_of(name), what, "not carried"));
                }
            }
            if !primitive.targets.is_empty() {
                materials.lose(Loss::new(LossKind::Elements, "morph targets", "not carried"));
            }
            let indices = match (unpacked, primitive.indices) {
                (Some(unpacked), _) => Some(unpacked.indices),
                (None, number) => {
                    number.map(|number| buffers.accessor(number, &[1])).transpose()?
                }
            };
            if let Some(indices) = indices.as_ref().filter(|indices| !indices.is_unsigned()) {
                return Err(file.bad(format!(
                    "the {} indices of a primitive are not unsigned integers; export the mesh again",
                    indices.count
                )));
            }
            let texture = texture.map(|elements| (elements, place));
            let (at, name) = (placed.at, names.number(&name));
            out.push(Piece {
                primitive,
                name,
                mode,
                at,
                positions,
                normals,
                colours,
                texture,
                indices,
            });
        }
    }
    Ok(out)
}

const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

/// Share of an image that coordinates may lie outside of it by rounding.
const BEYOND: f32 = 1e-3;

/// Hands on the vertices of a piece in their places; returns how many have texture coordinates that are not finite, how
/// many a colour beyond white, and how many coordinates beyond the image.
fn put_vertices(
    file: &RawFile,
    (piece, bare): (&Piece, [u8; 4]),
    options: &StageOptions,
    joiner: &mut Joiner,
) -> Result<[u64; 4]> {
    let (mut n_not_finite, mut n_clamped, mut n_outside, mut n_coloured) = (0, 0, 0, 0);
    let of_normals = piece.at.of_normals();
    let mut bytes = Vec::new();
    let (mut xyz, mut normals, mut colours, mut uvs) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut first = 0;
    while first < piece.positions.count {
        piece.positions.read(first, &mut bytes, &mut xyz)?;
        let optional = [(&piece.normals, &mut normals), (&piece.colours, &mut colours)];
        for (elements, out) in optional {
            if let Some(elements) = elements {
                elements.read(first, &mut bytes, out)?;
            }
        }
        if let Some((elements, _)) = &piece.texture {
            elements.read(first, &mut bytes, &mut uvs)?;
        }
        let n_colours = piece.colours.as_ref().map_or(4, |elements| elements.n_numbers);
        for (i, p) in xyz.as_chunks::<3>().0.iter().enumerate() {
            let position = piece.at.point(*p);
            if !options.read.skip_bad && position.iter().any(|x| !x.is_finite()) {
                return Err(file.bad(format!(
                    "vertex {} is not finite; repair the file, or drop such vertices and their faces with --skip-bad",
                    first + i as u64
                )));
            }
            let normal = match normals.as_chunks::<3>().0.get(i) {
                Some(n) => {
                    unit(of_normals.map(|row| row[0] * n[0] + row[1] * n[1] + row[2] * n[2]))
                }
                None => [0.0; 3],
            };
            let colour = match colours.get(i * n_colours..(i + 1) * n_colours) {
                Some(c) => {
                    let alpha = held(c.get(3).copied().unwrap_or(1.0));
                    n_clamped += u64::from(c[..3].iter().any(|&light| is_outside(light)));
                    let [r, g, b] = [c[0], c[1], c[2]].map(srgb_byte);
                    n_coloured += u64::from([r, g, b] != [255; 3]);
                    [r, g, b, (alpha * 255.0).round() as u8]
                }
                None => bare,
            };
            let uv = match (&piece.texture, uvs.as_chunks::<2>().0.get(i)) {
                (Some((_, place)), Some(&uv)) => place.place(uv),
                _ => [0.0; 2],
            };
            n_not_finite += u64::from(uv.iter().any(|x| !x.is_finite()));
            let uv = uv.map(|x| if x.is_finite() { x } else { 0.0 });
            n_outside += u64::from(uv.iter().any(|x| !(-BEYOND..=1.0 + BEYOND).contains(x)));
            joiner.put_vertex(&VertexRow { position, colour, normal, uv })?;
        }
        first += BLOCK;
    }
    Ok([n_not_finite, n_clamped, n_outside, n_coloured])
}

fn unit(v: [f64; 3]) -> [f32; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| if length > 0.0 { (x / length) as f32 } else { 0.0 })
}

/// Hands on the faces of a piece whose vertices begin with number `first`; returns how many are broken.
fn put_faces(
    file: &RawFile,
    piece: &Piece,
    (first, skip_bad): (u64, bool),
    joiner: &mut Joiner,
) -> Result<u64> {
    let n_vertices = piece.positions.count;
    let material = piece.primitive.material.map_or(-1, |material| material as i32);
    let labels = [material, piece.name];
    let (mode, is_mirror) = (piece.mode, piece.at.is_mirror());
    let n_indices = piece.indices.as_ref().map_or(n_vertices, |indices| indices.count);
    let (mut bytes, mut block) = (Vec::new(), Vec::new());
    let (mut open, mut place, mut n_bad, mut n) = ([0u64; 3], 0, 0, 0u64);
    for at in (0..n_indices).step_by(BLOCK as usize) {
        match &piece.indices {
            Some(indices) => indices.read(at, &mut bytes, &mut block)?,
            None => {
                block.clear();
                block.extend((at..n_indices.min(at + BLOCK)).map(|i| i as f64));
            }
        }
        for &index in &block {
            open[place] = index as u64;
            n += 1;
            if place < 2 {
                place += 1;
                continue;
            }
            // A triangle of a fan begins with the first corner of all, one of a strip turns every other time.
            let corners = open;
            match mode {
                STRIP => open = [corners[1], corners[2], 0],
                FAN => open = [corners[0], corners[2], 0],
                _ => place = 0,
            }
            if corners.iter().any(|&v| v >= n_vertices) {
                if skip_bad {
                    n_bad += 1;
                    continue;
                }
                return Err(file.bad(format!(
                    "a face names vertex {}, its primitive has {n_vertices}; export the mesh again, or drop such faces \
                     with --skip-bad",
                    corners.iter().max().unwrap_or(&0)
                )));
            }
            let is_turned = mode == STRIP && n.is_multiple_of(2);
            let [a, b, c] = corners.map(|v| first + v);
            joiner.put_face(if is_turned != is_mirror { [a, c, b] } else { [a, b, c] }, labels)?;
        }
    }
    Ok(n_bad)
}
