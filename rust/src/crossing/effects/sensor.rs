//! A sensor under effects: what is the same for all of its pixels, and computed once.

use super::hot_pixels::HotPixelNoise;
use super::parameters::Effects;
use super::shot_noise::ShotNoiseLaw;
use crate::crossing::parameters::CrossingParameters;
use crate::event::SensorSize;

/// Size, effects, and what is derived from them.
pub(super) struct Sensor {
    pub(super) size: SensorSize,
    pub(super) effects: Effects,
    pub(super) seed: u64,
    /// The time of the first frame: leaks drift from there.
    pub(super) started_us: i64,
    pub(super) shot: Option<ShotNoiseLaw>,
    pub(super) hot: Option<HotPixelNoise>,
    /// A change of log intensity that does not count: a hundredth of the least threshold.
    pub(super) tolerance: f64,
}

impl Sensor {
    pub(super) fn new(size: SensorSize, p: &CrossingParameters, effects: &Effects, seed: u64, started_us: i64) -> Self {
        let (shot, hot) = (ShotNoiseLaw::new(effects, seed), HotPixelNoise::new(effects, seed));
        Self { size, effects: effects.clone(), seed, started_us, shot, hot, tolerance: 0.01 * p.least_threshold() }
    }

    /// Microseconds since the first frame.
    #[allow(clippy::cast_precision_loss, reason = "times of interest lie below 2^53 us")]
    pub(super) fn elapsed(&self, t_us: i64) -> f64 {
        (t_us - self.started_us) as f64
    }
}
