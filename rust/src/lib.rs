//! The hot code of `davis_rs`, a simulator of the DAVIS event camera.
//!
//! ```text
//! luma frames -> crossing::CrossingEngine -> [Event] -> EventTextWriter -> events.txt
//!   USB bytes -> aer::Decoder -------------> [Event]
//! ```
//!
//! Linear luma frames go in, one after the other; out come events stamped to the microsecond wherever the log
//! intensity of a pixel crosses one of its levels, sorted and independent of the number of threads. Everything meets
//! at [`Event`]. The Python bindings (feature `python`) are a thin layer on top and the only place that knows them.

pub mod aer;
mod crossing;
mod error;
mod event;
mod exact;
mod log_intensity;
mod order;
mod random;
mod readout;
mod text;

#[cfg(feature = "python")]
mod python;

pub use crossing::{
    CrossingEngine, CrossingParameters, EffectState, Effects, EngineState, Frame, HotPixels, Interpolation,
    PhotoreceptorBandwidth, ShotNoise, SparseSamples, Threshold, reconstruct,
};
pub use error::{Error, Result};
pub use event::{Event, SensorSize};
pub use log_intensity::{log_intensity, log_intensity_frame};
pub use readout::{ReadoutParameters, ReadoutState};
pub use text::{EventTextWriter, read_events_text};
