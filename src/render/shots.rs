//! Several pictures of one file: materials are looked at once, decoded images stay from picture to picture.

use super::camera::Camera;
use super::draw::{self, CLAY, draw, extent, free_bytes};
use super::picture::Picture;
use super::scene::{OnDisk, find};
use super::skin::Skins;
use super::view::{Aim, Coloring, Resources, View, per_pixel};
use crate::texture::{ImageCache, Palette, Purpose};
use std::sync::Arc;
use stonecut_io::materials::{Alpha, EMITTED, MapKind, Material, Materials};
use stonecut_io::ply::MeshSource;
use stonecut_mesh::vec3::{add, cross, scale, unit};
use stonecut_system::error::Result;
use stonecut_system::losses::{Ledger, Loss, LossKind};
use stonecut_system::progress::Progress;

/// Share of the memory beside the frame that decoded images take, if those of one material do with it.
const IMAGE_SHARE: u64 = 3;

/// A picture with its silhouette.
pub struct Shot {
    /// The picture.
    pub picture: Picture,
    /// For each pixel, row by row, whether any surface is seen there.
    pub covered: Vec<bool>,
}

/// True if materials of a file have images of their colour, whether or not these can be read.
pub fn has_images(source: &MeshSource) -> bool {
    let has_image = |all: &Arc<Materials>| all.shown().has_image(|kind| kind == MapKind::Base);
    source.has_corner_texture() && source.materials().is_some_and(has_image)
}

/// True if a material of a file has a normal map, whether or not it can be read.
fn has_normal_maps(source: &MeshSource) -> bool {
    source.materials().is_some_and(|all| all.has_image(|kind| kind == MapKind::Normal))
}

/// True if a file has colours: of materials, or of vertices.
pub fn has_looks(source: &MeshSource) -> bool {
    let has = |name: &str| find(source, name).is_some();
    source.materials().is_some_and(|all| !all.list.is_empty()) || has("red") || has("diffuse_red")
}

fn is_textured(view: &View) -> bool {
    view.coloring == Coloring::Texture && view.scale.is_none()
}

/// True if materials of a file are drawn: of surfaces without colours, normal maps are seen all the same.
fn is_painted(source: &MeshSource, view: &View) -> bool {
    let is_clay = view.coloring == Coloring::Plain && view.scale.is_none();
    is_textured(view) || (is_clay && has_normal_maps(source))
}

/// Looks that views of a file show, and its materials if they show any.
fn looks<'a>(source: &'a MeshSource, views: &[View]) -> (Palette, Option<&'a Materials>) {
    let is_any_painted = views.iter().any(|view| is_painted(source, view));
    let materials = source.materials().filter(|_| is_any_painted).map(|all| &**all);
    let purpose = if views.iter().any(is_textured) { Purpose::View } else { Purpose::Relief };
    (Palette::new(materials, purpose), materials)
}

/// Memory that images take at least.
fn looks_bytes(palette: &Palette) -> u64 {
    if palette.has_images() { palette.material_bytes() } else { 0 }
}

/// Memory that a picture of a file takes at least, with the images that are decoded for it.
pub fn least_bytes(source: &MeshSource, view: &View) -> Result<u64> {
    let (palette, _) = looks(source, std::slice::from_ref(view));
    Ok(draw::least_bytes(view)? + looks_bytes(&palette))
}

/// Refuses a picture of a file that the memory does not hold with the images that are decoded for it.
pub fn hold_images(source: &MeshSource, view: &View, resources: Resources) -> Result<()> {
    let (palette, _) = looks(source, std::slice::from_ref(view));
    free_bytes(view, looks_bytes(&palette), resources).map(drop)
}

/// Cameras evenly around a file, all at the distance at which they see the sphere around its bounding box.
///
/// Each is the `n`-th of a circle turned by the golden angle, from above to below.
pub fn aims_around(
    source: &MeshSource,
    view: &View,
    n: u32,
    resources: Resources,
    progress: &Progress,
) -> Result<Vec<Aim>> {
    let per_pixel = per_pixel(view)?;
    let extent = extent(&OnDisk::plain(source), resources.threads, progress)?;
    let (up, _) = extent.natural_view();
    let about_up = Camera::facing([0.0; 3], [0.0, 0.0, 1.0], up, [1, 1]);
    let side = unit(cross(up, about_up.axes[2]))
        .or_else(|| unit(cross(up, about_up.axes[0])))
        .unwrap_or([1.0, 0.0, 0.0]);
    let front = cross(side, up);
    let size = [view.width as usize * per_pixel, view.height as usize * per_pixel];
    let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    let aim = |i: u32| {
        let height = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
        let (sin, cos) = (golden * f64::from(i)).sin_cos();
        let level = (1.0 - height * height).sqrt();
        let around = add(scale(front, level * cos), scale(side, level * sin));
        let direction = add(around, scale(up, height));
        let mut camera = Camera::facing(extent.middle(), direction, up, size);
        camera.frame_sphere(extent.radius().max(f64::MIN_POSITIVE));
        Aim(camera)
    };
    Ok((0..n).map(aim).collect())
}

impl Aim {
    /// From the mesh to the viewer, of length 1.
    pub fn direction(&self) -> [f64; 3] {
        self.0.axes[2]
    }
}

/// Takes pictures of a file, one after another, and hands each to `each` with its number.
///
/// Memory: as `render_source`. Images that are missing or damaged are noted in `progress`, once.
///
/// Errors: as `render_source`, and those of `each`; the memory does not hold what `least_bytes` says.
pub fn shots(
    source: &MeshSource,
    views: &[View],
    resources: Resources,
    progress: &Progress,
    mut each: impl FnMut(usize, Shot) -> Result<()>,
) -> Result<()> {
    let (palette, materials) = looks(source, views);
    let looks_bytes = looks_bytes(&palette);
    let mut least = u64::MAX;
    for view in views {
        least = least.min(free_bytes(view, looks_bytes, resources)?);
    }
    // Opacity means what it does in a new texture and in tiles.
    let is_any_textured = views.iter().any(is_textured);
    let palette = match materials.filter(|_| is_any_textured) {
        Some(all) => Palette::settled(Some(all), Purpose::View, least / IMAGE_SHARE),
        None => palette,
    };
    let image_bytes = match palette.has_images() {
        true => {
            let all = palette.decoded_bytes().iter().sum::<u64>() + palette.decoder_bytes();
            (least / IMAGE_SHARE).clamp(palette.material_bytes(), all)
        }
        false => 0,
    };
    let images = ImageCache::new(&palette, image_bytes);
    let coloured = materials.map(|_| Skins::new(&palette, &images, None));
    let clay = materials.map(|_| Skins::new(&palette, &images, Some(CLAY)));
    for (number, view) in views.iter().enumerate() {
        let skins = match is_textured(view) {
            true => coloured.as_ref(),
            false => clay.as_ref().filter(|_| is_painted(source, view)),
        };
        let budget = free_bytes(view, looks_bytes, resources)?.saturating_sub(image_bytes);
        let mut scene = OnDisk::new(source, view);
        if skins.is_some_and(Skins::has_normal_maps) {
            scene = scene.with_frames();
        }
        let drawn = draw(&scene, view, (skins, &[]), (resources, budget), progress)?;
        let covered = drawn.covered();
        let picture = drawn.picture(view.lighting, resources.threads, progress)?;
        drop(drawn);
        each(number, Shot { picture, covered })?;
    }
    progress.lose_all(palette.losses());
    source.clamped_colours().into_iter().for_each(|loss| progress.lose(loss));
    progress.lose_all(&images.losses());
    progress.lose_all(&not_drawn(source, is_any_textured));
    Ok(())
}

/// Parts of the looks that pictures are without.
fn not_drawn(source: &MeshSource, is_textured: bool) -> Ledger {
    let mut losses = Ledger::default();
    let Some(materials) = source.materials() else { return losses };
    let materials = materials.shown();
    if materials.has_image(|kind| kind == MapKind::Base) && !source.has_corner_texture() {
        let loss =
            Loss::new(LossKind::Images, "images", "not drawn: faces have no texture coordinates");
        losses.lose(loss.whole().remedy("where vertices have them, convert the mesh to OBJ first"));
    }
    if !is_textured {
        return losses;
    }
    let lets_light_through = |material: &&Material| {
        let is_mask = matches!(material.alpha, Alpha::Mask(_));
        let is_clear = material.alpha == Alpha::Blend
            || material.base[3] < 1.0
            || material.map(MapKind::Opacity).is_some();
        is_clear && !is_mask
    };
    let emits = |material: &&Material| material.light() != [0.0; 3];
    let lights = materials.list.iter().filter(emits).map(|m| format!("material '{}'", m.name));
    for example in lights {
        losses.lose(Loss::new(LossKind::Materials, EMITTED, "not drawn").example(example));
    }
    match materials.list.iter().filter(lets_light_through).count() {
        0 => {}
        n => {
            let why = "drawn opaque, and holes where an image is less than half opaque";
            let loss = Loss::new(LossKind::Materials, "opacity of materials", why);
            losses.lose(loss.count(n as u64));
        }
    }
    losses
}
