//! The whole engine against the rule of [`super::pixel`] alone, on seeded walks of every kind of pixel.
//!
//! The rule takes each pixel through each interval, and a stable sort by time orders its events: nothing of what makes
//! the engine fast. Walks are quiet, dense, jump over many levels, end on levels and next to them, and come back to their
//! first value to the bit. Threads, thresholds, curves, sparse samples and lengths of intervals change from run to run.

use super::cubic::Cubic;
use super::engine::{CrossingEngine, Feed};
use super::frame::{Frame, SparseSamples};
use super::level::{Level, Thresholds};
use super::line::Line;
use super::parameters::{CrossingParameters, Interpolation, Threshold};
use super::pixel::follow;
use crate::event::{Event, SensorSize};

/// Random numbers: Steele, Lea and Flood's `SplitMix64`, OOPSLA 2014.
struct Random(u64);

#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small")]
impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// In 1..=n.
    fn ticks(&mut self, n: i64) -> i64 {
        1 + (self.next() % n.cast_unsigned()).cast_signed()
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.next() >> 11) as f64 / (1u64 << 53) as f64)
    }
}

/// What a walk's samples are made of.
trait Walked: Feed + Default {
    fn of(log: f64, log_eps: f64) -> Self;

    /// The rate of change that goes with one of log intensity.
    fn rate_of(log_rate: f64, sample: Self, log_eps: f64) -> Self;
}

impl Walked for f64 {
    fn of(log: f64, _: f64) -> Self {
        log
    }

    fn rate_of(log_rate: f64, _: f64, _: f64) -> Self {
        log_rate
    }
}

impl Walked for f32 {
    #[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
    fn of(log: f64, log_eps: f64) -> Self {
        (log.exp() - log_eps).max(0.0) as f32
    }

    #[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
    fn rate_of(log_rate: f64, sample: f32, log_eps: f64) -> Self {
        (log_rate * (f64::from(sample) + log_eps)) as f32
    }
}

fn log<S: Feed>(sample: S, log_eps: f64) -> f64 {
    let mut log = [0.0];
    S::logs(&[sample], log_eps, &mut log);
    log[0]
}

fn line_change<S: Feed>(from: f64, to: S, log_eps: f64) -> f64 {
    log(to, log_eps) - from
}

/// A pixel by the rule alone.
struct Slow<S> {
    level: Level,
    first: f64,
    last: S,
    rate: S,
    last_event_us: i64,
}

/// Where a pixel's log intensity goes next: a step of its kind, or a level of its own, or nearly, or its first value.
fn next_log<S>(pixel: &Slow<S>, from: f64, c: Thresholds, kind: usize, random: &mut Random) -> f64 {
    let level = |steps: i32| {
        let value = pixel.level.value(c);
        value + f64::from(steps) * if steps > 0 { c.on } else { c.off }
    };
    let to = match (kind, random.below(40)) {
        (_, 0) => pixel.first,
        (_, 1) => level([-2, -1, 1, 2][random.below(4)]),
        (_, 2) => level([-1, 1][random.below(2)]) * (1.0 + random.uniform(-4e-16, 4e-16)),
        (_, 3) => from + random.uniform(-8.0, 8.0) * c.on,
        (0, _) => from,
        (1, _) => from + random.uniform(-0.02, 0.02) * c.on,
        (2, _) => from + random.uniform(-0.6, 0.6) * c.on,
        (3, _) => from + random.uniform(0.0, 1.4) * c.on,
        _ => from + random.uniform(-2.5, 2.5) * c.off,
    };
    if to.abs() < 8.0 { to } else { pixel.first }
}

/// Runs `frames` frames through both, and compares all that they tell.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::too_many_lines,
    reason = "small; one story"
)]
fn compare<S: Walked>(seed: u64, frames: usize) {
    let mut random = Random(seed);
    let size = SensorSize { width: 1 + random.below(90) as u16, height: 1 + random.below(40) as u16 };
    let n = size.pixels();
    let [on, off] = [0; 2].map(|_| random.uniform(0.02, 0.4));
    let off = [on, off][random.below(2)];
    let each = random.below(3) == 0;
    let mut threshold = |c: f64| {
        let of_pixels = (0..n).map(|_| c * random.uniform(0.9, 1.1));
        if each { Threshold::PerPixel(of_pixels.collect()) } else { Threshold::Uniform(c) }
    };
    let (contrast_threshold, contrast_threshold_off) = (threshold(on), threshold(off));
    let hermite = random.below(3) == 0;
    let parameters = CrossingParameters {
        contrast_threshold,
        contrast_threshold_off,
        log_eps: [1e-3, 1e-12, 0.5][random.below(3)],
        interpolation: if hermite { Interpolation::Hermite } else { Interpolation::Linear },
        ..CrossingParameters::default()
    };
    let (eps, threads) = (parameters.log_eps, [1, 1, 3][random.below(3)]);
    let context = format!("seed {seed}: {size:?}, {threads} threads, C = {on} {off}, each: {each}, Hermite: {hermite}");
    let mut engine = CrossingEngine::new(size, parameters.clone(), Some(threads)).unwrap();
    let mut t_us = random.ticks(1 << 40);
    let quiet = random.below(2) == 0;
    let mut pixels: Vec<Slow<S>> = (0..n)
        .map(|_| {
            let last = S::of(random.uniform(-5.0, 2.0), eps);
            let first = log(last, eps);
            Slow { level: Level { base: first, on: 0, off: 0 }, first, last, rate: S::default(), last_event_us: -1 }
        })
        .collect();
    let kinds: Vec<usize> = (0..n).map(|_| random.below(if quiet { 2 } else { 5 })).collect();
    let (mut samples, mut rates): (Vec<S>, Vec<S>) =
        (pixels.iter().map(|pixel| pixel.last).collect(), vec![S::default(); n]);
    let mut events = vec![];
    let mut frame = Frame::new(t_us, &samples[..]);
    frame.rate = hermite.then_some(&rates[..]);
    engine.take(frame, &mut events).unwrap();
    for k in 0..frames {
        let ticks = [random.ticks(20), 1000, random.ticks(100_000)][random.below(3)];
        let seconds = ticks as f64 * 1e-6;
        let (mut between, mut expected) = ((vec![], vec![], vec![]), vec![]);
        let brings_sparse = ticks > 10 && random.below(3) == 0;
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let c = parameters.thresholds(i);
            let from = log(pixel.last, eps);
            let now = S::of(next_log(pixel, from, c, kinds[i], &mut random), eps);
            let change = [line_change(from, now, eps), random.uniform(-1.5, 1.5) * c.on, f64::NAN];
            let rate = S::rate_of(change[random.below(9).saturating_sub(6)] / seconds, now, eps);
            let mut nodes = vec![];
            if brings_sparse && random.below(20) == 0 {
                let sample = S::of(next_log(pixel, from, c, 4, &mut random), eps);
                let tick = random.ticks(ticks - 1);
                nodes.push((tick, log(sample, eps)));
                between.0.push(i as u32);
                between.1.push(t_us + tick);
                between.2.push(sample);
            }
            let (x, y) = size.xy(i);
            let mut emit = |t_us, on| {
                expected.push(Event::new(t_us, x, y, on));
                pixel.last_event_us = t_us;
            };
            let line = Line { from, to: log(now, eps), ticks };
            if hermite && nodes.is_empty() {
                let slope = |sample: S, rate| sample.log_rate(rate, eps) * seconds;
                let cubic = Cubic::new(line, slope(pixel.last, pixel.rate), slope(now, rate));
                follow(&mut pixel.level, &cubic, t_us, c, &mut emit);
            } else {
                let (mut start, mut from) = (0, from);
                for (tick, to) in nodes.into_iter().chain([(ticks, line.to)]) {
                    follow(&mut pixel.level, &Line { from, to, ticks: tick - start }, t_us + start, c, &mut emit);
                    (start, from) = (tick, to);
                }
            }
            (pixel.last, pixel.rate, samples[i], rates[i]) = (now, rate, now, rate);
        }
        expected.sort_by_key(|event| event.t);
        t_us += ticks;
        let mut frame = Frame::new(t_us, &samples[..]);
        frame.rate = hermite.then_some(&rates[..]);
        frame.sparse = SparseSamples { pixel: &between.0, t_us: &between.1, samples: &between.2 };
        engine.take(frame, &mut events).unwrap();
        assert!(events == expected, "{context}, frame {k}: {} events, not {}", events.len(), expected.len());
    }
    let state = engine.state();
    assert!(pixels.iter().map(|pixel| pixel.last_event_us).eq(state.last_event_us), "{context}");
    assert!(
        pixels.iter().map(|pixel| (pixel.level.on, pixel.level.off)).eq(state.on.into_iter().zip(state.off)),
        "{context}"
    );
}

/// Of both kinds of samples, until so many pixel-frames have been compared.
fn compare_many(pixel_frames: usize) {
    // An average sensor has some 900 pixels, for 20 frames.
    for seed in 0..pixel_frames as u64 / 18_000 {
        if seed % 2 == 0 { compare::<f32>(seed, 20) } else { compare::<f64>(seed, 20) }
    }
}

#[test]
fn the_engine_makes_the_events_of_the_rule() {
    compare_many(400_000);
}

#[test]
#[ignore = "takes minutes"]
fn the_engine_makes_the_events_of_the_rule_at_length() {
    compare_many(12_000_000);
}
