//! The JSON of a GLB file that is written: primitives in one buffer, each with its vertices and its indices.

use super::materials_out::{BASIS, OutImages, WEBP, materials};
use crate::by_material::FaceLabel;
use crate::materials::TexturePlan;
use crate::names::Name;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;

// Numbers that glTF 2.0 gives to types of components, uses of buffers and kinds of primitives.
const I8: u32 = 5120;
const I16: u32 = 5122;
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const TRIANGLES: u32 = 4;

/// Form of positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Positions {
    /// 16 bits an axis, in steps of one size.
    #[default]
    Steps,
    /// Floats from the lower corner of the bounding box.
    Floats,
}

/// Layout of a vertex: bytes, and places of what it has besides x, y, z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct VertexLayout {
    pub(super) n_bytes: u64,
    pub(super) positions: Positions,
    pub(super) colour_at: Option<u64>,
    pub(super) normal_at: Option<u64>,
    pub(super) texture_at: Option<u64>,
    /// Normals and tangents have 16 bits a number where there are tangents.
    pub(super) tangent_at: Option<u64>,
}

/// Faces of one label with their vertices.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Primitive {
    pub(super) label: FaceLabel,
    pub(super) n_vertices: u64,
    pub(super) n_corners: u64,
    /// Bounds of its positions, as they are stored.
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
}

/// Everything besides the primitives.
pub(super) struct Frame<'a> {
    pub(super) generator: String,
    /// Smallest coordinates, and length of a step.
    pub(super) least: [f64; 3],
    pub(super) scale: f64,
    /// Subtracted from the coordinates of the input.
    pub(super) offset: Option<[f64; 3]>,
    pub(super) textures: Option<(&'a TexturePlan, &'a OutImages)>,
    /// Names by the number in labels.
    pub(super) names: &'a [Name],
    /// Comments of the input.
    pub(super) comments: Vec<&'a str>,
}

/// A list of the document as text, which takes less memory than a tree of values.
#[derive(Default)]
struct List {
    items: String,
    n: usize,
}

impl List {
    /// Appends an item; returns its place.
    fn push(&mut self, item: &Value) -> usize {
        self.items.push_str(if self.n > 0 { "," } else { "" });
        // Writing into memory cannot fail.
        let _ = write!(self.items, "{item}");
        self.n += 1;
        self.n - 1
    }

    fn text(&self) -> String {
        format!("[{}]", self.items)
    }
}

/// Bytes of the binary chunk: vertices of all primitives, then their indices, then images, each padded to 4.
pub(super) fn binary_bytes(
    layout: VertexLayout,
    primitives: &[Primitive],
    images: Option<&OutImages>,
) -> u64 {
    let mesh: u64 =
        primitives.iter().map(|p| layout.n_bytes * p.n_vertices + 4 * p.n_corners).sum();
    mesh + images.map_or(0, |images| images.padded_bytes().sum())
}

/// Describes the binary chunk as glTF 2.0 (Khronos, sections 3.6 and 5), in JSON.
///
/// Primitives of a name are one mesh, with its own node; they come one after another.
pub(super) fn describe(layout: VertexLayout, primitives: &[Primitive], frame: &Frame) -> String {
    let images = frame.textures.map(|(_, images)| images);
    let total = binary_bytes(layout, primitives, images);
    let (mut views, mut accessors) = (List::default(), List::default());
    let (mut meshes, mut nodes) = (List::default(), List::default());
    let mut indices_at: u64 = primitives.iter().map(|p| layout.n_bytes * p.n_vertices).sum();
    let normal_component = if layout.tangent_at.is_some() { I16 } else { I8 };
    let mut vertices_at = 0;
    for of_name in primitives.chunk_by(|a, b| a.label.name == b.label.name) {
        let mut parts: Vec<Value> = Vec::new();
        for primitive in of_name {
            let n_vertices = primitive.n_vertices;
            let view = views.push(&json!({
                "buffer": 0, "byteOffset": vertices_at, "byteLength": layout.n_bytes * n_vertices,
                "byteStride": layout.n_bytes, "target": ARRAY_BUFFER,
            }));
            views.push(&json!({
                "buffer": 0, "byteOffset": indices_at, "byteLength": 4 * primitive.n_corners,
                "target": ELEMENT_ARRAY_BUFFER,
            }));
            vertices_at += layout.n_bytes * n_vertices;
            indices_at += 4 * primitive.n_corners;
            let (low, high) = (primitive.low, primitive.high);
            let (component, low, high) = match layout.positions {
                Positions::Steps => {
                    (U16, json!(low.map(|x| x as u16)), json!(high.map(|x| x as u16)))
                }
                Positions::Floats => (F32, json!(low), json!(high)),
            };
            let positions = accessors.push(&json!({
                "bufferView": view, "byteOffset": 0, "count": n_vertices,
                "componentType": component, "type": "VEC3", "min": low, "max": high,
            }));
            let mut attributes = json!({ "POSITION": positions });
            for (name, at, component, kind) in [
                ("COLOR_0", layout.colour_at, U16, "VEC4"),
                ("NORMAL", layout.normal_at, normal_component, "VEC3"),
                ("TEXCOORD_0", layout.texture_at, F32, "VEC2"),
                ("TANGENT", layout.tangent_at, I16, "VEC4"),
            ] {
                let Some(at) = at else { continue };
                let mut accessor = json!({
                    "bufferView": view, "byteOffset": at, "count": n_vertices,
                    "componentType": component, "type": kind,
                });
                if component != F32 {
                    accessor["normalized"] = true.into();
                }
                attributes[name] = accessors.push(&accessor).into();
            }
            let indices = accessors.push(&json!({
                "bufferView": view + 1, "byteOffset": 0, "count": primitive.n_corners,
                "componentType": U32, "type": "SCALAR",
            }));
            let mut part =
                json!({ "attributes": attributes, "indices": indices, "mode": TRIANGLES });
            let place = |material| images.and_then(|images| images.place_of(material));
            if let Some(place) = primitive.label.material.and_then(place) {
                part["material"] = place.into();
            }
            parts.push(part);
        }
        let name = of_name[0].label.name.and_then(|name| frame.names.get(name as usize));
        let mut mesh = json!({ "primitives": parts });
        let mut node = node(layout, frame);
        if let Some(name) = name {
            put_name(name, &mut mesh, &mut node);
        }
        node["mesh"] = meshes.push(&mesh).into();
        nodes.push(&node);
    }
    // Also what allows normals to be bytes.
    let is_quantised = layout.positions == Positions::Steps || layout.normal_at.is_some();
    let mut used = Vec::new();
    if is_quantised {
        used.push("KHR_mesh_quantization");
    }
    let mut required = used.clone();
    let all: Vec<usize> = (0..nodes.n).collect();
    let mut asset = json!({ "version": "2.0", "generator": frame.generator });
    if !frame.comments.is_empty() {
        asset["extras"] = json!({ "comments": frame.comments });
    }
    let mut document = BTreeMap::from([
        ("asset", asset.to_string()),
        ("buffers", json!([{ "byteLength": total }]).to_string()),
        ("accessors", accessors.text()),
        ("meshes", meshes.text()),
        ("nodes", nodes.text()),
        ("scenes", json!([{ "nodes": all }]).to_string()),
        ("scene", "0".to_owned()),
    ]);
    if let Some((plan, images)) = frame.textures {
        let first_image = indices_at;
        images.views(first_image).iter().for_each(|view| {
            views.push(view);
        });
        let list = materials(plan, images);
        // Nothing stands in for these images where they cannot be read.
        required.extend(list.extensions.iter().filter(|name| [WEBP, BASIS].contains(name)));
        used.extend(list.extensions);
        for (key, values) in [
            ("materials", list.materials),
            ("textures", list.textures),
            ("samplers", list.samplers),
            ("images", images.list(plan, views.n)),
        ] {
            if !values.is_empty() {
                document.insert(key, Value::from(values).to_string());
            }
        }
    }
    document.insert("bufferViews", views.text());
    for (key, names) in [("extensionsRequired", required), ("extensionsUsed", used)] {
        if !names.is_empty() {
            document.insert(key, json!(names).to_string());
        }
    }
    let members: Vec<String> =
        document.iter().map(|(key, value)| format!("\"{key}\":{value}")).collect();
    format!("{{{}}}", members.join(","))
}

/// A node that brings positions back to where they were.
fn node(layout: VertexLayout, frame: &Frame) -> Value {
    let mut node = json!({ "translation": frame.least });
    if layout.positions == Positions::Steps {
        let side = frame.scale as f32;
        node["scale"] = json!([side, side, side]);
    }
    if let Some(offset) = frame.offset {
        node["extras"] = json!({ "offset": offset });
    }
    node
}

/// Gives node and mesh the name of object and group; both have one, so that every reader finds it, and the reader here finds
/// which of them is meant.
fn put_name(name: &Name, mesh: &mut Value, node: &mut Value) {
    let (object, group) = (name.object.as_str(), name.group.as_str());
    let (of_node, of_mesh) = match (object, group) {
        ("", group) => (group, group),
        (object, "") => (object, object),
        both => both,
    };
    node["name"] = of_node.into();
    mesh["name"] = of_mesh.into();
    if of_node == of_mesh && !group.is_empty() {
        node["extras"]["names"] = if object.is_empty() { "g" } else { "o g" }.into();
    }
}
