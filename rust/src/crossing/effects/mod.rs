//! Effects of a real sensor on the signal, the reference and the thresholds of its pixels. Each is off by default.
//!
//! ```text
//! log intensity -> filtered (photoreceptor, source follower) -> plus the leak's drift -> levels -> events
//!                                                                       ^ held after each (refractory period)
//!                                                             noise -> ^
//! ```
//!
//! - [`parameters`] says which effects there are. [`mismatch`] draws thresholds.
//! - [`shot_noise`] says how large and how fast noise is, [`two_pole_noise`] how it moves, [`noise_path`] follows it
//!   in a pixel, and [`near_noise`] in many pixels that are near a level. [`hot_pixels`] draws events that are no noise of the signal.
//! - [`leak`] is the drift of references. [`filtered`] is the output curve of one low-pass, [`two_poles`] that of two.
//! - [`input`] is what a pixel sees over an interval, [`chords`] takes a cubic as straight lines, and [`timeline`] what happens to the pixel on the way.
//! - [`scan`] finds the pixels to which something may happen. [`band`] takes a band of rows, with an [`estimate`] of
//!   the events that it makes. [`core`] runs the bands on threads, and [`sensor`] holds what is the same for all
//!   pixels.
//!
//! An engine without effects uses none of this, so that an effect that is off costs nothing.
//!
//! What must not break: every draw is a function of (seed, purpose, pixel, index). So draws depend neither on threads
//! nor on when frames come.

#[cfg(test)]
mod against_chords;
mod band;
mod chords;
mod core;
mod estimate;
mod filtered;
mod hot_pixels;
mod input;
mod leak;
mod mismatch;
mod near_noise;
mod noise_path;
mod parameters;
mod scan;
mod sensor;
mod shot_noise;
mod timeline;
mod two_pole_noise;
mod two_poles;

pub(crate) use self::core::EffectCore;
pub(crate) use mismatch::mismatched;
pub use parameters::{Effects, HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise, ThresholdMismatch};
