//! Eight lanes in an array, left to the compiler.

use super::lanes::{Lanes, PACKING};
use crate::vertex::Vertex;
use stonecut_mesh::corners::others;

/// Eight numbers in an array.
#[derive(Clone, Copy)]
pub(crate) struct Portable([f32; 8]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Portable(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Portable([x; 8])
    }
    #[inline(always)]
    fn load(x: &[f32; 8]) -> Self {
        Portable(*x)
    }
    #[inline(always)]
    fn store(self) -> [f32; 8] {
        self.0
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    fn over(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
    #[inline(always)]
    fn root(self) -> Self {
        Portable(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        let x = self.0;
        ((x[0] + x[4]) + (x[1] + x[5])) + ((x[2] + x[6]) + (x[3] + x[7]))
    }
    #[inline(always)]
    fn least(self) -> f32 {
        let x = self.0;
        let min = |a: f32, b: f32| if a < b { a } else { b };
        min(min(min(x[0], x[4]), min(x[1], x[5])), min(min(x[2], x[6]), min(x[3], x[7])))
    }
    #[inline(always)]
    fn lt_select(a: Self, b: Self, x: Self, y: Self) -> Self {
        Portable(std::array::from_fn(|i| if a.0[i] < b.0[i] { x.0[i] } else { y.0[i] }))
    }
    #[inline(always)]
    fn relative(vertices: [&Vertex; 8], base: [&[f64; 3]; 8], scale: f64) -> [Self; 3] {
        std::array::from_fn(|axis| {
            let at = |i: usize| (vertices[i].position[axis] - base[i][axis]) * scale;
            Portable(std::array::from_fn(|i| at(i) as f32))
        })
    }
    #[inline(always)]
    fn quadrics(vertices: [&Vertex; 8]) -> [Self; 9] {
        std::array::from_fn(|row| Portable(std::array::from_fn(|i| vertices[i].quadric[row])))
    }
    #[inline(always)]
    fn columns(rows: [&[f32; 8]; 8]) -> [Self; 8] {
        std::array::from_fn(|k| Portable(std::array::from_fn(|i| rows[i][k])))
    }
    #[inline(always)]
    fn store_rows(columns: [Self; 8], rows: &mut [[f32; 8]; 8]) {
        for (lane, row) in rows.iter_mut().enumerate() {
            for (x, column) in row.iter_mut().zip(&columns) {
                *x = column.0[lane];
            }
        }
    }
    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        (0..8).fold(0, |bits, i| bits | u32::from(self.0[i] < other.0[i]) << i)
    }
    #[inline(always)]
    fn matches(ids: &[u32; 8], id: u32) -> u32 {
        (0..8).fold(0, |bits, i| bits | u32::from(ids[i] == id) << i)
    }
    #[inline(always)]
    fn others(triangles: [&[u32; 3]; 8], v: u32) -> [[u32; 8]; 2] {
        let pairs = triangles.map(|&t| others(t, v));
        [pairs.map(|(next, _)| next), pairs.map(|(_, last)| last)]
    }
    #[inline(always)]
    fn packed(list: &[u32; 8], bits: u32) -> [u32; 8] {
        PACKING[bits as usize & 0xFF].map(|lane| list[lane as usize & 7])
    }
}
