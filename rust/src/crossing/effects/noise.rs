//! Noise events: arrivals of processes of their own in each pixel, each a function of (seed, purpose, pixel, number of the
//! arrival).
//!
//! What must not break: arrivals depend neither on how the signal is sampled in time nor on what the pixel sees. The
//! pixel may drop an arrival, and the next one comes when it would have come.

use super::hot_pixels::HotPixelNoise;
use super::shot_noise::ShotNoiseLaw;
use crate::crossing::level::Thresholds;

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
pub(crate) enum Noise {
    /// In all pixels: [`super::shot_noise`].
    Shot(ShotNoiseLaw),
    /// In a few: [`super::hot_pixels`].
    Hot(HotPixelNoise),
}

impl Noise {
    /// Moves on to the next arrival in a pixel of these thresholds.
    pub(crate) fn advance(&self, pixel: u32, c: Thresholds, arrivals: &mut Arrivals) {
        match self {
            Self::Shot(noise) => noise.advance(pixel, c, arrivals),
            Self::Hot(noise) => noise.advance(pixel, arrivals),
        }
    }
}
