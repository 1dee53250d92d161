//! Thresholds in the two forms that the engine needs: as steps of log intensity and as factors of luma.
//!
//! If all pixels have the same thresholds, the steps are computed once. If each pixel has its own, they are computed
//! for each batch.

use super::exponential::exp;
use super::level::Thresholds;
use super::parameters::{CrossingParameters, Threshold};

/// The thresholds, in log intensity and as factors of luma.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Steps<T> {
    pub(crate) on: T,
    pub(crate) off: T,
    /// exp(`on`), within 1e-9.
    pub(crate) rise: T,
    /// exp(-`off`), within 1e-9.
    pub(crate) fall: T,
}

impl Steps<f64> {
    pub(crate) fn new(c: Thresholds) -> Self {
        Self { on: c.on, off: c.off, rise: exp(c.on), fall: exp(-c.off) }
    }
}

/// Steps of many pixels.
pub(crate) struct StepArrays(Steps<Vec<f64>>);

impl StepArrays {
    /// Room for `length` steps, filled where all pixels have the same thresholds.
    pub(crate) fn new(length: usize, p: &CrossingParameters) -> Self {
        let Steps { on, off, rise, fall } = Steps::new(p.thresholds(0));
        let filled = |value| vec![value; length];
        Self(Steps { on: filled(on), off: filled(off), rise: filled(rise), fall: filled(fall) })
    }

    /// Takes the steps of `count` pixels.
    #[inline]
    pub(crate) fn take(&mut self, pixel: impl Fn(usize) -> usize, count: usize, p: &CrossingParameters) {
        if matches!((&p.contrast_threshold, &p.contrast_threshold_off), (Threshold::Uniform(_), Threshold::Uniform(_)))
        {
            return; // they are there
        }
        let Self(Steps { on, off, rise, fall }) = self;
        let factors = rise.iter_mut().zip(fall);
        for (j, ((on, off), (rise, fall))) in on.iter_mut().zip(off).zip(factors).take(count).enumerate() {
            let steps = Steps::new(p.thresholds(pixel(j)));
            (*on, *off, *rise, *fall) = (steps.on, steps.off, steps.rise, steps.fall);
        }
    }

    /// The first `n`.
    pub(crate) fn first(&self, n: usize) -> Steps<&[f64]> {
        let Self(Steps { on, off, rise, fall }) = self;
        Steps { on: &on[..n], off: &off[..n], rise: &rise[..n], fall: &fall[..n] }
    }
}
