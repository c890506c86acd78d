//! Joins vertices that lie within rounding of each other, before everything else, out of core.
//!
//! Programs that write faces one by one leave a soup: every corner is a vertex, and copies of one place differ in their
//! last digits. No later step can see that they belong together, and cells share nothing. What is near is found by a sort
//! into a grid (`neighbours`), and the mesh is written again with one vertex for each place (`rewrite`). Decided from
//! counts and a sample (`survey`): an input without a reason pays nothing. Only vertices at open edges are joined
//! (`open_edges`). Equal positions within one cell are left to the kernel, and exact copies in STL to its reader.

mod edits;
mod neighbours;
mod overlaps;
mod rest;
mod rewrite;
mod splits;
mod survey;

use super::borders::OpenBorders;
use super::open_options::{StageOptions, Weld, WeldOptions};
use crate::ply::{MeshSource, WeldReport};
use stonecut_system::error::Result;
use stonecut_system::units::show_count;
use survey::Found;

/// Joins what `options.weld` says; where nothing is to be joined, the source as it is.
///
/// Memory: a third of the stage's for each of three sorts. Disk at peak: about 150 bytes for each vertex at an open edge,
/// 4 for every vertex, and the mesh twice: as it was and as it becomes.
pub fn weld(source: MeshSource, options: &StageOptions) -> Result<MeshSource> {
    let Some(how) = &options.weld else { return Ok(source) };
    let found = match how.how {
        Weld::Off => return Ok(source),
        Weld::Auto => match survey::survey(&source)? {
            None => return Ok(source),
            Some(found) => found,
        },
        Weld::Distance(distance) => survey::asked(&source, distance)?,
    };
    let n_triangles = source.n_triangles();
    let is_left = found.is_exact && n_triangles <= how.exact_above;
    if found.distance <= 0.0 || is_left {
        return Ok(with_note(source, &found));
    }
    Ok(with_note(rewrite::join(source, &found, None, how, options)?, &found))
}

/// Joins the borders of parts that were staged as one mesh: exact copies always, others as `options.weld` says.
pub fn join_parts(
    source: MeshSource,
    borders: &OpenBorders,
    options: &StageOptions,
) -> Result<MeshSource> {
    let plain = || WeldOptions {
        how: Weld::Auto,
        exact_above: 0,
        labels: Vec::new(),
        keeps_numbers: false,
    };
    let how = options.weld.clone().unwrap_or_else(plain);
    let found = survey::of_parts(&source, borders, how.how)?;
    let n_parts = source.parts().len();
    let mut source = rewrite::join(source, &found, Some(borders), &how, options)?;
    let vertices = source.n_vertices();
    let mut report =
        source.weld().cloned().unwrap_or(WeldReport { vertices, ..WeldReport::default() });
    let (joined, distance) = (show_count(report.joined), found.distance);
    let line = match report.joined {
        0 if borders.n_vertices() == 0 => {
            format!("{n_parts} files became one mesh: none has an open edge, so nothing is joined")
        }
        0 => format!(
            "{n_parts} files have no vertices in common within {distance:.1e}; if they belong together, --weld DISTANCE"
        ),
        _ => format!(
            "{n_parts} files became one mesh: {joined} vertices lay within {distance:.1e} of another and were joined"
        ),
    };
    if n_parts > 1 {
        report.notes.insert(0, line);
    }
    source.note_weld(report);
    Ok(source)
}

/// Notes what was seen beyond the distance within which vertices are joined.
fn with_note(mut source: MeshSource, found: &Found) -> MeshSource {
    if let Some(near) = found.suggested {
        let vertices = source.n_vertices();
        let pieces = show_count(source.n_triangles());
        let asked = near.wider;
        let none = WeldReport { vertices, ..WeldReport::default() };
        let mut report = source.weld().cloned().unwrap_or(none);
        report.notes.push(format!(
            "{pieces} triangles hardly have a vertex in common, but neighbours within {:.0e}: if they belong together, \
             --weld {asked:.0e}",
            near.distance
        ));
        source.note_weld(report);
    }
    source
}
