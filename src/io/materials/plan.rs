//! Fate of materials and images for one output, decided and checked before work begins.
//!
//! Images are copied beside the output, referred to where they are, embedded, or left out. A missing or damaged image
//! is a note, never a failure. Writing the files beside the output is in `sides`.

use super::description::{Image, ImageData, MapKind, Materials};
use super::images::{ImageFacts, is_same, look};
use super::light::shown_in;
use super::mode::TextureMode;
use super::search::relative;
use super::{losses, mtl_text};
use crate::output_format::OutputKind;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stonecut_system::disk::{folder_of, open_input};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Ledger, Loss, LossKind};
use stonecut_system::paths::real;
use stonecut_system::pending_file::{Seen, refuse_irregular, refuse_linked};

/// An output that materials are planned for.
#[derive(Clone, Copy, Debug)]
pub struct TextureRequest<'a> {
    /// The output's final path; `-` is standard output.
    pub output: &'a Path,
    /// Its kind.
    pub kind: OutputKind,
    /// As asked for; by the kind if `None`.
    pub mode: Option<TextureMode>,
    /// True if files beside the output may be replaced.
    pub force: bool,
}

/// Form in which an output refers to an image.
#[derive(Clone, Debug, PartialEq)]
pub enum Reference {
    /// A path relative to the output's folder.
    Path(String),
    /// Its bytes, and their number.
    Embedded(&'static str, u64),
    /// Not at all.
    None,
}

/// A file that an image is copied to.
#[derive(Clone, Debug)]
pub(super) struct Copied {
    pub(super) image: usize,
    pub(super) target: PathBuf,
}

/// Materials as an output has them; `losses` lists what is missing or lost.
#[derive(Clone, Debug)]
pub struct TexturePlan {
    /// As the input has them; for PLY with light as the colour of what has no other.
    pub materials: Arc<Materials>,
    /// One for each image.
    pub references: Vec<Reference>,
    pub(super) copies: Vec<Copied>,
    /// The material library beside the output.
    pub library: Option<PathBuf>,
    /// The library as it was found.
    pub(super) library_seen: Option<Seen>,
    /// Missing, damaged and lost parts.
    pub losses: Ledger,
    /// Images that cannot be read.
    pub n_missing: usize,
    /// Bytes of all copied and embedded images.
    pub bytes: u64,
    pub(super) force: bool,
}

impl TexturePlan {
    /// Decides for one output; looks at every image and every file that would be written.
    ///
    /// Errors: a mode that the kind of output cannot have; files beside the output that may not be replaced.
    pub fn new(materials: Arc<Materials>, request: &TextureRequest) -> Result<TexturePlan> {
        let mode = decided(request)?;
        let mut losses = Ledger::default();
        let materials = shown_in(request.kind, materials, &mut losses);
        let mut plan = TexturePlan {
            references: vec![Reference::None; materials.images.len()],
            copies: Vec::new(),
            library: None,
            library_seen: None,
            losses,
            n_missing: 0,
            bytes: 0,
            force: request.force,
            materials,
        };
        losses::enter(request.kind, &plan.materials, &mut plan.losses);
        if request.kind == OutputKind::Stl {
            return Ok(plan);
        }
        if request.kind == OutputKind::Obj {
            plan.library = plan.library_for(request)?;
            plan.library_seen = plan.library.as_deref().map(Seen::new);
        }
        if mode != TextureMode::None {
            if request.kind != OutputKind::Glb && plan.materials.n_tinted > 0 {
                let why = format!("hidden by the images in {}", request.kind.name());
                let what = "colours of vertices under images";
                let loss = Loss::new(LossKind::Colors, what, why).count(plan.materials.n_tinted);
                plan.losses.lose(
                    loss.remedy(
                        "GLB shows both, and so does a new texture (simplify --texture bake)",
                    ),
                );
            }
            plan.refer(mode, request)?;
        } else if !plan.materials.images.is_empty() {
            let n = plan.materials.images.len() as u64;
            plan.losses.lose(
                Loss::new(LossKind::Images, "images", "left out, as asked").count(n).notice(),
            );
        }
        Ok(plan)
    }

    /// Materials whose images and library were written by the caller, beside the output.
    pub fn given(materials: Materials, library: Option<PathBuf>) -> TexturePlan {
        let reference = |image: &Image| Reference::Path(image.name.clone());
        TexturePlan {
            references: materials.images.iter().map(reference).collect(),
            materials: Arc::new(materials),
            copies: Vec::new(),
            library_seen: library.as_deref().map(Seen::new),
            library,
            losses: Ledger::default(),
            n_missing: 0,
            bytes: 0,
            force: true,
        }
    }

    /// Decides on every image.
    fn refer(&mut self, mode: TextureMode, request: &TextureRequest) -> Result<()> {
        let materials = self.materials.clone();
        let home = real(if is_stream(request.output) {
            Path::new(".")
        } else {
            folder_of(request.output)
        });
        let (mut taken, mut pending) = (HashSet::new(), Vec::new());
        for (number, image) in materials.images.iter().enumerate() {
            let facts = look(&image.data);
            let fault = match &facts {
                Err(what) => {
                    self.n_missing += 1;
                    Some(what.clone())
                }
                Ok(facts) => facts.fault.clone().map(|fault| format!("is doubtful: {fault}")),
            };
            if let Some(fault) = fault {
                let mut loss = Loss::new(LossKind::Images, "image", fault);
                // Its user is looked for among all materials.
                if !self.losses.knows(&loss) {
                    loss = loss.example(format!("'{}'{}", shown(image), self.user(number)));
                }
                self.losses.lose(loss);
            }
            if mode == TextureMode::Embed {
                self.embed(number, facts.as_ref().ok());
                continue;
            }
            let ImageData::File(path) = &image.data else {
                if let Ok(facts) = facts {
                    pending.push((number, facts));
                }
                continue;
            };
            let (path, relative) = (real(path), relative(&home, &real(path)));
            let is_below = !relative.starts_with("..") && !relative.starts_with('/');
            match facts {
                Ok(facts) if mode == TextureMode::Copy && !is_below => {
                    pending.push((number, facts))
                }
                _ => {
                    taken.insert(path);
                    self.references[number] = Reference::Path(relative);
                }
            }
        }
        if self.lacks_images() {
            self.losses.lose(all_missing(self.n_missing));
        } else if materials.lacks_images {
            let why = "no material that a face names has one";
            let loss = Loss::new(LossKind::Images, "all images of the material library", why);
            let remedy = "let the faces name a material of the library (usemtl)";
            self.losses.lose(loss.remedy(remedy).whole());
        }
        let is_none = |reference: &Reference| matches!(reference, Reference::None);
        if mode == TextureMode::Embed
            && self.references.iter().all(is_none)
            && self.n_missing < self.references.len()
        {
            let reason = "glTF knows JPEG, PNG, WebP and KTX2";
            let loss = Loss::new(LossKind::Images, "all images", reason).whole();
            self.losses.lose(loss.remedy("make them JPEG or PNG first, or write OBJ"));
        }
        if is_stream(request.output) && !pending.is_empty() {
            let loss =
                Loss::new(LossKind::Images, "images", "beside standard output there is no folder");
            self.losses
                .lose(loss.count(pending.len() as u64).whole().remedy("write to a file, or a GLB"));
            return Ok(());
        }
        let folder = format!("{}_textures", stem(request.output));
        if !pending.is_empty() {
            refuse_linked(&folder_of(request.output).join(&folder))?;
        }
        let mut next = HashMap::new();
        for (number, facts) in pending {
            let image = &materials.images[number];
            if facts.ending == "ktx2" {
                let reason = format!("programs that read {} know no KTX2", request.kind.name());
                let loss = Loss::new(LossKind::Images, "image", reason)
                    .example(format!("'{}'", shown(image)));
                self.losses
                    .lose(loss.remedy("write a GLB, or make a new texture with --texture bake"));
            }
            let name = free_name(image, &facts, (number, &mut next), |name| {
                taken.insert(home.join(&folder).join(name))
            });
            let target = folder_of(request.output).join(&folder).join(&name);
            self.check_copy(number, &target)?;
            self.bytes += facts.n_bytes;
            self.references[number] = Reference::Path(format!("{folder}/{name}"));
            self.copies.push(Copied { image: number, target });
        }
        Ok(())
    }

    fn embed(&mut self, number: usize, facts: Option<&ImageFacts>) {
        let Some(facts) = facts else { return };
        match facts.mime {
            Some(mime) => {
                self.bytes += facts.n_bytes;
                self.references[number] = Reference::Embedded(mime, facts.n_bytes);
            }
            None => {
                let reason = format!("glTF knows no {}", facts.ending);
                let loss = Loss::new(LossKind::Images, "image", reason)
                    .remedy("make it a JPEG or PNG first");
                self.losses
                    .lose(loss.example(format!("'{}'", shown(&self.materials.images[number]))));
            }
        }
    }

    /// The material that needs an image, for messages.
    fn user(&self, image: usize) -> String {
        let has = |m: &&super::Material| m.maps.iter().any(|map| map.image == image);
        let user = self.materials.list.iter().find(has);
        user.map_or_else(String::new, |m| format!(" (material '{}')", m.name))
    }

    /// Refuses to replace a file that is another image.
    fn check_copy(&self, image: usize, target: &Path) -> Result<()> {
        refuse_irregular(target)?;
        let is_free = !target.exists() || self.force;
        if is_free || is_same(&self.materials.images[image].data, target)? {
            return Ok(());
        }
        Err(Error::Usage(format!(
            "{} exists and is another image; give --force to replace it, or --textures link to refer to images where they are",
            target.display()
        )))
    }

    /// The material library beside an OBJ file.
    fn library_for(&mut self, request: &TextureRequest) -> Result<Option<PathBuf>> {
        if is_stream(request.output) {
            let why = "only named: beside standard output there is no place for a material library";
            self.losses
                .lose(Loss::new(LossKind::Materials, "materials", why).remedy("write to a file"));
            return Ok(None);
        }
        let name = format!("{}.mtl", stem(request.output));
        let path = folder_of(request.output).join(name);
        refuse_irregular(&path)?;
        let shown = path.display();
        self.materials.refuse_output(&path)?;
        if path.exists() && !self.force && !is_own_library(&path) {
            return Err(Error::Usage(format!(
                "{shown} exists and was not written by stonecut; give --force to replace it, or OUTPUT another name"
            )));
        }
        Ok(Some(path))
    }

    /// Returns whether images are named and none of them is there.
    pub fn lacks_images(&self) -> bool {
        self.n_missing > 0 && self.n_missing == self.materials.images.len()
    }

    /// The path that the output has for an image.
    pub fn path_of(&self, image: usize) -> Option<&str> {
        match &self.references[image] {
            Reference::Path(path) => Some(path),
            Reference::Embedded(..) | Reference::None => None,
        }
    }

    /// The path of the colour image of a material.
    pub fn base_path(&self, material: usize) -> Option<&str> {
        self.path_of(self.materials.list[material].map(MapKind::Base)?.image)
    }

    /// Returns whether there is more than one material, so that faces need an order.
    pub fn has_many(&self) -> bool {
        self.materials.list.len() > 1
    }
}

impl Materials {
    /// Paths of the images and libraries that lie in other files.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let images = self.images.iter().filter_map(|image| match &image.data {
            ImageData::File(path) => Some(path.as_path()),
            _ => None,
        });
        images.chain(self.libraries.iter().map(PathBuf::as_path))
    }

    /// Names of the materials.
    pub fn names(&self) -> Vec<String> {
        self.list.iter().map(|material| material.name.clone()).collect()
    }

    /// Returns whether images are named and none of them can be read.
    pub fn lacks_images(&self) -> bool {
        !self.images.is_empty() && self.images.iter().all(|image| look(&image.data).is_err())
    }

    /// Refuses an output that would replace an image or a material library of the input, `--force` or not.
    pub fn refuse_output(&self, output: &Path) -> Result<()> {
        if is_stream(output) || !output.exists() {
            return Ok(());
        }
        let output_file = real(output);
        let image = self.images.iter().find(|image| match &image.data {
            ImageData::File(path) => real(path) == output_file,
            _ => false,
        });
        let what = match image {
            Some(_) => "an image",
            None if self.libraries.iter().any(|path| real(path) == output_file) => {
                "the material library"
            }
            None => return Ok(()),
        };
        let shown = output.display();
        Err(Error::Usage(format!("{shown} is {what} of the input; give OUTPUT another name")))
    }
}

/// The mode for an output; refuses one that its kind cannot have.
fn decided(request: &TextureRequest) -> Result<TextureMode> {
    let TextureRequest { output, kind, mode, .. } = *request;
    let default = match kind {
        OutputKind::Glb => TextureMode::Embed,
        OutputKind::Obj | OutputKind::Ply if is_stream(output) => TextureMode::Link,
        OutputKind::Obj | OutputKind::Ply | OutputKind::Stl => TextureMode::Copy,
    };
    match mode {
        Some(TextureMode::Embed) if kind != OutputKind::Glb => {
            let what =
                "--textures embed: only GLB holds images; write a .glb, or choose copy or link";
            Err(Error::Usage(what.to_owned()))
        }
        Some(TextureMode::Copy) if is_stream(output) && kind != OutputKind::Stl => {
            let what = "--textures copy: there is no folder beside standard output; choose link, embed or none";
            Err(Error::Usage(what.to_owned()))
        }
        Some(mode) if mode.is_ktx2() && kind != OutputKind::Glb => {
            let mode = mode.name();
            Err(Error::Usage(format!("--textures {mode}: only GLB holds KTX2; write a .glb")))
        }
        Some(mode) if mode.is_ktx2() => Err(Error::Usage(format!(
            "--textures {}: images that are kept stay as they are, those of a new texture in a .glb become KTX2; choose \
             --texture bake, or run 'gltf-transform {} IN.glb OUT.glb' on the result",
            mode.name(),
            if mode == TextureMode::Ktx2 { "uastc" } else { "etc1s" }
        ))),
        mode => Ok(mode.unwrap_or(default)),
    }
}

/// The loss of all images that materials name.
pub fn all_missing(n: usize) -> Loss {
    let what = "none of the images that the mesh names can be used";
    let loss = Loss::new(LossKind::Images, what, "").count(n as u64).whole();
    loss.remedy("see above what each lacks, or give them up with --textures none")
}

fn is_stream(path: &Path) -> bool {
    path == Path::new("-")
}

fn is_own_library(path: &Path) -> bool {
    use std::io::Read;
    let mut head = vec![0; mtl_text::first_line().len().min(10)];
    let read = open_input(path).is_ok_and(|mut file| file.read_exact(&mut head).is_ok());
    read && mtl_text::first_line().as_bytes().starts_with(&head)
}

/// The output's name without ending, without blanks, which many readers of materials take for an end.
pub fn stem(path: &Path) -> String {
    let stem =
        path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    plain(&stem)
}

fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect()
}

/// A file name for a copy that no other image has; `next` has the number that is tried next behind each name.
fn free_name(
    image: &Image,
    facts: &ImageFacts,
    (number, next): (usize, &mut HashMap<String, usize>),
    mut take: impl FnMut(&str) -> bool,
) -> String {
    let own = match &image.data {
        ImageData::File(path) => path.file_name().map(|name| name.to_string_lossy().into_owned()),
        ImageData::Inside(_) => {
            let base = image.name.rsplit(['/', '\\']).next().unwrap_or_default();
            let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
            let stem = if stem.is_empty() { format!("image_{number}") } else { stem.to_owned() };
            Some(format!("{stem}.{}", facts.ending))
        }
    };
    let own = plain(&own.unwrap_or_else(|| format!("image_{number}.{}", facts.ending)));
    let (stem, ending) = own.rsplit_once('.').unwrap_or((&own, facts.ending));
    let mut name = format!("{stem}.{ending}");
    if take(&name) {
        return name;
    }
    // No number is tried twice behind a name.
    let n = next.entry(name.clone()).or_insert(2);
    while !take(&name) {
        name = format!("{stem}_{n}.{ending}");
        *n += 1;
    }
    name
}

fn shown(image: &Image) -> String {
    match &image.data {
        ImageData::File(path) => path.display().to_string(),
        ImageData::Inside(_) => image.name.clone(),
    }
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_from_the_output_to_the_image() {
        for (folder, file, way) in [
            ("/a/b", "/a/b/c.png", "c.png"),
            ("/a/b", "/a/b/t/c.png", "t/c.png"),
            ("/a/b", "/a/c.png", "../c.png"),
            ("/a/b/d", "/x/y.png", "../../../x/y.png"),
            ("/", "/x.png", "x.png"),
        ] {
            assert_eq!(relative(Path::new(folder), Path::new(file)), way);
        }
    }
}
