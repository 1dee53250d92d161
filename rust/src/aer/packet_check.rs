//! Checks a packet before the encoder sends any of it.
//!
//! All of it is checked first, so that a refused packet leaves the encoder as it was. Errors name the kind, the index
//! and the value.
//!
//! What must not break: the encoder relies on what is checked here. It casts times, addresses and sizes to their bits
//! without a check of its own.

use super::decoded::Decoded;
use super::device::Device;
use super::frame::{Frame, Region};
use super::frame_assembler::EXPOSURE_WORDS;
use super::imu::{ImuGroups, ImuReading};
use super::trigger::TriggerKind;
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// Times must lie below this, 8.9 years. A longer gap would need more wrap words than memory can hold.
const TIME_LIMIT_US: i64 = 1 << 48;

/// Refuses what cannot follow the time `now`; the first `resets` triggers are resets of the clock.
pub(super) fn check(packet: &Decoded, resets: usize, device: &Device, now: i64) -> Result<()> {
    in_order("event", packet.events.iter().map(|event| event.t), now)?;
    for (index, event) in packet.events.iter().enumerate() {
        check_event(event, device.size()).map_err(|rule| at("event", index, &rule))?;
    }
    in_order("IMU sample", packet.imu.iter().map(|reading| reading.t), now)?;
    for (index, reading) in packet.imu.iter().enumerate() {
        check_reading(reading).map_err(|rule| at("IMU sample", index, &rule))?;
    }
    let times = |frame: &Frame| [frame.t_start, frame.t_exposure_start, frame.t_exposure_end, frame.t_end];
    in_order("time of frames", packet.frames.iter().flat_map(times), now)?;
    for (index, frame) in packet.frames.iter().enumerate() {
        check_frame(frame, device.frame_size()).map_err(|rule| at("frame", index, &rule))?;
    }
    in_order("trigger", packet.triggers.iter().map(|trigger| trigger.t), now)?;
    for (index, trigger) in packet.triggers.iter().enumerate() {
        let is_reset = trigger.kind == TriggerKind::TimestampReset;
        if is_reset && (index >= resets || trigger.t != 0) {
            let rule = format!("a reset of the clock must come first and at 0, got one at {} us", trigger.t);
            return Err(at("trigger", index, &rule));
        }
    }
    Ok(())
}

fn at(what: &str, index: usize, rule: &str) -> Error {
    Error::Argument(format!("{what} {index}: {rule}"))
}

fn in_order(what: &str, times: impl Iterator<Item = i64>, now: i64) -> Result<()> {
    let mut last = now;
    for (index, t) in times.enumerate() {
        if t < last {
            return Err(Error::Order(format!("times must not decrease: {what} {index} is at {t} us, after {last} us")));
        }
        if t >= TIME_LIMIT_US {
            return Err(at(what, index, &format!("times must lie below 2^48 us, got {t}")));
        }
        last = t;
    }
    Ok(())
}

type Checked = std::result::Result<(), String>;

fn check_event(event: &Event, size: SensorSize) -> Checked {
    if event.x >= size.width || event.y >= size.height {
        return Err(format!("({}, {}) lies outside of {} x {}", event.x, event.y, size.width, size.height));
    }
    if event.p > 1 {
        return Err(format!("polarity must be 0 or 1, got {}", event.p));
    }
    Ok(())
}

fn check_reading(reading: &ImuReading) -> Checked {
    let ImuReading { groups: ImuGroups(groups), accel_range, gyro_range, .. } = *reading;
    if !(1..=7).contains(&groups) {
        return Err(format!("groups must lie in 1..7, got {groups}"));
    }
    if accel_range > 3 || gyro_range > 3 {
        return Err(format!("ranges must lie in 0..3, got {accel_range} and {gyro_range}"));
    }
    Ok(())
}

fn check_frame(frame: &Frame, size: SensorSize) -> Checked {
    let Region { x, y, width, height } = frame.region;
    let inside =
        |start: u16, length: u16, limit: u16| length > 0 && u32::from(start) + u32::from(length) <= limit.into();
    if !(inside(x, width, size.width) && inside(y, height, size.height)) {
        return Err(format!(
            "its region of {width} x {height} pixels at ({x}, {y}) must be a part of {} x {}",
            size.width, size.height
        ));
    }
    if frame.pixels.len() != frame.region.pixels() {
        return Err(format!("it has {} pixels for a region of {width} x {height}", frame.pixels.len()));
    }
    if frame.exposure_cycles >> (10 * EXPOSURE_WORDS) != 0 {
        return Err(format!("its exposure must lie below 2^30 cycles, got {}", frame.exposure_cycles));
    }
    Ok(())
}
