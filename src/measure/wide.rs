//! Work that is compiled a second time for AVX2, and done so where the processor has it.
//!
//! The compiler neither fuses nor reorders operations on floats, so both ways give the same bits. Knows nothing of the work.

/// Work in whose `run` everything that counts is inlined.
pub trait WideJob {
    /// Outcome of the work.
    type Output;
    /// Does the work; must be `#[inline(always)]` to gain from wide registers.
    fn run(self) -> Self::Output;
}

/// Does `job` with the widest registers of this processor.
#[inline(always)]
pub fn run<J: WideJob>(job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { with_avx2(job) };
    }
    job.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<J: WideJob>(job: J) -> J::Output {
    job.run()
}
