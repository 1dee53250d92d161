//! An excursion of the noise: the time from the event that noise makes until the noise is gone again.
//!
//! Noise takes what the comparators see to a level, which makes an event. The reset memorises the noise together with
//! the signal. Once the noise is gone, the pixel finds the opposite level crossed. So noise events come in pairs of
//! opposite polarity.

/// Noise that is away from zero for a while: a part of what the comparators see, and so of what a reset memorises.
///
/// While it lasts the pixel's reference is kept without it, as the signal is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Excursion {
    /// Microseconds from the interval's start until it is over; not finite where there is none.
    pub(crate) until_us: f64,
    /// The noise in log intensity.
    pub(crate) noise: f64,
    /// 1 where an ON event is awaited when it is over, -1 an OFF event, 0 neither.
    pub(crate) awaits: i8,
}

impl Excursion {
    /// There is none.
    pub(crate) const NONE: Self = Self { until_us: f64::NEG_INFINITY, noise: 0.0, awaits: 0 };

    pub(crate) fn is_on(&self) -> bool {
        self.until_us > f64::NEG_INFINITY
    }

    /// How far an event's level may be from the signal when the excursion is over, as a share of its threshold.
    pub(crate) fn reach(&self, on: bool) -> f64 {
        if self.awaits == polarity(on) { REACH } else { 0.0 }
    }
}

pub(super) fn polarity(on: bool) -> i8 {
    if on { 1 } else { -1 }
}

/// On its way back, noise soon goes this share of a threshold beyond zero, and makes its second event there.
///
/// Noise that has just come as far as a whole threshold is often as far as half of one. What a mismatch of the pixel's
/// two thresholds leaves between its reference and its signal is less.
const REACH: f64 = 0.5;
