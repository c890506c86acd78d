//! The tiles of a tree as `extract` needs them, and the cuts through it.
//!
//! All tiles of a group are shown, or all that are finer below them; and a group is refined only if all groups are that its
//! tiles came from. Tiles on both sides of the border of a group have the same vertices there, so that every such cut is
//! one mesh.

use crate::error::{Error, Result};
use crate::io::TileScalar;
use crate::io::sidecars::crs_in;
use crate::io::tileset::{FILE_NAME, MOST_FILE_BYTES, Tile, Volume, read_tileset, resolve};
use crate::mesh::bounds::Bounds;
use crate::mesh::placing::{offset_comment, offset_in};
use crate::system::disk::read_regular;
use std::collections::BTreeMap;
use std::path::Path;

/// Deepest nesting of tiles and files that is followed.
const DEEPEST: usize = 64;

/// A tile. Lengths are in units of the mesh.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) level: u32,
    /// Number of its group in `Tree::groups`; none on level 0.
    group: Option<usize>,
    parent: Option<usize>,
    /// Distance from the input, at most, of a tile of the finest level.
    leaf_deviation: f64,
    pub(super) triangles: u64,
    pub(super) content: Option<String>,
    /// Bounds of the content, from the origin of the lattice.
    bounds: Bounds,
}

/// Tiles that are shown finer together.
#[derive(Clone, Debug, Default)]
struct TileGroup {
    /// Distance of its tiles from the input, at most.
    deviation: f64,
    /// Its tiles, and the finer ones below them.
    own: Vec<usize>,
    below: Vec<usize>,
}

/// A tree of tiles.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    /// Finer levels first.
    groups: Vec<TileGroup>,
    /// Comments on the place of the mesh.
    pub(super) comments: Vec<String>,
    /// Place of coordinate 0 of the lattice.
    pub(super) origin: [f64; 3],
    /// Length of a step of level 0.
    pub(super) step: f64,
    /// True if normals are those of the input.
    pub(super) has_normals: bool,
    /// Properties of vertices that tiles have as attributes.
    pub(super) scalars: Vec<TileScalar>,
    /// True if y points upwards, as in glTF.
    pub(super) is_y_up: bool,
}

/// The largest distances that are allowed, in units of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowed {
    pub(super) outside: f64,
    /// A box, from the origin of the lattice, and the distance in it.
    pub(super) inside: Option<(Bounds, f64)>,
}

/// Tiles that make a mesh together.
#[derive(Clone, Debug, Default)]
pub(super) struct TreeCut {
    /// Coarse ones first.
    pub(super) tiles: Vec<usize>,
    pub(super) triangles: u64,
    /// The largest stated distance from the input.
    pub(super) deviation: f64,
    /// True if a tile of the finest level is farther from the input than is allowed.
    pub(super) is_coarser: bool,
}

/// Comments on the place of a mesh, out of the facts of its tree.
fn place_comments(facts: &serde_json::Value) -> Vec<String> {
    let numbers = facts["offset"].as_array().into_iter().flatten().map_while(|x| x.as_f64());
    let offset: Option<[f64; 3]> = numbers.collect::<Vec<f64>>().try_into().ok();
    let crs = facts["crs"].as_str().and_then(|crs| crs_in(&[format!("crs {crs}")]));
    let crs = crs.filter(|crs| !crs.is_empty()).map(|crs| format!("crs {crs}"));
    crs.into_iter().chain(offset.map(offset_comment)).collect()
}

impl Tree {
    /// Reads the JSON of a tree. Errors: `BadInput` if there is none of this program.
    pub(super) fn read(folder: &Path) -> Result<Tree> {
        let bad = |what: String| Error::bad_input(folder, what);
        let text = read_regular(&folder.join(FILE_NAME), MOST_FILE_BYTES).map_err(|e| {
            bad(format!(
                "{FILE_NAME} cannot be read: {e}; name a folder that 'stonecut tiles' has written"
            ))
        })?;
        let set = read_tileset(&text).map_err(|what| bad(format!("{FILE_NAME}: {what}")))?;
        let facts = &set.extras["stonecut"];
        let numbers: Option<Vec<f64>> =
            facts["origin"].as_array().and_then(|list| list.iter().map(|x| x.as_f64()).collect());
        let (Some(step), Some(origin)) = (facts["step"].as_f64(), numbers.as_deref()) else {
            let what = "has no facts of 'stonecut tiles' in its extras: only its trees are known";
            return Err(bad(format!("{FILE_NAME} {what}")));
        };
        let &[x, y, z] = origin else {
            return Err(bad(format!("{FILE_NAME}: its origin is not a place")));
        };
        let scalars = TileScalar::read_list(&facts["scalars"])
            .map_err(|what| bad(format!("{FILE_NAME}: {what}")))?;
        let is_z_up = facts["up"].as_str() != Some("y");
        let mut reader = TreeReader { folder, is_z_up, nodes: Vec::new(), facts: BTreeMap::new() };
        reader.tile(FILE_NAME, &set.root, (None, 0))?;
        let has_normals = facts["normals"].as_str() == Some("given");
        let comments = place_comments(&set.extras["stonecut"]);
        let origin = [x, y, z];
        let is_y_up = !is_z_up;
        let mut tree =
            Tree { comments, origin, step, has_normals, scalars, is_y_up, ..Tree::default() };
        let TreeReader { mut nodes, facts, .. } = reader;
        let numbers: BTreeMap<(u32, u32), usize> = facts.keys().copied().zip(0..).collect();
        tree.groups = facts
            .values()
            .map(|facts| TileGroup { deviation: facts.0, ..TileGroup::default() })
            .collect();
        for (node, key) in
            facts.iter().flat_map(|(key, (_, own))| own.iter().map(move |n| (*n, key)))
        {
            nodes[node].group = Some(numbers[key]);
        }
        for (number, node) in nodes.iter().enumerate() {
            if let Some(group) = node.group {
                tree.groups[group].own.push(number);
            }
            if let Some(group) = node.parent.and_then(|parent| nodes[parent].group) {
                tree.groups[group].below.push(number);
            }
        }
        tree.nodes = nodes;
        Ok(tree)
    }

    /// Refuses, in words, a box that meets no tile; `bounds` has its `corners` from the origin of the lattice.
    pub(super) fn require_touched(
        &self,
        bounds: &Bounds,
        corners: [[f64; 3]; 2],
    ) -> std::result::Result<(), String> {
        let tiles = || self.nodes.iter().filter(|node| node.content.is_some());
        if tiles().any(|node| node.bounds.touches(bounds)) {
            return Ok(());
        }
        let whole = tiles().fold(Bounds::EMPTY, |whole, node| whole.joined(&node.bounds));
        let moved = |p: [f64; 3], by: [f64; 3]| [0, 1, 2].map(|k| p[k] + by[k]);
        let words = |[low, high]: [[f64; 3]; 2]| {
            [low, high].as_flattened().iter().map(f64::to_string).collect::<Vec<_>>().join(",")
        };
        let all = words(whole.map(|corner| moved(corner, self.origin)).into());
        let hint = offset_in(&self.comments).map_or_else(String::new, |offset| {
            let own = corners.map(|corner| moved(corner, offset.map(|x| -x)));
            let [x, y, z] = offset;
            format!(
                "; its coordinates count from an offset of {x} {y} {z}, without which the box is --inside {}",
                words(own)
            )
        });
        Err(format!("--inside: the box meets no tile of the tree, which lies in {all}{hint}"))
    }

    /// The coarsest cut that keeps within the allowed distances.
    pub(super) fn cut(&self, allowed: &Allowed) -> TreeCut {
        let mut refined = vec![false; self.groups.len()];
        // Groups are sorted by level, so those below come first.
        for (number, group) in self.groups.iter().enumerate() {
            let touches = |bounds: &Bounds| {
                let tiles = group.own.iter().chain(&group.below);
                tiles.map(|&node| &self.nodes[node]).any(|node| node.bounds.touches(bounds))
            };
            let is_near =
                |(bounds, most): &(Bounds, f64)| group.deviation > *most && touches(bounds);
            let needed = |node: &usize| self.nodes[*node].group.is_some_and(|below| refined[below]);
            refined[number] = group.deviation > allowed.outside
                || allowed.inside.as_ref().is_some_and(is_near)
                || group.below.iter().any(needed);
        }
        let mut cut = TreeCut::default();
        let is_refined = |node: &Node| node.group.is_some_and(|group| refined[group]);
        for (number, node) in self.nodes.iter().enumerate() {
            let is_below = node.parent.is_none_or(|parent| is_refined(&self.nodes[parent]));
            if is_below && !is_refined(node) && node.content.is_some() {
                cut.tiles.push(number);
                cut.triangles += node.triangles;
                let finest = node.leaf_deviation + self.rounding();
                let deviation = node.group.map_or(finest, |group| self.groups[group].deviation);
                cut.deviation = cut.deviation.max(deviation);
                let inside = allowed.inside.filter(|(bounds, _)| node.bounds.touches(bounds));
                let most = inside.map_or(allowed.outside, |(_, most)| most.min(allowed.outside));
                // Who asks for 0 wants the finest that there is.
                let finest = if most > 0.0 { finest } else { node.leaf_deviation };
                cut.is_coarser |= node.group.is_none() && finest > most;
            }
        }
        cut.tiles.sort_by_key(|&tile| (std::cmp::Reverse(self.nodes[tile].level), tile));
        cut
    }

    /// Distance by which rounding to the lattice moves a vertex of the finest level, at most: half a step of the level above along
    /// each axis, where groups meet.
    fn rounding(&self) -> f64 {
        3f64.sqrt() * self.step
    }

    /// The distances that groups have from the input, largest first.
    pub(super) fn deviations(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.groups.iter().map(|group| group.deviation).collect();
        all.sort_by(|a, b| b.total_cmp(a));
        all.dedup();
        all
    }
}

/// Groups by level and number: their distance from the input and their tiles.
type Facts = BTreeMap<(u32, u32), (f64, Vec<usize>)>;

struct TreeReader<'a> {
    folder: &'a Path,
    is_z_up: bool,
    nodes: Vec<Node>,
    facts: Facts,
}

impl TreeReader<'_> {
    fn tile(
        &mut self,
        file: &str,
        tile: &Tile,
        (parent, depth): (Option<usize>, usize),
    ) -> Result<()> {
        let bad = |what: String| {
            Error::bad_input(
                self.folder,
                format!("{file}: {what}; see what 'stonecut info --check' finds"),
            )
        };
        if depth > DEEPEST {
            return Err(bad(format!("tiles nest deeper than {DEEPEST}")));
        }
        let content = match &tile.content {
            Some(content) => Some(
                resolve(file, &content.uri)
                    .ok_or_else(|| bad(format!("'{}' leads out of the folder", content.uri)))?,
            ),
            None => None,
        };
        if let Some(name) = content.as_ref().filter(|name| name.ends_with(".json")) {
            let text = read_regular(&self.folder.join(name), MOST_FILE_BYTES)
                .map_err(|e| bad(format!("{name} cannot be read: {e}")))?;
            let set = read_tileset(&text).map_err(|what| bad(format!("{name}: {what}")))?;
            return self.tile(name, &set.root, (parent, depth + 1));
        }
        let facts = &tile.extras;
        let level = facts["level"].as_u64().and_then(|level| u32::try_from(level).ok());
        let level = level
            .filter(|level| *level < 64)
            .ok_or_else(|| bad("a tile has no level".to_owned()))?;
        let above = parent.map(|parent| self.nodes[parent].level);
        if above.is_some_and(|above| above <= level) {
            return Err(bad("a tile is not finer than the one above it".to_owned()));
        }
        let number = self.nodes.len();
        if level > 0 {
            let group = facts["group"].as_u64().and_then(|group| u32::try_from(group).ok());
            let deviation = facts["deviation"].as_f64().filter(|x| x.is_finite());
            let (Some(group), Some(deviation)) = (group, deviation) else {
                return Err(bad("a tile has no group or no deviation".to_owned()));
            };
            let known = self.facts.entry((level, group)).or_insert((deviation, Vec::new()));
            known.0 = known.0.max(deviation);
            known.1.push(number);
        }
        let volume = tile.content.as_ref().and_then(|content| content.bounding_volume.as_ref());
        self.nodes.push(Node {
            level,
            group: None,
            parent,
            leaf_deviation: facts["deviation"].as_f64().filter(|x| x.is_finite()).unwrap_or(0.0),
            triangles: facts["triangles"].as_u64().unwrap_or(0),
            content,
            bounds: volume.map_or(Bounds::EMPTY, |volume| self.bounds(volume)),
        });
        for child in &tile.children {
            self.tile(file, child, (Some(number), depth + 1))?;
        }
        Ok(())
    }

    /// The bounds of a volume in the frame of the mesh; a volume that is not a box is everywhere.
    fn bounds(&self, volume: &Volume) -> Bounds {
        let Some(b) = volume.cuboid else {
            return Bounds { low: [f64::NEG_INFINITY; 3], high: [f64::INFINITY; 3] };
        };
        let half = [b[3], b[7], b[11]];
        let (low, high) = ([0, 1, 2].map(|k| b[k] - half[k]), [0, 1, 2].map(|k| b[k] + half[k]));
        match self.is_z_up {
            true => Bounds { low, high },
            false => Bounds { low: [low[0], low[2], -high[1]], high: [high[0], high[2], -low[1]] },
        }
    }
}
