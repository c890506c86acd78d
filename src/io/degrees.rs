//! Meshes in degrees whose heights are metres, where lengths are reckoned with as they are: said, with the map that makes metres.

use crate::globe::Crs;
use crate::ply::MeshSource;
use crate::sidecars::crs_in;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::losses::{Loss, LossKind};

/// Heights over widths from which on coordinates of no known system look like degrees and metres: a slope of one in 200 has 550
/// metres of height over a degree. No ordinary mesh is so tall on so small a foot away from the origin.
const TALL: f64 = 500.0;

/// Distance from the origin, in widths, of a mesh that is counted in degrees.
const AWAY: f64 = 2.0;

/// A remark on a mesh in a box whose x and y are degrees, by its system or by its looks.
pub fn degrees_remark(source: &MeshSource, bounds: &Bounds) -> Option<Loss> {
    let is_y_up = source.file_format() == "glTF";
    let up = |[x, y, z]: [f64; 3]| if is_y_up { [x, 0.0 - z, y] } else { [x, y, z] };
    let [low, high] = [up(bounds.low), up(bounds.high)];
    let wide = [0, 1, 2].map(|k| (high[k] - low[k]).abs());
    let far = [0, 1].map(|k: usize| low[k].abs().max(high[k].abs()));
    let offset = source.offset().unwrap_or_default();
    let named = crs_in(source.comments()).filter(|crs| !crs.is_empty());
    let (crs, is_sure) = match named {
        Some(code) => (Crs::of(&code).ok().filter(Crs::is_geographic)?, true),
        None => (Crs::of("EPSG:4326").ok()?, false),
    };
    let is_tall = wide[2] > TALL * wide[0].max(wide[1]) && wide[0].min(wide[1]) > 0.0;
    let is_away = far[0].max(far[1]) > AWAY * wide[0].max(wide[1]);
    if !(is_sure || is_tall && is_away && far[0] <= 360.0 && far[1] <= 90.0) {
        return None;
    }
    let map = crs.local(bounds, offset, is_y_up).ok()?.map;
    let [x, y, z] = [0, 5, 10].map(|i| format!("{:.3}", map[i]));
    let what = match is_sure {
        true => format!("x and y are degrees of {}", crs.name()),
        false => "x and y look like degrees, heights like metres".to_owned(),
    };
    let why = "lengths and errors mix them, so that places count less than heights";
    let remedy = format!(
        "'tiles --crs' makes metres of them; elsewhere --transform {x},0,0,0,0,{y},0,0,0,0,{z},0,0,0,0,1 does, or a system in metres (UTM)"
    );
    Some(Loss::new(LossKind::Precision, what, why).notice().remedy(remedy))
}
