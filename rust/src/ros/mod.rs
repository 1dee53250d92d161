//! `dvs_msgs/EventArray` of ROS 1: the message in which recordings of real cameras carry events.
//!
//! ```text
//! Header header      uint32 seq, time stamp, string frame_id
//! uint32 height
//! uint32 width
//! Event[] events     uint32 count, then each: uint16 x, uint16 y, time ts, bool polarity (13 bytes)
//! ```
//!
//! All little-endian and without padding; a time is two uint32, seconds and nanoseconds. The container (the bag) is not
//! of this module. Source: `rpg_dvs_ros`, `dvs_msgs/msg`; <http://wiki.ros.org/roscpp/Overview/MessagesSerializationAndAdaptingTypes>.

mod layout;
mod pack;
mod unpack;

pub use pack::{LATEST_US, pack_events, packed_size};
pub use unpack::{EventMessage, unpack_events};
