//! What the deciders of lines and of cubics share: their input, their output and their arithmetic.
//!
//! [`super::candidates`] decides straight lines and [`super::cubic_candidates`] cubics, both many at a time. Their
//! common types are here so that either can be read without the other.
//!
//! What must not break: [`ceiling`] and [`integer`] use only operations that every vector unit has. A call or a branch
//! would keep the loops around them from becoming vector code.

use super::exponential::ROUND;

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
    pub(crate) fn of(one: bool, brighter: bool, nothing: bool) -> Self {
        let event = if brighter { Self::On } else { Self::Off };
        if one {
            event
        } else if nothing {
            Self::Nothing
        } else {
            Self::Unclear
        }
    }
}

/// 2^50: up to here [`ceiling`] works.
pub(crate) const LARGEST_TICK: f64 = 1_125_899_906_842_624.0;

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

/// Log intensity at the interval's start and end, one of each a candidate, and the interval's length in ticks.
pub(crate) struct Lines<'a> {
    pub(crate) from: &'a [f64],
    pub(crate) to: &'a [f64],
    pub(crate) ticks: f64,
}

/// The references of the candidates: `B`, `n_on` and `n_off` as floats.
pub(crate) struct References<'a> {
    pub(crate) base: &'a [f64],
    pub(crate) on: &'a [f64],
    pub(crate) off: &'a [f64],
}

/// Where the decisions go, one of each a candidate. `tick` means something only where there is one event. `after` is the
/// reference after the interval, within 1e-9, unless that is unclear.
pub(crate) struct Decisions<'a> {
    pub(crate) tick: &'a mut [i64],
    pub(crate) verdict: &'a mut [Verdict],
    pub(crate) after: &'a mut [f64],
}
