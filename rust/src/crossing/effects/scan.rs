//! The common path under effects: what comparators see at a frame, and which pixels need a look, many at a time.
//!
//! What must not break: a pixel is marked wherever it may have had an event since the last frame. One that is marked
//! without need costs time only.

use multiversion::multiversion;

use super::filtered::filter;
use super::parameters::PhotoreceptorBandwidth;

/// Of each pixel the low-pass's time constants in an interval, and its output at the end.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn low_pass(
    bandwidth: PhotoreceptorBandwidth,
    ticks: f64,
    before: &[f64],
    (from, to): (&[f64], &[f64]),
    (decay, output): (&mut [f64], &mut [f64]),
) {
    let n = before.len();
    let (from, to, decay, output) = (&from[..n], &to[..n], &mut decay[..n], &mut output[..n]);
    for i in 0..n {
        let z = bandwidth.decay(from[i], to[i], ticks);
        decay[i] = z;
        output[i] = filter(before[i], from[i], to[i], z);
    }
}

/// Marks pixels whose comparators see log intensity at or beyond its bounds.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
pub(super) fn mark_out_of_bounds(seen: &[f64], (low, high): (&[f64], &[f64]), marked: &mut [bool]) {
    let n = marked.len();
    let (seen, low, high) = (&seen[..n], &low[..n], &high[..n]);
    for i in 0..n {
        marked[i] = (seen[i] >= high[i]) | (seen[i] <= low[i]);
    }
}

/// A low-pass over an interval, pixel by pixel: its input and output at both ends, and its time constants.
pub(super) struct FilterStep<'a> {
    pub(super) from: &'a [f64],
    pub(super) to: &'a [f64],
    pub(super) before: &'a [f64],
    pub(super) output: &'a [f64],
    pub(super) decay: &'a [f64],
}

/// Marks pixels in which the slope of the low-pass's output changes its sign within the interval, and whose output may
/// have been beyond its bounds at the extremum between.
///
/// The output stays between its value at the start and its input's two ends, which bounds the extremum. What a
/// comparator sees has leaked so much at both ends.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
pub(super) fn mark_sign_changes(
    step: &FilterStep<'_>,
    (leaked, will_leak): (&[f64], &[f64]),
    (low, high): (&[f64], &[f64]),
    marked: &mut [bool],
) {
    let n = marked.len();
    let FilterStep { from, to, before, output, decay } = step;
    let (from, to, before, output, decay) = (&from[..n], &to[..n], &before[..n], &output[..n], &decay[..n]);
    let (leaked, will_leak) = (&leaked[..n], &will_leak[..n]);
    let (low, high) = (&low[..n], &high[..n]);
    for i in 0..n {
        let drift = will_leak[i] - leaked[i];
        let slopes = (decay[i] * (from[i] - before[i]) + drift, decay[i] * (to[i] - output[i]) + drift);
        let (least, most) = (from[i].min(before[i]).min(to[i]), from[i].max(before[i]).max(to[i]));
        let may_leave = (most + will_leak[i] >= high[i]) | (least + leaked[i] <= low[i]);
        marked[i] |= (slopes.0 * slopes.1 < 0.0) & may_leave;
    }
}
