//! Charts of a result: made block by block, packed together, written with their tangents.
//!
//! A block is at most `BLOCK_TRIANGLES` triangles of one region of space, so the memory of making charts (`flatten`) does
//! not grow with the result. Charts end where blocks do. Packing is in `packing`. Knows nothing of the original.

use super::density::Density;
use super::flatten::{FLATTEN_BYTES, Flat, flatten};
use super::grid::area;
use super::packing::{Wanted, pack};
use super::page_kind::PagePart;
use super::settings::{Corner, Means, NONE, Options};
use std::path::Path;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_render::texture::{FrameCorner, Tangent, tangents};
use stonecut_system::disk::Disk;
use stonecut_system::error::Result;

/// Triangles of a block at most.
const BLOCK_TRIANGLES: usize = 500_000;

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
        128 * n_triangles + FLATTEN_BYTES * n_triangles.min(BLOCK_TRIANGLES as u64)
    }

    /// Makes charts once, and packs them at a density, or about at the highest that needs at most the pages allowed.
    ///
    /// Memory: 100 bytes a triangle, and `FLATTEN_BYTES` of the triangles of a block.
    pub fn make(mesh: &Mesh, density: Density, options: &Options, means: Means) -> Result<Charts> {
        let n = mesh.triangles.len();
        let mut flat = Flat { chart: vec![NONE; n], corners: vec![[[0.0; 2]; 3]; n], n_charts: 0 };
        for block in blocks(mesh) {
            let own = flatten(&part_of(mesh, &block), means.progress)?;
            for (i, &t) in block.iter().enumerate() {
                let t = t as usize;
                let chart = own.chart[i];
                flat.chart[t] = if chart == NONE { NONE } else { flat.n_charts + chart };
                flat.corners[t] = own.corners[i];
            }
            flat.n_charts += own.n_charts;
        }
        let wanted = Wanted {
            page_size: options.page_size,
            most_pages: options.most_pages,
            texels_per_unit: density.wanted,
        };
        let packed = pack(&flat, wanted, means.progress)?;
        Ok(Charts {
            densities: vec![packed.texels_per_unit; packed.pages.len()],
            pages: packed.pages,
            page: packed.page,
            chart: packed.chart,
            corners: packed.corners,
            n_charts: packed.n_charts,
            texels_per_unit: packed.texels_per_unit,
            tangents: Vec::new(),
        })
    }

    /// Texels of all pages.
    pub fn n_texels(&self) -> u64 {
        self.pages.iter().map(|[width, height]| u64::from(*width) * u64::from(*height)).sum()
    }

    /// Texels that charts cover, about.
    pub fn n_covered(&self) -> u64 {
        let is_there = |&t: &usize| self.chart[t] != NONE;
        let all = (0..self.chart.len()).filter(is_there).map(|t| area(&self.corners[t]));
        all.sum::<f64>() as u64
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
        Corner { part: page, uv }
    }

    /// Parts of pages, and for each triangle its own; `blends` as the texels say it, empty for parts that are pages.
    pub fn parts(&self, blends: &[bool], all_blend: bool) -> (Vec<PagePart>, Vec<u32>) {
        let n_pages = self.pages.len() as u32;
        if blends.is_empty() {
            let parts = (0..n_pages).map(|page| PagePart { page, blends: all_blend });
            return (parts.collect(), self.page.clone());
        }
        let place = |t: usize| 2 * self.page[t] as usize + usize::from(blends[t]);
        let mut number = vec![None; 2 * self.pages.len()];
        (0..self.page.len()).for_each(|t| number[place(t)] = Some(0));
        let mut parts = Vec::new();
        for (at, own) in number.iter_mut().enumerate().filter(|(_, own)| own.is_some()) {
            *own = Some(parts.len() as u32);
            parts.push(PagePart { page: at as u32 / 2, blends: at % 2 == 1 });
        }
        let own = (0..self.page.len()).map(|t| number[place(t)].unwrap_or_default());
        (parts, own.collect())
    }

    /// Writes a record for each triangle, durably; `parts` as `parts` returns them.
    pub fn write(&self, parts: &[u32], path: &Path, disk: &Disk) -> Result<()> {
        let mut file = disk.create(path)?;
        let mut bytes = Vec::new();
        for first in (0..self.page.len()).step_by(1 << 16) {
            bytes.clear();
            let triangles = first..(first + (1 << 16)).min(self.page.len());
            let corner = |t: usize| Corner { part: parts[t], ..self.corner(t) };
            triangles.for_each(|t| corner(t).write(&mut bytes));
            file.append(&bytes)?;
        }
        file.sync()
    }
}

/// Some triangles of a mesh as one with vertices around the origin.
fn part_of(mesh: &Mesh, block: &[u32]) -> Mesh {
    let corners = || block.iter().flat_map(|&t| mesh.triangles[t as usize]);
    let mut vertices: Vec<u32> = corners().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let positions = vertices.iter().map(|&v| mesh.positions[v as usize]).collect();
    let place = |v: u32| vertices.binary_search(&v).expect("collected above") as u32;
    let triangles = block.iter().map(|&t| mesh.triangles[t as usize].map(place)).collect();
    Mesh::new(positions, triangles)
}

/// Triangles in blocks of neighbours: halved along the longest axis of their centres until they are few enough.
fn blocks(mesh: &Mesh) -> Vec<Vec<u32>> {
    let centre = |t: u32| {
        let [a, b, c] = mesh.corners(t as usize);
        [0, 1, 2].map(|k| a[k] + b[k] + c[k])
    };
    let mut open: Vec<Vec<u32>> = vec![(0..mesh.triangles.len() as u32).collect()];
    let mut done = Vec::new();
    while let Some(mut block) = open.pop() {
        if block.len() <= BLOCK_TRIANGLES {
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
