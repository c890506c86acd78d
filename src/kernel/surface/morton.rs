//! Brings vertices and triangles into coarse Morton order, so that blocks of triangles are compact.
//!
//! A counting sort over cells of a cube around the mesh: about 20 ns a triangle, whatever the order of
//! the input. Inside of a cell the order of the input stays. It moves only indices; the caller moves the
//! data.

use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::morton::spread;
use stonecut_mesh::vec3::Vec3;

/// Triangles a cell of the cube holds on average, if the mesh is a surface.
const TRIANGLES_A_CELL: usize = 128;

/// Order of vertices and of triangles.
pub(crate) struct Order {
    /// For each old vertex its new place.
    pub(crate) vertex_place: Vec<u32>,
    /// For each old triangle its new place.
    pub(crate) triangle_place: Vec<u32>,
    /// For each new place of a vertex the old one.
    pub(crate) source: Vec<u32>,
}

/// Lower corner and longest side of the box around the points.
pub(crate) fn bounds(positions: &[Vec3]) -> (Vec3, f64) {
    let bounds = Bounds::around(positions);
    (bounds.low, bounds.side())
}

/// Turns keys into places, in place; keys are less than the length of `starts`, which is overwritten.
fn counting_sort(keys: &mut [u32], starts: &mut [u32]) {
    starts.fill(0);
    for &key in keys.iter() {
        starts[key as usize] += 1;
    }
    let mut next = 0;
    for start in starts.iter_mut() {
        next += std::mem::replace(start, next);
    }
    for key in keys {
        let start = &mut starts[*key as usize];
        *key = *start;
        *start += 1;
    }
}

/// Finds the order within the box of `bounds`. Memory: 8 bytes a vertex and 4 a triangle.
pub(crate) fn morton(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    (low, side): (Vec3, f64),
) -> Order {
    let cells = (triangles.len() / TRIANGLES_A_CELL).max(1);
    // A surface meets about 4^bits of 8^bits cells; there shall not be many more of those than triangles.
    let most = (4 * triangles.len().max(2)).ilog2() / 3;
    let bits = (cells.ilog2() / 2 + 1).min(most).min(8);
    let to_cell = f64::from(1u32 << bits) / side;
    let top = (1u32 << bits) - 1;
    let key = |p: &Vec3| {
        // A cast from NaN gives 0, so a mesh without extent lies in one cell.
        let at = |axis: usize| (((p[axis] - low[axis]) * to_cell) as u32).min(top);
        spread(at(0)) | spread(at(1)) << 1 | spread(at(2)) << 2
    };
    let mut vertex_place: Vec<u32> = positions.iter().map(key).collect();
    let mut triangle_place: Vec<u32> =
        triangles.iter().map(|t| vertex_place[t[0] as usize]).collect();
    let mut starts = vec![0; 1 << (3 * bits)];
    counting_sort(&mut vertex_place, &mut starts);
    counting_sort(&mut triangle_place, &mut starts);
    let mut source = vec![0; positions.len()];
    for (old, &new) in vertex_place.iter().enumerate() {
        source[new as usize] = old as u32;
    }
    Order { vertex_place, triangle_place, source }
}
