//! What a pixel's comparator sees over an interval: straight lines or a cubic, low-passed once or twice, plus the leak.
//!
//! A low-pass has a closed form only for straight input, so it takes a cubic as chords.
//!
//! What must not break: the drift of the leak is straight over the whole interval, also if samples lie between its
//! ends.

use super::filtered::{Filtered, filter};
use super::leak::Drift;
use super::parameters::PhotoreceptorBandwidth;
use super::timeline::Pixel;
use super::two_poles::{Decays, FilteredTwice, filter_twice};
use crate::crossing::cubic::Cubic;
use crate::crossing::line::Line;

/// A pixel's input over an interval of `ticks` ticks.
pub(super) struct Input {
    pub(super) drift: Drift,
    /// Log intensity at both ends.
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) ticks: i64,
}

/// A low-pass, or two, and their outputs at the start, then at the end.
pub(super) struct LowPass<'a> {
    pub(super) bandwidth: PhotoreceptorBandwidth,
    /// What leaves the photoreceptor, where the source follower is a second low-pass.
    pub(super) photoreceptor: Option<&'a mut f64>,
    pub(super) output: &'a mut f64,
}

#[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
impl Input {
    /// Straight from node to node (tick, log intensity) between the ends.
    pub(super) fn follow_lines(
        &self,
        pixel: &mut Pixel<'_>,
        between: impl Iterator<Item = (i64, f64)>,
        mut low_pass: Option<LowPass<'_>>,
        mut emit: impl FnMut(i64, bool),
    ) {
        let (mut start, mut from) = (0, self.from);
        for (tick, to) in between.chain([(self.ticks, self.to)]) {
            let ticks = tick - start;
            let light_at = |t: f64| libm::exp(from + (to - from) * (t / ticks as f64));
            let (leaked, will_leak) = (self.leaked(start as f64), self.leaked(tick as f64));
            let drift = will_leak - leaked;
            if let Some(LowPass { bandwidth, photoreceptor: Some(first), output }) = &mut low_pass {
                let decays = Decays {
                    first: bandwidth.photoreceptor_decay(from, to, ticks as f64),
                    second: bandwidth.follower_decay(ticks as f64),
                };
                let before = (**first, **output);
                let ends = filter_twice(before, from, to, decays);
                (**first, **output) = (ends.first, ends.second);
                let curve = FilteredTwice {
                    start: before.1 + leaked,
                    end: **output + will_leak,
                    lag: before.0 - before.1,
                    gap: from - before.0,
                    change: to - from,
                    drift,
                    decays,
                    ticks,
                };
                pixel.follow(&curve, start, light_at, &mut emit);
            } else if let Some(LowPass { bandwidth, output, .. }) = &mut low_pass {
                let decay = bandwidth.decay(from, to, ticks as f64);
                let before = **output;
                **output = filter(before, from, to, decay);
                let curve = Filtered {
                    start: before + leaked,
                    end: **output + will_leak,
                    gap: from - before,
                    change: to - from,
                    drift,
                    decay,
                    ticks,
                };
                pixel.follow(&curve, start, light_at, &mut emit);
            } else {
                let curve = Line { from: from + leaked, to: to + will_leak, ticks };
                pixel.follow(&curve, start, light_at, &mut emit);
            }
            (start, from) = (tick, to);
        }
    }

    /// Follows the cubic with these slopes (log intensity over the whole interval).
    ///
    /// A low-pass takes the cubic as chords: enough for them to lie within `tolerance` of it, but at most 16.
    pub(super) fn follow_cubic(
        &self,
        pixel: &mut Pixel<'_>,
        slopes: (f64, f64),
        tolerance: f64,
        low_pass: Option<LowPass<'_>>,
        emit: impl FnMut(i64, bool),
    ) {
        let line = Line { from: self.from, to: self.to, ticks: self.ticks };
        let input = Cubic::new(line, slopes.0, slopes.1);
        let log_at = |t: f64| input.at(t / self.ticks as f64);
        if low_pass.is_some() {
            // The error of chords falls with the square of their number.
            #[allow(clippy::cast_possible_truncation, reason = "at most 16")]
            let chords = (bend(slopes, self.to - self.from) / tolerance).sqrt().ceil().clamp(1.0, 16.0) as i64;
            let chords = chords.min(self.ticks);
            let ticks = (1..chords).map(|k| self.ticks * k / chords);
            self.follow_lines(pixel, ticks.map(|tick| (tick, log_at(tick as f64))), low_pass, emit);
        } else {
            let (leaked, will_leak) = (self.leaked(0.0), self.leaked(self.ticks as f64));
            let line = Line { from: self.from + leaked, to: self.to + will_leak, ticks: self.ticks };
            let drift = will_leak - leaked;
            let curve = Cubic::new(line, slopes.0 + drift, slopes.1 + drift);
            pixel.follow(&curve, 0, |t| libm::exp(log_at(t)), emit);
        }
    }

    /// How far the reference has leaked at a tick of the interval.
    fn leaked(&self, tick: f64) -> f64 {
        self.drift.at(tick)
    }
}

/// How far a cubic with these slopes strays from its chord, from above: an eighth of its largest second derivative, which
/// lies at one of its ends. NaN where it is its chord for want of a slope.
pub(super) fn bend(slopes: (f64, f64), chord: f64) -> f64 {
    let (from, to) = (slopes.0 - chord, slopes.1 - chord);
    0.25 * (2.0 * from + to).abs().max((from + 2.0 * to).abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Second derivatives at the ends, 6 chord - 4 p - 2 q and 2 p + 4 q - 6 chord, over eight.
    #[test]
    fn a_cubic_s_bend_is_an_eighth_of_its_largest_second_derivative() {
        for (slopes, chord, expected) in [
            ((0.0, 0.0), 1.0, 0.75),
            ((3.0, 0.0), 1.0, 0.75),
            ((0.0, 4.0), 1.0, 1.25),
            ((4.0, 0.0), 1.0, 1.25),
            ((2.0, 5.0), -1.0, 3.75),
            ((1.5, 1.5), 1.5, 0.0),
        ] {
            assert_eq!(bend(slopes, chord).to_bits(), f64::to_bits(expected), "{slopes:?} {chord}");
        }
    }
}
