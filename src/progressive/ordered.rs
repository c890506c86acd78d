//! The mesh that a file was refined to, in the order of an output.

use super::read::Refiner;
use super::replay::NONE;
use stonecut_system::error::Result;

/// Vertices or triangles that are handed over at a time.
const BLOCK: usize = 1 << 16;

/// The mesh at hand, in the order of direct runs if the file has it.
pub struct Ordered<'a> {
    mesh: &'a Refiner,
    /// Numbers in the replay.
    vertices: Vec<u32>,
    triangles: Vec<u32>,
    /// Number in the output of each vertex of the replay.
    number: Vec<u32>,
}

impl Refiner {
    /// Puts the mesh at hand in order. Memory: 12 bytes a vertex and 12 a triangle.
    pub fn ordered(&self) -> Ordered<'_> {
        let replay = &self.replay;
        let n = replay.keys.len() as u32;
        let mut vertices: Vec<u32> = (0..n).filter(|&v| replay.has_vertex(v)).collect();
        let n_triangles = replay.triangles.len() as u32;
        let mut triangles: Vec<u32> =
            (0..n_triangles).filter(|&t| replay.has_triangle(t)).collect();
        if self.head().bits.is_none() {
            vertices.sort_unstable_by_key(|&v| (replay.keys[v as usize], v));
            triangles.sort_unstable_by_key(|&t| (replay.triangle_keys[t as usize], t));
        }
        let mut number = vec![NONE; n as usize];
        (0..).zip(&vertices).for_each(|(new, &v)| number[v as usize] = new);
        Ordered { mesh: self, vertices, triangles, number }
    }
}

impl Ordered<'_> {
    /// Number of vertices.
    pub fn n_vertices(&self) -> u64 {
        self.vertices.len() as u64
    }

    /// Number of triangles.
    pub fn n_triangles(&self) -> u64 {
        self.triangles.len() as u64
    }

    /// Hands the records of the vertices over, some at a time.
    pub fn records(&self, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut records = Vec::new();
        for block in self.vertices.chunks(BLOCK) {
            records.clear();
            let rows = block.iter().map(|&v| self.mesh.replay.row(v));
            rows.for_each(|row| self.mesh.rows().put_record(row, &mut records));
            take(&records)?;
        }
        Ok(())
    }

    /// Hands the corners of the triangles over, some at a time.
    pub fn triangles(&self, mut take: impl FnMut(&[[u32; 3]]) -> Result<()>) -> Result<()> {
        let mut corners = Vec::new();
        for block in self.triangles.chunks(BLOCK) {
            corners.clear();
            let of = |&t: &u32| self.mesh.replay.triangles[t as usize];
            corners.extend(block.iter().map(of).map(|t| t.map(|v| self.number[v as usize])));
            take(&corners)?;
        }
        Ok(())
    }
}
