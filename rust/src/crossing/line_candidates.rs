//! Straight lines, as candidates are decided by: see [`super::decision`].
//!
//! The tick is estimated as [`super::line`] does it. It counts if it is farther from any other than its error.
//!
//! What must not break: the error bound covers every rounding. The tests below compare with the exact rule, also as near
//! to levels and ticks as floats can lie.

use super::decision::{Curves, Target, VectorCurve, ceiling};

/// Log intensity at the interval's start and end, one of each a candidate.
pub(crate) struct Lines<'a> {
    pub(crate) from: &'a [f64],
    pub(crate) to: &'a [f64],
}

/// One of them.
#[derive(Clone, Copy)]
pub(crate) struct VectorLine {
    from: f64,
    to: f64,
}

#[allow(clippy::inline_always, reason = "becomes vector code")]
impl Curves for Lines<'_> {
    type Curve = VectorLine;

    #[inline(always)]
    fn count(&self) -> usize {
        self.from.len()
    }

    #[inline(always)]
    fn curve(&self, j: usize) -> VectorLine {
        VectorLine { from: self.from[j], to: self.to[j] }
    }
}

#[allow(clippy::inline_always, reason = "becomes vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
impl VectorCurve for VectorLine {
    #[inline(always)]
    fn change(self) -> f64 {
        self.to - self.from
    }

    #[inline(always)]
    fn end(self) -> f64 {
        self.to
    }

    /// Its end is given, not computed.
    #[inline(always)]
    fn magnitude(self) -> f64 {
        0.0
    }

    /// Whether a level is reached depends on its end alone.
    #[inline(always)]
    fn extent(self) -> (f64, f64) {
        (self.to, self.to)
    }

    #[inline(always)]
    fn first_tick(self, target: Target, error: f64, ticks: f64) -> (f64, bool) {
        let scale = ticks / self.change();
        let estimate = (target.level - self.from) * scale;
        // Both differences, the quotient and the product round by half an ulp each. Where the end is clearly past the
        // level, a stamp that is clear of its ticks lies within the interval.
        let doubt = error * scale.abs() * 1.01 + 4.0 * f64::EPSILON * estimate.abs();
        let ceiling = ceiling(estimate);
        (ceiling, (ceiling - estimate > doubt) & (estimate - (ceiling - 1.0) > doubt))
    }
}

#[cfg(test)]
mod tests {
    use crate::crossing::band_events::{Grid, Key, LONG};
    use crate::crossing::candidates::Candidates;
    use crate::crossing::decision::Verdict;
    use crate::crossing::level::{Level, Thresholds};
    use crate::crossing::line::Line;
    use crate::crossing::parameters::{CrossingParameters, Interpolation, Threshold};
    use crate::crossing::pixel::follow;
    use crate::crossing::record::{NEVER, Narrow, Record, Wide};
    use crate::crossing::registers::{LANES, Registers, Setting};
    use crate::crossing::scan::NotedSamples;
    use crate::event::SensorSize;
    use crate::order::Stamped;
    use proptest::prelude::*;

    const C: Thresholds = Thresholds { on: 0.25, off: 0.5 };

    /// The verdict and tick of one candidate whose reference is `reference`.
    fn decide_one(reference: Level, c: Thresholds, from: f64, to: f64, ticks: i64) -> (Verdict, i64) {
        let parameters = CrossingParameters {
            contrast_threshold: Threshold::Uniform(c.on),
            contrast_threshold_off: Threshold::Uniform(c.off),
            ..CrossingParameters::default()
        };
        let mut candidates = Candidates::<f64>::new(&parameters);
        let mut samples = NotedSamples::new();
        (samples.count, samples.from[0], samples.to[0]) = (1, from, to);
        let record = Wide::of(reference, NEVER);
        candidates.take_inputs(&samples, 0, &parameters);
        candidates.decide(&samples, &[record], None, ticks, &parameters);
        let decided = (candidates.verdict[0], candidates.tick[0]);
        if let (Some(registers), Some(record)) = (Registers::find(), Narrow::new(reference, NEVER, 0))
            && ticks < LONG
        {
            assert_eq!(decide_in_registers(registers, record, &mut candidates, &samples, ticks), decided);
        }
        decided
    }

    /// The same of registers. The tick stays what it is where there is no event.
    fn decide_in_registers(
        registers: Registers,
        record: Narrow,
        candidates: &mut Candidates<f64>,
        samples: &NotedSamples<f64>,
        ticks: i64,
    ) -> (Verdict, i64) {
        let grid = Grid::new(0, SensorSize { width: 1, height: 1 });
        #[allow(clippy::cast_precision_loss, reason = "not long")]
        let setting = Setting { ticks: ticks as f64, since: 1, grid };
        let (mut keys, mut old) = ([Key::default(); 1 + LANES], [0; 1 + LANES]);
        let state = (&mut [record][..], &mut keys[..], &mut old[..]);
        let progress = candidates.carry_out(registers, samples, 0, setting, state).unwrap();
        let event = keys[0].event(0, Key::ADDRESS);
        match (progress.lines, progress.events) {
            (1, 1) => (if event.p == 1 { Verdict::On } else { Verdict::Off }, event.t),
            (1, 0) => (Verdict::Nothing, candidates.tick[0]),
            (0, 0) => (Verdict::Unclear, candidates.tick[0]),
            other => panic!("{other:?}"),
        }
    }

    const ZERO: Level = Level { base: 0.0, on: 0, off: 0 };

    #[test]
    fn one_clear_event_is_decided() {
        assert_eq!(decide_one(ZERO, C, 0.0, 0.3, 1000), (Verdict::On, 834));
        assert_eq!(decide_one(ZERO, C, 0.0, -0.6, 1000), (Verdict::Off, 834));
        assert_eq!(decide_one(ZERO, C, 0.0, 0.2, 1000).0, Verdict::Nothing);
        assert_eq!(decide_one(ZERO, C, 0.0, -0.4, 1000).0, Verdict::Nothing);
        // At the first tick, and at the only one.
        assert_eq!(decide_one(ZERO, C, 0.2499, 0.3, 1000), (Verdict::On, 2));
        assert_eq!(decide_one(ZERO, C, 0.24999, 0.3, 1000), (Verdict::On, 1));
        assert_eq!(decide_one(ZERO, C, 0.0, 0.3, 1), (Verdict::On, 1));
    }

    #[test]
    fn what_is_not_clear_is_left() {
        // Two events; a level hit exactly; a moment on a tick.
        assert_eq!(decide_one(ZERO, C, 0.0, 0.55, 1000).0, Verdict::Unclear);
        assert_eq!(decide_one(ZERO, C, 0.0, 0.25, 1000).0, Verdict::Unclear);
        assert_eq!(decide_one(ZERO, C, 0.0, 0.4, 1000).0, Verdict::Unclear);
    }

    #[test]
    fn a_level_that_was_passed_before_is_left() {
        assert_eq!(decide_one(ZERO, C, 0.4007, 0.3013, 1000).0, Verdict::Unclear);
        assert_eq!(decide_one(ZERO, C, 0.3013, 0.4007, 1000).0, Verdict::Unclear);
        // By less than a tick.
        assert_eq!(decide_one(ZERO, C, 0.2501, 0.4503, 1000).0, Verdict::Unclear);
    }

    #[test]
    fn more_ticks_than_floats_tell_apart_are_left() {
        assert_eq!(decide_one(ZERO, C, 0.0, 0.25 + 1e-9, 1 << 52).0, Verdict::Unclear);
    }

    #[test]
    fn counters_too_large_for_the_bounds_are_left() {
        let c = Thresholds { on: 1000.0, off: 1000.0 };
        let far = Level { base: 0.0, on: 4_000_000_000, off: 4_000_000_000 };
        assert_eq!(decide_one(far, c, 0.0, 1010.3, 1000).0, Verdict::Unclear);
        // Registers take such records, but the levels of these are not accurate enough.
        let many = Level { base: 0.0, on: 60_000, off: 60_000 };
        assert_eq!(decide_one(many, c, 0.0, 1010.3, 1000).0, Verdict::Unclear);
        let near = Level { base: 0.0, on: 4, off: 4 };
        assert_eq!(decide_one(near, c, 0.0, 1010.3, 1000).0, Verdict::On);
    }

    /// The events (tick, ON) of a line by the exact rule.
    fn events_of(mut reference: Level, c: Thresholds, from: f64, to: f64, ticks: i64) -> Vec<(i64, bool)> {
        let mut events = vec![];
        follow(&mut reference, &Line { from, to, ticks }, 0, c, |tick, on| events.push((tick, on)));
        events
    }

    /// The verdict, which the exact rule must not contradict.
    fn checked(reference: Level, c: Thresholds, from: f64, to: f64, ticks: i64) -> Result<Verdict, TestCaseError> {
        let (verdict, tick) = decide_one(reference, c, from, to, ticks);
        let events = events_of(reference, c, from, to, ticks);
        match verdict {
            Verdict::Unclear => {}
            Verdict::Nothing => prop_assert_eq!(events, vec![], "{:?} {:?} {} {} {}", reference, c, from, to, ticks),
            Verdict::On | Verdict::Off => {
                let on = verdict == Verdict::On;
                prop_assert_eq!(events, vec![(tick, on)], "{:?} {:?} {} {} {}", reference, c, from, to, ticks);
            }
        }
        Ok(verdict)
    }

    fn starting_at(base: f64) -> Level {
        Level { base, on: 0, off: 0 }
    }

    /// Rounding of the level, stretched by a slow line over many ticks, is more than that of the quotient.
    #[test]
    fn the_rounding_of_a_level_counts_in_ticks() {
        let c = Thresholds { on: 0.15, off: 0.15 };
        let (from, to) = (-4.571_614_330_777_804, -4.297_635_973_670_371);
        checked(starting_at(from), c, from, to, 1 << 49).unwrap();
    }

    /// The line reaches the level on a tick; its estimate lies just after it.
    #[test]
    fn a_crossing_that_seems_to_lie_just_after_a_tick_is_left() {
        let c = Thresholds { on: 0.25, off: 0.375 };
        let (from, to) = (-3.692_068_864_326_186, -4.192_068_864_326_186_5);
        assert_eq!(checked(starting_at(from), c, from, to, 1000).unwrap(), Verdict::Unclear);
        assert_eq!(events_of(starting_at(from), c, from, to, 1000), [(750, false)]);
    }

    /// The rate at the interval's end is the new frame's, not the last one's.
    #[test]
    fn cubics_take_each_end_s_own_rate() {
        let parameters = CrossingParameters {
            contrast_threshold: Threshold::Uniform(0.25),
            interpolation: Interpolation::Hermite,
            ..CrossingParameters::default()
        };
        let mut candidates = Candidates::<f64>::new(&parameters);
        let mut samples = NotedSamples::new();
        (samples.count, samples.from[0], samples.to[0]) = (1, 0.0, 0.3);
        let zero = Wide::of(ZERO, NEVER);
        // Over 7 ticks, slopes of 0 and 3 over the interval.
        candidates.take_inputs(&samples, 0, &parameters);
        candidates.decide(&samples, &[zero], Some((&[0.0], &[3.0 / 7e-6])), 7, &parameters);
        assert_eq!((candidates.verdict[0], candidates.tick[0]), (Verdict::On, 7));
        candidates.decide(&samples, &[zero], Some((&[3.0 / 7e-6], &[0.0])), 7, &parameters);
        assert_ne!((candidates.verdict[0], candidates.tick[0]), (Verdict::On, 7));
    }

    fn steps() -> impl Strategy<Value = f64> {
        // In thresholds: anywhere, and as near to a level as floats lie.
        prop_oneof![
            3 => -2.5f64..2.5,
            1 => (prop::sample::select(vec![-2.0, -1.0, 1.0, 2.0]), -4i32..=4)
                .prop_map(|(steps, ulps)| steps * (1.0 + 0.5 * f64::EPSILON * f64::from(ulps))),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4_000))]

        #[test]
        fn what_is_decided_is_what_the_exact_rule_says(
            base in prop_oneof![Just(0.0), -7.0f64..2.0],
            counts in (0u32..4, 0u32..4),
            c in prop_oneof![Just((0.25, 0.375)), (0.01f64..0.6, 0.01f64..0.6)],
            start in -0.999f64..0.999,
            steps in steps(),
            ticks in prop_oneof![4 => 1i64..3000, 2 => 1i64..2_000_000, 1 => (1i64 << 40)..(1 << 53)],
        ) {
            let c = Thresholds { on: c.0, off: c.1 };
            let reference = Level { base, on: counts.0, off: counts.1 };
            let centre = reference.value(c);
            let step = |steps: f64| if steps > 0.0 { steps * c.on } else { steps * c.off };
            checked(reference, c, centre + step(start), centre + step(steps), ticks)?;
        }

        /// Crossings on ticks, and as near to one as floats lie: `ticks` and C are such that the line hits them.
        #[test]
        fn crossings_near_ticks_are_decided_alike(
            base in -7.0f64..2.0, at in 1i64..1000, ulps in -3i32..=3, on in any::<bool>(), off in 0.05f64..0.5
        ) {
            let c = Thresholds { on: 0.25, off };
            let step = if on { c.on } else { -c.off };
            #[allow(clippy::cast_precision_loss, reason = "small")]
            let to = base + step * 1000.0 / at as f64;
            let to = to + f64::from(ulps) * to.abs() * f64::EPSILON;
            checked(starting_at(base), c, base, to, 1000)?;
        }
    }
}
