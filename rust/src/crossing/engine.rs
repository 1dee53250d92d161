//! The engine: frames in, sorted events out.

use rayon::prelude::*;

use super::level::Thresholds;
use super::parameters::CrossingParameters;
use super::pixel::{NEVER, Pixel};
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};
use crate::log_intensity::{check_luma, check_none, log_intensity};
use crate::order::sort_raster_by_time;

/// Pixels that one thread takes at a time: large enough to hide the hand-over, small enough to balance the load.
const TILE: usize = 4096;

/// No logarithm of a positive finite float64 lies outside of +-745.2.
const MAX_LOG_INTENSITY: f64 = 746.0;

/// Turns luma frames into events, by the crossing rule of an ideal event-camera pixel.
///
/// Each pixel holds a reference `R = B + n_on C_on - n_off C_off` with integer counters, `B` being the log intensity of
/// the first frame. Between two frames log intensity is linear; an ON event falls each time it reaches `R + C_on`, an
/// OFF event each time it reaches `R - C_off`, stamped with the first microsecond tick at or after the crossing. Every
/// decision is exact for the given float64 log intensity.
pub struct CrossingEngine {
    size: SensorSize,
    parameters: CrossingParameters,
    pool: rayon::ThreadPool,
    /// The time of the last frame; none before the first.
    t_us: Option<i64>,
    pixels: Vec<Pixel>,
}

impl CrossingEngine {
    /// An engine for a sensor; `threads = None` takes one thread a core.
    ///
    /// # Errors
    /// [`Error::Argument`] for a parameter out of range or an empty sensor.
    pub fn new(size: SensorSize, parameters: CrossingParameters, threads: Option<usize>) -> Result<Self> {
        parameters.check()?;
        if size.pixels() == 0 {
            return Err(Error::Argument(format!(
                "the sensor must have at least one pixel, got {} x {}",
                size.width, size.height
            )));
        }
        if threads == Some(0) {
            return Err(Error::Argument("threads must be at least 1, got 0".into()));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .build()
            .map_err(|e| Error::Argument(format!("threads = {threads:?}: {e}")))?;
        Ok(Self { size, parameters, pool, t_us: None, pixels: Vec::new() })
    }

    /// The size of the sensor.
    #[must_use]
    pub fn size(&self) -> SensorSize {
        self.size
    }

    /// The time of the last frame in microseconds, if there was one.
    #[must_use]
    pub fn t_us(&self) -> Option<i64> {
        self.t_us
    }

    /// Takes the frame of linear luma at `t_us`, row by row; returns the events since the frame before it.
    ///
    /// # Errors
    /// A frame of the wrong size, luma that is NaN, infinite or negative ([`Error::Argument`] with time and pixel), or
    /// a time that is not after the last one ([`Error::Order`]). The state is then as it was.
    pub fn push(&mut self, t_us: i64, luma: &[f32]) -> Result<Vec<Event>> {
        let ticks = self.check_frame(t_us, luma.len())?;
        check_luma(luma, self.size, Some(t_us))?;
        let log_eps = self.parameters.log_eps;
        Ok(self.advance(t_us, ticks, luma, |&y| log_intensity(y, log_eps)))
    }

    /// [`Self::push`] of log intensity itself.
    ///
    /// # Errors
    /// As [`Self::push`]; log intensity must lie within +-746, the logarithms of all positive finite floats.
    pub fn push_log(&mut self, t_us: i64, log_intensity: &[f64]) -> Result<Vec<Event>> {
        let ticks = self.check_frame(t_us, log_intensity.len())?;
        let bad = log_intensity.iter().position(|l| l.is_nan() || l.abs() > MAX_LOG_INTENSITY);
        check_none(bad, self.size, Some(t_us), |i| {
            format!("log intensity must lie within +-746, got {}", log_intensity[i])
        })?;
        Ok(self.advance(t_us, ticks, log_intensity, |&l| l))
    }

    /// The reference `R` of each pixel in log intensity, row by row; NaN before the first frame.
    #[must_use]
    pub fn reference(&self) -> Vec<f64> {
        if self.pixels.is_empty() {
            return vec![f64::NAN; self.size.pixels()];
        }
        let c = self.thresholds();
        self.pixels.iter().map(|pixel| pixel.reference.exact(c).value()).collect()
    }

    /// The surface of active events: the time of each pixel's last event in microseconds, row by row; -1 = none yet.
    #[must_use]
    pub fn last_event_us(&self) -> Vec<i64> {
        if self.pixels.is_empty() {
            return vec![NEVER; self.size.pixels()];
        }
        self.pixels.iter().map(|pixel| pixel.last_event_us).collect()
    }

    fn thresholds(&self) -> Thresholds {
        Thresholds { on: self.parameters.contrast_threshold, off: self.parameters.contrast_threshold_off }
    }

    /// The length of the interval that the frame ends (none for the first frame).
    fn check_frame(&self, t_us: i64, pixels: usize) -> Result<Option<i64>> {
        if pixels != self.size.pixels() {
            return Err(Error::Argument(format!(
                "a frame must have {} x {} = {} pixels, got {pixels}",
                self.size.width,
                self.size.height,
                self.size.pixels()
            )));
        }
        if t_us < 0 {
            return Err(Error::Argument(format!("the time of a frame must be >= 0 us, got {t_us} us")));
        }
        let Some(last) = self.t_us else { return Ok(None) };
        if t_us <= last {
            return Err(Error::Order(format!(
                "the time of a frame must be after the last one ({last} us), got {t_us} us"
            )));
        }
        if t_us - last >= 1 << 53 {
            return Err(Error::Argument(format!(
                "two frames must be less than 2^53 us apart, got {last} us and {t_us} us"
            )));
        }
        Ok(Some(t_us - last))
    }

    /// Runs every pixel over one checked frame.
    fn advance<S: Sync>(
        &mut self,
        t_us: i64,
        ticks: Option<i64>,
        samples: &[S],
        log: impl Fn(&S) -> f64 + Sync,
    ) -> Vec<Event> {
        self.t_us = Some(t_us);
        let Some(ticks) = ticks else {
            self.pixels = samples.iter().map(|sample| Pixel::new(log(sample))).collect();
            return Vec::new();
        };
        let (size, c) = (self.size, self.thresholds());
        let pixels = &mut self.pixels;
        let tiles: Vec<Vec<Event>> = self.pool.install(|| {
            pixels
                .par_chunks_mut(TILE)
                .zip(samples.par_chunks(TILE))
                .enumerate()
                .map(|(tile, (pixels, samples))| {
                    let mut events = Vec::new();
                    for (i, (pixel, sample)) in pixels.iter_mut().zip(samples).enumerate() {
                        let (x, y) = size.xy(tile * TILE + i);
                        pixel
                            .advance(log(sample), t_us - ticks, ticks, c, |t, on| events.push(Event::new(t, x, y, on)));
                    }
                    events
                })
                .collect()
        });
        let mut events = tiles.concat();
        sort_raster_by_time(&mut events);
        events
    }
}
