//! Places of lists by ids that the kernel itself keeps valid.
//!
//! The innermost loop looks up some hundred places a collapse; checking each again costs a tenth of the
//! time. Builds with debug assertions check all of them. Used by the innermost loops only.
//!
//! Contract of every function here: an id of a vertex, triangle or place in the arena comes from the
//! surface. `Surface::new` checks each corner of the input against the number of vertices, everything
//! else is made by the kernel, the arena holds ids of triangles even beyond the end of a ring, lists never
//! become shorter while ids of them are kept, and compacting gives every id that stays a new, valid one.

/// `list[id]`.
#[inline(always)]
pub(crate) fn at<T>(list: &[T], id: u32) -> &T {
    debug_assert!((id as usize) < list.len());
    // SAFETY: the id is one of the list's, see above.
    unsafe { list.get_unchecked(id as usize) }
}

/// `&mut list[id]`.
#[inline(always)]
pub(crate) fn at_mut<T>(list: &mut [T], id: u32) -> &mut T {
    debug_assert!((id as usize) < list.len());
    // SAFETY: the id is one of the list's, see above.
    unsafe { list.get_unchecked_mut(id as usize) }
}

/// `&list[first..first + n]`.
#[inline(always)]
pub(crate) fn part<T>(list: &[T], first: u32, n: u32) -> &[T] {
    let (first, n) = (first as usize, n as usize);
    debug_assert!(first + n <= list.len());
    // SAFETY: a ring's part lies within the arena, see above.
    unsafe { list.get_unchecked(first..first + n) }
}

/// `&mut list[first..first + n]`.
#[inline(always)]
pub(crate) fn part_mut<T>(list: &mut [T], first: u32, n: u32) -> &mut [T] {
    let (first, n) = (first as usize, n as usize);
    debug_assert!(first + n <= list.len());
    // SAFETY: a ring's part lies within the arena, see above.
    unsafe { list.get_unchecked_mut(first..first + n) }
}

/// Asks for `list[id]` to be brought near; any id will do, and nothing but the time depends on it.
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
