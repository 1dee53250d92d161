//! The crossing engine: where the log intensity of a pixel reaches a level, an event falls.
//!
//! [`level`] knows where the levels lie, [`tick`] when a line reaches one, [`pixel`] which events one new sample
//! makes, [`engine`] runs that over frames and threads.

mod engine;
mod level;
mod parameters;
mod pixel;
mod reconstruct;
mod tick;

pub use engine::CrossingEngine;
pub use parameters::CrossingParameters;
pub use reconstruct::reconstruct;
