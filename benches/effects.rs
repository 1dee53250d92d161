//! What each effect costs: nanoseconds a pixel and frame, on a moving texture.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use davis_rs::{
    CrossingEngine, CrossingParameters, Effects, Event, Frame, HotPixels, Leak, PhotoreceptorBandwidth,
    ReadoutParameters, SensorSize, ShotNoise, ThresholdMismatch,
};

mod common;
use common::{FRAMES, sequence, spread};

const SIZE: SensorSize = SensorSize { width: 240, height: 180 };

/// Every effect alone at a usual strength, and all of them.
fn cases() -> Vec<(&'static str, Effects)> {
    let none = Effects::default;
    let bandwidth = PhotoreceptorBandwidth { hz: 1000.0, source_follower_hz: f64::INFINITY };
    let both = PhotoreceptorBandwidth { source_follower_hz: 300.0, ..bandwidth };
    let shot_noise = ShotNoise { rms: 0.05, floor: 0.0, half_luma: 1.0, bandwidth_hz: 300.0 };
    let hot_pixels = HotPixels { fraction: 1e-3, rate_hz: 10.0, ..none().hot_pixels };
    let leak = Leak { rate_hz: 0.1, spread: 0.23, jitter: 0.1, ..none().leak };
    let threshold_mismatch = ThresholdMismatch { sigma: 0.05, ..none().threshold_mismatch };
    let readout = Some(ReadoutParameters {
        events_per_s: 9e6,
        row_us: 0.32,
        latency_us: 3.0,
        jitter_us: 1.0,
        drop_after_us: None,
        by_columns: false,
    });
    vec![
        ("none", none()),
        ("photoreceptor_bandwidth_hz", Effects { photoreceptor_bandwidth: bandwidth, ..none() }),
        ("with a source follower", Effects { photoreceptor_bandwidth: both, ..none() }),
        ("threshold_mismatch", Effects { threshold_mismatch, ..none() }),
        ("refractory_period_us", Effects { refractory_period_us: 100.0, ..none() }),
        ("leak_rate_hz", Effects { leak, ..none() }),
        ("shot_noise_rms", Effects { shot_noise, ..none() }),
        ("hot_pixels", Effects { hot_pixels, ..none() }),
        ("readout", Effects { readout, ..none() }),
        (
            "all",
            Effects {
                photoreceptor_bandwidth: both,
                threshold_mismatch,
                refractory_period_us: 100.0,
                leak,
                shot_noise,
                hot_pixels,
                readout,
            },
        ),
    ]
}

fn effects(c: &mut Criterion) {
    for (speed, step) in [("dense: 1/3 px a frame", 1.0 / 3.0), ("quiet: 0.02 px a frame", 0.02)] {
        let frames = sequence(SIZE, step);
        let first = spread(&frames[0]);
        let mut group = c.benchmark_group(speed);
        group.throughput(Throughput::Elements(SIZE.pixels() as u64 * u64::from(FRAMES))).sample_size(20);
        for (name, effects) in cases() {
            group.bench_function(name, |b| {
                b.iter(|| {
                    let parameters = CrossingParameters::default();
                    let mut engine =
                        CrossingEngine::with_effects(SIZE, parameters, &effects, 1, Some(1)).expect("valid");
                    let mut events = Vec::<Event>::new();
                    engine.push(Frame::new(0, &first), &mut events).expect("valid");
                    for (t_us, frame) in (1000..).step_by(1000).zip(&frames) {
                        engine.push(Frame::new(t_us, frame), &mut events).expect("valid");
                        black_box(&events);
                    }
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, effects);
criterion_main!(benches);
