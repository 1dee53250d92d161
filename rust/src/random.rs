//! Random draws that are a function of (seed, purpose, pixel, index) alone.
//!
//! A draw is named by (seed, purpose, pixel, index): whoever asks for it, on whatever thread and after whatever other
//! draws, gets the same. The generator is Philox 4x32 with ten rounds: Salmon, Moraes, Dror and Shaw, "Parallel random
//! numbers: as easy as 1, 2, 3", SC 2011.

use multiversion::multiversion;

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
    ReadoutRequest = 14,
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
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
    pub(crate) fn uniform(self) -> f64 {
        // 32 bits and 20 more; the half keeps it clear of both ends.
        let integer = f64::from(self.0[0]) * 1_048_576.0 + f64::from(self.0[1] >> 12);
        (integer + 0.5) / 4_503_599_627_370_496.0
    }

    /// Returns a number uniform in (0, 1), 32 bits: from the third quarter.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
    pub(crate) fn second_uniform(self) -> f64 {
        (f64::from(self.0[2]) + 0.5) / 4_294_967_296.0
    }

    /// Returns an exponential number with mean 1.
    pub(crate) fn exponential(self) -> f64 {
        -ln(self.uniform())
    }

    /// Returns two independent normal numbers with mean 0 and variance 1 (Box and Muller).
    pub(crate) fn normals(self) -> (f64, f64) {
        normals_of(self.uniform(), self.second_uniform())
    }

    /// Returns a normal number with mean 0 and variance 1, by the C library's cosine.
    pub(crate) fn normal(self) -> f64 {
        (2.0 * self.exponential()).sqrt() * libm::cos(std::f64::consts::TAU * self.second_uniform())
    }
}

/// Two normal numbers of two uniform ones (Box and Muller), without branches.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
fn normals_of(uniform: f64, turns: f64) -> (f64, f64) {
    let radius = (-2.0 * ln(uniform)).sqrt();
    let (sine, cosine) = sine_and_cosine(turns);
    (radius * cosine, radius * sine)
}

/// The sine and cosine of so many turns, 0 to 1, within 2e-16, by Taylor's series about quarters of a turn.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
fn sine_and_cosine(turns: f64) -> (f64, f64) {
    /// 1.5 * 2^52: adding it rounds to an integer, in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    // 1 / n! with alternating signs; the next terms are 0.79^17 / 17! = 5e-17 and 0.79^18 / 18! = 2e-18.
    const SINE: [f64; 7] = [
        -1.0 / 1_307_674_368_000.0,
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5_040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
    ];
    const COSINE: [f64; 8] = [
        1.0 / 20_922_789_888_000.0,
        -1.0 / 87_178_291_200.0,
        1.0 / 479_001_600.0,
        -1.0 / 3_628_800.0,
        1.0 / 40_320.0,
        -1.0 / 720.0,
        1.0 / 24.0,
        -0.5,
    ];
    let shifted = 4.0 * turns + ROUND;
    let angle = std::f64::consts::TAU * (turns - 0.25 * (shifted - ROUND));
    let square = angle * angle;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for coefficient in SINE {
        sine = (sine + coefficient) * square;
    }
    for coefficient in COSINE {
        cosine = (cosine + coefficient) * square;
    }
    let (sine, cosine) = (angle + angle * sine, 1.0 + cosine);
    let quarter = shifted.to_bits();
    let (first, second) = if quarter & 1 == 0 { (sine, cosine) } else { (cosine, sine) };
    let signed = |value: f64, negative: u64| f64::from_bits(value.to_bits() ^ ((negative & 2) << 62));
    (signed(first, quarter), signed(second, quarter.wrapping_add(1)))
}

/// How many draws are made at a time.
const LANES: usize = 16;

/// Two normal numbers of each of many draws of a purpose, those of [`Draw::normals`] to the last bit.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::cast_possible_truncation, reason = "the halves of 64 bits")]
pub(crate) fn many_normals(
    seed: u64,
    purpose: Purpose,
    (pixels, indices): (&[u32], &[u64]),
    (first, second): (&mut [f64], &mut [f64]),
) {
    let n = pixels.len();
    let (indices, first, second) = (&indices[..n], &mut first[..n], &mut second[..n]);
    for start in (0..n).step_by(LANES) {
        let end = (start + LANES).min(n);
        let (mut low, mut high, mut pixel) = ([0; LANES], [0; LANES], [0; LANES]);
        let mut last = [purpose as u32; LANES];
        for (lane, i) in (start..end).enumerate() {
            (low[lane], high[lane], pixel[lane]) = (indices[i] as u32, (indices[i] >> 32) as u32, pixels[i]);
        }
        let mut key = halves(seed);
        for _ in 0..ROUNDS {
            for lane in 0..LANES {
                let counter = [low[lane], high[lane], pixel[lane], last[lane]];
                [low[lane], high[lane], pixel[lane], last[lane]] = philox_round(key, counter);
            }
            key = next_key(key);
        }
        let mut normals = [(0.0, 0.0); LANES];
        for lane in 0..LANES {
            let draw = Draw([low[lane], high[lane], pixel[lane], last[lane]]);
            normals[lane] = normals_of(draw.uniform(), draw.second_uniform());
        }
        for (lane, i) in (start..end).enumerate() {
            (first[i], second[i]) = normals[lane];
        }
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
#[allow(clippy::cast_possible_truncation, reason = "the two halves")]
fn halves(x: u64) -> [u32; 2] {
    [x as u32, (x >> 32) as u32]
}

const ROUNDS: usize = 10;

fn philox(mut key: [u32; 2], mut counter: [u32; 4]) -> [u32; 4] {
    for _ in 0..ROUNDS {
        counter = philox_round(key, counter);
        key = next_key(key);
    }
    counter
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
fn philox_round(key: [u32; 2], counter: [u32; 4]) -> [u32; 4] {
    let [low_0, high_0] = halves(u64::from(counter[0]) * 0xd251_1f53);
    let [low_2, high_2] = halves(u64::from(counter[2]) * 0xcd9e_8d57);
    [high_2 ^ counter[1] ^ key[0], low_2, high_0 ^ counter[3] ^ key[1], low_0]
}

fn next_key(key: [u32; 2]) -> [u32; 2] {
    [key[0].wrapping_add(0x9e37_79b9), key[1].wrapping_add(0xbb67_ae85)]
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

    /// Any number of draws at a time, in vector code or not.
    #[test]
    fn many_draws_are_single_ones_to_the_bit() {
        for n in [0, 1, 15, 16, 17, 100] {
            let pixels: Vec<u32> = (0..n).map(|i| 7 * i).collect();
            let indices: Vec<u64> = (0..u64::from(n)).map(|i| i << 30).collect();
            let (mut first, mut second) = (vec![0.0; n as usize], vec![0.0; n as usize]);
            many_normals(1 << 40, Purpose::ShotNoise, (&pixels, &indices), (&mut first, &mut second));
            for i in 0..n as usize {
                let (a, b) = Draw::at(1 << 40, Purpose::ShotNoise, pixels[i], indices[i]).normals();
                assert_eq!((first[i].to_bits(), second[i].to_bits()), (a.to_bits(), b.to_bits()));
            }
        }
    }

    /// All around, and where quarters meet.
    #[test]
    fn sines_and_cosines_are_those_of_libm() {
        for k in 0..=40_000u32 {
            let turns = f64::from(k) / 40_000.0;
            let (sine, cosine) = sine_and_cosine(turns);
            let angle = std::f64::consts::TAU * turns;
            assert!((sine - libm::sin(angle)).abs() < 1e-15 && (cosine - libm::cos(angle)).abs() < 1e-15, "{turns}");
        }
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
