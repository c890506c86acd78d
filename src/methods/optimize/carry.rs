//! Colours, normals, numbers and labels of the vertices of an optimised mesh: those of the mesh as it was, at the nearest
//! place.

use stonecut_measure::tree::{Nearest, Tree};
use stonecut_measure::triangle;
use stonecut_mesh::Mesh;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Vertices that go to a thread together.
const BLOCK: usize = 4096;

/// Fills channels and records of `mesh` from `before`, whose records are those given.
pub(super) fn carry(
    before: &Mesh,
    mesh: &mut Mesh,
    records: &mut Vec<u8>,
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    let tree = Tree::build_until(before.triangles.len(), |t| before.corners(t), progress)?;
    let (n, n_channels) = (mesh.positions.len(), mesh.n_channels);
    let record_bytes = records.len() / before.positions.len().max(1);
    let mut channels = Vec::with_capacity(n * n_channels);
    let mut labels = Vec::with_capacity(records.len());
    in_order(
        n.div_ceil(BLOCK) as u64,
        threads,
        progress,
        |block, out: &mut (Vec<f32>, Vec<u32>)| {
            out.0.clear();
            out.1.clear();
            let from = block as usize * BLOCK;
            for v in from..n.min(from + BLOCK) {
                let point = mesh.positions[v];
                let is_same = before.positions[v] == point;
                let (corners, weights) = match is_same {
                    true => ([v as u32; 3], [1.0, 0.0, 0.0]),
                    false => {
                        let found = tree.nearest(point, Nearest::NONE);
                        let (_, weights) = triangle::closest(point, tree.corners(found.slot));
                        let t = tree.id(found.slot) as usize;
                        let first = triangle::rotation(&before.corners(t));
                        (before.triangles[t], triangle::rotate(weights, (3 - first) % 3))
                    }
                };
                let mixed = |k: usize| {
                    let value = |v: u32| f64::from(before.channels_of(v)[k]);
                    let terms = corners.iter().zip(weights).map(|(&v, w)| (w, value(v)));
                    let mixed = terms.clone().map(|(w, x)| w * x).sum::<f64>();
                    if mixed.is_finite() || is_same {
                        return if is_same { value(v as u32) } else { mixed } as f32;
                    }
                    // Values that are missing do not count.
                    let known = terms.filter(|(_, x)| x.is_finite());
                    let (weight, sum) =
                        known.fold((0.0, 0.0), |(all, sum), (w, x)| (all + w, sum + w * x));
                    (sum / weight) as f32
                };
                out.0.extend((0..n_channels).map(mixed));
                let nearest =
                    (1..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
                out.1.push(corners[nearest]);
            }
            Ok(())
        },
        |_, (some, nearest)| {
            channels.append(some);
            for &v in nearest.iter() {
                let from = v as usize * record_bytes;
                labels.extend_from_slice(&records[from..from + record_bytes]);
            }
            Ok(())
        },
    )?;
    mesh.channels = channels;
    *records = labels;
    Ok(())
}
