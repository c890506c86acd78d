//! All meshes of a glTF scene in their places: those of nodes, once for each instance (`EXT_mesh_gpu_instancing`), those of skins
//! where their joints are, moved to where the file counts from (`CESIUM_RTC`).

use super::buffers::Buffers;
use super::elements::{BLOCK, Elements};
use super::json::{Document, Instances, Skeleton};
use super::scene::{MAX_PLACED, NodePlacement, Placed, placed};
use crate::ply::raw::RawFile;
use stonecut_system::error::Result;

/// Parts of the place of an instance: name, numbers, and values where there are none.
const PARTS: [(&str, &[f64]); 3] =
    [("TRANSLATION", &[0.0; 3]), ("ROTATION", &[0.0, 0.0, 0.0, 1.0]), ("SCALE", &[1.0; 3])];

/// Meshes in their places, in the order of nodes and instances; `turns_up` as `Placing` has it.
pub(super) fn all_placed(
    file: &RawFile,
    document: &Document,
    (buffers, turns_up): (&mut Buffers, bool),
) -> Result<Vec<Placed>> {
    let (nodes, places) = placed(file, document)?;
    // It counts in the axes of 3D Tiles, after y upwards has become z upwards (Cesium's readers do so; the extension's text is
    // silent). Where the axes stay as they are, so does it.
    let center = document.extensions.rtc.as_ref().map(|rtc| match (turns_up, rtc.center) {
        (true, [x, y, z]) => [x, z, -y],
        (false, center) => center,
    });
    let mut out = Vec::with_capacity(nodes.len());
    for Placed { mesh, node, at } in nodes {
        let skin = document.nodes[node].skin.and_then(|skin| document.skins.get(skin));
        let at = match skin {
            Some(skin) => at_rest(skin, &places, buffers)?.unwrap_or(at),
            None => at,
        };
        let at = center.map_or(at, |center| at.moved(center));
        match document.nodes.get(node).and_then(|node| node.extensions.instances.as_ref()) {
            None => out.push(Placed { mesh, node, at }),
            Some(instances) => {
                let each = |inner: NodePlacement| Placed { mesh, node, at: inner.inside(&at) };
                out.extend(placements(file, instances, buffers)?.into_iter().map(each));
            }
        }
        if out.len() > MAX_PLACED {
            return Err(file.bad(format!("more than {MAX_PLACED} meshes and instances of meshes")));
        }
    }
    Ok(out)
}

/// The place of a skin at rest: where its first joint has it. The node that names it does not move it (glTF 2.0, section 3.7.3.3).
fn at_rest(
    skin: &Skeleton,
    places: &[Option<NodePlacement>],
    buffers: &mut Buffers,
) -> Result<Option<NodePlacement>> {
    let first = skin.joints.first().and_then(|&joint| places.get(joint).copied().flatten());
    let (Some(joint), Some(number)) = (first, skin.inverse_bind_matrices) else { return Ok(first) };
    let (mut bytes, mut rows) = (Vec::new(), Vec::new());
    buffers.accessor(number, &[16])?.read(0, &mut bytes, &mut rows)?;
    let inverse = rows.first_chunk().map(NodePlacement::of_matrix);
    Ok(inverse.map_or(first, |inverse| Some(inverse.inside(&joint))))
}

/// Places of the instances of a node, seen from the node.
fn placements(
    file: &RawFile,
    instances: &Instances,
    buffers: &mut Buffers,
) -> Result<Vec<NodePlacement>> {
    let mut parts: Vec<Option<Elements>> = Vec::new();
    for (name, default) in PARTS {
        let number = instances.attributes.get(name);
        parts.push(number.map(|&number| buffers.accessor(number, &[default.len()])).transpose()?);
    }
    let mut counts = parts.iter().flatten().map(|part| part.count);
    // With no attribute that is known it is one instance, where its node is.
    let count = counts.next().unwrap_or(1);
    if counts.any(|other| other != count) {
        return Err(
            file.bad("the attributes of instances (EXT_mesh_gpu_instancing) differ in length")
        );
    }
    if count > MAX_PLACED as u64 {
        return Err(file.bad(format!("a node has {count} instances, more than {MAX_PLACED}")));
    }
    let (mut bytes, mut rows) = (Vec::new(), [Vec::new(), Vec::new(), Vec::new()]);
    let mut out = Vec::with_capacity(count as usize);
    let mut first = 0;
    while first < count {
        for (part, row) in parts.iter().zip(&mut rows) {
            if let Some(part) = part {
                part.read(first, &mut bytes, row)?;
            }
        }
        let n = BLOCK.min(count - first) as usize;
        for i in 0..n {
            let value = |k: usize| {
                let default = PARTS[k].1;
                rows[k].get(i * default.len()..(i + 1) * default.len()).unwrap_or(default)
            };
            let (shift, turn, scale) = (value(0), value(1), value(2));
            out.push(NodePlacement::new(
                [shift[0], shift[1], shift[2]],
                [turn[0], turn[1], turn[2], turn[3]],
                [scale[0], scale[1], scale[2]],
            ));
        }
        first += n as u64;
    }
    Ok(out)
}
