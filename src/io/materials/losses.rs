//! Parts of materials that a kind of output has no place for, as lines for people.

use super::description::{Alpha, Losses, MapKind, Material, Materials};
use crate::io::output_format::OutputKind;

/// Kinds of images that each kind of output holds.
fn holds(kind: OutputKind, map: MapKind) -> bool {
    use MapKind::{
        Ambient, Base, Bump, Emissive, MetallicRoughness, Normal, Occlusion, Opacity, Specular,
    };
    match kind {
        OutputKind::Obj => {
            matches!(map, Base | Emissive | Opacity | Specular | Ambient | Bump | Normal)
        }
        OutputKind::Glb => matches!(map, Base | Emissive | Normal | MetallicRoughness | Occlusion),
        OutputKind::Ply => map == Base,
        OutputKind::Stl => false,
    }
}

/// The image lines that an output of this kind is without, and colours and flags.
pub(super) fn lines(kind: OutputKind, materials: &Materials) -> Vec<String> {
    let mut losses = Losses::default();
    for material in &materials.list {
        let name = &material.name;
        for map in &material.maps {
            if !holds(kind, map.kind) {
                losses.add(map.kind.name(), name);
            } else if !map.options.is_empty() && kind != OutputKind::Obj {
                losses.add(format!("options of the {}", map.kind.name()), name);
            }
        }
        for (what, holders) in traits(material) {
            if !holders.contains(&kind) {
                losses.add(what, name);
            }
        }
        if kind != OutputKind::Obj {
            for line in &material.mtl_lines {
                let word = line.split_whitespace().next().unwrap_or_default();
                if word != "illum" && !line.starts_with("Ni 1") {
                    losses.add(format!("line '{word}'"), name);
                }
            }
        }
    }
    let reason = match kind {
        OutputKind::Obj => "OBJ has no place for it",
        OutputKind::Glb => "GLB has no place for it",
        OutputKind::Ply => "PLY has no place for it",
        OutputKind::Stl => "STL has no place for it",
    };
    losses.lines(reason)
}

/// Colours and flags of a material that say something, and the kinds of output that hold them.
fn traits(material: &Material) -> Vec<(&'static str, &'static [OutputKind])> {
    use OutputKind::{Glb, Obj};
    let [r, g, b, opacity] = material.base;
    let is = |colour: Option<[f32; 3]>, usual: &[[f32; 3]]| {
        colour.is_some_and(|colour| !usual.contains(&colour))
    };
    let has_base = material.map(MapKind::Base).is_some();
    let is_matt = material.metallic.is_none_or(|x| x == 0.0 || x == 1.0)
        && material.roughness.is_none_or(|x| x == 1.0);
    let highlights = is(material.specular, &[[0.0; 3]]);
    let found: [(&str, &[OutputKind], bool); 9] = [
        ("colour", &[Obj, Glb], [r, g, b] != [1.0; 3]),
        ("opacity", &[Obj, Glb], opacity != 1.0),
        ("opacity of the colour image", &[Glb], material.alpha != Alpha::Plain && has_base),
        ("ambient colour", &[Obj], is(material.ambient, &[[0.0; 3], [1.0; 3], [r, g, b]])),
        ("highlights", &[Obj], highlights),
        ("emitted light", &[Obj, Glb], is(material.emissive, &[[0.0; 3]])),
        ("metal and roughness", &[Obj, Glb], !is_matt),
        ("drawing of both sides", &[Glb], material.two_sided),
        ("independence of light", &[Obj, Glb], material.unlit),
    ];
    found.into_iter().filter(|(_, _, says)| *says).map(|(what, kinds, _)| (what, kinds)).collect()
}
