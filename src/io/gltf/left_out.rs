//! Parts of a glTF document that are not a mesh in its place: each goes into the ledger.

use super::json::Document;
use super::scene::Placed;
use crate::materials::Materials;
use stonecut_system::losses::{Loss, LossKind};

/// Extensions that a file may require: what is read, and what only changes the look.
pub(super) const KNOWN: [&str; 10] = [
    "KHR_texture_basisu",
    "KHR_draco_mesh_compression",
    "CESIUM_RTC",
    "EXT_mesh_gpu_instancing",
    "KHR_mesh_quantization",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
    "EXT_texture_avif",
    "EXT_texture_webp",
];

/// Enters what is left out of the scene, apart from what primitives and materials lack.
pub(super) fn enter(document: &Document, placed: &[Placed], out: &mut Materials) {
    let mut lose = |loss: Loss, n: usize| {
        if n > 0 {
            out.lose(loss.count(n as u64));
        }
    };
    let is_skinned = document.nodes.iter().any(|node| node.skin.is_some());
    let why = "the mesh is read as it rests, a skin as its first joint has it";
    let moves = is_skinned || !document.animations.is_empty();
    lose(Loss::new(LossKind::Elements, "skins and animations", why), usize::from(moves));
    let cameras = Loss::new(LossKind::Elements, "cameras", "not carried").notice();
    lose(cameras, document.cameras.len());
    let mut is_placed = vec![false; document.meshes.len()];
    for mesh in
        placed.iter().filter_map(|placed| document.meshes.get(placed.mesh).map(|_| placed.mesh))
    {
        is_placed[mesh] = true;
    }
    let n_hidden = is_placed.iter().filter(|is_placed| !**is_placed).count();
    let hidden = Loss::new(LossKind::Elements, "meshes", "not in the scene that is shown");
    lose(hidden, n_hidden);
    let bare = document.nodes.iter().filter(|node| node.mesh.is_none() && node.name.is_some());
    let names = Loss::new(LossKind::Names, "names of nodes without a mesh", "not carried").notice();
    lose(names, bare.count());
    let primitives = || document.meshes.iter().flat_map(|mesh| &mesh.primitives);
    for (what, n) in [
        ("nodes", document.nodes.iter().filter(|node| node.extras.has_others).count()),
        ("meshes", document.meshes.iter().filter(|mesh| mesh.extras.is_some()).count()),
        ("primitives", primitives().filter(|part| part.extras.is_some()).count()),
        ("materials", document.materials.iter().filter(|look| look.extras.is_some()).count()),
        ("scenes", document.scenes.iter().filter(|scene| scene.extras.is_some()).count()),
    ] {
        let what = format!("extras of {what}");
        lose(Loss::new(LossKind::Attributes, what, "not carried").notice(), n);
    }
    for name in &document.extensions_used {
        // Those of materials are looked for where materials are read.
        let is_read = KNOWN.contains(&name.as_str())
            || (name.starts_with("KHR_materials_") && name != "KHR_materials_variants");
        if !is_read {
            let loss = Loss::new(LossKind::Elements, "extension", "is not read").notice();
            out.lose(loss.example(format!("'{name}'")));
        }
    }
}
