//! Triggers: edges at the camera's external input and generator, and resets of its clock.
//!
//! What must not break: a trigger's layout is that of Python's `TRIGGER_DTYPE`, which reads these arrays in place.

use super::word;

/// Something that happened at the camera's connectors or to its clock, in 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// Microseconds since the clock's last reset; of a reset, 0.
    pub t: i64,
    /// What happened.
    pub kind: TriggerKind,
    /// Padding written out, so that equal triggers are equal bytes.
    padding: [u8; 7],
}

impl Trigger {
    /// Returns a trigger at `t` microseconds.
    #[must_use]
    pub const fn new(t: i64, kind: TriggerKind) -> Self {
        Self { t, kind, padding: [0; 7] }
    }
}

/// The kind of a trigger; its number is that of the word in the camera's stream.
#[repr(u8)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriggerKind {
    /// The clock was set to zero.
    TimestampReset = 1,
    /// The external input fell.
    InputFalling = 2,
    /// The external input rose.
    InputRising = 3,
    /// A pulse at the external input.
    InputPulse = 4,
    /// The camera's own generator fell.
    GeneratorFalling = 0x10,
    /// The camera's own generator rose.
    GeneratorRising = 0x11,
}

impl TriggerKind {
    /// Returns the kind by its number, if there is one of that number.
    #[must_use]
    pub const fn of(number: u16) -> Option<Self> {
        Some(match number {
            word::TIMESTAMP_RESET => Self::TimestampReset,
            word::INPUT_FALLING => Self::InputFalling,
            word::INPUT_RISING => Self::InputRising,
            word::INPUT_PULSE => Self::InputPulse,
            word::GENERATOR_FALLING => Self::GeneratorFalling,
            word::GENERATOR_RISING => Self::GeneratorRising,
            _ => return None,
        })
    }
}
