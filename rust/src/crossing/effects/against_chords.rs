//! The engine under effects: a cubic against the chords that stand for it, and pixels that rest against pixels that are
//! followed.
//!
//! Chords are given to the engine as sparse samples. It takes these pixel by pixel, as straight lines, while it takes
//! the chords of a cubic for many pixels at a time.

use proptest::prelude::*;

use super::chords::number_of_chords;
use super::filtered::filter;
use super::hot_pixels::{Arrivals, HotPixelNoise};
use super::input::{Chord, Input};
use super::leak::Leaks;
use super::noise_path::{NoisePath, ShotNoisePath};
use super::parameters::{Effects, HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise};
use super::shot_noise::{FAR, ShotNoiseLaw};
use super::timeline::{FREE, Pixel, WHOLE};
use super::two_poles::{Decays, filter_twice};
use crate::crossing::cubic::Cubic;
use crate::crossing::engine::CrossingEngine;
use crate::crossing::frame::{Frame, SparseSamples};
use crate::crossing::level::{Level, Thresholds};
use crate::crossing::line::Line;
use crate::crossing::parameters::{CrossingParameters, Interpolation};
use crate::event::{Event, SensorSize};
use crate::random::{Draw, Purpose};

const SIZE: SensorSize = SensorSize { width: 30, height: 20 };

/// Both kinds of low-pass with all other effects.
fn effects(source_follower_hz: f64) -> Effects {
    let none = Effects::default();
    Effects {
        photoreceptor_bandwidth: PhotoreceptorBandwidth { hz: 800.0, source_follower_hz },
        refractory_period_us: 300.0,
        leak: Leak { rate_hz: 20.0, spread: 0.2, jitter: 0.1, ..none.leak },
        shot_noise: ShotNoise { rms: 0.1, floor: 0.01, half_luma: 1.0, bandwidth_hz: 300.0 },
        hot_pixels: HotPixels { fraction: 0.2, rate_hz: 200.0, ..none.hot_pixels },
        ..none
    }
}

/// A number from -1 to 1 that belongs to a pixel of a frame.
fn spread(frame: u64, pixel: usize) -> f64 {
    2.0 * Draw::at(7, Purpose::HotPixelKind, u32::try_from(pixel).expect("small"), frame).uniform() - 1.0
}

/// The nodes of the chords that a cubic takes, between its ends: (tick, log intensity).
#[allow(clippy::cast_precision_loss, clippy::cast_possible_wrap, reason = "small")]
fn nodes(line: Line, slopes: (f64, f64), tolerance: f64) -> Vec<(i64, f64)> {
    let chords = number_of_chords(slopes, line.to - line.from, tolerance, line.ticks) as i64;
    let cubic = Cubic::new(line, slopes.0, slopes.1);
    let tick = |k: i64| line.ticks * k / chords;
    (1..chords).map(|k| (tick(k), cubic.at(tick(k) as f64 / line.ticks as f64))).collect()
}

/// Frames of very different change and bend: the engine makes the same events, whether it takes the chords itself or is
/// given them. Every seventh pixel has a sparse sample of its own. Builds without optimization try fewer frames.
#[test]
#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small")]
fn cubics_are_the_chords_that_stand_for_them() {
    let frames = if cfg!(debug_assertions) { 6 } else { 40 };
    for (source_follower_hz, strength) in [(f64::INFINITY, 1.0), (250.0, 1.0), (250.0, 0.1), (5000.0, 3.0)] {
        let (lines, effects) = (CrossingParameters::default(), effects(source_follower_hz));
        let cubics = CrossingParameters { interpolation: Interpolation::Hermite, ..lines.clone() };
        let tolerance = 0.01 * lines.least_threshold();
        let engine = |p| CrossingEngine::with_effects(SIZE, p, &effects, 3, Some(1)).expect("valid");
        let (mut taken, mut given) = (engine(cubics), engine(lines));
        let (mut bent, mut count, mut t_us) = (0, 0, 0);
        let mut last: Option<(Vec<f64>, Vec<f64>)> = None;
        for frame in 0..frames {
            let ticks = [4772, 937, 13, 3, 1, 20_011][usize::try_from(frame % 6).expect("small")];
            let still = |i: usize| if i.is_multiple_of(5) { 0.0 } else { strength };
            let logs: Vec<f64> = (0..SIZE.pixels()).map(|i| still(i) * spread(frame, i)).collect();
            let rates: Vec<f64> =
                (0..SIZE.pixels()).map(|i| still(i) * 3e6 / ticks as f64 * spread(frame + 1000, i)).collect();
            let (mut both, mut chords) = (vec![], vec![]);
            if let Some((from, slopes)) = &last {
                for i in 0..SIZE.pixels() {
                    let line = Line { from: from[i], to: logs[i], ticks };
                    let seconds = ticks as f64 * 1e-6;
                    let nodes = nodes(line, (slopes[i] * seconds, rates[i] * seconds), tolerance);
                    let own = i.is_multiple_of(7) && ticks > 1;
                    bent += usize::from(!nodes.is_empty() && !own);
                    let samples = if own { vec![(ticks / 2, spread(frame + 2000, i))] } else { nodes };
                    let samples = samples.iter().map(|&(tick, log)| (i as u32, t_us + tick, log));
                    both.extend(samples.clone().filter(|_| own));
                    chords.extend(samples);
                }
            }
            t_us += if frame == 0 { 0 } else { ticks };
            let push = |engine: &mut CrossingEngine, rate, sparse: &[(u32, i64, f64)]| {
                let pixel: Vec<u32> = sparse.iter().map(|sample| sample.0).collect();
                let times: Vec<i64> = sparse.iter().map(|sample| sample.1).collect();
                let samples: Vec<f64> = sparse.iter().map(|sample| sample.2).collect();
                let sparse = SparseSamples { pixel: &pixel, t_us: &times, samples: &samples };
                let mut events = Vec::<Event>::new();
                engine.push_log(Frame { t_us, samples: &logs, rate, sparse }, &mut events).expect("valid");
                events
            };
            let events = push(&mut taken, Some(&rates), &both);
            assert_eq!(events, push(&mut given, None, &chords), "frame {frame} of {source_follower_hz} Hz");
            count += events.len();
            last = Some((logs, rates));
        }
        assert!(bent.min(count) > 75 * usize::try_from(frames).expect("small"), "{bent} {count}");
    }
}

/// A pixel's state at the start of an interval, in which noise arrives or does not.
#[derive(Clone, Debug, PartialEq)]
struct State {
    reference: Level,
    held_until_us: f64,
    /// The standard deviation of shot noise, and which path it takes; so far from zero it may be.
    noise: Option<(f64, u32)>,
    hot: Option<Arrivals>,
}

const TICKS: i64 = 1000;

/// FREE, or at some time within the interval or after it.
fn until() -> impl Strategy<Value = f64> {
    prop_oneof![3 => Just(FREE), 1 => 1e-3f64..2000.0, 1 => 999.0f64..1001.0]
}

fn state() -> impl Strategy<Value = State> {
    let arrivals = || prop::option::weighted(0.3, 1e-3f64..4000.0);
    let arrived = |wait_us| Arrivals { wait_us, index: 5 };
    let noise = prop::option::weighted(0.3, (1e-3f64..0.02, 0u32..1000));
    (-0.3f64..0.3, 0u32..3, 0u32..3, until(), noise, arrivals()).prop_map(
        move |(base, on, off, held_until_us, noise, hot)| State {
            reference: Level { base, on, off },
            held_until_us,
            noise,
            hot: hot.map(arrived),
        },
    )
}

impl State {
    /// Takes the pixel through a call, and returns its events.
    fn through(&mut self, call: impl FnOnce(&mut Pixel<'_>, &mut dyn FnMut(i64, bool))) -> Vec<(i64, bool)> {
        let effects = effects(250.0);
        let noise = self.noise.map(|(rms, pixel)| {
            let shot_noise = ShotNoise { rms, half_luma: f64::INFINITY, floor: 0.0, ..effects.shot_noise };
            (ShotNoiseLaw::new(&Effects { shot_noise, ..effects.clone() }, 3).expect("on"), pixel)
        });
        let mut path = noise.as_ref().map(|(law, pixel)| NoisePath::new(law, *pixel, 0.0));
        let hot = HotPixelNoise::new(&effects, 3);
        let mut events = vec![];
        let mut pixel = Pixel {
            number: 4,
            c: Thresholds { on: 0.11, off: 0.13 },
            reference: &mut self.reference,
            held_until_us: &mut self.held_until_us,
            refractory_us: 300.0,
            window_us: WHOLE,
            leak_jitter: None,
            shot_noise: noise.as_ref().zip(path.as_mut()).map(|((law, pixel), path)| {
                let reach = FAR * law.sigma(0.0);
                ShotNoisePath { law, pixel: *pixel, path, elapsed_us: 0.0, reach, last: None }
            }),
            hot: hot.zip(self.hot.as_mut()),
        };
        call(&mut pixel, &mut |tick, on| events.push((tick, on)));
        events
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    /// Wherever the engine lets a pixel rest, following it would have changed nothing.
    #[test]
    fn a_pixel_that_rests_would_have_no_event(
        state in state(), from in -0.3f64..0.3, to in -0.3f64..0.3, outputs in (-0.3f64..0.3, -0.3f64..0.3),
        beyond in prop::option::weighted(0.2, -1e-3f64..1e-3), first in -2.0f64..2.0, second in -2.0f64..2.0, twice in any::<bool>(), leak_hz in prop_oneof![Just(0.0), 1.0f64..500.0],
    ) {
        let c = Thresholds { on: 0.11, off: 0.13 };
        let mut decays = Decays { first: 10f64.powf(first), second: 10f64.powf(second) };
        let (mut from, mut to, mut outputs) = (from, to, outputs);
        if let Some(beyond) = beyond {
            // From below to next to a level, and fast enough to come there.
            let level = state.reference.up().value(c);
            let below = |value: f64| level - 0.7 * value.abs();
            (from, to, outputs) = (below(from), level + beyond, (below(outputs.0), below(outputs.1)));
            decays = Decays { first: 10.0 * decays.first.max(1.0), second: 10.0 * decays.second.max(1.0) };
        }
        let leak = Leak { rate_hz: leak_hz, ..Effects::default().leak };
        let drift = Leaks::new(leak, 3, true, 0, &[c]).drift(0, 2000.0, (from, to));
        let input = Input { drift, from, to, ticks: TICKS };
        let chord = Chord { start: 0, ticks: TICKS, from, to };
        let light = |t| chord.log_light_at(t);
        let (mut rested, mut followed) = (state.clone(), state);
        let (events, expected) = if twice {
            let end = filter_twice(outputs, from, to, decays).second;
            let curve = input.filtered_twice(&chord, decays, outputs, end);
            (
                rested.through(|pixel, emit| input.follow_filtered_twice(pixel, &chord, decays, outputs, end, emit)),
                followed.through(|pixel, emit| pixel.follow(&curve, 0, light, emit)),
            )
        } else {
            let outputs = (outputs.0, filter(outputs.0, from, to, decays.first));
            let curve = input.filtered(&chord, decays.first, outputs);
            (
                rested.through(|pixel, emit| input.follow_filtered(pixel, &chord, decays.first, outputs, emit)),
                followed.through(|pixel, emit| pixel.follow(&curve, 0, light, emit)),
            )
        };
        prop_assert_eq!(events, expected);
        prop_assert_eq!(rested, followed);
    }
}
