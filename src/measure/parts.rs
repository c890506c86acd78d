//! Surfaces that come in parts: a whole mesh in memory, or the cells of a store on disk.
//!
//! One look at every part tells what the measurement must know beforehand: area, boxes, connectivity,
//! and a sparse set of points that bounds every later search. Measures nothing yet.

use super::sums::Sum;
use super::tree::{Nearest, Tree};
use super::triangle::Vector;
use super::{Carried, Surface, Unit};
use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::topology_counts::{CellCounts, CellPart, Topology, TopologyCounter, count_cell};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellStore, load_bytes};
use stonecut_system::error::Result;
use stonecut_system::parallel::{self, Weighted};
use stonecut_system::progress::Progress;

/// Most of the sparse points that bound searches; 22 MiB of tree.
const SPARSE_POINTS: u64 = 200_000;

/// Share of the memory that their tree may take; fewer points bound a search less tightly, no less truly.
const SPARSE_SHARE: u64 = 8;

/// Place of a surface: in memory or on disk.
#[derive(Clone, Copy)]
pub enum Place<'a> {
    /// In memory, as one part.
    Memory(&'a Mesh),
    /// On disk, a part a cell.
    Cells(&'a CellStore),
}

/// A surface to be measured, wherever it is.
#[derive(Clone, Copy)]
pub struct Parts<'a> {
    /// Place of its data.
    pub place: Place<'a>,
    /// Channels with its colours.
    pub colours: Option<Carried>,
    /// All vertices, unused ones included.
    pub n_vertices: u64,
    /// A box around all vertices.
    pub bounds: Bounds,
    /// The unit that cells are turned to when they are loaded.
    unit: Unit,
}

/// Findings of one pass over a surface.
pub(super) struct Survey {
    /// The box of each part's used vertices.
    pub boxes: Vec<Bounds>,
    /// The box of them all.
    pub bounds: Bounds,
    pub area: f64,
    pub topology: Topology,
    /// Points of the surface: no search goes farther than to the nearest of them.
    sparse: Tree,
}

/// The surroundings of out-of-core work.
#[derive(Clone, Copy)]
pub(super) struct Means<'a> {
    pub threads: usize,
    pub memory_bytes: u64,
    pub progress: &'a Progress,
    /// Triangles count as work done.
    pub is_counted: bool,
}

impl<'a> Parts<'a> {
    /// A mesh in memory.
    pub fn in_memory(mesh: &'a Mesh, colours: Option<Carried>) -> Self {
        let bounds = Bounds::around(&mesh.positions);
        let (place, n_vertices) = (Place::Memory(mesh), mesh.positions.len() as u64);
        Parts { place, colours, n_vertices, bounds, unit: Unit::OWN }
    }

    /// The cells of a store, which hold a mesh of `n_vertices` vertices within `bounds`.
    pub fn in_cells(store: &'a CellStore, n_vertices: u64, bounds: Bounds) -> Self {
        let colours = Carried::of(&store.layout().schema);
        Parts { place: Place::Cells(store), colours, n_vertices, bounds, unit: Unit::OWN }
    }

    /// A copy of a mesh in memory in another unit; `None` for cells, which are turned as they are loaded.
    pub(super) fn turned_mesh(&self, unit: Unit) -> Option<Mesh> {
        let Place::Memory(mesh) = self.place else { return None };
        let mut mesh = mesh.clone();
        unit.turn(&mut mesh);
        Some(mesh)
    }

    /// The same surface in another unit, with its `turned_mesh`.
    pub(super) fn in_unit<'b>(&self, unit: Unit, mesh: &'b Option<Mesh>) -> Parts<'b>
    where
        'a: 'b,
    {
        let place = mesh.as_ref().map_or(self.place, Place::Memory);
        Parts { place, bounds: self.bounds.map(|point| unit.place(point)), unit, ..*self }
    }

    /// Returns the number of parts.
    pub fn n_parts(&self) -> usize {
        match self.place {
            Place::Memory(_) => 1,
            Place::Cells(store) => store.n_cells(),
        }
    }

    /// Triangles of one part.
    pub fn n_triangles(&self, part: usize) -> u64 {
        match self.place {
            Place::Memory(mesh) => mesh.triangles.len() as u64,
            Place::Cells(store) => store.info().cells[part].triangles,
        }
    }

    /// Bytes that loading a part takes, mesh included.
    pub fn bytes(&self, part: usize) -> u64 {
        match self.place {
            Place::Memory(_) => 0,
            Place::Cells(store) => load_bytes(store.info().cells[part], store.layout()),
        }
    }

    /// Lets a part be read in the background.
    fn expect(&self, part: usize) {
        if let Place::Cells(store) = self.place {
            store.expect(CellId::at(part));
        }
    }

    /// Loads a part.
    pub fn load(&self, part: usize) -> Result<Cow<'_, Mesh>> {
        Ok(match self.place {
            Place::Memory(mesh) => Cow::Borrowed(mesh),
            Place::Cells(store) => {
                let mut mesh = store.load(CellId::at(part))?.mesh;
                self.unit.turn(&mut mesh);
                Cow::Owned(mesh)
            }
        })
    }

    /// Runs `work` on every listed part, in parallel within the memory budget, and hands the results to
    /// `gather` in any order; `more_bytes` is what `work` takes besides the part itself.
    pub(super) fn for_each<T>(
        &self,
        parts: impl Iterator<Item = usize>,
        means: Means,
        more_bytes: impl Fn(u64) -> u64,
        work: impl Fn(usize, Surface) -> T + Sync,
        gather: impl FnMut(T) + Send,
    ) -> Result<()> {
        let weigh =
            |item| Weighted { item, bytes: self.bytes(item) + more_bytes(self.n_triangles(item)) };
        let gather = Mutex::new(gather);
        let jobs = parts.map(weigh).collect();
        let soon = |part| self.expect(part);
        let Means { threads, memory_bytes, progress, .. } = means;
        parallel::largest_first(jobs, threads, memory_bytes, progress, soon, |part| {
            let mesh = self.load(part)?;
            let result = work(part, Surface { mesh: &mesh, colour: self.colours });
            if means.is_counted {
                means.progress.add(mesh.triangles.len() as u64);
            }
            (*gather.lock().unwrap_or_else(PoisonError::into_inner))(result);
            Ok(())
        })
    }

    /// Looks at every part once.
    pub(super) fn survey(&self, means: Means) -> Result<Survey> {
        let n_parts = self.n_parts();
        let diagonal = self.bounds.diagonal();
        let n_triangles: u64 = (0..n_parts).map(|part| self.n_triangles(part)).sum();
        let most = ((means.memory_bytes / SPARSE_SHARE).saturating_mul(1000) / Tree::bytes(1000))
            .min(SPARSE_POINTS);
        let stride = (n_triangles / most.max(1) + 1) as usize;
        let mut boxes = vec![Bounds::EMPTY; n_parts];
        let mut area = Sum::new(diagonal * diagonal);
        let mut counter = TopologyCounter::default();
        let mut sparse: Vec<(usize, Vec<Vector>)> = Vec::new();
        let weigh = |item| Weighted { item, bytes: self.bytes(item) + 60 * self.n_triangles(item) };
        let jobs = (0..n_parts).map(weigh).collect();
        let gathered = Mutex::new(|part: usize, look: PartLook| {
            boxes[part] = look.bounds;
            area.merge(&look.area);
            counter.add(look.counts);
            sparse.push((part, look.points));
        });
        let soon = |part| self.expect(part);
        let Means { threads, memory_bytes, progress, .. } = means;
        parallel::largest_first(jobs, threads, memory_bytes, progress, soon, |part| {
            let look = self.look(part, diagonal, stride)?;
            means.progress.add(self.n_triangles(part));
            (*gathered.lock().unwrap_or_else(PoisonError::into_inner))(part, look);
            Ok(())
        })?;
        // The order of the parts decides how the tree is built, though not what it answers.
        sparse.sort_unstable_by_key(|(part, _)| *part);
        let points: Vec<Vector> = sparse.into_iter().flat_map(|(_, points)| points).collect();
        let bounds = boxes.iter().fold(Bounds::EMPTY, |all, part| all.joined(part));
        Ok(Survey {
            boxes,
            bounds,
            area: area.value(),
            topology: counter.finish(self.n_vertices),
            sparse: Tree::build_until(points.len(), |i| [points[i]; 3], means.progress)?,
        })
    }

    fn look(&self, part: usize, diagonal: f64, stride: usize) -> Result<PartLook> {
        let look = |mesh: &Mesh, counts: CellCounts| {
            let surface = Surface { mesh, colour: None };
            let some = mesh.triangles.iter().step_by(stride);
            PartLook {
                bounds: Bounds::of(mesh),
                area: surface.area(diagonal),
                counts,
                points: some.map(|t| mesh.positions[t[0].max(t[1]).max(t[2]) as usize]).collect(),
            }
        };
        Ok(match self.place {
            Place::Memory(mesh) => look(mesh, stonecut_mesh::topology_counts::count_mesh(mesh)),
            Place::Cells(store) => {
                let mut cell = store.load(CellId::at(part))?;
                self.unit.turn(&mut cell.mesh);
                let (triangles, shared) = (&cell.mesh.triangles[..], &cell.shared[..]);
                let counts = count_cell(&CellPart { triangles, global: &cell.ids, shared });
                look(&cell.mesh, counts)
            }
        })
    }
}

/// Findings of one pass over a part.
struct PartLook {
    bounds: Bounds,
    area: Sum,
    counts: CellCounts,
    points: Vec<Vector>,
}

impl Survey {
    /// Returns whether nothing of a surface is there.
    pub fn is_empty(&self) -> bool {
        self.sparse.is_empty()
    }

    /// Memory that it holds, in bytes.
    pub fn bytes(&self) -> u64 {
        Tree::bytes(self.sparse.len() as u64)
    }

    /// Used vertices.
    pub fn n_used(&self) -> u64 {
        self.topology.vertices - self.topology.unreferenced_vertices
    }

    /// A squared distance that the nearest point of the surface does not exceed, and the sparse point it
    /// was found at, as a hint for the next call.
    pub fn bound_sq(&self, point: Vector, hint: u32) -> (f64, u32) {
        let found = self.sparse.nearest(point, self.sparse.guess(point, hint));
        let found = if found.is_found() { found } else { Nearest::NONE };
        // A triangle's own distance is computed in another way than that of its corner: allow rounding.
        (found.distance_sq * (1.0 + 1e-9), found.slot)
    }
}
