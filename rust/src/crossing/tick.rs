//! When a straight line reaches a level: the first microsecond tick at or after the crossing.

use super::level::{Level, Thresholds};

/// One interval between two samples, over which log intensity is linear.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interval {
    /// Log intensity at its start and end.
    pub(crate) from: f64,
    pub(crate) to: f64,
    /// Length in microseconds, in 1..2^53.
    pub(crate) ticks: i64,
}

impl Interval {
    /// The first tick k in 1..=ticks at which the line has reached `level` from below (`up`) or above, exactly.
    ///
    /// The line ends at or beyond the level. A level that was passed before the interval began is reached at its
    /// first tick.
    #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
    #[allow(clippy::cast_possible_truncation, reason = "the fraction lies within 0..=ticks")]
    pub(crate) fn first_tick(&self, level: Level, up: bool, c: Thresholds) -> i64 {
        let span = self.to - self.from;
        let ticks = self.ticks as f64;
        let (value, error) = level.approximate(c);
        let estimate = (value - self.from) / span * ticks;
        // Relative errors: half an ulp each for both differences, the quotient and the product, so 4 eps in all.
        let doubt = (error / span.abs()) * ticks * 1.01 + 4.0 * f64::EPSILON * estimate.abs();
        let candidate = estimate.ceil();
        let clear = candidate - estimate > doubt && estimate - (candidate - 1.0) > doubt;
        if clear && (span > 0.0) == up && candidate >= 1.0 && candidate <= ticks {
            return candidate as i64;
        }
        self.first_tick_exact(level, up, c)
    }

    /// [`Self::first_tick`] by bisection on an exact predicate.
    fn first_tick_exact(&self, level: Level, up: bool, c: Thresholds) -> i64 {
        if self.reached(level, up, c, 0) {
            return 1;
        }
        let (mut before, mut at) = (0, self.ticks);
        while at - before > 1 {
            let middle = before + (at - before) / 2;
            if self.reached(level, up, c, middle) {
                at = middle;
            } else {
                before = middle;
            }
        }
        at
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

    fn on_level(n: u64) -> Level {
        Level { base: 0.0, on: n, off: 0 }
    }

    #[test]
    fn a_crossing_on_a_tick_takes_that_tick() {
        let line = Interval { from: 0.0, to: 1.0, ticks: 1000 };
        assert_eq!(line.first_tick(on_level(1), true, C), 250);
        assert_eq!(line.first_tick(on_level(4), true, C), 1000);
    }

    #[test]
    fn a_crossing_just_after_a_tick_takes_the_next() {
        let line = Interval { from: -1e-16, to: 1.0, ticks: 1000 };
        // (0.25 + 1e-16) / (1 + 1e-16) lies above 0.25 by less than an ulp.
        assert_eq!(line.first_tick(on_level(1), true, C), 251);
        let line = Interval { from: 1e-16, to: 1.0, ticks: 1000 };
        assert_eq!(line.first_tick(on_level(1), true, C), 250);
    }

    #[test]
    fn a_level_passed_before_the_interval_fires_on_its_first_tick() {
        let line = Interval { from: 0.5, to: 1.0, ticks: 1000 };
        assert_eq!(line.first_tick(on_level(1), true, C), 1);
    }

    #[test]
    fn the_quick_path_and_the_exact_one_agree() {
        for ticks in [1, 2, 3, 7, 1000, 999_983, (1 << 53) - 1] {
            for step in 1..40u32 {
                let line = Interval { from: 0.013 * f64::from(step), to: 0.6, ticks };
                assert_eq!(line.first_tick(on_level(2), true, C), line.first_tick_exact(on_level(2), true, C));
            }
        }
    }
}
