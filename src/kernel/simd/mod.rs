//! Eight f32 lanes: with AVX2 where the processor has it, portably elsewhere, with the same bytes.
//!
//! The kernel's `unsafe` is in `avx2` and in `unchecked`. It knows the layout of a vertex, no mesh.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod lanes;
mod portable;
pub(crate) mod unchecked;

pub(crate) use lanes::{Job, Lanes};
pub(crate) use portable::Portable;

/// The lanes that are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Simd {
    /// Arrays of eight, left to the compiler.
    Portable,
    /// 256-bit registers; only made by `detect`.
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Token),
}

impl Simd {
    /// Returns the fastest lanes that this processor has.
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(token) = avx2::Token::detect() {
            return Simd::Avx2(token);
        }
        Simd::Portable
    }

    /// Does `job` with these lanes. `job.run` must be `#[inline(always)]` to gain from them.
    #[inline(always)]
    pub(crate) fn run<J: Job>(self, job: J) -> J::Output {
        match self {
            Simd::Portable => job.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2(token) => avx2::run(token, job),
        }
    }
}
