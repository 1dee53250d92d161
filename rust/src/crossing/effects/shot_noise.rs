//! Shot noise: a Gaussian process, of which only its crossings of a pixel's levels are drawn.
//!
//! Rice: a stationary Gaussian process of standard deviation s crosses the level d upwards `nu exp(-d^2 / (2 s^2))` times a
//! second, and `nu` is its bandwidth where it is white noise behind two poles of one corner frequency. Arrivals are
//! drawn at the rate in the dark, which is the highest, and kept by the light at their very instant.

use super::arrivals::Arrivals;
use super::excursion::{Excursion, polarity};
use super::parameters::{Effects, ShotNoise};
use crate::crossing::level::Thresholds;
use crate::log_intensity::ln;
use crate::random::{Draw, Purpose};

/// What shot noise does, the same in every pixel but for the thresholds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShotNoiseLaw {
    seed: u64,
    noise: ShotNoise,
    correlation: Correlation,
}

/// Pairs a second that come at least: no pixel lives long enough to see one, and waits stay finite.
const LEAST_RATE_HZ: f64 = 1e-10;

impl ShotNoiseLaw {
    /// None where there is no noise.
    pub(super) fn new(effects: &Effects, seed: u64) -> Option<Self> {
        let noise = effects.shot_noise;
        let correlation = Correlation::new(noise.bandwidth_hz, effects.refractory_period_us);
        (noise.rms > 0.0).then_some(Self { seed, noise, correlation })
    }

    /// Pairs a second that begin with an ON event, and those that begin with an OFF event, where luma + `log_eps` is
    /// `light`.
    fn rates_hz(&self, c: Thresholds, light: f64) -> (f64, f64) {
        let ShotNoise { rms, half_luma, bandwidth_hz } = self.noise;
        let twice_variance = 2.0 * rms * rms / (1.0 + light / half_luma);
        let rate = |distance: f64| bandwidth_hz * libm::exp(-distance * distance / twice_variance);
        (rate(c.on), rate(c.off))
    }

    /// Arrivals a second: the pairs in the dark.
    pub(super) fn arrivals_hz(&self, c: Thresholds) -> f64 {
        let (on, off) = self.rates_hz(c, 0.0);
        (on + off).max(LEAST_RATE_HZ)
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

    /// The excursion that begins with an arrival's event, noise being so much.
    pub(super) fn excursion(&self, pixel: u32, index: u64, at_us: f64, noise: f64, on: bool) -> Excursion {
        let lasts = Draw::at(self.seed, Purpose::ShotNoiseExcursion, pixel, index).exponential();
        self.correlation.excursion(at_us, lasts, noise, -polarity(on))
    }

    /// The one that begins with the second event of a pair, `index` being the number of the next arrival.
    pub(super) fn excursion_back(&self, pixel: u32, index: u64, at_us: f64, noise: f64) -> Excursion {
        let lasts = -ln(Draw::at(self.seed, Purpose::ShotNoiseExcursion, pixel, index).second_uniform());
        self.correlation.excursion(at_us, lasts, noise, 0)
    }

    fn draw(&self, pixel: u32, index: u64) -> Draw {
        Draw::at(self.seed, Purpose::ShotNoise, pixel, index)
    }
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
