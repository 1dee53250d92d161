//! Asks the processor to bring memory into its caches before it is read.
//!
//! A frame comes fresh from memory or from a far cache, and so do the triangles of a large mesh. What reads them is so
//! quick that it would wait for each line.
//!
//! What must not break: this is only a hint. It reads nothing and changes nothing, and where there is no such
//! instruction, it does nothing.

/// Asks for all of a slice.
#[inline]
#[allow(unsafe_code, reason = "the instruction takes a pointer")]
pub(crate) fn prefetch<T>(values: &[T]) {
    #[cfg(target_arch = "x86_64")]
    for at in (0..size_of_val(values)).step_by(LINE) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch may be given any address, and this one is in the slice.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().cast::<i8>().wrapping_add(at)) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}

/// Bytes of a line of the cache.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;
