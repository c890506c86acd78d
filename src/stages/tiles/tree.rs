//! Puts the tiles of all rounds into one tree: parents, volumes, errors.
//!
//! All tiles that a group shows finer have the volume and the error of the group, and a group's volume holds those of
//! all groups below that share a tile with it, its error exceeds theirs. So whatever rule of error and distance
//! a viewer has, it refines a group whole, and only after all groups above it: neighbours always fit together.
//! Every triangle of a tile lies in the volume of one of its finer tiles, so viewers may judge by these what is in the picture.
//!
//! docs/design/tiles.md.

use super::tile_path;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use stonecut_io::tileset::TreeTile;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{BoxKey, GroupRecord, Lattice, TileRecord, group_of, parent_of};

/// Errors grow from level to level by this share at least.
const LEAST_STEP: f64 = 1.0 / 512.0;

/// Pixels that viewers let an error have by default.
const VIEWER_PIXELS: f64 = 16.0;

/// The rounds of a tree and the tile at its top.
pub struct TreeLevels<'a> {
    /// The lattice of the tree.
    pub lattice: Lattice,
    /// The groups of each round, sorted.
    pub rounds: &'a [Vec<GroupRecord>],
    /// The groups of the rounds before, which have written nothing.
    pub hidden: &'a [Vec<GroupRecord>],
    /// The tile at the top.
    pub top: &'a TileRecord,
    /// Pixels that the distance from the input may have on the screen.
    pub pixels: f64,
}

/// The tiles of a tree, the top last, and the largest distance from the input of each level.
pub fn tree(levels: &TreeLevels) -> (Vec<TreeTile>, Vec<f64>) {
    let mut tree = Tree { leaves: hidden(levels.hidden), ..Tree::default() };
    let n_rounds = levels.rounds.len() as u32;
    for (level, round) in (0u32..).zip(levels.rounds) {
        let mut first = Vec::with_capacity(round.len());
        for (cell, record) in CellId::first(round.len()).zip(round) {
            first.push(tree.tiles.len() as u32);
            for (n, tile) in record.tiles.iter().enumerate() {
                let path = tile_path(level, cell, n);
                tree.push(levels, level, tile.key, Some((path, tile)));
            }
        }
        first.push(tree.tiles.len() as u32);
        tree.first.push(first);
    }
    let root = tree.push(levels, n_rounds, levels.top.key, None);
    let top = &mut tree.tiles[root as usize];
    top.content = Some(tile_path(n_rounds, CellId(0), 0));
    top.content_bounds = bounds_of(levels.top, levels.lattice.step_of(n_rounds));
    top.triangles = levels.top.triangles;
    top.group = (n_rounds > 0).then_some(0);
    tree.records[root as usize] = Some(levels.top);
    tree.owned = levels.rounds.iter().map(|round| vec![Vec::new(); round.len()]).collect();
    for tile in 0..root {
        if let Some((round, group)) = tree.owner(tile) {
            tree.owned[round][group].push(tile);
        }
    }
    if let Some(last) = tree.owned.last_mut() {
        last[0] = vec![root];
    }
    for round in (0..levels.rounds.len()).rev() {
        tree.attach(levels, round);
    }
    let deviations = tree.bound(levels);
    // The top comes last for those who look at the list.
    (tree.tiles, deviations)
}

#[derive(Default)]
struct Tree<'a> {
    tiles: Vec<TreeTile>,
    keys: Vec<BoxKey>,
    /// For each tile what was recorded when it was written; none if it has no content.
    records: Vec<Option<&'a TileRecord>>,
    /// For each round the number of the first tile that each of its groups has written, and their end.
    first: Vec<Vec<u32>>,
    /// For each round and group the tiles that it shows finer.
    owned: Vec<Vec<Vec<u32>>>,
    /// The groups that have left the finest tiles, sorted, with the distance of these from the input; none if they are it.
    leaves: Vec<(BoxKey, f64)>,
}

/// The groups of the last of some rounds, with the distance from the input of what they have left.
fn hidden(rounds: &[Vec<GroupRecord>]) -> Vec<(BoxKey, f64)> {
    let mut below: Vec<(&GroupRecord, f64)> = Vec::new();
    for records in rounds {
        let mut most: BTreeMap<BoxKey, f64> = BTreeMap::new();
        for (record, distance) in &below {
            for (key, _) in &record.parts {
                let most = most.entry(group_of(parent_of(*key))).or_default();
                *most = most.max(*distance);
            }
        }
        let distance = |record: &GroupRecord| {
            most.get(&record.group).copied().unwrap_or(0.0) + record.deviation
        };
        below = records.iter().map(|record| (record, distance(record))).collect();
    }
    below.into_iter().map(|(record, distance)| (record.group, distance)).collect()
}

impl<'a> Tree<'a> {
    fn push(
        &mut self,
        levels: &TreeLevels,
        level: u32,
        key: BoxKey,
        content: Option<(String, &'a TileRecord)>,
    ) -> u32 {
        let group = match level {
            0 => None,
            _ => levels.rounds[level as usize - 1]
                .binary_search_by_key(&group_of(key), |record| record.group)
                .ok()
                .map(|group| group as u32),
        };
        let mut tile = TreeTile { level, group, ..TreeTile::default() };
        self.records.push(content.as_ref().map(|(_, record)| *record));
        if let Some((path, record)) = content {
            tile.content = Some(path);
            tile.content_bounds = bounds_of(record, levels.lattice.step_of(level));
            tile.triangles = record.triangles;
        }
        self.tiles.push(tile);
        self.keys.push(key);
        self.tiles.len() as u32 - 1
    }

    /// Round and group that show a tile finer; none on the finest level.
    fn owner(&self, tile: u32) -> Option<(usize, usize)> {
        let tile = &self.tiles[tile as usize];
        Some(((tile.level as usize).checked_sub(1)?, tile.group? as usize))
    }

    /// Gives the tiles that a round has written their parents. A group of which nothing is left gets a parent without
    /// content.
    fn attach(&mut self, levels: &TreeLevels, round: usize) {
        for group in 0..levels.rounds[round].len() {
            let tiles = self.first[round][group]..self.first[round][group + 1];
            if tiles.is_empty() {
                continue;
            }
            if self.owned[round][group].is_empty() {
                let key = parent_of(self.keys[tiles.start as usize]);
                let empty = self.push(levels, round as u32 + 1, key, None);
                self.tiles[empty as usize].group = Some(group as u32);
                self.owned[round][group].push(empty);
                // Rounds above have their parents already.
                let above = self.above(levels, round + 1, group_of(parent_of(key)));
                self.tiles[above as usize].children.push(empty);
            }
            for tile in tiles {
                let wanted = parent_of(self.keys[tile as usize]);
                let parents = &self.owned[round][group];
                let off_sq = |parent: &u32| -> i64 {
                    let key = self.keys[*parent as usize];
                    (0..3).map(|k| (i64::from(key[k]) - i64::from(wanted[k])).pow(2)).sum()
                };
                let parent = parents.iter().copied().min_by_key(|p| (off_sq(p), *p));
                let parent = parent.expect("there is at least one");
                self.tiles[parent as usize].children.push(tile);
            }
            self.share_out(levels, &self.owned[round][group].clone());
        }
    }

    /// Gives each tile of a group that got no finer one the nearest of the tile that has most: a viewer would go on showing
    /// it beside what takes its place. A group is refined whole, so any of its tiles may lead to any finer one.
    fn share_out(&mut self, levels: &TreeLevels, parents: &[u32]) {
        for &poor in parents {
            if !self.tiles[poor as usize].children.is_empty() {
                continue;
            }
            let n_children = |parent: u32| self.tiles[parent as usize].children.len();
            let rich = parents.iter().copied().max_by_key(|&p| (n_children(p), Reverse(p)));
            let rich = rich.filter(|&rich| n_children(rich) > 1);
            let child = rich.and_then(|rich| {
                let centre = self.tiles[poor as usize].content_bounds.middle();
                let tiles = &self.tiles;
                let off_sq = |child: &u32| {
                    length_sq(sub(tiles[*child as usize].content_bounds.middle(), centre))
                };
                let children = &self.tiles[rich as usize].children;
                let nearest = (0..children.len())
                    .min_by(|a, b| off_sq(&children[*a]).total_cmp(&off_sq(&children[*b])))?;
                Some(self.tiles[rich as usize].children.remove(nearest))
            });
            // Fewer finer tiles than coarse ones: one without content takes its place.
            let child = child.unwrap_or_else(|| {
                let empty = self.push(levels, 0, self.keys[poor as usize], None);
                self.tiles[empty as usize].content_bounds =
                    self.tiles[poor as usize].content_bounds;
                empty
            });
            self.tiles[poor as usize].children.push(child);
        }
    }

    /// A tile that the group of a round shows finer, or the nearest group that has any.
    fn above(&self, levels: &TreeLevels, round: usize, group: BoxKey) -> u32 {
        let off_sq = |other: BoxKey| -> i64 {
            (0..3).map(|k| (i64::from(group[k]) - i64::from(other[k])).pow(2)).sum()
        };
        let groups = levels.rounds[round].iter().zip(&self.owned[round]);
        let near = groups
            .filter(|(_, owned)| !owned.is_empty())
            .min_by_key(|(record, _)| off_sq(record.group));
        near.expect("the last round has the top").1[0]
    }

    /// The distance of a tile of the finest level from the input, but for the rounding to the lattice.
    fn leaf(&self, tile: u32) -> f64 {
        let group = group_of(self.keys[tile as usize]);
        let found = self.leaves.binary_search_by_key(&group, |(key, _)| *key);
        found.map_or(0.0, |at| self.leaves[at].1)
    }

    /// Makes the volumes of the finer tiles of a tile hold its triangles: of those of a box, the volume that grows least by it.
    fn hold(&mut self, levels: &TreeLevels, number: u32) {
        let tile = &self.tiles[number as usize];
        let Some(record) = self.records[number as usize] else { return };
        let step = levels.lattice.step_of(tile.level);
        let mut parts: Vec<Bounds> = record.by_box.iter().map(|b| in_units(b, step)).collect();
        if parts.is_empty() {
            parts.push(tile.content_bounds);
        }
        let children = tile.children.clone();
        for part in parts {
            let grown = |child: u32| self.tiles[child as usize].bounds.joined(&part);
            let growth =
                |child: u32| area(&grown(child)) - area(&self.tiles[child as usize].bounds);
            let nearest = children.iter().copied().min_by(|a, b| growth(*a).total_cmp(&growth(*b)));
            let Some(child) = nearest else { return };
            let grown = grown(child);
            if grown == self.tiles[child as usize].bounds {
                continue;
            }
            // All tiles of a group have one volume.
            let group = self.owner(child);
            let alike =
                group.map_or(vec![child], |(round, group)| self.owned[round][group].clone());
            alike.iter().for_each(|&tile| self.tiles[tile as usize].bounds = grown);
        }
    }

    /// Volumes and errors, from the finest level upwards; returns the largest deviation of each level.
    fn bound(&mut self, levels: &TreeLevels) -> Vec<f64> {
        let mut most = 0.0f64;
        for number in 0..self.tiles.len() {
            let leaf = match self.tiles[number].level == 0 && !self.leaves.is_empty() {
                true => self.leaf(number as u32) + 3f64.sqrt() * levels.lattice.step_of(0),
                false => 0.0,
            };
            most = most.max(leaf);
            let tile = &mut self.tiles[number];
            tile.bounds = tile.content_bounds;
            tile.deviation = leaf;
            tile.geometric_error = VIEWER_PIXELS / levels.pixels * leaf;
        }
        let mut deviations = vec![most];
        // Of the groups of the round before: distance without the rounding to the lattice.
        let mut geometry: Vec<f64> = Vec::new();
        for (round, records) in levels.rounds.iter().enumerate() {
            // A vertex moves to the nearest point of the lattice; at the border of a group that is a coarser one.
            let rounding = 3f64.sqrt() * levels.lattice.step_of(round as u32 + 1);
            let mut own = Vec::with_capacity(records.len());
            let mut most = 0.0f64;
            // Volumes of finer tiles grow before any group above them takes them in.
            for group in 0..records.len() {
                for tile in self.owned[round][group].clone() {
                    self.hold(levels, tile);
                }
            }
            for (group, record) in records.iter().enumerate() {
                let (mut bounds, mut below, mut error) = (Bounds::EMPTY, 0.0f64, 0.0f64);
                let mut texel = 0.0f64;
                for &tile in &self.owned[round][group] {
                    texel = texel.max(self.records[tile as usize].map_or(0.0, |r| r.texel));
                    let tile = &self.tiles[tile as usize];
                    bounds = bounds.joined(&tile.content_bounds);
                    for &number in &tile.children {
                        let child = &self.tiles[number as usize];
                        bounds = bounds.joined(&child.bounds);
                        error = error.max(child.geometric_error);
                        below = below.max(match child.group {
                            Some(group) => geometry[group as usize],
                            None => self.leaf(number),
                        });
                    }
                }
                let distance = below + record.deviation;
                own.push(distance);
                let deviation = distance + rounding;
                most = most.max(deviation);
                // A texel is at most as wide on the screen as a distance from the input may be.
                let wanted = VIEWER_PIXELS / levels.pixels * deviation.max(texel);
                let geometric_error = wanted.max(error * (1.0 + LEAST_STEP));
                for tile in self.owned[round][group].clone() {
                    let tile = &mut self.tiles[tile as usize];
                    tile.bounds = bounds;
                    tile.geometric_error = geometric_error;
                    tile.deviation = deviation;
                }
            }
            geometry = own;
            deviations.push(most);
        }
        deviations
    }
}

fn in_units([low, high]: &[[i32; 3]; 2], step: f64) -> Bounds {
    Bounds { low: low.map(|x| f64::from(x) * step), high: high.map(|x| f64::from(x) * step) }
}

/// Half the area of a box.
fn area(bounds: &Bounds) -> f64 {
    let [x, y, z] = sub(bounds.high, bounds.low);
    x * y + y * z + z * x
}

/// Bounds of a tile, a little wider, so that a flat one has a volume; `step` is that of its lattice.
fn bounds_of(tile: &TileRecord, step: f64) -> Bounds {
    let extent = (0..3).map(|k| tile.high[k] - tile.low[k]).fold(0.0, f64::max);
    let rim = extent.max(step) / 8192.0;
    Bounds { low: tile.low.map(|x| x - rim), high: tile.high.map(|x| x + rim) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(key: BoxKey, x: f64) -> TileRecord {
        TileRecord {
            key,
            triangles: 10,
            low: [x, 0.0, 0.0],
            high: [x + 1.0, 1.0, 1.0],
            ..TileRecord::default()
        }
    }

    fn round(tiles: Vec<TileRecord>, group: BoxKey) -> Vec<GroupRecord> {
        vec![GroupRecord { group, tiles, deviation: 0.1, ..GroupRecord::default() }]
    }

    fn made(finest: Vec<TileRecord>, coarse: Vec<TileRecord>) -> Vec<TreeTile> {
        let lattice = Lattice { origin: [0.0; 3], step: 0.001 };
        let rounds = [round(finest, [0; 3]), round(coarse, [0; 3])];
        let top = tile([0; 3], 0.0);
        let levels = TreeLevels { lattice, rounds: &rounds, hidden: &[], top: &top, pixels: 1.0 };
        tree(&levels).0
    }

    #[test]
    fn every_tile_of_a_refined_group_has_a_finer_one() {
        // All finer tiles lie in the box of the second coarse tile, as where boxes with few triangles were joined.
        let coarse = || vec![tile([-1, 0, 0], 0.0), tile([0; 3], 2.0)];
        for n_finest in [1, 2, 5] {
            let finest = (0..n_finest).map(|i| tile([0; 3], f64::from(i))).collect();
            let tiles = made(finest, coarse());
            let coarse: Vec<&TreeTile> = tiles.iter().filter(|tile| tile.level == 1).collect();
            assert_eq!(coarse.len(), 2);
            let mut seen = Vec::new();
            for tile in coarse {
                assert!(!tile.children.is_empty(), "{n_finest}: {tiles:#?}");
                for &child in &tile.children {
                    let child_tile = &tiles[child as usize];
                    assert!(child_tile.geometric_error < tile.geometric_error);
                    assert!(tile.bounds.joined(&child_tile.bounds) == tile.bounds);
                    seen.push(child);
                }
            }
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), n_finest.max(2) as usize);
        }
        // The nearest one is given away.
        let tiles = made((0..3).map(|i| tile([0; 3], f64::from(i))).collect(), coarse());
        assert_eq!(tiles.iter().find(|t| t.level == 1).unwrap().children, [0]);
    }

    #[test]
    fn what_reaches_beyond_the_finer_tiles_is_held_by_the_nearest() {
        let finest = vec![tile([-1, 0, 0], 0.0), tile([0; 3], 5.0)];
        let mut wide = tile([0; 3], 0.0);
        wide.high[0] = 6.5;
        // In steps of level 1: from 0 to 1, and from 4.5 to 6.5 (units).
        wide.by_box = vec![[[0; 3], [500; 3]], [[2250, 0, 0], [3250, 500, 500]]];
        let tiles = made(finest, vec![wide]);
        let widths: Vec<[f64; 2]> =
            tiles[..2].iter().map(|t| [t.bounds.low[0], t.bounds.high[0]]).collect();
        assert!(widths[0][0] < 0.0 && widths[0][1] < 1.1, "{widths:?}");
        assert_eq!(widths[1], [4.5, 6.5]);
        let coarse = tiles.iter().find(|t| t.level == 1).unwrap();
        assert!(tiles[..2].iter().all(|t| coarse.bounds.joined(&t.bounds) == coarse.bounds));
    }
}
