//! Meaning of opacity in colour images where the input's format does not say it (MTL, PLY): found in the images' texels.
//!
//! Without that, every scan whose PNG happens to have opacity would blend in glTF, and viewers draw what blends without depth.

use super::images::opacities;
use super::palette::Palette;
use super::purpose::Purpose;
use std::collections::BTreeMap;
use stonecut_io::materials::{Alpha, MapKind, Material, Materials, look_at_image};
use stonecut_system::losses::{Ledger, Loss, LossKind};

/// Value from which on a texel is there, where all are 0 or 1: that of glTF.
const CUTOFF: f32 = 0.5;

impl Palette {
    /// Looks at all materials and images, with the meaning of opacity as texels have it where the input does not say it; decoding takes at most `most_bytes`.
    pub fn settled(materials: Option<&Materials>, purpose: Purpose, most_bytes: u64) -> Palette {
        let Some((settled, losses)) = materials.and_then(|all| settle_opacity(all, most_bytes))
        else {
            return Palette::new(materials, purpose);
        };
        let mut palette = Palette::new(Some(&settled), purpose);
        palette.lose_all(&losses);
        palette
    }
}

/// Gives materials with a clear colour image the meaning of its opacity: opaque where all texels are, or where none is to be
/// seen, a mask where all are 0 or 1. `None` if nothing changes. Images that `most_bytes` do not hold while they are decoded are left.
pub(super) fn settle_opacity(
    materials: &Materials,
    most_bytes: u64,
) -> Option<(Materials, Ledger)> {
    let image_of = |material: &Material, kind: MapKind| material.map(kind).map(|map| map.image);
    let is_open = |material: &&Material| {
        material.alpha == Alpha::Plain
            && material.base[3] == 1.0
            && materials.has_clear_base(material)
    };
    let mut found = BTreeMap::new();
    for material in materials.list.iter().filter(is_open) {
        let Some(image) = image_of(material, MapKind::Base) else { continue };
        found.entry(image).or_insert_with(|| look(materials, image, most_bytes));
    }
    let is_mask = |image: usize| {
        materials.list.iter().any(|other| image_of(other, MapKind::Opacity) == Some(image))
    };
    let (mut out, mut losses) = (materials.clone(), Ledger::default());
    let settled = materials.list.iter().zip(&mut out.list).filter(|(own, _)| is_open(own));
    for (own, to) in settled {
        let Some(image) = image_of(own, MapKind::Base) else { continue };
        // Where others name the image for their opacity, those that do not are opaque.
        let is_opaque = is_mask(image) && image_of(own, MapKind::Opacity).is_none();
        match found[&image] {
            _ if is_opaque => to.alpha = Alpha::Opaque,
            [false, false, true] => to.alpha = Alpha::Opaque,
            [true, false, true] => to.alpha = Alpha::Mask(CUTOFF),
            [true, false, false] => {
                to.alpha = Alpha::Opaque;
                let why = "would leave the surface invisible: it is taken as opaque";
                let loss = Loss::new(LossKind::Materials, "image with opacity 0 everywhere", why);
                losses.lose(loss.example(format!("material '{}'", own.name)).notice());
            }
            _ => {}
        }
        if to.alpha == Alpha::Opaque {
            to.maps.retain(|map| map.kind != MapKind::Opacity);
        }
    }
    (out.list != materials.list).then_some((out, losses))
}

/// Returns whether an image has texels of opacity 0, in between, and 1; all of them if that is not known.
fn look(materials: &Materials, image: usize, most_bytes: u64) -> [bool; 3] {
    let data = &materials.images[image].data;
    let found = look_at_image(data).ok().filter(|facts| !facts.is_too_large).and_then(|facts| {
        let size = facts.size?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let bytes = facts.n_bytes + (facts.decoder_pixel_bytes + 4) * pixels;
        (bytes <= most_bytes).then(|| opacities(data, size).ok())?
    });
    found.unwrap_or([true; 3])
}
