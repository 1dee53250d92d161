//! Asks the system for pages of 2 MiB for arrays that are larger.
//!
//! A sensor of 1280 x 720 pixels has 33 MB of state. In pages of 4 KiB that is more than the processor keeps addresses of,
//! and each page costs a fault when it is first written. Linux gives larger pages where it is asked to
//! (`/sys/kernel/mm/transparent_hugepage/enabled` is `madvise` or `always`).
//!
//! What must not break: this is only a wish. Where the system does not grant it, nothing is different but the speed.

/// Returns an empty array with room for so many.
pub(crate) fn with_capacity<T>(capacity: usize) -> Vec<T> {
    let mut array = Vec::with_capacity(capacity);
    ask_for(&mut array);
    array
}

/// Returns an array of one value. Of zeros, nothing is written yet.
pub(crate) fn filled<T: Clone>(value: T, length: usize) -> Vec<T> {
    let mut array = vec![value; length];
    ask_for(&mut array);
    array
}

/// Asks for them for all that an array has room for.
#[allow(unsafe_code, reason = "the system is told a range of addresses")]
pub(crate) fn ask_for<T>(array: &mut Vec<T>) {
    #[cfg(target_os = "linux")]
    {
        const HUGE_PAGE: usize = 1 << 21;
        const PAGE: usize = 1 << 12;
        let start = array.as_mut_ptr();
        let first = start.addr().next_multiple_of(PAGE);
        let bytes = (start.addr() + array.capacity() * size_of::<T>()).saturating_sub(first) & !(PAGE - 1);
        if bytes >= HUGE_PAGE {
            // SAFETY: whole pages within memory that is the array's own. Their contents stay as they are.
            unsafe { libc::madvise(start.with_addr(first).cast(), bytes, libc::MADV_HUGEPAGE) };
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = array;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_hold_what_they_held() {
        let mut array: Vec<u64> = (0..3_000_000).collect();
        let expected = array.clone();
        array.reserve(5_000_000);
        ask_for(&mut array);
        assert_eq!(array, expected);
        array.resize(7_000_000, 9);
        assert_eq!((&array[..3_000_000], array[6_999_999]), (&expected[..], 9));
        assert_eq!(filled(7u8, 5_000_000), vec![7u8; 5_000_000]);
        // Too small to ask, at every place within a page.
        for length in 0..5000 {
            assert_eq!(filled(1u8, length).len(), length);
        }
    }
}
