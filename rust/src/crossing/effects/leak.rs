//! Leak: the memorised reference drifts down. Each pixel has its own rate, which grows with temperature and light.
//!
//! What leaks in the dark is a function of the time since the first frame, so it does not depend on when frames come.
//! What light adds is a sum over the intervals between samples, each with the mean light of its ends.
//!
//! Jitter is booked at events: how much has leaked since the event before is uncertain by a fraction.
//!
//! What must not break: both parts are straight lines within an interval, because curves and the search for crossings
//! take them as such.

use super::parameters::Leak;
use crate::crossing::level::Thresholds;
use crate::random::{Draw, Purpose};

/// No pixel leaks faster, in Hz.
pub(crate) const FASTEST_HZ: f64 = 1e6;

/// Largest absolute value of a normal draw: that of the least uniform number, 2^-53.
const LARGEST_DRAW: f64 = 8.6;

impl Leak {
    pub(crate) fn is_on(&self) -> bool {
        self.rate_hz > 0.0
    }

    pub(super) fn by_light(&self) -> bool {
        self.is_on() && self.double_luma.is_finite()
    }

    pub(super) fn jitters(&self) -> bool {
        self.is_on() && self.jitter > 0.0
    }

    fn warmth(&self) -> f64 {
        libm::exp2((self.temperature_c - REFERENCE_C) / self.doubling_c)
    }

    /// An upper bound of the rate of any pixel.
    pub(crate) fn most_hz(&self) -> f64 {
        if !self.is_on() {
            0.0
        } else if self.by_light() {
            FASTEST_HZ
        } else {
            let spread = libm::log1p(self.spread * self.spread).sqrt();
            (self.rate_hz * self.warmth() * libm::exp(LARGEST_DRAW * spread)).min(FASTEST_HZ)
        }
    }

    /// How far the reference of a pixel drifts in a microsecond: in the dark, and where luma + `log_eps` is 1 in addition.
    pub(super) fn drifts(&self, seed: u64, pixel: u32, c: Thresholds) -> (f64, f64) {
        let variance = libm::log1p(self.spread * self.spread);
        let factor = if self.spread > 0.0 {
            let normal = Draw::at(seed, Purpose::LeakSpread, pixel, 0).normal();
            libm::exp(variance.sqrt() * normal - 0.5 * variance)
        } else {
            1.0
        };
        let of = |hz: f64| c.on * hz * 1e-6;
        let lit = if self.by_light() { of(self.rate_hz * factor / self.double_luma) } else { 0.0 };
        (of((self.rate_hz * self.warmth() * factor).min(FASTEST_HZ)), lit)
    }
}

/// The temperature at which the rate is `rate_hz`.
const REFERENCE_C: f64 = 25.0;

/// What has leaked of a band's pixels. What belongs to something that is off is empty.
pub(super) struct Leaks {
    /// The drift in the dark, in log intensity per microsecond; zeros if only other effects need it.
    pub(super) dark: Vec<f64>,
    /// The drift that light adds where luma + `log_eps` is 1.
    lit: Vec<f64>,
    /// No light makes it leak faster.
    fastest: Vec<f64>,
    /// What light has added until the last frame, and what it will have until the next one.
    pub(super) leaked: Vec<f64>,
    next: Vec<f64>,
    /// What jitter adds to the reference of a pixel that is held, at the end of its hold.
    pub(super) error: Vec<f64>,
}

impl Leaks {
    /// The leaks of a band's pixels; `needed` if another effect needs them although the leak is off.
    pub(super) fn new(leak: Leak, seed: u64, needed: bool, first: usize, thresholds: &[Thresholds]) -> Self {
        let n = thresholds.len();
        #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
        let drifts = |(i, &c): (usize, &Thresholds)| leak.drifts(seed, (first + i) as u32, c);
        let drifts = || thresholds.iter().enumerate().map(drifts);
        let lit = leak.by_light();
        let zeros = |on: bool| vec![0.0; if on { n } else { 0 }];
        Self {
            dark: if leak.is_on() { drifts().map(|both| both.0).collect() } else { zeros(needed) },
            lit: if lit { drifts().map(|both| both.1).collect() } else { vec![] },
            fastest: if lit { thresholds.iter().map(|c| c.on * FASTEST_HZ * 1e-6).collect() } else { vec![] },
            leaked: zeros(lit),
            next: zeros(lit),
            error: zeros(leak.jitters()),
        }
    }

    /// Straight drift of a pixel over an interval between two log intensities.
    pub(super) fn drift(&self, i: usize, elapsed_us: f64, (from, to): (f64, f64)) -> Drift {
        let dark = self.dark.get(i).copied().unwrap_or_default();
        let Some(&lit) = self.lit.get(i) else { return Drift { dark, elapsed_us, leaked: 0.0, lit: 0.0 } };
        let lit = (lit * 0.5 * (libm::exp(from) + libm::exp(to))).min(self.fastest[i]);
        Drift { dark, elapsed_us, leaked: self.leaked[i], lit }
    }

    /// Notes what light will have leaked at the next frame.
    pub(super) fn note(&mut self, i: usize, drift: &Drift, ticks: f64) {
        if let Some(next) = self.next.get_mut(i) {
            *next = drift.leaked + drift.lit * ticks;
        }
    }

    /// The next frame is the last one now.
    pub(super) fn settle(&mut self) {
        self.leaked.copy_from_slice(&self.next);
    }
}

/// What leaks of a pixel over an interval, in log intensity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drift {
    dark: f64,
    /// Microseconds from the first frame to the interval's start.
    elapsed_us: f64,
    leaked: f64,
    lit: f64,
}

impl Drift {
    /// How far the reference has leaked at a tick of the interval.
    pub(super) fn at(&self, tick: f64) -> f64 {
        self.dark * (self.elapsed_us + tick) + (self.leaked + self.lit * tick)
    }

    /// The drift in log intensity per microsecond.
    pub(super) fn rate(&self) -> f64 {
        self.dark + self.lit
    }
}

/// How much has leaked of a pixel from one of its events to the next: uncertain by a normal fraction.
pub(crate) struct LeakJitter<'a> {
    pub(crate) fraction: f64,
    pub(crate) seed: u64,
    /// Log intensity in a microsecond.
    pub(crate) rate: f64,
    /// Microseconds from the first frame to the interval's start, and to the pixel's last event.
    pub(crate) elapsed_us: i64,
    pub(crate) last_us: i64,
    /// What the reset at the end of a hold will add to the reference.
    pub(crate) error: &'a mut f64,
}

impl LeakJitter<'_> {
    /// Sets the error of the reference after an event at a tick.
    ///
    /// It is a fraction of what has leaked since the event before, and at most half a threshold. Its draw depends on the
    /// time. Two events on one tick need no draws of their own, because nothing leaks between them.
    #[allow(clippy::cast_precision_loss, reason = "times of interest lie below 2^53 us")]
    #[allow(clippy::cast_sign_loss, reason = "events come after the first frame")]
    pub(crate) fn book(&mut self, pixel: u32, c: Thresholds, tick: i64) {
        let at_us = self.elapsed_us + tick;
        let leaked = self.rate * (at_us - self.last_us) as f64;
        self.last_us = at_us;
        let most = 0.5 * c.on.min(c.off);
        let normal =
            if leaked > 0.0 { Draw::at(self.seed, Purpose::LeakJitter, pixel, at_us as u64).normal() } else { 0.0 };
        *self.error = (self.fraction * leaked * normal).clamp(-most, most);
    }
}
