//! Colours of vertices out of the input's images and materials, for outputs that have colours but neither of them.
//!
//! A vertex gets the mean of what its corners show, in linear light, weighted by opacity (times its own colour, in formats that multiply the two; where images hide colours, vertices without an image keep theirs): the part of the image that reaches
//! halfway along the edges of each triangle. Sums of as many vertices as the memory holds are kept at a time;
//! the faces are read once for each such window. Bytes depend neither on memory nor on threads.

use super::Means;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use stonecut_io::materials::Materials;
use stonecut_io::ply::{FaceBlock, FaceLooks, MeshSource, OutputHeader, PlyWriter, VertexBlock};
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::property::{Property, Scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_render::texture::{
    ImageCache, Light, Palette, Purpose, Spot, UvBox, apart, multiply, pixel_of, times_opacity,
};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::Ledger;
use stonecut_system::memory::BASE_BYTES;
use stonecut_system::pending_file::Place;
use stonecut_system::units::{memory_word, show_bytes};

/// Properties that are added.
const COLOUR: [&str; 3] = ["red", "green", "blue"];

/// Shares of the memory: decoded images, and sums.
const IMAGE_SHARE: u64 = 2;
const SUM_SHARE: u64 = 3;

/// Colour of vertices that no image and no material colours.
const NONE: [u8; 3] = [180; 3];

/// Findings of colouring.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Coloured {
    /// Images that could not be used, and other losses.
    pub losses: Ledger,
    /// Faces of the input that are left out: those without three different corners, and those with a fault.
    pub degenerate_faces: u64,
    /// Those with a fault.
    pub bad_faces: u64,
}

/// True if vertices can get colours out of images or materials: they have none yet, or their own multiply those or are hidden.
pub fn colours_vertices(source: &MeshSource) -> bool {
    let has_colour = source.schema().properties.iter().any(|p| p.name == COLOUR[0]);
    let own = own_colour(source).is_some();
    let sees_materials =
        !has_colour || own && (!source.images_hide_colours() || source.has_bare_vertices());
    let has_images = |all: &Materials| source.has_corner_texture() && !all.images.is_empty();
    let sees_images = !has_colour || own;
    source
        .materials()
        .is_some_and(|all| sees_images && has_images(all) || sees_materials && is_tinted(all))
}

/// True if materials differ in colour, or if the colour of all of them is not a grey.
fn is_tinted(materials: &Materials) -> bool {
    let shown = materials.shown();
    let mut colours = shown.list.iter().map(|material| material.base);
    let Some([r, g, b, _]) = colours.next() else { return false };
    r != g || g != b || colours.any(|other| other[..3] != [r, g, b])
}

fn own_colour(source: &MeshSource) -> Option<ColourPlace> {
    ColourPlace::find(source.schema()).filter(|colour| colour.names() == COLOUR)
}

/// The properties of vertices after `colour_vertices`.
pub fn coloured_schema(source: &MeshSource) -> VertexSchema {
    let mut schema = source.schema().clone();
    if own_colour(source).is_none() {
        schema.properties.extend(COLOUR.map(|name| Property::new(name, Scalar::U8)));
    }
    schema
}

/// Memory without which vertices get no colours, beside `BASE_BYTES`.
pub fn least_for_colours(source: &MeshSource) -> u64 {
    IMAGE_SHARE * Palette::new(source.materials().map(Arc::as_ref), Purpose::View).largest_bytes()
}

/// Writes `source` as a PLY with a colour for each vertex, without images and texture coordinates.
///
/// Memory: 16 bytes a vertex of a window, as many as a third of it holds; one decoded image at least. Disk: the mesh.
/// Errors: an image that does not fit into half of the memory while it is decoded.
pub fn colour_vertices(source: &MeshSource, to: &Path, means: Means) -> Result<Coloured> {
    let image_bytes = means.memory_bytes / IMAGE_SHARE;
    let materials = source.materials().map(Arc::as_ref);
    let palette = Palette::settled(materials, Purpose::View, image_bytes);
    let least = palette.largest_bytes();
    if least > image_bytes {
        return Err(Error::NoMemory(format!(
            "colours of vertices: an image takes {} while it is decoded, the budget has {} for it; give --memory {}",
            show_bytes(least),
            show_bytes(image_bytes),
            memory_word(BASE_BYTES + IMAGE_SHARE * least)
        )));
    }
    let cache = ImageCache::new(&palette, image_bytes);
    let window = means.memory_bytes / SUM_SHARE / (size_of::<Light>() as u64 + 1);
    if window == 0 {
        return Err(Error::NoMemory(format!(
            "no memory for colours of vertices in {}; give more --memory",
            show_bytes(means.memory_bytes)
        )));
    }
    in_windows(source, to, means, (&palette, &cache), window)
}

fn in_windows(
    source: &MeshSource,
    to: &Path,
    means: Means,
    (palette, cache): (&Palette, &ImageCache),
    window: u64,
) -> Result<Coloured> {
    let n_vertices = source.n_vertices();
    let (schema, own) = (coloured_schema(source), own_colour(source));
    let hides = own.is_some() && source.images_hide_colours();
    let has_bare = source.has_bare_vertices();
    let mut coloured = Coloured::default();
    let mut writer = None;
    let mut first = 0;
    let mut records = Vec::new();
    let mut vertices = VertexBlock::default();
    let mut block = 0;
    while first < n_vertices || writer.is_none() {
        let end = n_vertices.min(first.saturating_add(window));
        let n = (end - first) as usize;
        let (sums, has_image) = (vec![[0.0; 4]; n], vec![false; n]);
        let mut painter = Painter { cache, palette, first, means, sums, has_image, hides };
        let counted = painter.paint(source)?;
        let writer = match &mut writer {
            Some(writer) => writer,
            None => {
                (coloured.degenerate_faces, coloured.bad_faces) =
                    (counted.n_degenerate, counted.n_bad);
                let header = OutputHeader {
                    comments: source.plain_comments(),
                    ..OutputHeader::new(schema.clone(), n_vertices, counted.n_triangles)
                };
                let place =
                    Place { path: to.to_path_buf(), disk: means.disk.clone(), replace: true };
                writer.insert(PlyWriter::create(place, header)?)
            }
        };
        // A block of vertices may belong to two windows.
        let mut next = first;
        while next < end {
            if next
                >= vertices.first + (vertices.records.len() / source.schema().record_bytes()) as u64
                || vertices.records.is_empty()
            {
                source.read_vertices(block, &mut vertices)?;
                block += 1;
            }
            let bytes = source.schema().record_bytes();
            let from = (next - vertices.first) as usize;
            let n = (vertices.records.len() / bytes - from).min((end - next) as usize);
            records.clear();
            for (i, record) in
                vertices.records[from * bytes..][..n * bytes].chunks_exact(bytes).enumerate()
            {
                let at = records.len();
                records.extend_from_slice(record);
                let vertex = (next - first) as usize + i;
                let mut light = painter.sums[vertex];
                let mut is_kept = false;
                if let Some(own) = own {
                    let [r, g, b] = own.bytes(record);
                    let is_bare = has_bare && [r, g, b] == [255; 3];
                    is_kept = hides && !painter.has_image[vertex] && !is_bare;
                    if !hides {
                        let of_own = cache.table.of([r, g, b, 255]);
                        (0..3).for_each(|k| light[k] *= of_own[k]);
                    }
                }
                let [r, g, b, opacity] = pixel_of(light);
                match (own, opacity > 0 && !is_kept) {
                    (Some(own), true) => own.put_bytes([r, g, b], &mut records[at..]),
                    (Some(_), false) => {}
                    (None, true) => records.extend([r, g, b]),
                    (None, false) => records.extend(NONE),
                }
            }
            writer.write_vertices(&records)?;
            next += n as u64;
        }
        first = end;
    }
    let Some(mut writer) = writer else { return Ok(coloured) };
    let mut faces = FaceBlock::default();
    for index in 0..source.n_face_blocks() {
        means.progress.check()?;
        source.read_faces(index, &mut faces)?;
        writer.write_faces(&faces.triangles)?;
    }
    writer.finish()?;
    coloured.losses.merge(palette.losses());
    coloured.losses.merge(&cache.losses());
    Ok(coloured)
}

#[derive(Default)]
struct Counted {
    n_triangles: u64,
    n_degenerate: u64,
    n_bad: u64,
}

/// Sums of the vertices from `first` on.
struct Painter<'a> {
    cache: &'a ImageCache<'a>,
    palette: &'a Palette,
    first: u64,
    means: Means<'a>,
    sums: Vec<Light>,
    /// Vertices that have seen an image, which hides everything else at them where `hides`.
    has_image: Vec<bool>,
    hides: bool,
}

impl Painter<'_> {
    /// Adds what every corner of a vertex of the window shows, in the order of the faces.
    fn paint(&mut self, source: &MeshSource) -> Result<Counted> {
        let mut counted = Counted::default();
        let (mut faces, mut looks) = (FaceBlock::default(), FaceLooks::default());
        let (mut places, mut spots, mut lights) = (Vec::new(), Vec::new(), Vec::new());
        let Means { threads, progress, .. } = self.means;
        for index in 0..source.n_face_blocks() {
            progress.check()?;
            source.read_faces_with_looks(index, &mut faces, &mut looks)?;
            counted.n_triangles += faces.triangles.len() as u64;
            counted.n_degenerate += faces.n_degenerate;
            counted.n_bad += faces.n_bad;
            places.clear();
            spots.clear();
            lights.clear();
            for (t, corners) in faces.triangles.iter().enumerate() {
                let Some((uv, material)) = looks.of(t) else { continue };
                let Some(paint) = self.palette.paints.get(material as usize) else { continue };
                let uv_box = UvBox::of(uv);
                let within = uv_box.within_one();
                for k in 0..3 {
                    if let Some(place) = self.place(corners[k]) {
                        places.push(place);
                        spots.push(Spot {
                            material,
                            uv: uv_box.inside(uv[k]),
                            within,
                            apart: apart(uv, k),
                        });
                        lights.push(times_opacity(paint.factor));
                    }
                }
            }
            multiply(&mut lights, &spots, (self.palette, self.cache), threads, progress)?;
            for ((&place, light), spot) in places.iter().zip(&lights).zip(&spots) {
                let sum: &mut Light = &mut self.sums[place];
                if self.hides {
                    let paint = &self.palette.paints[spot.material as usize];
                    match (paint.base.is_some(), self.has_image[place]) {
                        (false, true) => continue,
                        (true, false) => (*sum, self.has_image[place]) = ([0.0; 4], true),
                        _ => {}
                    }
                }
                *sum = std::array::from_fn(|i| sum[i] + light[i]);
            }
            progress.add(faces.triangles.len() as u64);
        }
        Ok(counted)
    }

    fn place(&self, vertex: u64) -> Option<usize> {
        let place = vertex.checked_sub(self.first)? as usize;
        (place < self.sums.len()).then_some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_system::disk::Disk;
    use stonecut_system::progress::Progress;

    #[test]
    fn windows_of_vertices_do_not_show() {
        let folder = tempfile::tempdir().unwrap();
        let ply = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\nproperty float x\n\
            property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\n\
            property list uchar float texcoord\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n\
            3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 1 1 0 1\n";
        std::fs::write(folder.path().join("in.ply"), ply).unwrap();
        let pixel = |x: u32, y: u32| image::Rgb([40 * x as u8, 60 * y as u8, 7]);
        image::RgbImage::from_fn(4, 4, pixel).save(folder.path().join("t.png")).unwrap();
        let source = MeshSource::open(&folder.path().join("in.ply")).unwrap();
        assert!(colours_vertices(&source));
        let (disk, progress) = (Disk::default(), Progress::default());
        let coloured = |window: u64| {
            let means = Means {
                memory_bytes: 1 << 30,
                threads: 1,
                temp_dir: folder.path(),
                disk: &disk,
                progress: &progress,
            };
            let to = folder.path().join("out.ply");
            let palette = Palette::new(source.materials().map(Arc::as_ref), Purpose::View);
            let cache = ImageCache::new(&palette, 1 << 30);
            let found = in_windows(&source, &to, means, (&palette, &cache), window).unwrap();
            assert_eq!(found, Coloured::default());
            std::fs::read(&to).unwrap()
        };
        let whole = coloured(100);
        // Two faces of 13 bytes, before them the last vertex.
        let last = &whole[whole.len() - 26 - 3..][..3];
        assert_eq!(last[2], 7, "{last:?}");
        (1..5).for_each(|window| assert_eq!(coloured(window), whole, "{window} at a time"));
    }
}
