//! The path of noise in one pixel, and where signal and noise together reach a level.
//!
//! Noise is drawn at the ends of cells, one after the other. Where the signal is so near to a level that noise may have
//! reached it within a cell, the cell is halved by a draw of its middle, and so on, until what is not known is far
//! less than the noise. There the path is the cubic through what is known.
//!
//! What must not break:
//! - A draw is a function of (seed, pixel, instant), so looking closer never changes what was seen before, and on a scene
//!   that stands still the path does not depend on when frames come.
//! - A cell has the light of its start all the way, because its law must not change once its end is drawn.
//! - Where noise cannot reach a level, none is drawn. It is taken up again by the law of the time that has passed.

use super::shot_noise::{FAR, ShotNoiseLaw};
use super::two_pole_noise::{Outputs, TwoPoleNoise};
use crate::crossing::level::Thresholds;

/// Where a pixel's noise stands: its cell, and the outputs of both poles at the ends of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NoisePath {
    pub(crate) cell: i64,
    /// ln(luma + `log_eps`) at the cell's start.
    pub(crate) log_light: f64,
    /// What follows from that: the standard deviation, and the place of both poles' ratio in its table.
    pub(super) sigma: f64,
    pub(super) ratio: usize,
    pub(crate) start: Outputs,
    pub(super) end: Outputs,
}

#[allow(clippy::cast_precision_loss, reason = "small")]
impl NoisePath {
    /// Noise at the first frame, and in the cell that begins there.
    pub(super) fn new(law: &ShotNoiseLaw, pixel: u32, log_light: f64) -> Self {
        Self::at(law, pixel, 0, log_light, law.first(pixel, log_light))
    }

    /// Noise at the first frame of a pixel that has seen the same for some time, and its reference there.
    ///
    /// The noise of before has taken references away from where the next of its passages would be at once. `first` gives
    /// the reference where that time begins, by the noise there.
    pub(super) fn run_before(
        law: &ShotNoiseLaw,
        pixel: u32,
        log_light: f64,
        c: Thresholds,
        first: impl Fn(f64) -> f64,
    ) -> (Self, f64) {
        const CELLS: i64 = 16;
        let mut path = Self::at(law, pixel, -CELLS, log_light, law.first(pixel, log_light));
        let (mut reference, least) = (first(path.start[1]), c.on.min(c.off));
        let begins = -(CELLS as f64) * law.cell_us;
        let mut noise = ShotNoisePath { law, pixel, path: &mut path, elapsed_us: 0.0, reach: 0.0, last: None };
        let (mut now, light) = (begins, |_: f64| log_light);
        loop {
            let levels = Levels { above: reference + c.on, below: reference - c.off, least };
            let Some((at, on)) = noise.first_crossing((now, 0.0), &light, levels, &light) else { break };
            (now, reference) = (at, if on { levels.above } else { levels.below });
        }
        noise.enter(0.0, &light);
        (path, reference)
    }

    /// Noise in a cell that begins with these outputs.
    pub(super) fn at(law: &ShotNoiseLaw, pixel: u32, cell: i64, log_light: f64, start: Outputs) -> Self {
        let (sigma, ratio) = (law.sigma(log_light), law.ratio(log_light));
        let draws = law.draws(pixel, law.node(cell + 1, 0));
        let end = law.poles_of(ratio).after_a_cell(start, sigma, draws);
        Self { cell, log_light, sigma, ratio, start, end }
    }

    /// Noise in a later cell, by the draws of its end.
    pub(super) fn enter(&mut self, law: &ShotNoiseLaw, pixel: u32, cell: i64, log_light: f64, draws: (f64, f64)) {
        let left_out = cell - self.cell - 1;
        let start = if left_out > 0 { law.after(pixel, cell, left_out, log_light, self.end) } else { self.end };
        if self.log_light.to_bits() != log_light.to_bits() {
            (self.log_light, self.sigma, self.ratio) = (log_light, law.sigma(log_light), law.ratio(log_light));
        }
        let end = law.poles_of(self.ratio).after_a_cell(start, self.sigma, draws);
        (self.cell, self.start, self.end) = (cell, start, end);
    }

    /// The level at which its spans are smooth, and are halved no more, for the lesser of both thresholds.
    pub(super) fn smooth(&self, law: &ShotNoiseLaw, least: f64) -> usize {
        law.poles_of(self.ratio).smooth(FINE * (least / self.sigma).min(1.0))
    }

    /// The whole cell.
    pub(super) fn span(&self, units: u64) -> Span {
        Span { cell: self.cell, level: 0, position: 0, units, ends: [self.start, self.end] }
    }
}

/// What is not known within a span may be this share of the noise's standard deviation, and of a threshold, at most.
const FINE: f64 = 0.005;

/// A moment of the interval, in microseconds from its start, and what comparators see there without noise.
type Seen = (f64, f64);

/// The noise of a pixel over an interval that begins `elapsed_us` after the first frame.
pub(crate) struct ShotNoisePath<'a> {
    pub(crate) law: &'a ShotNoiseLaw,
    pub(crate) pixel: u32,
    pub(crate) path: &'a mut NoisePath,
    pub(crate) elapsed_us: f64,
    /// How far it may be from zero.
    pub(crate) reach: f64,
    /// The smooth span of the last crossing, where the next one is often: looking there draws nothing.
    pub(crate) last: Option<Span>,
}

impl ShotNoisePath<'_> {
    /// Goes to the cell in which a time lies; returns when that begins.
    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "within 2^53 us")]
    fn enter(&mut self, t: f64, log_light: &impl Fn(f64) -> f64) -> f64 {
        let cell_us = self.law.cell_us;
        let cell = ((self.elapsed_us + t) / cell_us).floor() as i64;
        let begins = cell as f64 * cell_us - self.elapsed_us;
        if cell > self.path.cell {
            let draws = self.law.draws(self.pixel, self.law.node(cell + 1, 0));
            self.path.enter(self.law, self.pixel, cell, log_light(begins), draws);
        }
        begins
    }

    /// Noise at a time, none being asked for at an earlier one afterwards. `log_light` gives ln(luma + `log_eps`).
    pub(crate) fn at(&mut self, t: f64, least: f64, log_light: &impl Fn(f64) -> f64) -> f64 {
        let begins = self.enter(t, log_light);
        let cell = self.cell(begins, least);
        let mut span = self.path.span(1 << self.law.levels);
        while span.level < cell.smooth {
            let (middle, at) = cell.middle(&span);
            span = if t < at { span.first_half(middle) } else { span.second_half(middle) };
        }
        cell.cubic(&span, t)
    }

    /// When signal and noise first reach the level above or the one below in a window, and whether it is the one above.
    ///
    /// `seen` is monotone there.
    pub(crate) fn first_crossing(
        &mut self,
        (from, until): (f64, f64),
        seen: &impl Fn(f64) -> f64,
        levels: Levels,
        log_light: &impl Fn(f64) -> f64,
    ) -> Option<(f64, bool)> {
        let mut first = (from, seen(from));
        while first.0 < until {
            let begins = self.enter(first.0, log_light);
            let ends = begins + self.law.cell_us;
            if ends <= first.0 {
                return None; // so late that a float does not tell times of a cell apart
            }
            let mut last = if ends < until { ends } else { until };
            let mut span = self.path.span(1 << self.law.levels);
            let end = (last, seen(last));
            let range = self.law.poles_of(self.path.ratio).range(0, span.ends, self.path.sigma, FAR);
            if !levels.within_reach([first, end], range) {
                first = end;
                continue;
            }
            let cell = self.cell(begins, levels.least);
            if let Some(smooth) = self.last.filter(|smooth| cell.has(smooth, first.0)) {
                (last, span) = (last.min(cell.extent(&smooth).1), smooth);
            }
            let last = (last, seen(last));
            let crossing = cell.search(&span, [first, last], seen, &levels);
            if let Some((at, on, span)) = crossing {
                self.last = Some(span);
                return Some((at, on));
            }
            first = last;
        }
        None
    }

    #[allow(clippy::cast_precision_loss, reason = "at most 2^25")]
    fn cell(&self, begins: f64, least: f64) -> Cell<'_> {
        let (poles, sigma) = (self.law.poles_of(self.path.ratio), self.path.sigma);
        let unit_us = self.law.cell_us / (1u64 << self.law.levels) as f64;
        let (law, pixel, number) = (self.law, self.pixel, self.path.cell);
        Cell { law, pixel, number, begins, unit_us, poles, sigma, smooth: self.path.smooth(law, least) }
    }
}

/// The next levels above and below, in log intensity, and the lesser of both thresholds.
#[derive(Clone, Copy)]
pub(crate) struct Levels {
    pub(crate) above: f64,
    pub(crate) below: f64,
    pub(crate) least: f64,
}

impl Levels {
    /// Whether one may be reached between two moments, with noise that comes down and up so far.
    #[inline]
    fn within_reach(&self, [first, last]: [Seen; 2], (down, up): (f64, f64)) -> bool {
        first.1.max(last.1) + up >= self.above || first.1.min(last.1) + down <= self.below
    }

    /// Which one a value has reached, as (so, the one above).
    fn reached(&self, value: f64) -> Option<bool> {
        match (value >= self.above, value <= self.below) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        }
    }
}

/// A part of a cell of which the outputs at both ends are known.
#[derive(Clone, Copy)]
pub(crate) struct Span {
    /// The number of the cell.
    pub(super) cell: i64,
    pub(super) level: usize,
    /// Where it begins, in units of the shortest span.
    position: u64,
    units: u64,
    pub(super) ends: [Outputs; 2],
}

impl Span {
    /// Where its middle is, in units of the shortest span.
    pub(super) fn middle(&self) -> u64 {
        self.position + self.units / 2
    }

    pub(super) fn first_half(&self, middle: Outputs) -> Self {
        let ends = [self.ends[0], middle];
        Self { level: self.level + 1, units: self.units / 2, ends, ..*self }
    }

    pub(super) fn second_half(&self, middle: Outputs) -> Self {
        let (position, ends) = (self.middle(), [middle, self.ends[1]]);
        Self { level: self.level + 1, position, units: self.units / 2, ends, ..*self }
    }
}

/// A cell of a pixel's noise.
struct Cell<'a> {
    law: &'a ShotNoiseLaw,
    pixel: u32,
    number: i64,
    /// In microseconds from the interval's start.
    begins: f64,
    unit_us: f64,
    poles: &'a TwoPoleNoise,
    sigma: f64,
    /// The level at which spans are smooth.
    smooth: usize,
}

#[allow(clippy::cast_precision_loss, reason = "at most 2^25 units")]
impl Cell<'_> {
    /// When a span begins and when it ends.
    fn extent(&self, span: &Span) -> (f64, f64) {
        let at = |units: u64| self.begins + units as f64 * self.unit_us;
        (at(span.position), at(span.position + span.units))
    }

    /// Whether a span is smooth here and has a time in it, with some that follows.
    fn has(&self, span: &Span, t: f64) -> bool {
        let (begins, ends) = self.extent(span);
        span.cell == self.number && span.level >= self.smooth && begins <= t && t < ends
    }

    /// Outputs in the middle of a span, and when that is.
    fn middle(&self, span: &Span) -> (Outputs, f64) {
        let position = span.middle();
        let draws = self.law.draws(self.pixel, self.law.node(self.number, position));
        let outputs = self.poles.middle(span.level, span.ends, self.sigma, draws);
        (outputs, self.begins + position as f64 * self.unit_us)
    }

    /// When a span begins, how long it lasts, the second output's slopes at both ends and its change, over the span.
    fn shape(&self, span: &Span) -> (f64, f64, [f64; 2], f64) {
        let lasts = span.units as f64 * self.unit_us;
        let follower = self.law.follower * lasts;
        let [[u, v], [x, y]] = span.ends;
        let begins = self.begins + span.position as f64 * self.unit_us;
        (begins, lasts, [follower * (u - v), follower * (x - y)], y - v)
    }

    /// Noise at a time within a smooth span: the cubic through outputs and slopes at both ends.
    fn cubic(&self, span: &Span, t: f64) -> f64 {
        let (begins, lasts, [from, to], way) = self.shape(span);
        let s = (t - begins) / lasts;
        let left = 1.0 - s;
        // A straight line, and what the slopes at both ends add to that.
        span.ends[0][1] + way * s + s * left * ((from - way) * left - (to - way) * s)
    }

    /// The first crossing within a span, between two moments of which something lies in it.
    fn search(
        &self,
        span: &Span,
        [first, last]: [Seen; 2],
        seen: &impl Fn(f64) -> f64,
        levels: &Levels,
    ) -> Option<(f64, bool, Span)> {
        if !levels.within_reach([first, last], self.poles.range(span.level, span.ends, self.sigma, FAR)) {
            return None;
        }
        if span.level >= self.smooth {
            return self.look(span, [first, last], seen, levels).map(|(at, on)| (at, on, *span));
        }
        let (middle, at) = self.middle(span);
        if at >= last.0 {
            return self.search(&span.first_half(middle), [first, last], seen, levels);
        }
        if at <= first.0 {
            return self.search(&span.second_half(middle), [first, last], seen, levels);
        }
        let between = (at, seen(at));
        self.search(&span.first_half(middle), [first, between], seen, levels)
            .or_else(|| self.search(&span.second_half(middle), [between, last], seen, levels))
    }

    /// The first crossing within a smooth span.
    ///
    /// Signal and noise are looked at where they turn, the signal being taken as straight for that.
    fn look(
        &self,
        span: &Span,
        [first, last]: [Seen; 2],
        seen: &impl Fn(f64) -> f64,
        levels: &Levels,
    ) -> Option<(f64, bool)> {
        let at = |t: f64, seen: f64| seen + self.cubic(span, t);
        let mut before = (first.0, at(first.0, first.1));
        if let Some(on) = levels.reached(before.1) {
            return Some((before.0, on));
        }
        let turns = self.turns(span, (last.1 - first.1) / (last.0 - first.0));
        for t in turns.into_iter().filter(|&t| first.0 < t && t < last.0).chain([last.0]) {
            let after = (t, at(t, if t < last.0 { seen(t) } else { last.1 }));
            if let Some(on) = levels.reached(after.1) {
                let level = if on { levels.above } else { levels.below };
                return Some((root([before, after], level, |t| at(t, seen(t))), on));
            }
            before = after;
        }
        None
    }

    /// When a smooth span and a straight line of a slope per microsecond turn together, in order; NaN where they do not.
    fn turns(&self, span: &Span, slope: f64) -> [f64; 2] {
        let (begins, lasts, [from, to], way) = self.shape(span);
        // The derivative by the share s of the span is a s^2 - 2 b s + c.
        let (from, to) = (from - way, to - way);
        let (a, b, c) = (3.0 * (from + to), 2.0 * from + to, way + from + slope * lasts);
        let far = b + (b * b - a * c).sqrt().copysign(b);
        let (first, second) = (far / a, c / far);
        [first.min(second), first.max(second)].map(|s| begins + s * lasts)
    }
}

/// Stamps are whole microseconds; where windows end must not move one.
const WITHIN_US: f64 = 1e-7;

/// When a value reaches a level between two moments, of which it has reached it at the second: by false position, the
/// retained end's weight halved (Illinois).
fn root([mut before, mut after]: [(f64, f64); 2], level: f64, value: impl Fn(f64) -> f64) -> f64 {
    let side = after.1 >= level && before.1 < level;
    let (mut low, mut high) = (before.1 - level, after.1 - level);
    for _ in 0..60 {
        if after.0 - before.0 <= WITHIN_US || high == 0.0 {
            break;
        }
        let t = (before.0 + (after.0 - before.0) * (low / (low - high))).clamp(before.0, after.0);
        let at = value(t) - level;
        if (at >= 0.0) == side {
            if at == 0.0 {
                return t;
            }
            (after.0, high, low) = (t, at, 0.5 * low);
        } else {
            (before.0, low, high) = (t, at, 0.5 * high);
        }
    }
    after.0
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small")]
mod tests {
    use super::*;
    use crate::crossing::effects::parameters::{Effects, ShotNoise};
    use proptest::prelude::*;

    fn law(rms: f64, half_luma: f64) -> ShotNoiseLaw {
        let shot_noise = ShotNoise { rms, floor: 0.0, half_luma, bandwidth_hz: 300.0 };
        ShotNoiseLaw::new(&Effects { shot_noise, ..Effects::default() }, 5).expect("on")
    }

    /// All crossings of a signal up to a time, the windows ending at these times.
    fn crossings(law: &ShotNoiseLaw, pixel: u32, slope: f64, ends: &[f64]) -> Vec<(f64, bool)> {
        let log_light = |_: f64| 0.0;
        let mut path = NoisePath::new(law, pixel, 0.0);
        let mut noise = ShotNoisePath { law, pixel, path: &mut path, elapsed_us: 0.0, reach: 0.0, last: None };
        let (mut reference, mut now, mut made) = (0.0, 0.0, vec![]);
        for &end in ends {
            loop {
                let levels = Levels { above: reference + 0.1, below: reference - 0.1, least: 0.1 };
                let seen = |t: f64| slope * t;
                let Some((at, on)) = noise.first_crossing((now, end), &seen, levels, &log_light) else { break };
                made.push((at, on));
                (now, reference) = (at, if on { levels.above } else { levels.below });
            }
            now = end;
        }
        made
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        /// Windows may end anywhere.
        #[test]
        fn crossings_do_not_depend_on_the_windows(
            pixel in 0u32..1000, slope in -1e-5f64..1e-5, power in -6.0f64..6.0,
            cuts in prop::collection::btree_set(1u32..40_000, 0..60),
        ) {
            let law = law(0.05, power.exp2());
            let whole = crossings(&law, pixel, slope, &[40_000.0]);
            let ends: Vec<f64> = cuts.into_iter().map(f64::from).chain([40_000.0]).collect();
            let cut = crossings(&law, pixel, slope, &ends);
            prop_assert_eq!(whole.len(), cut.len());
            for (whole, cut) in whole.into_iter().zip(cut) {
                prop_assert!(whole.1 == cut.1 && (whole.0 - cut.0).abs() < 0.01, "{whole:?} {cut:?}");
            }
        }

        /// Noise looked up at any time is that of which crossings are sought: level and signal differ by it.
        #[test]
        fn noise_is_on_the_level_at_a_crossing(pixel in 0u32..1000, power in -6.0f64..6.0) {
            let law = law(0.06, power.exp2());
            let (mut reference, made) = (0.0, crossings(&law, pixel, 0.0, &[40_000.0]));
            let mut path = NoisePath::new(&law, pixel, 0.0);
            for (at, on) in made {
                reference += if on { 0.1 } else { -0.1 };
                let mut noise = ShotNoisePath { law: &law, pixel, path: &mut path, elapsed_us: 0.0, reach: 0.0, last: None };
                while (noise.path.cell + 1) as f64 * law.cell_us < at {
                    noise.at((noise.path.cell + 1) as f64 * law.cell_us, 0.1, &|_| 0.0); // no cell is left out
                }
                let value = noise.at(at, 0.1, &|_| 0.0);
                prop_assert!(at == 0.0 || (value - reference).abs() < 1e-5, "{at} {value} {reference}");
            }
        }
    }

    /// Noise has its standard deviation and its autocorrelation, at any time, also where cells were left out.
    #[test]
    fn noise_is_that_of_two_poles() {
        let law = law(0.1, 0.5); // the photoreceptor is twice as fast
        let follower = std::f64::consts::TAU * 300e-6;
        let late: Vec<f64> = vec![1_537.0, 1_600.0, 2_100.0, 9_000.0];
        let count = 40_000;
        let (mut products, mut fourth) = (vec![0.0; late.len()], 0.0);
        for pixel in 0..count {
            let mut path = NoisePath::new(&law, pixel, 0.0);
            let mut noise =
                ShotNoisePath { law: &law, pixel, path: &mut path, elapsed_us: 0.0, reach: 0.0, last: None };
            let values: Vec<f64> = late.iter().map(|&t| noise.at(t, 1.0, &|_| 0.0)).collect();
            products.iter_mut().zip(&values).for_each(|(sum, value)| *sum += values[0] * value);
            fourth += values[3].powi(2);
        }
        for (product, t) in products.into_iter().zip(late) {
            let (a, b) = (2.0 * follower * (t - 1_537.0), follower * (t - 1_537.0));
            let expected = 0.01 / 3.0 * (2.0 * (-b).exp() - (-a).exp());
            let got = product / f64::from(count);
            assert!((got - expected).abs() < 5.0 * 0.01 / 3.0 * 1.5 / f64::from(count).sqrt(), "{t} {got} {expected}");
        }
        assert!((fourth / f64::from(count) * 300.0 - 1.0).abs() < 5.0 * (2.0 / f64::from(count)).sqrt());
    }

    /// In light that changes, it is as large as the light says, once time has passed.
    #[test]
    fn noise_follows_light() {
        let law = law(0.1, 1.0);
        let log_light = |t: f64| if t < 20_000.0 { -3.0 } else { 2.0 };
        let count = 20_000;
        let mut squares = [0.0; 2];
        for pixel in 0..count {
            let mut path = NoisePath::new(&law, pixel, log_light(0.0));
            let mut noise =
                ShotNoisePath { law: &law, pixel, path: &mut path, elapsed_us: 0.0, reach: 0.0, last: None };
            for (square, t) in squares.iter_mut().zip([19_000.0, 40_000.0]) {
                *square += noise.at(t, 1.0, &log_light).powi(2) / f64::from(count);
            }
        }
        for (square, light) in squares.into_iter().zip([f64::exp(-3.0), f64::exp(2.0)]) {
            let expected = 0.01 / (1.0 + light);
            assert!((square / expected - 1.0).abs() < 5.0 * (2.0 / f64::from(count)).sqrt(), "{square} {expected}");
        }
    }
}
