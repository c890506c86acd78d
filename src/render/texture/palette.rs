//! Colours of a mesh: its materials as factors and images, ready for looking up.
//!
//! Images are looked at, not decoded: kind and size from their headers. Decides what cannot be used, and says so.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use stonecut_io::materials::{
    Alpha, ImageData, Map, MapKind, Material, Materials, all_missing, besides_pages, look_at_image,
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
    /// that are needed both with their opacity and without, a second time.
    pub images: Vec<Option<Picture>>,
    /// Number of the images without the second ones.
    n_images: usize,
    materials: Vec<Material>,
    losses: Ledger,
}

/// Use of a palette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A new texture: an image that does not fit is refused; what all materials share is left to the new ones.
    Bake,
    /// Pictures: an image that does not fit is a note; normal maps are used, too.
    View,
    /// Pictures without colours: normal maps alone.
    Relief,
}

impl Purpose {
    /// True if images of this kind are looked up.
    fn uses(self, kind: MapKind) -> bool {
        match kind {
            MapKind::Base | MapKind::Opacity => self != Purpose::Relief,
            MapKind::Normal => self != Purpose::Bake,
            _ => false,
        }
    }
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

/// Colour of a material.
#[derive(Clone, Debug)]
pub struct Paint {
    /// Linear light, and opacity.
    pub factor: [f32; 4],
    /// Image of colours.
    pub base: Option<MapUse>,
    /// Image of opacity.
    pub opacity: Option<MapUse>,
    /// Directions in tangent space; only for pictures.
    pub normal: Option<MapUse>,
    /// Opaque from this value on, otherwise not there.
    pub mask: Option<f32>,
    /// True if light does not matter.
    pub unlit: bool,
}

impl Paint {
    /// Its images.
    pub fn maps(&self) -> impl Iterator<Item = &MapUse> {
        [&self.base, &self.opacity, &self.normal].into_iter().flatten()
    }
}

/// An image with the way that coordinates lead to it.
#[derive(Clone, Debug, PartialEq)]
pub struct MapUse {
    /// Index of the image in the palette.
    pub image: usize,
    /// Width and height in pixels.
    pub size: [u32; 2],
    wrap: [Wrap; 2],
    scale: [f64; 2],
    offset: [f64; 2],
    /// Texels of the image for a length of 1 in its coordinates.
    pub texels_per_coordinate: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

impl Wrap {
    /// Tiling as glTF numbers it.
    fn of(number: u32) -> Wrap {
        match number {
            33071 => Wrap::Clamp,
            33648 => Wrap::Mirror,
            _ => Wrap::Repeat,
        }
    }

    /// The texel that stands for number `at` of a side of `n`.
    fn texel(self, at: i64, n: i64) -> usize {
        // Nearly all are, and a division takes longer than all else.
        if (0..n).contains(&at) {
            return at as usize;
        }
        let at = match self {
            Wrap::Repeat => at.rem_euclid(n),
            Wrap::Clamp => at.clamp(0, n - 1),
            Wrap::Mirror => {
                let at = at.rem_euclid(2 * n);
                at.min(2 * n - 1 - at)
            }
        };
        at as usize
    }
}

/// Coordinates that are larger come to nothing in single precision.
const FARTHEST: f64 = 1e7;

impl MapUse {
    fn new(map: &Map, size: [u32; 2]) -> MapUse {
        let place = map.place();
        let wrap = map.wrap.map_or([Wrap::Repeat; 2], |wrap| wrap.map(Wrap::of));
        let wrap = if place.is_clamped { [Wrap::Clamp; 2] } else { wrap };
        MapUse { wrap, ..MapUse::scaled(map.image, size, place.scale, place.offset) }
    }

    /// An image that repeats.
    fn scaled(image: usize, size: [u32; 2], scale: [f64; 2], offset: [f64; 2]) -> MapUse {
        let [width, height] = size.map(f64::from);
        let texels_per_coordinate = (width * height * (scale[0] * scale[1]).abs()).sqrt();
        MapUse { image, size, wrap: [Wrap::Repeat; 2], scale, offset, texels_per_coordinate }
    }

    /// An image that does not repeat, with coordinates from 0 to 1 that lead to all of it.
    pub(super) fn whole(size: [u32; 2]) -> MapUse {
        MapUse { wrap: [Wrap::Clamp; 2], ..MapUse::scaled(0, size, [1.0; 2], [0.0; 2]) }
    }

    /// Place in an image of `size` at coordinates, v upwards: the four texels around it, and shares of the right and
    /// lower ones. `None` where coordinates are not numbers.
    pub fn texels(&self, uv: [f32; 2], size: [u32; 2]) -> Option<([[usize; 2]; 2], [f32; 2])> {
        let uv = [0, 1].map(|k| f64::from(uv[k]) * self.scale[k] + self.offset[k]);
        if !uv.iter().all(|x| x.abs() < FARTHEST) {
            return None;
        }
        let at = [uv[0], 1.0 - uv[1]];
        let at = [0, 1].map(|k| at[k] * f64::from(size[k]) - 0.5);
        let low = at.map(f64::floor);
        let texel = |k: usize, step: i64| {
            self.wrap[k].texel(low[k] as i64 + step, i64::from(size[k].max(1)))
        };
        let share = [0, 1].map(|k| (at[k] - low[k]) as f32);
        Some(([[texel(0, 0), texel(0, 1)], [texel(1, 0), texel(1, 1)]], share))
    }

    /// True if coordinates are numbers that a texel can be found for.
    pub fn leads_to_texels(&self, uv: [f32; 2]) -> bool {
        self.texels(uv, self.size).is_some()
    }

    /// Texels of the image for a length of 1 along each of its coordinates.
    pub fn texels_along(&self) -> [f32; 2] {
        [0, 1].map(|k| (f64::from(self.size[k]) * self.scale[k].abs()) as f32)
    }
}

/// Look of the pages of a bake, besides their images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finish {
    /// Colour as screens show it, and opacity; they multiply the pages.
    pub base: [f32; 4],
    /// Opaque from this value on, where opacity is a mask.
    pub mask: Option<f32>,
    /// True if a share of the light passes.
    pub blends: bool,
    /// True if both sides are drawn.
    pub two_sided: bool,
    /// True if light does not matter.
    pub unlit: bool,
    /// Share of metal.
    pub metallic: Option<f32>,
    /// Roughness.
    pub roughness: Option<f32>,
}

impl Palette {
    /// Looks at all materials and images.
    pub fn new(materials: Option<&Materials>, purpose: Purpose) -> Palette {
        let none = Materials::default();
        let materials = materials.unwrap_or(&none);
        let mut palette = Palette {
            paints: Vec::new(),
            images: Vec::new(),
            n_images: materials.images.len(),
            materials: materials.list.clone(),
            losses: Ledger::default(),
        };
        palette.look(materials, purpose);
        let opaque = palette.part_opaque(purpose);
        let images = &palette.images;
        let use_of = |material: &Material, kind: MapKind| {
            let map = material.maps.iter().find(|map| map.kind == kind)?;
            let used = MapUse::new(map, images[map.image].as_ref()?.size);
            let image = match is_opaque(material, kind) {
                true => opaque.get(&map.image).copied().unwrap_or(map.image),
                false => map.image,
            };
            Some(MapUse { image, ..used })
        };
        let paint = |material: &Material| Paint {
            factor: linear(material.base),
            base: use_of(material, MapKind::Base),
            opacity: use_of(material, MapKind::Opacity),
            normal: match purpose {
                Purpose::Bake => None,
                Purpose::View | Purpose::Relief => use_of(material, MapKind::Normal),
            },
            mask: material.alpha.cutoff(),
            unlit: material.unlit,
        };
        let mut paints: Vec<Paint> = materials.list.iter().map(paint).collect();
        // What all share stays with the material, where every viewer treats it as it did.
        if purpose == Purpose::Bake && palette.common_base().is_some() {
            paints.iter_mut().for_each(|paint| paint.factor = [1.0; 4]);
        }
        palette.paints = paints;
        if purpose == Purpose::Bake {
            palette.enter_losses();
        }
        palette
    }

    fn look(&mut self, materials: &Materials, purpose: Purpose) {
        let is_used = |number: usize, counts: &dyn Fn(MapKind) -> bool| {
            let uses = |map: &Map| map.image == number && counts(map.kind);
            materials.list.iter().any(|material| material.maps.iter().any(uses))
        };
        let is_needed = |number: usize| is_used(number, &|kind| purpose.uses(kind));
        for (number, image) in materials.images.iter().enumerate() {
            if !is_needed(number) {
                self.images.push(None);
                continue;
            }
            let name = match &image.data {
                ImageData::File(path) => path.display().to_string(),
                ImageData::Inside(_) => image.name.clone(),
            };
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
                Err(fault) => self.lose_image(&name, &fault),
            }
        }
        let n_needed = (0..materials.images.len()).filter(|&number| is_needed(number)).count();
        if n_needed > 0 && self.images.iter().all(Option::is_none) {
            self.losses.lose(all_missing(n_needed));
        }
    }

    /// Takes the next image as one that cannot be used.
    fn lose_image(&mut self, name: &str, fault: &str) {
        self.images.push(None);
        let reason = format!("{fault}: its material's colour stands for it");
        let loss = Loss::new(LossKind::Images, "image", reason).example(name);
        self.losses.lose(loss);
    }

    /// Makes the colour images of opaque materials opaque; returns the number that each has for these.
    ///
    /// An image that is also used otherwise gets a second place.
    fn part_opaque(&mut self, purpose: Purpose) -> BTreeMap<usize, usize> {
        let (mut opaque, mut others) = (BTreeMap::new(), BTreeSet::new());
        for material in &self.materials {
            for map in material.maps.iter().filter(|map| purpose.uses(map.kind)) {
                if is_opaque(material, map.kind) {
                    opaque.insert(map.image, map.image);
                } else {
                    others.insert(map.image);
                }
            }
        }
        for (image, place) in &mut opaque {
            // A JPEG has no opacity.
            let picture = self.images[*image].as_mut().filter(|picture| !picture.is_jpeg);
            let Some(picture) = picture else { continue };
            if others.contains(image) {
                let second = Picture { is_opaque: true, ..picture.clone() };
                *place = self.images.len();
                self.images.push(Some(second));
            } else {
                picture.is_opaque = true;
            }
        }
        opaque
    }

    /// Enters what of the materials has no place on the pages.
    fn enter_losses(&mut self) {
        let is_mixed = |of: fn(&Material) -> Option<f32>| {
            self.materials.windows(2).any(|pair| of(&pair[0]) != of(&pair[1]))
        };
        let differ = [
            ("metal and roughness", is_mixed(|m| m.metallic) || is_mixed(|m| m.roughness)),
            ("cut-off of opacity", is_mixed(|m| m.alpha.cutoff())),
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
            let maps = maps.filter(|kind| !matches!(kind, MapKind::Base | MapKind::Opacity));
            let names = maps.map(|kind| kind.name().to_owned());
            for what in names.chain(besides_pages(material)) {
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

    /// True if all images are photographs in the way of JPEG.
    pub fn is_photographic(&self) -> bool {
        self.has_images() && self.images.iter().flatten().all(|picture| picture.is_jpeg)
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

    /// Look of the pages.
    pub fn finish(&self, has_alpha: bool) -> Finish {
        fn same<T: PartialEq + Copy>(mut all: impl Iterator<Item = Option<T>>) -> Option<T> {
            let first = all.next()??;
            all.all(|x| x == Some(first)).then_some(first)
        }
        let list = &self.materials;
        let mask = same(list.iter().map(|material| material.alpha.cutoff()));
        let base = self.common_base().unwrap_or([1.0; 4]);
        let is_clear = has_alpha || base[3] < 1.0;
        Finish {
            base,
            mask: mask.filter(|_| is_clear),
            blends: mask.is_none() && is_clear,
            two_sided: list.iter().any(|material| material.two_sided),
            unlit: !list.is_empty() && list.iter().all(|material| material.unlit),
            metallic: same(list.iter().map(|material| material.metallic)),
            roughness: same(list.iter().map(|material| material.roughness)),
        }
    }
}

/// True if the opacity of a material's image of this kind does not count.
fn is_opaque(material: &Material, kind: MapKind) -> bool {
    material.alpha == Alpha::Opaque && kind == MapKind::Base
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
    use std::sync::Arc;
    use stonecut_io::materials::{Image, Part};
    use stonecut_io::ply::raw::RawFile;

    fn map(options: &str, wrap: Option<[u32; 2]>) -> MapUse {
        let map = Map { kind: MapKind::Base, image: 0, options: options.to_owned(), wrap };
        MapUse::new(&map, [4, 2])
    }

    /// Texels of the upper left corner for coordinates at the middle of a texel.
    fn at(map: &MapUse, uv: [f32; 2]) -> Option<[usize; 2]> {
        map.texels(uv, [4, 2]).map(|(texels, _)| [texels[0][0], texels[1][0]])
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
            let map = Map { kind: MapKind::Base, image: 0, options, wrap: None };
            Material { alpha, maps: vec![map], ..Material::default() }
        };
        let images = |list: &[Alpha]| {
            let mut materials = materials.clone();
            materials.list = list.iter().map(|alpha| material(*alpha)).collect();
            let palette = Palette::new(Some(&materials), Purpose::Bake);
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

    #[test]
    fn coordinates_lead_to_texels_whatever_they_are() {
        let plain = map("", None);
        assert_eq!(at(&plain, [0.125, 0.75]), Some([0, 0]));
        assert_eq!(at(&plain, [0.875, 0.25]), Some([3, 1]));
        assert_eq!(at(&plain, [7.125, -1.25]), Some([0, 0]));
        assert_eq!(at(&plain, [f32::NAN, 0.0]), None);
        assert_eq!(at(&plain, [f32::INFINITY, 0.0]), None);
        assert_eq!(at(&plain, [3e38, 0.0]), None);
        let clamped = map("-clamp on", None);
        assert_eq!(at(&clamped, [7.125, -1.25]), Some([3, 1]));
        let mirrored = map("", Some([33648, 10497]));
        assert_eq!(at(&mirrored, [1.125, 0.75]), Some([3, 0]));
        let scaled = map("-s 2 1 1 -o 0.25 0", None);
        assert_eq!(at(&scaled, [0.0625, 0.75]), Some([1, 0]));
        assert_eq!(scaled.texels_per_coordinate, 4.0);
    }
}
