//! Pages of the tiles of a textured scan: a step behind the last round.
//!
//! The rounds have written shapes, which know nothing of the input's charts. Here the input is staged with its images, and
//! the tiles of one group after the other get charts, a page of the density of their level, and their final
//! file; those of coarse levels out of the tiles of the level below. What is durable is recorded from time to time, so a run
//! that was stopped goes on behind it.
//!
//! docs/design/tiles.md, "Textures".

use super::config::Finest;
use super::pending::{self, SHAPES};
use super::report::PagesReport;
use super::rounds::Stages;
use crate::bake::{ImageFaults, PagedTile, Photographs, TilePainter, TilePicture, surface};
use crate::error::Result;
use crate::io::ply::MeshSource;
use crate::io::tileset::encode_borders;
use crate::io::{StageOptions, TileScalar};
use crate::mesh::Mesh;
use crate::mesh::bounds::Bounds;
use crate::mesh::morton::spread;
use crate::stages::tiles::{
    Places, border_name, encode_with_page, put_file, read_shapes, tile_path,
};
use crate::store::cell_id::CellId;
use crate::store::cells::{GroupRecord, TileRecord};
use crate::store::job::fingerprint::unchanged;
use crate::store::stage_context::StageContext;
use crate::system::losses::Ledger;
use crate::system::parallel::in_order;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Record of the cells whose tiles are durable, and of the faults of images up to there.
const SO_FAR: &str = "tiles with pages, and faults";

/// Steps of a level from the tiles of a group within which tiles of the level below may be nearest: a quarter of a box.
const NEAR_STEPS: f64 = 4096.0;

/// The tiles of one cell of a round.
struct Unit {
    level: u32,
    cell: CellId,
    /// Boxes of its tiles' triangles in the frame of the input, and their numbers.
    tiles: Vec<(Bounds, u64)>,
    /// Tiles of the tree before it.
    before: u32,
}

impl Unit {
    fn bounds(&self) -> Bounds {
        self.tiles.iter().fold(Bounds::EMPTY, |all, (bounds, _)| all.joined(bounds))
    }

    /// The Morton code of its middle among `all`.
    fn place_on_curve(&self, all: &Bounds) -> u32 {
        let (own, side) = (self.bounds(), 2.0 * all.diagonal());
        let step = |k: usize| 1023.0 * (own.low[k] + own.high[k] - 2.0 * all.low[k]) / side;
        (0..3).map(|k| spread(step(k) as u32) << k).sum()
    }
}

/// A tile with its page.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct PaintedTile {
    bytes: u64,
    checksum: u64,
    image_bytes: u64,
    charts: u64,
    texels: u64,
    covered_texels: u64,
    texels_per_unit: f64,
}

/// The tiles of a cell, and checksum and bytes of the file of their numbers.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct PaintedCell {
    tiles: Vec<PaintedTile>,
    borders: (u64, u64),
}

/// Outcome of the step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Painted {
    cells: Vec<PaintedCell>,
    texels_per_unit: f64,
    losses: Ledger,
}

/// Frame and properties of a tree.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub(super) origin: [f64; 3],
    pub(super) scalars: &'a [TileScalar],
}

/// Gives the tiles of all levels their pages, and writes into their records what became of them.
pub(super) fn paint(
    stages: &mut Stages,
    marks: &BTreeMap<String, String>,
    (rounds, top): (&mut [Vec<GroupRecord>], &mut TileRecord),
    frame: Frame,
) -> Result<PagesReport> {
    let units = units(rounds, top, frame.origin);
    let all = rounds.iter().flatten().flat_map(|record| &record.tiles);
    let n_triangles = all.map(|tile| tile.triangles).sum::<u64>() + top.triangles;
    let largest = rounds.iter().flatten().map(|record| record.triangles[0]).max().unwrap_or(0);
    let (config, pending) = (stages.config, stages.pending);
    let painted: Painted = stages.stages.stage(
        ("bake", "bake"),
        n_triangles,
        |_| n_triangles,
        |run| {
            // What an attempt that was killed has left.
            run.job.clear_scratch()?;
            let read = config.read_options();
            let stage = StageOptions {
                read,
                memory_bytes: run.memory_bytes / 2,
                disk: run.disk().clone(),
                ..StageOptions::new(run.job.folder())
            };
            run.progress.count_from_zero(stages.input_triangles);
            let most = largest.max(top.triangles);
            let staged = MeshSource::open_staged(&config.input, &stage)
                .and_then(|source| Photographs::stage(source, most, run.into()));
            let photographs = unchanged(&config.input, marks, staged)?;
            run.progress.count_from_zero(n_triangles);
            let mut work = Work {
                painter: photographs.painter(config.coding, run.into()),
                folder: pending,
                packs: config.packs,
                texels_per_unit: photographs.texels_per_unit(),
                is_finest: config.finest == Finest::Input,
                frame,
                run,
            };
            let cells = work.all(&units, config.checkpoint_every)?;
            run.disk().sync_all_below(pending)?;
            let texels_per_unit = photographs.texels_per_unit();
            Ok(Painted { cells, texels_per_unit, losses: work.painter.losses() })
        },
    )?;
    for unit in &units {
        remove_shapes(stages.run.disk(), pending, unit)?;
    }
    if pending.join(SHAPES).exists() {
        pending::remove_shapes(pending, stages.run.disk())?;
    }
    let mut report = PagesReport {
        texels_per_unit: painted.texels_per_unit,
        notes: painted.losses.lines(),
        losses: painted.losses,
        ..PagesReport::default()
    };
    for (unit, cell) in units.iter().zip(&painted.cells) {
        let record = rounds.get_mut(unit.level as usize).map(|round| &mut round[unit.cell]);
        let tiles = match record {
            Some(record) => {
                record.borders = cell.borders;
                &mut record.tiles[..]
            }
            None => std::slice::from_mut(&mut *top),
        };
        for (tile, painted) in tiles.iter_mut().zip(&cell.tiles) {
            (tile.bytes, tile.checksum) = (painted.bytes, painted.checksum);
            tile.texel = 1.0 / painted.texels_per_unit;
            report.pages += 1;
            report.charts += painted.charts;
            report.texels += painted.texels;
            report.covered_texels += painted.covered_texels;
            report.bytes += painted.image_bytes;
        }
    }
    Ok(report)
}

/// All cells with tiles, level by level, the top last; in each along a curve through space, so that one mostly shows the images of the
/// one before, which are decoded already.
fn units(rounds: &[Vec<GroupRecord>], top: &TileRecord, origin: [f64; 3]) -> Vec<Unit> {
    let tiles = |records: &[TileRecord]| {
        let bounds = |tile: &TileRecord| {
            let of_origin = Bounds { low: tile.low, high: tile.high };
            of_origin.map(|at| [0, 1, 2].map(|k| origin[k] + at[k]))
        };
        records.iter().map(|tile| (bounds(tile), tile.triangles)).collect()
    };
    let mut units = Vec::new();
    let mut before = 0;
    for (level, round) in (0u32..).zip(rounds) {
        let first = units.len();
        for (cell, record) in CellId::first(round.len()).zip(round) {
            units.push(Unit { level, cell, tiles: tiles(&record.tiles), before });
            before += record.tiles.len() as u32;
        }
        let all = units[first..].iter().map(Unit::bounds).fold(Bounds::EMPTY, |a, b| a.joined(&b));
        units[first..].sort_by_key(|unit| unit.place_on_curve(&all));
    }
    let (level, tiles) = (rounds.len() as u32, tiles(std::slice::from_ref(top)));
    units.push(Unit { level, cell: CellId(0), tiles, before });
    units
}

fn remove_shapes(disk: &crate::system::disk::Disk, pending: &Path, unit: &Unit) -> Result<()> {
    let shapes = pending.join(SHAPES);
    disk.remove(&shapes.join(border_name(unit.level, unit.cell)))?;
    for n in 0..unit.tiles.len() {
        disk.remove(&shapes.join(tile_path(unit.level, unit.cell, n)))?;
    }
    Ok(())
}

/// The step while it is under way.
struct Work<'a> {
    painter: TilePainter<'a>,
    folder: &'a Path,
    packs: bool,
    texels_per_unit: f64,
    /// True if the finest tiles are the input, in its own triangles.
    is_finest: bool,
    frame: Frame<'a>,
    run: &'a StageContext<'a>,
}

impl Work<'_> {
    fn all(&mut self, units: &[Unit], every: std::time::Duration) -> Result<Vec<PaintedCell>> {
        let job = self.run.job;
        let so_far: Option<(Vec<PaintedCell>, ImageFaults)> = job.outcome(SO_FAR)?;
        let (mut done, faults) = so_far.unwrap_or_default();
        self.painter.resume(faults);
        let mut last = Instant::now();
        for unit in units.iter().skip(done.len()) {
            self.run.progress.check()?;
            if unit.level > 0 {
                self.painter.clear();
            }
            done.push(self.one(unit, (units, &done))?);
            if last.elapsed() >= every {
                self.run.disk().sync_all_below(self.folder)?;
                job.record(SO_FAR, &(&done, self.painter.faults()))?;
                last = Instant::now();
            }
        }
        Ok(done)
    }

    /// Tiles of the level below that may have nearest places of those of a unit, whose level has steps of `step`.
    fn finer(
        &self,
        unit: &Unit,
        step: f64,
        (units, done): (&[Unit], &[PaintedCell]),
    ) -> Vec<PagedTile> {
        let around = unit.bounds();
        let below = || units.iter().zip(done).filter(|(below, _)| below.level + 1 == unit.level);
        let boxes = below().flat_map(|(below, _)| &below.tiles);
        let least_sq = boxes.map(|(own, _)| own.gap_sq(&around)).fold(f64::INFINITY, f64::min);
        let most_sq = (NEAR_STEPS * step).powi(2).max(least_sq);
        let mut out = Vec::new();
        for (below, cell) in below() {
            let tiles = below.tiles.iter().zip(&cell.tiles).enumerate();
            for (n, (&(bounds, n_triangles), tile)) in tiles {
                if bounds.gap_sq(&around) <= most_sq {
                    out.push(PagedTile {
                        path: self.folder.join(tile_path(below.level, below.cell, n)),
                        bytes: [tile.bytes, tile.image_bytes],
                        n_triangles,
                        bounds,
                        origin: self.frame.origin,
                    });
                }
            }
        }
        out
    }

    fn one(&mut self, unit: &Unit, all: (&[Unit], &[PaintedCell])) -> Result<PaintedCell> {
        let Unit { level, cell, before, .. } = *unit;
        let n_tiles = unit.tiles.len();
        let scalars = self.frame.scalars;
        let shapes = read_shapes(&self.folder.join(SHAPES), (level, cell), n_tiles, scalars)?;
        let origin = self.frame.origin;
        let meshes: Vec<Mesh> = shapes.iter().map(|shape| surface(&shape.tile, origin)).collect();
        // Triangles of a level are twice as long as those of the one below.
        let texels_per_unit = self.texels_per_unit / f64::from(level).exp2();
        let step = shapes.iter().map(|shape| shape.tile.step).fold(0.0, f64::max);
        let pictures = if level == 0 {
            // Lattices of borders are twice as wide.
            let same_within = self.is_finest.then_some(2.0 * step);
            self.painter.paint(&meshes, (texels_per_unit, 1), same_within)?
        } else {
            self.painter.paint_from(self.finer(unit, step, all), &meshes, texels_per_unit)?
        };
        drop(meshes);
        let mut out = PaintedCell::default();
        let mut borders = Vec::with_capacity(n_tiles);
        in_order(
            n_tiles as u64,
            self.run.threads,
            self.run.progress,
            |n, encoded: &mut Encoded| {
                let (shape, picture) = (&shapes[n as usize], &pictures[n as usize]);
                let places = Places {
                    chart: &picture.chart,
                    no_chart: TilePicture::NO_CHART,
                    corners: &picture.corners,
                };
                let tile = before + n as u32;
                *encoded =
                    encode_with_page(shape, places, (picture.page(), self.packs), scalars, tile);
                Ok(())
            },
            |n, (bytes, border)| {
                let path = self.folder.join(tile_path(level, cell, n as usize));
                self.put(&path, bytes)?;
                let picture = &pictures[n as usize];
                out.tiles.push(PaintedTile {
                    bytes: bytes.len() as u64,
                    checksum: xxh3_64(bytes),
                    image_bytes: picture.image.len() as u64,
                    charts: picture.n_charts,
                    texels: picture.texels,
                    covered_texels: picture.covered_texels,
                    texels_per_unit: picture.texels_per_unit,
                });
                borders.push(std::mem::take(border));
                Ok(())
            },
        )?;
        let bytes = encode_borders(&borders);
        self.put(&self.folder.join(border_name(level, cell)), &bytes)?;
        out.borders = (xxh3_64(&bytes), bytes.len() as u64);
        Ok(out)
    }

    fn put(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        put_file(self.run.disk(), path, bytes)?;
        self.run.disk().disown(bytes.len() as u64);
        Ok(())
    }
}

/// A tile's file and its numbers.
type Encoded = (Vec<u8>, crate::io::tileset::TileBorder);
