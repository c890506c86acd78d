//! Charts of a result: unwrapped and packed by `uvunwrap`, block by block.
//!
//! A block is at most `BLOCK_TRIANGLES` triangles of one region of space, and has pages for itself, so memory and time
//! do not grow faster than the result. Charts end where blocks do. Knows nothing of the original.

use super::original::Density;
use super::settings::{Corner, Means, Options};
use crate::error::{Error, Result};
use crate::measure::triangle;
use crate::mesh::Mesh;
use crate::mesh::bounds::Bounds;
use crate::system::disk::Disk;
use crate::system::parallel;
use crate::texture::{FrameCorner, Tangent, tangents};
use std::path::Path;

/// Triangles of a block at most.
const BLOCK_TRIANGLES: usize = 200_000;

/// Texels that the triangles of a block may cover; pages of one block count at most 2^30.
const BLOCK_TEXELS: f64 = (1u64 << 28) as f64;

/// Texels around every chart that show its own colours, so that charts are twice as far apart.
///
/// At 1/8 of the size a texel is 8 wide, and a point between two of them mixes what is up to 12 away.
pub(super) const PADDING: u32 = 12;

/// Sides of cropped pages are multiples of this: halves of them down to 1/16 are whole, and so are compressed blocks.
const SIDE_STEP: u32 = 16;

/// Attempts to meet a count of pages, and to fill them.
const MOST_TRIES: usize = 10;

/// A density is not looked for between one that fits and another that is higher by no more than this factor.
const CLOSE_ENOUGH: f64 = 1.04;

/// Bytes of a triangle in a block while it is unwrapped; 0.5 KiB were measured (68,771 triangles, 8,481 charts).
const UNWRAP_BYTES: u64 = 1024;

/// No chart.
pub(super) const NONE: u32 = u32::MAX;

/// Places of the triangles of a result on pages.
pub(super) struct Charts {
    /// Width and height of each page in texels.
    pub pages: Vec<[u32; 2]>,
    /// For each triangle its page.
    pub page: Vec<u32>,
    /// For each triangle its chart; `NONE` for triangles without an area.
    pub chart: Vec<u32>,
    /// For each triangle its corners in texels of its page, from the upper left corner.
    pub corners: Vec<[[f32; 2]; 3]>,
    pub n_charts: u64,
    pub texels_per_unit: f64,
    /// The same of each page.
    pub densities: Vec<f64>,
    /// For each triangle the tangents of its corners; empty until `add_tangents`.
    pub tangents: Vec<[Tangent; 3]>,
}

impl Charts {
    /// Bytes that the charts of a result take, with one block while it is unwrapped.
    pub fn bytes(n_triangles: u64) -> u64 {
        48 * n_triangles + UNWRAP_BYTES * n_triangles.min(BLOCK_TRIANGLES as u64)
    }

    /// Makes charts and packs them at a density, or about at the highest that needs at most the pages allowed.
    pub fn make(mesh: &Mesh, density: Density, options: &Options, means: Means) -> Result<Charts> {
        let mut texels_per_unit = density.wanted;
        let most = options.most_pages.map_or(usize::MAX, |most| most.max(1) as usize);
        let (mut fitting, mut too_dense) = (None::<f64>, f64::INFINITY);
        for _ in 0..MOST_TRIES {
            let charts = Self::at(mesh, texels_per_unit, options, means)?;
            let n = charts.pages.len();
            if n <= most {
                fitting = Some(texels_per_unit);
                let is_done =
                    too_dense.is_infinite() || too_dense <= CLOSE_ENOUGH * texels_per_unit;
                if is_done {
                    return Ok(charts);
                }
            } else {
                too_dense = texels_per_unit;
            }
            texels_per_unit = match fitting {
                Some(fitting) if too_dense <= CLOSE_ENOUGH * fitting => break,
                Some(fitting) => (fitting * too_dense).sqrt(),
                // The last page of each block is rarely full, so a share of the pages is not a share of the area.
                None => texels_per_unit * (most as f64 / n as f64).sqrt().clamp(0.1, 0.95),
            };
        }
        if let Some(fitting) = fitting {
            // Made again: two of them at a time would take twice the memory.
            return Self::at(mesh, fitting, options, means);
        }
        let what = format!(
            "--bake-pages {most}: the charts of {} triangles do not fit at any sensible density; allow more pages",
            mesh.triangles.len()
        );
        Err(Error::Usage(what))
    }

    fn at(mesh: &Mesh, texels_per_unit: f64, options: &Options, means: Means) -> Result<Charts> {
        let n = mesh.triangles.len();
        let mut charts = Charts {
            pages: Vec::new(),
            page: vec![0; n],
            chart: vec![NONE; n],
            corners: vec![[[0.0; 2]; 3]; n],
            n_charts: 0,
            texels_per_unit,
            densities: Vec::new(),
            tangents: Vec::new(),
        };
        for block in blocks(mesh, texels_per_unit) {
            means.progress.check()?;
            charts.add_block(mesh, &block, options, means)?;
        }
        Ok(charts)
    }

    /// Unwraps the triangles of a block onto further pages.
    fn add_block(
        &mut self,
        mesh: &Mesh,
        block: &[u32],
        options: &Options,
        means: Means,
    ) -> Result<()> {
        let corners = block.iter().flat_map(|&t| mesh.triangles[t as usize]);
        let mut vertices: Vec<u32> = corners.clone().collect();
        vertices.sort_unstable();
        vertices.dedup();
        let mut around = Bounds::EMPTY;
        vertices.iter().for_each(|&v| around.add(mesh.positions[v as usize]));
        // Single precision is enough around the middle.
        let middle = around.middle();
        let local =
            |&v: &u32| [0, 1, 2].map(|k| (mesh.positions[v as usize][k] - middle[k]) as f32);
        let positions: Vec<[f32; 3]> = vertices.iter().map(local).collect();
        let place = |v: u32| vertices.binary_search(&v).expect("collected above") as u32;
        let indices: Vec<u32> = corners.map(place).collect();
        let settings = uvunwrap::Options {
            density: uvunwrap::Density::Fixed {
                texels_per_unit: self.texels_per_unit as f32,
                page_size: Some(options.page_size),
            },
            padding: padding(options.page_size),
            max_chart_size: options.page_size - 2 * padding(options.page_size) - 2,
            packing: uvunwrap::Packing::Fast,
            ..uvunwrap::Options::default()
        };
        let input = [uvunwrap::MeshInput::new(&positions, &indices)];
        let is_wanted = |_: uvunwrap::Progress| means.progress.check().is_ok();
        let atlas = parallel::with_threads(means.threads, || {
            uvunwrap::generate_with_progress(&input, &settings, is_wanted)
        })?;
        means.progress.check()?;
        let atlas = atlas.map_err(|error| {
            Error::Internal(format!("no charts for {} triangles: {error}", block.len()))
        })?;
        let Some(unwrapped) = atlas.meshes.first() else { return Ok(()) };
        let (first_page, first_chart) = (self.pages.len() as u32, self.n_charts as u32);
        let size = [atlas.width, atlas.height].map(|side| side as f32);
        let mut used = vec![[0f32; 2]; atlas.page_count.max(1) as usize];
        for (&t, corners) in block.iter().zip(unwrapped.indices.as_chunks::<3>().0) {
            let found = corners.map(|v| unwrapped.vertices[v as usize]);
            let uv = found.map(|v| [v.uv[0] * size[0], v.uv[1] * size[1]]);
            let page = found.iter().find_map(|v| v.page).unwrap_or(0);
            let t = t as usize;
            (self.page[t], self.corners[t]) = (first_page + page, uv);
            // Corners of triangles without an area may lie in several charts.
            let is_one = found.iter().all(|v| v.chart.is_some() && v.chart == found[0].chart);
            if let (true, Some(chart)) = (is_one, found[0].chart) {
                self.chart[t] = first_chart + chart;
            }
            let used = &mut used[page as usize];
            uv.iter().for_each(|at| *used = [0, 1].map(|k| used[k].max(at[k])));
        }
        let cropped = |far: &[f32; 2]| {
            far.map(|side| {
                let side = (side.max(0.0).ceil() as u32).saturating_add(padding(options.page_size));
                side.next_multiple_of(SIDE_STEP).min(options.page_size)
            })
        };
        self.pages.extend(used.iter().map(cropped));
        self.densities.resize(self.pages.len(), self.texels_per_unit);
        self.n_charts += u64::from(atlas.chart_count);
        Ok(())
    }

    /// Finds the tangents of all corners, page by page, as a viewer would that has a page's triangles in one part; `normals`
    /// are those of the vertices.
    ///
    /// Memory: 28 bytes a triangle, and 300 of the triangles of a page.
    pub fn add_tangents(&mut self, mesh: &Mesh, normals: &[[f32; 3]]) {
        let mut order: Vec<u32> = (0..self.page.len() as u32).collect();
        order.sort_by_key(|&t| self.page[t as usize]);
        let mut found = vec![[[0; 4]; 3]; order.len()];
        for triangles in order.chunk_by(|&a, &b| self.page[a as usize] == self.page[b as usize]) {
            let first = mesh.corners(triangles[0] as usize)[0];
            let corner = |i: usize, k: usize| {
                let t = triangles[i] as usize;
                let v = mesh.triangles[t][k] as usize;
                // Single precision is enough around a place of the page.
                let position = [0, 1, 2].map(|axis| (mesh.positions[v][axis] - first[axis]) as f32);
                FrameCorner { position, normal: normals[v], uv: self.corner(t).uv[k] }
            };
            let of_page = tangents(triangles.len(), corner);
            triangles.iter().zip(of_page).for_each(|(&t, tangents)| found[t as usize] = tangents);
        }
        self.tangents = found;
    }

    /// Writes the tangents, `TANGENT_BYTES` a triangle, durably.
    pub fn write_tangents(&self, path: &Path, disk: &Disk) -> Result<()> {
        let mut file = disk.create(path)?;
        let mut bytes = Vec::new();
        for some in self.tangents.chunks(1 << 16) {
            bytes.clear();
            let numbers = some.as_flattened().as_flattened();
            numbers.iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
            file.append(&bytes)?;
        }
        file.sync()
    }

    /// Page and texture coordinates of a triangle.
    fn corner(&self, triangle: usize) -> Corner {
        let page = self.page[triangle];
        let [width, height] = self.pages[page as usize].map(|side| side as f32);
        let uv = self.corners[triangle]
            .map(|[x, y]| [(x / width).clamp(0.0, 1.0), (1.0 - y / height).clamp(0.0, 1.0)]);
        Corner { page, uv }
    }

    /// Writes a record for each triangle, durably.
    pub fn write(&self, path: &Path, disk: &Disk) -> Result<()> {
        let mut file = disk.create(path)?;
        let mut bytes = Vec::new();
        for first in (0..self.page.len()).step_by(1 << 16) {
            bytes.clear();
            let triangles = first..(first + (1 << 16)).min(self.page.len());
            triangles.for_each(|t| self.corner(t).write(&mut bytes));
            file.append(&bytes)?;
        }
        file.sync()
    }
}

/// `PADDING`, less on pages so small that little else would fit.
pub(super) fn padding(page_size: u32) -> u32 {
    PADDING.min(page_size / 16)
}

/// Triangles in blocks of neighbours: halved along the longest axis of their centres until they are few enough.
fn blocks(mesh: &Mesh, texels_per_unit: f64) -> Vec<Vec<u32>> {
    let centre = |t: u32| {
        let [a, b, c] = mesh.corners(t as usize);
        [0, 1, 2].map(|k| a[k] + b[k] + c[k])
    };
    let texels =
        |t: u32| triangle::area(&mesh.corners(t as usize)) * texels_per_unit * texels_per_unit;
    let mut open: Vec<Vec<u32>> = vec![(0..mesh.triangles.len() as u32).collect()];
    let mut done = Vec::new();
    while let Some(mut block) = open.pop() {
        let n_texels: f64 = block.iter().map(|&t| texels(t)).sum();
        let is_small = block.len() <= BLOCK_TRIANGLES && n_texels <= BLOCK_TEXELS;
        if is_small || block.len() < 2 {
            // In the order of the result, whatever the splits.
            block.sort_unstable();
            done.push(block);
            continue;
        }
        let mut around = Bounds::EMPTY;
        block.iter().for_each(|&t| around.add(centre(t)));
        let extent = [0, 1, 2].map(|k| around.high[k] - around.low[k]);
        let axis = (0..3).fold(0, |most, k| if extent[k] > extent[most] { k } else { most });
        let middle = block.len() / 2;
        block.select_nth_unstable_by(middle, |&a, &b| {
            centre(a)[axis].total_cmp(&centre(b)[axis]).then(a.cmp(&b))
        });
        let rest = block.split_off(middle);
        open.push(rest);
        open.push(block);
    }
    done.retain(|block| !block.is_empty());
    done
}
