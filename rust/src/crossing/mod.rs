//! The crossing engine: an event occurs wherever the log intensity of a pixel reaches one of its levels.
//!
//! ```text
//! frame -> scan        which samples left the reach of their pixel's mark?
//!       -> candidates  those, many at a time in vector registers, where the event is beyond doubt
//!       -> pixel       the rest, exactly
//!       -> order       all events by time
//! ```
//!
//! [`pixel`] is the whole rule: it says which events one new sample makes. [`level`] says where the levels lie.
//! [`curve`], [`mod@line`] and [`cubic`] say when log intensity reaches one. [`start_phase`] says where references
//! begin.
//!
//! Running that rule on every pixel would be slow. So [`sample`], [`marks`], [`steps`], [`scan`], [`decision`],
//! [`candidates`], [`line_candidates`] and [`cubic_candidates`] decide nearly all pixels in vector code, and leave to
//! [`pixel`] what they cannot decide beyond doubt. Where the processor allows it, [`registers`] does the same faster. [`band`] does all of it for a band of rows:
//! [`prefetch`](crate::prefetch) brings its frame near, [`record`] is what only events touch, [`band_events`] and [`buffer`]
//! keep the events. [`core`] runs the bands on threads. [`engine`] is what the user sees, and [`restore`] stores and restores
//! it. Pixels under [`effects`] take a different way from frame to events.
//!
//! What must not break: the events are those of [`pixel`] alone, the same on any number of threads and for any split of
//! the pixels into bands. An error changes no state.

#[cfg(test)]
mod against_rule;
mod band;
mod band_events;
mod buffer;
mod candidates;
mod core;
mod cubic;
mod cubic_candidates;
mod curve;
mod decision;
mod effects;
mod engine;
mod exponential;
mod frame;
mod level;
mod line;
mod line_candidates;
mod marks;
mod parameters;
mod pixel;
mod reconstruct;
mod record;
mod registers;
mod restore;
mod sample;
mod scan;
mod start_phase;
mod state;
mod steps;

pub use effects::{Effects, HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise, ThresholdMismatch};
pub use engine::{CrossingEngine, MOST_THREADS};
pub use frame::{Frame, SparseSamples};
pub use parameters::{CrossingParameters, Interpolation, Threshold};
pub use reconstruct::reconstruct;
pub use start_phase::StartPhase;
pub use state::{EffectState, EngineState};
