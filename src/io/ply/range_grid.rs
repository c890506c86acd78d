//! Range grids: where a file has them. Their triangles are in `grid_mesh`.
//!
//! A scan as rows and columns of posts, each of which has a vertex or none.

use super::header::Header;
use super::raw::RawFile;
use super::scan::Mark;
use stonecut_system::error::Result;

/// Columns of a grid, at most: their rows are held in memory, some 100 bytes a column.
const MOST_COLUMNS: u64 = 1 << 22;

/// Place of a grid in its file, and its size.
#[derive(Clone, Copy, Debug)]
pub struct RangeGrid {
    /// Number of the element.
    pub element: usize,
    /// Place of its first row.
    pub mark: Mark,
    pub n_columns: u64,
    pub n_rows: u64,
}

/// The grid of posts of a file, its place not yet known; `None` if the header does not tell its columns and rows.
pub fn find(file: &RawFile, header: &Header) -> Result<Option<RangeGrid>> {
    let Some(place) = header.elements.iter().position(|e| e.name == "range_grid" && e.count > 0)
    else {
        return Ok(None);
    };
    let element = &header.elements[place];
    let number = |name: &str| {
        let value = |line: &String| line.strip_prefix(name)?.trim().parse::<u64>().ok();
        header.obj_infos.iter().find_map(value)
    };
    let (Some(n_columns), Some(n_rows)) = (number("num_cols "), number("num_rows ")) else {
        return Ok(None);
    };
    if n_columns.checked_mul(n_rows) != Some(element.count) {
        return Err(file.bad(format!(
            "obj_info num_cols and num_rows tell of {n_columns} x {n_rows} posts, element range_grid of {}; export \
             the scan again",
            element.count
        )));
    }
    if n_columns > MOST_COLUMNS {
        return Err(file.bad(format!(
            "obj_info num_cols tells of {n_columns} posts in a row, {MOST_COLUMNS} can be read; export the scan \
             with columns and rows in turn, or make a mesh of it first"
        )));
    }
    Ok(Some(RangeGrid { element: place, mark: Mark::default(), n_columns, n_rows }))
}
