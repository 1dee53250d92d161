//! Shot noise: a stationary Gaussian process that is added to what a pixel's comparators see.
//!
//! Photons make white noise, which passes the photoreceptor's pole and the source follower's. The first one is
//! proportional to light. So in the dark noise is large and slow, in bright light it is small and fast.
//! [`ShotNoiseLaw`] says how large and how fast, [`super::two_pole_noise`] how it moves, and [`super::noise_path`]
//! follows it in a pixel.
//!
//! What must not break: the process does not know of the pixel's events. So a reset memorises the noise of its instant
//! by itself, and no draw depends on what the pixel does.

use std::sync::OnceLock;

use super::parameters::{Effects, ShotNoise};
pub(super) use super::scan::FAR;
use super::scan::noise_reach;
use super::two_pole_noise::{Outputs, TwoPoleNoise, leap, levels};
use crate::crossing::exponential::exp_precise;
use crate::random::{Draw, Purpose, many_normals};

/// What shot noise does, the same in every pixel.
#[derive(Debug)]
pub(crate) struct ShotNoiseLaw {
    seed: u64,
    noise: ShotNoise,
    /// ln `half_luma`, or None where noise is the same in any light.
    log_half: Option<f64>,
    /// The source follower's time constants in a microsecond.
    pub(super) follower: f64,
    /// The length of cells.
    pub(super) cell_us: f64,
    /// How often one can be halved.
    pub(super) levels: usize,
    /// By the ratio of the poles, made when first needed.
    poles: Vec<OnceLock<Box<TwoPoleNoise>>>,
}

/// Limits of the ratio of the pole that is proportional to light to the other one, as powers of two: 1 / 65,536 and about
/// 100.
const LEAST_POWER: f64 = -16.0;
const MOST_POWER: f64 = 6.65;

/// Ratios are rounded to so many in each octave. Standard deviations are not rounded.
const IN_AN_OCTAVE: f64 = 32.0;

impl ShotNoiseLaw {
    /// None where there is no noise.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and positive")]
    pub(super) fn new(effects: &Effects, seed: u64) -> Option<Self> {
        let noise = effects.shot_noise;
        if !noise.is_on() {
            return None;
        }
        let ratios = if noise.half_luma.is_finite() { (MOST_POWER - LEAST_POWER) * IN_AN_OCTAVE } else { 0.0 };
        Some(Self {
            seed,
            noise,
            log_half: noise.half_luma.is_finite().then(|| libm::log(noise.half_luma)),
            follower: noise.follower(),
            cell_us: noise.cell_us(),
            levels: levels(noise.follower() * noise.cell_us()),
            poles: (0..=ratios as usize).map(|_| OnceLock::new()).collect(),
        })
    }

    /// The standard deviation where luma + `log_eps` has this logarithm.
    pub(super) fn sigma(&self, log_light: f64) -> f64 {
        let ShotNoise { rms, floor, .. } = self.noise;
        let Some(log_half) = self.log_half else { return rms };
        let x = exp_precise(log_light - log_half);
        (rms * rms / (1.0 + x) + floor * floor * (x / (1.0 + x))).sqrt()
    }

    /// How far noise may be from zero within intervals between such log intensities.
    pub(super) fn reach(&self, from: &[f64], to: &[f64], reach: &mut [f64]) {
        match self.log_half {
            None => reach.fill(FAR * self.noise.rms),
            Some(log_half) => noise_reach((self.noise.rms, self.noise.floor, log_half), from, to, reach),
        }
    }

    /// The power of two, in steps of a table, by which the pole that is proportional to light is faster than the other.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and positive")]
    pub(super) fn ratio(&self, log_light: f64) -> usize {
        let Some(log_half) = self.log_half else { return 0 };
        let power = (log_light - log_half) * std::f64::consts::LOG2_E;
        let position = (power.clamp(LEAST_POWER, MOST_POWER) - LEAST_POWER) * IN_AN_OCTAVE;
        (position.round() as usize).min(self.poles.len() - 1)
    }

    #[allow(clippy::cast_precision_loss, reason = "small")]
    fn ratio_of(&self, index: usize) -> f64 {
        if self.log_half.is_some() { libm::exp2(LEAST_POWER + index as f64 / IN_AN_OCTAVE) } else { 1.0 }
    }

    /// How noise moves where the ratio of both poles has this place in their table.
    pub(super) fn poles_of(&self, index: usize) -> &TwoPoleNoise {
        let made = || Box::new(TwoPoleNoise::new(self.ratio_of(index), self.follower * self.cell_us));
        self.poles[index].get_or_init(made)
    }

    /// Noise at the first frame.
    pub(super) fn first(&self, pixel: u32, log_light: f64) -> Outputs {
        self.poles_of(self.ratio(log_light)).stationary(self.sigma(log_light), self.draws(pixel, 0))
    }

    /// Noise at the start of a cell, so many cells after these outputs.
    #[allow(clippy::cast_precision_loss, reason = "beyond 2^53 cells nothing is left")]
    pub(super) fn after(&self, pixel: u32, cell: i64, cells: i64, log_light: f64, outputs: Outputs) -> Outputs {
        let second = self.follower * self.cell_us * cells as f64;
        let first = self.ratio_of(self.ratio(log_light)) * second;
        leap(outputs, (first, second), self.sigma(log_light), self.draws(pixel, self.node(cell, 0)))
    }

    /// The number of an instant: so many shortest spans after the start of a cell.
    pub(super) fn node(&self, cell: i64, position: u64) -> u64 {
        (cell.cast_unsigned() << self.levels).wrapping_add(position)
    }

    /// The two normal draws of an instant.
    pub(super) fn draws(&self, pixel: u32, node: u64) -> (f64, f64) {
        Draw::at(self.seed, Purpose::ShotNoise, pixel, node).normals()
    }

    /// The same for many pixels and instants.
    pub(super) fn many_draws(&self, named: (&[u32], &[u64]), draws: (&mut [f64], &mut [f64])) {
        many_normals(self.seed, Purpose::ShotNoise, named, draws);
    }

    /// About how many events it makes in a microsecond, from above: trips further than half a threshold away, and on
    /// each as many events as there are thresholds on its way.
    pub(super) fn events_in_a_us(&self, c: f64, log_light: f64) -> f64 {
        let sigma = self.sigma(log_light);
        let omega = self.follower * self.ratio_of(self.ratio(log_light)).sqrt();
        let thresholds = c / sigma;
        omega * (2.0 / std::f64::consts::TAU + 0.8 / thresholds) * libm::exp(-thresholds * thresholds / 8.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn law(floor: f64) -> ShotNoiseLaw {
        let shot_noise = ShotNoise { rms: 0.1, floor, half_luma: 2.0, bandwidth_hz: 300.0 };
        ShotNoiseLaw::new(&Effects { shot_noise, ..Effects::default() }, 1).expect("on")
    }

    /// Within the rounding of the table, and within its limits beyond.
    #[test]
    fn the_photoreceptor_s_pole_is_proportional_to_light() {
        let law = law(0.0);
        let ratio = |light: f64| law.ratio_of(law.ratio(light.ln()));
        for light in [1e-3, 0.02, 0.7, 2.0, 5.0, 150.0] {
            assert!((ratio(light) / (light / 2.0)).ln().abs() <= 2f64.ln() / 64.0 + 1e-12, "{light}");
        }
        assert!((ratio(1e-300) * 65_536.0 - 1.0).abs() < 1e-12 && (ratio(1e300) - 100.0).abs() < 2.0);
    }

    /// An interval's reach is that of its end with more noise, which a floor may turn to the brighter one.
    #[test]
    fn the_reach_is_that_of_the_end_with_more_noise() {
        let logs = [0.02f64.ln(), 50f64.ln()];
        for floor in [0.0, 0.03, 0.4] {
            let (law, mut reach) = (law(floor), [0.0; 2]);
            law.reach(&logs, &[logs[1], logs[0]], &mut reach);
            let most = FAR * law.sigma(logs[0]).max(law.sigma(logs[1]));
            assert!(reach.iter().all(|reach| (reach / most - 1.0).abs() < 1e-9), "{reach:?} {most}");
        }
    }
}
