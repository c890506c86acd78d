//! Parts of the input that a tree of tiles does not hold, or holds otherwise.

use super::report::PagesReport;
use crate::bake::Coloured;
use crate::error::Result;
use crate::io::materials::{Materials, all_missing};
use crate::io::ply::MeshSource;
use crate::io::{NUMBER, lost_comments};
use crate::render::texture::SEEN;
use crate::store::cells::GroupRecord;
use crate::system::losses::{Ledger, Loss, LossKind};

/// Properties of vertices that tiles do not carry, and values that they do not hold as they were.
fn scalar_losses(lost: &[String], leaves: Option<&Vec<GroupRecord>>) -> Ledger {
    let mut losses = Ledger::default();
    if !lost.is_empty() {
        let what = format!("properties of vertices ({})", lost.join(", "));
        let loss = Loss::new(LossKind::Attributes, what, "not carried by tiles");
        losses.lose(loss.count(lost.len() as u64));
    }
    let tiles = leaves.into_iter().flatten().flat_map(|record| &record.tiles);
    let inexact: u64 = tiles.map(|tile| tile.inexact).sum();
    if inexact > 0 {
        let why = "not exact in tiles: 0 stands for what is not a number, the largest float for what is beyond it; tiny doubles \
                   and integers beyond 2^53 are rounded";
        let loss = Loss::new(LossKind::Precision, "values of properties of vertices", why);
        losses.lose(loss.count(inexact));
    }
    losses
}

/// All that the tree does not hold of its input, and remarks on it.
pub(super) fn all_losses(
    source: &MeshSource,
    (coloured, of_world): (Option<Coloured>, Vec<Loss>),
    (lost, leaves): (&[String], Option<&Vec<GroupRecord>>),
    pages: Option<&PagesReport>,
) -> Result<Ledger> {
    let mut losses = source.losses();
    of_world.into_iter().for_each(|loss| losses.lose(loss));
    losses.merge(&losses_of(source, coloured, pages));
    losses.merge(&scalar_losses(lost, leaves));
    source.remarks()?.into_iter().chain(source.clamped_colours()).for_each(|l| losses.lose(l));
    if let Some(materials) = source.materials().filter(|materials| materials.lacks_images()) {
        losses.lose(all_missing(materials.images.len()));
    }
    Ok(losses)
}

const ALL: &str = "texture coordinates and images";

/// Said of images and materials that are not there.
const INSTEAD: &str = "not carried: vertices have colours out of them instead";

/// Parts of the input that tiles do not carry.
fn losses_of(
    source: &MeshSource,
    coloured: Option<Coloured>,
    pages: Option<&PagesReport>,
) -> Ledger {
    let mut losses = Ledger::default();
    let comments = source.plain_comments();
    let lost = lost_comments(&comments, source.obj_infos(), "not carried by tiles");
    lost.into_iter().for_each(|loss| losses.lose(loss));
    let is_coloured = coloured.is_some();
    let has_colours = source.materials().is_some_and(|all| {
        all.images.is_empty() || all.shown().has_image(|map| SEEN.contains(&map))
    });
    if let Some(pages) = pages {
        losses.merge(&pages.losses);
    } else if source.require_no_texture().is_err() {
        let (what, instead) = match (is_coloured, has_colours) {
            (true, true) => (ALL, INSTEAD),
            (true, false) => ("materials", INSTEAD),
            (false, _) => (ALL, "not carried: tiles have vertex colours only"),
        };
        losses.lose(Loss::new(LossKind::Images, what, instead));
        source.materials().into_iter().for_each(|all| lose_other_images(all, &mut losses));
    } else if is_coloured {
        losses.lose(Loss::new(LossKind::Materials, "materials", INSTEAD));
    } else if source.materials().is_some_and(|all| !all.images.is_empty()) {
        let why = "not carried: faces have no texture coordinates";
        let loss = Loss::new(LossKind::Images, "images", why).whole();
        losses.lose(loss.remedy("where vertices have them, convert the mesh to OBJ first"));
    }
    if let Some(coloured) = coloured {
        losses.merge(&coloured.losses);
    }
    let others = source.face_properties().into_iter().map(|p| p.name);
    let (numbers, faces): (Vec<String>, Vec<String>) = others.partition(|name| name == NUMBER);
    // The number of the material goes with the images.
    if !numbers.is_empty() && !is_coloured && pages.is_none() {
        let loss =
            Loss::new(LossKind::Materials, "materials and their colours", "not carried by tiles");
        losses.lose(loss);
    }
    if !faces.is_empty() {
        let what = format!("properties of faces ({})", faces.join(", "));
        let loss = Loss::new(LossKind::Attributes, what, "not carried by tiles");
        losses.lose(loss.count(faces.len() as u64).whole());
    }
    losses
}

/// Enters the images that vertices have no colours out of; all of them where none is of colours.
fn lose_other_images(materials: &Materials, losses: &mut Ledger) {
    let shown = materials.shown();
    let has_colours = shown.has_image(|kind| SEEN.contains(&kind));
    for material in &shown.list {
        for map in material.maps.iter().filter(|map| !SEEN.contains(&map.kind)) {
            let loss = Loss::new(LossKind::Images, map.kind.name(), "not carried by tiles");
            let loss = loss.example(format!("material '{}'", material.name));
            losses.lose(if has_colours { loss } else { loss.whole() });
        }
    }
}
