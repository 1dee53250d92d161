//! The 16-bit words of the wire: what their upper bits say and where their payload is.
//!
//! The numbers are those of logic version 18 (libcaer 3.3, jAER, the logic's VHDL). All other modules take them from
//! here, so that each number is written once.

/// Words from here on carry a time: its low 15 bits, above the wrap offset.
pub(super) const TIMESTAMP: u16 = 0x8000;
/// A wrap: the wrap offset grows by 2^15 us, times the low 12 bits.
pub(super) const WRAP: u16 = 0x7000;
/// A row address.
pub(super) const ROW: u16 = 0x1000;
/// A column address: an event, OFF.
pub(super) const COLUMN_OFF: u16 = 0x2000;
/// A column address: an event, ON.
pub(super) const COLUMN_ON: u16 = 0x3000;
/// The bit that makes a column's event an ON one.
pub(super) const ON: u16 = 0x1000;
/// A sample of the frame's converter.
pub(super) const SAMPLE: u16 = 0x4000;
/// A byte of an inertial sample.
pub(super) const IMU_BYTE: u16 = 0x5000;
/// High byte of a bound of the frame's region.
pub(super) const REGION_HIGH: u16 = 0x5100;
/// Low byte of a bound of the frame's region.
pub(super) const REGION_LOW: u16 = 0x5200;
/// What an inertial sample holds, and its full scales.
pub(super) const IMU_SCALE: u16 = 0x5300;
/// Ten bits of the exposure in cycles of the converter's clock.
pub(super) const EXPOSURE: u16 = 0x6000;

/// The payload of an address, a sample or a wrap.
pub(super) const LOW_12: u16 = 0x0FFF;
/// The payload of a timestamp.
pub(super) const LOW_15: u16 = 0x7FFF;
/// The payload of an exposure word.
pub(super) const LOW_10: u16 = 0x03FF;

/// Marks without a payload.
pub(super) const TIMESTAMP_RESET: u16 = 0x0001;
pub(super) const INPUT_FALLING: u16 = 0x0002;
pub(super) const INPUT_RISING: u16 = 0x0003;
pub(super) const INPUT_PULSE: u16 = 0x0004;
pub(super) const IMU_START: u16 = 0x0005;
pub(super) const IMU_END: u16 = 0x0007;
pub(super) const FRAME_START_GLOBAL: u16 = 0x0008;
pub(super) const FRAME_START_ROLLING: u16 = 0x0009;
pub(super) const FRAME_END: u16 = 0x000A;
pub(super) const RESET_COLUMN_START: u16 = 0x000B;
pub(super) const SIGNAL_COLUMN_START: u16 = 0x000C;
pub(super) const COLUMN_END: u16 = 0x000D;
pub(super) const EXPOSURE_START: u16 = 0x000E;
pub(super) const EXPOSURE_END: u16 = 0x000F;
pub(super) const GENERATOR_FALLING: u16 = 0x0010;
pub(super) const GENERATOR_RISING: u16 = 0x0011;
