//! Eight f32 lanes: with AVX2 where the processor has it, portably elsewhere, with the same bytes.
//!
//! Every operation is one correctly rounded IEEE operation a lane, none is fused, so both kinds agree to
//! the last bit. The kernel's `unsafe` is here and in `unchecked`. It knows the layout of a vertex, no mesh.

pub(crate) mod unchecked;

use crate::kernel::surface::{self, Vertex};

/// The lanes that are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Simd {
    /// Arrays of eight, left to the compiler.
    Portable,
    /// 256-bit registers; only made by `detect`.
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2Token),
}

/// Proof that AVX2 is there.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx2Token(());

impl Simd {
    /// The fastest lanes that this processor has.
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Simd::Avx2(Avx2Token(()));
        }
        Simd::Portable
    }
}

/// Work that can be done with either kind of lanes.
pub(crate) trait Job {
    type Output;
    fn run<L: Lanes>(self) -> Self::Output;
}

impl Simd {
    /// Does `job` with these lanes. `job.run` must be `#[inline(always)]` to gain from them.
    #[inline(always)]
    pub(crate) fn run<J: Job>(self, job: J) -> J::Output {
        match self {
            Simd::Portable => job.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the token is only made after AVX2 was detected.
            Simd::Avx2(_) => unsafe { avx2::run(job) },
        }
    }
}

/// Eight numbers. `lt_select(a, b, x, y)` is `x` where a < b, else `y` (also where a or b is NaN).
pub(crate) trait Lanes: Copy {
    fn splat(x: f32) -> Self;
    fn load(x: &[f32; 8]) -> Self;
    fn store(self) -> [f32; 8];
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn times(self, other: Self) -> Self;
    fn over(self, other: Self) -> Self;
    fn root(self) -> Self;
    /// The greater of both; `other` if either is NaN.
    fn greater(self, other: Self) -> Self;
    /// The lesser of both; `other` if either is NaN.
    fn lesser(self, other: Self) -> Self;
    /// All eight added up, always in the same order.
    fn sum(self) -> f32;
    /// The least of all eight by `lesser`, always in the same order.
    fn least(self) -> f32;
    fn lt_select(a: Self, b: Self, x: Self, y: Self) -> Self;
    /// x, y, z of each vertex minus `base`, times `scale`, subtracted in f64.
    fn relative(vertices: [&Vertex; 8], base: [&[f64; 3]; 8], scale: f64) -> [Self; 3];
    /// The nine numbers of each vertex's quadric, one array a number.
    fn quadrics(vertices: [&Vertex; 8]) -> [Self; 9];
    /// Eight rows of eight numbers, one array a number.
    fn columns(rows: [&[f32; 8]; 8]) -> [Self; 8];
    /// Eight numbers of each lane, one array a lane.
    fn store_rows(columns: [Self; 8], rows: &mut [[f32; 8]; 8]);
    /// Bit `i` tells whether lane `i` is less than that of `other`; not so if either is NaN.
    fn below(self, other: Self) -> u32;
    /// Bit `i` tells whether `ids[i]` is `id`.
    fn matches(ids: &[u32; 8], id: u32) -> u32;
    /// Of eight triangles the two corners that are not `v`, in their sense of rotation: all next ones, all last
    /// ones. What is not a triangle of `v` comes out as its last two corners.
    fn others(triangles: [&[u32; 3]; 8], v: u32) -> [[u32; 8]; 2];
    /// The numbers whose bits are set, in their order, then anything.
    fn packed(list: &[u32; 8], bits: u32) -> [u32; 8];
}

/// For each set of bits, which lanes they stand for, in order.
const PACKING: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < 8 {
            if bits >> lane & 1 == 1 {
                table[bits][n] = lane as u8;
                n += 1;
            }
            lane += 1;
        }
        bits += 1;
    }
    table
};

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
        let pairs = triangles.map(|&t| surface::others(t, v));
        [pairs.map(|(next, _)| next), pairs.map(|(_, last)| last)]
    }
    #[inline(always)]
    fn packed(list: &[u32; 8], bits: u32) -> [u32; 8] {
        PACKING[bits as usize & 0xFF].map(|lane| list[lane as usize & 7])
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2;
