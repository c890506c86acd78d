//! Colours of a mesh: its materials as factors and images, ready for looking up.
//!
//! Images are looked at, not decoded: kind and size from their headers. Decides what cannot be used, and says so.

use super::map_use::MapUse;
use super::paint::{Finish, Paint};
use super::purpose::{BESIDE, Meaning, Purpose, SEEN, SURFACE, meaning};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use stonecut_io::materials::{
    Alpha, EMITTED, ImageData, Map, MapKind, Material, Materials, all_missing, besides_pages,
    look_at_image,
};
use stonecut_mesh::oklab::linear_of_srgb;
use stonecut_system::losses::{Ledger, Loss, LossKind};

/// Bytes of a decoded pixel, with all smaller sizes of the image.
const PIXEL_BYTES: u64 = 4;

/// Materials and images of the original.
pub struct Palette {
    /// Paints in the order of the numbers that faces have.
    pub paints: Vec<Paint>,
    /// Images as the materials number them; `None` for those that cannot be used or are not needed. Behind them those
    /// that are needed in several meanings (with their opacity and without, as colours and as numbers), once more.
    pub images: Vec<Option<Picture>>,
    /// Number of the images without the second ones.
    n_images: usize,
    purpose: Purpose,
    materials: Vec<Material>,
    losses: Ledger,
}

/// An image that can be decoded.
#[derive(Clone)]
pub struct Picture {
    pub data: ImageData,
    pub name: String,
    pub size: [u32; 2],
    pub is_jpeg: bool,
    /// Bytes that it takes beside its own while it is decoded: its file, and what the decoder holds.
    pub decoder_bytes: u64,
    /// True if the opacity of its pixels does not count.
    pub is_opaque: bool,
    /// True if its values are numbers, not colours.
    pub is_plain: bool,
}

impl Picture {
    /// Bytes of the image once it is decoded, with its smaller sizes.
    pub fn bytes(&self) -> u64 {
        image_bytes(self.size)
    }
}

/// Bytes of an image of `size` once it is decoded, with its smaller sizes.
pub fn image_bytes(size: [u32; 2]) -> u64 {
    let [width, height] = size.map(u64::from);
    PIXEL_BYTES * width * height / 3 * 4 + 4096
}

impl Palette {
    /// Looks at all materials and images.
    pub fn new(materials: Option<&Materials>, purpose: Purpose) -> Palette {
        let none = Materials::default();
        let given = materials.unwrap_or(&none);
        // Where light has no place, it is the colour of what has no other.
        let shows_light = purpose.uses(MapKind::Base) && !purpose.uses(MapKind::Emissive);
        let shown = if shows_light { given.shown() } else { Cow::Borrowed(given) };
        let materials = &*shown;
        let mut palette = Palette {
            paints: Vec::new(),
            images: Vec::new(),
            n_images: materials.images.len(),
            purpose,
            materials: materials.list.clone(),
            losses: Ledger::default(),
        };
        palette.look(materials, purpose);
        let places = palette.part_meanings();
        let images = &palette.images;
        let use_of = |material: &Material, kind: MapKind| {
            let map = material.map(kind).filter(|_| purpose.uses(kind))?;
            let picture = images[map.image].as_ref()?;
            let image = places[&(map.image, meaning(material, kind, picture.is_jpeg))];
            Some(MapUse::new(&Map { image, ..map.clone() }, picture.size))
        };
        let strength = emissive_strength(&materials.list);
        let paint = |material: &Material| {
            let of_kind = |&kind: &MapKind| Some((kind, use_of(material, kind)?));
            let others: Vec<_> = BESIDE.iter().filter_map(of_kind).collect();
            let has = |kinds: &[MapKind]| others.iter().any(|(kind, _)| kinds.contains(kind));
            let full = |is_so: bool| if is_so { 1.0 } else { 0.0 };
            // As the writer of glTF has it.
            let is_metal = has(&[MapKind::MetallicRoughness, MapKind::Metallic]);
            let has_light = material.emissive.is_some() || has(&[MapKind::Emissive]);
            let [r, g, b] = if has_light { material.light() } else { [0.0; 3] };
            // The strongest light is white on the pages.
            let [r, g, b, _] = linear([r, g, b, 1.0]);
            let emitted = [r, g, b].map(|x| x * (material.emissive_strength / strength));
            let share = |x: f32| if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 };
            Paint {
                factor: linear(material.base),
                base: use_of(material, MapKind::Base),
                opacity: use_of(material, MapKind::Opacity),
                normal: use_of(material, MapKind::Normal),
                surface: [
                    share(material.roughness.unwrap_or(1.0)),
                    share(material.metallic.unwrap_or(full(is_metal))),
                ],
                emitted,
                others,
                mask: material.alpha.cutoff(),
                unlit: material.unlit,
            }
        };
        let mut paints: Vec<Paint> = materials.list.iter().map(paint).collect();
        // What all share stays with the material, where every viewer treats it as it did.
        let bakes = matches!(purpose, Purpose::Bake(_));
        if bakes && palette.common_base().is_some() {
            paints.iter_mut().for_each(|paint| paint.factor = [1.0; 4]);
        }
        palette.paints = paints;
        if bakes {
            let light = given.light_as_colour().filter(|_| shows_light);
            light.into_iter().for_each(|loss| palette.losses.lose(loss));
            palette.enter_losses();
        }
        palette
    }

    /// Enters what is missing or taken otherwise.
    pub(super) fn lose_all(&mut self, losses: &Ledger) {
        self.losses.merge(losses);
    }

    fn look(&mut self, materials: &Materials, purpose: Purpose) {
        let is_used = |number: usize, counts: &dyn Fn(MapKind) -> bool| {
            let uses = |map: &Map| map.image == number && counts(map.kind);
            materials.list.iter().any(|material| material.maps.iter().any(uses))
        };
        let is_needed = |number: usize| is_used(number, &|kind| purpose.uses(kind));
        let is_seen =
            |number: usize| is_used(number, &|kind| SEEN.contains(&kind) && purpose.uses(kind));
        for (number, image) in materials.images.iter().enumerate() {
            let name = match &image.data {
                ImageData::File(path) => path.display().to_string(),
                ImageData::Inside(_) => image.name.clone(),
            };
            if !is_needed(number) {
                self.images.push(None);
                // The output is without it either way, but the file is missed.
                if let (Purpose::Bake(_), Err(fault)) = (purpose, look_at_image(&image.data)) {
                    self.losses.lose(Loss::new(LossKind::Images, "image", fault).example(name));
                }
                continue;
            }
            let mut doubt = None;
            let found = look_at_image(&image.data).and_then(|facts| {
                doubt.clone_from(&facts.fault);
                let size = facts.size.ok_or_else(|| "has no size in its header".to_owned())?;
                Ok((size, facts))
            });
            let picture = match found {
                Ok((size, facts)) if facts.is_too_large => {
                    let [width, height] = size;
                    Err(format!("is not used: its header says {width} x {height} pixels"))
                }
                Ok((size, facts)) => Ok(Picture {
                    data: image.data.clone(),
                    name: name.clone(),
                    size,
                    is_jpeg: facts.ending == "jpg",
                    decoder_bytes: 2 * facts.n_bytes
                        + u64::from(size[0]) * u64::from(size[1]) * facts.decoder_pixel_bytes,
                    is_opaque: false,
                    is_plain: false,
                }),
                Err(fault) => Err(fault),
            };
            match picture {
                Ok(picture) => {
                    self.images.push(Some(picture));
                    if let Some(fault) = doubt {
                        let loss =
                            Loss::new(LossKind::Images, "image", format!("is doubtful: {fault}"));
                        self.losses.lose(loss.example(name));
                    }
                }
                Err(fault) => self.lose_image(&name, &fault, is_seen(number)),
            }
        }
        // Without colours a mesh is not what it was, whatever other images are there.
        let mut needed: Vec<usize> = (0..self.images.len()).filter(|&n| is_needed(n)).collect();
        if needed.iter().any(|&number| is_seen(number)) {
            needed.retain(|&number| is_seen(number));
        }
        if !needed.is_empty() && needed.iter().all(|&number| self.images[number].is_none()) {
            self.losses.lose(all_missing(needed.len()));
        }
    }

    /// Takes the next image as one that cannot be used.
    fn lose_image(&mut self, name: &str, fault: &str, is_seen: bool) {
        self.images.push(None);
        let what = if is_seen { "colour stands" } else { "values stand" };
        let reason = format!("{fault}: its material's {what} for it");
        let loss = Loss::new(LossKind::Images, "image", reason).example(name);
        self.losses.lose(loss);
    }

    /// Gives every image its meaning, and a second place where it has another one besides; returns the places.
    fn part_meanings(&mut self) -> BTreeMap<(usize, Meaning), usize> {
        let mut meanings = BTreeSet::new();
        for material in &self.materials {
            for map in material.maps.iter().filter(|map| self.purpose.uses(map.kind)) {
                if let Some(picture) = &self.images[map.image] {
                    meanings.insert((map.image, meaning(material, map.kind, picture.is_jpeg)));
                }
            }
        }
        let (mut places, mut last) = (BTreeMap::new(), None);
        for (image, meaning) in meanings {
            let Some(picture) = self.images[image].as_mut() else { continue };
            let Meaning { is_opaque, is_plain } = meaning;
            let mut place = image;
            if last == Some(image) {
                let second = Picture { is_opaque, is_plain, ..picture.clone() };
                place = self.images.len();
                self.images.push(Some(second));
            } else {
                (picture.is_opaque, picture.is_plain) = (is_opaque, is_plain);
            }
            places.insert((image, meaning), place);
            last = Some(image);
        }
        places
    }

    /// Enters what of the materials has no place on the pages.
    fn enter_losses(&mut self) {
        let is_mixed = |of: fn(&Material) -> Option<f32>| {
            self.materials.windows(2).any(|pair| of(&pair[0]) != of(&pair[1]))
        };
        let beside = self.purpose.beside();
        let is_mixed_metal = is_mixed(|m| m.metallic) || is_mixed(|m| m.roughness);
        let differ = [
            ("metal and roughness", is_mixed_metal && !beside.surface),
            ("cut-off of opacity", is_mixed(|m| m.alpha.cutoff()) && self.common_mask().is_none()),
            ("independence of light", is_mixed(|m| m.unlit.then_some(1.0))),
        ];
        let mut lost: BTreeMap<String, (u64, String)> = BTreeMap::new();
        for (what, _) in differ.iter().filter(|(_, differs)| *differs) {
            lost.insert(
                format!("{what} that differ from material to material"),
                (1, String::new()),
            );
        }
        for material in &self.materials {
            let maps = material.maps.iter().map(|map| map.kind);
            let maps = maps.filter(|kind| !self.purpose.uses(*kind));
            let names = maps.map(|kind| kind.name().to_owned());
            let others = besides_pages(material);
            let others = others.into_iter().filter(|what| !beside.surface || what != EMITTED);
            for what in names.chain(others) {
                let first = || (0, format!("material '{}'", material.name));
                lost.entry(what).or_insert_with(first).0 += 1;
            }
        }
        for (what, (n, first)) in lost {
            self.losses
                .lose(Loss::new(LossKind::Materials, what, "not baked").count(n).example(first));
        }
    }

    /// Missing, damaged and lost parts.
    pub fn losses(&self) -> &Ledger {
        &self.losses
    }

    /// Pixels of all images, each counted once.
    pub fn n_pixels(&self) -> u64 {
        let pixels = |picture: &Picture| u64::from(picture.size[0]) * u64::from(picture.size[1]);
        self.images[..self.n_images].iter().flatten().map(pixels).sum()
    }

    /// Pixels of images that are normal maps and no JPEG, each counted once.
    pub fn n_plain_pixels(&self) -> u64 {
        let used: BTreeSet<usize> =
            self.paints.iter().filter_map(|paint| Some(paint.normal.as_ref()?.image)).collect();
        let pictures = used.into_iter().filter_map(|image| self.images[image].as_ref());
        let pixels = |picture: &Picture| u64::from(picture.size[0]) * u64::from(picture.size[1]);
        pictures.filter(|picture| !picture.is_jpeg).map(pixels).sum()
    }

    /// Bytes of each image once it is decoded.
    pub fn decoded_bytes(&self) -> Vec<u64> {
        self.images.iter().flatten().map(Picture::bytes).collect()
    }

    /// Bytes that the decoder of an image takes beside it, at most.
    pub fn decoder_bytes(&self) -> u64 {
        self.images.iter().flatten().map(|picture| picture.decoder_bytes).max().unwrap_or(0)
    }

    /// Memory for images without which none can be looked up: the largest, and its decoder.
    pub fn largest_bytes(&self) -> u64 {
        self.decoded_bytes().into_iter().max().unwrap_or(0) + self.decoder_bytes()
    }

    /// Memory for images without which no picture can be drawn: all of one material, and a decoder.
    pub fn material_bytes(&self) -> u64 {
        let bytes_of = |paint: &Paint| {
            let images: BTreeSet<usize> = paint.maps().map(|map| map.image).collect();
            images.into_iter().filter_map(|i| Some(self.images[i].as_ref()?.bytes())).sum::<u64>()
        };
        self.paints.iter().map(bytes_of).max().unwrap_or(0) + self.decoder_bytes()
    }

    /// True if any material has a normal map that is of use.
    pub fn has_normal_maps(&self) -> bool {
        self.paints.iter().any(|paint| paint.normal.is_some())
    }

    /// True if any image can be used.
    pub fn has_images(&self) -> bool {
        self.images.iter().any(Option::is_some)
    }

    /// True if there are images of these kinds, all photographs in the way of JPEG.
    pub fn is_photographic(&self, kinds: &[MapKind]) -> bool {
        let is_jpeg = |map: &MapUse| self.images[map.image].as_ref().is_some_and(|p| p.is_jpeg);
        let all = |paint: &Paint| kinds.iter().filter_map(|&kind| paint.map(kind)).all(is_jpeg);
        self.has_any(kinds) && self.paints.iter().all(all)
    }

    /// True if any material has an image of one of these kinds.
    fn has_any(&self, kinds: &[MapKind]) -> bool {
        self.paints.iter().any(|paint| kinds.iter().any(|&kind| paint.map(kind).is_some()))
    }

    /// True if pages of emitted light are wanted: materials have images of it, or differ in it.
    pub fn has_emission(&self) -> bool {
        let differs = self.paints.windows(2).any(|pair| pair[0].emitted != pair[1].emitted);
        self.purpose.beside().surface && (differs || self.has_any(&[MapKind::Emissive]))
    }

    /// True if pages of roughness, metal and shade are wanted.
    pub fn has_surface(&self) -> bool {
        let differs = self.paints.windows(2).any(|pair| pair[0].surface != pair[1].surface);
        self.purpose.beside().surface && (differs || self.has_any(&SURFACE))
    }

    /// True if any material has an image of ambient shade that is of use.
    pub fn has_occlusion(&self) -> bool {
        self.has_any(&[MapKind::Occlusion])
    }

    /// Colour and opacity of all materials, if they are the same and every one has an image.
    fn common_base(&self) -> Option<[f32; 4]> {
        let first = self.materials.first()?.base;
        let has_image = |material: &Material| {
            let map = material.maps.iter().find(|map| map.kind == MapKind::Base);
            map.is_some_and(|map| self.images[map.image].is_some())
        };
        let is_same = |material: &Material| material.base == first && has_image(material);
        self.materials.iter().all(is_same).then_some(first)
    }

    /// True if a share of the light passes where a material is not opaque: it has no mask, or not the one of all masks.
    pub fn blends(&self, material: u32) -> bool {
        let own = self.materials.get(material as usize).and_then(|own| own.alpha.cutoff());
        own.is_none() || own != self.mask_of_masks()
    }

    /// The value from which on all materials with a mask are opaque, if it is the same.
    fn mask_of_masks(&self) -> Option<f32> {
        let mut all = self.materials.iter().filter_map(|material| material.alpha.cutoff());
        let first = all.next()?;
        all.all(|cutoff| cutoff == first).then_some(first)
    }

    /// The same where all materials that are not opaque anyway have a mask.
    pub fn common_mask(&self) -> Option<f32> {
        let mut all = self.materials.iter().filter(|material| material.alpha != Alpha::Opaque);
        let first = all.next()?.alpha.cutoff()?;
        all.all(|material| material.alpha.cutoff() == Some(first)).then_some(first)
    }

    /// Look of the pages, whose texels let light through (`has_alpha`), some of them a share of it (`blends`).
    pub fn finish(&self, has_alpha: bool, blends: bool) -> Finish {
        fn same<T: PartialEq + Copy>(mut all: impl Iterator<Item = Option<T>>) -> Option<T> {
            let first = all.next()??;
            all.all(|x| x == Some(first)).then_some(first)
        }
        let list = &self.materials;
        let base = self.common_base().unwrap_or([1.0; 4]);
        let is_clear = has_alpha || base[3] < 1.0;
        Finish {
            base,
            mask: self.mask_of_masks().filter(|_| is_clear),
            blends: blends || (base[3] < 1.0 && self.common_mask().is_none()),
            two_sided: list.iter().any(|material| material.two_sided),
            unlit: !list.is_empty() && list.iter().all(|material| material.unlit),
            metallic: match self.has_surface() {
                true => Some(1.0),
                false => same(list.iter().map(|material| material.metallic)),
            },
            roughness: match self.has_surface() {
                true => Some(1.0),
                false => same(list.iter().map(|material| material.roughness)),
            },
            emissive: match self.has_emission() {
                true => Some([1.0; 3]),
                false => same(list.iter().map(|material| material.emissive))
                    .filter(|light| self.purpose.beside().surface && *light != [0.0; 3]),
            },
            emissive_strength: emissive_strength(list),
        }
    }
}

/// The largest strength of the light that materials emit.
fn emissive_strength(list: &[Material]) -> f32 {
    let emits = |material: &&Material| material.light() != [0.0; 3];
    let all = list.iter().filter(emits).map(|material| material.emissive_strength);
    all.filter(|strength| *strength > 0.0).reduce(f32::max).unwrap_or(1.0)
}

/// A material's colour in linear light.
fn linear(base: [f32; 4]) -> [f32; 4] {
    let [r, g, b, opacity] = base.map(|x| if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 });
    let [r, g, b] = [r, g, b].map(|x| linear_of_srgb(f64::from(x)) as f32);
    [r, g, b, opacity]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::WantedMaps;
    use std::sync::Arc;
    use stonecut_io::materials::{Image, Part};
    use stonecut_io::ply::raw::RawFile;

    #[test]
    fn masks_are_kept_beside_materials_that_are_opaque_or_blend() {
        let masks = |list: &[Alpha]| {
            let mut materials = Materials::default();
            let material = |alpha: &Alpha| Material { alpha: *alpha, ..Material::default() };
            materials.list = list.iter().map(material).collect();
            let palette = Palette::new(Some(&materials), Purpose::Bake(WantedMaps::default()));
            let blends: Vec<bool> = (0..list.len() as u32).map(|i| palette.blends(i)).collect();
            (palette.finish(true, false).mask, blends)
        };
        assert_eq!(masks(&[Alpha::Opaque, Alpha::Mask(0.4)]), (Some(0.4), vec![true, false]));
        assert_eq!(masks(&[Alpha::Mask(0.5), Alpha::Mask(0.4)]), (None, vec![true, true]));
        assert_eq!(masks(&[Alpha::Blend, Alpha::Mask(0.4)]), (Some(0.4), vec![true, false]));
    }

    /// A glTF material without `alphaMode` and one with a mask share an image with opacity.
    #[test]
    fn an_image_of_opaque_and_of_clear_materials_is_there_twice() {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbaImage::from_pixel(4, 2, image::Rgba([200, 40, 0, 0]));
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        let n_bytes = bytes.get_ref().len() as u64;
        let file = Arc::new(RawFile::from_bytes("image", bytes.into_inner()));
        let data = ImageData::Inside(Part { file, offset: 0, n_bytes });
        let mut materials = Materials::default();
        materials.add_image(Image { name: "image".to_owned(), data });
        let material = |alpha: Alpha| {
            let options = String::new();
            let map = Map::new(MapKind::Base, 0, options);
            Material { alpha, maps: vec![map], ..Material::default() }
        };
        let images = |list: &[Alpha]| {
            let mut materials = materials.clone();
            materials.list = list.iter().map(|alpha| material(*alpha)).collect();
            let palette = Palette::new(Some(&materials), Purpose::Bake(WantedMaps::default()));
            assert_eq!(palette.n_pixels(), 8);
            let numbers = palette.paints.iter().map(|paint| paint.base.as_ref().unwrap().image);
            let opaque = palette.images.iter().flatten().map(|picture| picture.is_opaque);
            (numbers.collect::<Vec<_>>(), opaque.collect::<Vec<_>>())
        };
        assert_eq!(images(&[Alpha::Opaque, Alpha::Opaque]), (vec![0, 0], vec![true]));
        assert_eq!(images(&[Alpha::Plain, Alpha::Blend]), (vec![0, 0], vec![false]));
        let mixed = [Alpha::Opaque, Alpha::Mask(0.5), Alpha::Opaque];
        assert_eq!(images(&mixed), (vec![1, 0, 1], vec![false, true]));
    }
}
