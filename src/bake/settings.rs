//! Settings, means and findings of a bake, for all files of this room.

use serde::{Deserialize, Serialize};
use std::path::Path;
use stonecut_io::ply::MeshSource;
use stonecut_render::texture::{BasisCoding, Palette, Purpose, WantedMaps};
use stonecut_store::stage_context::StageContext;
use stonecut_system::disk::Disk;
use stonecut_system::losses::Ledger;
use stonecut_system::progress::Progress;

/// Texels around every chart that show its own colours at most, so that charts are twice as far apart.
///
/// At 1/8 of the size a texel is 8 wide, and a point between two of them mixes what is up to 12 away.
pub(super) const PADDING: u32 = 12;

/// No chart.
pub(super) const NONE: u32 = u32::MAX;

/// `PADDING`, less on pages so small that little else would fit.
pub(super) fn padding(page_size: u32) -> u32 {
    PADDING.min(page_size / 16)
}

/// Settings of a bake that change its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Side of a page in texels.
    pub page_size: u32,
    /// Pages at most; as many as the original's texel density takes if `None`.
    pub most_pages: Option<u32>,
    /// Triangles per cell of the original.
    pub cell_triangles: u64,
    /// With normal maps.
    pub normals: bool,
    /// Maps of the original that are baked besides its colours.
    pub beside: WantedMaps,
    /// KTX2 files with this coding instead of JPEG and PNG.
    pub coding: Option<BasisCoding>,
    /// True if the colours of the result's vertices multiply the pages, as glTF has it.
    pub colours_multiply: bool,
}

impl Options {
    /// Texels of a page at most.
    pub(super) fn page_texels(&self) -> u64 {
        u64::from(self.page_size) * u64::from(self.page_size)
    }

    /// The same with opacity as texels have it; decoding takes at most `most_bytes`.
    pub(super) fn settled_palette(&self, original: &MeshSource, most_bytes: u64) -> Palette {
        let materials = original.materials().map(|all| &**all);
        Palette::settled(materials, Purpose::Bake(self.beside), most_bytes)
    }

    /// Materials and images of an original as these settings use them.
    pub(super) fn palette(&self, original: &MeshSource) -> Palette {
        let materials = original.materials().map(|all| &**all);
        Palette::new(materials, Purpose::Bake(self.beside))
    }
}

/// Memory and places of a bake.
#[derive(Clone, Copy, Debug)]
pub struct Means<'a> {
    /// Memory for everything, in bytes.
    pub memory_bytes: u64,
    /// Worker threads.
    pub threads: usize,
    /// Folder for temporary data without names.
    pub temp_dir: &'a Path,
    /// The disk that pages are written through.
    pub disk: &'a Disk,
    /// Counts triangles of the original, then texels; asks to stop.
    pub progress: &'a Progress,
}

impl Means<'_> {
    /// The same with no more threads than can make KTX2 files of `texels` each at once.
    pub(super) fn coding(self, coding: Option<BasisCoding>, texels: u64) -> Self {
        let bytes = work_bytes(coding, texels);
        let fitting = self.memory_bytes.checked_div(bytes).unwrap_or(u64::MAX).max(1);
        Means { threads: self.threads.min(usize::try_from(fitting).unwrap_or(usize::MAX)), ..self }
    }
}

/// Bytes of memory while a KTX2 file of `texels` is made; none without a coding.
pub(super) fn work_bytes(coding: Option<BasisCoding>, texels: u64) -> u64 {
    coding.map_or(0, |coding| coding.work_bytes() * texels + CODER_BYTES)
}

/// Bytes of the encoder of KTX2 besides those of texels.
const CODER_BYTES: u64 = 24 << 20;

impl<'a> From<&'a StageContext<'a>> for Means<'a> {
    fn from(run: &'a StageContext<'a>) -> Means<'a> {
        Means {
            memory_bytes: run.memory_bytes,
            threads: run.threads,
            temp_dir: run.job.folder(),
            disk: run.disk(),
            progress: run.progress,
        }
    }
}

/// Findings of a bake.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BakeReport {
    /// Charts of the result.
    pub charts: u64,
    /// Pages.
    pub pages: u64,
    /// Side of a page in texels; pages that are not full are smaller.
    pub page_size: u32,
    /// Texels of all pages.
    pub texels: u64,
    /// Texels that show the surface.
    pub covered_texels: u64,
    /// Texels per input unit of length.
    pub texel_density: f64,
    /// The same of the original's images, by area; absent where it has none.
    pub original_texel_density: Option<f64>,
    /// Bytes of the files of colours.
    pub bytes: u64,
    /// Pages besides those of colours and normals.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub maps: Vec<MapReport>,
    /// Normal maps, one a page; absent without any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normals: Option<NormalReport>,
    /// Missing, damaged and lost parts, a line each; deprecated, `losses` says more.
    pub notes: Vec<String>,
    /// Missing, damaged and lost parts.
    #[serde(default)]
    pub losses: Ledger,
}

/// Pages of one kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MapReport {
    /// Contents, as `image of emitted light`.
    pub kind: String,
    /// Bytes of their files.
    pub bytes: u64,
}

/// Findings about normal maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NormalReport {
    /// Source of the normals: `input` (its vertices have them) or `faces` (computed from the input's faces).
    pub source: NormalSource,
    /// Mean angle between the map and the result's own normals, in degrees, over all texels.
    pub mean_degrees: f64,
    /// Bytes of the maps' files.
    pub bytes: u64,
}

/// Source of normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NormalSource {
    /// Vertices of the input.
    Input,
    /// Faces of the input.
    #[default]
    Faces,
}

/// Part of a page and texture coordinates of a triangle of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Number of the part.
    pub part: u32,
    /// Coordinates of the three corners, from 0 to 1, v upwards.
    pub uv: [[f32; 2]; 3],
}

impl Corner {
    /// Bytes of a record.
    pub const BYTES: usize = 28;

    /// Reads a record.
    pub fn read(bytes: &[u8; Self::BYTES]) -> Corner {
        let words = bytes.as_chunks::<4>().0;
        let float = |i: usize| f32::from_le_bytes(words[1 + i]);
        Corner {
            part: u32::from_le_bytes(words[0]),
            uv: [0, 2, 4].map(|i| [float(i), float(i + 1)]),
        }
    }

    /// Appends the record.
    pub fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.part.to_le_bytes());
        self.uv.as_flattened().iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
    }
}

/// Bytes of a triangle in a file of tangents: four numbers of 16 bits a corner.
pub const TANGENT_BYTES: usize = 24;
