//! [`super::candidates`] for cubics: decides monotone ones that reach one level, and those that stay between their
//! levels.
//!
//! A root found by Newton's steps is only a guess here. It counts where the cubic has clearly reached the level at its
//! tick and clearly not at the tick before, so the search may be as rough as it likes.
//!
//! What must not break: the limits of slopes are those of `Cubic::new`, the error bound covers every rounding, and the
//! loop has neither branches nor calls that are not inlined.

use multiversion::multiversion;

use super::cubic::STEEPEST;
use super::decision::{Decisions, LARGEST_TICK, Lines, References, Verdict, ceiling, integer};
use super::steps::Steps;

/// Slopes, in log intensity over the whole interval, at its start and end.
pub(crate) struct Slopes<'a> {
    pub(crate) from: &'a [f64],
    pub(crate) to: &'a [f64],
}

/// Newton's steps, each within a bracket that it narrows; where they do not suffice, no tick is clear.
const STEPS: usize = 5;

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
pub(crate) fn decide_cubics(
    lines: &Lines<'_>,
    slopes: &Slopes<'_>,
    references: &References<'_>,
    steps: Steps<&[f64]>,
    decisions: Decisions<'_>,
) {
    let n = lines.from.len();
    let (from, to, ticks) = (&lines.from[..n], &lines.to[..n], lines.ticks);
    let (slope_from, slope_to) = (&slopes.from[..n], &slopes.to[..n]);
    let (base, on, off) = (&references.base[..n], &references.on[..n], &references.off[..n]);
    let (c_on, c_off) = (&steps.on[..n], &steps.off[..n]);
    let (tick, verdict, after) = (&mut decisions.tick[..n], &mut decisions.verdict[..n], &mut decisions.after[..n]);
    for j in 0..n {
        let chord = to[j] - from[j];
        // The slopes as `Cubic::new` limits them.
        let finite = (slope_from[j].abs() < f64::INFINITY) & (slope_to[j].abs() < f64::INFINITY);
        #[allow(clippy::manual_clamp, reason = "clamp may panic, and what may panic cannot become vector code")]
        let within = |slope: f64, most: f64| slope.max(-most).min(most);
        let p = within(if finite { slope_from[j] } else { chord }, STEEPEST);
        let q = within(if finite { slope_to[j] } else { chord }, STEEPEST);
        let monotone = p * q >= 0.0;
        let agree = (chord != 0.0) & (p * chord >= 0.0) & (q * chord >= 0.0);
        let most = 3.0 * chord.abs();
        let limited = |slope: f64| if agree { within(slope, most) } else { chord };
        let (p, q) = (if monotone { limited(p) } else { p }, if monotone { limited(q) } else { q });
        let (b, c) = (3.0 * chord - 2.0 * p - q, p + q - 2.0 * chord);
        let at = |s: f64| from[j] + s * (p + s * (b + s * c));

        let (up, down) = (on[j] * c_on[j], off[j] * c_off[j]);
        let reference = base[j] + (up - down);
        // As for lines, and four roundings more of each of the cubic's terms.
        let terms = from[j].abs() + p.abs() + b.abs() + c.abs();
        let error = 8.0 * f64::EPSILON * (base[j].abs() + up + down + c_on[j] + c_off[j] + terms);
        // A cubic lies within the hull of its Bezier points.
        let (first, second) = (from[j] + p * (1.0 / 3.0), to[j] - q * (1.0 / 3.0));
        let highest = from[j].max(to[j]).max(first.max(second));
        let lowest = from[j].min(to[j]).min(first.min(second));
        let nothing = (highest < reference + c_on[j] - error) & (lowest > reference - c_off[j] + error);

        let brighter = to[j] > reference;
        let (sign, step) = if brighter { (1.0, c_on[j]) } else { (-1.0, c_off[j]) };
        let level = reference + sign * step;
        let (mut low, mut high) = (0.0, 1.0);
        let mut s = ((level - from[j]) / chord).clamp(0.0, 1.0);
        for _ in 0..STEPS {
            let missing = level - at(s);
            let before = sign * missing > 0.0;
            low = if before { s } else { low };
            high = if before { high } else { s };
            let next = s + missing / (p + s * (2.0 * b + 3.0 * c * s));
            s = if (next >= low) & (next <= high) { next } else { 0.5 * (low + high) };
        }
        let ceiling = ceiling(s * ticks);
        let one = monotone
            & (sign * (to[j] - level) > error)
            & (sign * (to[j] - (level + sign * step)) < -error)
            & (sign * chord > 0.0)
            & (ceiling >= 1.0)
            & (ceiling <= ticks)
            & (ceiling < LARGEST_TICK)
            // Reached at this tick, not at the one before, both beyond doubt: so it is the tick, however it was found.
            & (sign * (at(ceiling / ticks) - level) > error)
            & (sign * (at((ceiling - 1.0) / ticks) - level) < -error)
            & (error < 1e-10);
        tick[j] = integer(ceiling);
        after[j] = level;
        verdict[j] = Verdict::of(one, brighter, nothing);
    }
}
