//! Effects of a real sensor on the signal, the reference and the thresholds of its pixels, each off unless asked for.
//!
//! ```text
//! log intensity -> filtered (photoreceptor, source follower) -> plus the leak's drift -> levels -> events
//!                                                                       ^ held after each (refractory period)
//!                                                       noise events -> ^
//! ```
//!
//! [`parameters`] says which effects there are, [`mismatch`] draws thresholds, [`shot_noise`] and [`hot_pixels`] the
//! arrivals of [`noise`], and an [`excursion`] is what follows one. [`leak`] is the
//! drift of references. [`filtered`] is the curve that leaves one low-pass, [`two_poles`] the one that leaves two,
//! [`input`] what a pixel sees over an interval, [`timeline`] what happens to it on the way. [`scan`] finds the pixels to which something may happen, [`band`] takes a band of rows (with
//! an [`estimate`] of how many events that makes), [`core`] runs
//! the bands on threads, and [`sensor`] holds what is the same for all pixels.
//!
//! An engine without effects uses none of this, so that an effect that is off costs nothing. What must not break: every
//! draw is a function of (seed, purpose, pixel, index), so draws depend neither on threads nor on when frames come.

mod arrivals;
mod band;
mod core;
mod estimate;
mod excursion;
mod filtered;
mod hot_pixels;
mod input;
mod leak;
mod mismatch;
mod noise;
mod parameters;
mod scan;
mod sensor;
mod shot_noise;
mod timeline;
mod two_poles;

pub(crate) use self::core::EffectCore;
pub(crate) use mismatch::mismatched;
pub use parameters::{Effects, HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise, ThresholdMismatch};
