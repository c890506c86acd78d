//! Places of lists by ids that are known to be valid, without a check.
//!
//! The innermost loops look up some hundred places a collapse; checking each again costs a tenth of the time. They
//! promise once, where they begin, that all their ids are valid, and hand the promise (`KnownIds`, no bytes) on to
//! what they call. Whatever is not given it checks. Builds with debug assertions check everything.

/// Promise that ids are valid; no other code reads a list without a check.
#[derive(Clone, Copy)]
pub(crate) struct KnownIds(());

impl KnownIds {
    /// Makes the promise.
    ///
    /// # Safety
    /// Every id, and every range, that is given to a method of this value or of a copy lies within the list that it is
    /// given with.
    ///
    /// For the lists of a `Surface`: `MeshState::build` asserts that every corner is a vertex, and makes the rings
    /// and the arena of them. From then on corners only change to other vertices, ids in the arena to other triangles
    /// (also beyond the end of a ring), the vertex that a deleted one was merged into is one of the surface, and no list
    /// becomes shorter before it is built again.
    #[inline(always)]
    pub(crate) unsafe fn promise() -> Self {
        KnownIds(())
    }

    /// `list[id]`.
    #[inline(always)]
    pub(crate) fn at<T>(self, list: &[T], id: u32) -> &T {
        debug_assert!((id as usize) < list.len());
        // SAFETY: the id lies within the list, as was promised.
        unsafe { list.get_unchecked(id as usize) }
    }

    /// `&mut list[id]`.
    #[inline(always)]
    pub(crate) fn at_mut<T>(self, list: &mut [T], id: u32) -> &mut T {
        debug_assert!((id as usize) < list.len());
        // SAFETY: the id lies within the list, as was promised.
        unsafe { list.get_unchecked_mut(id as usize) }
    }

    /// `&list[first..first + n]`.
    #[inline(always)]
    pub(crate) fn part<T>(self, list: &[T], first: u32, n: u32) -> &[T] {
        let (first, n) = (first as usize, n as usize);
        debug_assert!(first + n <= list.len());
        // SAFETY: the range lies within the list, as was promised.
        unsafe { list.get_unchecked(first..first + n) }
    }

    /// `&mut list[first..first + n]`.
    #[inline(always)]
    pub(crate) fn part_mut<T>(self, list: &mut [T], first: u32, n: u32) -> &mut [T] {
        let (first, n) = (first as usize, n as usize);
        debug_assert!(first + n <= list.len());
        // SAFETY: the range lies within the list, as was promised.
        unsafe { list.get_unchecked_mut(first..first + n) }
    }
}

/// Fetches `list[id]` into the cache; any id will do, and only the time depends on it.
#[inline(always)]
pub(crate) fn prefetch<T>(list: &[T], id: u32) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch reads nothing, whatever the address.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(list.as_ptr().wrapping_add(id as usize).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (list, id);
}
