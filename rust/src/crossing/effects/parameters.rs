//! Which effects there are, their parameters, and the allowed ranges of these.
//!
//! The default of each effect means that it is off. Names in errors are those that Python uses.

use crate::error::{Error, Result};
use crate::readout::ReadoutParameters;

/// The photoreceptor and the source follower behind it: two first-order low-passes of log intensity, one after the other.
///
/// The photoreceptor's corner frequency is proportional to the photocurrent, luma + `log_eps`, of which `log_eps` is the
/// dark current. It is frozen for each interval, at that of the mean log intensity of both ends. The source follower's
/// is set by its bias.
/// Source: Lichtsteiner, Posch and Delbruck, IEEE JSSC 43(2), 2008, section III; Graca and Delbruck, "Unraveling the
/// paradox of intensity-dependent DVS pixel noise", IISW 2021 (both poles).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoreceptorBandwidth {
    /// The photoreceptor's corner frequency where luma + `log_eps` = 1; infinite for one that follows at once.
    pub hz: f64,
    /// The source follower's, in any light; infinite likewise.
    pub source_follower_hz: f64,
}

/// A stationary Gaussian process that is added to what comparators see. A reset memorises it with the signal.
///
/// It is white noise behind two poles: one at `bandwidth_hz`, and one that is proportional to light, at x
/// `bandwidth_hz` with x = (luma + `log_eps`) / `half_luma`. Photons make noise whose density is as one over light, which leaves a
/// variance of `rms`^2 / (1 + x). Noise of a density that is the same in any light leaves `floor`^2 x / (1 + x).
/// Source: Graca and Delbruck, "Unraveling the paradox of intensity-dependent DVS pixel noise", IISW 2021 (both poles,
/// noise of constant power in the dark); Graca, `McReynolds` and Delbruck, "Exploiting alternating DVS shot noise event
/// pair statistics to reduce background activity", IISW 2023 (a reset memorises the noise).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotNoise {
    /// Standard deviation of log intensity in the dark.
    pub rms: f64,
    /// What the standard deviation comes to in bright light, at least.
    pub floor: f64,
    /// The luma + `log_eps` at which the variance has halved, both poles being alike there; infinite for noise that is the
    /// same in any light, of variance `rms`^2 and with both poles at `bandwidth_hz`.
    pub half_luma: f64,
    /// Corner frequency of the pole that does not depend on light.
    pub bandwidth_hz: f64,
}

impl ShotNoise {
    /// Whether there is any.
    pub(crate) fn is_on(&self) -> bool {
        self.rms > 0.0 || self.floor > 0.0
    }

    /// The source follower's time constants in a microsecond.
    pub(super) fn follower(&self) -> f64 {
        std::f64::consts::TAU * 1e-6 * self.bandwidth_hz
    }

    /// Noise is drawn at the ends of cells of so many microseconds first: one to two time constants of the source
    /// follower, or 256 us where that is more. It is a power of two, so that times of cells are exact.
    pub(super) fn cell_us(&self) -> f64 {
        libm::exp2((-libm::log2(self.follower())).ceil()).max(256.0)
    }

    /// Refuses an interval of so many microseconds that following noise in it would not come to an end.
    pub(crate) fn check_interval(&self, ticks: f64) -> Result<()> {
        const MOST_CELLS: f64 = 4_194_304.0;
        let most_us = MOST_CELLS * self.cell_us();
        if self.is_on() && ticks > most_us {
            return Err(Error::Argument(format!(
                "two frames under shot_noise_rms of bandwidth_hz {} must be at most {most_us} us apart, got {ticks} us",
                self.bandwidth_hz
            )));
        }
        Ok(())
    }
}

/// Thresholds that differ from pixel to pixel: log-normal factors, whose mean is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThresholdMismatch {
    /// Relative standard deviation of what each pixel has of its own.
    pub sigma: f64,
    /// Correlation of the logarithms of a pixel's own ON and OFF factors.
    pub correlation: f64,
    /// Thresholds of even columns are lower by this fraction, those of odd ones higher; negative the other way round.
    pub column_parity: f64,
    /// Relative standard deviation of what the pixels of a column have in common.
    pub columns: f64,
    /// Likewise of a row.
    pub rows: f64,
}

impl ThresholdMismatch {
    /// All pixels are alike.
    pub(crate) const NONE: Self = Self { sigma: 0.0, correlation: 0.0, column_parity: 0.0, columns: 0.0, rows: 0.0 };

    pub(crate) fn is_neutral(&self) -> bool {
        *self == Self { correlation: self.correlation, ..Self::NONE }
    }
}

/// Leak of the memorised reference, so that a static scene makes ON events.
///
/// Source: Nozaki and Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision sensors", IEEE Trans.
/// Electron Devices 64(8), 2017 (junction leakage in the reset switch follows Arrhenius' law; light adds to it).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leak {
    /// Drift of the reference in ON thresholds per second, downwards: the mean of all pixels at 25 degrees in the dark.
    pub rate_hz: f64,
    /// Standard deviation of the rate from pixel to pixel, as a fraction of its mean; log-normal.
    pub spread: f64,
    /// Standard deviation of what leaks from one event to the next, as a fraction of it.
    pub jitter: f64,
    /// Of the junctions, in degrees Celsius.
    pub temperature_c: f64,
    /// The warming in degrees that doubles the rate.
    pub doubling_c: f64,
    /// The luma whose parasitic photocurrent leaks as much as the rate at 25 degrees in the dark; infinite for none.
    pub double_luma: f64,
}

/// Pixels that fire by themselves: a fraction of all, each with nearly periodic ON events, which reset the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HotPixels {
    /// The fraction of pixels.
    pub fraction: f64,
    /// Events per second of each: the median, from which each differs.
    pub rate_hz: f64,
    /// Standard deviation of the natural logarithm of the rate from pixel to pixel.
    pub rate_spread: f64,
    /// Standard deviation of a pixel's intervals over their mean: at least this, and at most the next, evenly in its logarithm.
    pub least_cv: f64,
    /// See `least_cv`.
    pub most_cv: f64,
}

impl HotPixels {
    /// Whether any fires.
    pub(crate) fn are_on(&self) -> bool {
        self.fraction > 0.0 && self.rate_hz > 0.0
    }
}

/// What makes a sensor differ from ideal pixels. The default is none of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Effects {
    /// The photoreceptor's low-pass.
    pub photoreceptor_bandwidth: PhotoreceptorBandwidth,
    /// Differences of the thresholds from pixel to pixel.
    pub threshold_mismatch: ThresholdMismatch,
    /// A pixel is held in reset for so long after each event, and memorises log intensity anew at its end.
    pub refractory_period_us: f64,
    /// Drift of the reference.
    pub leak: Leak,
    /// Noise in all pixels.
    pub shot_noise: ShotNoise,
    /// Noise in a few.
    pub hot_pixels: HotPixels,
    /// The bus that events wait for; None for one that carries all at once.
    pub readout: Option<ReadoutParameters>,
}

/// The least value of parameters that must be above 0.
const LEAST: f64 = 1e-300;

/// A bound as people write it.
fn plain(bound: f64) -> String {
    if bound == 0.0 || (1e-3..1e5).contains(&bound.abs()) || bound.is_infinite() {
        format!("{bound}")
    } else {
        format!("{bound:e}")
    }
}

impl Default for Effects {
    fn default() -> Self {
        Self {
            photoreceptor_bandwidth: PhotoreceptorBandwidth { hz: f64::INFINITY, source_follower_hz: f64::INFINITY },
            threshold_mismatch: ThresholdMismatch::NONE,
            refractory_period_us: 0.0,
            leak: Leak {
                rate_hz: 0.0,
                spread: 0.0,
                jitter: 0.0,
                temperature_c: 25.0,
                doubling_c: 8.0,
                double_luma: f64::INFINITY,
            },
            shot_noise: ShotNoise { rms: 0.0, floor: 0.0, half_luma: 1.0, bandwidth_hz: 300.0 },
            hot_pixels: HotPixels { fraction: 0.0, rate_hz: 0.0, rate_spread: 0.0, least_cv: 0.1, most_cv: 0.1 },
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
        let PhotoreceptorBandwidth { hz, source_follower_hz } = self.photoreceptor_bandwidth;
        let ranges = [
            ("photoreceptor_bandwidth_hz", hz, LEAST, f64::INFINITY, "Hz"),
            ("photoreceptor_bandwidth_hz: source_follower_hz", source_follower_hz, 1e-3, f64::INFINITY, "Hz"),
            ("threshold_mismatch", self.threshold_mismatch.sigma, 0.0, 1.0, "of the threshold"),
            ("threshold_mismatch: correlation", self.threshold_mismatch.correlation, -1.0, 1.0, "of ON and OFF"),
            ("threshold_mismatch: column_parity", self.threshold_mismatch.column_parity, -0.5, 0.5, "of the threshold"),
            ("threshold_mismatch: columns", self.threshold_mismatch.columns, 0.0, 1.0, "of the threshold"),
            ("threshold_mismatch: rows", self.threshold_mismatch.rows, 0.0, 1.0, "of the threshold"),
            ("refractory_period_us", self.refractory_period_us, 0.0, 1e15, "us"),
            ("leak_rate_hz", self.leak.rate_hz, 0.0, 1e6, "Hz"),
            ("leak_rate_hz: spread", self.leak.spread, 0.0, 1.0, "of the rate"),
            ("leak_rate_hz: jitter", self.leak.jitter, 0.0, 1.0, "of an interval"),
            ("leak_rate_hz: temperature_c", self.leak.temperature_c, -100.0, 200.0, "degrees Celsius"),
            ("leak_rate_hz: doubling_c", self.leak.doubling_c, 1.0, 1e6, "degrees"),
            ("leak_rate_hz: double_luma", self.leak.double_luma, LEAST, f64::INFINITY, "units of luma"),
            ("shot_noise_rms", self.shot_noise.rms, 0.0, 1e6, "of log intensity"),
            ("shot_noise_rms: floor", self.shot_noise.floor, 0.0, 1e6, "of log intensity"),
            ("shot_noise_rms: half_luma", self.shot_noise.half_luma, LEAST, f64::INFINITY, "units of luma"),
            ("shot_noise_rms: bandwidth_hz", self.shot_noise.bandwidth_hz, 1e-3, 1e7, "Hz"),
            ("hot_pixels: fraction", self.hot_pixels.fraction, 0.0, 1.0, "of the pixels"),
            ("hot_pixels: rate_hz", self.hot_pixels.rate_hz, 0.0, 1e7, "Hz"),
            ("hot_pixels: rate_spread", self.hot_pixels.rate_spread, 0.0, 3.0, "of ln rate"),
            ("hot_pixels: most_cv", self.hot_pixels.most_cv, 0.0, 1.0, "of an interval"),
            ("hot_pixels: least_cv", self.hot_pixels.least_cv, 0.0, self.hot_pixels.most_cv, "of an interval"),
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
        if self.shot_noise.floor > 0.0 && self.shot_noise.half_luma == f64::INFINITY {
            return Err(Error::Argument(format!(
                "shot_noise_rms: floor must be 0 for noise that is the same in any light (half_luma = inf), got {}",
                self.shot_noise.floor
            )));
        }
        self.readout.as_ref().map_or(Ok(()), ReadoutParameters::check)
    }

    /// Whether there is a low-pass: the photoreceptor's, the source follower's, or both.
    pub(crate) fn filters(&self) -> bool {
        let PhotoreceptorBandwidth { hz, source_follower_hz } = self.photoreceptor_bandwidth;
        hz.min(source_follower_hz).is_finite()
    }

    /// Whether there are two low-passes one after the other.
    pub(crate) fn filters_twice(&self) -> bool {
        let PhotoreceptorBandwidth { hz, source_follower_hz } = self.photoreceptor_bandwidth;
        hz.max(source_follower_hz).is_finite()
    }

    /// Whether any of them acts inside of the pixel, where thresholds of its own are no reason to leave the ideal one.
    pub(crate) fn change_the_pixel(&self) -> bool {
        self.filters()
            || self.refractory_period_us > 0.0
            || self.leak.is_on()
            || self.shot_noise.is_on()
            || self.hot_pixels.are_on()
    }
}
