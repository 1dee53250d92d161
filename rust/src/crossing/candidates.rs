//! Decides pixels that left their reach, many at a time in vector registers, where there is no doubt: straight lines.
//!
//! Nearly all of these candidates reach exactly one level, clearly, at a moment clearly between two ticks. The loop in
//! [`decide`] computes for each the level, the tick and a bound of the rounding errors. If the bound leaves any doubt,
//! the verdict is `Unclear`, and [`super::pixel`] decides exactly. [`super::cubic_candidates`] does the same for
//! cubics.
//!
//! [`Candidates`] keeps each quantity in an array of its own, padded to whole vectors, because the loops need that to
//! become vector code. It also computes the mark that a pixel has after its event.
//!
//! What must not break:
//! - A verdict other than `Unclear` is what the exact rule says. So the error bounds must cover every rounding. The
//!   tests below compare with the exact rule, also as near to levels and ticks as floats can lie.
//! - The loop in [`decide`] has no branches and no calls that are not inlined, or it is no longer vector code.

use std::marker::PhantomData;

use multiversion::multiversion;

use super::cubic_candidates::{Slopes, decide_cubics};
use super::decision::{Decisions, LARGEST_TICK, Lines, References, Verdict, ceiling, integer};
use super::made::{Grid, Key};
use super::parameters::CrossingParameters;
use super::record::Record;
use super::sample::{Ground, Sample};
use super::scan::{Found, MOST_FOUND};
use super::steps::{StepArrays, Steps};

/// Candidates as arrays.
pub(crate) struct Candidates<S> {
    /// Room for log intensity at the interval's start and end.
    from: Vec<f64>,
    to: Vec<f64>,
    base: Vec<f64>,
    count_on: Vec<f64>,
    count_off: Vec<f64>,
    steps: StepArrays,
    /// Slopes at the interval's start and end, in log intensity over the interval, where curves are cubics.
    pub(crate) slope_from: Vec<f64>,
    pub(crate) slope_to: Vec<f64>,
    /// The tick of the event, where there is one, and the reference that is left behind.
    pub(crate) tick: Vec<i64>,
    pub(crate) verdict: Vec<Verdict>,
    after: Vec<f64>,
    /// The mark of that reference.
    pub(crate) marks: Vec<f32>,
    /// The words of the records, before the event and after it.
    pub(crate) words: Vec<u64>,
    pub(crate) words_after: Vec<u64>,
    /// The events themselves.
    pub(crate) keys: Vec<Key>,
    samples: PhantomData<S>,
}

/// Arrays are worked on in whole vectors: up to the next multiple.
const VECTOR: usize = 8;

impl<S: Sample> Candidates<S> {
    pub(crate) fn new(p: &CrossingParameters) -> Self {
        let length = MOST_FOUND.next_multiple_of(VECTOR);
        let zeros = || vec![0.0; length];
        Self {
            from: zeros(),
            to: zeros(),
            base: zeros(),
            count_on: zeros(),
            count_off: zeros(),
            steps: StepArrays::new(length, p),
            slope_from: zeros(),
            slope_to: zeros(),
            tick: vec![0; length],
            verdict: vec![Verdict::Nothing; length],
            after: zeros(),
            marks: vec![0.0; length],
            words: vec![0; length],
            words_after: vec![0; length],
            keys: vec![Key::default(); length],
            samples: PhantomData,
        }
    }

    /// Decides all candidates that were found, over an interval of `ticks` ticks.
    ///
    /// `records` begin at pixel `first_pixel`. So do `rates`, the rates of change at the interval's ends, if given.
    pub(crate) fn decide<R: Record>(
        &mut self,
        found: &Found<S>,
        records: &[R],
        rates: Option<(&[S], &[S])>,
        first_pixel: usize,
        ticks: i64,
        p: &CrossingParameters,
    ) {
        let places = &found.place[..found.count];
        for ((&place, base), word) in places.iter().zip(&mut self.base).zip(&mut self.words) {
            let record = records[place as usize];
            (*base, *word) = (record.base(), record.word());
        }
        unpack::<R>(&self.words[..found.count], &mut self.count_on, &mut self.count_off);
        self.steps.take(|j| first_pixel + places[j] as usize, found.count, p);
        if let Some(rates) = rates {
            #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
            let seconds = ticks as f64 * 1e-6;
            let slopes = self.slope_from.iter_mut().zip(&mut self.slope_to);
            for ((j, &place), (from, to)) in places.iter().enumerate().zip(slopes) {
                *from = found.from[j].log_rate(rates.0[place as usize], p.log_eps) * seconds;
                *to = found.to[j].log_rate(rates.1[place as usize], p.log_eps) * seconds;
            }
        }
        let n = found.count.next_multiple_of(VECTOR);
        let steps = self.steps.first(n);
        let (from, to) = (&found.from[..n], &found.to[..n]);
        let (from, to) = (S::logs_in(from, p.log_eps, &mut self.from), S::logs_in(to, p.log_eps, &mut self.to));
        #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
        let lines = Lines { from, to, ticks: ticks as f64 };
        let references = References { base: &self.base[..n], on: &self.count_on[..n], off: &self.count_off[..n] };
        let decisions =
            Decisions { tick: &mut self.tick[..n], verdict: &mut self.verdict[..n], after: &mut self.after[..n] };
        if rates.is_some() {
            let slopes = Slopes { from: &self.slope_from[..n], to: &self.slope_to[..n] };
            decide_cubics(&lines, &slopes, &references, steps, decisions);
        } else {
            decide(&lines, &references, steps, decisions);
        }
    }

    /// Computes the events that were decided, and the marks and records after them. `since` is from the zero of times to the
    /// interval's start. Returns whether a record is full, and cannot take its event.
    pub(crate) fn finish<R: Record>(&mut self, found: &Found<S>, grid: Grid, since: i64, ground: Ground) -> bool {
        let n = found.count;
        S::marks(&self.after[..n], ground, &mut self.marks[..n]);
        let decided = Decided { place: &found.place[..n], verdict: &self.verdict[..n], tick: &self.tick[..n] };
        finish::<R>(&decided, grid, since, &self.words[..n], (&mut self.words_after[..n], &mut self.keys[..n]))
    }
}

/// The counters of words, as floats.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn unpack<R: Record>(words: &[u64], on: &mut [f64], off: &mut [f64]) {
    let n = words.len();
    let (on, off) = (&mut on[..n], &mut off[..n]);
    for j in 0..n {
        (on[j], off[j]) = R::counters(words[j]);
    }
}

/// What was decided of the candidates at these places.
struct Decided<'a> {
    place: &'a [u32],
    verdict: &'a [Verdict],
    tick: &'a [i64],
}

/// The events of candidates, and their records' words after them; returns whether a record is full.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn finish<R: Record>(
    decided: &Decided<'_>,
    grid: Grid,
    since: i64,
    words: &[u64],
    (after, keys): (&mut [u64], &mut [Key]),
) -> bool {
    let n = words.len();
    let (place, verdict, tick) = (&decided.place[..n], &decided.verdict[..n], &decided.tick[..n]);
    let (after, keys) = (&mut after[..n], &mut keys[..n]);
    let mut full = false;
    for j in 0..n {
        let on = verdict[j] as u8 == Verdict::On as u8;
        let one = on | (verdict[j] as u8 == Verdict::Off as u8);
        keys[j] = Key::new(tick[j], grid.place(place[j]), on);
        full |= one & R::is_full(words[j], on);
        let stepped = R::stepped(words[j], on, since + tick[j]);
        after[j] = if one { stepped } else { words[j] };
    }
    full
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn decide(lines: &Lines<'_>, references: &References<'_>, steps: Steps<&[f64]>, decisions: Decisions<'_>) {
    let n = lines.from.len();
    let (from, to, ticks) = (&lines.from[..n], &lines.to[..n], lines.ticks);
    let (base, on, off) = (&references.base[..n], &references.on[..n], &references.off[..n]);
    let (c_on, c_off) = (&steps.on[..n], &steps.off[..n]);
    let (tick, verdict, after) = (&mut decisions.tick[..n], &mut decisions.verdict[..n], &mut decisions.after[..n]);
    for j in 0..n {
        let (up, down) = (on[j] * c_on[j], off[j] * c_off[j]);
        let reference = base[j] + (up - down);
        // The reference takes four roundings, the levels one and two more, none of them of anything larger than this.
        let error = 8.0 * f64::EPSILON * (base[j].abs() + up + down + c_on[j] + c_off[j]);
        let brighter = to[j] > reference;
        let (sign, c) = if brighter { (1.0, c_on[j]) } else { (-1.0, c_off[j]) };
        let level = reference + sign * c;
        let past_first = sign * (to[j] - level);
        let past_second = sign * (to[j] - (level + sign * c));
        // What is left of the reference must have a mark within its accuracy, too.
        let accurate = error < 1e-10;
        let nothing = (past_first < -error) & accurate;

        let span = to[j] - from[j];
        let scale = ticks / span;
        let estimate = (level - from[j]) * scale;
        // Both differences, the quotient and the product round by half an ulp each. Where the end is clearly past the
        // level, a stamp that is clear of its ticks lies within the interval.
        let doubt = error * scale.abs() * 1.01 + 4.0 * f64::EPSILON * estimate.abs();
        let ceiling = ceiling(estimate);
        let one = (past_first > error)
            & (past_second < -error)
            & (sign * span > 0.0)
            & (ceiling - estimate > doubt)
            & (estimate - (ceiling - 1.0) > doubt)
            & (1.0..LARGEST_TICK).contains(&ceiling)
            & accurate;
        tick[j] = integer(ceiling);
        after[j] = if one { level } else { reference };
        verdict[j] = Verdict::of(one, brighter, nothing);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::level::{Level, Thresholds};
    use crate::crossing::line::Line;
    use crate::crossing::parameters::{Interpolation, Threshold};
    use crate::crossing::pixel::follow;
    use crate::crossing::record::{NEVER, Wide};
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
        let mut found = Found::new();
        (found.count, found.from[0], found.to[0]) = (1, from, to);
        let record = Wide::of(reference, NEVER);
        candidates.decide(&found, &[record], None, 0, ticks, &parameters);
        (candidates.verdict[0], candidates.tick[0])
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
        let mut found = Found::new();
        (found.count, found.from[0], found.to[0]) = (1, 0.0, 0.3);
        let zero = Wide::of(ZERO, NEVER);
        // Over 7 ticks, slopes of 0 and 3 over the interval.
        candidates.decide(&found, &[zero], Some((&[0.0], &[3.0 / 7e-6])), 0, 7, &parameters);
        assert_eq!((candidates.verdict[0], candidates.tick[0]), (Verdict::On, 7));
        candidates.decide(&found, &[zero], Some((&[3.0 / 7e-6], &[0.0])), 0, 7, &parameters);
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
