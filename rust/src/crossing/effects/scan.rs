//! The common path under effects: what comparators see at a frame, and which pixels need a closer look, many at a time.
//!
//! It computes low-passes for all pixels in vector code, because every pixel's output changes with every frame. It then
//! marks the pixels whose signal left its bounds, or may have done so between two frames because it turned.
//!
//! What must not break: a pixel is marked wherever it may have had an event since the last frame. Marking one without
//! need costs only time.

use multiversion::multiversion;

use super::filtered::filter;
use super::parameters::PhotoreceptorBandwidth;
use super::two_poles::{Decays, filter_twice};
use crate::crossing::exponential::exp_precise;

/// Further from zero than so many standard deviations noise is not looked for: it is there once in some days of a pixel.
pub(super) const FAR: f64 = 6.0;

/// Computes the low-pass's time constants in an interval and its output at the end, for each pixel.
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

/// The outputs of two low-passes in a row at the end of an interval, for each pixel.
pub(super) struct TwoOutputs<'a> {
    pub(super) first: &'a mut [f64],
    pub(super) second: &'a mut [f64],
    /// Their derivatives by the share of the interval.
    pub(super) first_slope: &'a mut [f64],
    pub(super) second_slope: &'a mut [f64],
}

/// The same as [`low_pass`] for two low-passes: the first one's time constants, and the outputs of both.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn two_low_passes(
    bandwidth: PhotoreceptorBandwidth,
    ticks: f64,
    (photoreceptor, follower): (&[f64], &[f64]),
    (from, to): (&[f64], &[f64]),
    decay: &mut [f64],
    outputs: TwoOutputs<'_>,
) {
    let n = follower.len();
    let (photoreceptor, from, to) = (&photoreceptor[..n], &from[..n], &to[..n]);
    let (decay, first, second) = (&mut decay[..n], &mut outputs.first[..n], &mut outputs.second[..n]);
    let (first_slope, second_slope) = (&mut outputs.first_slope[..n], &mut outputs.second_slope[..n]);
    let follower_decay = bandwidth.follower_decay(ticks);
    for i in 0..n {
        let decays = Decays { first: bandwidth.photoreceptor_decay(from[i], to[i], ticks), second: follower_decay };
        let ends = filter_twice((photoreceptor[i], follower[i]), from[i], to[i], decays);
        decay[i] = decays.first;
        (first[i], second[i]) = (ends.first, ends.second);
        (first_slope[i], second_slope[i]) = (ends.first_slope, ends.second_slope);
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

/// Marks pixels whose comparators saw log intensity at or beyond its bounds at the interval's start.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
pub(super) fn mark_start_out_of_bounds(
    before: &[f64],
    leaked: &[f64],
    (low, high): (&[f64], &[f64]),
    marked: &mut [bool],
) {
    let n = marked.len();
    let (before, leaked, low, high) = (&before[..n], &leaked[..n], &low[..n], &high[..n]);
    for i in 0..n {
        let seen = before[i] + leaked[i];
        marked[i] |= (seen >= high[i]) | (seen <= low[i]);
    }
}

/// Bounds of what comparators see without noise: beyond these, noise of a reach may take it beyond the others.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn within_reach((low, high): (&[f64], &[f64]), reach: &[f64], (least, most): (&mut [f64], &mut [f64])) {
    let n = reach.len();
    let (low, high, least, most) = (&low[..n], &high[..n], &mut least[..n], &mut most[..n]);
    for i in 0..n {
        (least[i], most[i]) = (low[i] + reach[i], high[i] - reach[i]);
    }
}

/// How far noise may be from zero within an interval, for each pixel: in the light of the end that has more of it.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn noise_reach((rms, floor, log_half): (f64, f64, f64), from: &[f64], to: &[f64], reach: &mut [f64]) {
    let n = reach.len();
    let (from, to, falls) = (&from[..n], &to[..n], floor <= rms);
    for i in 0..n {
        let log_light = if falls { from[i].min(to[i]) } else { from[i].max(to[i]) };
        let fraction = 1.0 / (1.0 + exp_precise(log_light - log_half));
        reach[i] = FAR * (rms * rms * fraction + floor * floor * (1.0 - fraction)).sqrt();
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

/// Two low-passes over an interval, pixel by pixel.
pub(super) struct TwoSteps<'a> {
    pub(super) from: &'a [f64],
    pub(super) to: &'a [f64],
    /// What left both at the start.
    pub(super) first: &'a [f64],
    pub(super) second: &'a [f64],
    /// Time constants.
    pub(super) first_decay: &'a [f64],
    pub(super) second_decay: f64,
    /// Derivatives at the end.
    pub(super) first_slope: &'a [f64],
    pub(super) second_slope: &'a [f64],
}

/// The same as [`mark_sign_changes`] for the output of the second of two low-passes, which may turn twice in an interval.
///
/// It turns where its slope changes its sign between both ends, or where the slope is not monotone, which the second
/// derivative at both ends tells: that has one zero at most. The output stays between both outputs at the start and the
/// input's two ends.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
pub(super) fn mark_turns(
    step: &TwoSteps<'_>,
    (leaked, will_leak): (&[f64], &[f64]),
    (low, high): (&[f64], &[f64]),
    marked: &mut [bool],
) {
    let n = marked.len();
    let (from, to, first, second) = (&step.from[..n], &step.to[..n], &step.first[..n], &step.second[..n]);
    let (decay, first_slope, second_slope) = (&step.first_decay[..n], &step.first_slope[..n], &step.second_slope[..n]);
    let (leaked, will_leak) = (&leaked[..n], &will_leak[..n]);
    let (low, high) = (&low[..n], &high[..n]);
    for i in 0..n {
        let drift = will_leak[i] - leaked[i];
        let slope = step.second_decay * (first[i] - second[i]);
        let bends = (decay[i] * (from[i] - first[i]) - slope, first_slope[i] - second_slope[i]);
        let slopes = (slope + drift, second_slope[i] + drift);
        let least = from[i].min(to[i]).min(first[i]).min(second[i]);
        let most = from[i].max(to[i]).max(first[i]).max(second[i]);
        let may_leave = (most + will_leak[i] >= high[i]) | (least + leaked[i] <= low[i]);
        marked[i] |= ((slopes.0 * slopes.1 < 0.0) | (bends.0 * bends.1 < 0.0)) & may_leave;
    }
}
