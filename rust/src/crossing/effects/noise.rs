//! Noise events: says which process an arrival belongs to, so that [`super::timeline`] treats all kinds alike.

use super::arrivals::Arrivals;
use super::hot_pixels::HotPixelNoise;
use super::shot_noise::ShotNoiseLaw;
use crate::crossing::level::Thresholds;

/// A kind of noise, the same in every pixel that has it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Noise {
    /// Noise of all pixels: [`super::shot_noise`].
    Shot(ShotNoiseLaw),
    /// Noise of a few pixels: [`super::hot_pixels`].
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
