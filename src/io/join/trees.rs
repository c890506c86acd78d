//! Parts out of trees of tiles that other programs made: 3D Tiles 1.0 and 1.1, the finest cut.
//!
//! Of a tile with `REPLACE` the content counts where nothing below it has any; of one with `ADD` it always does. JSON is
//! weighed before it is parsed; bounds of tiles and errors are not looked at. docs/design/inputs.md, "Trees".

use super::contents::{PACKED, TileFrame, UpAxis, begins_with_json, first_bytes};
use super::implicit::{self, Implicit};
use super::limits::hold;
use super::tree_folder::TreeFolder;
use super::{InputSet, affine};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::path::{Path, PathBuf};
use stonecut_system::disk::{open_input, read_regular};
use stonecut_system::error::{Error, Result};

/// Bytes of a JSON file at most.
const MOST_JSON_BYTES: u64 = 1 << 30;
/// Bytes that an object of JSON comes to, once parsed; a tile has several.
const OBJECT_BYTES: u64 = 640;
/// Deepest nesting of files in files, and of tiles in a file.
const DEEPEST: usize = 64;

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Tileset {
    asset: Asset,
    geometric_error: Option<IgnoredAny>,
    root: Option<Tile>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Asset {
    gltf_up_axis: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Tile {
    transform: Option<[f64; 16]>,
    refine: Option<String>,
    content: Option<Content>,
    contents: Vec<Content>,
    children: Vec<Tile>,
    implicit_tiling: Option<Implicit>,
    extensions: Extensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Extensions {
    #[serde(rename = "3DTILES_multiple_contents")]
    multiple: Option<Multiple>,
    #[serde(rename = "3DTILES_implicit_tiling")]
    implicit: Option<Implicit>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Multiple {
    #[serde(alias = "content")]
    contents: Vec<Content>,
}

/// Address of a content, as 3D Tiles 1.0 or what came before it names it.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Content {
    uri: Option<String>,
    url: Option<String>,
}

impl Content {
    fn address(&self) -> Option<&str> {
        self.uri.as_deref().or(self.url.as_deref()).filter(|text| !text.is_empty())
    }
}

/// Bytes at the beginning of a file of JSON in which the error of a tree is looked for.
const HEAD_BYTES: usize = 64 << 10;

/// Returns whether a file describes a tree of tiles: by its name, or as JSON that has an error of geometry near its beginning.
pub(super) fn is_tree(path: &Path) -> bool {
    let head = || {
        let mut head = vec![0; HEAD_BYTES];
        let n_bytes = first_bytes(path, &mut head).ok()?;
        head.truncate(n_bytes);
        Some(head)
    };
    let word = b"\"geometricError\"";
    let has_word = |head: Vec<u8>| head.windows(word.len()).any(|part| part == word);
    let is_json = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"));
    path.file_name().is_some_and(|name| name == "tileset.json")
        || is_json && path.is_file() && head().is_some_and(has_word)
}

/// The finest tiles of the tree that a `tileset.json` describes, each with the map to where the tree stands.
///
/// Errors: `BadInput` for what is not such a tree, circles, files that are missing, lie elsewhere or are not regular;
/// `NoMemory` for JSON or meshes that take more than `limit` bytes.
pub(super) fn parts_of(path: &Path, limit: u64) -> Result<InputSet> {
    let mut walk = Walk { files: TreeFolder::of(path, limit)?, limit, open: Vec::new() };
    walk.file(path, &affine::NONE, true)?;
    let set = walk.files.set;
    if set.parts.is_empty() {
        let lost = set.losses.lines().join("; ");
        let what = format!("this tree of tiles has no mesh that is read. {lost}");
        return Err(Error::bad_input(path, what.trim_end().to_owned()));
    }
    Ok(set)
}

/// The tree as far as it was walked.
struct Walk {
    files: TreeFolder,
    /// Memory for parsed JSON.
    limit: u64,
    /// Files of JSON that are being read, each named by the one before it.
    open: Vec<PathBuf>,
}

impl Walk {
    /// Adds the parts of a file of JSON, `outer` being the map from its frame; returns whether there were any.
    fn file(&mut self, path: &Path, outer: &[f64; 16], replaces: bool) -> Result<bool> {
        if self.open.len() >= DEEPEST {
            let what = format!("{DEEPEST} files of a tree one in the other; give a part of it");
            return Err(Error::bad_input(path, what));
        }
        let key = path.canonicalize().map_err(|e| Error::reading(path, "cannot read", e))?;
        if self.open.contains(&key) {
            return Err(Error::bad_input(path, "this file of the tree leads back to itself"));
        }
        let text = self.read(path)?;
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
        let bad = |what: String| Error::bad_input(path, what);
        let set: Tileset = serde_json::from_slice(text)
            .map_err(|e| bad(format!("its JSON is not that of a tree of 3D Tiles: {e}")))?;
        let (Some(root), Some(_)) = (&set.root, &set.geometric_error) else {
            return Err(bad("this JSON is not a tree of 3D Tiles: it has no root".to_owned()));
        };
        self.files.note_file(path)?;
        let up = match set.asset.gltf_up_axis.as_deref() {
            None | Some("Y" | "y") => UpAxis::Y,
            Some("Z" | "z") => UpAxis::Z,
            Some("X" | "x") => UpAxis::X,
            Some(other) => {
                return Err(bad(format!("gltfUpAxis '{}': X, Y or Z", other.escape_default())));
            }
        };
        self.open.push(key);
        let found = self.tile(path, root, TileFrame { map: *outer, replaces, up }, 0);
        self.open.pop();
        found
    }

    /// Reads a file of JSON that fits into memory.
    fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let n_bytes =
            open_input(path)?.metadata().map_err(|e| Error::reading(path, "cannot read", e))?.len();
        // What its objects come to is not known before it is read.
        hold(path, "the JSON of this tree of tiles", 3 * n_bytes, self.limit)?;
        let text = read_regular(path, MOST_JSON_BYTES)
            .map_err(|e| Error::reading(path, "cannot read", e))?;
        if text.starts_with(&[0x1f, 0x8b]) {
            return Err(Error::bad_input(path, PACKED));
        }
        let objects = text.iter().filter(|&&byte| byte == b'{').count() as u64;
        let needed = 3 * text.len() as u64 + OBJECT_BYTES * objects;
        hold(path, "the JSON of this tree of tiles", needed, self.limit)?;
        Ok(text)
    }

    /// Adds the finest contents of a tile and below; returns whether there were any.
    fn tile(&mut self, file: &Path, tile: &Tile, outer: TileFrame, depth: usize) -> Result<bool> {
        if depth > DEEPEST {
            let what = format!("tiles nest deeper than {DEEPEST}; give a part of the tree");
            return Err(Error::bad_input(file, what));
        }
        let map = match &tile.transform {
            Some(own) if !affine::is_finite(own) => {
                let what = "a transform of a tile is not one of finite numbers with a last row of 0, 0, 0, 1";
                return Err(Error::bad_input(file, what));
            }
            Some(own) => affine::inside(own, &outer.map),
            None => outer.map,
        };
        let replaces = match tile.refine.as_deref() {
            None => outer.replaces,
            Some(refine) => !refine.eq_ignore_ascii_case("ADD"),
        };
        let at = TileFrame { map, replaces, up: outer.up };
        if let Some(implicit) = tile.implicit_tiling.as_ref().or(tile.extensions.implicit.as_ref())
        {
            let addresses = self.addresses(tile, file)?;
            return implicit::add(&mut self.files, file, (implicit, &addresses), at);
        }
        let mut has_finer = false;
        for child in &tile.children {
            has_finer |= self.tile(file, child, at, depth + 1)?;
        }
        let mut found = has_finer;
        for address in self.addresses(tile, file)? {
            let path = self.files.resolve(file, &address)?;
            let mut first = [0; 64];
            let n = first_bytes(&path, &mut first)?;
            if begins_with_json(&path, &first[..n]) {
                found |= self.file(&path, &map, replaces)?;
            } else if !(replaces && has_finer) {
                found |= self.files.content(&path, &at)?;
            }
        }
        Ok(found)
    }

    /// Addresses of all contents of a tile.
    fn addresses(&self, tile: &Tile, file: &Path) -> Result<Vec<String>> {
        let multiple = tile.extensions.multiple.iter().flat_map(|multiple| &multiple.contents);
        let all = tile.content.iter().chain(&tile.contents).chain(multiple);
        all.map(|content| {
            content.address().map(str::to_owned).ok_or_else(|| {
                Error::bad_input(file, "a content of a tile has no uri; write the tree again")
            })
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// A GLB of one triangle, as far as headers are looked at.
    fn glb() -> Vec<u8> {
        let mut json = br#"{"asset":{"version":"2.0"}}"#.to_vec();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut out = b"glTF".to_vec();
        for n in [2, 20 + json.len() as u32, json.len() as u32] {
            out.extend(n.to_le_bytes());
        }
        out.extend(b"JSON");
        out.extend(json);
        out
    }

    /// A batched mesh with a feature table and a batch table.
    fn b3dm(features: &str, batches: &str) -> Vec<u8> {
        let mesh = glb();
        let sizes = [features.len(), 0, batches.len(), 0].map(|n| n as u32);
        let total = 28 + sizes.iter().sum::<u32>() + mesh.len() as u32;
        let mut out = b"b3dm".to_vec();
        [1, total].iter().chain(&sizes).for_each(|n: &u32| out.extend(n.to_le_bytes()));
        out.extend(features.as_bytes());
        out.extend(batches.as_bytes());
        out.extend(mesh);
        out
    }

    fn tree(files: &[(&str, Vec<u8>)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
        folder
    }

    fn tileset(root: Value) -> Vec<u8> {
        json!({"asset": {"version": "1.0"}, "geometricError": 9, "root": root}).to_string().into()
    }

    /// Names of the parts, and where each has the point 1, 2, 3.
    fn parts(folder: &tempfile::TempDir) -> Vec<(String, [f64; 3])> {
        let set = parts_of(&folder.path().join("tileset.json"), 64 << 20).unwrap();
        let name = |path: &Path| path.strip_prefix(folder.path()).unwrap().display().to_string();
        set.parts.iter().map(|p| (name(&p.path), p.placing.point([1.0, 2.0, 3.0]))).collect()
    }

    fn refusal(folder: &tempfile::TempDir) -> String {
        parts_of(&folder.path().join("tileset.json"), 64 << 20).unwrap_err().to_string()
    }

    #[test]
    fn the_finest_cut_of_replaced_and_added_tiles() {
        // A coarse root is replaced, but not where nothing is finer; an added one stays.
        let shift = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 100, 0, 0, 1];
        let root = json!({"refine": "REPLACE", "content": {"uri": "root.glb"}, "transform": shift,
            "boundingVolume": {"region": [0, 0, 1, 1, 0, 9]}, "geometricError": 8, "children": [
                {"content": {"uri": "./a%20b.glb"}, "boundingVolume": {"sphere": [0, 0, 0, 1]}, "geometricError": 0,
                 "children": [{"geometricError": 0}]},
                {"refine": "ADD", "contents": [{"uri": "b.glb"}], "transform": shift, "children": [
                    {"content": {"url": "sub/c.b3dm"}},
                    {"content": {"uri": "sub/more.json?v=1"}}]}]});
        let more = json!({"content": {"uri": "../d.glb"}, "extensions": {"3DTILES_multiple_contents":
            {"content": [{"uri": "e.glb"}]}}});
        let folder = tree(&[
            ("tileset.json", tileset(root)),
            ("root.glb", glb()),
            ("a b.glb", glb()),
            ("b.glb", glb()),
            ("d.glb", glb()),
            ("sub/e.glb", glb()),
            ("sub/c.b3dm", b3dm(r#"{"BATCH_LENGTH":0,"RTC_CENTER":[10,20,30]}"#, "{}")),
            ("sub/more.json", tileset(more)),
        ]);
        // y upwards becomes z upwards: 1, 2, 3 is 1, -3, 2.
        assert_eq!(
            parts(&folder),
            [
                ("a b.glb".to_owned(), [101.0, -3.0, 2.0]),
                ("sub/c.b3dm".to_owned(), [211.0, 17.0, 32.0]),
                ("d.glb".to_owned(), [201.0, -3.0, 2.0]),
                ("sub/e.glb".to_owned(), [201.0, -3.0, 2.0]),
                ("b.glb".to_owned(), [201.0, -3.0, 2.0]),
            ]
        );
        let set = parts_of(&folder.path().join("tileset.json"), 64 << 20).unwrap();
        assert_eq!(set.parts[1].bytes, Some(28 + 42 + 2..28 + 42 + 2 + glb().len() as u64));
        assert_eq!(set.found_in.len(), 2);
        assert!(set.losses.lines()[0].contains("tables of batches"), "{:?}", set.losses.lines());
    }

    #[test]
    fn composites_and_points_and_axes() {
        let inner = b3dm("{}", "");
        let mut composite = b"cmpt".to_vec();
        let mut points = b"pnts".to_vec();
        [1u32, 16, 0].iter().for_each(|n| points.extend(n.to_le_bytes()));
        let total = 16 + inner.len() + points.len();
        [1, total as u32, 2].iter().for_each(|n: &u32| composite.extend(n.to_le_bytes()));
        composite.extend(&inner);
        composite.extend(points);
        let text = json!({"asset": {"version": "1.0", "gltfUpAxis": "Z"}, "geometricError": 1,
            "root": {"content": {"uri": "all.cmpt"}}});
        let folder = tree(&[("tileset.json", text.to_string().into()), ("all.cmpt", composite)]);
        assert_eq!(parts(&folder), [("all.cmpt".to_owned(), [1.0, 2.0, 3.0])]);
        let set = parts_of(&folder.path().join("tileset.json"), 64 << 20).unwrap();
        assert!(set.losses.lines()[0].contains("pnts"), "{:?}", set.losses.lines());
    }

    #[test]
    fn an_implicit_quadtree() {
        // Two levels, all of the first, two tiles of the second: the root is replaced by these.
        let json = json!({"buffers": [{"byteLength": 1}],
            "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 1}],
            "tileAvailability": {"constant": 1}, "contentAvailability": [{"bitstream": 0}],
            "childSubtreeAvailability": {"constant": 0}});
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        let mut subtree = b"subt\x01\0\0\0".to_vec();
        subtree.extend((text.len() as u64).to_le_bytes());
        subtree.extend(8u64.to_le_bytes());
        subtree.extend(text);
        subtree.extend([0b0001_1001, 0, 0, 0, 0, 0, 0, 0]);
        let root = json!({"refine": "REPLACE", "content": {"uri": "c/{level}_{x}_{y}.glb"},
            "implicitTiling": {"subdivisionScheme": "QUADTREE", "subtreeLevels": 2, "availableLevels": 2,
                "subtrees": {"uri": "s/{level}.{x}.{y}.subtree"}}});
        let folder = tree(&[
            ("tileset.json", tileset(root)),
            ("s/0.0.0.subtree", subtree),
            ("c/0_0_0.glb", glb()),
            ("c/1_0_1.glb", glb()),
            ("c/1_1_1.glb", glb()),
        ]);
        let names: Vec<String> = parts(&folder).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["c/1_0_1.glb", "c/1_1_1.glb"]);
    }

    #[test]
    fn what_lies_elsewhere_is_missing_or_leads_back_is_refused() {
        for (uri, words) in [
            ("../x.glb", "outside of the folder"),
            ("/etc/passwd", "outside of the folder"),
            ("http://a.b/c.glb", "outside of the folder"),
            ("data:model/gltf-binary;base64,AA", "outside of the folder"),
            ("a%2", "not a name"),
            ("no.glb", "no.glb"),
            ("tileset.json", "leads back to itself"),
            ("short.b3dm", "cut off"),
            ("flat.glb", "transform"),
        ] {
            let map = if uri == "flat.glb" { json!(vec![0; 16]) } else { Value::Null };
            let root = json!({"content": {"uri": uri}, "transform": map});
            let folder = tree(&[
                ("tileset.json", tileset(root)),
                ("short.b3dm", b3dm("{}", "")[..60].to_vec()),
            ]);
            let error = refusal(&folder);
            assert!(error.contains(words), "{uri}: {error}");
        }
        let folder = tree(&[("tileset.json", b"{\"a\": 1}".to_vec())]);
        assert!(refusal(&folder).contains("not a tree"));
        let deep = format!("{}{}", "{\"children\":[".repeat(200), "]}".repeat(200));
        let text = format!("{{\"geometricError\":1,\"root\":{deep}}}");
        assert!(refusal(&tree(&[("tileset.json", text.into())])).contains("recursion"));
    }
}
