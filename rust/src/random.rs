//! Random draws that are a function of (seed, purpose, pixel, index) alone.
//!
//! A draw is named by (seed, purpose, pixel, index): whoever asks for it, on whatever thread and after whatever other
//! draws, gets the same. The generator is Philox 4x32 with ten rounds: Salmon, Moraes, Dror and Shaw, "Parallel random
//! numbers: as easy as 1, 2, 3", SC 2011.

use crate::log_intensity::ln;

/// What a draw is for; each effect has its own, so that adding one does not change the draws of another.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
pub(crate) enum Purpose {
    ThresholdOn = 1,
    ThresholdOff = 2,
    StartPhase = 3,
    ShotNoise = 4,
    HotPixels = 5,
    ReadoutJitter = 6,
    LeakSpread = 8,
    LeakJitter = 9,
    HotPixelKind = 10,
    ThresholdColumn = 11,
    ThresholdRow = 12,
    LightPath = 13,
}

/// 128 random bits, a function of (seed, purpose, pixel, index).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Draw([u32; 4]);

impl Draw {
    pub(crate) fn at(seed: u64, purpose: Purpose, pixel: u32, index: u64) -> Self {
        let [low, high] = halves(index);
        Self(philox(halves(seed), [low, high, pixel, purpose as u32]))
    }

    /// Returns a number uniform in (0, 1), 52 bits: from the first half.
    pub(crate) fn uniform(self) -> f64 {
        // 32 bits and 20 more; the half keeps it clear of both ends.
        let integer = f64::from(self.0[0]) * 1_048_576.0 + f64::from(self.0[1] >> 12);
        (integer + 0.5) / 4_503_599_627_370_496.0
    }

    /// Returns a number uniform in (0, 1), 32 bits: from the third quarter.
    pub(crate) fn second_uniform(self) -> f64 {
        (f64::from(self.0[2]) + 0.5) / 4_294_967_296.0
    }

    /// Returns an exponential number with mean 1.
    pub(crate) fn exponential(self) -> f64 {
        -ln(self.uniform())
    }

    /// Returns two independent normal numbers with mean 0 and variance 1 (Box and Muller).
    pub(crate) fn normals(self) -> (f64, f64) {
        let radius = (2.0 * self.exponential()).sqrt();
        let (sine, cosine) = libm::sincos(std::f64::consts::TAU * self.second_uniform());
        (radius * cosine, radius * sine)
    }

    /// Returns the first of [`Self::normals`].
    pub(crate) fn normal(self) -> f64 {
        (2.0 * self.exponential()).sqrt() * libm::cos(std::f64::consts::TAU * self.second_uniform())
    }
}

#[allow(clippy::cast_possible_truncation, reason = "the two halves")]
fn halves(x: u64) -> [u32; 2] {
    [x as u32, (x >> 32) as u32]
}

fn philox(mut key: [u32; 2], mut counter: [u32; 4]) -> [u32; 4] {
    for _ in 0..10 {
        let [low_0, high_0] = halves(u64::from(counter[0]) * 0xd251_1f53);
        let [low_2, high_2] = halves(u64::from(counter[2]) * 0xcd9e_8d57);
        counter = [high_2 ^ counter[1] ^ key[0], low_2, high_0 ^ counter[3] ^ key[1], low_0];
        key = [key[0].wrapping_add(0x9e37_79b9), key[1].wrapping_add(0xbb67_ae85)];
    }
    counter
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers that come with Random123.
    #[test]
    fn it_is_philox_4x32_10() {
        assert_eq!(philox([0; 2], [0; 4]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox([u32::MAX; 2], [u32::MAX; 4]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        let pi = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
        assert_eq!(philox([0xa409_3822, 0x299f_31d0], pi), [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]);
    }

    /// 200,000 draws: mean and variance within five standard errors.
    #[test]
    fn draws_have_their_moments() {
        let draws: Vec<Draw> = (0..200_000).map(|i| Draw::at(7, Purpose::ShotNoise, 3, i)).collect();
        let check = |name: &str, of: fn(Draw) -> f64, mean: f64, variance: f64, kurtosis: f64| {
            let n = 200_000.0;
            let got = draws.iter().map(|&d| of(d)).sum::<f64>() / n;
            let spread = draws.iter().map(|&d| (of(d) - mean).powi(2)).sum::<f64>() / n;
            assert!((got - mean).abs() < 5.0 * (variance / n).sqrt(), "{name}: mean {got}");
            assert!((spread - variance).abs() < 5.0 * variance * ((kurtosis - 1.0) / n).sqrt(), "{name}: {spread}");
        };
        check("uniform", Draw::uniform, 0.5, 1.0 / 12.0, 1.8);
        check("second uniform", Draw::second_uniform, 0.5, 1.0 / 12.0, 1.8);
        check("exponential", Draw::exponential, 1.0, 1.0, 9.0);
        check("normal", Draw::normal, 0.0, 1.0, 3.0);
    }

    #[test]
    fn every_part_of_the_name_counts() {
        let bits = |seed, purpose, pixel, index| Draw::at(seed, purpose, pixel, index).0;
        let first = bits(0, Purpose::ShotNoise, 0, 0);
        for other in [
            bits(1, Purpose::ShotNoise, 0, 0),
            bits(1 << 32, Purpose::ShotNoise, 0, 0),
            bits(0, Purpose::HotPixels, 0, 0),
            bits(0, Purpose::ShotNoise, 1, 0),
            bits(0, Purpose::ShotNoise, 0, 1),
            bits(0, Purpose::ShotNoise, 0, 1 << 32),
        ] {
            assert_ne!(first, other);
        }
    }
}
