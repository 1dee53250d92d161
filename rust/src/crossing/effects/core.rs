//! The pixels of a sensor under effects: cuts them into bands for threads, and stores and restores their state.
//!
//! Unlike the ideal [`crate::crossing::core::Core`], it keeps log intensity whatever it is fed with, because effects
//! act on that.
//!
//! What must not break: the cut into bands changes no event. A stored state is checked before any of it is used.

use std::collections::TryReserveError;

use rayon::prelude::*;

use super::band::Band;
use super::hot_pixels::Arrivals;
use super::noise_path::NoisePath;
use super::parameters::{Effects, ShotNoise};
use super::sensor::Sensor;
use super::timeline::FREE;
use crate::crossing::buffer::{Allowance, Stop};
use crate::crossing::core::{Pixels, Push};
use crate::crossing::frame::Frame;
use crate::crossing::level::Level;
use crate::crossing::parameters::CrossingParameters;
use crate::crossing::sample::Sample;
use crate::crossing::scan::TILE;
use crate::crossing::state::{EffectState, EngineState};
use crate::error::{self, Error};
use crate::event::{Event, SensorSize};
use crate::order::TimeSort;

/// The counterpart of [`crate::crossing::core::Core`] for pixels under effects. It always keeps log intensity.
pub(crate) struct EffectCore {
    sensor: Sensor,
    bands: Vec<Band>,
}

/// Bands for each thread, so that one with many events does not keep the others waiting.
const BANDS_PER_THREAD: usize = 4;

impl EffectCore {
    /// Takes the first frame, at which references begin.
    pub(crate) fn new<S: Sample>(
        frame: &Frame<'_, S>,
        size: SensorSize,
        p: &CrossingParameters,
        effects: &Effects,
        seed: u64,
        pool: Option<&rayon::ThreadPool>,
    ) -> Self {
        let n = size.pixels();
        let mut logs = vec![0.0; n];
        S::logs(frame.samples, p.log_eps, &mut logs);
        let slopes: Vec<f64> = frame.rate.map_or(vec![], |rates| {
            frame.samples.iter().zip(rates).map(|(sample, &rate)| sample.log_rate(rate, p.log_eps)).collect()
        });
        let sensor = Sensor::new(size, p, effects, seed, frame.t_us);
        let bands = pool.map_or(1, |pool| BANDS_PER_THREAD * pool.current_num_threads());
        let length = n.div_ceil(bands).next_multiple_of(TILE);
        let bands = (0..n).step_by(length).map(|first| {
            let pixels = first..(first + length).min(n);
            let slopes = slopes.get(pixels.clone()).unwrap_or_default();
            Band::new(first, &logs[pixels], slopes, p, &sensor)
        });
        Self { bands: bands.collect(), sensor }
    }

    pub(crate) fn references(&self) -> impl Iterator<Item = &Level> {
        self.bands.iter().flat_map(|band| &band.references)
    }

    /// The reference of each pixel in log intensity at `t_us`; NaN in those that are held.
    pub(crate) fn reference(&self, t_us: i64, p: &CrossingParameters) -> Vec<f64> {
        let elapsed_us = self.sensor.elapsed(t_us);
        let leaked = |(i, band): (usize, &Band)| band.leaks.drift(i, elapsed_us, (0.0, 0.0)).at(0.0);
        let leaked: Vec<f64> =
            self.bands.iter().flat_map(|band| (0..band.logs.len()).map(move |i| leaked((i, band)))).collect();
        let held = self.joined(|band| &band.held_us);
        let value = |(i, level): (usize, &Level)| {
            let c = p.thresholds(i);
            let reference = level.exact(c).value() - leaked[i];
            if held.get(i).is_some_and(|&held| held > FREE) { f64::NAN } else { reference }
        };
        self.references().enumerate().map(value).collect()
    }

    pub(crate) fn last_event_us(&self) -> Vec<i64> {
        self.joined(|band| &band.last_event_us)
    }

    /// Log intensity at the last frame, and its change per second.
    pub(crate) fn logs(&self) -> (Vec<f64>, Vec<f64>) {
        (self.joined(|band| &band.logs), self.joined(|band| &band.slopes))
    }

    pub(crate) fn state(&self) -> EffectState {
        let hot: Vec<Arrivals> = self.bands.iter().flat_map(|band| band.hot.iter().map(|hot| hot.1)).collect();
        let noise = self.joined(|band| &band.noise);
        EffectState {
            started_us: self.sensor.started_us,
            photoreceptor: self.joined(|band| &band.photoreceptor),
            filtered: self.joined(|band| &band.filtered),
            held_us: self.joined(|band| &band.held_us),
            noise_cell: noise.iter().map(|path| path.cell).collect(),
            noise_log_light: noise.iter().map(|path| path.log_light).collect(),
            noise_photoreceptor: noise.iter().map(|path| path.start[0]).collect(),
            noise_filtered: noise.iter().map(|path| path.start[1]).collect(),
            leaked: self.joined(|band| &band.leaks.leaked),
            leak_error: self.joined(|band| &band.leaks.error),
            hot_wait_us: hot.iter().map(|arrivals| arrivals.wait_us).collect(),
            hot_index: hot.iter().map(|arrivals| arrivals.index).collect(),
        }
    }

    /// Takes up a stored state, the last frame being that of the state.
    #[allow(clippy::cast_precision_loss, reason = "times of interest lie below 2^53 us")]
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(crate) fn restore(&mut self, engine: &EngineState, state: &EffectState) -> error::Result<()> {
        self.sensor.started_us = state.started_us;
        let hot = self.bands.iter().map(|band| band.hot.len()).sum::<usize>();
        let (n, filtered) = (self.sensor.size.pixels(), self.sensor.effects.filters());
        let leak = self.sensor.effects.leak;
        let expected = |on: bool| if on { n } else { 0 };
        let lengths = [
            ("photoreceptor", state.photoreceptor.len(), expected(self.sensor.effects.filters_twice())),
            ("filtered", state.filtered.len(), expected(filtered)),
            ("held_us", state.held_us.len(), expected(self.sensor.effects.refractory_period_us > 0.0)),
            ("noise_cell", state.noise_cell.len(), expected(self.sensor.effects.shot_noise.is_on())),
            ("noise_log_light", state.noise_log_light.len(), state.noise_cell.len()),
            ("noise_photoreceptor", state.noise_photoreceptor.len(), state.noise_cell.len()),
            ("noise_filtered", state.noise_filtered.len(), state.noise_cell.len()),
            ("leaked", state.leaked.len(), expected(leak.by_light())),
            ("leak_error", state.leak_error.len(), expected(leak.jitters())),
            ("hot_wait_us", state.hot_wait_us.len(), hot),
            ("hot_index", state.hot_index.len(), hot),
        ];
        if let Some((name, length, expected)) = lengths.into_iter().find(|(_, length, expected)| length != expected) {
            return Err(Error::Argument(format!(
                "{name} of a state with these effects must have {expected} values, got {length}"
            )));
        }
        let t_us = engine.t_us.unwrap_or_default();
        if !(0..=t_us).contains(&state.started_us) {
            return Err(Error::Argument(format!(
                "started_us of a state must lie in 0..{t_us}, got {}",
                state.started_us
            )));
        }
        // What was due at the last frame has been dealt with there.
        let ahead = |wait: &f64| 0.0 < *wait && *wait < 1e18;
        let waits = |waits: &[f64]| waits.iter().all(ahead);
        let held = |held: &f64| *held == FREE || ahead(held);
        let elapsed_us = (t_us - state.started_us) as f64;
        let cell_us = self.sensor.shot.as_ref().map_or(1.0, |noise| noise.cell_us);
        let ShotNoise { rms, floor, .. } = self.sensor.effects.shot_noise;
        let within = |times: f64| move |noise: &f64| noise.abs() <= times * (rms + floor);
        let latest_us = elapsed_us * (1.0 + 4.0 * f64::EPSILON) + cell_us;
        let begun = |cell: &i64| *cell >= 0 && *cell as f64 * cell_us <= latest_us;
        let ranges = [
            ("photoreceptor", "within +-746", f64::all_valid(&state.photoreceptor)),
            ("filtered", "within +-746", f64::all_valid(&state.filtered)),
            ("held_us", "> 0, or -inf where a pixel is free", state.held_us.iter().all(held)),
            ("noise_cell", "that of the last frame or an earlier one", state.noise_cell.iter().all(begun)),
            ("noise_log_light", "within +-746", f64::all_valid(&state.noise_log_light)),
            (
                "noise_photoreceptor",
                "within 500 times the rms and the floor",
                state.noise_photoreceptor.iter().all(within(500.0)),
            ),
            ("noise_filtered", "within 50 times the rms and the floor", state.noise_filtered.iter().all(within(50.0))),
            ("leaked", "finite", state.leaked.iter().all(|leaked| leaked.is_finite())),
            ("leak_error", "finite", state.leak_error.iter().all(|error| error.is_finite())),
            ("hot_wait_us", "finite and > 0", waits(&state.hot_wait_us)),
        ];
        if let Some((name, rule, _)) = ranges.into_iter().find(|(_, _, valid)| !valid) {
            return Err(Error::Argument(format!("{name} of a state must be {rule}")));
        }
        let (mut first_hot, arrivals) = (0, |(&wait_us, &index)| Arrivals { wait_us, index });
        for band in &mut self.bands {
            let (first, n) = (band.first_pixel, band.logs.len());
            let pixels = first..first + n;
            for (i, reference) in band.references.iter_mut().enumerate() {
                let at = first + i;
                *reference = Level { base: engine.base[at], on: engine.on[at], off: engine.off[at] };
            }
            band.last_event_us.copy_from_slice(&engine.last_event_us[pixels.clone()]);
            band.photoreceptor = state.photoreceptor.get(pixels.clone()).unwrap_or_default().to_vec();
            band.filtered = state.filtered.get(pixels.clone()).unwrap_or_default().to_vec();
            band.held_us = state.held_us.get(pixels.clone()).unwrap_or_default().to_vec();
            band.leaks.leaked = state.leaked.get(pixels.clone()).unwrap_or_default().to_vec();
            band.leaks.error = state.leak_error.get(pixels.clone()).unwrap_or_default().to_vec();
            if let Some(law) = &self.sensor.shot {
                let path = |at: usize| {
                    let start = [state.noise_photoreceptor[at], state.noise_filtered[at]];
                    NoisePath::at(law, at as u32, state.noise_cell[at], state.noise_log_light[at], start)
                };
                band.noise = pixels.map(path).collect();
            }
            let waits = state.hot_wait_us[first_hot..].iter().zip(&state.hot_index[first_hot..]);
            band.hot.iter_mut().zip(waits).for_each(|(hot, stored)| hot.1 = arrivals(stored));
            first_hot += band.hot.len();
            band.reset_bounds(&engine.parameters);
        }
        Ok(())
    }

    fn joined<T: Clone>(&self, field: impl Fn(&Band) -> &Vec<T>) -> Vec<T> {
        self.bands.iter().flat_map(|band| field(band).iter().cloned()).collect()
    }
}

impl<S: Sample> Pixels<S> for EffectCore {
    fn advance(&mut self, push: &Push<'_, S>, allowance: Allowance) -> Result<(), Stop> {
        let sensor = &self.sensor;
        let advance =
            |band: &mut Band| band.advance(&band.part_of(push), push.p, sensor, allowance).map_err(Stop::from);
        // Every band begins, also where another one is full: what it holds is then of this frame.
        match push.pool {
            None => self.bands.iter_mut().map(advance).fold(Ok(()), Result::and),
            Some(pool) => pool.install(|| self.bands.par_iter_mut().map(advance).reduce(|| Ok(()), Result::and)),
        }
    }

    fn event_count(&self) -> u64 {
        self.bands.iter().map(|band| band.events.made().len() as u64).sum()
    }

    fn sort(&self, push: &Push<'_, S>, sort: &mut TimeSort, events: &mut Vec<Event>) -> Result<(), TryReserveError> {
        sort.sort(self.bands.iter().map(|band| band.events.made()), push.at.start_us, push.at.ticks, events)
    }

    fn settle(&mut self, push: &Push<'_, S>) {
        let settle = |band: &mut Band| band.settle(push.at.ticks);
        match push.pool {
            None => self.bands.iter_mut().for_each(settle),
            Some(pool) => pool.install(|| self.bands.par_iter_mut().for_each(settle)),
        }
    }

    #[cold]
    fn undo(&mut self, push: &Push<'_, S>) {
        self.bands.iter_mut().for_each(|band| band.undo(push.p));
    }

    #[cold]
    fn count(&self, push: &Push<'_, S>) -> u64 {
        let counts = self.bands.iter().map(|band| band.count(&band.part_of(push), push.p, &self.sensor));
        counts.fold(0, u64::saturating_add)
    }
}
