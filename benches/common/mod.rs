//! What the benches of the crossing engine are fed with.

use davis_rs::SensorSize;

/// Frames that are timed, after one that spreads the references and one that settles them.
pub const FRAMES: u16 = 60;

/// Frames of a texture of waves of 8 to 128 pixels, as strong in each octave (0.6 rms in log), moved by `step` pixels.
pub fn sequence(size: SensorSize, step: f64) -> Vec<Vec<f32>> {
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
            let moved = -(kx + 0.4 * ky) * f64::from(frame) * step;
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
    (0..=FRAMES).map(frame).collect()
}

/// The frame as it is, but for luma off by up to half a threshold: as references lie in the midst of a run.
#[allow(clippy::cast_precision_loss, reason = "few pixels")]
#[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
pub fn spread(frame: &[f32]) -> Vec<f32> {
    // The golden ratio's multiples spread evenly.
    let factor = |i: usize| (0.3 * ((i as f64 * 0.618_033_988_749_895).fract() - 0.5)).exp();
    frame.iter().enumerate().map(|(i, y)| (f64::from(*y) * factor(i)) as f32).collect()
}
