//! Text to events, strictly.

use crate::error::{Error, Result};
use crate::event::Event;

/// Parses the whole of an events.txt, given as its bytes.
///
/// Times need one to nine decimals and must be whole microseconds; they may not decrease. Lines end with a newline
/// (the last one may lack it).
///
/// # Errors
/// [`Error::Format`] with line and byte for the first line that is not `sec.nnnnnnnnn x y p`.
pub fn read_events_text(bytes: &[u8]) -> Result<Vec<Event>> {
    let mut events: Vec<Event> = Vec::with_capacity(bytes.len() / 20);
    let mut start = 0;
    for (index, line) in bytes.split_inclusive(|&b| b == b'\n').enumerate() {
        let text = line.trim_ascii();
        let event = parse_line(text)
            .and_then(|event| match events.last() {
                Some(last) if event.t < last.t => Err("event times must not decrease"),
                _ => Ok(event),
            })
            .map_err(|rule| Error::Format {
                message: format!("{rule}: {:?}", String::from_utf8_lossy(&text[..text.len().min(60)])),
                line: index + 1,
                byte: start,
            })?;
        events.push(event);
        start += line.len();
    }
    Ok(events)
}

fn parse_line(line: &[u8]) -> std::result::Result<Event, &'static str> {
    let mut words = line.split(|&b| b == b' ').filter(|word| !word.is_empty());
    let (Some(t), Some(x), Some(y), Some(p), None) =
        (words.next(), words.next(), words.next(), words.next(), words.next())
    else {
        return Err("a line must be 'timestamp x y polarity'");
    };
    let coordinate = |word| parse_number(word).and_then(|n| u16::try_from(n).ok());
    let t = parse_time(t)?;
    let x = coordinate(x).ok_or("x must be an integer in 0..65535")?;
    let y = coordinate(y).ok_or("y must be an integer in 0..65535")?;
    match p {
        b"0" => Ok(Event::new(t, x, y, false)),
        b"1" => Ok(Event::new(t, x, y, true)),
        _ => Err("polarity must be 0 or 1"),
    }
}

/// Seconds as a decimal fraction to microseconds.
fn parse_time(word: &[u8]) -> std::result::Result<i64, &'static str> {
    const RULE: &str = "a timestamp must be seconds with one to nine decimals, such as 0.003811000";
    let point = word.iter().position(|&b| b == b'.').ok_or(RULE)?;
    let (seconds, decimals) = (&word[..point], &word[point + 1..]);
    if decimals.is_empty() || decimals.len() > 9 {
        return Err(RULE);
    }
    let mut nanoseconds = parse_number(decimals).ok_or(RULE)?;
    for _ in decimals.len()..9 {
        nanoseconds *= 10;
    }
    if nanoseconds % 1000 != 0 {
        return Err("a timestamp must be whole microseconds");
    }
    parse_number(seconds).and_then(|s| s.checked_mul(1_000_000)?.checked_add(nanoseconds / 1000)).ok_or(RULE)
}

/// A number of decimal digits alone, if it fits.
fn parse_number(word: &[u8]) -> Option<i64> {
    if word.is_empty() {
        return None;
    }
    word.iter().try_fold(0i64, |number, &b| {
        let digit = b.is_ascii_digit().then(|| i64::from(b - b'0'))?;
        number.checked_mul(10)?.checked_add(digit)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::EventTextWriter;
    use proptest::prelude::*;

    #[test]
    fn faults_are_named_with_line_and_byte() {
        for (line, rule) in [
            ("1.0 2 3", "a line must be"),
            ("1.0 2 3 1 5", "a line must be"),
            ("1 2 3 1", "decimals"),
            ("1. 2 3 1", "decimals"),
            ("1.0000000000 2 3 1", "decimals"),
            ("-1.0 2 3 1", "decimals"),
            ("1e3.0 2 3 1", "decimals"),
            ("9223372036855.0 2 3 1", "decimals"),
            ("1.0000001 2 3 1", "whole microseconds"),
            ("1.0 65536 3 1", "x must be"),
            ("1.0 2 -3 1", "y must be"),
            ("1.0 2 3 2", "polarity"),
            ("0.4 2 3 1", "must not decrease"),
            ("", "a line must be"),
        ] {
            let text = format!("0.500000000 1 1 0\n{line}\n");
            match read_events_text(text.as_bytes()) {
                Err(Error::Format { message, line: 2, byte: 18 }) => {
                    assert!(message.contains(rule), "{line:?}: {message}");
                }
                other => panic!("{line:?}: {other:?}"),
            }
        }
    }

    #[test]
    fn fewer_decimals_and_a_last_line_without_newline_are_read() {
        let events = read_events_text(b"0.5 1 2 0\r\n0.500001 3 4 1").unwrap();
        assert_eq!(events, [Event::new(500_000, 1, 2, false), Event::new(500_001, 3, 4, true)]);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(raw in prop::collection::vec((0i64..1 << 40, any::<u16>(), any::<u16>(), any::<bool>()), 0..50)) {
            let mut events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            events.sort_by_key(|e| e.t);
            let mut writer = EventTextWriter::new(Vec::new());
            for packet in events.chunks(7) {
                writer.write(packet).unwrap();
            }
            prop_assert_eq!(read_events_text(&writer.finish().unwrap()).unwrap(), events);
        }
    }
}
