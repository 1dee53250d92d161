//! The USB stream of a real DAVIS, both ways.
//!
//! The camera sends little-endian 16-bit words: timestamps, row and column addresses of events, bytes of inertial
//! samples, samples of the frame's pixels, and marks between them (`word` lists all). [`Decoder`] turns them into
//! events, [`ImuReading`]s, [`Frame`]s and [`Trigger`]s. [`Encoder`] does the inverse. Neither reads or writes files or
//! devices.
//!
//! The rules are those of logic version 18, as the public drivers (libcaer 3.3, jAER) and the logic's VHDL have them.
//!
//! ```text
//! bytes -> decoder, word by word -> clock, addresses, imu, frame_assembler -> Decoded
//!            `-> fast_path -> block -> lanes: the same for runs of plain words, many at a time
//! Decoded -> packet_check -> encoder -> bytes
//! ```
//!
//! What must not break: a malformed stream never stops the decoder. It drops what it cannot use and counts it in
//! [`Stats`]. Decoding what was encoded gives back the same data, except for what [`Encoder`] lists.

mod addresses;
mod block;
mod clock;
mod decoded;
mod decoder;
mod device;
mod encoder;
mod fast_path;
mod frame;
mod frame_assembler;
mod imu;
mod lanes;
mod packet_check;
mod state;
mod stats;
mod trigger;
mod word;

pub use decoded::Decoded;
pub use decoder::Decoder;
pub use device::{Chip, Device};
pub use encoder::Encoder;
pub use frame::{Frame, Region};
pub use imu::{ImuGroups, ImuReading, ImuSample, ImuType, STANDARD_GRAVITY};
pub use stats::Stats;
pub use trigger::{Trigger, TriggerKind};
