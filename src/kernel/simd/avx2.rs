//! The eight lanes in one 256-bit register.
//!
//! `Avx2` is private to this file, and nothing but `run_with_avx2` names it; that is only called with a `Token`. So
//! wherever code of this file runs with `Avx2` for its lanes, the processor has AVX2: the argument of every
//! `unsafe` block below.

use std::arch::x86_64::*;

use super::lanes::{Job, Lanes, PACKING};
use crate::vertex::Vertex;

/// Proof that the processor has AVX2; only made by `detect`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Token(());

impl Token {
    /// Asks the processor; `None` if it has no AVX2.
    pub(super) fn detect() -> Option<Self> {
        std::arch::is_x86_feature_detected!("avx2").then_some(Token(()))
    }
}

/// Runs a job with AVX2 allowed.
#[inline(always)]
pub(super) fn run<J: Job>(_: Token, job: J) -> J::Output {
    // SAFETY: the token is only made after AVX2 was detected.
    unsafe { run_with_avx2(job) }
}

/// Runs a job with AVX2 allowed.
///
/// # Safety
/// The processor must have AVX2.
#[target_feature(enable = "avx2")]
unsafe fn run_with_avx2<J: Job>(job: J) -> J::Output {
    job.run::<Avx2>()
}

/// Eight numbers in a register; exists only inside of `run_with_avx2`, whose caller vouches for AVX2.
#[derive(Clone, Copy)]
struct Avx2(__m256);

/// Two points minus their bases, times `scale`, side by side.
///
/// # Safety
/// The processor must have AVX2; each pointer must be to three numbers.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn rows(
    p: *const f64,
    from_p: *const f64,
    q: *const f64,
    from_q: *const f64,
    mask: __m256i,
    scale: __m256d,
) -> __m256 {
    // SAFETY: the mask keeps the loads to three numbers.
    let (p, from_p, q, from_q) = unsafe {
        (
            _mm256_maskload_pd(p, mask),
            _mm256_maskload_pd(from_p, mask),
            _mm256_maskload_pd(q, mask),
            _mm256_maskload_pd(from_q, mask),
        )
    };
    let p = _mm256_cvtpd_ps(_mm256_mul_pd(_mm256_sub_pd(p, from_p), scale));
    let q = _mm256_cvtpd_ps(_mm256_mul_pd(_mm256_sub_pd(q, from_q), scale));
    _mm256_set_m128(q, p)
}

/// Rows become columns.
#[inline]
#[target_feature(enable = "avx2")]
fn transposed(r: [__m256; 8]) -> [__m256; 8] {
    let (t0, t1) = (_mm256_unpacklo_ps(r[0], r[1]), _mm256_unpackhi_ps(r[0], r[1]));
    let (t2, t3) = (_mm256_unpacklo_ps(r[2], r[3]), _mm256_unpackhi_ps(r[2], r[3]));
    let (t4, t5) = (_mm256_unpacklo_ps(r[4], r[5]), _mm256_unpackhi_ps(r[4], r[5]));
    let (t6, t7) = (_mm256_unpacklo_ps(r[6], r[7]), _mm256_unpackhi_ps(r[6], r[7]));
    let (s0, s1) = (_mm256_shuffle_ps::<0x44>(t0, t2), _mm256_shuffle_ps::<0xEE>(t0, t2));
    let (s2, s3) = (_mm256_shuffle_ps::<0x44>(t1, t3), _mm256_shuffle_ps::<0xEE>(t1, t3));
    let (s4, s5) = (_mm256_shuffle_ps::<0x44>(t4, t6), _mm256_shuffle_ps::<0xEE>(t4, t6));
    let (s6, s7) = (_mm256_shuffle_ps::<0x44>(t5, t7), _mm256_shuffle_ps::<0xEE>(t5, t7));
    [
        _mm256_permute2f128_ps::<0x20>(s0, s4),
        _mm256_permute2f128_ps::<0x20>(s1, s5),
        _mm256_permute2f128_ps::<0x20>(s2, s6),
        _mm256_permute2f128_ps::<0x20>(s3, s7),
        _mm256_permute2f128_ps::<0x31>(s0, s4),
        _mm256_permute2f128_ps::<0x31>(s1, s5),
        _mm256_permute2f128_ps::<0x31>(s2, s6),
        _mm256_permute2f128_ps::<0x31>(s3, s7),
    ]
}

impl Lanes for Avx2 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn load(x: &[f32; 8]) -> Self {
        // SAFETY: AVX2 is there (see above); eight numbers are read of eight.
        Avx2(unsafe { _mm256_loadu_ps(x.as_ptr()) })
    }
    #[inline(always)]
    fn store(self) -> [f32; 8] {
        let mut x = [0.0; 8];
        // SAFETY: AVX2 is there (see above); eight numbers are written to eight.
        unsafe { _mm256_storeu_ps(x.as_mut_ptr(), self.0) };
        x
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_add_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_sub_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_mul_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn over(self, other: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_div_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn root(self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_max_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_min_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: AVX2 is there, see above.
        unsafe {
            let (low, high) = (_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let four = _mm_add_ps(low, high);
            let two = _mm_add_ps(four, _mm_movehdup_ps(four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_movehl_ps(two, two)))
        }
    }
    #[inline(always)]
    fn least(self) -> f32 {
        // SAFETY: AVX2 is there, see above.
        unsafe {
            let (low, high) = (_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let four = _mm_min_ps(low, high);
            let two = _mm_min_ps(four, _mm_movehdup_ps(four));
            _mm_cvtss_f32(_mm_min_ss(two, _mm_movehl_ps(two, two)))
        }
    }
    #[inline(always)]
    fn lt_select(a: Self, b: Self, x: Self, y: Self) -> Self {
        // SAFETY: AVX2 is there, see above.
        Avx2(unsafe { _mm256_blendv_ps(y.0, x.0, _mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0)) })
    }
    #[inline(always)]
    fn relative(vertices: [&Vertex; 8], base: [&[f64; 3]; 8], scale: f64) -> [Self; 3] {
        // SAFETY: AVX2 is there (see above); each pointer is to the three numbers of a point.
        unsafe {
            let mask = _mm256_setr_epi64x(-1, -1, -1, 0);
            let scale = _mm256_set1_pd(scale);
            let at = |i: usize| vertices[i].position.as_ptr();
            let from = |i: usize| base[i].as_ptr();
            let r0 = rows(at(0), from(0), at(4), from(4), mask, scale);
            let r1 = rows(at(1), from(1), at(5), from(5), mask, scale);
            let r2 = rows(at(2), from(2), at(6), from(6), mask, scale);
            let r3 = rows(at(3), from(3), at(7), from(7), mask, scale);
            let (xy01, z01) = (_mm256_unpacklo_ps(r0, r1), _mm256_unpackhi_ps(r0, r1));
            let (xy23, z23) = (_mm256_unpacklo_ps(r2, r3), _mm256_unpackhi_ps(r2, r3));
            [
                Avx2(_mm256_shuffle_ps::<0x44>(xy01, xy23)),
                Avx2(_mm256_shuffle_ps::<0xEE>(xy01, xy23)),
                Avx2(_mm256_shuffle_ps::<0x44>(z01, z23)),
            ]
        }
    }
    #[inline(always)]
    fn store_rows(columns: [Self; 8], rows: &mut [[f32; 8]; 8]) {
        let c = &columns;
        // SAFETY: AVX2 is there (see above); eight numbers are written to each row of eight.
        unsafe {
            let r = transposed([c[0].0, c[1].0, c[2].0, c[3].0, c[4].0, c[5].0, c[6].0, c[7].0]);
            _mm256_storeu_ps(rows[0].as_mut_ptr(), r[0]);
            _mm256_storeu_ps(rows[1].as_mut_ptr(), r[1]);
            _mm256_storeu_ps(rows[2].as_mut_ptr(), r[2]);
            _mm256_storeu_ps(rows[3].as_mut_ptr(), r[3]);
            _mm256_storeu_ps(rows[4].as_mut_ptr(), r[4]);
            _mm256_storeu_ps(rows[5].as_mut_ptr(), r[5]);
            _mm256_storeu_ps(rows[6].as_mut_ptr(), r[6]);
            _mm256_storeu_ps(rows[7].as_mut_ptr(), r[7]);
        }
    }
    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        // SAFETY: AVX2 is there, see above.
        unsafe {
            let less = _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0);
            _mm256_movemask_ps(less).cast_unsigned()
        }
    }
    #[inline(always)]
    fn matches(ids: &[u32; 8], id: u32) -> u32 {
        // SAFETY: AVX2 is there (see above); eight numbers are read of eight.
        unsafe {
            let ids = _mm256_loadu_si256(ids.as_ptr().cast());
            let same = _mm256_cmpeq_epi32(ids, _mm256_set1_epi32(id.cast_signed()));
            _mm256_movemask_ps(_mm256_castsi256_ps(same)).cast_unsigned()
        }
    }
    #[inline(always)]
    fn others(triangles: [&[u32; 3]; 8], v: u32) -> [[u32; 8]; 2] {
        // SAFETY: AVX2 is there (see above); the mask keeps the loads to three numbers; eight are written to eight.
        unsafe {
            let mask = _mm_setr_epi32(-1, -1, -1, 0);
            let at = |i: usize| _mm_maskload_epi32(triangles[i].as_ptr().cast(), mask);
            let two = |i: usize| _mm256_set_m128i(at(i + 4), at(i));
            let (t0, t1, t2, t3) = (two(0), two(1), two(2), two(3));
            let (xy01, z01) = (_mm256_unpacklo_epi32(t0, t1), _mm256_unpackhi_epi32(t0, t1));
            let (xy23, z23) = (_mm256_unpacklo_epi32(t2, t3), _mm256_unpackhi_epi32(t2, t3));
            let x = _mm256_unpacklo_epi64(xy01, xy23);
            let y = _mm256_unpackhi_epi64(xy01, xy23);
            let z = _mm256_unpacklo_epi64(z01, z23);
            let v = _mm256_set1_epi32(v.cast_signed());
            let (first, second) = (_mm256_cmpeq_epi32(x, v), _mm256_cmpeq_epi32(y, v));
            let next = _mm256_blendv_epi8(_mm256_blendv_epi8(x, z, second), y, first);
            let last = _mm256_blendv_epi8(_mm256_blendv_epi8(y, x, second), z, first);
            let mut pairs = [[0; 8]; 2];
            _mm256_storeu_si256(pairs[0].as_mut_ptr().cast(), next);
            _mm256_storeu_si256(pairs[1].as_mut_ptr().cast(), last);
            pairs
        }
    }
    #[inline(always)]
    fn packed(list: &[u32; 8], bits: u32) -> [u32; 8] {
        let lanes = &PACKING[bits as usize & 0xFF];
        let mut packed = [0; 8];
        // SAFETY: AVX2 is there (see above); eight numbers, or the eight bytes of an entry, are read and written.
        unsafe {
            let list = _mm256_loadu_si256(list.as_ptr().cast());
            let lanes = _mm256_cvtepu8_epi32(_mm_loadl_epi64(lanes.as_ptr().cast()));
            let list = _mm256_permutevar8x32_epi32(list, lanes);
            _mm256_storeu_si256(packed.as_mut_ptr().cast(), list);
        }
        packed
    }
    #[inline(always)]
    fn columns(rows: [&[f32; 8]; 8]) -> [Self; 8] {
        // SAFETY: AVX2 is there (see above); eight numbers are read of each row of eight.
        unsafe {
            let r = |i: usize| _mm256_loadu_ps(rows[i].as_ptr());
            let [x0, x1, x2, x3, x4, x5, x6, x7] =
                transposed([r(0), r(1), r(2), r(3), r(4), r(5), r(6), r(7)]);
            [Avx2(x0), Avx2(x1), Avx2(x2), Avx2(x3), Avx2(x4), Avx2(x5), Avx2(x6), Avx2(x7)]
        }
    }
    #[inline(always)]
    fn quadrics(vertices: [&Vertex; 8]) -> [Self; 9] {
        // SAFETY: AVX2 is there (see above); the first eight of nine numbers are read.
        unsafe {
            let at = |i: usize| vertices[i].quadric.as_ptr();
            let (r0, r1) = (_mm256_loadu_ps(at(0)), _mm256_loadu_ps(at(1)));
            let (r2, r3) = (_mm256_loadu_ps(at(2)), _mm256_loadu_ps(at(3)));
            let (r4, r5) = (_mm256_loadu_ps(at(4)), _mm256_loadu_ps(at(5)));
            let (r6, r7) = (_mm256_loadu_ps(at(6)), _mm256_loadu_ps(at(7)));
            let last: [f32; 8] = std::array::from_fn(|i| vertices[i].quadric[8]);
            let [x0, x1, x2, x3, x4, x5, x6, x7] = transposed([r0, r1, r2, r3, r4, r5, r6, r7]);
            let last = _mm256_loadu_ps(last.as_ptr());
            [
                Avx2(x0),
                Avx2(x1),
                Avx2(x2),
                Avx2(x3),
                Avx2(x4),
                Avx2(x5),
                Avx2(x6),
                Avx2(x7),
                Avx2(last),
            ]
        }
    }
}
