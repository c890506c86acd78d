//! The JSON of glTF 2.0 (Khronos, section 5) as far as meshes and materials need it.
//!
//! Not the types of `gltf-json`: these round translations to single precision, which a scan in map coordinates does
//! not survive, and refuse files for parts that do not matter here. Nothing is checked here but types.

use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub(super) asset: Asset,
    pub(super) accessors: Vec<Accessor>,
    pub(super) animations: Vec<IgnoredAny>,
    pub(super) cameras: Vec<IgnoredAny>,
    pub(super) buffers: Vec<Buffer>,
    pub(super) buffer_views: Vec<View>,
    pub(super) extensions: DocumentExtensions,
    /// Tilesets of 3D Tiles have it, and an asset too.
    pub(super) geometric_error: Option<IgnoredAny>,
    pub(super) extensions_required: Vec<String>,
    pub(super) extensions_used: Vec<String>,
    pub(super) images: Vec<Image>,
    pub(super) materials: Vec<Material>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) nodes: Vec<Node>,
    pub(super) samplers: Vec<Sampler>,
    pub(super) scene: Option<usize>,
    pub(super) scenes: Vec<Scene>,
    pub(super) skins: Vec<Skeleton>,
    pub(super) textures: Vec<Texture>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct DocumentExtensions {
    #[serde(rename = "CESIUM_RTC")]
    pub(super) rtc: Option<Rtc>,
}

/// The place that all positions count from.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Rtc {
    pub(super) center: [f64; 3],
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Asset {
    pub(super) version: String,
    pub(super) generator: String,
    pub(super) copyright: Option<String>,
    /// Comments that this program has noted, and what others say of the file.
    #[serde(rename = "extras", deserialize_with = "comments_of_extras")]
    pub(super) comments: Vec<String>,
}

/// Comments that are read, at most.
const MAX_COMMENTS: usize = 1000;

/// The texts at `comments`, and others with their keys: author, licence and the like.
fn comments_of_extras<'de, D: serde::Deserializer<'de>>(
    extras: D,
) -> Result<Vec<String>, D::Error> {
    let extras = serde_json::Value::deserialize(extras)?;
    let Some(members) = extras.as_object() else { return Ok(Vec::new()) };
    let texts = members.iter().flat_map(|(key, value)| match (key.as_str(), value) {
        ("comments", texts) => Vec::<String>::deserialize(texts).unwrap_or_default(),
        (key, serde_json::Value::String(text)) => vec![format!("{key}: {text}")],
        (key, value) => vec![format!("{key}: {value}")],
    });
    Ok(texts.take(MAX_COMMENTS).collect())
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Box<Sparse>>,
}

/// Elements of an accessor that differ from its view, or from zeros.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Sparse {
    pub(super) count: u64,
    pub(super) indices: SparsePart,
    pub(super) values: SparsePart,
}

/// Places or values of such elements.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct SparsePart {
    pub(super) buffer_view: usize,
    pub(super) byte_offset: u64,
    /// Of places only.
    pub(super) component_type: u32,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Buffer {
    pub(super) byte_length: u64,
    pub(super) uri: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct View {
    pub(super) buffer: usize,
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
    pub(super) extensions: ViewExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    pub(super) meshopt: Option<Meshopt>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Meshopt {
    pub(super) buffer: usize,
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: u64,
    pub(super) count: u64,
    pub(super) mode: String,
    pub(super) filter: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Image {
    pub(super) name: Option<String>,
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) name: Option<String>,
    pub(super) extras: Option<IgnoredAny>,
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    pub(super) mode: Option<u32>,
    pub(super) targets: Vec<IgnoredAny>,
    pub(super) extras: Option<IgnoredAny>,
    pub(super) extensions: PrimitiveExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<Draco>,
}

/// A compressed primitive: its view, and the number that each attribute has there.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Draco {
    pub(super) buffer_view: usize,
    pub(super) attributes: BTreeMap<String, u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) name: Option<String>,
    pub(super) children: Vec<usize>,
    pub(super) mesh: Option<usize>,
    pub(super) skin: Option<usize>,
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) extensions: NodeExtensions,
    #[serde(deserialize_with = "known_extras")]
    pub(super) extras: NodeExtras,
}

/// Nodes that move vertices, and the accessor of the matrices that undo their places where the mesh was made.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Skeleton {
    pub(super) joints: Vec<usize>,
    pub(super) inverse_bind_matrices: Option<usize>,
}

/// Notes of this program with a node.
#[derive(Debug, Default)]
pub(super) struct NodeExtras {
    /// The offset that was subtracted from all coordinates.
    pub(super) offset: Option<[f64; 3]>,
    /// True if the name is that of a group, and of an object besides, where node and mesh have the same.
    pub(super) is_group: bool,
    pub(super) is_object_too: bool,
    /// True if there is more than these.
    pub(super) has_others: bool,
}

/// The three numbers at `offset`, and the word at `names`; of others only that they are there.
fn known_extras<'de, D: serde::Deserializer<'de>>(extras: D) -> Result<NodeExtras, D::Error> {
    let extras = serde_json::Value::deserialize(extras)?;
    let names = extras.get("names").and_then(serde_json::Value::as_str);
    Ok(NodeExtras {
        offset: extras.get("offset").and_then(|offset| <[f64; 3]>::deserialize(offset).ok()),
        is_group: matches!(names, Some("g" | "o g")),
        is_object_too: names == Some("o g"),
        has_others: match &extras {
            serde_json::Value::Object(members) => {
                members.keys().any(|key| key != "offset" && key != "names")
            }
            other => !other.is_null(),
        },
    })
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instances: Option<Instances>,
}

/// Accessors of translations, rotations and scales, a row of each for every instance.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Instances {
    pub(super) attributes: BTreeMap<String, usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub(super) extras: Option<IgnoredAny>,
    pub(super) nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Sampler {
    pub(super) wrap_s: Option<u32>,
    pub(super) wrap_t: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Texture {
    pub(super) sampler: Option<usize>,
    pub(super) source: Option<usize>,
    pub(super) extensions: TextureExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp")]
    pub(super) webp: Option<Source>,
    #[serde(rename = "KHR_texture_basisu")]
    pub(super) basis: Option<Source>,
    #[serde(rename = "EXT_texture_avif")]
    pub(super) avif: Option<Source>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Source {
    pub(super) source: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Material {
    pub(super) name: Option<String>,
    pub(super) pbr_metallic_roughness: Surface,
    pub(super) normal_texture: Option<TextureInfo>,
    pub(super) occlusion_texture: Option<TextureInfo>,
    pub(super) emissive_texture: Option<TextureInfo>,
    pub(super) emissive_factor: Option<[f32; 3]>,
    pub(super) alpha_mode: Option<String>,
    pub(super) alpha_cutoff: Option<f32>,
    pub(super) double_sided: bool,
    pub(super) extras: Option<IgnoredAny>,
    pub(super) extensions: BTreeMap<String, serde_json::Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Surface {
    pub(super) base_color_factor: Option<[f32; 4]>,
    pub(super) base_color_texture: Option<TextureInfo>,
    pub(super) metallic_factor: Option<f32>,
    pub(super) roughness_factor: Option<f32>,
    pub(super) metallic_roughness_texture: Option<TextureInfo>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct TextureInfo {
    pub(super) index: usize,
    pub(super) tex_coord: u32,
    /// Of directions.
    pub(super) scale: Option<f64>,
    /// Of shade.
    pub(super) strength: Option<f64>,
    pub(super) extensions: InfoExtensions,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct InfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub(super) transform: Option<Transform>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Transform {
    pub(super) offset: Option<[f64; 2]>,
    pub(super) rotation: Option<f64>,
    pub(super) scale: Option<[f64; 2]>,
    pub(super) tex_coord: Option<u32>,
}
