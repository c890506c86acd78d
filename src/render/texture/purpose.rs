//! Uses of a palette: the images that each looks up, and the meaning of their values.

use stonecut_io::materials::{Alpha, MapKind, Material};

/// Images without which a mesh has no colours.
pub const SEEN: [MapKind; 2] = [MapKind::Base, MapKind::Opacity];

/// Images of roughness, metal and shade.
pub const SURFACE: [MapKind; 4] =
    [MapKind::Occlusion, MapKind::MetallicRoughness, MapKind::Roughness, MapKind::Metallic];

/// Images besides colour and directions that a new texture has pages for.
pub(super) const BESIDE: [MapKind; 5] = [
    MapKind::Emissive,
    MapKind::Occlusion,
    MapKind::MetallicRoughness,
    MapKind::Roughness,
    MapKind::Metallic,
];

/// Use of a palette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A new texture with maps besides colour: an image that does not fit is refused; what all materials share is left to
    /// the new ones.
    Bake(WantedMaps),
    /// Pictures: an image that does not fit is a note; normal maps are used, too.
    View,
    /// Pictures without colours: normal maps alone.
    Relief,
}

/// Maps besides colour that a new texture gets where the input has them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WantedMaps {
    /// Directions.
    pub normals: bool,
    /// Emitted light, roughness and metal.
    pub surface: bool,
    /// Shade of ambient light.
    pub occlusion: bool,
}

impl Purpose {
    /// Maps besides colour that are looked up.
    pub(super) fn beside(self) -> WantedMaps {
        match self {
            Purpose::Bake(beside) => beside,
            Purpose::View | Purpose::Relief => {
                WantedMaps { normals: true, ..WantedMaps::default() }
            }
        }
    }

    /// True if images of this kind are looked up.
    pub(super) fn uses(self, kind: MapKind) -> bool {
        use MapKind::{Emissive, Metallic, MetallicRoughness, Roughness};
        match kind {
            MapKind::Base | MapKind::Opacity => self != Purpose::Relief,
            MapKind::Normal => self.beside().normals,
            Emissive | MetallicRoughness | Roughness | Metallic => self.beside().surface,
            MapKind::Occlusion => self.beside().occlusion,
            MapKind::Specular | MapKind::Ambient | MapKind::Bump => false,
        }
    }
}

/// Meaning of an image's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Meaning {
    /// Opacity does not count.
    pub is_opaque: bool,
    /// Values are numbers, not colours.
    pub is_plain: bool,
}

/// The meaning of a material's image of this kind. A JPEG has no opacity.
pub(super) fn meaning(material: &Material, kind: MapKind, is_jpeg: bool) -> Meaning {
    let is_opaque = match kind {
        MapKind::Base => material.alpha == Alpha::Opaque,
        kind => kind != MapKind::Opacity,
    };
    Meaning { is_opaque: is_opaque && !is_jpeg, is_plain: !kind.is_colour() }
}
