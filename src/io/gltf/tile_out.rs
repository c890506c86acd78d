//! A tile as GLB: few triangles, in memory, with positions on a lattice.
//!
//! Positions are whole steps from the corner of the tile (`KHR_mesh_quantization`), so tiles of one step agree to the
//! bit in what they share. A tile wider than 65,535 steps has them as floats, which hold whole numbers
//! of 24 bits exactly. Colours are linear, as glTF wants them; instead of colours there may be a page, an image within
//! the file. Further properties are attributes with names that begin with `_`.

use super::materials_out::BASIS;
use super::meshopt_out::{OCTAHEDRAL, octahedral, pack_triangles, reorder};
use super::meshopt_vertices::encode_vertices;
use super::tile_scalars::{TileScalar, element};
use crate::materials::CLAMP_TO_EDGE;
use serde_json::{Value, json};

/// Numbers of glTF 2.0 for types of components and uses of buffers.
const I8: u32 = 5120;
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

const MESHOPT: &str = "EXT_meshopt_compression";
const UNLIT: &str = "KHR_materials_unlit";

/// A mesh that becomes a tile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TileMesh {
    /// Positions in whole steps.
    pub positions: Vec<[i32; 3]>,
    /// Normals of length 127.
    pub normals: Vec<[i8; 3]>,
    /// Linear colours; empty without any.
    pub colours: Vec<[u16; 3]>,
    /// Texture coordinates in 65,535ths of the page, from its upper left corner; empty without a page.
    pub coordinates: Vec<[u16; 2]>,
    /// The finite values of each further property, in the order of `TileForm::scalars`.
    pub scalars: Vec<Vec<f64>>,
    /// Corners; every vertex is used.
    pub triangles: Vec<[u32; 3]>,
}

/// Form of the tiles of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileForm<'a> {
    /// Length of a step.
    pub step: f64,
    /// Packs with EXT_meshopt_compression.
    pub packs: bool,
    /// True if z points upwards in the mesh; in glTF y does.
    pub is_z_up: bool,
    /// Further properties of vertices.
    pub scalars: &'a [TileScalar],
    /// The image on the tile; `coordinates` lead into it.
    pub page: Option<TilePage<'a>>,
}

/// An image, and the look of the surface besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TilePage<'a> {
    /// The file of the image.
    pub image: &'a [u8],
    /// Its type, as the web names it.
    pub mime: &'static str,
    /// Linear light and opacity by which the image is multiplied.
    pub factor: [f32; 4],
    /// Opaque from this value on, where opacity is a mask.
    pub mask: Option<f32>,
    /// True if a share of the light passes.
    pub blends: bool,
    /// True if light does not matter.
    pub unlit: bool,
    /// Share of metal.
    pub metallic: f32,
    /// Roughness.
    pub roughness: f32,
}

/// Turns coordinates with z upwards into those of glTF.
const Z_UP: [f64; 16] = [1., 0., 0., 0., 0., 0., -1., 0., 0., 1., 0., 0., 0., 0., 0., 1.];

/// Parts of the binary chunk and their views.
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    /// Bytes that the packed views have when unpacked.
    unpacked: usize,
    packs: bool,
}

impl Binary {
    /// Adds a view of rows; returns its number.
    fn rows<const N: usize>(&mut self, rows: &[[u8; N]]) -> usize {
        let packed = if self.packs { encode_vertices(rows) } else { rows.as_flattened().to_vec() };
        let mut view =
            self.view(&packed, rows.len() * N, json!({ "byteStride": N, "count": rows.len() }));
        view["byteStride"] = N.into();
        view["target"] = ARRAY_BUFFER.into();
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds a view of directions, in rows that end with a byte of 0; returns its number.
    fn directions(&mut self, rows: &[[i8; 3]]) -> usize {
        if !self.packs {
            let plain = |[x, y, z]: &[i8; 3]| [*x as u8, *y as u8, *z as u8, 0];
            return self.rows(&rows.iter().map(plain).collect::<Vec<_>>());
        }
        let view = self.rows(&rows.iter().map(|&row| octahedral(row)).collect::<Vec<_>>());
        self.views[view]["extensions"][MESHOPT]["filter"] = OCTAHEDRAL.into();
        view
    }

    /// Adds a view of triangles; returns its number.
    fn triangles(&mut self, triangles: &[[u32; 3]], n_vertices: usize) -> (usize, u32) {
        let corners = triangles.as_flattened();
        let (stride, component) = if n_vertices < 65_535 { (2, U16) } else { (4, U32) };
        let packed = match self.packs {
            true => pack_triangles(triangles, n_vertices),
            false => corners.iter().flat_map(|c| c.to_le_bytes()[..stride].to_vec()).collect(),
        };
        let packing = json!({ "byteStride": stride, "count": corners.len(), "mode": "TRIANGLES" });
        let mut view = self.view(&packed, corners.len() * stride, packing);
        view["target"] = ELEMENT_ARRAY_BUFFER.into();
        self.views.push(view);
        (self.views.len() - 1, component)
    }

    /// Adds a view of a file as it is; returns its number.
    fn file(&mut self, bytes: &[u8]) -> usize {
        let at = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": bytes.len() }));
        self.views.len() - 1
    }

    fn view(&mut self, packed: &[u8], n_bytes: usize, packing: Value) -> Value {
        let at = self.bytes.len();
        self.bytes.extend_from_slice(packed);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        if !self.packs {
            return json!({ "buffer": 0, "byteOffset": at, "byteLength": n_bytes });
        }
        let mut packing = packing;
        packing["buffer"] = 0.into();
        packing["byteOffset"] = at.into();
        packing["byteLength"] = packed.len().into();
        if packing.get("mode").is_none() {
            packing["mode"] = "ATTRIBUTES".into();
        }
        let place = self.unpacked;
        self.unpacked += n_bytes.next_multiple_of(4);
        json!({
            "buffer": 1, "byteOffset": place, "byteLength": n_bytes,
            "extensions": { MESHOPT: packing },
        })
    }
}

/// Encodes a tile; returns the file, and for each of its vertices the number it had in `mesh`. Panics without a triangle.
pub fn encode_tile(mut mesh: TileMesh, form: TileForm) -> (Vec<u8>, Vec<u32>) {
    let order = reorder(&mut mesh.triangles, mesh.positions.len());
    let n_vertices = order.len();
    let position = |v: &u32| mesh.positions[*v as usize];
    let bound = |start: i32, pick: fn(i32, i32) -> i32| {
        order.iter().map(position).fold([start; 3], |b, p| [0, 1, 2].map(|k| pick(b[k], p[k])))
    };
    let (low, high) = (bound(i32::MAX, i32::min), bound(i32::MIN, i32::max));
    let span = [0, 1, 2].map(|k| i64::from(high[k]) - i64::from(low[k]));
    let is_narrow = span.iter().all(|&x| x <= 65_535);
    let from_corner = |v: &u32| {
        let p = position(v);
        [0, 1, 2].map(|k| (i64::from(p[k]) - i64::from(low[k])) as u32)
    };
    let mut binary =
        Binary { bytes: Vec::new(), views: Vec::new(), unpacked: 0, packs: form.packs };
    let position_view = match is_narrow {
        true => {
            let rows: Vec<[u8; 8]> = order
                .iter()
                .map(|v| {
                    let [x, y, z] = from_corner(v).map(|x| (x as u16).to_le_bytes());
                    [x[0], x[1], y[0], y[1], z[0], z[1], 0, 0]
                })
                .collect();
            binary.rows(&rows)
        }
        false => {
            let row = |v: &u32| -> [u8; 12] {
                let flat = from_corner(v).map(|x| (x as f32).to_le_bytes());
                flat.as_flattened().try_into().expect("three floats")
            };
            binary.rows(&order.iter().map(row).collect::<Vec<_>>())
        }
    };
    let mut accessors = vec![json!({
        "bufferView": position_view, "count": n_vertices, "type": "VEC3",
        "componentType": if is_narrow { U16 } else { F32 }, "min": [0, 0, 0], "max": span,
    })];
    let mut attributes = json!({ "POSITION": 0 });
    if !mesh.normals.is_empty() {
        let of = |v: &u32| mesh.normals[*v as usize];
        let view = binary.directions(&order.iter().map(of).collect::<Vec<_>>());
        attributes["NORMAL"] = accessors.len().into();
        accessors.push(json!({
            "bufferView": view, "count": n_vertices, "type": "VEC3", "componentType": I8,
            "normalized": true,
        }));
    }
    if !mesh.colours.is_empty() {
        let row = |v: &u32| -> [u8; 8] {
            let [r, g, b] = mesh.colours[*v as usize].map(u16::to_le_bytes);
            [r[0], r[1], g[0], g[1], b[0], b[1], 255, 255]
        };
        let view = binary.rows(&order.iter().map(row).collect::<Vec<_>>());
        attributes["COLOR_0"] = accessors.len().into();
        accessors.push(json!({
            "bufferView": view, "count": n_vertices, "type": "VEC4", "componentType": U16,
            "normalized": true,
        }));
    }
    if !mesh.coordinates.is_empty() {
        let row = |v: &u32| -> [u8; 4] {
            let [u, v] = mesh.coordinates[*v as usize].map(u16::to_le_bytes);
            [u[0], u[1], v[0], v[1]]
        };
        let view = binary.rows(&order.iter().map(row).collect::<Vec<_>>());
        attributes["TEXCOORD_0"] = accessors.len().into();
        accessors.push(json!({
            "bufferView": view, "count": n_vertices, "type": "VEC2", "componentType": U16,
            "normalized": true,
        }));
    }
    for (scalar, values) in form.scalars.iter().zip(&mesh.scalars) {
        for part in scalar.parts(values) {
            let value = |v: &u32| part.values[*v as usize];
            let rows: Vec<_> = order.iter().map(|v| element(part.component, value(v))).collect();
            let view = binary.rows(&rows);
            let fold = |start, pick: fn(f64, f64) -> f64| order.iter().map(value).fold(start, pick);
            attributes[&part.attribute] = accessors.len().into();
            accessors.push(json!({
                "bufferView": view, "count": n_vertices, "type": "SCALAR",
                "componentType": part.component, "name": scalar.name,
                "min": [fold(f64::INFINITY, f64::min)], "max": [fold(f64::NEG_INFINITY, f64::max)],
            }));
        }
    }
    let (view, component) = binary.triangles(&mesh.triangles, n_vertices);
    let indices = accessors.len();
    accessors.push(json!({
        "bufferView": view, "count": 3 * mesh.triangles.len(), "type": "SCALAR",
        "componentType": component,
    }));
    let corner = low.map(|x| f64::from(x) * form.step);
    let mut nodes = vec![json!({
        "mesh": 0, "translation": corner, "scale": [form.step, form.step, form.step],
    })];
    if form.is_z_up {
        nodes.push(json!({ "matrix": Z_UP, "children": [0] }));
    }
    let page_view = form.page.map(|page| binary.file(page.image));
    let mut required = vec!["KHR_mesh_quantization"];
    let mut buffers = vec![json!({ "byteLength": binary.bytes.len() })];
    if form.packs {
        required.push(MESHOPT);
        buffers.push(json!({
            "byteLength": binary.unpacked, "extensions": { MESHOPT: { "fallback": true } },
        }));
    }
    let is_basis = form.page.is_some_and(|page| page.mime == "image/ktx2");
    required.extend(is_basis.then_some(BASIS));
    let mut used = required.clone();
    if form.page.is_some_and(|page| page.unlit) {
        used.push(UNLIT);
    }
    let mut document = json!({
        "asset": { "version": "2.0", "generator": concat!("stonecut ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": used,
        "extensionsRequired": required,
        "buffers": buffers,
        "bufferViews": binary.views,
        "accessors": accessors,
        "materials": [material(&form, !mesh.colours.is_empty())],
        "meshes": [{ "primitives": [{
            "attributes": attributes, "indices": indices, "material": 0, "mode": 4,
        }] }],
        "nodes": nodes,
        "scenes": [{ "nodes": [nodes.len() - 1] }],
        "scene": 0,
    });
    if let (Some(page), Some(view)) = (form.page, page_view) {
        document["images"] = json!([{ "bufferView": view, "mimeType": page.mime }]);
        document["samplers"] = json!([{ "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE }]);
        let source = json!({ "source": 0 });
        let mut texture =
            if is_basis { json!({ "extensions": { BASIS: source } }) } else { source };
        texture["sampler"] = 0.into();
        document["textures"] = json!([texture]);
    }
    (glb(&document, &binary.bytes), order)
}

/// The material of a tile: its page, the colours of its vertices, or grey.
fn material(form: &TileForm, has_colours: bool) -> Value {
    let Some(page) = form.page else {
        let grey = if has_colours { 1.0 } else { 0.6 };
        return json!({
            "pbrMetallicRoughness": {
                "baseColorFactor": [grey, grey, grey, 1.0], "metallicFactor": 0.0,
                "roughnessFactor": 0.9,
            },
            "doubleSided": true,
        });
    };
    let mut out = json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": page.factor, "baseColorTexture": { "index": 0 },
            "metallicFactor": page.metallic, "roughnessFactor": page.roughness,
        },
        "doubleSided": true,
    });
    if let Some(from) = page.mask {
        out["alphaMode"] = "MASK".into();
        out["alphaCutoff"] = from.into();
    } else if page.blends {
        out["alphaMode"] = "BLEND".into();
    }
    if page.unlit {
        out["extensions"] = json!({ UNLIT: {} });
    }
    out
}

/// The two chunks of a GLB file (Khronos, section 4.4).
fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 28 + text.len() + binary.len();
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(b"glTF");
    for word in [2, total, text.len()] {
        out.extend_from_slice(&(word as u32).to_le_bytes());
    }
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&text);
    out.extend_from_slice(&(binary.len() as u32).to_le_bytes());
    out.extend_from_slice(b"BIN\0");
    out.extend_from_slice(binary);
    out
}
