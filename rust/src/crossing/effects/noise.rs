//! Noise events: arrivals of Poisson processes, each a function of (seed, purpose, pixel, number of the arrival).
//!
//! Arrivals are drawn at the rate in the dark and kept with a probability that falls with the light at their instant.
//! So they do not depend on how the signal is sampled in time, which must not break.

use super::parameters::{Effects, ShotNoise};
use crate::random::{Draw, Purpose};

/// Where a pixel's process stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrivals {
    /// Microseconds from the interval's start to the next arrival.
    pub(crate) wait_us: f64,
    /// Its number.
    pub(crate) index: u64,
}

/// A kind of noise, the same in every pixel that has it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    seed: u64,
    purpose: Purpose,
    mean_wait_us: f64,
    /// Thins the arrivals where there is light; None for as many everywhere.
    half_luma: Option<f64>,
}

impl Noise {
    /// Shot noise, where it is on: arrivals at the rate in the dark, thinned by irradiance at their very instant, so
    /// that they do not depend on how the signal is sampled.
    pub(crate) fn shot(effects: &Effects, seed: u64) -> Option<Self> {
        let ShotNoise { rate_hz, half_luma } = effects.shot_noise;
        let noise = Self { seed, purpose: Purpose::ShotNoise, mean_wait_us: 1e6 / rate_hz, half_luma: Some(half_luma) };
        (rate_hz > 0.0).then_some(noise)
    }

    /// Hot pixels' events, where there are any.
    pub(crate) fn hot(effects: &Effects, seed: u64) -> Option<Self> {
        let hot = effects.hot_pixels;
        let noise = Self { seed, purpose: Purpose::HotPixels, mean_wait_us: 1e6 / hot.rate_hz, half_luma: None };
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

    fn draw(&self, pixel: u32, index: u64) -> Draw {
        Draw::at(self.seed, self.purpose, pixel, index)
    }
}
