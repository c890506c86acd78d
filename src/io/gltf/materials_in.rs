//! Materials and images of a glTF file as `io::materials` describes them.

use super::buffers::{Buffers, Inline, path_of};
use super::json::{self, Document, TextureInfo, Transform};
use crate::materials::{
    Alpha, Image, ImageData, Map, MapKind, Material, Materials, Part, Search, all_missing,
};
use crate::ply::raw::RawFile;
use stonecut_mesh::oklab::srgb_of_linear;
use stonecut_system::disk::folder_of;
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Texture coordinates of a material: their set, and their way to those of the image.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Coordinates {
    pub(super) set: u32,
    /// Rows of a matrix, and an offset.
    rows: [[f64; 2]; 2],
    offset: [f64; 2],
}

impl Coordinates {
    fn of(info: Option<&TextureInfo>) -> Coordinates {
        let transform = info.and_then(|info| info.extensions.transform.clone()).unwrap_or_default();
        let Transform { offset, rotation, scale, tex_coord } = transform;
        let ([x, y], angle) = (scale.unwrap_or([1.0; 2]), rotation.unwrap_or(0.0));
        let (sin, cos) = if angle == 0.0 { (0.0, 1.0) } else { angle.sin_cos() };
        Coordinates {
            set: tex_coord.or(info.map(|info| info.tex_coord)).unwrap_or(0),
            rows: [[cos * x, sin * y], [-sin * x, cos * y]],
            offset: offset.unwrap_or_default(),
        }
    }

    /// The first set as it is.
    pub(super) fn plain() -> Coordinates {
        Coordinates::of(None)
    }

    /// Options of a material library that lead to these coordinates from others (`-s`, `-o`), empty where both are the same.
    /// `None` if they are of another set, or turned.
    fn options_from(&self, other: &Coordinates) -> Option<String> {
        if self == other {
            return Some(String::new());
        }
        let [[a, b], [c, d]] = other.rows;
        let determinant = a * d - b * c;
        // The rows of one times the inverse of the other's.
        let rows = self.rows.map(|[x, y]| [x * d - y * c, y * a - x * b].map(|z| z / determinant));
        let [[s, turned], [also, t]] = rows;
        let is_straight = turned.abs().max(also.abs()) < 1e-9 && (s * t).is_finite();
        let [over, down] = [0, 1].map(|i| self.offset[i] - rows[i][i] * other.offset[i]);
        let up = 1.0 - t - down;
        (self.set == other.set && is_straight && (over * up).is_finite())
            .then(|| format!("-s {s} {t} 1 -o {over} {up} 0"))
    }

    /// Coordinates as all other formats have them, from the bottom up.
    pub(super) fn place(&self, [u, v]: [f64; 2]) -> [f32; 2] {
        let [s, t] = [0, 1].map(|i| self.rows[i][0] * u + self.rows[i][1] * v + self.offset[i]);
        [s as f32, (1.0 - t) as f32]
    }
}

/// Materials of a file, and the coordinates that each uses.
pub(super) fn read(
    file: &RawFile,
    document: &Document,
    buffers: &mut Buffers,
    inline: &Inline,
) -> Result<(Materials, Vec<Coordinates>)> {
    let mut out = Materials::default();
    let mut search = Search::new("image", &[folder_of(file.path())]);
    for (number, image) in document.images.iter().enumerate() {
        let mut read = image_of(file, image, (number, inline.image(number)), buffers)?;
        if let ImageData::File(path) = &mut read.data
            && image.uri.is_some()
            && !path.is_file()
        {
            let found = search.find(read.name.as_bytes());
            *path = if found.is_file() { found } else { std::mem::take(path) };
        }
        // Every image keeps its number, even if two are one file.
        out.images.push(read);
    }
    search.note().into_iter().chain(buffers.note()).for_each(|note| out.note(note));
    let (mut coordinates, mut n_without) = (Vec::new(), 0);
    for material in &document.materials {
        coordinates.push(add(file, document, material, (&mut out, &mut n_without))?);
    }
    if n_without > 0 && !out.has_image(|_| true) {
        out.lose(all_missing(n_without));
    }
    out.name_all();
    Ok((out, coordinates))
}

fn image_of(
    file: &RawFile,
    image: &json::Image,
    (number, inline): (usize, Option<Part>),
    buffers: &mut Buffers,
) -> Result<Image> {
    let fallback = || {
        image
            .name
            .clone()
            .filter(|name| !name.is_empty())
            .unwrap_or_else(|| format!("image_{number}"))
    };
    let nowhere = |name: String| Image { data: ImageData::File(name.clone().into()), name };
    if let Some(part) = inline {
        return Ok(Image { name: fallback(), data: ImageData::Inside(part) });
    }
    Ok(match (&image.uri, image.buffer_view) {
        (Some(uri), _) => match path_of(file, uri) {
            Some(path) => Image { name: uri.clone(), data: ImageData::File(path) },
            None => nowhere(uri.clone()),
        },
        (None, Some(view)) => {
            Image { name: fallback(), data: ImageData::Inside(buffers.view(view)?) }
        }
        (None, None) => nowhere(fallback()),
    })
}

const GLOSS: &str = "KHR_materials_pbrSpecularGlossiness";
const UNLIT: &str = "KHR_materials_unlit";
const STRENGTH: &str = "KHR_materials_emissive_strength";

/// Adds a material; returns the coordinates of its colour image.
fn add(
    file: &RawFile,
    document: &Document,
    material: &json::Material,
    (out, n_without): (&mut Materials, &mut usize),
) -> Result<Coordinates> {
    let surface = &material.pbr_metallic_roughness;
    let mut new = Material {
        name: material.name.clone().unwrap_or_default(),
        base: shown(surface.base_color_factor.unwrap_or([1.0; 4])),
        metallic: Some(surface.metallic_factor.unwrap_or(1.0)),
        roughness: Some(surface.roughness_factor.unwrap_or(1.0)),
        // Without a factor the image of emitted light does not show (Khronos, section 5.19).
        emissive: material
            .emissive_factor
            .or(material.emissive_texture.as_ref().map(|_| [0.0; 3]))
            .map(|light| light.map(shown_channel)),
        two_sided: material.double_sided,
        alpha: match material.alpha_mode.as_deref() {
            Some("BLEND") => Alpha::Blend,
            Some("MASK") => Alpha::Mask(material.alpha_cutoff.unwrap_or(0.5)),
            _ => Alpha::Opaque,
        },
        ..Material::default()
    };
    let mut base = surface.base_color_texture.clone();
    for (name, value) in &material.extensions {
        match name.as_str() {
            UNLIT => new.unlit = true,
            STRENGTH => {
                let strength = value.get("emissiveStrength").and_then(|x| x.as_f64());
                new.emissive_strength = strength.map_or(1.0, |x| x.max(0.0) as f32);
            }
            GLOSS => {
                let part = |key: &str| value.get(key).cloned();
                let from = |key| part(key).and_then(|value| serde_json::from_value(value).ok());
                base = from("diffuseTexture").or(base);
                let factor =
                    part("diffuseFactor").and_then(|value| serde_json::from_value(value).ok());
                new.base = factor.map_or(new.base, shown);
                (new.metallic, new.roughness) = (None, None);
                let what = format!("highlights of {GLOSS}");
                out.lose(Loss::new(LossKind::Materials, what, "not carried"));
            }
            other => {
                let what = format!("material extension {other}");
                out.lose(Loss::new(LossKind::Materials, what, "not carried"));
            }
        }
    }
    // Its value means nothing then (Khronos, section 3.9.4).
    if new.alpha == Alpha::Opaque {
        new.base[3] = 1.0;
    }
    let maps = [
        (MapKind::Base, base.as_ref()),
        (MapKind::MetallicRoughness, surface.metallic_roughness_texture.as_ref()),
        (MapKind::Normal, material.normal_texture.as_ref()),
        (MapKind::Occlusion, material.occlusion_texture.as_ref()),
        (MapKind::Emissive, material.emissive_texture.as_ref()),
    ];
    // Light is what is seen where there is no colour image.
    let seen = [MapKind::Base, MapKind::Emissive].iter().chain(maps.iter().map(|(kind, _)| kind));
    let first = seen.filter_map(|kind| maps.iter().find(|(own, _)| own == kind));
    let first = first.filter_map(|(kind, info)| info.map(|info| (*kind, info))).next();
    let coordinates = Coordinates::of(first.map(|(_, info)| info));
    for (kind, info) in maps {
        let Some(info) = info else { continue };
        let Some(options) = Coordinates::of(Some(info)).options_from(&coordinates) else {
            let (name, first) = (kind.name(), first.map_or("", |(kind, _)| kind.name()));
            let what = format!("{name} with other texture coordinates than the {first}");
            out.lose(Loss::new(LossKind::Images, what, "not carried"));
            // Without its image the factor would hold everywhere.
            match kind {
                MapKind::Emissive => new.emissive = None,
                MapKind::MetallicRoughness => new.metallic = Some(0.0),
                _ => {}
            }
            continue;
        };
        let Some(texture) = document.textures.get(info.index) else {
            return Err(
                file.bad(format!("texture {}, which a material names, does not exist", info.index))
            );
        };
        let extensions = [&texture.extensions.webp, &texture.extensions.basis];
        let better = extensions.into_iter().flatten().find_map(|extension| extension.source);
        // Of this kind nothing is read: the plain image is better.
        let named = texture.extensions.avif.as_ref().and_then(|avif| avif.source);
        let image = better.or(texture.source).or(named);
        let Some(image) = image.filter(|&image| image < out.images.len()) else {
            let loss = Loss::new(LossKind::Images, "texture", "names no image: left out");
            *n_without += 1;
            out.lose(loss.example(format!("number {}", info.index)));
            continue;
        };
        let wrap = texture.sampler.and_then(|sampler| document.samplers.get(sampler));
        let wrap = wrap.map(|s| [s.wrap_s.unwrap_or(REPEAT), s.wrap_t.unwrap_or(REPEAT)]);
        let wrap = wrap.filter(|wrap| *wrap != [REPEAT; 2]);
        let strength = info.scale.or(info.strength).unwrap_or(1.0) as f32;
        new.maps.push(Map { wrap, strength, ..Map::new(kind, image, options) });
    }
    out.list.push(new);
    Ok(coordinates)
}

/// Tiling as it is unless a sampler says otherwise.
const REPEAT: u32 = 10497;

/// A colour as screens show it, from glTF's linear light; opacity stays.
fn shown([r, g, b, opacity]: [f32; 4]) -> [f32; 4] {
    let [r, g, b] = [r, g, b].map(shown_channel);
    [r, g, b, opacity]
}

fn shown_channel(light: f32) -> f32 {
    // Black and white stay exact; what is brighter than white has no other form.
    if light > 0.0 && light < 1.0 { srgb_of_linear(f64::from(light)) as f32 } else { light }
}
