//! A message to events.

use super::layout::{AFTER_NAME, BEFORE_NAME, EVENT};
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// The contents of a message.
#[derive(Debug, PartialEq, Eq)]
pub struct EventMessage {
    /// The sensor's size.
    pub size: SensorSize,
    /// The events, in the message's order.
    pub events: Vec<Event>,
}

/// Reads one message. Times are rounded to the nearest microsecond, halves up: recordings that were moved to wall-clock
/// time have nanoseconds.
///
/// # Errors
/// [`Error::Format`] with the byte where the message breaks the definition: its length, a sensor of more than 65,535
/// pixels a side, a polarity other than 0 or 1, nanoseconds of a second or more.
pub fn unpack_events(message: &[u8]) -> Result<EventMessage> {
    let word = |at: usize| -> Result<usize> {
        let bytes =
            message.get(at..at + 4).ok_or_else(|| fault("the message ends before its events", message.len()))?;
        Ok(u32::from_le_bytes(bytes.try_into().unwrap_or_default()) as usize)
    };
    let after_name = BEFORE_NAME.saturating_add(word(BEFORE_NAME - 4)?);
    if after_name > message.len() {
        return Err(fault("the message ends before its events", message.len()));
    }
    let pixels = |at| u16::try_from(word(at)?).map_err(|_| fault("a sensor's side must be 0..65535 pixels", at));
    let size = SensorSize { height: pixels(after_name)?, width: pixels(after_name + 4)? };
    let count = word(after_name + 8)?;
    let start = after_name + AFTER_NAME;
    let body = &message[start..];
    if count.checked_mul(EVENT) != Some(body.len()) {
        return Err(fault("a message must hold 13 bytes for each of the events it counts", after_name + 8));
    }
    let mut events = Vec::with_capacity(count);
    for (index, bytes) in body.chunks_exact(EVENT).enumerate() {
        let short = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let long = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let (seconds, nanoseconds, polarity) = (long(4), long(8), bytes[12]);
        if polarity > 1 {
            return Err(fault("polarity must be 0 or 1", start + index * EVENT + 12));
        }
        if nanoseconds >= 1_000_000_000 {
            return Err(fault("nanoseconds must be less than a second", start + index * EVENT + 8));
        }
        let t_us = i64::from(seconds) * 1_000_000 + i64::from((nanoseconds + 500) / 1000);
        events.push(Event::new(t_us, short(0), short(2), polarity == 1));
    }
    Ok(EventMessage { size, events })
}

#[cold]
fn fault(rule: &str, byte: usize) -> Error {
    Error::Format { message: format!("dvs_msgs/EventArray: {rule}"), line: None, byte }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::{LATEST_US, pack_events, packed_size};
    use proptest::prelude::*;

    const SIZE: SensorSize = SensorSize { width: 240, height: 180 };

    fn packed(events: &[Event], frame_id: &[u8]) -> Vec<u8> {
        let mut message = vec![0; packed_size(events.len(), frame_id)];
        pack_events(&mut message, events, SIZE, 0, frame_id).unwrap();
        message
    }

    #[test]
    fn nanoseconds_are_rounded_to_the_nearest_microsecond() {
        for (nanoseconds, t_us) in [(499u32, 0), (500, 1), (1_499, 1), (999_999_999, 1_000_000)] {
            let mut message = packed(&[Event::new(0, 0, 0, true)], b"");
            let at = message.len() - 5;
            message[at..at + 4].copy_from_slice(&nanoseconds.to_le_bytes());
            assert_eq!(unpack_events(&message).unwrap().events[0].t, t_us);
        }
    }

    #[test]
    fn faults_are_named_with_their_byte() {
        let whole = packed(&[Event::new(0, 0, 0, true)], b"dvs");
        let broken = |at: usize, byte: u8| {
            let mut message = whole.clone();
            message[at] = byte;
            message
        };
        for (message, rule, place) in [
            (vec![0; 5], "ends before", 5),
            (whole[..20].to_vec(), "ends before", 20),
            (broken(15, 255), "ends before", whole.len()),
            (broken(21, 1), "65535", 19),
            (broken(27, 2), "13 bytes", 27),
            (whole[..whole.len() - 1].to_vec(), "13 bytes", 27),
            (broken(43, 2), "polarity", 43),
            (broken(42, 255), "nanoseconds", 39),
        ] {
            match unpack_events(&message) {
                Err(Error::Format { message, byte, .. }) => {
                    assert!(message.contains(rule) && byte == place, "{message} {byte}");
                }
                other => panic!("{rule}: {other:?}"),
            }
        }
    }

    proptest! {
        #[test]
        fn what_is_packed_is_unpacked(raw in prop::collection::vec((0..=LATEST_US, any::<u16>(), any::<u16>(), any::<bool>()), 0..50), frame_id in "[a-z/]{0,12}") {
            let events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            let message = packed(&events, frame_id.as_bytes());
            prop_assert_eq!(unpack_events(&message).unwrap(), EventMessage { size: SIZE, events });
        }

        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            let _ = unpack_events(&bytes);
        }
    }
}
