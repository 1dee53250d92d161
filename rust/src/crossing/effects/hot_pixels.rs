//! Hot pixels: a few that fire by themselves, whatever they see.

use super::noise::Arrivals;
use super::parameters::{Effects, HotPixels};
use crate::random::{Draw, Purpose};

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
        (hot.fraction > 0.0 && hot.rate_hz > 0.0).then_some(Self { seed, hot })
    }

    /// Whether a pixel is among them.
    pub(super) fn chosen(&self, pixel: u32) -> bool {
        self.draw(pixel, u64::MAX).uniform() < self.hot.fraction
    }

    /// The process at its beginning.
    pub(super) fn first(&self, pixel: u32) -> Arrivals {
        Arrivals { wait_us: self.wait_us(pixel, 0), index: 0 }
    }

    /// Moves on to the next arrival.
    pub(super) fn advance(&self, pixel: u32, arrivals: &mut Arrivals) {
        arrivals.index += 1;
        arrivals.wait_us += self.wait_us(pixel, arrivals.index);
    }

    fn wait_us(&self, pixel: u32, index: u64) -> f64 {
        self.draw(pixel, index).exponential() * (1e6 / self.hot.rate_hz)
    }

    fn draw(&self, pixel: u32, index: u64) -> Draw {
        Draw::at(self.seed, Purpose::HotPixels, pixel, index)
    }
}
