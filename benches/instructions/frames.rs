//! The program whose instructions `instructions.py` counts: an engine that takes a number of frames of one kind.
//!
//! Its pixels are ideal, but for the kind `sensor`: those have all effects of a real sensor but noise, and frames 5 ms
//! apart with rates of change.

use davis_rs::{
    CrossingEngine, CrossingParameters, Effects, Event, Frame, Interpolation, Leak, PhotoreceptorBandwidth, SensorSize,
    ThresholdMismatch,
};

const SIZE: SensorSize = SensorSize { width: 240, height: 180 };

fn main() {
    let mut arguments = std::env::args().skip(1);
    let kind = arguments.next().expect("a kind, as instructions.py lists them");
    let frames: i64 = arguments.next().and_then(|n| n.parse().ok()).expect("how many frames");
    let step = match kind.as_str() {
        "dense" | "hermite" | "sensor" => 0.03,
        "quiet" => 0.01,
        _ => 0.0,
    };
    let mut state = 1u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from((state >> 33) as u32) / f64::from(1u32 << 31)
    };
    let pixels: Vec<(f64, f64, f64)> = (0..SIZE.pixels()).map(|_| (uniform(), uniform(), uniform())).collect();
    // Three frames and the way between them, so that making them costs the same however many are pushed.
    let luma: Vec<Vec<f32>> = (0..3)
        .map(|k| {
            let at = f64::from(k) * step;
            pixels.iter().map(|(level, slope, _)| (level - 2.0 + (slope - 0.5) * 20.0 * at).exp() as f32).collect()
        })
        .collect();
    let rate: Vec<f32> = pixels.iter().map(|(_, slope, noise)| ((slope - 0.5) * 20.0 + noise - 0.5) as f32).collect();
    let sensor = kind == "sensor";
    let hermite = sensor || kind == "hermite";
    let interpolation = if hermite { Interpolation::Hermite } else { Interpolation::Linear };
    let parameters = CrossingParameters { interpolation, ..CrossingParameters::default() };
    let mut effects = Effects::default();
    if sensor {
        effects.photoreceptor_bandwidth = PhotoreceptorBandwidth { hz: 3000.0, source_follower_hz: 300.0 };
        effects.threshold_mismatch = ThresholdMismatch { sigma: 0.05, ..effects.threshold_mismatch };
        effects.leak = Leak { rate_hz: 0.1, spread: 0.23, jitter: 0.1, ..effects.leak };
        effects.refractory_period_us = 10.0;
    }
    let mut engine = CrossingEngine::with_effects(SIZE, parameters, &effects, 1, Some(1)).expect("valid");
    let interval_us = if sensor { 5000 } else { 1000 };
    let (mut events, mut count) = (Vec::<Event>::new(), 0);
    for k in 0..=frames {
        let place = [0, 1, 2, 1][usize::try_from(k % 4).expect("small")];
        let mut frame = Frame::new(interval_us * k, &luma[place][..]);
        frame.rate = hermite.then_some(&rate);
        engine.push(frame, &mut events).expect("valid");
        count += events.len();
    }
    println!("{count} events");
}
