//! The pixels of a sensor, and one frame's way through them.

use rayon::prelude::*;

use super::band::{Band, Interval, Share};
use super::parameters::CrossingParameters;
use super::pixel::Pixel;
use super::sample::{Around, Sample};
use super::scan::TILE;
use super::state::EngineState;
use crate::event::{Event, SensorSize};

/// State of 36 bytes a pixel for luma (the rate of change takes four more), in arrays: what every frame touches lies
/// together, apart from what only an event touches.
pub(crate) struct Core<S> {
    last: Vec<S>,
    low: Vec<S>,
    high: Vec<S>,
    /// Empty where interpolation is linear.
    rates: Vec<S>,
    pixels: Vec<Pixel>,
    bands: Vec<Band<S>>,
}

/// Bands for each thread, so that one with many events does not keep the others waiting.
const BANDS_PER_THREAD: usize = 4;

impl<S: Sample> Core<S> {
    /// Memorises the first frame.
    pub(crate) fn new(
        first: &[S],
        rates: Option<&[S]>,
        parameters: &CrossingParameters,
        pool: Option<&rayon::ThreadPool>,
    ) -> Self {
        let mut logs = vec![0.0; first.len()];
        S::logs(first, parameters.log_eps, &mut logs);
        let bands = pool.map_or(1, |pool| BANDS_PER_THREAD * pool.current_num_threads());
        let mut core = Self {
            last: first.to_vec(),
            low: vec![S::default(); first.len()],
            high: vec![S::default(); first.len()],
            rates: rates.map_or(vec![], <[S]>::to_vec),
            pixels: logs.into_iter().map(Pixel::new).collect(),
            bands: (0..bands).map(|_| Band::new()).collect(),
        };
        core.reset_bounds(parameters);
        core
    }

    /// Takes up stored counters and times, the last frame being that of the state.
    pub(crate) fn restore(&mut self, state: &EngineState) {
        for (i, pixel) in self.pixels.iter_mut().enumerate() {
            pixel.reference.base = state.base[i];
            pixel.reference.on = state.on[i];
            pixel.reference.off = state.off[i];
            pixel.last_event_us = state.last_event_us[i];
        }
        self.reset_bounds(&state.parameters);
    }

    pub(crate) fn last(&self) -> &[S] {
        &self.last
    }

    pub(crate) fn rates(&self) -> &[S] {
        &self.rates
    }

    pub(crate) fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// The events of the last frame: parts that together are in raster order.
    pub(crate) fn events(&self) -> impl Iterator<Item = &[Event]> + Clone {
        self.bands.iter().map(|band| &band.events[..])
    }

    /// Runs every pixel over one checked frame.
    pub(crate) fn advance(
        &mut self,
        frame: &[S],
        rates: Option<&[S]>,
        at: Interval,
        size: SensorSize,
        parameters: &CrossingParameters,
        pool: Option<&rayon::ThreadPool>,
    ) {
        let Self { last, low, high, rates: before, pixels, bands } = self;
        let rates_at = |start: usize, n: usize| rates.map(|now| (&before[start..start + n], &now[start..start + n]));
        match pool {
            None => {
                let rates = rates_at(0, frame.len());
                let share = Share { first_pixel: 0, pixels, last, low, high, new: frame, rates };
                bands[0].advance(share, at, size, parameters);
            }
            Some(pool) => {
                let length = frame.len().div_ceil(bands.len()).next_multiple_of(TILE);
                for band in &mut *bands {
                    band.events.clear(); // one that gets no pixels keeps none of its last
                }
                pool.install(|| {
                    (pixels.par_chunks_mut(length), last.par_chunks_mut(length), low.par_chunks_mut(length))
                        .into_par_iter()
                        .zip((high.par_chunks_mut(length), frame.par_chunks(length), bands.par_iter_mut()))
                        .enumerate()
                        .for_each(|(i, ((pixels, last, low), (high, new, band)))| {
                            let rates = rates_at(i * length, new.len());
                            let share = Share { first_pixel: i * length, pixels, last, low, high, new, rates };
                            band.advance(share, at, size, parameters);
                        });
                });
            }
        }
        if let Some(now) = rates {
            before.copy_from_slice(now);
        }
    }

    /// Computes the bounds of all pixels afresh.
    fn reset_bounds(&mut self, parameters: &CrossingParameters) {
        let pixels = self.pixels.iter().enumerate();
        let (below, above): (Vec<f64>, Vec<f64>) = pixels
            .map(|(i, Pixel { reference, .. })| {
                let c = parameters.thresholds(i);
                (reference.down().value(c), reference.up().value(c))
            })
            .unzip();
        let bounds = Around { below: &mut self.low[..], above: &mut self.high[..] };
        S::bounds(Around { below: &below, above: &above }, parameters.log_eps, bounds);
    }
}
