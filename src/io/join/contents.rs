//! Contents of tiles: glTF, batched meshes (b3dm) and composites (cmpt) as parts; what has no mesh is named.
//!
//! Only headers and the small tables beside a mesh are read; the mesh itself is when its turn comes.

use super::{InputSet, MeshPart, affine};
use crate::ply::raw::RawFile;
use serde::Deserialize;
use std::ops::Range;
use std::path::Path;
use stonecut_mesh::placing::{Placing, Y_TO_Z};
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Axis that points upwards in the glTF of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UpAxis {
    X,
    Y,
    Z,
}

/// The frame of a tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileFrame {
    /// From the tile to where the tree stands, by columns.
    pub(super) map: [f64; 16],
    /// True if finer tiles take the place of its content.
    pub(super) replaces: bool,
    pub(super) up: UpAxis,
}

/// Bytes of the header of a batched mesh, and of a composite.
const MESH_HEAD: usize = 28;
const COMPOSITE_HEAD: u64 = 16;
/// Composites in composites.
const DEEPEST: usize = 8;
/// Bytes of the table beside a mesh that says where it counts from.
const MOST_TABLE_BYTES: u64 = 16 << 20;

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE", default)]
struct FeatureTable {
    #[serde(rename = "RTC_CENTER")]
    rtc_center: Option<Center>,
}

/// Three numbers, or their place behind the table.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Center {
    Numbers([f64; 3]),
    Place {
        #[serde(rename = "byteOffset")]
        byte_offset: u64,
    },
}

/// Words on files that a web server would unpack.
pub(super) const PACKED: &str =
    "this file of a tree is compressed (gzip); unpack the tree first (npx 3d-tiles-tools ungzip)";

/// Reads the beginning of a regular file; returns the number of bytes.
pub(super) fn first_bytes(path: &Path, first: &mut [u8]) -> Result<usize> {
    let file = RawFile::open(path)?;
    file.read_at_most(first, 0)
}

/// Returns whether a content is a further file of a tree, by its name or its first bytes.
pub(super) fn begins_with_json(path: &Path, first: &[u8]) -> bool {
    let name = path.extension().map(|end| end.to_string_lossy().to_ascii_lowercase());
    match name.as_deref() {
        Some("json") => true,
        Some("gltf" | "geojson") => false,
        _ => {
            first.trim_ascii_start().starts_with(b"{")
                && !first.windows(7).any(|word| word == b"buffers" || word == b"\"scene\"")
        }
    }
}

/// Adds the meshes of a content; returns whether there were any.
pub(super) fn add_content(path: &Path, at: &TileFrame, set: &mut InputSet) -> Result<bool> {
    let file = RawFile::open(path)?;
    let content = ContentFile { file: &file, path, at };
    let before = set.parts.len();
    let mut first = [0; 4];
    let n = first_bytes(path, &mut first)?;
    let is_packed =
        first.starts_with(&[0x1f, 0x8b]) || first.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]);
    match &first[..n] {
        b"b3dm" | b"i3dm" | b"pnts" | b"cmpt" | b"vctr" | b"geom" => {
            content.add_tile(0..file.len(), set, 0)?;
        }
        // A tile under its old name is not known before it is unpacked.
        _ if is_packed && !path.to_string_lossy().contains(".gl") => {
            return Err(file.bad(PACKED));
        }
        _ if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("geojson")) => {
            lose(set, "contents of features (geojson)");
        }
        _ => content.add_mesh(None, None, set),
    }
    Ok(set.parts.len() > before)
}

fn lose(set: &mut InputSet, what: &str) {
    let loss = Loss::new(LossKind::Elements, what, "only meshes are read: left out");
    set.losses.lose(loss);
}

struct ContentFile<'a> {
    file: &'a RawFile,
    path: &'a Path,
    at: &'a TileFrame,
}

impl ContentFile<'_> {
    fn add_mesh(&self, bytes: Option<Range<u64>>, center: Option<[f64; 3]>, set: &mut InputSet) {
        let mut placing = Placing::default();
        match self.at.up {
            UpAxis::Y => placing.then(&Y_TO_Z),
            UpAxis::X => placing.then(&affine::X_TO_Z),
            UpAxis::Z => {}
        }
        placing.turns_up = self.at.up == UpAxis::Y;
        if let Some(center) = center {
            placing.then(&affine::shift(center));
        }
        placing.then(&self.at.map);
        set.parts.push(MeshPart { path: self.path.to_path_buf(), placing, bytes });
    }

    /// Adds what lies in a range of the file and begins with the letters of a kind of tile.
    fn add_tile(&self, range: Range<u64>, set: &mut InputSet, depth: usize) -> Result<()> {
        let cut_off = || {
            let at = range.start;
            self.file.bad(format!("byte offset {at}: the tile was cut off; fetch it again"))
        };
        let mut head = [0; MESH_HEAD];
        let n = self.file.read_at_most(&mut head, range.start)?;
        let word = |at: usize| {
            u64::from(u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]))
        };
        let end = range.start + word(8);
        if n < COMPOSITE_HEAD as usize || end > range.end || word(8) < COMPOSITE_HEAD {
            return Err(cut_off());
        }
        match &head[..4] {
            b"cmpt" => {
                if depth >= DEEPEST {
                    return Err(self
                        .file
                        .bad("composites of composites of composites: unpack them"));
                }
                let mut at = range.start + COMPOSITE_HEAD;
                for _ in 0..word(12) {
                    let mut size = [0; 12];
                    if at + 12 > end || self.file.read_at_most(&mut size, at)? < 12 {
                        return Err(cut_off());
                    }
                    let size =
                        u64::from(u32::from_le_bytes([size[8], size[9], size[10], size[11]]));
                    if size < COMPOSITE_HEAD || at + size > end {
                        return Err(cut_off());
                    }
                    self.add_tile(at..at + size, set, depth + 1)?;
                    at += size;
                }
            }
            b"b3dm" => {
                if n < MESH_HEAD {
                    return Err(cut_off());
                }
                self.add_batched([word(12), word(16), word(20), word(24)], range.start..end, set)?;
            }
            b"i3dm" => lose(set, "tiles of instances (i3dm)"),
            b"pnts" => lose(set, "tiles of points (pnts)"),
            _ => lose(set, "tiles of vectors (vctr, geom)"),
        }
        Ok(())
    }

    /// Adds a batched mesh: the sizes of its four tables, then these, then a GLB.
    fn add_batched(&self, sizes: [u64; 4], range: Range<u64>, set: &mut InputSet) -> Result<()> {
        let [features, binary, batches, batch_binary] = sizes;
        let table = range.start + MESH_HEAD as u64;
        let full = table + features + binary + batches + batch_binary;
        // Before version 1 the header had 20 or 24 bytes.
        let old = [(20, sizes[0] + sizes[1]), (24, sizes[1] + sizes[2])];
        let old = old.map(|(head, tables)| range.start + head + tables);
        let is_mesh = |at: u64| -> Result<bool> {
            let mut first = [0; 4];
            Ok(at + 20 <= range.end
                && self.file.read_at_most(&mut first, at)? == 4
                && &first == b"glTF")
        };
        let mut found = None;
        for at in [full, old[0], old[1]] {
            if found.is_none() && is_mesh(at)? {
                found = Some(at);
            }
        }
        let Some(mesh) = found else {
            return Err(self.file.bad(format!(
                "byte offset {full}: a tile (b3dm) without a GLB in it; it was cut off, or made before 3D Tiles 1.0 \
                 (npx 3d-tiles-tools upgrade)"
            )));
        };
        let mut center = None;
        if mesh == full && features > 0 {
            if features + binary > MOST_TABLE_BYTES {
                return Err(self.file.bad(format!("a table of {features} bytes before the mesh")));
            }
            let mut text = vec![0; (features + binary) as usize];
            self.file.read_exact_at(&mut text, table)?;
            let (text, numbers) = text.split_at(features as usize);
            let fail = |e| self.file.bad(format!("its feature table is not JSON: {e}"));
            let known: FeatureTable = serde_json::from_slice(text).map_err(fail)?;
            center = match known.rtc_center {
                None => None,
                Some(Center::Numbers(center)) => Some(center),
                Some(Center::Place { byte_offset }) => {
                    let at = usize::try_from(byte_offset).unwrap_or(usize::MAX);
                    let bytes = numbers.get(at..).and_then(|rest| rest.get(..12));
                    let Some(bytes) = bytes else {
                        return Err(self.file.bad("RTC_CENTER lies outside of its table"));
                    };
                    let number =
                        |n: usize| f32::from_le_bytes([0, 1, 2, 3].map(|i| bytes[4 * n + i]));
                    Some([0, 1, 2].map(|n| f64::from(number(n))))
                }
            };
            if center.is_some_and(|center| !center.iter().all(|x| x.is_finite())) {
                return Err(self.file.bad("RTC_CENTER is not finite"));
            }
        }
        if mesh != full || batches > 0 {
            let loss = Loss::new(LossKind::Attributes, "tables of batches (b3dm)", "not carried");
            set.losses.lose(loss.notice());
        }
        let mut size = [0; 12];
        self.file.read_exact_at(&mut size, mesh)?;
        let size = u64::from(u32::from_le_bytes([size[8], size[9], size[10], size[11]]));
        if size < 20 || mesh + size > range.end {
            return Err(self.file.bad(format!(
                "byte offset {mesh}: the GLB in this tile should have {size} bytes, {} are there; fetch it again",
                range.end - mesh
            )));
        }
        self.add_mesh(Some(mesh..mesh + size), center, set);
        Ok(())
    }
}
