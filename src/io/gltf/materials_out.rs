//! Materials and images of a GLB file that is written.

use crate::materials::{Alpha, CLAMP_TO_EDGE, Map, MapKind, Material, Reference, TexturePlan};
use serde_json::{Map as Object, Value, json};
use stonecut_mesh::oklab::linear_of_srgb;

/// Materials that faces use, images that the file holds or names, and their places in its lists.
pub(super) struct OutImages {
    /// Numbers of the materials, in order.
    used: Vec<u32>,
    /// Place in the list of the file for each image of the plan.
    places: Vec<Option<usize>>,
    /// Images that the file holds, and their bytes.
    embedded: Vec<(usize, u64)>,
}

impl OutImages {
    /// `used` are the numbers of the materials that faces have, in order.
    pub(super) fn new(plan: &TexturePlan, used: Vec<u32>) -> OutImages {
        let mut is_out = vec![false; plan.references.len()];
        let materials = used.iter().map(|&number| &plan.materials.list[number as usize]);
        for map in materials.flat_map(|material| &material.maps).filter(|map| is_held(map.kind)) {
            is_out[map.image] = plan.references[map.image] != Reference::None;
        }
        let (mut places, mut embedded, mut n) = (Vec::new(), Vec::new(), 0);
        for (number, (reference, &is_out)) in plan.references.iter().zip(&is_out).enumerate() {
            if let (Reference::Embedded(_, n_bytes), true) = (reference, is_out) {
                embedded.push((number, *n_bytes));
            }
            places.push(is_out.then_some(n));
            n += usize::from(is_out);
        }
        OutImages { used, places, embedded }
    }

    /// The place of a material in the list of the file.
    pub(super) fn place_of(&self, material: u32) -> Option<usize> {
        self.used.binary_search(&material).ok()
    }

    /// Numbers of the images that the file holds, and their bytes.
    pub(super) fn embedded(&self) -> &[(usize, u64)] {
        &self.embedded
    }

    pub(super) fn padded_bytes(&self) -> impl Iterator<Item = u64> {
        self.embedded.iter().map(|(_, n_bytes)| n_bytes.next_multiple_of(4))
    }

    /// Their views of the buffer from byte `at`.
    pub(super) fn views(&self, mut at: u64) -> Vec<Value> {
        let view = |(_, n_bytes): &(usize, u64)| {
            let view = json!({ "buffer": 0, "byteOffset": at, "byteLength": n_bytes });
            at += n_bytes.next_multiple_of(4);
            view
        };
        self.embedded.iter().map(view).collect()
    }

    /// The list of images; the last of `n_views` views are theirs.
    pub(super) fn list(&self, plan: &TexturePlan, n_views: usize) -> Vec<Value> {
        let mut view = n_views - self.embedded.len();
        let mut out = Vec::new();
        let images = plan.materials.images.iter().zip(&self.places);
        for (reference, (image, place)) in plan.references.iter().zip(images) {
            match reference {
                _ if place.is_none() => {}
                Reference::Embedded(mime, _) => {
                    let base = image.name.rsplit(['/', '\\']).next().unwrap_or_default();
                    let name = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
                    out.push(json!({ "bufferView": view, "mimeType": mime, "name": name }));
                    view += 1;
                }
                Reference::Path(path) => out.push(json!({ "uri": encoded(path) })),
                Reference::None => {}
            }
        }
        out
    }
}

/// Kinds of images that glTF has a place for.
fn is_held(kind: MapKind) -> bool {
    use MapKind::{Base, Emissive, MetallicRoughness, Normal, Occlusion};
    matches!(kind, Base | Emissive | MetallicRoughness | Normal | Occlusion)
}

/// A path as part of an address: all but plain letters, digits and a few signs by number.
fn encoded(path: &str) -> String {
    let mut out = String::new();
    for byte in path.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' | b'~' => {
                out.push(byte as char);
            }
            _ => out.push_str(&format!("%{byte:02X}")),
        }
    }
    out
}

/// Lists of the file.
#[derive(Default)]
pub(super) struct Lists {
    pub(super) materials: Vec<Value>,
    pub(super) textures: Vec<Value>,
    pub(super) samplers: Vec<Value>,
    pub(super) extensions: Vec<&'static str>,
}

const UNLIT: &str = "KHR_materials_unlit";
const STRENGTH: &str = "KHR_materials_emissive_strength";
pub(super) const WEBP: &str = "EXT_texture_webp";
pub(super) const BASIS: &str = "KHR_texture_basisu";
const TRANSFORM: &str = "KHR_texture_transform";

/// Material, texture and sampler objects (Khronos, sections 3.9 and 5).
pub(super) fn materials(plan: &TexturePlan, images: &OutImages) -> Lists {
    let mut lists = Lists::default();
    for &number in &images.used {
        let material = &plan.materials.list[number as usize];
        let value = lists.material(material, plan, images);
        lists.materials.push(value);
    }
    lists
}

impl Lists {
    fn material(&mut self, material: &Material, plan: &TexturePlan, images: &OutImages) -> Value {
        let mut texture =
            |kind: MapKind| material.map(kind).and_then(|map| self.texture(map, plan, images));
        let base_map = texture(MapKind::Base);
        let rough_map = texture(MapKind::MetallicRoughness);
        let others = [
            ("normalTexture", texture(MapKind::Normal)),
            ("occlusionTexture", texture(MapKind::Occlusion)),
            ("emissiveTexture", texture(MapKind::Emissive)),
        ];
        // A scan reflects light evenly; factors of images are 1 unless they say otherwise.
        let metallic = material.metallic.unwrap_or(if rough_map.is_some() { 1.0 } else { 0.0 });
        let mut surface = json!({
            "metallicFactor": metallic.clamp(0.0, 1.0),
            "roughnessFactor": material.roughness.unwrap_or(1.0).clamp(0.0, 1.0),
        });
        let [r, g, b, opacity] = material.base;
        let [r, g, b] = [r, g, b].map(light);
        let base = [r, g, b, opacity.clamp(0.0, 1.0)];
        if base != [1.0; 4] {
            surface["baseColorFactor"] = json!(base);
        }
        for (key, map) in [("baseColorTexture", base_map), ("metallicRoughnessTexture", rough_map)]
        {
            if let Some(map) = map {
                surface[key] = map;
            }
        }
        let mut out = Object::new();
        out.insert("name".to_owned(), material.name.as_str().into());
        out.insert("pbrMetallicRoughness".to_owned(), surface);
        let emits = material.map(MapKind::Emissive).is_some();
        let emissive = material.emissive.unwrap_or(if emits { [1.0; 3] } else { [0.0; 3] });
        if emissive != [0.0; 3] {
            let factor = json!(emissive.map(light));
            out.insert("emissiveFactor".to_owned(), factor);
        }
        for (key, map) in others {
            if let Some(map) = map {
                out.insert(key.to_owned(), map);
            }
        }
        match material.alpha {
            Alpha::Mask(cutoff) => {
                out.insert("alphaMode".to_owned(), "MASK".into());
                out.insert("alphaCutoff".to_owned(), cutoff.into());
            }
            Alpha::Opaque => {}
            // Leaves and grates are drawn without holes otherwise.
            Alpha::Plain if base[3] == 1.0 && !plan.materials.has_clear_base(material) => {}
            Alpha::Blend | Alpha::Plain => {
                out.insert("alphaMode".to_owned(), "BLEND".into());
            }
        }
        if material.two_sided {
            out.insert("doubleSided".to_owned(), true.into());
        }
        let mut extensions = Object::new();
        if material.unlit {
            extensions.insert(UNLIT.to_owned(), json!({}));
            self.extend(UNLIT);
        }
        if emissive != [0.0; 3] && material.emissive_strength != 1.0 {
            let strength = json!({ "emissiveStrength": material.emissive_strength });
            extensions.insert(STRENGTH.to_owned(), strength);
            self.extend(STRENGTH);
        }
        if !extensions.is_empty() {
            out.insert("extensions".to_owned(), Value::Object(extensions));
        }
        Value::Object(out)
    }

    fn extend(&mut self, extension: &'static str) {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
    }

    /// The use of an image, if the file has it.
    fn texture(&mut self, map: &Map, plan: &TexturePlan, images: &OutImages) -> Option<Value> {
        let place = images.places[map.image]?;
        let extension = match plan.references[map.image] {
            Reference::Embedded("image/webp", _) => Some(WEBP),
            Reference::Embedded("image/ktx2", _) => Some(BASIS),
            _ => None,
        };
        let mut texture = match extension {
            Some(name) => {
                self.extend(name);
                json!({ "extensions": { name: { "source": place } } })
            }
            None => json!({ "source": place }),
        };
        let place = map.place();
        let clamped = place.is_clamped.then_some([CLAMP_TO_EDGE; 2]);
        if let Some([s, t]) = clamped.or(map.wrap) {
            let sampler = json!({ "wrapS": s, "wrapT": t });
            texture["sampler"] = found_or_pushed(&mut self.samplers, sampler).into();
        }
        let mut value = json!({ "index": found_or_pushed(&mut self.textures, texture) });
        match map.kind {
            MapKind::Normal if map.strength != 1.0 => value["scale"] = map.strength.into(),
            MapKind::Occlusion if map.strength != 1.0 => value["strength"] = map.strength.into(),
            _ => {}
        }
        let ([u, v], [over, up]) = (place.scale, place.offset);
        if (place.scale, place.offset) != ([1.0; 2], [0.0; 2]) {
            // Coordinates of glTF go downwards from the top.
            let transform = json!({ "offset": [over, 1.0 - v - up], "scale": [u, v] });
            value["extensions"] = json!({ TRANSFORM: transform });
            self.extend(TRANSFORM);
        }
        Some(value)
    }
}

/// glTF's linear light of a channel as screens show it.
fn light(shown: f32) -> f32 {
    let shown = shown.clamp(0.0, 1.0);
    // White stays exact.
    if shown < 1.0 { linear_of_srgb(f64::from(shown)) as f32 } else { shown }
}

/// The place of a value in a list that has each value once. Lists are as long as there are images.
fn found_or_pushed(list: &mut Vec<Value>, value: Value) -> usize {
    // Materials that share an image mostly follow each other.
    let found = list.iter().rposition(|other| *other == value);
    found.unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}
