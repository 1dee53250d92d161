//! The crossing engine on moving textures, one thread: pixels a second.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use davis_rs::{CrossingEngine, CrossingParameters, SensorSize};

const SIZE: SensorSize = SensorSize { width: 240, height: 180 };
const FRAMES: u16 = 40;

/// A texture of waves of 8 to 128 pixels, strength falling with frequency, moved by `step` pixels a frame.
fn sequence(step: f64) -> Vec<Vec<f32>> {
    let waves: Vec<(f64, f64, f64, f64)> = (0..24)
        .map(|i| {
            let length = 8.0 * 16f64.powf(f64::from(i) / 23.0);
            let angle = 2.4 * f64::from(i);
            let k = std::f64::consts::TAU / length;
            (k * angle.cos(), k * angle.sin(), 1.7 * f64::from(i), 0.0022 * length)
        })
        .collect();
    (0..FRAMES)
        .map(|frame| {
            let (shift_x, shift_y) = (f64::from(frame) * step, f64::from(frame) * step * 0.4);
            let pixel = |x: u16, y: u16| -> f64 {
                let (x, y) = (f64::from(x) - shift_x, f64::from(y) - shift_y);
                waves.iter().map(|(kx, ky, phase, strength)| strength * (kx * x + ky * y + phase).sin()).sum()
            };
            let pixels = (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (x, y)));
            #[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
            pixels.map(|(x, y)| (pixel(x, y) - 1.5).exp() as f32).collect()
        })
        .collect()
}

fn crossing(c: &mut Criterion) {
    let mut group = c.benchmark_group("crossing");
    group.throughput(Throughput::Elements(SIZE.pixels() as u64 * u64::from(FRAMES - 1)));
    group.sample_size(20);
    for (name, step) in [("dense: 1/3 px a frame", 1.0 / 3.0), ("quiet: 0.02 px a frame", 0.02), ("static", 0.0)] {
        let frames = sequence(step);
        let fresh = || {
            let mut engine = CrossingEngine::new(SIZE, CrossingParameters::default(), Some(1)).expect("valid");
            engine.push(0, &frames[0]).expect("valid");
            engine
        };
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                fresh,
                |engine| {
                    for (t_us, frame) in (1000..).step_by(1000).zip(&frames[1..]) {
                        black_box(engine.push(t_us, frame).expect("valid"));
                    }
                },
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, crossing);
criterion_main!(benches);
