//! The JSON of a tree of tiles: read whole, with the files it is cut into, and held against its rules.

use super::found::TilesetCheck;
use std::collections::BTreeMap;
use std::path::Path;
use stonecut_io::TileScalar;
use stonecut_io::tileset::{
    FILE_NAME, MOST_FILE_BYTES, Tile, Tileset, Volume, read_tileset, resolve,
};
use stonecut_system::disk::read_regular;
use stonecut_system::error::{Error, Result};

/// Deepest nesting of tiles and files that is followed.
const DEEPEST: usize = 64;

/// A tile of the tree; those that only point to a file are left out.
#[derive(Debug, Default)]
pub(super) struct CheckedTile {
    pub(super) level: u32,
    pub(super) group: Option<u32>,
    pub(super) parent: Option<u32>,
    pub(super) error: f64,
    pub(super) volume: Option<Cuboid>,
    pub(super) content_volume: Option<Cuboid>,
    pub(super) content: Option<String>,
    pub(super) triangles: u64,
    /// The largest distance from the input that is stated.
    deviation: f64,
    /// Volumes of its finer tiles.
    pub(super) finer: Vec<Cuboid>,
    n_children: usize,
}

impl CheckedTile {
    /// Path of the content in the folder of the tree.
    pub(super) fn name(&self) -> &str {
        self.content.as_deref().unwrap_or("a tile without content")
    }
}

/// A box along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cuboid {
    low: [f64; 3],
    high: [f64; 3],
}

impl Cuboid {
    fn of(volume: &Volume) -> Option<Cuboid> {
        let b = volume.cuboid?;
        let off = [b[4], b[5], b[6], b[8], b[9], b[10]];
        let half = [b[3], b[7], b[11]];
        let sound = b.iter().all(|x| x.is_finite())
            && off.iter().all(|x| *x == 0.0)
            && half.iter().all(|x| *x > 0.0);
        sound.then(|| Cuboid {
            low: [0, 1, 2].map(|k| b[k] - half[k]),
            high: [0, 1, 2].map(|k| b[k] + half[k]),
        })
    }

    pub(super) fn contains(&self, p: [f64; 3], slack: f64) -> bool {
        (0..3).all(|k| self.low[k] - slack <= p[k] && p[k] <= self.high[k] + slack)
    }

    /// Holds for boxes that agree but for rounding, too.
    fn holds(&self, other: &Cuboid) -> bool {
        let size = (0..3).map(|k| self.high[k] - self.low[k]).fold(0.0, f64::max);
        [other.low, other.high].iter().all(|p| self.contains(*p, 1e-9 * size))
    }
}

/// A tree as its JSON describes it.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub(super) tiles: Vec<CheckedTile>,
    /// Triangles that the finest tiles have together.
    pub(super) finest_triangles: u64,
    /// True if the finest tiles are not the input, and so have an error.
    is_reduced: bool,
    pub(super) step: f64,
    pub(super) is_z_up: bool,
    /// Properties of vertices that tiles have as attributes.
    pub(super) scalars: Vec<TileScalar>,
    /// True if tiles have pages.
    pub(super) has_pages: bool,
}

impl Tree {
    /// Reads all files. Errors: `BadInput` if the first one is none of this program.
    pub(super) fn read(folder: &Path, found: &mut TilesetCheck) -> Result<Tree> {
        let text = read_regular(&folder.join(FILE_NAME), MOST_FILE_BYTES)
            .map_err(|e| Error::bad_input(folder, format!("{FILE_NAME} cannot be read: {e}")))?;
        let set = read_tileset(&text)
            .map_err(|what| Error::bad_input(folder, format!("{FILE_NAME}: {what}")))?;
        let facts = &set.extras["stonecut"];
        let (Some(input_triangles), Some(step)) =
            (facts["input_triangles"].as_u64(), facts["step"].as_f64())
        else {
            let what = "has no facts of 'stonecut tiles' in its extras: only its trees are checked";
            return Err(Error::bad_input(folder, format!("{FILE_NAME} {what}")));
        };
        let scalars = TileScalar::read_list(&facts["scalars"]).unwrap_or_else(|what| {
            found.fault(|| format!("{FILE_NAME}: {what}"));
            Vec::new()
        });
        let is_z_up = facts["up"].as_str() != Some("y");
        let finest = facts["finest_triangles"].as_u64();
        let mut tree = Tree {
            finest_triangles: finest.unwrap_or(input_triangles),
            is_reduced: finest.is_some(),
            step,
            is_z_up,
            scalars,
            has_pages: facts["texels_per_unit"].as_f64().is_some(),
            ..Tree::default()
        };
        found.tilesets = 1;
        if set.geometric_error <= set.root.geometric_error {
            found.fault(|| {
                format!(
                    "{FILE_NAME}: its error does not exceed that of its root, which may never show"
                )
            });
        }
        tree.set(folder, FILE_NAME, &set, None, found);
        Ok(tree)
    }

    fn set(
        &mut self,
        folder: &Path,
        name: &str,
        set: &Tileset,
        parent: Option<u32>,
        found: &mut TilesetCheck,
    ) {
        if set.asset.version != "1.1" {
            found.fault(|| format!("{name}: version {} instead of 1.1", set.asset.version));
        }
        if set.root.refine.as_deref() != Some("REPLACE") {
            found.fault(|| format!("{name}: its root does not say that it is replaced"));
        }
        if name != FILE_NAME && set.root.transform.is_some() {
            found.fault(|| format!("{name}: its root has a transform, which moves it twice"));
        }
        self.tile(folder, name, &set.root, (parent, 0), found);
    }

    fn tile(
        &mut self,
        folder: &Path,
        file: &str,
        tile: &Tile,
        (parent, depth): (Option<u32>, usize),
        found: &mut TilesetCheck,
    ) {
        let uri = tile.content.as_ref().map(|content| resolve(file, &content.uri));
        let uri = match uri {
            Some(None) => {
                found.fault(|| format!("{file}: a content leads out of the folder"));
                return;
            }
            other => other.flatten(),
        };
        if depth > DEEPEST {
            found.fault(|| format!("{file}: tiles nest deeper than {DEEPEST}"));
            return;
        }
        if let Some(name) = uri.as_ref().filter(|uri| uri.ends_with(".json")) {
            if !tile.children.is_empty() {
                found.fault(|| format!("{file}: the tile that points to {name} has children"));
            }
            self.pointed(folder, (file, name), tile, (parent, depth), found);
            return;
        }
        let number = self.tiles.len() as u32;
        let facts = &tile.extras;
        self.tiles.push(CheckedTile {
            level: facts["level"].as_u64().map_or(0, |level| level.min(63) as u32),
            group: facts["group"].as_u64().map(|group| group as u32),
            parent,
            error: tile.geometric_error,
            volume: Cuboid::of(&tile.bounding_volume),
            content_volume: tile
                .content
                .as_ref()
                .and_then(|content| content.bounding_volume.as_ref())
                .and_then(Cuboid::of),
            content: uri,
            triangles: facts["triangles"].as_u64().unwrap_or(0),
            deviation: facts["deviation"].as_f64().unwrap_or(0.0),
            finer: Vec::new(),
            n_children: tile.children.len(),
        });
        if let (Some(parent), Some(volume)) = (parent, Cuboid::of(&tile.bounding_volume)) {
            self.tiles[parent as usize].finer.push(volume);
        }
        for child in &tile.children {
            self.tile(folder, file, child, (Some(number), depth + 1), found);
        }
    }

    /// Follows a tile to the file that it points to.
    fn pointed(
        &mut self,
        folder: &Path,
        (file, name): (&str, &str),
        tile: &Tile,
        (parent, depth): (Option<u32>, usize),
        found: &mut TilesetCheck,
    ) {
        found.tilesets += 1;
        let text = read_regular(&folder.join(name), MOST_FILE_BYTES)
            .map_err(|e| format!("cannot be read: {e}"));
        let set = match text.and_then(|text| read_tileset(&text)) {
            Ok(set) => set,
            Err(what) => return found.fault(|| format!("{name}: {what}")),
        };
        let (outer, inner) =
            (Cuboid::of(&tile.bounding_volume), Cuboid::of(&set.root.bounding_volume));
        let holds = matches!((outer, inner), (Some(outer), Some(inner)) if outer.holds(&inner));
        if !holds || tile.geometric_error < set.root.geometric_error {
            found.fault(|| format!("{file}: the tile that points to {name} does not hold it"));
        }
        let above = parent.map(|parent| self.tiles[parent as usize].error);
        if above.is_some_and(|above| above <= tile.geometric_error) {
            found.fault(|| {
                format!("{file}: the error of the tile that points to {name} does not fall")
            });
        }
        if depth > DEEPEST {
            return found.fault(|| format!("{file}: files nest deeper than {DEEPEST}"));
        }
        if set.asset.version != "1.1" || set.root.refine.as_deref() != Some("REPLACE") {
            found.fault(|| format!("{name}: not of version 1.1, or its root is not replaced"));
        }
        self.tile(folder, name, &set.root, (parent, depth + 1), found);
    }

    /// Holds errors, volumes and groups against the rules.
    pub(super) fn check(&self, found: &mut TilesetCheck) {
        let mut groups: BTreeMap<(u32, u32), &CheckedTile> = BTreeMap::new();
        for tile in &self.tiles {
            let name = || tile.name().to_owned();
            let level = tile.level as usize;
            found.deviations.resize(found.deviations.len().max(level + 1), 0.0);
            found.deviations[level] = tile.deviation.max(found.deviations[level]);
            if !(tile.error >= 0.0 && tile.error.is_finite()) {
                found.fault(|| format!("{}: its error is {}", name(), tile.error));
            }
            let Some(volume) = tile.volume else {
                found.fault(|| format!("{}: its volume is not a box along the axes", name()));
                continue;
            };
            if tile.content.is_some() && tile.content_volume.is_none_or(|own| !volume.holds(&own)) {
                found.fault(|| format!("{}: its volume does not hold its content", name()));
            }
            let is_finest = tile.level == 0 && (self.is_reduced || tile.error == 0.0);
            if tile.n_children == 0 && !is_finest {
                found.fault(|| format!("{}: it has an error but nothing finer", name()));
            }
            if let Some(parent) = tile.parent.map(|parent| &self.tiles[parent as usize]) {
                if parent.error <= tile.error {
                    found.fault(|| {
                        format!(
                            "{}: its error {} does not fall below {}",
                            name(),
                            tile.error,
                            parent.error
                        )
                    });
                }
                if parent.volume.is_some_and(|outer| !outer.holds(&volume)) {
                    found.fault(|| format!("{}: its volume leaves that of its parent", name()));
                }
                if parent.level <= tile.level {
                    found.fault(|| format!("{}: it is not finer than its parent", name()));
                }
            }
            match tile.group {
                Some(group) => {
                    let first = groups.entry((tile.level, group)).or_insert(tile);
                    if (first.volume, first.error) != (tile.volume, tile.error) {
                        found.fault(|| {
                            format!(
                                "{}: it has another volume or error than {} of its group",
                                name(),
                                first.name()
                            )
                        });
                    }
                }
                None if tile.level > 0 => {
                    found.fault(|| format!("{}: it belongs to no group", name()));
                }
                None => {}
            }
        }
        found.groups = groups.len() as u64;
    }

    /// The group that a tile was written with: the one that its parent is shown finer in.
    pub(super) fn writer_of(&self, tile: u32) -> Option<u32> {
        let parent = self.tiles[tile as usize].parent?;
        self.tiles[parent as usize].group
    }
}
