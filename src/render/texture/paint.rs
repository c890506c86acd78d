//! Looks of a material and of the pages of a bake: factors, and the images that they multiply.

use super::map_use::MapUse;
use serde::{Deserialize, Serialize};
use stonecut_io::materials::MapKind;

/// Colour of a material.
#[derive(Clone, Debug)]
pub struct Paint {
    /// Linear light, and opacity.
    pub factor: [f32; 4],
    /// Image of colours.
    pub base: Option<MapUse>,
    /// Image of opacity.
    pub opacity: Option<MapUse>,
    /// Directions in tangent space.
    pub normal: Option<MapUse>,
    /// Images of light, roughness, metal and shade.
    pub others: Vec<(MapKind, MapUse)>,
    /// Emitted light, multiplied with its image.
    pub emitted: [f32; 3],
    /// Roughness and share of metal, multiplied with their images.
    pub surface: [f32; 2],
    /// Opaque from this value on, otherwise not there.
    pub mask: Option<f32>,
    /// True if light does not matter.
    pub unlit: bool,
}

impl Paint {
    /// Its images.
    pub fn maps(&self) -> impl Iterator<Item = &MapUse> {
        let first = [&self.base, &self.opacity, &self.normal].into_iter().flatten();
        first.chain(self.others.iter().map(|(_, map)| map))
    }

    /// Its image of a kind.
    pub fn map(&self, kind: MapKind) -> Option<&MapUse> {
        match kind {
            MapKind::Base => self.base.as_ref(),
            MapKind::Opacity => self.opacity.as_ref(),
            MapKind::Normal => self.normal.as_ref(),
            _ => self.others.iter().find(|(own, _)| *own == kind).map(|(_, map)| map),
        }
    }

    /// The image with the most texels for a length in its coordinates.
    pub fn densest(&self) -> Option<&MapUse> {
        let denser =
            |a: &&MapUse, b: &&MapUse| a.texels_per_coordinate.total_cmp(&b.texels_per_coordinate);
        self.maps().max_by(denser)
    }
}

/// Look of the pages of a bake, besides their images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finish {
    /// Colour as screens show it, and opacity; they multiply the pages.
    pub base: [f32; 4],
    /// Opaque from this value on, where opacity is a mask.
    pub mask: Option<f32>,
    /// True if a share of the light passes, at some places at least.
    pub blends: bool,
    /// True if both sides are drawn.
    pub two_sided: bool,
    /// True if light does not matter.
    pub unlit: bool,
    /// Share of metal.
    pub metallic: Option<f32>,
    /// Roughness.
    pub roughness: Option<f32>,
    /// Emitted light as screens show it.
    #[serde(default)]
    pub emissive: Option<[f32; 3]>,
    /// Factor of the emitted light.
    #[serde(default = "one")]
    pub emissive_strength: f32,
}

fn one() -> f32 {
    1.0
}
