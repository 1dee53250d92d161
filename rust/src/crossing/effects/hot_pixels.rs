//! Hot pixels: a few pixels that fire by themselves, nearly periodically, whatever they see.
//!
//! Each has a rate and a regularity of its own. Intervals are log-normal, so they are never negative, however irregular
//! they are.

use super::parameters::{Effects, HotPixels};
use crate::random::{Draw, Purpose};

/// No pixel fires faster.
const FASTEST_HZ: f64 = 1e7;

/// Where a hot pixel's process stands.
///
/// Arrivals depend neither on how the signal is sampled in time nor on what the pixel sees. The pixel may drop one, and
/// the next one comes when it would have come anyway.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrivals {
    /// Microseconds from the interval's start to the next arrival.
    pub(crate) wait_us: f64,
    /// Its number.
    pub(crate) index: u64,
}

/// One of them.
pub(super) struct HotPixel {
    pub(super) rate_hz: f64,
    /// Standard deviation of the logarithm of its intervals.
    deviation: f64,
}

/// What hot pixels do.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HotPixelNoise {
    seed: u64,
    hot: HotPixels,
}

impl HotPixelNoise {
    /// None where there are none.
    pub(super) fn new(effects: &Effects, seed: u64) -> Option<Self> {
        let hot = effects.hot_pixels;
        hot.are_on().then_some(Self { seed, hot })
    }

    /// Whether a pixel is among them.
    pub(super) fn chosen(&self, pixel: u32) -> bool {
        self.draw(pixel, u64::MAX).uniform() < self.hot.fraction
    }

    /// Events a second of a pixel, and the standard deviation of the logarithm of its intervals.
    pub(super) fn pixel(&self, pixel: u32) -> HotPixel {
        let draw = Draw::at(self.seed, Purpose::HotPixelKind, pixel, 0);
        let HotPixels { rate_hz, rate_spread, least_cv, most_cv, .. } = self.hot;
        let factor = if rate_spread > 0.0 { libm::exp(rate_spread * draw.normal()) } else { 1.0 };
        let fraction = Draw::at(self.seed, Purpose::HotPixelKind, pixel, 1).uniform();
        let cv = if least_cv > 0.0 { least_cv * libm::pow(most_cv / least_cv, fraction) } else { most_cv * fraction };
        HotPixel { rate_hz: (rate_hz * factor).min(FASTEST_HZ), deviation: libm::log1p(cv * cv).sqrt() }
    }

    /// The process at its beginning, which has gone on for long: within an interval, longer ones being met more often.
    pub(super) fn first(&self, pixel: u32) -> Arrivals {
        let HotPixel { rate_hz, deviation } = self.pixel(pixel);
        let met = libm::exp(deviation * self.draw(pixel, 0).normal() + 0.5 * deviation * deviation);
        let left = Draw::at(self.seed, Purpose::HotPixelKind, pixel, 2).uniform();
        Arrivals { wait_us: met * left * (1e6 / rate_hz), index: 0 }
    }

    /// Moves on to the next arrival.
    pub(super) fn advance(&self, pixel: u32, arrivals: &mut Arrivals) {
        arrivals.index += 1;
        let HotPixel { rate_hz, deviation } = self.pixel(pixel);
        let interval = libm::exp(deviation * self.draw(pixel, arrivals.index).normal() - 0.5 * deviation * deviation);
        arrivals.wait_us += interval * (1e6 / rate_hz);
    }

    fn draw(&self, pixel: u32, index: u64) -> Draw {
        Draw::at(self.seed, Purpose::HotPixels, pixel, index)
    }
}
