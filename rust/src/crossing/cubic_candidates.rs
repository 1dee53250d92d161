//! Cubics, as candidates are decided by: see [`super::decision`].
//!
//! A cubic reaches no level if the hull of its Bezier points lies between the levels. For a monotone one that reaches a
//! level, [`prepare`] finds a likely moment by a few of Halley's steps. The tick after it counts only if the cubic has
//! clearly reached the level there and clearly not at the tick before. So the search may be rough: a poor guess makes the
//! verdict `Unclear`, never wrong. Halley's steps need no bracket: on monotone cubics they find as many ticks as with
//! one. Two loops are faster than one, because a processor works on several turns of a short loop at a time.
//!
//! What must not break:
//! - Slopes are limited exactly as in `Cubic::new`.
//! - The error bound covers every rounding.
//! - The loops have no branches and no calls that are not inlined, or they are no longer vector code.

use multiversion::multiversion;

use super::cubic::STEEPEST;
use super::decision::{Curves, References, Target, VectorCurve, ceiling, reference};
use super::record::Record;
use super::steps::Steps;

/// Log intensity at the interval's start and end, one of each a candidate.
#[derive(Clone, Copy)]
pub(crate) struct Ends<'a> {
    pub(crate) from: &'a [f64],
    pub(crate) to: &'a [f64],
}

/// Slopes in log intensity over the whole interval, at its start and end, and where cubics are likely to reach their
/// level: a fraction of the interval.
pub(crate) struct Preparation<'a> {
    pub(crate) slope_from: &'a mut [f64],
    pub(crate) slope_to: &'a mut [f64],
    pub(crate) likely: &'a mut [f64],
}

/// Halley's steps; where they do not suffice, no tick is clear.
const STEPS: usize = 3;

/// Limits slopes as `Cubic::new` does, and finds where cubics are likely to reach their level.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
#[allow(clippy::manual_clamp, reason = "clamp may panic, and what may panic cannot become vector code")]
pub(crate) fn prepare<R: Record>(
    ends: Ends<'_>,
    references: &References<'_>,
    steps: Steps<&[f64]>,
    preparation: Preparation<'_>,
) {
    let n = ends.from.len();
    let (from, to) = (&ends.from[..n], &ends.to[..n]);
    let (base, words) = (&references.base[..n], &references.words[..n]);
    let (c_on, c_off) = (&steps.on[..n], &steps.off[..n]);
    let Preparation { slope_from, slope_to, likely } = preparation;
    let (slope_from, slope_to, likely) = (&mut slope_from[..n], &mut slope_to[..n], &mut likely[..n]);
    for j in 0..n {
        let chord = to[j] - from[j];
        let finite = (slope_from[j].abs() < f64::INFINITY) & (slope_to[j].abs() < f64::INFINITY);
        let within = |slope: f64, most: f64| slope.max(-most).min(most);
        let p = within(if finite { slope_from[j] } else { chord }, STEEPEST);
        let q = within(if finite { slope_to[j] } else { chord }, STEEPEST);
        let monotone = p * q >= 0.0;
        let sign = 1.0f64.copysign(chord);
        let agree = (chord != 0.0) & (p * sign >= 0.0) & (q * sign >= 0.0);
        let most = 3.0 * chord.abs();
        let limited = |slope: f64| if agree { within(slope, most) } else { chord };
        let (p, q) = (if monotone { limited(p) } else { p }, if monotone { limited(q) } else { q });
        (slope_from[j], slope_to[j]) = (p, q);

        let c = (c_on[j], c_off[j]);
        let (reference, _) = reference::<R>(base[j], words[j], c);
        let target = Target::new(reference, to[j], c);
        let cubic = VectorCubic::new(from[j], to[j], p, q);
        let mut s = ((target.level - from[j]) / chord).max(0.0).min(1.0);
        for _ in 0..STEPS {
            let missing = target.level - cubic.at(s);
            let bend = cubic.b + 3.0 * cubic.c * s;
            let slope = p + s * (bend + cubic.b);
            s = (s + missing * slope / (slope * slope + missing * bend)).max(0.0).min(1.0);
        }
        likely[j] = s;
    }
}

/// Prepared cubics, one a candidate.
pub(crate) struct Cubics<'a> {
    pub(crate) ends: Ends<'a>,
    pub(crate) slope_from: &'a [f64],
    pub(crate) slope_to: &'a [f64],
    pub(crate) likely: &'a [f64],
}

#[allow(clippy::inline_always, reason = "becomes vector code")]
impl Curves for Cubics<'_> {
    type Curve = PreparedCubic;

    #[inline(always)]
    fn count(&self) -> usize {
        self.likely.len()
    }

    #[inline(always)]
    fn curve(&self, j: usize) -> PreparedCubic {
        let cubic = VectorCubic::new(self.ends.from[j], self.ends.to[j], self.slope_from[j], self.slope_to[j]);
        PreparedCubic { cubic, likely: self.likely[j] }
    }
}

/// L(s) = from + s (p + s (b + s c)), s from 0 to 1 over the interval; it ends at `to` with the slope `q`.
#[derive(Clone, Copy)]
struct VectorCubic {
    from: f64,
    to: f64,
    p: f64,
    q: f64,
    b: f64,
    c: f64,
}

#[allow(clippy::inline_always, reason = "becomes vector code")]
impl VectorCubic {
    /// The operations are those of `Cubic::new`.
    #[inline(always)]
    fn new(from: f64, to: f64, p: f64, q: f64) -> Self {
        let chord = to - from;
        Self { from, to, p, q, b: 3.0 * chord - 2.0 * p - q, c: p + q - 2.0 * chord }
    }

    #[inline(always)]
    fn at(self, s: f64) -> f64 {
        self.from + s * (self.p + s * (self.b + s * self.c))
    }
}

/// A cubic, and where it is likely to reach its level.
#[derive(Clone, Copy)]
pub(crate) struct PreparedCubic {
    cubic: VectorCubic,
    likely: f64,
}

#[allow(clippy::inline_always, reason = "becomes vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
impl VectorCurve for PreparedCubic {
    #[inline(always)]
    fn change(self) -> f64 {
        self.cubic.to - self.cubic.from
    }

    #[inline(always)]
    fn end(self) -> f64 {
        self.cubic.to
    }

    /// Each of its terms takes a few roundings.
    #[inline(always)]
    fn magnitude(self) -> f64 {
        let VectorCubic { from, p, b, c, .. } = self.cubic;
        from.abs() + p.abs() + b.abs() + c.abs()
    }

    /// The hull of its Bezier points.
    #[inline(always)]
    fn extent(self) -> (f64, f64) {
        let VectorCubic { from, to, p, q, .. } = self.cubic;
        let (first, second) = (from + p * (1.0 / 3.0), to - q * (1.0 / 3.0));
        (from.min(to).min(first.min(second)), from.max(to).max(first.max(second)))
    }

    #[inline(always)]
    fn first_tick(self, target: Target, error: f64, ticks: f64) -> (f64, bool) {
        let Target { level, sign, .. } = target;
        let VectorCubic { p, q, .. } = self.cubic;
        let ceiling = ceiling(self.likely * ticks);
        // Reached at this tick, not at the one before, both beyond doubt: so it is the tick, however it was found.
        let clear = (p * q >= 0.0)
            & (ceiling <= ticks)
            & (sign * (self.cubic.at(ceiling / ticks) - level) > error)
            & (sign * (self.cubic.at((ceiling - 1.0) / ticks) - level) < -error);
        (ceiling, clear)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::cubic::Cubic;
    use crate::crossing::decision::{Decisions, Verdict, decide};
    use crate::crossing::level::{Level, Thresholds};
    use crate::crossing::line::Line;
    use crate::crossing::pixel::follow;
    use crate::crossing::record::{NEVER, Wide};
    use proptest::prelude::*;

    const C: Thresholds = Thresholds { on: 0.25, off: 0.375 };
    const MILLION: i64 = 1_000_000;

    /// A cubic by its values and slopes (over the interval) at both ends.
    type Knots = [f64; 4];

    fn verdict_of([from, to, p, q]: Knots, reference: Level, c: Thresholds, ticks: i64) -> (Verdict, i64) {
        let ends = Ends { from: &[from], to: &[to] };
        let words = [Wide::of(reference, NEVER).word()];
        let references = References { base: &[reference.base], words: &words };
        let steps = Steps { on: &[c.on][..], off: &[c.off] };
        let (mut slope_from, mut slope_to, mut likely) = ([p], [q], [0.0]);
        let preparation = Preparation { slope_from: &mut slope_from, slope_to: &mut slope_to, likely: &mut likely };
        prepare::<Wide>(ends, &references, steps, preparation);
        let cubics = Cubics { ends, slope_from: &slope_from, slope_to: &slope_to, likely: &likely };
        let (mut tick, mut verdict, mut after) = ([0], [Verdict::Unclear], [0.0]);
        let decisions = Decisions { tick: &mut tick, verdict: &mut verdict, after: &mut after };
        #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
        decide::<_, Wide>(&cubics, &references, steps, ticks as f64, decisions);
        (verdict[0], tick[0])
    }

    /// The events (tick, ON) by the exact rule.
    fn events_of([from, to, p, q]: Knots, mut reference: Level, c: Thresholds, ticks: i64) -> Vec<(i64, bool)> {
        let mut events = vec![];
        let curve = Cubic::new(Line { from, to, ticks }, p, q);
        follow(&mut reference, &curve, 0, c, |tick, on| events.push((tick, on)));
        events
    }

    /// The verdict, which the exact rule must not contradict.
    fn checked(knots: Knots, reference: Level, ticks: i64) -> Result<Verdict, TestCaseError> {
        checked_with(knots, reference, C, ticks)
    }

    fn checked_with(knots: Knots, reference: Level, c: Thresholds, ticks: i64) -> Result<Verdict, TestCaseError> {
        let (verdict, tick) = verdict_of(knots, reference, c, ticks);
        let events = events_of(knots, reference, c, ticks);
        match verdict {
            Verdict::Unclear => {}
            Verdict::Nothing => prop_assert_eq!(events, vec![], "{:?} {:?} {}", knots, reference, ticks),
            Verdict::On | Verdict::Off => {
                prop_assert_eq!(events, vec![(tick, verdict == Verdict::On)], "{:?} {:?} {}", knots, reference, ticks);
            }
        }
        Ok(verdict)
    }

    fn starting_at(base: f64) -> Level {
        Level { base, on: 0, off: 0 }
    }

    /// Curves for each of which one part of the decision is what keeps it right.
    #[test]
    fn hard_curves_are_decided_as_the_exact_rule_does() {
        let infinite = f64::INFINITY;
        let curves: [(&str, Knots, Verdict); 23] = [
            ("one slope is not finite", [0.0, 0.3, infinite, 0.2], Verdict::On),
            ("nor the other", [0.0, 0.3, 0.2, -infinite], Verdict::On),
            ("a number is missing", [0.0, -0.41, f64::NAN, -0.2], Verdict::Off),
            ("slopes differ", [0.1, 0.5, 6.0, 1.0], Verdict::On),
            ("it starts and ends flat", [0.0, 0.3, 0.0, 0.0], Verdict::On),
            ("it falls and ends flat", [0.0, -0.6, -1.0, 0.0], Verdict::Off),
            ("it starts flat and falls", [0.0, -0.6, 0.0, -1.0], Verdict::Off),
            ("the search stops some ticks too late", [0.0, 0.28, 0.756, 0.0], Verdict::Unclear),
            ("the search stops some ticks too early", [0.0, 0.43, 1.29, 0.86], Verdict::Unclear),
            ("a slope against the samples, too small for a product", [0.0, 0.3, -5e-324, 0.4], Verdict::On),
            ("the other one", [0.0, -0.47, -0.4, 5e-324], Verdict::Off),
            ("it rises past a level and comes back, at its end", [0.0, 0.1, 0.1, -3.0], Verdict::Unclear),
            ("it falls past a level and comes back, at its start", [0.0, 0.0, -6.0, 0.3], Verdict::Unclear),
            ("it rises past a level and comes back, at its start", [0.0, 0.0, 6.0, -0.3], Verdict::Unclear),
            ("it falls past a level and comes back, at its end", [0.0, -0.1, -0.1, 3.0], Verdict::Unclear),
            ("it ends on the level above", [0.0, 0.25, 0.0, 2.0], Verdict::Unclear),
            ("it ends on the level below", [0.0, -0.375, 0.0, 0.0], Verdict::Unclear),
            ("it turns just above a level", [0.0, 0.239, 0.96, -0.02], Verdict::Unclear),
            ("its mirror image in time", [0.239, 0.0, 0.02, -0.96], Verdict::Unclear),
            ("it stays between the levels", [0.0, 0.1, 0.2, -0.2], Verdict::Nothing),
            ("its hull stays between them, at its start", [0.0, 0.1, 0.6, -0.2], Verdict::Nothing),
            ("its hull stays between them, at its end", [0.0, 0.0, 0.1, -0.6], Verdict::Nothing),
            ("it stays between them, downwards", [0.0, -0.2, -0.1, 0.1], Verdict::Nothing),
        ];
        for (name, knots, expected) in curves {
            let reference = starting_at(if name.contains("mirror") { 0.0 } else { knots[0] });
            assert_eq!(checked(knots, reference, MILLION).unwrap(), expected, "{name}");
        }
    }

    /// Ticks next to the one that a root lies on, found to be wrong by a search that trusts its own steps.
    #[test]
    fn a_tick_is_taken_only_where_the_curve_has_reached_the_level() {
        let curve = [0.0, 0.3, 0.9, 0.1];
        assert_eq!(events_of(curve, starting_at(0.0), C, MILLION), [(500_001, true)]);
        checked(curve, starting_at(0.0), MILLION).unwrap();
    }

    /// Slopes beyond belief are cut before they are limited to three times the chord's, which matters where that is steeper.
    #[test]
    fn slopes_are_cut_to_the_steepest() {
        let c = Thresholds { on: 400.0, off: 400.0 };
        for (p, q) in [(2000.0, 10.0), (10.0, 2000.0)] {
            for sign in [1.0, -1.0] {
                let knots = [-250.0 * sign, 250.0 * sign, p * sign, q * sign];
                let verdict = checked_with(knots, starting_at(knots[0]), c, MILLION).unwrap();
                assert!(matches!(verdict, Verdict::On | Verdict::Off));
            }
        }
    }

    /// Log intensity ends within 1.5 thresholds of where it began: at most one level is reached where it does not turn.
    fn single_crossings() -> impl Strategy<Value = Knots> {
        let slope = || {
            prop_oneof![
                6 => -4.0f64..4.0,
                2 => -0.1f64..0.1,
                1 => -2000.0f64..2000.0,
                1 => prop::sample::select(vec![0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN]),
            ]
        };
        let to = prop_oneof![
            6 => (-1.5f64..1.5).prop_map(|steps| if steps > 0.0 { steps * C.on } else { steps * C.off }),
            // On a level, and as near to one as floats lie.
            2 => (prop::sample::select(vec![C.on, -C.off]), -4i32..=4)
                .prop_map(|(level, ulps)| level * (1.0 + f64::from(ulps) * 0.5 * f64::EPSILON)),
            1 => Just(0.0),
        ];
        (to, slope(), slope()).prop_map(|(to, p, q)| [0.0, to, p, q])
    }

    /// Curves that turn as near to a level as `off` says.
    fn turns_near_a_level() -> impl Strategy<Value = Knots> {
        let off = prop_oneof![-1e-3f64..1e-3, -1e-12f64..1e-12, -1e-15f64..1e-15];
        (-0.3f64..0.2, 0.05f64..0.95, any::<bool>(), off).prop_map(|(to, at, up, off)| {
            // Of all cubics from 0 to `to` that turn at the fraction `at`, the one whose value there is the level's.
            let level = (if up { C.on } else { -C.off }) + off;
            // level = p h10 + q h11 + to h01 there, and the derivative is 0: two equations for p and q.
            let (s, s2, s3) = (at, at * at, at * at * at);
            let (h01, h10, h11) = (3.0 * s2 - 2.0 * s3, s3 - 2.0 * s2 + s, s3 - s2);
            let (d01, d10, d11) = (6.0 * s - 6.0 * s2, 3.0 * s2 - 4.0 * s + 1.0, 3.0 * s2 - 2.0 * s);
            let (value, slope) = (level - to * h01, -to * d01);
            let determinant = h10 * d11 - h11 * d10;
            [0.0, to, (value * d11 - h11 * slope) / determinant, (h10 * slope - value * d10) / determinant]
        })
    }

    fn lengths() -> impl Strategy<Value = i64> {
        prop_oneof![4 => 1i64..2_000_000, 2 => 1i64..20, 1 => (1i64 << 40)..(1 << 53)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4_000))]

        #[test]
        fn single_crossings_are_decided_as_the_exact_rule_does(
            knots in single_crossings(), shift in prop_oneof![Just(0.0), -30.0f64..30.0], counts in (0u32..4, 0u32..4), ticks in lengths()
        ) {
            let reference = Level { base: shift, on: counts.0, off: counts.1 };
            let [from, to, p, q] = knots;
            let start = shift + f64::from(counts.0) * C.on - f64::from(counts.1) * C.off;
            checked([start + from, start + to, p, q], reference, ticks)?;
        }

        /// Within a step of the reference, as pixels really are, rather than on it.
        #[test]
        fn starts_between_levels_are_decided_alike(knots in single_crossings(), fraction in -0.999f64..0.999, ticks in lengths()) {
            let off_centre = if fraction > 0.0 { fraction * C.on } else { fraction * C.off };
            let [from, to, p, q] = knots;
            checked([from + off_centre, to, p, q], starting_at(0.0), ticks)?;
        }

        #[test]
        fn curves_that_turn_near_a_level_are_decided_alike(knots in turns_near_a_level(), ticks in lengths()) {
            checked(knots, starting_at(0.0), ticks)?;
        }

        /// Levels of many steps round by more than an ulp of their own: what ends as near to them as that is in doubt.
        #[test]
        fn ends_within_the_rounding_of_a_level_are_decided_alike(
            base in -7.0f64..2.0, counts in (0u32..30_000, 0u32..30_000), c in (0.05f64..0.4, 0.05f64..0.4),
            on in any::<bool>(), ulps in -30i32..=30, p in 0.0f64..2.0, q in 0.0f64..2.0
        ) {
            let c = Thresholds { on: c.0, off: c.1 };
            let reference = Level { base, on: counts.0, off: counts.1 };
            let level = if on { reference.up() } else { reference.down() };
            let ulp = f64::EPSILON * (f64::from(counts.0) * c.on + f64::from(counts.1) * c.off);
            let (from, to) = (reference.exact(c).value(), level.exact(c).value() + 0.1 * ulp * f64::from(ulps));
            checked_with([from, to, p * (to - from), q * (to - from)], reference, c, 1000)?;
        }

        /// What is far from any doubt is decided here: the exact way is for the few.
        #[test]
        fn what_is_clear_is_not_left(fraction in 0.3f64..0.9, on in any::<bool>(), p in 0.5f64..1.5, q in 0.5f64..1.5, offset in 200i64..800) {
            let to = if on { C.on } else { -C.off } * (1.0 + fraction);
            let verdict = checked([0.0, to, p * to, q * to], starting_at(0.0), MILLION + offset)?;
            let event = if on { Verdict::On } else { Verdict::Off };
            prop_assert!(verdict == event || verdict == Verdict::Unclear);
            let verdict = checked([0.0, to * 0.3, p * to * 0.3, q * to * 0.3], starting_at(0.0), MILLION)?;
            prop_assert_eq!(verdict, Verdict::Nothing);
        }
    }
}
