//! How many events a frame will make in pixels under effects. Memory is taken for them before they are made.
//!
//! What must not break: the estimate for the signal is an upper bound, so that a push that does not fit is refused
//! before it runs.

use super::band::{Band, BandFrame};
use super::sensor::Sensor;
use super::timeline::FREE;
use crate::crossing::cubic::Cubic;
use crate::crossing::curve::{Curve, Piece};
use crate::crossing::line::Line;
use crate::crossing::parameters::CrossingParameters;
use crate::crossing::sample::Sample;

impl Band {
    /// About how many events a frame will make.
    #[cold]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an estimate, >= 0, saturating")]
    pub(super) fn count<S: Sample>(&self, frame: &BandFrame<'_, S>, p: &CrossingParameters, sensor: &Sensor) -> u64 {
        let count = |(i, &sample): (usize, &S)| {
            let slope = frame.rates.map_or(0.0, |rates| sample.log_rate(rates[i], p.log_eps));
            let (crossings, noise) = self.expected(i, (log(sample, p), slope), frame, p, sensor);
            (crossings + noise) as u64
        };
        frame.new.iter().enumerate().map(count).fold(0, u64::saturating_add)
    }

    /// How many events at most one pixel's signal makes over a frame that comes to this log intensity and its slope, and
    /// how many noise makes on average.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(super) fn expected<S: Sample>(
        &self,
        i: usize,
        (to, slope_to): (f64, f64),
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
        sensor: &Sensor,
    ) -> (f64, f64) {
        let (index, ticks, from) = (self.first_pixel + i, frame.at.ticks as f64, self.logs[i]);
        let (c, sparse) = (p.thresholds(index), frame.sparse.of(index, index + 1));
        let (mut last, mut way) = (from, 0.0);
        let mut go = |to: f64| {
            way += (to - last).abs();
            last = to;
        };
        if frame.rates.is_some() && sparse.is_empty() {
            let (line, seconds) = (Line { from, to, ticks: frame.at.ticks }, ticks * 1e-6);
            let cubic = Cubic::new(line, self.slopes[i] * seconds, slope_to * seconds);
            cubic.pieces().for_each(|piece| go(piece.end()));
        } else {
            sparse.samples.iter().for_each(|&sample| go(log(sample, p)));
            go(to);
        }
        // What leaves a low-pass moves no further than to its input and with it, and so does what leaves a second one.
        let start = self.filtered.get(i).copied().unwrap_or(from);
        let between = self.photoreceptor.get(i).copied().unwrap_or(start);
        let drift = self.leaks.drift(i, sensor.elapsed(frame.at.start_us), (from, to));
        let seen = start + drift.at(0.0);
        let held = self.held_us.get(i).is_some_and(|&held| held > FREE);
        let behind = if held { 0.0 } else { (seen - self.references[i].value(c)).abs() };
        let way = way + behind + (start - between).abs() + (between - from).abs() + drift.rate() * ticks;
        let hot = self.hot_place(i).and(sensor.hot.as_ref()).map_or(0.0, |hot| hot.pixel(index as u32).rate_hz);
        let least_threshold = c.on.min(c.off);
        let noise = sensor.shot.as_ref().map_or(0.0, |noise| {
            let events = |log_light| {
                ticks * noise.events_in_a_us(least_threshold, log_light) + noise.sigma(log_light) / least_threshold
            };
            events(from).max(events(to))
        });
        // Each event holds the pixel.
        let most = ticks / sensor.effects.refractory_period_us + 1.0;
        ((way / least_threshold).floor().min(most), (hot * ticks * 1e-6 + noise).min(most))
    }
}

/// Log intensity of one sample.
fn log<S: Sample>(sample: S, p: &CrossingParameters) -> f64 {
    let mut log = [0.0];
    S::logs(&[sample], p.log_eps, &mut log);
    log[0]
}
