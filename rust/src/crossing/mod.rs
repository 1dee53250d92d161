//! The crossing engine: an event falls wherever the log intensity of a pixel reaches one of its levels.
//!
//! ```text
//! frame -> scan        which samples left their pixel's bounds?
//!       -> candidates  those, many at a time in vector registers, where the event is beyond doubt
//!       -> pixel       the rest, exactly
//!       -> order       all events by time
//! ```
//!
//! [`level`] says where the levels lie. [`curve`], [`mod@line`] and [`cubic`] say when log intensity reaches one. [`pixel`]
//! says which events one new sample makes: it is the whole rule. [`sample`], [`steps`], [`scan`], [`decision`],
//! [`candidates`] and [`cubic_candidates`] only spare nearly all pixels that work, and leave to it what they cannot
//! decide beyond doubt. [`band`] does all of it for a band of rows ([`room`] keeps its events), [`core`] runs the bands
//! on threads, [`engine`] is what the user sees, [`restore`] stores and restores it. Pixels under [`effects`] take
//! another way from frame to events.
//!
//! What must not break: the events are those of [`pixel`] alone, the same on any number of threads and for any split of
//! the pixels into bands, and an error changes no state.

mod band;
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
mod parameters;
mod pixel;
mod reconstruct;
mod restore;
mod room;
mod sample;
mod scan;
mod state;
mod steps;

pub use effects::{Effects, HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise};
pub use engine::{CrossingEngine, MOST_THREADS};
pub use frame::{Frame, SparseSamples};
pub use parameters::{CrossingParameters, Interpolation, Threshold};
pub use reconstruct::reconstruct;
pub use state::{EffectState, EngineState};
