//! Reads a tile back that `tile_out` has written, for its checker: every number as it is stored.

use super::json::{Document, Texture, View};
use super::meshopt::decode;
use super::tile_out::TileMesh;
use super::tile_scalars::{TileScalar, join_all, number};
use crate::materials::image_size;
use std::cell::Cell;
use std::collections::BTreeMap;

/// A tile as it lies in its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredTile {
    /// Positions in steps from the origin of the lattice, normals, colours and triangles.
    pub mesh: TileMesh,
    /// Length of a step.
    pub step: f64,
    /// True if the file turns z upwards.
    pub is_z_up: bool,
    /// Its page, if it has one.
    pub page: Option<StoredPage>,
    /// Types of components and values of further attributes by name, one for each vertex.
    attributes: BTreeMap<String, (u32, Vec<f64>)>,
}

/// A page as it lies in the file of its tile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredPage {
    /// Width and height.
    pub size: [u32; 2],
    /// The file of the image.
    pub image: Vec<u8>,
    /// Linear light and opacity by which the image is multiplied.
    pub factor: [f32; 4],
}

impl StoredTile {
    /// Takes the attributes as `mesh.scalars`; the error says how they are not those of `scalars`.
    pub fn take_scalars(&mut self, scalars: &[TileScalar]) -> Result<(), String> {
        self.mesh.scalars = join_all(scalars, std::mem::take(&mut self.attributes))?;
        Ok(())
    }
}

/// The JSON of a tile has some thousand bytes, and some for each attribute.
const MOST_JSON_BYTES: usize = 64 << 10;

/// Bytes of an element while it is read, and of what is kept of it.
const READ_BYTES: u64 = 96;
const KEPT_BYTES: u64 = 24;

/// Decodes a tile; the error says what is wrong with it.
pub fn decode_tile(bytes: &[u8]) -> Result<StoredTile, String> {
    decode_tile_within(bytes, u64::MAX)
}

/// Decodes a tile that takes at most `most_bytes` of memory beside its file; the error says what is wrong with it.
pub fn decode_tile_within(bytes: &[u8], most_bytes: u64) -> Result<StoredTile, String> {
    let (document, binary) = chunks(bytes)?;
    let node = document.nodes.iter().find(|node| node.mesh.is_some()).ok_or("it has no mesh")?;
    let mesh = document.meshes.get(node.mesh.unwrap_or_default()).ok_or("its mesh is missing")?;
    let [primitive] = &mesh.primitives[..] else {
        return Err("its mesh has not one primitive".to_owned());
    };
    let (scale, corner) = (node.scale.ok_or("no scale")?, node.translation.ok_or("no place")?);
    let step = scale[0];
    if !(step > 0.0 && step.is_finite() && scale == [step; 3]) {
        return Err(format!("its scale is {scale:?}"));
    }
    let corner = corner.map(|x| (x / step).round() as i32);
    let kept = Cell::new(0u64);
    let read = |accessor: usize| {
        let count = document.accessors.get(accessor).map_or(0, |accessor| accessor.count);
        kept.set(kept.get().saturating_add(count.saturating_mul(KEPT_BYTES)));
        let left =
            most_bytes.checked_sub(kept.get().saturating_add(count.saturating_mul(READ_BYTES)));
        let left = left.ok_or_else(|| {
            format!(
                "it has {count} elements where one tile of the memory holds {}; give more --memory",
                most_bytes / READ_BYTES
            )
        })?;
        elements(&document, (binary, left), accessor)
    };
    let place = *primitive.attributes.get("POSITION").ok_or("it has no positions")?;
    let (component, rows) = read(place)?;
    let mut out = StoredTile { step, ..StoredTile::default() };
    out.is_z_up = document.nodes.iter().any(|node| node.matrix.is_some());
    for row in &rows {
        let at = |k: usize| match component {
            5123 => i32::from(u16::from_le_bytes([row[2 * k], row[2 * k + 1]])),
            _ => f32::from_le_bytes([row[4 * k], row[4 * k + 1], row[4 * k + 2], row[4 * k + 3]])
                as i32,
        };
        out.mesh.positions.push([0, 1, 2].map(|k| corner[k].saturating_add(at(k))));
    }
    if let Some(&normal) = primitive.attributes.get("NORMAL") {
        out.mesh.normals =
            read(normal)?.1.iter().map(|row| [0, 1, 2].map(|k| row[k] as i8)).collect();
    }
    if let Some(&colour) = primitive.attributes.get("COLOR_0") {
        let of =
            |row: &Vec<u8>| [0, 1, 2].map(|k| u16::from_le_bytes([row[2 * k], row[2 * k + 1]]));
        out.mesh.colours = read(colour)?.1.iter().map(of).collect();
    }
    if let Some(&coordinates) = primitive.attributes.get("TEXCOORD_0") {
        let of = |row: &Vec<u8>| [0, 1].map(|k| u16::from_le_bytes([row[2 * k], row[2 * k + 1]]));
        let (component, rows) = read(coordinates)?;
        if component != 5123 {
            return Err(format!("its texture coordinates are of type {component}"));
        }
        out.mesh.coordinates = rows.iter().map(of).collect();
    }
    out.page = page(&document, binary)?;
    let n = out.mesh.positions.len();
    for (name, &accessor) in primitive.attributes.iter().filter(|(name, _)| name.starts_with('_')) {
        let (component, rows) = read(accessor)?;
        if rows.len() != n {
            return Err(format!("its attribute {name} has {} values for {n} vertices", rows.len()));
        }
        let values = rows.iter().map(|row| number(component, row)).collect::<Result<_, _>>()?;
        out.attributes.insert(name.clone(), (component, values));
    }
    let (component, rows) = read(primitive.indices.ok_or("it has no indices")?)?;
    let corners: Vec<u32> = rows
        .iter()
        .map(|row| match component {
            5123 => u32::from(u16::from_le_bytes([row[0], row[1]])),
            _ => u32::from_le_bytes([row[0], row[1], row[2], row[3]]),
        })
        .collect();
    if let Some(corner) = corners.iter().find(|&&corner| corner as usize >= n) {
        return Err(format!("a triangle names vertex {corner} of {n}"));
    }
    let mesh = &out.mesh;
    let per_vertex = [mesh.normals.len(), mesh.colours.len(), mesh.coordinates.len()];
    if per_vertex.iter().any(|&m| m != 0 && m != n) || !corners.len().is_multiple_of(3) {
        return Err("its parts have different lengths".to_owned());
    }
    out.mesh.triangles = corners.as_chunks().0.to_vec();
    Ok(out)
}

/// The image of the first material; the size is that in the head of its file.
fn page(document: &Document, binary: &[u8]) -> Result<Option<StoredPage>, String> {
    let Some(material) = document.materials.first() else { return Ok(None) };
    let surface = &material.pbr_metallic_roughness;
    let Some(texture) = surface.base_color_texture.as_ref() else { return Ok(None) };
    let texture = document.textures.get(texture.index);
    let basis = |texture: &Texture| texture.extensions.basis.as_ref()?.source;
    let source = texture.and_then(|texture| texture.source.or_else(|| basis(texture)));
    let image = source.and_then(|source| document.images.get(source));
    let view = image
        .and_then(|image| document.buffer_views.get(image.buffer_view?))
        .ok_or("its image is missing")?;
    let start = view.byte_offset as usize;
    let bytes = binary.get(start..start.saturating_add(view.byte_length as usize));
    let bytes = bytes.ok_or("its image lies beyond the file")?;
    let size = image_size(bytes).map_err(|what| format!("its image {what}"))?;
    let factor = surface.base_color_factor.unwrap_or([1.0; 4]);
    Ok(Some(StoredPage { size, image: bytes.to_vec(), factor }))
}

fn chunks(bytes: &[u8]) -> Result<(Document, &[u8]), String> {
    let word = |at: usize| {
        let bytes = bytes.get(at..at + 4).ok_or("it was cut off")?;
        Ok::<usize, String>(u32::from_le_bytes(bytes.try_into().expect("4 bytes")) as usize)
    };
    if bytes.get(..4) != Some(b"glTF") || word(4)? != 2 || word(8)? != bytes.len() {
        return Err("it is not a whole GLB file of version 2".to_owned());
    }
    let n_text = word(12)?;
    let text = bytes.get(20..20 + n_text).ok_or("its JSON was cut off")?;
    if n_text > MOST_JSON_BYTES {
        return Err(format!(
            "its JSON has {n_text} bytes, that of a tile {MOST_JSON_BYTES} at most"
        ));
    }
    let document = serde_json::from_slice(text).map_err(|e| format!("its JSON: {e}"))?;
    let at = 20 + n_text;
    let n_binary = word(at)?;
    let binary = bytes.get(at + 8..at + 8 + n_binary).ok_or("its binary chunk was cut off")?;
    Ok((document, binary))
}

/// The elements of an accessor, and the type of their numbers; a view is unpacked to at most the bytes that are given.
fn elements(
    document: &Document,
    (binary, most_bytes): (&[u8], u64),
    accessor: usize,
) -> Result<(u32, Vec<Vec<u8>>), String> {
    let accessor = document.accessors.get(accessor).ok_or("an accessor is missing")?;
    let view: &View = accessor
        .buffer_view
        .and_then(|view| document.buffer_views.get(view))
        .ok_or("a view is missing")?;
    let size = match accessor.component_type {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        5125 | 5126 => 4,
        other => return Err(format!("components of type {other}")),
    };
    let n_numbers = match accessor.kind.as_str() {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        other => return Err(format!("elements of type {other}")),
    };
    let stride = view.byte_stride.map_or(size * n_numbers, |stride| stride as usize);
    let part = |offset: u64, n_bytes: u64| {
        let (start, n) = (offset as usize, n_bytes as usize);
        binary.get(start..start.saturating_add(n)).ok_or("a view lies beyond the file")
    };
    let unpacked;
    let data = match &view.extensions.meshopt {
        Some(packing) => {
            let n_bytes = packing.count.saturating_mul(packing.byte_stride);
            if n_bytes > most_bytes.min(1 << 30) {
                return Err(format!("a view of {n_bytes} bytes, more than the memory holds"));
            }
            unpacked = decode(packing, part(packing.byte_offset, packing.byte_length)?)?;
            &unpacked[..]
        }
        None => part(view.byte_offset, view.byte_length)?,
    };
    let data = data.get(accessor.byte_offset as usize..).ok_or("an accessor beyond its view")?;
    let count = accessor.count as usize;
    let needed = count.saturating_sub(1).saturating_mul(stride).saturating_add(size * n_numbers);
    if count > 0 && data.len() < needed {
        return Err("an accessor beyond its view".to_owned());
    }
    let rows = data.chunks(stride.max(1)).take(count);
    Ok((accessor.component_type, rows.map(|row| row[..size * n_numbers].to_vec()).collect()))
}

#[cfg(test)]
mod tests {
    use super::super::meshopt_out::octahedral;
    use super::super::tile_out::{TileForm, TilePage, encode_tile};
    use super::*;
    use stonecut_mesh::property::{Property, Scalar};

    type Corner = ([i32; 3], [i8; 3], [u16; 2]);

    fn sorted(mesh: &TileMesh) -> Vec<[Corner; 3]> {
        let corner = |v: u32| {
            let v = v as usize;
            (mesh.positions[v], mesh.normals[v], mesh.coordinates[v])
        };
        let turned = |t: &[u32; 3]| {
            let t = t.map(corner);
            let first = (0..3).min_by_key(|&k| t[k]).unwrap();
            [t[first], t[(first + 1) % 3], t[(first + 2) % 3]]
        };
        let mut out: Vec<_> = mesh.triangles.iter().map(turned).collect();
        out.sort_unstable();
        out
    }

    #[test]
    fn a_tile_comes_back_as_it_was() {
        let mut image = Vec::new();
        let mut encoder = png::Encoder::new(&mut image, 3, 2);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&[7; 18]).unwrap();
        let page = TilePage {
            image: &image,
            mime: "image/png",
            factor: [1.0; 4],
            mask: None,
            blends: false,
            unlit: true,
            metallic: 0.0,
            roughness: 1.0,
        };
        for (n, wide) in [(2, 1), (20, 1), (300, 1), (9, 9000)] {
            let mut mesh = TileMesh::default();
            for i in 0..n * n {
                let (x, y) = (i % n, i / n);
                mesh.positions.push([wide * (x - 5), wide * y, -7 + (x * y) % 5]);
                mesh.normals.push([(x % 100) as i8, -(y % 100) as i8, 127]);
                mesh.colours.push([(i * 7 % 65_536) as u16, 0, 65_535]);
                mesh.coordinates.push([(3 * x) as u16, 65_535 - y as u16]);
            }
            let properties =
                [("quality", Scalar::F32), ("time", Scalar::F64), ("class", Scalar::U8)]
                    .map(|(name, scalar)| Property::new(name, scalar));
            let scalars = TileScalar::list(&properties);
            // The first tells the vertices apart.
            let column = |f: fn(i32) -> f64| (0..n * n).map(f).collect::<Vec<f64>>();
            mesh.scalars = vec![
                column(f64::from),
                column(|i| 1e9 + f64::from(i) / 3.0),
                column(|i| f64::from(i % 256)),
            ];
            for i in 0..(n - 1) * (n - 1) {
                let a = (i / (n - 1) * n + i % (n - 1)) as u32;
                let n = n as u32;
                mesh.triangles.extend([[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]);
            }
            for packs in [false, true] {
                let page = (n == 20).then_some(page);
                let form = TileForm { step: 0.25, packs, is_z_up: packs, scalars: &scalars, page };
                let (bytes, _) = encode_tile(mesh.clone(), form);
                let mut back = decode_tile(&bytes).unwrap();
                assert_eq!((back.step, back.is_z_up), (0.25, packs));
                let mut expected = mesh.clone();
                if packs {
                    // Normals are packed within a degree.
                    let mut rows: Vec<[u8; 4]> =
                        mesh.normals.iter().map(|&n| octahedral(n)).collect();
                    meshopt_rs::vertex::filter::decode_filter_oct_8(&mut rows);
                    for (normal, row) in expected.normals.iter_mut().zip(rows) {
                        let now = [0, 1, 2].map(|k| row[k] as i8);
                        let along = |a: [i8; 3], b: [i8; 3]| -> f64 {
                            (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum()
                        };
                        let size = (along(now, now) * along(*normal, *normal)).sqrt();
                        let angle = (along(now, *normal) / size).min(1.0).acos();
                        assert!(angle.to_degrees() < 1.5, "{normal:?} {now:?}");
                        *normal = now;
                    }
                }
                assert_eq!(sorted(&back.mesh), sorted(&expected), "{n} {packs}");
                let stored = |page: TilePage| StoredPage {
                    size: [3, 2],
                    image: page.image.to_vec(),
                    factor: page.factor,
                };
                assert_eq!(back.page, page.map(stored));
                assert!(back.clone().take_scalars(&scalars[1..]).is_err());
                back.take_scalars(&scalars).unwrap();
                for (now, was) in back.mesh.scalars.iter().zip(&mesh.scalars) {
                    let old = |v: usize| back.mesh.scalars[0][v] as usize;
                    assert!((0..now.len()).all(|v| now[v] == was[old(v)]), "{n} {packs}");
                }
                // Cut off anywhere or with a byte changed it is refused or read, and never panics.
                for cut in (0..bytes.len()).step_by(bytes.len() / 50 + 1) {
                    assert!(decode_tile(&bytes[..cut]).is_err());
                }
            }
        }
    }
}
