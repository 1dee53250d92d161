//! The input of an engine: a frame, its rates of change, and samples that some pixels have between two frames.
//!
//! What must not break: sparse samples are sorted by pixel and time, because bands find theirs by bisection.
//! [`SparseSamples::check`] makes sure of it.

use crate::error::{Error, Result};
use crate::event::SensorSize;
use crate::log_intensity::check_none;

use super::sample::Sample;

/// A frame: luma (f32) or log intensity (f64) of all pixels at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a, S> {
    /// Its time in microseconds.
    pub t_us: i64,
    /// One sample a pixel, row by row.
    pub samples: &'a [S],
    /// Its total rate of change per second, for Hermite interpolation; not finite means a straight line.
    pub rate: Option<&'a [S]>,
    /// Samples between the last frame and this one.
    pub sparse: SparseSamples<'a, S>,
}

impl<'a, S> Frame<'a, S> {
    /// A frame without rates or sparse samples.
    #[must_use]
    pub fn new(t_us: i64, samples: &'a [S]) -> Self {
        Self { t_us, samples, rate: None, sparse: SparseSamples { pixel: &[], t_us: &[], samples: &[] } }
    }
}

/// Samples that some pixels bring between two frames, sorted by pixel and then by time; lines run between them.
#[derive(Clone, Copy, Debug)]
pub struct SparseSamples<'a, S> {
    /// The pixel's row-major index.
    pub pixel: &'a [u32],
    /// Microseconds, strictly between the frames.
    pub t_us: &'a [i64],
    /// Luma or log intensity, as in the frame.
    pub samples: &'a [S],
}

#[allow(private_bounds, reason = "users make these, and hand them over")]
impl<S: Sample> SparseSamples<'_, S> {
    pub(crate) fn is_empty(&self) -> bool {
        self.pixel.is_empty()
    }

    /// The samples of the pixels in `first..end`.
    pub(crate) fn of(&self, first: usize, end: usize) -> Self {
        let count_below = |bound| self.pixel.partition_point(|&pixel| (pixel as usize) < bound);
        let range = count_below(first)..count_below(end);
        Self { pixel: &self.pixel[range.clone()], t_us: &self.t_us[range.clone()], samples: &self.samples[range] }
    }

    /// How many samples the pixel has that has the most.
    pub(crate) fn most_of_a_pixel(&self) -> usize {
        self.pixel.chunk_by(|previous, next| previous == next).map(<[u32]>::len).max().unwrap_or(0)
    }

    /// Refuses samples outside of the interval, in order, with the first one's number.
    pub(crate) fn check(&self, size: SensorSize, start_us: i64, end_us: i64) -> Result<()> {
        let lengths = [self.pixel.len(), self.t_us.len(), self.samples.len()];
        if lengths[1..] != [lengths[0]; 2] {
            return Err(Error::Argument(format!(
                "sparse samples must have as many pixels as times and values, got {lengths:?}"
            )));
        }
        let (pixel, t_us) = (self.pixel, self.t_us);
        let described = |i: usize| format!("sparse sample {i} of pixel {} at {} us", pixel[i], t_us[i]);
        if let Some(i) = pixel.iter().position(|&pixel| pixel as usize >= size.pixels()) {
            let rule = format!("{} lies outside of the {} x {} sensor", described(i), size.width, size.height);
            return Err(Error::Argument(rule));
        }
        if let Some(i) = t_us.iter().position(|&t| t <= start_us || t >= end_us) {
            let rule =
                format!("{} does not lie strictly between the frames at {start_us} and {end_us} us", described(i));
            return Err(Error::Argument(rule));
        }
        if let Some(i) = (1..pixel.len()).find(|&i| (pixel[i - 1], t_us[i - 1]) >= (pixel[i], t_us[i])) {
            let rule = format!(
                "{} does not come after {}: they must be sorted by pixel and time",
                described(i),
                described(i - 1)
            );
            return Err(Error::Order(rule));
        }
        if S::all_valid(self.samples) {
            return Ok(());
        }
        let bad = (0..pixel.len()).find(|&i| !S::all_valid(&self.samples[i..=i]));
        let bad_pixel = bad.map(|i| pixel[i] as usize);
        check_none(bad_pixel, size, bad.map(|i| t_us[i]), |_| {
            format!("sparse {}, got {:?}", S::RULE, bad.map(|i| self.samples[i]).unwrap_or_default())
        })
    }
}
