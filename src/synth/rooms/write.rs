//! Writes rooms: images, material library, and the mesh with texture at its corners.
//!
//! Images come first and the mesh last, each by rename. A run that fails removes the images it made.

use super::Rooms;
use crate::shuffle::Shuffler;
use crate::sliced::CountedSurface;
use crate::surface::{Order, Surface};
use crate::write::Stream;
use crate::write_shuffled::{scratch_folder, shuffle_vertices};
use std::io::Read;
use std::path::{Path, PathBuf};
use stonecut_io::materials::{Materials, TexturePlan};
use stonecut_io::ply::{FaceSchema, OutputHeader, Place, TexturedTriangle};
use stonecut_io::{MeshSink, OutputFormat, OutputKind};
use stonecut_mesh::property::{Property, Scalar};
use stonecut_system::disk::open_input;
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::in_order;
use stonecut_system::pending_file::{refuse_irregular, write_whole};

/// Bytes of a face on its way through the shuffler: three corners, six coordinates, an image.
const FACE_BYTES: usize = 40;

/// Names of the images of an output, and of its material library if it is an OBJ.
pub(in super::super) fn file_names(
    path: &Path,
    n_pages: u64,
    format: OutputFormat,
) -> Result<(Vec<String>, Option<String>)> {
    let kind = format.kind.map_or_else(|| OutputKind::of(path), Ok)?;
    if !matches!(kind, OutputKind::Ply | OutputKind::Obj) {
        return Ok((Vec::new(), None));
    }
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    // A name with blanks would be two names in an MTL file and in many readers of PLY comments.
    let fit =
        |stem: &&str| *stem != "-" && !stem.chars().any(|c| c.is_whitespace() || c.is_control());
    let Some(stem) = stem.filter(fit) else {
        return Err(Error::Usage(format!(
            "'{}': rooms names its images after the output; give it a file name of plain text without blanks",
            path.display()
        )));
    };
    let images = (0..n_pages).map(|n| format!("{stem}_{n:03}.png")).collect();
    Ok((images, (kind == OutputKind::Obj).then(|| format!("{stem}.mtl"))))
}

/// Refuses what cannot be written, before the first byte.
fn check(rooms: &Rooms, files: &[PathBuf], force: bool) -> Result<()> {
    if let Some(least) = rooms.atlas.least_pages() {
        let asked = rooms.atlas.n_pages;
        return Err(Error::Usage(format!(
            "--pages {asked}: the images would be wider than 16384 pixels; ask for at least {least}"
        )));
    }
    for file in files {
        refuse_irregular(file)?;
        let shown = file.display();
        match is_ours(file) {
            None => {}
            Some(_) if !force => {
                return Err(Error::Usage(format!("{shown} exists; --force overwrites it")));
            }
            Some(true) => {}
            Some(false) => {
                return Err(Error::Usage(format!(
                    "{shown} exists and was not written by stonecut; --force overwrites only OUTPUT and \
                     earlier images of rooms: move it, or give OUTPUT another name"
                )));
            }
        }
    }
    Ok(())
}

/// Returns whether a file names this program near its beginning, as its images and libraries do; `None` without a file.
fn is_ours(file: &Path) -> Option<bool> {
    if std::fs::metadata(file).is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound) {
        return None;
    }
    let Ok(opened) = open_input(file) else { return Some(false) };
    let mut start = Vec::new();
    let is_read = opened.take(1024).read_to_end(&mut start).is_ok();
    Some(is_read && start.windows(8).any(|word| word == b"stonecut"))
}

/// Writes everything to `path` and beside it; returns the number of images.
pub(in super::super) fn write(
    path: &Path,
    surface: &CountedSurface<Rooms>,
    stream: &Stream,
    mut header: OutputHeader,
    shuffle: Option<u64>,
    (format, force): (OutputFormat, bool),
) -> Result<u64> {
    let rooms = surface.surface();
    let (images, library) = file_names(path, rooms.atlas.n_pages, format)?;
    let beside = |name: &String| path.with_file_name(name);
    let files: Vec<PathBuf> = images.iter().chain(&library).map(beside).collect();
    check(rooms, &files, force)?;
    if images.is_empty() {
        return Err(Error::Internal("rooms without images are written like any kind".to_owned()));
    }
    let pages: Vec<(u64, &str)> = (0..).zip(images.iter().map(String::as_str)).collect();
    let (properties, plan) = texture(&pages, library.as_ref().map(beside));
    header.faces = FaceSchema { texture: true, properties };
    header.textures = Some(plan);
    let mut made = Made { files: Vec::new(), keep: false };
    paint(rooms, &files[..images.len()], stream, force, &mut made.files)?;
    let place = Place { replace: force, ..Place::from(path) };
    let mut file = MeshSink::create(place, header, format)?;
    write_mesh(&mut file, path, surface, stream, shuffle)?;
    file.finish()?;
    made.keep = true;
    Ok(images.len() as u64)
}

/// Paints all images, and notes which are written.
pub(in super::super) fn paint(
    rooms: &Rooms,
    files: &[PathBuf],
    stream: &Stream,
    force: bool,
    written: &mut Vec<PathBuf>,
) -> Result<()> {
    let paint = |page: u64, png: &mut Vec<u8>| {
        *png = rooms.image(page).to_png()?;
        Ok(())
    };
    in_order(files.len() as u64, stream.threads, stream.progress, paint, |page, png| {
        let file = &files[page as usize];
        write_whole(Place { replace: force, ..Place::from(file.as_path()) }, png)?;
        written.push(file.clone());
        Ok(())
    })
}

/// Properties of faces and a white material for each image, which has a number and a name.
pub(in super::super) fn texture(
    pages: &[(u64, &str)],
    library: Option<PathBuf>,
) -> (Vec<Property>, TexturePlan) {
    let files: Vec<(String, PathBuf)> =
        pages.iter().map(|(_, name)| ((*name).to_owned(), PathBuf::from(name))).collect();
    let names: Vec<String> = pages.iter().map(|(page, _)| format!("page_{page:03}")).collect();
    let mut materials = Materials::of_files(&files, &names);
    for material in &mut materials.list {
        (material.ambient, material.specular) = (Some([0.0; 3]), Some([0.0; 3]));
        material.mtl_lines.push("illum 1".to_owned());
    }
    (vec![Property::new("texnumber", Scalar::I32)], TexturePlan::given(materials, library))
}

/// Files beside the output; removed unless the output is complete.
struct Made {
    files: Vec<PathBuf>,
    keep: bool,
}

impl Drop for Made {
    fn drop(&mut self) {
        if !self.keep {
            // A leftover only wastes space.
            self.files.iter().for_each(|file| drop(std::fs::remove_file(file)));
        }
    }
}

fn write_mesh(
    file: &mut MeshSink,
    path: &Path,
    surface: &CountedSurface<Rooms>,
    stream: &Stream,
    shuffle: Option<u64>,
) -> Result<()> {
    let Some(seed) = shuffle else {
        stream.vertices(|records| file.write_vertices(records))?;
        return faces(surface, stream, None, |encoded| put(file, encoded));
    };
    let (n_vertices, n_faces) = (surface.n_vertices(), surface.n_faces());
    let order = Order::new(n_vertices, n_faces, seed);
    shuffle_vertices(file, path, stream, &order)?;
    let folder = scratch_folder(path);
    let mut shuffler = Shuffler::new(folder, n_faces, FACE_BYTES)?;
    let mut row = 0;
    faces(surface, stream, Some(&order), |encoded| {
        encoded.chunks_exact(FACE_BYTES).try_for_each(|face| {
            row += 1;
            shuffler.put(order.faces.apply(row - 1), face)
        })
    })?;
    shuffler.drain(|encoded| put(file, encoded))
}

/// Hands on all faces, `FACE_BYTES` each: corners, texture coordinates, number of the image.
pub(in super::super) fn faces(
    surface: &CountedSurface<Rooms>,
    stream: &Stream,
    order: Option<&Order>,
    mut sink: impl FnMut(&[u8]) -> Result<()>,
) -> Result<()> {
    let produce = |block: u64, encoded: &mut Vec<u8>| {
        encoded.clear();
        let piece = surface.surface().piece(block);
        let first = surface.first_vertex(block);
        for ((face, page), row) in
            piece.faces.iter().zip(&piece.pages).zip(surface.first_face(block)..)
        {
            let mut corners =
                face.map(|id| (first + u64::from(id), piece.vertices[id as usize].uv));
            if let Some(order) = order {
                corners = corners.map(|(id, uv)| (order.vertices.apply(id), uv));
                corners.rotate_left(order.turn(row));
            }
            // Ids are below 2^32: larger meshes are refused before anything is made.
            corners.iter().for_each(|(id, _)| encoded.extend((*id as u32).to_le_bytes()));
            corners.iter().flat_map(|(_, uv)| uv).for_each(|x| encoded.extend(x.to_le_bytes()));
            encoded.extend(page.to_le_bytes());
        }
        Ok(())
    };
    in_order(surface.n_face_blocks(), stream.threads, stream.progress, produce, |_, encoded| {
        stream.progress.add((encoded.len() / FACE_BYTES) as u64);
        sink(encoded)
    })
}

/// Writes encoded faces.
fn put(file: &mut MeshSink, encoded: &[u8]) -> Result<()> {
    let word = |face: &[u8], n: usize| -> [u8; 4] { std::array::from_fn(|i| face[4 * n + i]) };
    let mut triangles = Vec::with_capacity(encoded.len() / FACE_BYTES);
    let mut pages = Vec::with_capacity(encoded.len() / 10);
    for face in encoded.chunks_exact(FACE_BYTES) {
        let number = |n: usize| f32::from_le_bytes(word(face, n));
        triangles.push(TexturedTriangle {
            corners: [0, 1, 2].map(|n| u64::from(u32::from_le_bytes(word(face, n)))),
            texture: [3, 5, 7].map(|n| [number(n), number(n + 1)]),
            ..TexturedTriangle::default()
        });
        pages.extend(word(face, 9));
    }
    file.write_full_faces(&triangles, &pages)
}
