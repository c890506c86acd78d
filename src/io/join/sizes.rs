//! Sizes of parts: one of other units stands out.

use crate::ply::PartReport;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{length_sq, sub};

/// A part this many times larger or smaller than most has other units.
const OTHER_UNITS: f64 = 300.0;

/// Lines on parts whose size is not that of the others.
pub(super) fn odd_sizes(boxes: &[Bounds], reports: &[PartReport]) -> Vec<String> {
    let sizes: Vec<f64> = boxes.iter().map(|b| length_sq(sub(b.high, b.low)).sqrt()).collect();
    let mut sorted = sizes.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted[sorted.len() / 2];
    let is_odd = |size: f64| size > OTHER_UNITS * middle || size * OTHER_UNITS < middle;
    let odd: Vec<usize> = (0..sizes.len()).filter(|&i| is_odd(sizes[i])).collect();
    let Some(&first) =
        odd.first().filter(|_| sizes.len() > 2 && odd.len() * 4 <= sizes.len().max(4))
    else {
        return Vec::new();
    };
    let more = match odd.len() {
        1 => String::new(),
        n => format!(" ({n} such in all)"),
    };
    vec![format!(
        "{}: is {:.3e} across, most files are {middle:.3e}: if its units are others, convert it with --scale first{more}",
        reports[first].path, sizes[first]
    )]
}
