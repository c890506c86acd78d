//! Places in images that texels show: materials and coordinates at points of the result, and some of them around each.
//!
//! A nearest place costs far more than a look into an image, so on coarse levels of tiles the quarters of a texel share one:
//! around it, texture coordinates go on as they do on its triangle (`side`). Looks nothing up.

use super::charts::Charts;
use super::original::{Hit, Original};
use stonecut_measure::triangle::Vector;
use stonecut_mesh::Mesh;
use stonecut_render::texture::{ImageCache, Light, Palette, Spot, times_opacity};
use stonecut_system::progress::Progress;

/// Inputs of a bake that is under way.
pub(super) struct Scene<'a> {
    pub mesh: &'a Mesh,
    pub charts: &'a Charts,
    /// Normals of the result's vertices; empty without normal maps.
    pub normals: &'a [[f32; 3]],
    pub original: &'a Original,
    pub palette: &'a Palette,
    pub images: &'a ImageCache<'a>,
    /// Points for a side of a texel, each with a place on the original.
    pub side: u32,
    /// 2 where each quarter of a texel is looked up in the images, around one point for those on the same triangle, instead
    /// of 1; only without pages besides colours.
    pub looks: u32,
    /// Distance of the corners of triangles from those of the original that they are, at most; `None` where none of them is.
    pub same_within: Option<f64>,
    pub batch_bytes: u64,
    pub threads: usize,
    pub progress: &'a Progress,
    /// Count of `progress` once all texels are filled.
    pub counted: u64,
}

/// A point of the result.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub at: Vector,
    /// Barycentric coordinates of the second and third corner.
    pub weights: [f32; 2],
    pub triangle: u32,
    /// Quarters of the texel that are looked up, as bits, with the point in their middle; none where it is itself.
    pub looks: u8,
    pub row: u32,
    pub column: u32,
}

/// Materials and coordinates of every look into an image; `starts` gets the first one of each point, and their number.
pub(super) fn find_spots(
    scene: &Scene,
    (points, hits): (&[Point], &[Hit]),
    (spots, starts): (&mut Vec<Spot>, &mut Vec<u32>),
) {
    let charts = scene.charts;
    spots.clear();
    starts.clear();
    for (point, hit) in points.iter().zip(hits) {
        starts.push(spots.len() as u32);
        let density = charts.densities[charts.page[point.triangle as usize] as usize];
        let apart = f64::from(hit.per_unit) / (density * f64::from(scene.side * scene.looks));
        let Hit { material, within, .. } = *hit;
        if point.looks.count_ones() < 2 {
            spots.push(Spot { material, uv: hit.uv, within, apart });
            continue;
        }
        let all = || (0..4).filter(|i| point.looks >> i & 1 == 1).map(|i| [i & 1, i >> 1]);
        let share = 1.0 / point.looks.count_ones() as f32;
        // Of a quarter from the middle of the quarters that there are.
        let middle = [0, 1].map(|k| share * all().map(|at| at[k] as f32).sum::<f32>());
        let [along_x, along_y] = hit.along;
        for [x, y] in all() {
            let (x, y) = (0.5 * (x as f32 - middle[0]), 0.5 * (y as f32 - middle[1]));
            let uv = [0, 1].map(|k| hit.uv[k] + x * along_x[k] + y * along_y[k]);
            spots.push(Spot { material, uv, within, apart });
        }
    }
    starts.push(spots.len() as u32);
}

/// The colour of every spot without its image, which is multiplied with it.
pub(super) fn plain_lights(
    scene: &Scene,
    (hits, starts): (&[Hit], &[u32]),
    lights: &mut Vec<Light>,
) {
    let table = &scene.images.table;
    let plain = |hit: &Hit| -> Light {
        let paint = scene.palette.paints.get(hit.material as usize);
        let factor = paint.map_or([1.0; 4], |paint| paint.factor);
        let has_image = paint.is_some_and(|paint| paint.base.is_some());
        let is_seen_through = scene.original.is_seen_through;
        let is_bare = scene.original.has_bare && hit.colour == [255; 3];
        if (has_image && !is_seen_through) || is_bare || !scene.original.has_colours() {
            return times_opacity(factor);
        }
        let [r, g, b] = hit.colour;
        let [r, g, b, _] = table.of([r, g, b, 255]);
        let [of_r, of_g, of_b, opacity] = factor;
        if is_seen_through {
            return times_opacity([of_r * r, of_g * g, of_b * b, opacity]);
        }
        times_opacity([r, g, b, opacity])
    };
    lights.clear();
    for (hit, range) in hits.iter().zip(starts.windows(2)) {
        lights.extend(std::iter::repeat_n(plain(hit), (range[1] - range[0]) as usize));
    }
}
