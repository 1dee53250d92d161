//! What a pixel's comparator sees over an interval: straight lines or a cubic, low-passed once or twice, plus the leak.
//!
//! A low-pass takes a cubic as chords ([`super::chords`]).
//!
//! What must not break: the drift of the leak is straight over the whole interval, also if samples lie between its
//! ends.

use super::chords::Node;
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
    /// Follows straight lines from node to node (tick, log intensity) between the ends.
    pub(super) fn follow_lines(
        &self,
        pixel: &mut Pixel<'_>,
        between: impl Iterator<Item = (i64, f64)>,
        mut low_pass: Option<LowPass<'_>>,
        mut emit: impl FnMut(i64, bool),
    ) {
        let (mut start, mut from) = (0, self.from);
        for (tick, to) in between.chain([(self.ticks, self.to)]) {
            let chord = Chord { start, ticks: tick - start, from, to };
            let ticks = chord.ticks as f64;
            if let Some(LowPass { bandwidth, photoreceptor: Some(first), output }) = &mut low_pass {
                let decays = Decays {
                    first: bandwidth.photoreceptor_decay(from, to, ticks),
                    second: bandwidth.follower_decay(ticks),
                };
                let before = (**first, **output);
                let ends = filter_twice(before, from, to, decays);
                (**first, **output) = (ends.first, ends.second);
                self.follow_filtered_twice(pixel, &chord, decays, before, ends.second, &mut emit);
            } else if let Some(LowPass { bandwidth, output, .. }) = &mut low_pass {
                let decay = bandwidth.decay(from, to, ticks);
                let before = **output;
                **output = filter(before, from, to, decay);
                self.follow_filtered(pixel, &chord, decay, (before, **output), &mut emit);
            } else {
                let (leaked, will_leak) = self.leaked(&chord);
                let curve = Line { from: from + leaked, to: to + will_leak, ticks: chord.ticks };
                pixel.follow(&curve, start, |t| chord.log_light_at(t), &mut emit);
            }
            (start, from) = (tick, to);
        }
    }

    /// Follows the outputs of low-passes along chords, whose nodes are known from the interval's start to its end.
    pub(super) fn follow_chords(
        &self,
        pixel: &mut Pixel<'_>,
        nodes: impl Iterator<Item = Node>,
        (bandwidth, twice): (PhotoreceptorBandwidth, bool),
        mut emit: impl FnMut(i64, bool),
    ) {
        let mut last: Option<Node> = None;
        for node in nodes {
            let Some(before) = last.replace(node) else { continue };
            let chord = Chord { start: before.tick, ticks: node.tick - before.tick, from: before.log, to: node.log };
            if twice {
                let decays = Decays { first: node.decay, second: bandwidth.follower_decay(chord.ticks as f64) };
                let outputs = (before.photoreceptor, before.filtered);
                self.follow_filtered_twice(pixel, &chord, decays, outputs, node.filtered, &mut emit);
            } else {
                self.follow_filtered(pixel, &chord, node.decay, (before.filtered, node.filtered), &mut emit);
            }
        }
    }

    /// Follows the cubic with these slopes (log intensity over the whole interval), without a low-pass.
    pub(super) fn follow_cubic(&self, pixel: &mut Pixel<'_>, slopes: (f64, f64), emit: impl FnMut(i64, bool)) {
        let line = Line { from: self.from, to: self.to, ticks: self.ticks };
        let input = Cubic::new(line, slopes.0, slopes.1);
        let (leaked, will_leak) = (self.drift.at(0.0), self.drift.at(self.ticks as f64));
        let line = Line { from: self.from + leaked, to: self.to + will_leak, ticks: self.ticks };
        let drift = will_leak - leaked;
        let curve = Cubic::new(line, slopes.0 + drift, slopes.1 + drift);
        pixel.follow(&curve, 0, |t| input.at(t / self.ticks as f64), emit);
    }

    /// Follows the output of one low-pass over a chord, which runs from `outputs.0` to `outputs.1`.
    pub(super) fn follow_filtered(
        &self,
        pixel: &mut Pixel<'_>,
        chord: &Chord,
        decay: f64,
        outputs: (f64, f64),
        emit: impl FnMut(i64, bool),
    ) {
        let (leaked, will_leak) = self.leaked(chord);
        // The output stays between its value at the start and its input's two ends.
        let (least, most) = (chord.from.min(chord.to).min(outputs.0), chord.from.max(chord.to).max(outputs.0));
        if pixel.rests_until(chord.end(), (least + leaked, most + will_leak)) {
            return;
        }
        pixel.follow(&self.filtered(chord, decay, outputs), chord.start, |t| chord.log_light_at(t), emit);
    }

    /// Returns what a comparator sees of the output of one low-pass.
    pub(super) fn filtered(&self, chord: &Chord, decay: f64, outputs: (f64, f64)) -> Filtered {
        let (leaked, will_leak) = self.leaked(chord);
        Filtered {
            start: outputs.0 + leaked,
            end: outputs.1 + will_leak,
            gap: chord.from - outputs.0,
            change: chord.to - chord.from,
            drift: will_leak - leaked,
            decay,
            ticks: chord.ticks,
        }
    }

    /// Follows the output of the second of two low-passes over a chord: their outputs `before` it, and its own at the `end`.
    pub(super) fn follow_filtered_twice(
        &self,
        pixel: &mut Pixel<'_>,
        chord: &Chord,
        decays: Decays,
        before: (f64, f64),
        end: f64,
        emit: impl FnMut(i64, bool),
    ) {
        let (leaked, will_leak) = self.leaked(chord);
        // The output stays between both outputs at the start and the input's two ends.
        let least = chord.from.min(chord.to).min(before.0).min(before.1);
        let most = chord.from.max(chord.to).max(before.0).max(before.1);
        if pixel.rests_until(chord.end(), (least + leaked, most + will_leak)) {
            return;
        }
        let curve = self.filtered_twice(chord, decays, before, end);
        pixel.follow(&curve, chord.start, |t| chord.log_light_at(t), emit);
    }

    /// Returns what a comparator sees of the output of the second of two low-passes.
    pub(super) fn filtered_twice(&self, chord: &Chord, decays: Decays, before: (f64, f64), end: f64) -> FilteredTwice {
        let (leaked, will_leak) = self.leaked(chord);
        FilteredTwice {
            start: before.1 + leaked,
            end: end + will_leak,
            lag: before.0 - before.1,
            gap: chord.from - before.0,
            change: chord.to - chord.from,
            drift: will_leak - leaked,
            decays,
            ticks: chord.ticks,
        }
    }

    /// How far the reference has leaked at both ends of a chord.
    fn leaked(&self, chord: &Chord) -> (f64, f64) {
        (self.drift.at(chord.start as f64), self.drift.at(chord.end()))
    }
}

/// A part of an interval over which the input is straight.
pub(super) struct Chord {
    /// Ticks from the interval's start to its own, and its length.
    pub(super) start: i64,
    pub(super) ticks: i64,
    /// Log intensity at both ends.
    pub(super) from: f64,
    pub(super) to: f64,
}

#[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
impl Chord {
    /// When it ends, in ticks from the interval's start.
    fn end(&self) -> f64 {
        (self.start + self.ticks) as f64
    }

    /// ln(luma + `log_eps`) so many ticks after its start.
    pub(super) fn log_light_at(&self, t: f64) -> f64 {
        self.from + (self.to - self.from) * (t / self.ticks as f64)
    }
}
