//! Materials of a mesh and the images that they name: the one form that every reader fills and every writer takes.
//!
//! A face names its material by number (`texnumber`). Images are named, never decoded. Does not read or write files.

use crate::ply::raw::{RawFile, Spool};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stonecut_system::error::Result;
use stonecut_system::losses::{Ledger, Loss, LossKind};

/// The property of faces that holds the number of their material.
pub const NUMBER: &str = "texnumber";

/// Materials by number, and the images that they name.
#[derive(Clone, Debug, Default)]
pub struct Materials {
    /// Materials in the order of their numbers.
    pub list: Vec<Material>,
    /// Images, each once.
    pub images: Vec<Image>,
    /// Parts of the input that this description has no place for.
    pub losses: Ledger,
    /// Files that the materials were read from.
    pub libraries: Vec<PathBuf>,
    /// Vertices whose colour, other than white, images are seen through: glTF multiplies the two.
    pub n_tinted: u64,
    /// True if the mesh names images, or its material library does, and no material of a face has one.
    pub lacks_images: bool,
    /// Places of the images that are files.
    by_path: HashMap<PathBuf, usize>,
}

/// Appearance of faces.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name, distinct among the materials of a mesh; empty where the input has none.
    pub name: String,
    /// Colour as screens show it (sRGB, as in MTL) and opacity, from 0 to 1; multiplied with the image of kind `Base`.
    pub base: [f32; 4],
    /// Ambient colour.
    pub ambient: Option<[f32; 3]>,
    /// Colour of highlights.
    pub specular: Option<[f32; 3]>,
    /// Emitted light, as screens show it.
    pub emissive: Option<[f32; 3]>,
    /// Factor of the emitted light, which may go beyond white.
    pub emissive_strength: f32,
    /// Exponent of highlights.
    pub shininess: Option<f32>,
    /// Share of metal, from 0 to 1.
    pub metallic: Option<f32>,
    /// Roughness, from 0 to 1.
    pub roughness: Option<f32>,
    /// True if the vertices of its faces have its colour, for outputs that have no materials.
    pub is_at_vertices: bool,
    /// Meaning of opacity.
    pub alpha: Alpha,
    /// True if both sides are drawn.
    pub two_sided: bool,
    /// True if light does not matter.
    pub unlit: bool,
    /// Images, at most one of each kind.
    pub maps: Vec<Map>,
    /// Lines that only a material library can hold.
    pub mtl_lines: Vec<String>,
}

/// Meaning of a material's opacity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Alpha {
    /// As the input's format has it: opaque unless colour or image are not.
    #[default]
    Plain,
    /// Opaque whatever colour and image say, as glTF has it where nothing else is said.
    Opaque,
    /// A share of the light passes.
    Blend,
    /// Opaque from this value on, otherwise not there.
    Mask(f32),
}

impl Alpha {
    /// The value from which on a mask is opaque.
    pub fn cutoff(self) -> Option<f32> {
        match self {
            Alpha::Mask(from) => Some(from),
            Alpha::Plain | Alpha::Opaque | Alpha::Blend => None,
        }
    }
}

/// An image in its role.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The role.
    pub kind: MapKind,
    /// Place in `Materials::images`.
    pub image: usize,
    /// Options of a material library: `-s 2 2 1`.
    pub options: String,
    /// Factor of slopes in a normal map, share of the shade in one of shade.
    pub strength: f32,
    /// Tiling outside of 0 to 1 as glTF numbers it, along u and v; repeated if `None`.
    pub wrap: Option<[u32; 2]>,
    /// True if coordinates lead beyond the image, where `wrap` is seen.
    pub shows_wrap: bool,
}

/// Place of an image among texture coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPlace {
    /// Coordinates, v upwards, are multiplied by it.
    pub scale: [f64; 2],
    /// Added after that.
    pub offset: [f64; 2],
    /// The image ends at its border.
    pub is_clamped: bool,
    /// True if there are options besides.
    pub has_others: bool,
}

/// Tiling of an image that ends at its border, as glTF numbers it.
pub(crate) const CLAMP_TO_EDGE: u32 = 33071;

/// The same along u and v.
pub const CLAMPED: [u32; 2] = [CLAMP_TO_EDGE; 2];

impl Map {
    /// An image that repeats, with options of a material library.
    pub fn new(kind: MapKind, image: usize, options: String) -> Map {
        Map { kind, image, options, strength: 1.0, wrap: None, shows_wrap: false }
    }

    /// Options of a material library, with the tiling if they can say it.
    pub fn library_options(&self) -> String {
        let clamp = if self.wrap == Some(CLAMPED) { "-clamp on" } else { "" };
        [clamp, &self.options].join(" ").trim().to_owned()
    }

    /// True if a material library cannot say how the image goes on where coordinates lead beyond it.
    pub fn has_unsaid_wrap(&self) -> bool {
        self.shows_wrap && self.wrap.is_some_and(|wrap| wrap != CLAMPED)
    }

    /// The place that options of a material library give it: `-s`, `-o` and `-clamp on`.
    pub fn place(&self) -> MapPlace {
        let mut out =
            MapPlace { scale: [1.0; 2], offset: [0.0; 2], is_clamped: false, has_others: false };
        let words: Vec<&str> = self.options.split_whitespace().collect();
        for (i, word) in words.iter().enumerate() {
            let number = |k: usize| {
                let word = words.get(i + k)?;
                word.parse::<f64>().ok().filter(|x| x.is_finite())
            };
            let pair = |rest: f64| number(1).map(|first| [first, number(2).unwrap_or(rest)]);
            match *word {
                "-s" => out.scale = pair(1.0).unwrap_or(out.scale),
                "-o" => out.offset = pair(0.0).unwrap_or(out.offset),
                "-clamp" => out.is_clamped = words.get(i + 1) == Some(&"on"),
                word => {
                    out.has_others |= word.starts_with('-') && word.parse::<f64>().is_err();
                }
            }
        }
        out
    }
}

/// Roles of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MapKind {
    /// Colour.
    Base,
    /// Emitted light.
    Emissive,
    /// Opacity.
    Opacity,
    /// Colour of highlights.
    Specular,
    /// Ambient colour.
    Ambient,
    /// Heights.
    Bump,
    /// Directions in tangent space.
    Normal,
    /// Roughness in green, share of metal in blue.
    MetallicRoughness,
    /// Shade of ambient light.
    Occlusion,
    /// Roughness alone.
    Roughness,
    /// Share of metal alone.
    Metallic,
}

impl MapKind {
    /// True if its values are colours as screens show them, not numbers.
    pub fn is_colour(self) -> bool {
        use MapKind::{Ambient, Base, Emissive, Opacity, Specular};
        matches!(self, Base | Opacity | Emissive | Specular | Ambient)
    }

    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            MapKind::Base => "colour image",
            MapKind::Emissive => "image of emitted light",
            MapKind::Opacity => "image of opacity",
            MapKind::Specular => "image of highlights",
            MapKind::Ambient => "image of ambient colour",
            MapKind::Bump => "image of heights",
            MapKind::Normal => "normal map",
            MapKind::MetallicRoughness => "image of metal and roughness",
            MapKind::Occlusion => "image of ambient shade",
            MapKind::Roughness => "image of roughness",
            MapKind::Metallic => "image of metal",
        }
    }
}

/// An image that materials name.
#[derive(Clone, Debug)]
pub struct Image {
    /// The name in the input, for messages.
    pub name: String,
    /// Place of its bytes.
    pub data: ImageData,
}

/// Place of an image's bytes.
#[derive(Clone)]
pub enum ImageData {
    /// A file, which need not be there.
    File(PathBuf),
    /// A part of another file.
    Inside(Part),
}

/// A part of a file that is open.
#[derive(Clone)]
pub struct Part {
    /// The file.
    pub file: Arc<RawFile>,
    /// Its first byte.
    pub offset: u64,
    /// Its length.
    pub n_bytes: u64,
}

impl std::fmt::Debug for ImageData {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ImageData::File(path) => f.debug_tuple("File").field(path).finish(),
            ImageData::Inside(part) => {
                f.debug_tuple("Inside").field(&part.offset).field(&part.n_bytes).finish()
            }
        }
    }
}

impl Default for Material {
    /// White, opaque, without images.
    fn default() -> Self {
        Material {
            name: String::new(),
            base: [1.0; 4],
            ambient: None,
            specular: None,
            emissive: None,
            emissive_strength: 1.0,
            shininess: None,
            metallic: None,
            roughness: None,
            is_at_vertices: false,
            alpha: Alpha::Plain,
            two_sided: false,
            unlit: false,
            maps: Vec::new(),
            mtl_lines: Vec::new(),
        }
    }
}

impl Material {
    /// The image of a kind.
    pub fn map(&self, kind: MapKind) -> Option<&Map> {
        self.maps.iter().find(|map| map.kind == kind)
    }
}

impl Materials {
    /// Returns whether a material has an image of such a kind.
    pub fn has_image(&self, of: impl Fn(MapKind) -> bool) -> bool {
        self.list.iter().any(|material| material.maps.iter().any(|map| of(map.kind)))
    }

    /// Returns whether a material has a colour image; `number` is that of a face.
    pub fn has_base(&self, number: i32) -> bool {
        let material = usize::try_from(number).ok().and_then(|number| self.list.get(number));
        material.is_some_and(|material| material.map(MapKind::Base).is_some())
    }

    /// Notes that coordinates lead beyond the images of a material, if there is one.
    pub fn show_wrap(&mut self, number: Option<usize>) {
        let material = number.and_then(|number| self.list.get_mut(number));
        let maps = material.into_iter().flat_map(|material| &mut material.maps);
        maps.filter(|map| map.wrap.is_some()).for_each(|map| map.shows_wrap = true);
    }

    /// Adds an image, or finds that of the same file.
    pub fn add_image(&mut self, image: Image) -> usize {
        let next = self.images.len();
        let number = match &image.data {
            ImageData::File(path) => *self.by_path.entry(path.clone()).or_insert(next),
            ImageData::Inside(_) => next,
        };
        if number == next {
            self.images.push(image);
        }
        number
    }

    /// Materials with one image each, as a PLY file names them; `names` in the same order where they are known.
    pub fn of_files(files: &[(String, PathBuf)], names: &[String]) -> Materials {
        let mut out = Materials::default();
        for i in 0..files.len().max(names.len()) {
            let mut material = Material::default();
            if let Some((name, path)) = files.get(i) {
                let data = ImageData::File(path.clone());
                let image = out.add_image(Image { name: name.clone(), data });
                let options = String::new();
                material.maps.push(Map::new(MapKind::Base, image, options));
                let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
                material.name = stem.unwrap_or_default();
            }
            if let Some(name) = names.get(i).filter(|_| names.len() >= files.len()) {
                material.name.clone_from(name);
            }
            out.list.push(material);
        }
        out.name_all();
        out
    }

    /// Gives every material a name that no other has.
    pub fn name_all(&mut self) {
        let mut taken = HashSet::new();
        // The number that is tried next behind each name: no number is tried twice.
        let mut next: HashMap<String, usize> = HashMap::new();
        for (i, material) in self.list.iter_mut().enumerate() {
            material.name = material.name.replace(char::is_control, "_").trim().to_owned();
            if material.name.is_empty() {
                material.name = format!("material_{i}");
            }
            if taken.insert(material.name.clone()) {
                continue;
            }
            let base = material.name.clone();
            let n = next.entry(base.clone()).or_insert(2);
            while !taken.insert(material.name.clone()) {
                material.name = format!("{base}_{n}");
                *n += 1;
            }
        }
    }

    /// Takes the images out of a folder that is going to vanish, into temporary data. `name` is what the folder is known by.
    ///
    /// Errors: an image that cannot be read, temporary data that cannot be written.
    pub(crate) fn leave_folder(
        &mut self,
        folder: &Path,
        name: &Path,
        mut spool: Spool,
    ) -> Result<()> {
        let mut places = Vec::new();
        let root = std::fs::canonicalize(folder).unwrap_or(folder.to_path_buf());
        for (i, image) in self.images.iter_mut().enumerate() {
            let ImageData::File(path) = &mut image.data else { continue };
            let last = || PathBuf::from(path.file_name().unwrap_or_default());
            let rest = path.strip_prefix(folder).map_or_else(|_| last(), Path::to_path_buf);
            // What lies outside belongs to others, and counts as missing.
            let real = std::fs::canonicalize(&*path).ok();
            if let Some(real) = real.filter(|real| real.starts_with(&root) && real.is_file()) {
                let file = RawFile::open(&real)?;
                places.push((i, spool.len(), file.len()));
                spool.append_file(&file)?;
            }
            *path = name.join(rest);
        }
        let file = Arc::new(spool.finish(name)?);
        for (i, offset, n_bytes) in places {
            self.images[i].data = ImageData::Inside(Part { file: file.clone(), offset, n_bytes });
        }
        self.by_path.clear();
        self.libraries.clear();
        self.losses.rename(&folder.to_string_lossy(), &name.to_string_lossy());
        Ok(())
    }

    /// Enters a remark on what was found otherwise than it is written.
    pub fn note(&mut self, line: impl AsRef<str>) {
        self.lose(Loss { kind: LossKind::Materials, ..Loss::remark(line) });
    }

    /// Enters what the description has no place for.
    pub fn lose(&mut self, loss: Loss) {
        self.losses.lose(loss);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A search from 2 on for each of these would try two thousand million names.
    #[test]
    fn names_that_repeat_are_numbered_in_one_go() {
        let mut out = Materials::default();
        for name in ["a", "a_2", "b"].repeat(20_000) {
            out.list.push(Material { name: name.to_owned(), ..Material::default() });
        }
        out.name_all();
        let names: HashSet<&str> = out.list.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names.len(), 60_000);
        let first: Vec<&str> = out.list[..6].iter().map(|m| m.name.as_str()).collect();
        assert_eq!(first, ["a", "a_2", "b", "a_3", "a_2_2", "b_2"]);
    }

    #[test]
    fn notes_beyond_the_first_are_counted() {
        let mut out = Materials::default();
        for _ in 0..2 {
            (0..200_000).for_each(|i| out.note(format!("_{i} of vertices: not carried")));
        }
        assert_eq!(out.losses.entries().len(), 101);
        assert_eq!(out.losses.entries()[100].count, 399_800);
    }
}
