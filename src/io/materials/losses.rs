//! Parts of materials that a kind of output has no place for.

use super::description::{Alpha, MapKind, Material, Materials};
use crate::output_format::OutputKind;
use stonecut_system::losses::{Ledger, Loss, LossKind, Severity};

/// The colour that a material has besides its images.
const COLOUR: &str = "colour";

/// The light that a material emits besides its images.
pub const EMITTED: &str = "emitted light";

/// Vertices without a colour where others have one.
pub const BARE_VERTICES: &str = "vertices without colour";

/// Faces without coordinates whose material has an image.
pub const BARE_FACES: &str = "faces without texture coordinates";
/// The fate of `BARE_FACES`.
pub const BARE_REASON: &str = "their material has an image: 0 0 stands for the coordinates";

/// Kinds of images that each kind of output holds.
fn holds(kind: OutputKind, map: MapKind) -> bool {
    use MapKind::{Base, Emissive, MetallicRoughness, Normal, Occlusion};
    match kind {
        OutputKind::Obj => !matches!(map, MetallicRoughness | Occlusion),
        OutputKind::Glb => matches!(map, Base | Emissive | Normal | MetallicRoughness | Occlusion),
        OutputKind::Ply => map == Base,
        OutputKind::Stl => false,
    }
}

/// Enters what an output of this kind is without: images, colours, flags and lines.
///
/// A whole kind is lost where no image is left, or where the colours of materials are all that the mesh had of colour.
pub(super) fn enter(kind: OutputKind, materials: &Materials, losses: &mut Ledger) {
    let reason = format!("{} has no place for it", kind.name());
    let remedy = match kind {
        OutputKind::Obj => "GLB has",
        OutputKind::Glb => "OBJ has",
        OutputKind::Ply | OutputKind::Stl => "OBJ and GLB have more",
    };
    let keeps_an_image = materials.has_image(|map| holds(kind, map));
    let has_base = materials.has_image(|map| map == MapKind::Base);
    for material in &materials.list {
        let mut lose = |of: LossKind, what: &str, is_whole: bool| {
            let severity = if is_whole { Severity::Whole } else { Severity::Partial };
            let loss = Loss::new(of, what, &reason).remedy(remedy).severity(severity);
            losses.lose(loss.example(format!("material '{}'", material.name)));
        };
        for map in &material.maps {
            // Where it is the opacity of the colour image, that holds it.
            let is_held = map.kind == MapKind::Opacity && materials.has_clear_base(material);
            if kind == OutputKind::Glb && is_held {
                continue;
            }
            if holds(kind, map.kind) && map.strength != 1.0 && kind != OutputKind::Glb {
                lose(LossKind::Images, &format!("strength of the {}", map.kind.name()), false);
            }
            if !holds(kind, map.kind) {
                lose(LossKind::Images, map.kind.name(), !keeps_an_image);
            } else if kind == OutputKind::Glb && map.place().has_others
                || kind == OutputKind::Ply && (map.place().has_others || map.place().is_clamped)
            {
                lose(LossKind::Images, &format!("options of the {}", map.kind.name()), false);
            } else if kind == OutputKind::Obj && map.has_unsaid_wrap()
                || kind == OutputKind::Ply && map.shows_wrap
            {
                let what = format!("tiling of the {} beyond its border", map.kind.name());
                lose(LossKind::Images, &what, false);
            }
        }
        for (what, holders) in traits(material, || materials.has_clear_base(material)) {
            let is_at_vertices =
                kind == OutputKind::Ply && what == COLOUR && material.is_at_vertices;
            if !holders.contains(&kind) && !is_at_vertices {
                let [r, g, b, _] = material.base;
                let is_colour = what == COLOUR;
                let of = if is_colour { LossKind::Colors } else { LossKind::Materials };
                // Grey is what programs write where no colour was chosen.
                lose(of, what, is_colour && !has_base && (r != g || g != b));
            }
        }
        if kind != OutputKind::Obj {
            for word in telling_lines(material) {
                lose(LossKind::Materials, &format!("line '{word}'"), false);
            }
        }
    }
}

/// Colours and lines of a material that are neither in its images nor in what all pages of a bake have in common.
pub fn besides_pages(material: &Material) -> Vec<String> {
    const OWN: [&str; 3] = ["ambient colour", "highlights", EMITTED];
    let colours = traits(material, || false).into_iter().map(|(what, _)| what);
    let mut found: Vec<String> =
        colours.filter(|what| OWN.contains(what)).map(str::to_owned).collect();
    for line in telling_lines(material) {
        let what = format!("line '{line}'");
        if !found.contains(&what) {
            found.push(what);
        }
    }
    found
}

/// First words of the lines that only a material library can hold, without those that say nothing.
fn telling_lines(material: &Material) -> impl Iterator<Item = &str> {
    let lines = material.mtl_lines.iter().filter(|line| !line.starts_with("Ni 1"));
    let words = lines.map(|line| line.split_whitespace().next().unwrap_or_default());
    words.filter(|word| *word != "illum")
}

/// Colours and flags of a material that say something, and the kinds of output that hold them.
fn traits(
    material: &Material,
    has_clear_base: impl Fn() -> bool,
) -> Vec<(&'static str, &'static [OutputKind])> {
    use OutputKind::{Glb, Obj};
    let [r, g, b, opacity] = material.base;
    let is = |colour: Option<[f32; 3]>, usual: &[[f32; 3]]| {
        colour.is_some_and(|colour| !usual.contains(&colour))
    };
    // Whether the image of an opaque material has opacity, which does not count, is not known before it is decoded.
    let is_clear = matches!(material.alpha, Alpha::Blend | Alpha::Mask(_)) && has_clear_base();
    let is_matt = material.metallic.is_none_or(|x| x == 0.0 || x == 1.0)
        && material.roughness.is_none_or(|x| x == 1.0);
    let highlights = is(material.specular, &[[0.0; 3]]);
    let is_brighter = material.light() != [0.0; 3] && material.emissive_strength != 1.0;
    let found: [(&str, &[OutputKind], bool); 10] = [
        (COLOUR, &[Obj, Glb], [r, g, b] != [1.0; 3]),
        ("opacity", &[Obj, Glb], opacity != 1.0),
        ("opacity of the colour image", &[Obj, Glb], is_clear),
        ("ambient colour", &[Obj], is(material.ambient, &[[0.0; 3], [1.0; 3], [r, g, b]])),
        ("highlights", &[Obj], highlights),
        (EMITTED, &[Obj, Glb], is(material.emissive, &[[0.0; 3]])),
        ("strength of emitted light", &[Glb], is_brighter),
        ("metal and roughness", &[Obj, Glb], !is_matt),
        ("drawing of both sides", &[Glb], material.two_sided),
        ("independence of light", &[Obj, Glb], material.unlit),
    ];
    found.into_iter().filter(|(_, _, says)| *says).map(|(what, kinds, _)| (what, kinds)).collect()
}
