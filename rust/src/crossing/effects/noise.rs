//! Noise events: arrivals of Poisson processes, each a function of (seed, purpose, pixel, number of the arrival).
//!
//! Arrivals are drawn at the rate in the dark and kept with a probability that falls with the light at their instant.
//! So they do not depend on how the signal is sampled in time, which must not break.
//!
//! An arrival of shot noise begins an [`Excursion`]: noise takes what the comparators see to a level, which makes an event,
//! and the reset memorises the noise with the signal. Once the noise is gone, the pixel finds the opposite level crossed.

use super::parameters::{Effects, ShotNoise};
use crate::log_intensity::ln;
use crate::random::{Draw, Purpose};

/// Where a pixel's process stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrivals {
    /// Microseconds from the interval's start to the next arrival.
    pub(crate) wait_us: f64,
    /// Its number.
    pub(crate) index: u64,
}

/// Noise that is away from zero for a while: a part of what the comparators see, and so of what a reset memorises.
///
/// While it lasts the pixel's reference is kept without it, as the signal is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Excursion {
    /// Microseconds from the interval's start until it is over; not finite where there is none.
    pub(crate) until_us: f64,
    /// In log intensity.
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

fn polarity(on: bool) -> i8 {
    if on { 1 } else { -1 }
}

/// On its way back noise soon gets as far beyond zero as this share of a threshold, and makes its second event there.
///
/// Noise that has just come as far as a whole threshold is often as far as half of one. What a mismatch of the pixel's
/// two thresholds leaves between its reference and its signal is less.
const REACH: f64 = 0.5;

/// A kind of noise, the same in every pixel that has it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    seed: u64,
    purpose: Purpose,
    mean_wait_us: f64,
    /// Thins the arrivals where there is light; None for as many everywhere.
    half_luma: Option<f64>,
    /// None where each event is one of its own.
    correlation: Option<Correlation>,
}

/// How noise changes with time: as white noise behind two poles of one bandwidth.
#[derive(Clone, Copy, Debug)]
struct Correlation {
    time_us: f64,
    refractory_us: f64,
    /// What is left of an event's noise at the end of the refractory period, when it is memorised.
    left: f64,
}

impl Correlation {
    fn new(bandwidth_hz: f64, refractory_us: f64) -> Self {
        let time_us = 1e6 / (std::f64::consts::TAU * bandwidth_hz);
        let times = refractory_us / time_us;
        // Of two poles, so that next to nothing is lost in a short time.
        let left = if times < 700.0 { (1.0 + times) * libm::exp(-times) } else { 0.0 };
        Self { time_us, refractory_us, left }
    }

    fn excursion(&self, at_us: f64, lasts: f64, noise: f64, awaits: i8) -> Excursion {
        let until_us = at_us + self.refractory_us + lasts * self.time_us;
        Excursion { until_us, noise: noise * self.left, awaits }
    }
}

impl Noise {
    /// Shot noise, where it is on: arrivals at the rate in the dark, thinned by irradiance at their very instant, so
    /// that they do not depend on how the signal is sampled.
    pub(crate) fn shot(effects: &Effects, seed: u64) -> Option<Self> {
        let ShotNoise { rate_hz, half_luma, bandwidth_hz } = effects.shot_noise;
        let noise = Self {
            seed,
            purpose: Purpose::ShotNoise,
            mean_wait_us: 2e6 / rate_hz, // an excursion makes two events
            half_luma: Some(half_luma),
            correlation: Some(Correlation::new(bandwidth_hz, effects.refractory_period_us)),
        };
        (rate_hz > 0.0).then_some(noise)
    }

    /// Hot pixels' events, where there are any.
    pub(crate) fn hot(effects: &Effects, seed: u64) -> Option<Self> {
        let hot = effects.hot_pixels;
        let noise = Self {
            seed,
            purpose: Purpose::HotPixels,
            mean_wait_us: 1e6 / hot.rate_hz,
            half_luma: None,
            correlation: None,
        };
        (hot.fraction > 0.0 && hot.rate_hz > 0.0).then_some(noise)
    }

    /// Whether a pixel is among the hot ones.
    pub(crate) fn chosen(&self, pixel: u32, fraction: f64) -> bool {
        Draw::at(self.seed, self.purpose, pixel, u64::MAX).uniform() < fraction
    }

    /// The process at its beginning.
    pub(crate) fn first(&self, pixel: u32) -> Arrivals {
        Arrivals { wait_us: self.draw(pixel, 0).exponential() * self.mean_wait_us, index: 0 }
    }

    /// Moves on to the next arrival.
    pub(crate) fn advance(&self, pixel: u32, arrivals: &mut Arrivals) {
        arrivals.index += 1;
        arrivals.wait_us += self.draw(pixel, arrivals.index).exponential() * self.mean_wait_us;
    }

    /// The arrival's event in light of the given luma: its polarity, or None where there is none.
    pub(crate) fn event(&self, pixel: u32, index: u64, luma: f64) -> Option<bool> {
        let Some(half_luma) = self.half_luma else { return Some(true) };
        let draw = self.draw(pixel, index);
        (draw.second_uniform() * (1.0 + luma.max(0.0) / half_luma) < 1.0).then(|| draw.coin())
    }

    /// The excursion that begins with an arrival's event, noise being so much; None where resetting the pixel is all.
    pub(crate) fn excursion(&self, pixel: u32, index: u64, at_us: f64, noise: f64, on: bool) -> Option<Excursion> {
        let correlation = self.correlation?;
        let lasts = Draw::at(self.seed, Purpose::ShotNoiseExcursion, pixel, index).exponential();
        Some(correlation.excursion(at_us, lasts, noise, -polarity(on)))
    }

    /// The one that begins with the second event of a pair, `index` being the number of the next arrival.
    pub(crate) fn excursion_back(&self, pixel: u32, index: u64, at_us: f64, noise: f64) -> Excursion {
        let Some(correlation) = self.correlation else { return Excursion::NONE };
        let lasts = -ln(Draw::at(self.seed, Purpose::ShotNoiseExcursion, pixel, index).second_uniform());
        correlation.excursion(at_us, lasts, noise, 0)
    }

    fn draw(&self, pixel: u32, index: u64) -> Draw {
        Draw::at(self.seed, self.purpose, pixel, index)
    }
}
