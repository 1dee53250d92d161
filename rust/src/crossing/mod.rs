//! The crossing engine: where the log intensity of a pixel reaches a level, an event falls.
//!
//! ```text
//! frame -> scan: which samples left their pixel's bounds?
//!       -> candidates: those in vector registers, where one event is beyond doubt
//!       -> pixel: the rest, exactly
//!       -> order: all by time
//! ```
//!
//! [`level`] knows where the levels lie, [`curve`] ([`line`], [`cubic`]) when log intensity reaches one, [`pixel`] which
//! events one new sample makes. [`sample`], [`steps`], [`scan`] and [`candidates`] spare nearly all pixels that; [`band`] does it all for
//! a band of rows ([`room`] keeps its events), [`core`] runs the bands on threads, [`engine`] is what the user sees, [`restore`] stores it. Pixels under [`effects`] go their
//! own way from frame to events.

mod band;
mod candidates;
mod core;
mod cubic;
mod cubic_candidates;
mod curve;
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

pub use effects::{Effects, HotPixels, PhotoreceptorBandwidth, ShotNoise};
pub use engine::{CrossingEngine, MOST_THREADS};
pub use frame::{Frame, SparseSamples};
pub use parameters::{CrossingParameters, Interpolation, Threshold};
pub use reconstruct::reconstruct;
pub use state::{EffectState, EngineState};
