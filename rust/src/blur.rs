//! The blur of the dataset's simulator: each frame is convolved with [1 2 1] x [1 2 1] / 16, edges mirrored.
//!
//! What must not break: sums of float32 in a fixed order, columns first, so that a frame has the same bits everywhere.

use multiversion::multiversion;

/// Blurs frames of so many columns and rows, one after the other, from `luma` to `blurred`, which are of the same length.
pub fn blur_3x3(luma: &[f32], (columns, rows): (usize, usize), blurred: &mut [f32]) {
    if columns * rows == 0 {
        return;
    }
    let mut row = vec![0.0; columns];
    for (frame, out) in luma.chunks_exact(columns * rows).zip(blurred.chunks_exact_mut(columns * rows)) {
        for (y, out) in out.chunks_exact_mut(columns).enumerate() {
            let at = |y: usize| &frame[y * columns..][..columns];
            let (before, after) = neighbours(y, rows);
            along_column(at(before), at(y), at(after), &mut row);
            along_row(&row, out);
        }
    }
}

/// Returns the neighbours of place `at` in a line of so many: at an end both are the one inside, and one alone has
/// itself.
fn neighbours(at: usize, count: usize) -> (usize, usize) {
    let inside = usize::from(count > 1);
    (if at == 0 { inside } else { at - 1 }, if at + 1 < count { at + 1 } else { at - inside })
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn along_column(before: &[f32], middle: &[f32], after: &[f32], out: &mut [f32]) {
    for (((before, middle), after), out) in before.iter().zip(middle).zip(after).zip(out) {
        *out = weighted(*before, *middle, *after);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn along_row(row: &[f32], out: &mut [f32]) {
    let count = row.len();
    for (three, out) in row.windows(3).zip(&mut out[1.min(count)..]) {
        *out = weighted(three[0], three[1], three[2]);
    }
    for end in [0, count - 1] {
        let (before, after) = neighbours(end, count);
        out[end] = weighted(row[before], row[end], row[after]);
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn weighted(before: f32, middle: f32, after: f32) -> f32 {
    0.25 * (before + after) + 0.5 * middle
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point becomes the kernel; what lies next to an edge counts twice there, because it is mirrored.
    #[test]
    fn a_point_becomes_the_kernel() {
        let blurred = |x: usize, y: usize, size: (usize, usize)| {
            let (mut luma, mut out) = (vec![0.0; size.0 * size.1], vec![-1.0; size.0 * size.1]);
            luma[y * size.0 + x] = 16.0;
            blur_3x3(&luma, size, &mut out);
            out
        };
        #[rustfmt::skip]
        assert_eq!(blurred(2, 2, (5, 5)), [
            0.0, 0.0, 0.0, 0.0, 0.0,
            0.0, 1.0, 2.0, 1.0, 0.0,
            0.0, 2.0, 4.0, 2.0, 0.0,
            0.0, 1.0, 2.0, 1.0, 0.0,
            0.0, 0.0, 0.0, 0.0, 0.0,
        ]);
        assert_eq!(blurred(1, 0, (3, 2)), [4.0, 4.0, 4.0, 4.0, 4.0, 4.0]);
        assert_eq!(blurred(0, 1, (3, 2)), [4.0, 2.0, 0.0, 4.0, 2.0, 0.0]);
        assert_eq!(blurred(0, 1, (1, 3)), [8.0, 8.0, 8.0]);
        assert_eq!(blurred(1, 0, (2, 1)), [8.0, 8.0]);
        assert_eq!(blurred(0, 0, (1, 1)), [16.0]);
    }
}
