//! The packet that a decoder fills and an encoder takes: one plain vector for each kind of data.
//!
//! These are vectors rather than a callback for each kind, because a reader clears and refills them, and Python takes
//! them as arrays without a copy.

use super::frame::Frame;
use super::imu::ImuReading;
use super::trigger::Trigger;
use crate::event::Event;

/// Everything of a piece of the stream, by kind; each in the order of the wire.
///
/// [`Decoder::push`](super::Decoder::push) appends to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decoded {
    /// Brightness changes.
    pub events: Vec<Event>,
    /// Inertial samples, in counts.
    pub imu: Vec<ImuReading>,
    /// Frames of the active pixels.
    pub frames: Vec<Frame>,
    /// Edges of the external input and of the generator, and resets of the clock.
    pub triggers: Vec<Trigger>,
}

impl Decoded {
    /// Forgets what is in it, and keeps the memory.
    pub fn clear(&mut self) {
        self.events.clear();
        self.imu.clear();
        self.frames.clear();
        self.triggers.clear();
    }
}
