//! Labels of faces in arrays: vertices on the borders of regions are parted before the work, and joined after it.
//!
//! As `io` does it for files (docs/design/attributes.md): each region has its own copy of a vertex, with the region's number as a
//! channel that makes the border an attribute seam. No triangle ever has corners of two regions.

use super::weld::Welded;
use crate::error::{Error, Result};
use std::collections::HashMap;
use std::ops::Range;

/// Labels that would make more than this many vertices of one are noise, not regions (docs/design/attributes.md).
const MOST_COPIES: f64 = 2.5;
/// Below this many triangles everything is a region.
const ALWAYS_REGIONS: usize = 1000;
/// Whole numbers that a float holds.
const MOST_REGIONS: usize = 1 << 24;

/// Vertices that were parted by the labels of their triangles.
#[derive(Debug)]
pub(super) struct FaceRegions {
    /// The label of each region.
    labels: Vec<u32>,
    /// Number of the region of each vertex, by id.
    of_vertex: Vec<u32>,
    /// Row in the arrays of each vertex, by id.
    rows: Vec<u32>,
}

impl FaceRegions {
    /// Parts the vertices of a mesh whose ids are rows below `n_rows`; a copy has a new id and stands at the end.
    ///
    /// Errors: `Usage` where the labels are not one a triangle, or differ nearly everywhere.
    pub(super) fn part(mesh: &mut Welded, labels: &[u32], n_rows: usize) -> Result<FaceRegions> {
        let n = mesh.triangles.len();
        if labels.len() != n {
            let what = format!("{} labels for {n} triangles: give one for each", labels.len());
            return Err(Error::Usage(what));
        }
        let mut distinct = labels.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        let n_vertices = mesh.positions.len();
        let mut first: Vec<Option<u32>> = vec![None; n_vertices];
        let mut copies: HashMap<(u32, u32), u32> = HashMap::new();
        let mut regions = FaceRegions {
            of_vertex: vec![0; n_rows],
            rows: (0..n_rows as u32).collect(),
            labels: distinct,
        };
        for (triangle, label) in mesh.triangles.iter_mut().zip(labels) {
            let region = regions.labels.binary_search(label).expect("it is one of them") as u32;
            for corner in triangle {
                let v = *corner as usize;
                let id = mesh.ids[v] as usize;
                match first[v] {
                    None => (first[v], regions.of_vertex[id]) = (Some(region), region),
                    Some(own) if own == region => {}
                    Some(_) => {
                        *corner = *copies.entry((*corner, region)).or_insert_with(|| {
                            mesh.positions.push(mesh.positions[v]);
                            mesh.ids.push(regions.rows.len() as u32);
                            regions.rows.push(id as u32);
                            regions.of_vertex.push(region);
                            mesh.positions.len() as u32 - 1
                        });
                    }
                }
            }
        }
        let is_noise = mesh.positions.len() as f64 > MOST_COPIES * n_vertices as f64;
        if regions.labels.len() > MOST_REGIONS || is_noise && n > ALWAYS_REGIONS {
            let what = format!(
                "the labels of the triangles differ nearly everywhere ({} of them, {} vertices for {n_vertices}): \
                 leave them out, or give them as a property of vertices",
                regions.labels.len(),
                mesh.positions.len()
            );
            return Err(Error::Usage(what));
        }
        Ok(regions)
    }

    /// The row of a vertex.
    pub(super) fn row(&self, id: u32) -> u32 {
        self.rows[id as usize]
    }

    /// Number of the region of a vertex.
    pub(super) fn number(&self, id: u32) -> u32 {
        self.of_vertex[id as usize]
    }

    /// Joins the copies in a result, and gives its triangles their labels. `ids` are those of its vertices, `source` the vertices of the input that
    /// they are like; `chart` has the bytes of a record that keep vertices apart: texture coordinates.
    ///
    /// Copies are vertices of different regions in one place: of one row, or of several, where the border has moved.
    pub(super) fn join(
        &self,
        (positions, ids): (&[[f64; 3]], &[u32]),
        source: &[u32],
        mut triangles: Vec<[u32; 3]>,
        records: &[u8],
        chart: &[Range<usize>],
    ) -> Rejoined {
        let (number, row) =
            (|v: u32| self.number(source[v as usize]), |v: u32| self.row(ids[v as usize]));
        let labels = triangles.iter().map(|t| self.labels[number(t[0]) as usize]).collect();
        let record_bytes = records.len() / positions.len().max(1);
        let place = |v: u32| {
            let record = &records[v as usize * record_bytes..][..record_bytes];
            let bits = positions[v as usize].map(f64::to_bits);
            (bits, chart.iter().map(|bytes| &record[bytes.clone()]).collect::<Vec<_>>())
        };
        let mut by_place: Vec<u32> = (0..ids.len() as u32).collect();
        by_place.sort_by_cached_key(|&v| (place(v), row(v), number(v)));
        // The vertex that each one becomes.
        let mut kept: Vec<u32> = (0..ids.len() as u32).collect();
        for same in by_place.chunk_by(|&a, &b| place(a) == place(b)) {
            let mut groups: Vec<(u32, Vec<u32>)> = Vec::new();
            for &v in same {
                let own = groups.iter().position(|(first, _)| row(*first) == row(v));
                let free = || groups.iter().position(|(_, regions)| !regions.contains(&number(v)));
                if let Some(group) = own.or_else(free) {
                    kept[v as usize] = groups[group].0;
                    groups[group].1.push(number(v));
                } else {
                    groups.push((v, vec![number(v)]));
                }
            }
        }
        let is_kept = |v: &u32| kept[*v as usize] == *v;
        let mut vertices: Vec<u32> = (0..ids.len() as u32).filter(is_kept).collect();
        vertices.sort_by_key(|&v| (self.row(source[v as usize]), v));
        let mut new = vec![0u32; ids.len()];
        (0..).zip(&vertices).for_each(|(at, &v)| new[v as usize] = at);
        for t in &mut triangles {
            *t = t.map(|v| new[kept[v as usize] as usize]);
        }
        Rejoined { vertices, triangles, labels }
    }
}

/// A result without copies.
pub(super) struct Rejoined {
    /// Vertices that stay, in the order of their rows.
    pub(super) vertices: Vec<u32>,
    /// Corners, counted in these.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The label of each triangle.
    pub(super) labels: Vec<u32>,
}
