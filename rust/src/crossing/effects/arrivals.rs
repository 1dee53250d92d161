//! Arrivals of noise events. Each pixel has processes of its own, and each arrival is a function of (seed, purpose,
//! pixel, number of the arrival).
//!
//! What must not break: arrivals depend neither on how the signal is sampled in time nor on what the pixel sees. The
//! pixel may drop an arrival, and the next one comes when it would have come anyway.

/// Where a pixel's process stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrivals {
    /// Microseconds from the interval's start to the next arrival.
    pub(crate) wait_us: f64,
    /// Its number.
    pub(crate) index: u64,
}
