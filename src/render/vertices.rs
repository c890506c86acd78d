//! Vertices in camera space while faces stream by: all of them, or the blocks used last.
//!
//! As long as they fit the budget, all vertices are held: 12 bytes each, 15 with colours, 27 with
//! normals. Beyond that a block of vertices is read when a face asks for it and kept until others have
//! been used more recently. Scans come in an order in which neighbours are near in the file, and then
//! every block is read little more than once; a shuffled file larger than the budget is refused rather
//! than read a thousand times.

use super::camera::Camera;
use super::scene::{Points, Scene};
use stonecut_io::ply::BLOCK_ROWS;
use stonecut_mesh::vec3::{dot, unit};
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;
use stonecut_system::units::show_bytes;

/// Mean number of reads of a vertex block above which the file counts as shuffled.
const MOST_READS: u64 = 12;

/// Blocks that are held however small the budget: some rows of neighbouring patches.
const LEAST_BLOCKS: u64 = 8;

/// A block of vertices in camera space.
#[derive(Default)]
struct Placed {
    places: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
    /// Unit normals of the file, zeros where they have no direction.
    normals: Vec<[f32; 3]>,
}

/// A vertex in camera space.
pub(super) struct PlacedVertex {
    pub(super) place: [f32; 3],
    pub(super) color: Option<[u8; 3]>,
    /// Its normal in the file, if that has any.
    pub(super) normal: Option<[f32; 3]>,
}

/// Vertices in camera space by number.
pub(super) struct Vertices<'a> {
    scene: &'a dyn Scene,
    camera: &'a Camera,
    /// Unit normals, where all vertices are held and normals were asked for.
    pub(super) normals: Vec<[f32; 3]>,
    /// For each vertex block its place among `held`.
    slots: Vec<Option<u32>>,
    held: Vec<Placed>,
    /// Block number of each of `held`, and the time of its last use.
    used: Vec<(u64, u64)>,
    clock: u64,
    /// Blocks that may be held.
    room: usize,
    reads: u64,
    points: Points,
}

/// Bytes of one vertex.
pub(super) fn vertex_bytes(colored: bool, normals: bool) -> u64 {
    12 + if colored { 3 } else { 0 } + if normals { 12 } else { 0 }
}

impl<'a> Vertices<'a> {
    /// Prepares the vertices of a scene within `budget_bytes`.
    pub(super) fn new(
        scene: &'a dyn Scene,
        camera: &'a Camera,
        budget_bytes: u64,
        threads: usize,
        progress: &Progress,
    ) -> Result<Self> {
        let block_bytes = BLOCK_ROWS * vertex_bytes(scene.is_colored(), scene.has_normals());
        let n_blocks = scene.n_point_blocks();
        let room = (budget_bytes / block_bytes).max(LEAST_BLOCKS).min(n_blocks.max(1));
        let mut vertices = Vertices {
            scene,
            camera,
            normals: Vec::new(),
            slots: vec![None; n_blocks as usize],
            held: Vec::new(),
            used: Vec::new(),
            clock: 0,
            room: room as usize,
            reads: 0,
            points: Points::default(),
        };
        if room >= n_blocks {
            let read = |block: u64, (points, placed): &mut (Points, Placed)| {
                scene.points(block, points)?;
                place(camera, points, placed);
                Ok(())
            };
            in_order(n_blocks, threads, progress, read, |block, (_, placed)| {
                vertices.slots[block as usize] = Some(block as u32);
                vertices.held.push(std::mem::take(placed));
                Ok(())
            })?;
        }
        Ok(vertices)
    }

    /// Returns whether every vertex is in memory.
    pub(super) fn all_held(&self) -> bool {
        self.held.len() == self.slots.len()
    }

    /// A vertex by its number.
    pub(super) fn get(&mut self, id: u64) -> Result<PlacedVertex> {
        let (block, row) = (id / BLOCK_ROWS, (id % BLOCK_ROWS) as usize);
        let slot = match self.slots[block as usize] {
            Some(slot) => slot as usize,
            None => self.load(block)?,
        };
        if !self.used.is_empty() {
            self.used[slot].1 = self.clock;
        }
        let placed = &self.held[slot];
        Ok(PlacedVertex {
            place: placed.places[row],
            color: placed.colors.get(row).copied(),
            normal: placed.normals.get(row).copied(),
        })
    }

    /// Marks the passing of time: what is used after this counts as more recent.
    pub(super) fn tick(&mut self) {
        self.clock += 1;
    }

    fn load(&mut self, block: u64) -> Result<usize> {
        self.reads += 1;
        if self.reads > MOST_READS * self.slots.len() as u64 {
            let (colored, normals) = (self.scene.is_colored(), self.scene.has_normals());
            let bytes = self.scene.n_vertices() * vertex_bytes(colored, normals);
            return Err(Error::NoMemory(format!(
                "the vertices of this mesh are in random order and do not fit into memory; give it \
                 --memory of at least {}, or render its simplification",
                show_bytes(bytes + (512 << 20))
            )));
        }
        let slot = if self.held.len() < self.room {
            self.held.push(Placed::default());
            self.used.push((block, self.clock));
            self.held.len() - 1
        } else {
            let oldest = (0..self.used.len()).min_by_key(|&slot| self.used[slot].1).unwrap_or(0);
            self.slots[self.used[oldest].0 as usize] = None;
            oldest
        };
        self.scene.points(block, &mut self.points)?;
        place(self.camera, &self.points, &mut self.held[slot]);
        self.used[slot] = (block, self.clock);
        self.slots[block as usize] = Some(slot as u32);
        Ok(slot)
    }
}

fn place(camera: &Camera, points: &Points, out: &mut Placed) {
    out.places.clear();
    out.places.extend(points.positions.iter().map(|p| camera.place(*p).map(|x| x as f32)));
    out.colors.clear();
    out.colors.extend_from_slice(&points.colors);
    let turned = |normal: &[f32; 3]| {
        let normal = unit(normal.map(f64::from)).unwrap_or_default();
        camera.axes.map(|axis| dot(axis, normal) as f32)
    };
    out.normals.clear();
    out.normals.extend(points.normals.iter().map(turned));
}
