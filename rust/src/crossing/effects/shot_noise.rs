//! Shot noise: a Gaussian process, of which only its crossings of a pixel's levels are drawn.
//!
//! By Rice's formula, a stationary Gaussian process of standard deviation s crosses the level d upwards `nu exp(-d^2 /
//! (2 s^2))` times a second. For white noise behind two poles, `nu` is the root of `f1 f2`, their corner frequencies.
//! One pole is fixed, the other is proportional to light, so `nu` grows with light while s falls.
//!
//! Each polarity has a light in which its rate is highest. Arrivals are drawn at these highest rates, and each is kept
//! or dropped by the light at its very instant (thinning).
//!
//! What must not break: [`ShotNoiseLaw::arrivals_hz`] is at least the rate in any light, or events would be missing.
//! Draws do not depend on the signal.

use super::arrivals::Arrivals;
use super::excursion::{Excursion, polarity};
use super::parameters::{Effects, ShotNoise};
use super::two_poles::Decays;
use crate::crossing::level::Thresholds;
use crate::log_intensity::ln;
use crate::random::{Draw, Purpose};

/// What shot noise does, the same in every pixel but for the thresholds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShotNoiseLaw {
    seed: u64,
    noise: ShotNoise,
    refractory_us: f64,
}

/// Pairs a second that come at least: no pixel lives long enough to see one, and waits stay finite.
const LEAST_RATE_HZ: f64 = 1e-10;

/// Limits of the ratio of the pole that is proportional to light to the other pole. They keep rates and times finite for
/// any noise and light.
const MOST_RATIO: f64 = 100.0;
const LEAST_RATIO: f64 = 1e-12;

impl ShotNoiseLaw {
    /// None where there is no noise.
    pub(super) fn new(effects: &Effects, seed: u64) -> Option<Self> {
        let noise = effects.shot_noise;
        (noise.rms > 0.0).then_some(Self { seed, noise, refractory_us: effects.refractory_period_us })
    }

    /// The pole that depends on light over the one that does not, where luma + `log_eps` is `light`.
    fn ratio(&self, light: f64) -> f64 {
        if self.noise.half_luma.is_finite() {
            (light / self.noise.half_luma).clamp(LEAST_RATIO, MOST_RATIO)
        } else {
            1.0
        }
    }

    /// The rate of crossings of a level at a distance from zero, at a ratio of the poles and a variance.
    fn crossings_hz(&self, distance: f64, ratio: f64, variance: f64) -> f64 {
        self.noise.bandwidth_hz * ratio.sqrt() * libm::exp(-distance * distance / (2.0 * variance))
    }

    /// Pairs a second that begin with an ON event, and those that begin with an OFF event, where luma + `log_eps` is
    /// `light`.
    fn rates_hz(&self, c: Thresholds, light: f64) -> (f64, f64) {
        let ShotNoise { rms, half_luma, .. } = self.noise;
        let variance = rms * rms / (1.0 + light / half_luma);
        let rate = |distance: f64| self.crossings_hz(distance, self.ratio(light), variance);
        (rate(c.on), rate(c.off))
    }

    /// Arrivals a second: the pairs of each polarity in the light where they are the most.
    pub(super) fn arrivals_hz(&self, c: Thresholds) -> f64 {
        let ShotNoise { rms, half_luma, .. } = self.noise;
        let most = |distance: f64| {
            if half_luma.is_infinite() {
                return self.crossings_hz(distance, 1.0, rms * rms);
            }
            // The root of x exp(-d^2 (1 + x) / (2 rms^2)) is largest there.
            let ratio = (rms * rms / (distance * distance)).clamp(LEAST_RATIO, MOST_RATIO);
            // A little above, for rounding.
            1.000_000_001 * self.crossings_hz(distance, ratio, rms * rms / (1.0 + ratio))
        };
        (most(c.on) + most(c.off)).max(LEAST_RATE_HZ)
    }

    /// The process at its beginning.
    pub(super) fn first(&self, pixel: u32, c: Thresholds) -> Arrivals {
        Arrivals { wait_us: self.wait_us(pixel, 0, c), index: 0 }
    }

    /// Moves on to the next arrival.
    pub(super) fn advance(&self, pixel: u32, c: Thresholds, arrivals: &mut Arrivals) {
        arrivals.index += 1;
        arrivals.wait_us += self.wait_us(pixel, arrivals.index, c);
    }

    fn wait_us(&self, pixel: u32, index: u64, c: Thresholds) -> f64 {
        self.draw(pixel, index).exponential() * 1e6 / self.arrivals_hz(c)
    }

    /// The arrival's event where luma + `log_eps` is `light`: its polarity, or None where there is none.
    pub(super) fn event(&self, pixel: u32, index: u64, c: Thresholds, light: f64) -> Option<bool> {
        let (on, off) = self.rates_hz(c, light);
        let most = self.arrivals_hz(c);
        let place = self.draw(pixel, index).second_uniform() * most;
        match (place < on, place >= most - off) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        }
    }

    /// The excursion that begins with an arrival's event of this polarity.
    pub(super) fn excursion(&self, pixel: u32, index: u64, away: Away, on: bool) -> Excursion {
        let lasts = Draw::at(self.seed, Purpose::ShotNoiseExcursion, pixel, index).exponential();
        self.lasting(away, lasts, -polarity(on))
    }

    /// The one that begins with the second event of a pair, `index` being the number of the next arrival.
    pub(super) fn excursion_back(&self, pixel: u32, index: u64, away: Away) -> Excursion {
        let lasts = -ln(Draw::at(self.seed, Purpose::ShotNoiseExcursion, pixel, index).second_uniform());
        self.lasting(away, lasts, 0)
    }

    /// An excursion that lasts `lasts` times the mean of both poles' time constants.
    ///
    /// Noise is memorised at the end of the refractory period. What is left of it then follows its autocorrelation.
    fn lasting(&self, away: Away, lasts: f64, awaits: i8) -> Excursion {
        let Away { at_us, light, noise } = away;
        let (fixed_us, ratio) = (1e6 / (std::f64::consts::TAU * self.noise.bandwidth_hz), self.ratio(light));
        let of_light_us = fixed_us / ratio;
        let until_us = at_us + self.refractory_us + (lasts * 0.5 * (fixed_us + of_light_us)).min(LONGEST_US);
        let decays = Decays { first: self.refractory_us / of_light_us, second: self.refractory_us / fixed_us };
        Excursion { until_us, noise: noise * decays.left(), awaits }
    }

    fn draw(&self, pixel: u32, index: u64) -> Draw {
        Draw::at(self.seed, Purpose::ShotNoise, pixel, index)
    }
}

/// Noise that has just made an event: when, in which light (luma + `log_eps`), and how much noise there is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Away {
    pub(crate) at_us: f64,
    pub(crate) light: f64,
    pub(crate) noise: f64,
}

/// No excursion lasts longer, so that a stored state has finite times.
const LONGEST_US: f64 = 1e16;
