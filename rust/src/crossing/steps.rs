//! The thresholds of many pixels, as arrays for vector code.
//!
//! If all pixels have the same thresholds, the arrays are filled once. If each pixel has its own, they are filled for
//! each batch.

use super::parameters::CrossingParameters;

/// The thresholds of many pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Steps<T> {
    pub(crate) on: T,
    pub(crate) off: T,
}

/// Room for the thresholds of many pixels.
pub(crate) struct StepArrays(Steps<Vec<f64>>);

impl StepArrays {
    /// Room for `length` pixels, filled where all have the same thresholds.
    pub(crate) fn new(length: usize, p: &CrossingParameters) -> Self {
        let c = p.thresholds(0);
        Self(Steps { on: vec![c.on; length], off: vec![c.off; length] })
    }

    /// Takes the thresholds of `count` pixels.
    #[inline]
    pub(crate) fn take(&mut self, pixel: impl Fn(usize) -> usize, count: usize, p: &CrossingParameters) {
        if p.is_uniform() {
            return; // they are there
        }
        let Self(Steps { on, off }) = self;
        for (j, (on, off)) in on.iter_mut().zip(off).take(count).enumerate() {
            let c = p.thresholds(pixel(j));
            (*on, *off) = (c.on, c.off);
        }
    }

    /// The first `n`.
    pub(crate) fn first(&self, n: usize) -> Steps<&[f64]> {
        let Self(Steps { on, off }) = self;
        Steps { on: &on[..n], off: &off[..n] }
    }
}
