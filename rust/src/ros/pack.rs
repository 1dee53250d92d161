//! Events to a message.

use super::layout::{AFTER_NAME, BEFORE_NAME, EVENT};
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// The latest time that a message can hold: its seconds are 32 bits.
pub const LATEST_US: i64 = (1 << 32) * 1_000_000 - 1;

/// Returns the size of a message in bytes.
#[must_use]
pub const fn packed_size(events: usize, frame_id: &[u8]) -> usize {
    BEFORE_NAME + frame_id.len() + AFTER_NAME + events * EVENT
}

/// Fills `message`, [`packed_size`] bytes long, with events; the header's stamp is the last one's time, or 0.
///
/// # Errors
/// [`Error::Argument`] for a time outside of `0..=LATEST_US`, with the index, or more than `u32::MAX` events.
///
/// # Panics
/// If `message` has another length.
pub fn pack_events(message: &mut [u8], events: &[Event], size: SensorSize, seq: u32, frame_id: &[u8]) -> Result<()> {
    assert_eq!(message.len(), packed_size(events.len(), frame_id), "the message's length");
    let (Ok(count), Ok(name)) = (u32::try_from(events.len()), u32::try_from(frame_id.len())) else {
        return Err(Error::Argument(format!("a message holds up to 2^32 - 1 events, got {}", events.len())));
    };
    let (head, body) = message.split_at_mut(BEFORE_NAME);
    let (text, body) = body.split_at_mut(frame_id.len());
    let (middle, body) = body.split_at_mut(AFTER_NAME);
    head[..4].copy_from_slice(&seq.to_le_bytes());
    let last_us = events.last().map_or(0, |event| event.t);
    head[4..12].copy_from_slice(&stamp(last_us).ok_or_else(|| late(events.len() - 1, last_us))?);
    head[12..].copy_from_slice(&name.to_le_bytes());
    text.copy_from_slice(frame_id);
    middle[..4].copy_from_slice(&u32::from(size.height).to_le_bytes());
    middle[4..8].copy_from_slice(&u32::from(size.width).to_le_bytes());
    middle[8..].copy_from_slice(&count.to_le_bytes());
    for (index, (bytes, event)) in body.chunks_exact_mut(EVENT).zip(events).enumerate() {
        bytes[..2].copy_from_slice(&event.x.to_le_bytes());
        bytes[2..4].copy_from_slice(&event.y.to_le_bytes());
        bytes[4..12].copy_from_slice(&stamp(event.t).ok_or_else(|| late(index, event.t))?);
        bytes[12] = event.p;
    }
    Ok(())
}

/// Seconds and nanoseconds; None where they do not fit.
#[allow(clippy::cast_possible_truncation, reason = "both were brought into range")]
fn stamp(t_us: i64) -> Option<[u8; 8]> {
    if !(0..=LATEST_US).contains(&t_us) {
        return None;
    }
    let t = t_us.unsigned_abs();
    let (seconds, nanoseconds) = ((t / 1_000_000) as u32, (t % 1_000_000) as u32 * 1000);
    Some((u64::from(nanoseconds) << 32 | u64::from(seconds)).to_le_bytes())
}

#[cold]
fn late(index: usize, t_us: i64) -> Error {
    Error::Argument(format!("a time of ROS must lie in 0..={LATEST_US} us: event {index} is at {t_us} us"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: SensorSize = SensorSize { width: 240, height: 180 };

    fn pack(events: &[Event]) -> Result<Vec<u8>> {
        let mut message = vec![0; packed_size(events.len(), b"dvs")];
        pack_events(&mut message, events, SIZE, 7, b"dvs").map(|()| message)
    }

    #[test]
    fn bytes_follow_the_definition() {
        let expected = [
            &[7, 0, 0, 0][..],                                // seq
            &[1, 0, 0, 0, 0xe8, 0x03, 0, 0],                  // 1 s, 1000 ns
            &[3, 0, 0, 0, b'd', b'v', b's'],                  // frame_id
            &[180, 0, 0, 0, 240, 0, 0, 0, 1, 0, 0, 0],        // height, width, count
            &[239, 0, 2, 1, 1, 0, 0, 0, 0xe8, 0x03, 0, 0, 1], // x, y, ts, polarity
        ];
        assert_eq!(pack(&[Event::new(1_000_001, 239, 258, true)]).unwrap(), expected.concat());
    }

    #[test]
    fn times_past_32_bits_of_seconds_are_refused() {
        assert!(pack(&[Event::new(LATEST_US, 0, 0, true)]).is_ok());
        for t in [-1, LATEST_US + 1, i64::MAX] {
            let refused = pack(&[Event::new(0, 0, 0, true), Event::new(t, 0, 0, true), Event::new(2, 0, 0, true)]);
            assert!(matches!(refused, Err(Error::Argument(m)) if m.contains(&format!("event 1 is at {t} us"))));
        }
    }
}
