//! Implicit tiles of 3D Tiles 1.1: quadtrees and octrees whose tiles are bits in subtree files.

use super::contents::TileFrame;
use super::tree_folder::TreeFolder;
use crate::ply::raw::RawFile;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use stonecut_system::error::{Error, Result};

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Implicit {
    subdivision_scheme: String,
    subtree_levels: u32,
    #[serde(alias = "maximumLevel")]
    available_levels: u32,
    subtrees: Subtrees,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Subtrees {
    uri: String,
}

/// The JSON of a subtree file.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Subtree {
    buffers: Vec<Buffer>,
    buffer_views: Vec<View>,
    tile_availability: Bits,
    #[serde(deserialize_with = "one_or_many")]
    content_availability: Vec<Bits>,
    child_subtree_availability: Bits,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Buffer {
    uri: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct View {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Bits {
    constant: Option<u8>,
    #[serde(alias = "bufferView")]
    bitstream: Option<usize>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum OneOrMany {
    One(Bits),
    Many(Vec<Bits>),
}

fn one_or_many<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Vec<Bits>, D::Error> {
    Ok(match OneOrMany::deserialize(from)? {
        OneOrMany::One(bits) => vec![bits],
        OneOrMany::Many(bits) => bits,
    })
}

/// Bytes of a subtree file, and of a buffer beside it.
const MOST_BYTES: u64 = 64 << 20;
/// Tiles of a subtree.
const MOST_TILES: u64 = 1 << 24;
/// Levels of a tree at most, so that places fit into 64 bits.
const MOST_LEVELS: u32 = 21;

/// A place in the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    level: u32,
    xyz: [u64; 3],
}

/// Adds the finest contents of an implicit tree; returns whether there were any.
pub(super) fn add(
    files: &mut TreeFolder,
    file: &Path,
    (implicit, contents): (&Implicit, &[String]),
    at: TileFrame,
) -> Result<bool> {
    let axes = match implicit.subdivision_scheme.as_str() {
        "QUADTREE" => 2,
        "OCTREE" => 3,
        other => {
            let what =
                format!("subdivisionScheme '{}': QUADTREE or OCTREE", other.escape_default());
            return Err(Error::bad_input(file, what));
        }
    };
    let levels = implicit.subtree_levels;
    let n_tiles = tiles_above(levels.min(MOST_LEVELS), axes);
    if levels == 0 || levels > MOST_LEVELS || n_tiles > MOST_TILES {
        let what =
            format!("subtreeLevels {levels}: from 1 on, at most {MOST_TILES} tiles in a subtree");
        return Err(Error::bad_input(file, what));
    }
    let tree = ImplicitTree { implicit, contents, axes, file };
    tree.subtree(files, Place { level: 0, xyz: [0; 3] }, at)
}

/// Tiles of all levels above one.
fn tiles_above(level: u32, axes: u32) -> u64 {
    ((1u64 << (axes * level).min(62)) - 1) / ((1 << axes) - 1)
}

struct ImplicitTree<'a> {
    implicit: &'a Implicit,
    contents: &'a [String],
    axes: u32,
    file: &'a Path,
}

impl ImplicitTree<'_> {
    /// The file of a template at a place.
    fn at(&self, files: &TreeFolder, template: &str, place: Place) -> Result<PathBuf> {
        let [x, y, z] = place.xyz;
        let values =
            BTreeMap::from([("level", u64::from(place.level)), ("x", x), ("y", y), ("z", z)]);
        files.resolve(self.file, &filled(template, &values))
    }

    /// A tile below another one, by its number in Morton order.
    fn below(&self, root: Place, level: u32, morton: u64) -> Place {
        let mut xyz = root.xyz.map(|x| x << level);
        for bit in 0..level * self.axes {
            xyz[(bit % self.axes) as usize] |= (morton >> bit & 1) << (bit / self.axes);
        }
        Place { level: root.level + level, xyz }
    }

    fn subtree(&self, files: &mut TreeFolder, root: Place, at: TileFrame) -> Result<bool> {
        let levels = self.implicit.subtree_levels;
        if root.level + levels > MOST_LEVELS.max(levels) {
            let what = format!("an implicit tree of more than {MOST_LEVELS} levels");
            return Err(Error::bad_input(self.file, what));
        }
        let path = self.at(files, &self.implicit.subtrees.uri, root)?;
        files.note_file(&path)?;
        let known = SubtreeFile::read(files, &path)?;
        let n_children = 1u64 << self.axes;
        let (mut finer, mut found) = (Vec::new(), false);
        for morton in 0..1u64 << (self.axes * levels) {
            let mut has = false;
            if known.bit(&known.json.child_subtree_availability, morton)? {
                has = self.subtree(files, self.below(root, levels, morton), at)?;
            }
            finer.push(has);
        }
        for level in (0..levels).rev() {
            let first = tiles_above(level, self.axes);
            let mut has = Vec::with_capacity(1 << (self.axes * level));
            for morton in 0..1u64 << (self.axes * level) {
                let children = morton * n_children..(morton + 1) * n_children;
                let has_finer = children.clone().any(|child| finer[child as usize]);
                let place = self.below(root, level, morton);
                let mut own = has_finer;
                if !(at.replaces && has_finer)
                    && known.bit(&known.json.tile_availability, first + morton)?
                {
                    for (bits, template) in
                        known.json.content_availability.iter().zip(self.contents)
                    {
                        if known.bit(bits, first + morton)? {
                            let path = self.at(files, template, place)?;
                            own |= files.content(&path, &at)?;
                        }
                    }
                }
                found |= own;
                has.push(own);
            }
            finer = has;
        }
        Ok(found)
    }
}

/// Values of an address that stands for many: `{level}`, `{x}`, `{y}`, `{z}`.
pub(super) fn filled(template: &str, values: &BTreeMap<&str, u64>) -> String {
    let mut out = template.to_owned();
    for (name, value) in values {
        out = out.replace(&format!("{{{name}}}"), &value.to_string());
    }
    out
}

/// A subtree file with its buffers.
struct SubtreeFile {
    path: PathBuf,
    json: Subtree,
    buffers: Vec<Vec<u8>>,
}

impl SubtreeFile {
    fn read(files: &TreeFolder, path: &Path) -> Result<SubtreeFile> {
        let file = RawFile::open(path)?;
        let whole = |file: &RawFile| -> Result<Vec<u8>> {
            if file.len() > MOST_BYTES {
                return Err(file.bad(format!("a subtree of more than {MOST_BYTES} bytes")));
            }
            let mut bytes = vec![0; file.len() as usize];
            file.read_exact_at(&mut bytes, 0)?;
            Ok(bytes)
        };
        let bytes = whole(&file)?;
        let (json, rest): (&[u8], &[u8]) = match bytes.strip_prefix(b"subt") {
            None => (&bytes, &[]),
            Some(_) => {
                let n = bytes.get(8..16).and_then(|n| n.try_into().ok()).map(u64::from_le_bytes);
                let end = n.and_then(|n| usize::try_from(n).ok()?.checked_add(24));
                end.and_then(|end| Some((bytes.get(24..end)?, bytes.get(end..)?)))
                    .ok_or_else(|| file.bad("a subtree that was cut off; fetch it again"))?
            }
        };
        let json: Subtree = serde_json::from_slice(json)
            .map_err(|e| file.bad(format!("its JSON is not that of a subtree: {e}")))?;
        let mut buffers = Vec::new();
        for buffer in &json.buffers {
            buffers.push(match &buffer.uri {
                None => rest.to_vec(),
                Some(uri) => whole(&RawFile::open(&files.resolve(path, uri)?)?)?,
            });
        }
        Ok(SubtreeFile { path: path.to_path_buf(), json, buffers })
    }

    /// The bit of a number; of what is not said, 0.
    fn bit(&self, bits: &Bits, number: u64) -> Result<bool> {
        let Some(view) = bits.bitstream else { return Ok(bits.constant == Some(1)) };
        let byte = self.json.buffer_views.get(view).and_then(|view| {
            let at = usize::try_from(number / 8).ok().filter(|&at| at < view.byte_length)?;
            self.buffers.get(view.buffer)?.get(view.byte_offset.checked_add(at)?)
        });
        match byte {
            Some(byte) => Ok(byte >> (number % 8) & 1 == 1),
            None => Err(Error::bad_input(
                &*self.path,
                format!("bit {number} of the subtree lies outside of its buffer; fetch it again"),
            )),
        }
    }
}
