//! Decides candidates, many at a time in vector registers, where there is no doubt.
//!
//! Nearly all candidates reach exactly one level, clearly, at a moment clearly between two ticks. The loop in [`decide`]
//! computes for each the level, and asks its curve for the tick. It also computes a bound of the rounding errors. If the
//! bound leaves any doubt, the verdict is `Unclear`, and [`super::pixel`] decides exactly.
//!
//! What lines and cubics have in common is here: where the levels lie, and what is clear. What they differ in is their
//! [`VectorCurve`]: [`super::line_candidates`] and [`super::cubic_candidates`].
//!
//! What must not break:
//! - A verdict other than `Unclear` is what the exact rule says. So the error bounds must cover every rounding.
//! - The loop has no branches and no calls that are not inlined, or it is no longer vector code. [`ceiling`] and
//!   [`integer`] use only operations that every vector unit has.

use multiversion::multiversion;

use super::exponential::ROUND;
use super::record::Record;
use super::steps::Steps;

/// What a candidate turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Verdict {
    /// Left its reach, which is drawn inward, without reaching a level.
    Nothing,
    /// One OFF event.
    Off,
    /// One ON event.
    On,
    /// Several events, or too close to call.
    Unclear,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Verdict {
    /// One event, none, or neither beyond doubt.
    #[inline(always)]
    fn new(single: bool, brighter: bool, nothing: bool) -> Self {
        let event = if brighter { Self::On } else { Self::Off };
        if single {
            event
        } else if nothing {
            Self::Nothing
        } else {
            Self::Unclear
        }
    }
}

/// The curves of many candidates.
pub(crate) trait Curves {
    /// The curve of one of them.
    type Curve: VectorCurve;

    /// How many there are.
    fn count(&self) -> usize;

    /// The curve of a candidate, by its number.
    fn curve(&self, j: usize) -> Self::Curve;
}

/// The log intensity of a candidate over the interval, as [`decide`] asks for it.
pub(crate) trait VectorCurve: Copy {
    /// Log intensity at the interval's end, less that at its start.
    fn change(self) -> f64;

    /// Log intensity at the interval's end.
    fn end(self) -> f64;

    /// A sum of the magnitudes of all that is added up to compute a value, beyond that of the levels.
    fn magnitude(self) -> f64;

    /// What it surely does not leave: the lowest and the highest value that count.
    fn extent(self) -> (f64, f64);

    /// The tick, a whole number, at which it is the first time at the level or beyond, over an interval of `ticks` ticks;
    /// and whether that is beyond doubt, where its end is clearly beyond the level. The level is off by less than `error`.
    fn first_tick(self, target: Target, error: f64, ticks: f64) -> (f64, bool);
}

/// The level that a candidate may reach: the one above its reference if it ends above that, else the one below.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    pub(crate) level: f64,
    /// 1 where it is reached from below, else -1.
    pub(crate) sign: f64,
    /// From level to level.
    step: f64,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Target {
    #[inline(always)]
    pub(crate) fn new(reference: f64, end: f64, (c_on, c_off): (f64, f64)) -> Self {
        let (sign, step) = if end > reference { (1.0, c_on) } else { (-1.0, c_off) };
        Self { level: reference + sign * step, sign, step }
    }
}

/// Returns a candidate's reference, and a sum of the magnitudes of all that is added up for it.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn reference<R: Record>(base: f64, word: u64, (c_on, c_off): (f64, f64)) -> (f64, f64) {
    let (on, off) = R::counters(word);
    let (up, down) = (on * c_on, off * c_off);
    (base + (up - down), base.abs() + up + down)
}

/// The references of the candidates: `B`, and the words that hold their counters.
pub(crate) struct References<'a> {
    pub(crate) base: &'a [f64],
    pub(crate) words: &'a [u64],
}

/// Where the decisions go, one of each a candidate. `tick` means something only where there is one event. `after` is the
/// reference after the interval, within 1e-9, unless that is unclear.
pub(crate) struct Decisions<'a> {
    pub(crate) tick: &'a mut [i64],
    pub(crate) verdict: &'a mut [Verdict],
    pub(crate) after: &'a mut [f64],
}

/// Decides all candidates, over an interval of `ticks` ticks.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
pub(crate) fn decide<C: Curves, R: Record>(
    curves: &C,
    references: &References<'_>,
    steps: Steps<&[f64]>,
    ticks: f64,
    decisions: Decisions<'_>,
) {
    let n = curves.count();
    let (base, words) = (&references.base[..n], &references.words[..n]);
    let (c_on, c_off) = (&steps.on[..n], &steps.off[..n]);
    let (tick, verdict, after) = (&mut decisions.tick[..n], &mut decisions.verdict[..n], &mut decisions.after[..n]);
    for j in 0..n {
        let curve = curves.curve(j);
        let c = (c_on[j], c_off[j]);
        let (reference, magnitude) = reference::<R>(base[j], words[j], c);
        // The reference takes four roundings, the levels one and two more, none of them of anything larger than this. A
        // curve's magnitude is chosen for its own.
        let error = 8.0 * f64::EPSILON * (magnitude + c.0 + c.1 + curve.magnitude());
        // What is left of the reference must have a mark within its accuracy, too.
        let accurate = error < 1e-10;
        let (lowest, highest) = curve.extent();
        let nothing = (highest < reference + c.0 - error) & (lowest > reference - c.1 + error) & accurate;

        let end = curve.end();
        let target = Target::new(reference, end, c);
        let Target { level, sign, step } = target;
        let (first_tick, clear) = curve.first_tick(target, error, ticks);
        let single = (sign * (end - level) > error)
            & (sign * (end - (level + sign * step)) < -error)
            & (sign * curve.change() > 0.0)
            & (1.0..LARGEST_TICK).contains(&first_tick)
            & clear
            & accurate;
        tick[j] = integer(first_tick);
        after[j] = if single { level } else { reference };
        verdict[j] = Verdict::new(single, sign > 0.0, nothing);
    }
}

/// 2^50: up to here [`ceiling`] works.
const LARGEST_TICK: f64 = 1_125_899_906_842_624.0;

/// The least whole number that is not smaller, in operations that every vector unit has.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn ceiling(x: f64) -> f64 {
    let nearest = (x + ROUND) - ROUND;
    nearest + if nearest < x { 1.0 } else { 0.0 }
}

/// A whole number to an integer, by way of the bits of 2^52 + it: vector units lack the conversion.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn integer(whole: f64) -> i64 {
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    (whole + TWO_52).to_bits().wrapping_sub(TWO_52.to_bits()).cast_signed()
}
