//! Encodes events, inertial samples, frames and triggers as the camera's words: the inverse of the decoder.
//!
//! Tests, recordings and the camera in software need streams whose contents are known. The encoder sends what the
//! camera's logic sends, in the same order, because other people's drivers read it too.
//!
//! What must not break:
//! - Decoding gives back what was encoded, except for what [`Encoder`] lists.
//! - A packet is checked as a whole ([`packet_check`]) before its first word, so that an error leaves the clock as it
//!   was and no word is sent.

use super::clock::WRAP_BITS;
use super::decoded::Decoded;
use super::device::Device;
use super::frame::{Frame, PIXEL_SHIFT, WHITE};
use super::frame_assembler::{EXPOSURE_WORDS, Read, to_wire_order};
use super::imu::ImuReading;
use super::packet_check;
use super::trigger::TriggerKind;
use super::word;
use crate::error::Result;
use crate::event::Event;

/// Encodes what a camera of this kind would send: the inverse of [`Decoder`](super::Decoder).
///
/// As the camera's logic does, it sends a timestamp only when time changed, a wrap for each 2^15 us (several in one
/// word where nothing happened between them), and a row once for the columns that share its time. What happens at one
/// time goes out in the order of frames, inertial samples, triggers, events. A frame's reads go out in one piece each.
///
/// Decoding gives back what was encoded, but for what the wire does not carry: of a pixel the upper ten bits (on a
/// DAVIS240 nine, and white), and a frame or sample that lies across a multiple of 2^31 us, which decoders lose.
pub struct Encoder {
    device: Device,
    /// The time that wraps brought, and the last time sent.
    base: i64,
    now: i64,
    /// The row that the next column belongs to.
    row: Option<u16>,
    bytes: Vec<u8>,
}

/// Something that is sent at a time, other than events.
enum Step<'a> {
    FrameStart(&'a Frame),
    ExposureStart(&'a Frame),
    ExposureEnd(&'a Frame),
    FrameEnd,
    Imu(&'a ImuReading),
    Trigger(TriggerKind),
}

impl Encoder {
    /// Returns an encoder whose clock is at 0.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for sizes out of range.
    pub fn new(device: Device) -> Result<Self> {
        device.check()?;
        Ok(Self { device, base: 0, now: 0, row: None, bytes: Vec::new() })
    }

    /// Returns the camera whose stream is made.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Returns the last time encoded in microseconds: no later packet may go behind it.
    #[must_use]
    pub fn t_us(&self) -> i64 {
        self.now
    }

    /// Returns the bytes of the next packet.
    ///
    /// Times must lie in 0..2^48 us, may not decrease within a kind, nor lie before the last time encoded; frames may
    /// not overlap. Resets of the clock come before everything else in `packet`, at time 0.
    ///
    /// # Errors
    /// [`Error::Order`](crate::Error::Order) for times that go back, [`Error::Argument`](crate::Error::Argument) for
    /// what does not fit the camera, with the index; nothing is encoded then.
    pub fn encode(&mut self, packet: &Decoded) -> Result<Vec<u8>> {
        let resets = packet.triggers.iter().take_while(|trigger| trigger.kind == TriggerKind::TimestampReset).count();
        packet_check::check(packet, resets, &self.device, if resets > 0 { 0 } else { self.now })?;
        for _ in 0..resets {
            self.word(word::TIMESTAMP_RESET);
            (self.base, self.now) = (0, 0);
        }
        let mut events = &packet.events[..];
        for (t, step) in steps(packet, resets) {
            let (before, rest) = events.split_at(events.partition_point(|event| event.t < t));
            self.events(before);
            events = rest;
            self.step(t, &step);
        }
        self.events(events);
        Ok(std::mem::take(&mut self.bytes))
    }

    fn events(&mut self, events: &[Event]) {
        self.bytes.reserve(3 * events.len());
        for event in events {
            let (column, row) = if self.device.dvs_swapped { (event.y, event.x) } else { (event.x, event.y) };
            self.time(event.t);
            if self.row != Some(row) {
                self.word(word::ROW | row);
                self.row = Some(row);
            }
            self.word(if event.p == 0 { word::COLUMN_OFF } else { word::COLUMN_ON } | column);
        }
    }

    fn step(&mut self, t: i64, step: &Step) {
        self.time(t);
        match step {
            Step::FrameStart(frame) => {
                self.frame_start(frame);
                if frame.global_shutter {
                    self.read(frame, Read::Reset);
                }
            }
            Step::ExposureStart(frame) => {
                self.word(word::EXPOSURE_START);
                if !frame.global_shutter {
                    self.read(frame, Read::Reset);
                }
            }
            Step::ExposureEnd(frame) => {
                self.word(word::EXPOSURE_END);
                self.read(frame, Read::Signal);
            }
            Step::FrameEnd => self.word(word::FRAME_END),
            Step::Imu(reading) => self.imu(**reading),
            Step::Trigger(kind) => self.word(*kind as u16),
        }
    }

    /// Sends what brings the clock to `t`. If time changed, the next event needs its row sent again.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "each is masked to its bits")]
    fn time(&mut self, t: i64) {
        if t == self.now {
            return;
        }
        let mut wraps = (t - self.base) >> WRAP_BITS;
        self.base += wraps << WRAP_BITS;
        while wraps > 0 {
            let step = wraps.min(i64::from(word::LOW_12));
            self.word(word::WRAP | step as u16);
            wraps -= step;
        }
        if t > self.base {
            self.word(word::TIMESTAMP | (t - self.base) as u16);
        }
        self.now = t;
        self.row = None;
    }

    #[allow(clippy::cast_possible_truncation, reason = "masked to ten bits")]
    fn frame_start(&mut self, frame: &Frame) {
        self.word(if frame.global_shutter { word::FRAME_START_GLOBAL } else { word::FRAME_START_ROLLING });
        for i in 0..EXPOSURE_WORDS {
            self.word(word::EXPOSURE | ((frame.exposure_cycles >> (10 * i)) as u16 & word::LOW_10));
        }
        let region = frame.region;
        for bound in [region.x, region.y, region.x + region.width - 1, region.y + region.height - 1] {
            let [high, low] = bound.to_be_bytes();
            self.word(word::REGION_HIGH | u16::from(high));
            self.word(word::REGION_LOW | u16::from(low));
        }
    }

    /// Sends one of a frame's two reads, column by column.
    fn read(&mut self, frame: &Frame, read: Read) {
        let device = &self.device;
        // The reset level, from which every intensity that there is can be subtracted.
        let (shift, reset) = if device.samples_count_double() { (1, 512) } else { (0, WHITE) };
        let orientation = (device.aps_swapped, device.aps_flip_x, device.aps_flip_y);
        let rows = usize::from(if device.aps_swapped { frame.region.width } else { frame.region.height });
        let start = match read {
            Read::Reset => word::RESET_COLUMN_START,
            Read::Signal => word::SIGNAL_COLUMN_START,
        };
        for column in to_wire_order(&frame.pixels, rows, orientation).chunks_exact(rows) {
            self.word(start);
            for pixel in column {
                let intensity = pixel >> PIXEL_SHIFT;
                let sample = match read {
                    Read::Reset => reset,
                    Read::Signal if intensity == WHITE => 0,
                    Read::Signal => reset - (intensity >> shift),
                };
                self.word(word::SAMPLE | sample);
            }
            self.word(word::COLUMN_END);
        }
    }

    fn imu(&mut self, mut reading: ImuReading) {
        reading.flip(self.device.imu_flips);
        let ImuReading { accel, gyro, temperature, groups, accel_range, gyro_range, .. } = reading;
        self.word(word::IMU_START);
        self.word(word::IMU_SCALE | u16::from(groups.0 << 5 | accel_range << 2 | gyro_range));
        let present = [(groups.accel(), &accel[..]), (groups.temperature(), &[temperature]), (groups.gyro(), &gyro)];
        for value in present.into_iter().filter(|(present, _)| *present).flat_map(|(_, values)| values) {
            for byte in value.to_be_bytes() {
                self.word(word::IMU_BYTE | u16::from(byte));
            }
        }
        self.word(word::IMU_END);
    }

    fn word(&mut self, word: u16) {
        self.bytes.extend_from_slice(&word.to_le_bytes());
    }
}

/// Returns what is to be sent besides events, in the order of time; without the first `resets` triggers, which were
/// sent.
fn steps(packet: &Decoded, resets: usize) -> Vec<(i64, Step<'_>)> {
    let mut steps = Vec::new();
    for frame in &packet.frames {
        steps.push((frame.t_start, Step::FrameStart(frame)));
        steps.push((frame.t_exposure_start, Step::ExposureStart(frame)));
        steps.push((frame.t_exposure_end, Step::ExposureEnd(frame)));
        steps.push((frame.t_end, Step::FrameEnd));
    }
    steps.extend(packet.imu.iter().map(|reading| (reading.t, Step::Imu(reading))));
    steps.extend(packet.triggers[resets..].iter().map(|trigger| (trigger.t, Step::Trigger(trigger.kind))));
    steps.sort_by_key(|(t, _)| *t);
    steps
}
