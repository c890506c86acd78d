//! Finished pages: what they hold, and as which type of image.

use super::settings::MapReport;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use stonecut_io::materials::MapKind;
use stonecut_render::texture::BasisCoding;

/// Type of a page's image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PageKind {
    /// JPEG, where all images of the original are and nothing lets light through.
    Jpeg,
    /// PNG, with opacity where there is any.
    Png,
    /// PNG whose values are numbers, not colours: all channels, or one.
    Numbers(Option<u8>),
    /// The same as JPEG, each channel in full size.
    JpegNumbers(Option<u8>),
    /// KTX2 of UASTC.
    Uastc,
    /// The same of numbers.
    UastcNumbers,
    /// KTX2 of ETC1S.
    Etc1s,
}

impl PageKind {
    /// The kind of colours: KTX2 if it is wanted, otherwise JPEG where they are photographs.
    pub(super) fn of_colours(coding: Option<BasisCoding>, is_photographic: bool) -> PageKind {
        match coding {
            Some(BasisCoding::Uastc) => PageKind::Uastc,
            Some(BasisCoding::Etc1s) => PageKind::Etc1s,
            None if is_photographic => PageKind::Jpeg,
            None => PageKind::Png,
        }
    }

    /// The kind of numbers: as KTX2 always UASTC, which alone keeps directions; otherwise JPEG where all images of these in
    /// the original are.
    pub(super) fn of_numbers(
        coding: Option<BasisCoding>,
        is_photographic: bool,
        channel: Option<u8>,
    ) -> PageKind {
        match (coding, is_photographic) {
            (Some(_), _) => PageKind::UastcNumbers,
            (None, true) => PageKind::JpegNumbers(channel),
            (None, false) => PageKind::Numbers(channel),
        }
    }

    /// The ending of files.
    pub fn ending(self) -> &'static str {
        match self {
            PageKind::Jpeg | PageKind::JpegNumbers(_) => "jpg",
            PageKind::Png | PageKind::Numbers(_) => "png",
            PageKind::Uastc | PageKind::UastcNumbers | PageKind::Etc1s => "ktx2",
        }
    }

    /// The only channel that is written.
    pub(super) fn channel(self) -> Option<usize> {
        match self {
            PageKind::Numbers(channel) | PageKind::JpegNumbers(channel) => channel.map(usize::from),
            _ => None,
        }
    }

    /// The type of the file as the web names it.
    pub(super) fn mime(self) -> &'static str {
        match self.ending() {
            "jpg" => "image/jpeg",
            "png" => "image/png",
            _ => "image/ktx2",
        }
    }
}

/// A finished page.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Page {
    /// Its file.
    pub path: PathBuf,
    /// Its type.
    pub kind: PageKind,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Triangles of a page with one meaning of opacity: a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PagePart {
    /// Number of the page.
    pub page: u32,
    /// True if a share of the light passes; viewers draw that without depth.
    pub blends: bool,
}

/// Contents of pages besides colours and normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sheet {
    /// Emitted light.
    Emission,
    /// Roughness in green, share of metal in blue.
    Surface,
    /// The same with the shade of ambient light in red.
    ShadedSurface,
    /// Roughness.
    Roughness,
    /// Share of metal.
    Metallic,
}

impl Sheet {
    /// Roles of such an image in a material.
    pub fn roles(self) -> &'static [MapKind] {
        match self {
            Sheet::Emission => &[MapKind::Emissive],
            Sheet::Surface => &[MapKind::MetallicRoughness],
            Sheet::ShadedSurface => &[MapKind::MetallicRoughness, MapKind::Occlusion],
            Sheet::Roughness => &[MapKind::Roughness],
            Sheet::Metallic => &[MapKind::Metallic],
        }
    }

    /// The end of the names of its files.
    pub fn suffix(self) -> &'static str {
        match self {
            Sheet::Emission => "_emission",
            Sheet::Surface | Sheet::ShadedSurface => "_surface",
            Sheet::Roughness => "_roughness",
            Sheet::Metallic => "_metal",
        }
    }

    /// The only channel that counts.
    pub(super) fn channel(self) -> Option<u8> {
        match self {
            Sheet::Roughness => Some(1),
            Sheet::Metallic => Some(2),
            Sheet::Emission | Sheet::Surface | Sheet::ShadedSurface => None,
        }
    }
}

/// Pages of one kind.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SheetPages {
    /// Contents of the pages.
    pub sheet: Sheet,
    /// One for each page of the bake.
    pub pages: Vec<Page>,
}

impl SheetPages {
    pub(super) fn report(&self, bytes: u64) -> MapReport {
        let names: Vec<&str> = self.sheet.roles().iter().map(|kind| kind.name()).collect();
        MapReport { kind: names.join(", "), bytes }
    }
}
