//! Finds whether faces use vertices that are near each other in the input.

use stonecut_io::ply::{BLOCK_ROWS, FaceBlock, MeshSource};
use stonecut_system::error::Result;

/// Blocks of faces that are looked at, spread evenly.
const PROBES: u64 = 16;

/// Blocks of vertices that a block of faces may use; no more than this part of all, but two. Each is a read of some 16 KiB, if its pages were given up, where a
/// further pass would read and decode the faces themselves, some 800 KiB.
const MOST_BLOCKS: u64 = 16;
const MOST_SHARE: u64 = 4;

/// Returns whether the faces of most blocks use few blocks of vertices, so that a table in pages is read little more than
/// once. Scans as they come from a scanner, a grid or a triangulation are; shuffled ones are not.
pub fn is_local(source: &MeshSource) -> Result<bool> {
    let n_blocks = source.n_face_blocks();
    let n_probes = PROBES.min(n_blocks);
    let most = (source.n_vertex_blocks() / MOST_SHARE).clamp(2, MOST_BLOCKS) as usize;
    let (mut faces, mut used, mut n_far) = (FaceBlock::default(), Vec::new(), 0);
    for probe in 0..n_probes {
        source.read_faces(probe * n_blocks / n_probes, &mut faces)?;
        used.clear();
        used.extend(faces.triangles.iter().flatten().map(|id| id / BLOCK_ROWS));
        used.sort_unstable();
        used.dedup();
        n_far += u64::from(used.len() > most);
    }
    Ok(8 * n_far <= n_probes)
}
