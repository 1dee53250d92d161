//! The crossing engine on moving textures, and what memory alone would cost: pixels a second.

use std::hint::black_box;

use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime};
use davis_rs::{CrossingEngine, CrossingParameters, Event, SensorSize};

const SMALL: SensorSize = SensorSize { width: 240, height: 180 };
const LARGE: SensorSize = SensorSize { width: 1280, height: 720 };

/// Frames of a sequence, there and back, for ever.
const FRAMES: u16 = 40;

/// A texture of waves of 8 to 128 pixels, as strong in each octave (0.6 rms in log), moved by `step` pixels a frame.
fn sequence(size: SensorSize, step: f64) -> Vec<Vec<f32>> {
    let waves: Vec<(f64, f64, f64, f64)> = (0..24)
        .map(|i| {
            let length = 8.0 * 16f64.powf(f64::from(i) / 23.0);
            let angle = 2.4 * f64::from(i);
            let k = std::f64::consts::TAU / length;
            (k * angle.cos(), k * angle.sin(), 1.7 * f64::from(i), 0.17)
        })
        .collect();
    let frame = |frame: u16| {
        let mut logs = vec![-1.5; size.pixels()];
        for &(kx, ky, phase, strength) in &waves {
            // Back between the places of the way there: real signals seldom meet a value again to the last bit.
            let place = if frame < FRAMES / 2 { f64::from(frame) } else { f64::from(FRAMES - frame) - 0.43 };
            let moved = -(kx + 0.4 * ky) * place * step;
            // sin(a + b) = sin a cos b + cos a sin b: one sine a row and column instead of one a pixel.
            let row: Vec<(f64, f64)> =
                (0..size.height).map(|y| (ky * f64::from(y) + moved + phase).sin_cos()).collect();
            let column: Vec<(f64, f64)> = (0..size.width).map(|x| (kx * f64::from(x)).sin_cos()).collect();
            for (logs, (sin_y, cos_y)) in logs.chunks_exact_mut(size.width.into()).zip(row) {
                for (log, (sin_x, cos_x)) in logs.iter_mut().zip(&column) {
                    *log += strength * (sin_x * cos_y + cos_x * sin_y);
                }
            }
        }
        #[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
        logs.iter().map(|log: &f64| log.exp() as f32).collect()
    };
    (0..FRAMES).map(frame).collect()
}

/// One engine, fed without end.
fn engine(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, size: SensorSize, step: f64, threads: usize) {
    let frames = sequence(size, step);
    let mut engine = CrossingEngine::new(size, CrossingParameters::default(), Some(threads)).expect("valid");
    // The first frame sets the references; one that comes again would be met exactly, which real signals are not.
    let first: Vec<f32> = frames[0].iter().map(|luma| luma * 1.013).collect();
    engine.push(0, &first, None, &mut Vec::new()).expect("valid");
    let mut order = (0..frames.len()).cycle();
    let (mut t_us, mut events, mut total) = (1000, Vec::<Event>::new(), (0, 0));
    let mut push = move || {
        let frame = &frames[order.next().expect("endless")];
        engine.push(t_us, frame, None, &mut events).expect("valid");
        t_us += 1000;
        total = (total.0 + events.len(), total.1 + frame.len());
        black_box(&events);
        total
    };
    for _ in 0..FRAMES {
        push();
    }
    group.bench_function(name, |b| b.iter(&mut push));
    #[allow(clippy::cast_precision_loss, reason = "for people")]
    let (events, pixels) = (push().0 as f64, push().1 as f64);
    println!("{name}: {:.3} events a pixel a frame", events / pixels);
}

/// What the common path cannot do without: read the frame and both bounds, and store the frame.
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch")]
fn bare_pass(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, size: SensorSize) {
    let (new, low, high) = (vec![0.5f32; size.pixels()], vec![0.4f32; size.pixels()], vec![0.6f32; size.pixels()]);
    let mut last = vec![0.0f32; size.pixels()];
    group.bench_function(name, |b| {
        b.iter(|| {
            let mut left = 0;
            for (((last, new), low), high) in last.iter_mut().zip(black_box(&new)).zip(&low).zip(&high) {
                left |= u32::from((new >= high) | (new <= low));
                *last = *new;
            }
            black_box(&last);
            left
        });
    });
}

/// Copying 16 bytes a pixel, half read and half written.
fn copy(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, size: SensorSize) {
    let from = vec![1u64; size.pixels()];
    let mut to = vec![0u64; size.pixels()];
    group.bench_function(name, |b| {
        b.iter(|| {
            to.copy_from_slice(black_box(&from));
            black_box(&to);
        });
    });
}

fn crossing(c: &mut Criterion) {
    for (size_name, size) in [("240 x 180", SMALL), ("1280 x 720", LARGE)] {
        let mut group = c.benchmark_group(size_name);
        group.throughput(Throughput::Elements(size.pixels() as u64));
        for (name, step) in [("dense: 1/3 px a frame", 1.0 / 3.0), ("quiet: 0.02 px a frame", 0.02), ("static", 0.0)] {
            engine(&mut group, name, size, step, 1);
        }
        engine(&mut group, "dense, two threads", size, 1.0 / 3.0, 2);
        bare_pass(&mut group, "bare pass over the same bytes", size);
        copy(&mut group, "copying 16 bytes a pixel", size);
        group.finish();
    }
}

criterion_group!(benches, crossing);
criterion_main!(benches);
