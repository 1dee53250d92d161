//! Linear interpolation: the first microsecond tick at or after a straight line reaches a level.
//!
//! The tick is first estimated in floats. If the estimate is farther from any tick than its error, it decides.
//! Otherwise exact arithmetic decides: at the line's ends, then at the likely tick, then by bisection over all ticks.
//!
//! What must not break: on both ways the tick is that of real arithmetic on the given samples. [`super::line_candidates`]
//! makes the same estimate in vector code, with the same terms in its error. Look at both when one changes.

use std::iter;

use super::curve::{Curve, Piece, Timed, first_true};
use super::level::{Level, Thresholds};

/// Log intensity that runs straight from one sample to the next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    /// Log intensity at its start and end.
    pub(crate) from: f64,
    pub(crate) to: f64,
    /// Length in microseconds, in 1..2^53.
    pub(crate) ticks: i64,
}

impl Curve for Line {
    type Piece = Self;

    fn pieces(&self) -> impl Iterator<Item = Self> {
        iter::once(*self)
    }
}

impl Piece for Line {
    fn end(&self) -> f64 {
        self.to
    }

    /// Estimated in floats, and decided exactly where the estimate comes near a tick.
    #[inline]
    #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
    #[allow(clippy::cast_possible_truncation, reason = "checked to lie within 1..=ticks")]
    fn first_tick(&self, level: Level, up: bool, c: Thresholds) -> i64 {
        let span = self.to - self.from;
        let ticks = self.ticks as f64;
        let (value, error) = level.approximate(c);
        let estimate = (value - self.from) / span * ticks;
        // Both differences, the quotient and the product round by half an ulp each.
        let doubt = (error / span.abs()) * ticks * 1.01 + 4.0 * f64::EPSILON * estimate.abs();
        let candidate = estimate.ceil();
        let clear = candidate - estimate > doubt && estimate - (candidate - 1.0) > doubt;
        if clear && (span > 0.0) == up && candidate >= 1.0 && candidate <= ticks {
            return candidate as i64;
        }
        self.first_tick_exact(level, up, c, candidate.clamp(1.0, ticks) as i64)
    }
}

#[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
impl Timed for Line {
    fn finish(&self) -> f64 {
        self.ticks as f64
    }

    fn value(&self, at: f64) -> f64 {
        self.from + (self.to - self.from) * (at / self.ticks as f64)
    }

    fn moment(&self, level: Level, _: bool, c: Thresholds) -> f64 {
        let fraction = (level.approximate(c).0 - self.from) / (self.to - self.from);
        // A level that was passed before the interval began may leave no fraction at all.
        if fraction.is_finite() { fraction.clamp(0.0, 1.0) * self.ticks as f64 } else { 0.0 }
    }
}

impl Line {
    /// [`Piece::first_tick`] by exact predicates: the ends, then the likely tick, else bisection.
    #[cold]
    fn first_tick_exact(&self, level: Level, up: bool, c: Thresholds, likely: i64) -> i64 {
        let sign_at_start = level.sign_of_excess(self.from, c);
        if if up { sign_at_start >= 0 } else { sign_at_start <= 0 } {
            return 1;
        }
        if level.sign_of_excess(self.to, c) == 0 {
            return self.ticks;
        }
        let reached = |k| self.reached(level, up, c, k);
        if likely >= 1 && !reached(likely - 1) && (likely == self.ticks || reached(likely)) {
            return likely;
        }
        first_true(0, self.ticks, reached)
    }

    /// Has the line reached the level at tick `k`? By the exact sign of `(level - from) ticks - k (to - from)`.
    #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
    fn reached(&self, level: Level, up: bool, c: Thresholds, k: i64) -> bool {
        let missing = level
            .exact(c)
            .plus(-self.from)
            .times(self.ticks as f64)
            .plus_product(-(k as f64), self.to)
            .plus_product(k as f64, self.from);
        if up { missing.sign() <= 0 } else { missing.sign() >= 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const C: Thresholds = Thresholds { on: 0.25, off: 0.25 };

    fn on_level(n: u32) -> Level {
        Level { base: 0.0, on: n, off: 0 }
    }

    #[test]
    fn a_crossing_on_a_tick_takes_that_tick() {
        let line = Line { from: 0.0, to: 1.0, ticks: 1000 };
        assert_eq!(line.first_tick(on_level(1), true, C), 250);
        assert_eq!(line.first_tick(on_level(4), true, C), 1000);
    }

    #[test]
    fn a_crossing_just_after_a_tick_takes_the_next() {
        let line = Line { from: -1e-16, to: 1.0, ticks: 1000 };
        // (0.25 + 1e-16) / (1 + 1e-16) lies above 0.25 by less than an ulp.
        assert_eq!(line.first_tick(on_level(1), true, C), 251);
        let line = Line { from: 1e-16, to: 1.0, ticks: 1000 };
        assert_eq!(line.first_tick(on_level(1), true, C), 250);
    }

    #[test]
    fn a_level_passed_before_the_interval_fires_on_its_first_tick() {
        for to in [1.0, 0.5, 0.3] {
            let line = Line { from: 0.5, to, ticks: 1000 };
            assert_eq!(line.first_tick(on_level(1), true, C), 1);
        }
    }

    #[test]
    fn the_quick_path_and_the_exact_one_agree() {
        for ticks in [1, 2, 3, 7, 1000, 999_983, (1 << 53) - 1] {
            for step in 1..40u32 {
                let line = Line { from: 0.013 * f64::from(step), to: 0.6, ticks };
                assert_eq!(line.first_tick(on_level(2), true, C), line.first_tick_exact(on_level(2), true, C, 0));
            }
        }
    }
}
