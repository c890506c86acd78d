//! The part of space near given points or edges, to hold the error there against the error elsewhere.
//!
//! A tool for those who look for seams: give it the vertices or edges along which cells met, and the
//! samples near them are counted apart.

use super::tree::{Nearest, Tree};
use super::triangle::{area, point_at};
use super::unit::Unit;
use std::sync::Arc;
use stonecut_io::ply::{FaceBlock, MeshSource, VertexBlock};
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::{Error, Result};
use stonecut_system::memory::BASE_BYTES;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;
use stonecut_system::units::show_bytes;

/// All points within some distance of given points and segments; copies share one tree.
#[derive(Clone, Debug)]
pub struct Region {
    tree: Arc<Tree>,
    within: f64,
}

impl Region {
    /// Everything within `within` (input units) of any of `points`.
    pub fn around_points(points: &[[f64; 3]], within: f64) -> Self {
        // A point is a triangle without extent, a segment one without width: the tree takes both.
        let tree = Tree::build(points.len(), |i| [points[i]; 3]);
        Region { tree: Arc::new(tree), within }
    }

    /// Memory for the vertices of `--near` with a tree over them.
    pub(super) fn needed_bytes(n_vertices: u64) -> u64 {
        POSITION_BYTES * n_vertices + Tree::bytes(n_vertices)
    }

    /// Memory for the vertices of the mesh whose triangles are held against a region.
    pub(super) fn beside_bytes(n_vertices: u64) -> u64 {
        POSITION_BYTES * n_vertices
    }

    /// Everything within `within` (input units) of any vertex of a file.
    ///
    /// Errors: those of reading; `NoMemory` where the budget `memory_bytes` (everything included) does not hold the vertices
    /// with a tree over them; `BadInput` for more than a tree can number.
    pub fn around_vertices(
        source: &MeshSource,
        within: f64,
        (memory_bytes, threads): (u64, usize),
        progress: &Progress,
    ) -> Result<Self> {
        let n = source.n_vertices();
        let needed = BASE_BYTES + POSITION_BYTES * n + Tree::bytes(n);
        if needed > memory_bytes {
            return Err(Error::NoMemory(format!(
                "the budget of {} does not hold the {n} vertices of {} (--near), which need {} in all; give more --memory, or \
                 a mesh of fewer vertices to --near",
                show_bytes(memory_bytes),
                source.path().display(),
                show_bytes(needed)
            )));
        }
        if n >= 1 << 31 {
            let what = format!("{n} vertices are too many for --near, which takes 2147483647");
            return Err(Error::bad_input(source.path(), what));
        }
        let points = positions(source, threads, progress)?;
        let tree = Tree::build_until(points.len(), |i| [points[i]; 3], progress)?;
        Ok(Region { tree: Arc::new(tree), within })
    }

    /// Everything within `within` (input units) of any of `segments`.
    pub fn around_segments(segments: &[[[f64; 3]; 2]], within: f64) -> Self {
        let tree =
            Tree::build(segments.len(), |i| [segments[i][0], segments[i][1], segments[i][1]]);
        Region { tree: Arc::new(tree), within }
    }

    /// Bytes that it takes at most.
    pub fn bytes(&self) -> u64 {
        Tree::bytes(self.tree.len() as u64)
    }

    /// The same region in another unit of length.
    pub fn in_unit(&self, unit: Unit) -> Self {
        if unit.is_own() {
            return self.clone();
        }
        let corners = |i: usize| self.tree.corners(i as u32).map(|corner| unit.place(corner));
        let tree = Arc::new(Tree::build(self.tree.len(), corners));
        Region { tree, within: unit.of(self.within) }
    }

    /// Returns whether `point` lies in the region.
    pub fn contains(&self, point: [f64; 3]) -> bool {
        let within_sq = self.within * self.within;
        let found = self.tree.nearest_unless_within(point, Nearest::NONE, within_sq);
        found.distance_sq <= within_sq
    }
}

/// Bytes of a place in memory.
const POSITION_BYTES: u64 = 24;

/// Reads the places of all vertices of a file, in order.
fn positions(source: &MeshSource, threads: usize, progress: &Progress) -> Result<Vec<[f64; 3]>> {
    let (schema, record_bytes) = (source.schema(), source.schema().record_bytes());
    let mut positions = Vec::new();
    positions.reserve_exact(source.n_vertices() as usize);
    let read = |index, block: &mut VertexBlock| source.read_vertices(index, block);
    in_order(source.n_vertex_blocks(), threads, progress, read, |_, block| {
        let records = block.records.chunks_exact(record_bytes);
        positions.extend(records.map(|record| schema.position(record)));
        Ok(())
    })?;
    Ok(positions)
}

/// Mean areas of a mesh's triangles near and far from a region (square input units), and their numbers.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct TriangleSizes {
    /// Triangles whose centroid lies in the region.
    pub near_triangles: u64,
    /// Their mean area; 0 if there are none.
    pub near_mean_area: f64,
    /// All others.
    pub far_triangles: u64,
    /// Their mean area; 0 if there are none.
    pub far_mean_area: f64,
}

/// Triangles of a block of faces, and their counts and areas: near ones, far ones.
#[derive(Default)]
struct SizeSums {
    block: FaceBlock,
    counts: [u64; 2],
    areas: [f64; 2],
}

impl TriangleSizes {
    /// Counts and areas of a mesh file, split by the position of the centroids.
    ///
    /// Memory: 24 bytes a vertex; faces are read block by block. Errors: those of reading; `NoMemory` where the budget
    /// `memory_bytes` (everything included) does not hold the vertices beside the region.
    pub fn of(
        source: &MeshSource,
        region: &Region,
        (memory_bytes, threads): (u64, usize),
        progress: &Progress,
    ) -> Result<Self> {
        let n = source.n_vertices();
        let needed = BASE_BYTES + POSITION_BYTES * n + region.bytes();
        if needed > memory_bytes {
            return Err(Error::NoMemory(format!(
                "the budget of {} does not hold the {n} vertices of {} beside those of --near, which need {} in all; give more \
                 --memory, or measure without --near",
                show_bytes(memory_bytes),
                source.path().display(),
                show_bytes(needed)
            )));
        }
        let positions = positions(source, threads, progress)?;
        let unit = Unit::around(&Bounds::around(&positions));
        let region = region.in_unit(unit);
        let look = |index, out: &mut SizeSums| {
            source.read_faces(index, &mut out.block)?;
            (out.counts, out.areas) = ([0; 2], [0.0; 2]);
            for corners in &out.block.triangles {
                let t = corners.map(|v| unit.place(positions[v as usize]));
                let third = 1.0 / 3.0;
                let side = usize::from(!region.contains(point_at(&t, [third, third, third])));
                out.counts[side] += 1;
                out.areas[side] += area(&t);
            }
            Ok(())
        };
        let (mut counts, mut areas) = ([0u64; 2], [0f64; 2]);
        in_order(source.n_face_blocks(), threads, progress, look, |_, found| {
            for side in 0..2 {
                counts[side] += found.counts[side];
                areas[side] += found.areas[side];
            }
            Ok(())
        })?;
        let mean = |side: usize| unit.back(unit.back(areas[side] / counts[side].max(1) as f64));
        Ok(TriangleSizes {
            near_triangles: counts[0],
            near_mean_area: mean(0),
            far_triangles: counts[1],
            far_mean_area: mean(1),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// A flat strip of squares of side 1 along x, of two triangles each; the second half is twice as high.
    fn strip(path: &Path, n: usize) -> MeshSource {
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            4 * n,
            2 * n
        );
        for square in 0..n {
            let (x, y) = (square, if square < n / 2 { 1 } else { 2 });
            text += &format!("{x} 0 0\n{} 0 0\n{} {y} 0\n{x} {y} 0\n", x + 1, x + 1);
        }
        for a in (0..4 * n).step_by(4) {
            text += &format!("3 {a} {} {}\n3 {a} {} {}\n", a + 1, a + 2, a + 2, a + 3);
        }
        std::fs::write(path, text).unwrap();
        MeshSource::open(path).unwrap()
    }

    #[test]
    fn triangles_near_and_far_are_counted_from_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let source = strip(&folder.path().join("strip.ply"), 20);
        let progress = Progress::default();
        for threads in [1, 3] {
            let means = (u64::MAX, threads);
            let points = [[5.0, 0.5, 0.0], [5.0, 0.5, 0.0]];
            let region = Region::around_points(&points, 5.1);
            let found = TriangleSizes::of(&source, &region, means, &progress).unwrap();
            assert_eq!((found.near_triangles, found.far_triangles), (20, 20), "{found:?}");
            assert!((found.near_mean_area - 0.5).abs() < 1e-12, "{found:?}");
            assert!((found.far_mean_area - 1.0).abs() < 1e-12, "{found:?}");
            let all = Region::around_vertices(&source, 0.8, means, &progress).unwrap();
            let found = TriangleSizes::of(&source, &all, means, &progress).unwrap();
            assert_eq!((found.near_triangles, found.far_triangles), (40, 0), "{found:?}");
        }
    }

    #[test]
    fn a_budget_too_small_for_the_vertices_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let source = strip(&folder.path().join("strip.ply"), 200);
        let progress = Progress::default();
        let near = |bytes| Region::around_vertices(&source, 1.0, (bytes, 1), &progress);
        let said = near(BASE_BYTES + 10_000).unwrap_err();
        assert!(matches!(&said, Error::NoMemory(what) if what.contains("--near")), "{said}");
        let region = near(BASE_BYTES + 200_000).unwrap();
        assert!(region.bytes() >= 800 * 72);
        let sizes = |bytes| TriangleSizes::of(&source, &region, (bytes, 1), &progress);
        let said = sizes(BASE_BYTES + region.bytes() + 10_000).unwrap_err();
        assert!(matches!(&said, Error::NoMemory(what) if what.contains("--near")), "{said}");
        sizes(BASE_BYTES + region.bytes() + 24 * 800).unwrap();
    }
}
