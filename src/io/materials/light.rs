//! Materials that are seen by their own light alone: black ones with an image of emitted light, as scans without lamps and
//! exports of games are. What has a place for colours and none for emitted light shows that light as the colour.

use super::description::{Alpha, MapKind, Material, Materials};
use super::losses::EMITTED;
use crate::output_format::OutputKind;
use std::borrow::Cow;
use std::sync::Arc;
use stonecut_system::losses::{Ledger, Loss, LossKind};

/// Components of a black colour at most, as screens show it: 0.4 % of the light.
const BLACK: f32 = 0.05;

impl Material {
    /// Emitted light, as screens show it, which its image is multiplied with.
    pub fn light(&self) -> [f32; 3] {
        let of_image = if self.map(MapKind::Emissive).is_some() { 1.0 } else { 0.0 };
        self.emissive.unwrap_or([of_image; 3])
    }

    /// True if nothing but its light is seen. What needs no lamps (`unlit`) emits none (KHR_materials_unlit).
    fn glows(&self) -> bool {
        self.base[..3].iter().all(|x| *x <= BLACK)
            && !self.unlit
            && self.light().iter().any(|x| *x > BLACK)
    }
}

/// Materials for an output, in PLY with light as the colour of what nothing else is seen of.
pub(super) fn shown_in(
    kind: OutputKind,
    materials: Arc<Materials>,
    losses: &mut Ledger,
) -> Arc<Materials> {
    match materials.shown() {
        Cow::Owned(shown) if kind == OutputKind::Ply => {
            materials.light_as_colour().into_iter().for_each(|loss| losses.lose(loss));
            Arc::new(shown)
        }
        _ => materials,
    }
}

impl Materials {
    /// The same with light as the colour of materials that nothing else is seen of.
    pub fn shown(&self) -> Cow<'_, Materials> {
        if !self.list.iter().any(Material::glows) {
            return Cow::Borrowed(self);
        }
        let mut out = self.clone();
        let glowing = self.list.iter().zip(&mut out.list).filter(|(own, _)| own.glows());
        for (own, to) in glowing {
            let (light, opacity) = (own.light(), own.base[3]);
            let is_clear = own.alpha != Alpha::Opaque && self.has_clear_base(own);
            to.maps.retain(|map| match map.kind {
                MapKind::Base => is_clear && own.map(MapKind::Opacity).is_none(),
                _ => true,
            });
            for map in &mut to.maps {
                map.kind = match map.kind {
                    MapKind::Base => MapKind::Opacity,
                    MapKind::Emissive => MapKind::Base,
                    other => other,
                };
            }
            // The light's own opacity means nothing.
            if to.alpha == Alpha::Plain && to.map(MapKind::Opacity).is_none() && opacity == 1.0 {
                to.alpha = Alpha::Opaque;
            }
            to.base[..3].copy_from_slice(&light.map(|x| x.min(1.0)));
            (to.emissive, to.emissive_strength, to.unlit) = (None, 1.0, true);
        }
        Cow::Owned(out)
    }

    /// The remark that the light of some materials became their colour.
    pub fn light_as_colour(&self) -> Option<Loss> {
        let mut glowing = self.list.iter().filter(|material| material.glows());
        let first = format!("material '{}'", glowing.next()?.name);
        let n = 1 + glowing.count() as u64;
        let loss = Loss::new(LossKind::Materials, EMITTED, "taken for the colour, which is black");
        Some(loss.count(n).example(first).notice())
    }
}
