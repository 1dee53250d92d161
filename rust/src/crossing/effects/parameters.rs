//! Which effects there are, their parameters, and the ranges that these may have.
//!
//! The default of each means that it is off. Names in errors are those that Python uses.

use crate::error::{Error, Result};
use crate::readout::ReadoutParameters;

/// The photoreceptor as a first-order low-pass of log intensity.
///
/// Its corner frequency is proportional to irradiance, down to a floor and up to a ceiling (where the source follower
/// behind it is the slower one). It is frozen for each interval, at that of the mean log intensity of both ends.
/// Source: Lichtsteiner, Posch and Delbruck, IEEE JSSC 43(2), 2008, section III.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoreceptorBandwidth {
    /// The corner frequency where luma + `log_eps` = 1; infinite for no low-pass.
    pub hz: f64,
    /// The corner frequency never falls below.
    pub floor_hz: f64,
    /// The corner frequency never rises above.
    pub ceiling_hz: f64,
}

/// Events from noise alone: now and then noise takes the signal to a level, and back.
///
/// Both ways make an event, so noise events come in pairs of opposite polarity, and the reference follows as after any
/// event. The rate of events falls with irradiance: `rate_hz` / (1 + luma / `half_luma`).
/// Source: Graca, `McReynolds` and Delbruck, "Exploiting alternating DVS shot noise event pair statistics to reduce
/// background activity", IISW 2023 (pairs, and that a reset memorises the noise); Hu, Liu and Delbruck, "v2e", CVPR
/// Workshops 2021 (rate falls with intensity).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotNoise {
    /// Events per second of a pixel in the dark.
    pub rate_hz: f64,
    /// The luma at which the rate has halved.
    pub half_luma: f64,
    /// Of the noise: an excursion lasts for 1 / (2 pi bandwidth) on average.
    pub bandwidth_hz: f64,
}

/// Pixels that fire by themselves: a share of all, each a Poisson process of ON events, which reset the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HotPixels {
    /// The share of pixels.
    pub fraction: f64,
    /// Events per second of each.
    pub rate_hz: f64,
}

/// What makes a sensor differ from ideal pixels. The default is none of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Effects {
    /// The photoreceptor's low-pass.
    pub photoreceptor_bandwidth: PhotoreceptorBandwidth,
    /// Relative standard deviation of the thresholds from pixel to pixel, each log-normal about its nominal value as mean.
    pub threshold_mismatch: f64,
    /// A pixel is held in reset for so long after each event, and memorises log intensity anew at its end.
    pub refractory_period_us: f64,
    /// The reference drifts down by so many ON thresholds a second.
    pub leak_rate_hz: f64,
    /// Noise in all pixels.
    pub shot_noise: ShotNoise,
    /// Noise in a few.
    pub hot_pixels: HotPixels,
    /// The bus that events wait for; None for one that carries all at once.
    pub readout: Option<ReadoutParameters>,
}

/// So little, of what must be more than nothing.
const LEAST: f64 = 1e-300;

/// A bound as people write it.
fn plain(bound: f64) -> String {
    if bound == 0.0 || (1e-3..1e5).contains(&bound) || bound.is_infinite() {
        format!("{bound}")
    } else {
        format!("{bound:e}")
    }
}

impl Default for Effects {
    fn default() -> Self {
        Self {
            photoreceptor_bandwidth: PhotoreceptorBandwidth {
                hz: f64::INFINITY,
                floor_hz: 0.0,
                ceiling_hz: f64::INFINITY,
            },
            threshold_mismatch: 0.0,
            refractory_period_us: 0.0,
            leak_rate_hz: 0.0,
            shot_noise: ShotNoise { rate_hz: 0.0, half_luma: 1.0, bandwidth_hz: 300.0 },
            hot_pixels: HotPixels { fraction: 0.0, rate_hz: 0.0 },
            readout: None,
        }
    }
}

impl Effects {
    /// Refuses values outside of their ranges.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the effect, the value and the range.
    pub fn check(&self) -> Result<()> {
        let PhotoreceptorBandwidth { hz, floor_hz, ceiling_hz } = self.photoreceptor_bandwidth;
        let ranges = [
            ("photoreceptor_bandwidth_hz", hz, LEAST, f64::INFINITY, "Hz"),
            ("photoreceptor_bandwidth_hz: ceiling_hz", ceiling_hz, LEAST, f64::INFINITY, "Hz"),
            ("photoreceptor_bandwidth_hz: floor_hz", floor_hz, 0.0, ceiling_hz, "Hz"),
            ("threshold_mismatch", self.threshold_mismatch, 0.0, 1.0, "of the threshold"),
            ("refractory_period_us", self.refractory_period_us, 0.0, 1e15, "us"),
            ("leak_rate_hz", self.leak_rate_hz, 0.0, 1e6, "Hz"),
            ("shot_noise_rate_hz", self.shot_noise.rate_hz, 0.0, 1e7, "Hz"),
            ("shot_noise_rate_hz: half_luma", self.shot_noise.half_luma, LEAST, 1e300, "units of luma"),
            ("shot_noise_rate_hz: bandwidth_hz", self.shot_noise.bandwidth_hz, 1e-3, 1e12, "Hz"),
            ("hot_pixels: fraction", self.hot_pixels.fraction, 0.0, 1.0, "of the pixels"),
            ("hot_pixels: rate_hz", self.hot_pixels.rate_hz, 0.0, 1e7, "Hz"),
        ];
        for (name, value, low, high, unit) in ranges {
            if !(low..=high).contains(&value) {
                let (from, to) = (plain(low), plain(high));
                let range = match (low == LEAST, high == f64::INFINITY) {
                    (true, true) => format!("be > 0 {unit}"),
                    (true, false) => format!("be > 0 and at most {to} {unit}"),
                    (false, true) => format!("be {from} {unit} or more"),
                    (false, false) => format!("lie in {from}..{to} {unit}"),
                };
                return Err(Error::Argument(format!("{name} must {range}, got {value}")));
            }
        }
        self.readout.as_ref().map_or(Ok(()), ReadoutParameters::check)
    }

    /// Whether the photoreceptor's low-pass is on.
    pub(crate) fn filters(&self) -> bool {
        self.photoreceptor_bandwidth.hz.min(self.photoreceptor_bandwidth.ceiling_hz).is_finite()
    }

    /// Whether any of them acts inside of the pixel, where thresholds of its own are no reason to leave the ideal one.
    pub(crate) fn change_the_pixel(&self) -> bool {
        self.filters()
            || self.refractory_period_us > 0.0
            || self.leak_rate_hz > 0.0
            || self.shot_noise.rate_hz > 0.0
            || (self.hot_pixels.fraction > 0.0 && self.hot_pixels.rate_hz > 0.0)
    }
}
