//! What makes a pixel real: effects on its signal, its reference and its thresholds, each off unless asked for.
//!
//! ```text
//! log intensity -> filtered (photoreceptor) -> plus the leak's drift -> levels -> events
//!                                                                       ^ held after each (refractory period)
//!                                                       noise events -> ^
//! ```
//!
//! [`parameters`] says what there is, [`mismatch`] draws thresholds, [`noise`] arrivals; [`filtered`] is the curve that
//! leaves the photoreceptor, [`input`] what a pixel sees over an interval, [`timeline`] what happens to it on the way.
//! [`scan`] finds the pixels to which something may happen, [`band`] takes a band of rows, [`core`] the bands on threads.
//! An engine without effects uses none of this.

mod band;
mod chain;
mod core;
mod filtered;
mod input;
mod mismatch;
mod noise;
mod parameters;
mod scan;
mod timeline;

pub(crate) use self::core::EffectCore;
pub(crate) use mismatch::mismatched;
pub use parameters::{Effects, HotPixels, PhotoreceptorBandwidth, ShotNoise};
