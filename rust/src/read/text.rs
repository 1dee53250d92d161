//! events.txt to events, strictly.

use super::reader::{Decode, DecoderState};
use crate::error::{Error, Result};
use crate::event::Event;

/// No line of an event is longer: a time of 13 digits and nine decimals, two coordinates, polarity, and some spaces.
const LONGEST_LINE: usize = 256;

/// Decodes lines `sec.nnnnnnnnn x y p`.
///
/// Times need one to nine decimals and must be whole microseconds; they may not decrease, unless told otherwise. Lines
/// end with a newline (the last one may lack it). A first line `width height` is taken for the sensor's size.
pub struct TextDecoder {
    /// Lines behind us; None where that is not known.
    lines: Option<usize>,
    bytes: usize,
    last_us: i64,
    in_order: bool,
    size: Option<(u32, u32)>,
}

impl TextDecoder {
    /// Returns a decoder of bytes that begin a line.
    #[must_use]
    pub fn new() -> Self {
        Self { lines: Some(0), bytes: 0, last_us: 0, in_order: true, size: None }
    }

    /// Returns the same, which also takes times that go back.
    #[must_use]
    pub fn in_any_order(self) -> Self {
        Self { in_order: false, ..self }
    }

    /// Decodes one line, with or without its newline.
    fn line(&mut self, line: &[u8], events: &mut Vec<Event>) -> Result<()> {
        let text = line.trim_ascii();
        match parse_line(text) {
            Ok(event) if self.in_order && event.t < self.last_us => {
                return Err(self.fault("event times must not decrease", text));
            }
            Ok(event) => {
                self.last_us = event.t;
                events.push(event);
            }
            Err(rule) => match parse_size(text) {
                Some(size) if self.bytes == 0 => self.size = Some(size),
                _ => return Err(self.fault(rule, text)),
            },
        }
        self.count(1, line.len());
        Ok(())
    }

    fn count(&mut self, lines: usize, bytes: usize) {
        self.lines = self.lines.map(|before| before + lines);
        self.bytes += bytes;
    }

    #[cold]
    fn fault(&self, rule: &str, text: &[u8]) -> Error {
        Error::Format {
            message: format!("{rule}: {:?}", String::from_utf8_lossy(&text[..text.len().min(60)])),
            line: self.lines.map(|lines| lines + 1),
            byte: self.bytes,
        }
    }
}

impl Default for TextDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decode for TextDecoder {
    fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize> {
        let mut at = 0;
        loop {
            // Lines as our own writer makes them; whatever else there may be is left to the strict rule below.
            while let Some((event, length)) = bytes.get(at..).and_then(common_line) {
                if self.in_order && event.t < self.last_us {
                    break;
                }
                self.last_us = event.t;
                events.push(event);
                self.count(1, length);
                at += length;
            }
            let rest = &bytes[at..];
            let Some(end) = rest.iter().position(|&b| b == b'\n') else {
                if rest.len() > LONGEST_LINE {
                    return Err(self.fault("a line must be 'timestamp x y polarity'", rest));
                }
                return Ok(at);
            };
            self.line(&rest[..=end], events)?;
            at += end + 1;
        }
    }

    fn end(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize> {
        // Cut before its polarity, it is no event and no fault.
        if bytes.is_empty() || is_cut(bytes) {
            return Ok(0);
        }
        self.line(bytes, events)?;
        Ok(bytes.len())
    }

    fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    fn resume(&mut self, byte: usize, _state: DecoderState) -> Result<()> {
        (self.lines, self.bytes, self.last_us) = ((byte == 0).then_some(0), byte, 0);
        Ok(())
    }
}

/// Returns an event and its line's length, where the line is `sec.nnnnnn000 x y p\n` and lies well within `bytes`.
#[inline]
fn common_line(bytes: &[u8]) -> Option<(Event, usize)> {
    let bytes: &[u8; 48] = bytes.first_chunk()?;
    let (seconds, mut at) = number(bytes, 0, 12, b'.')?;
    let decimals = u64::from_le_bytes(*bytes[at..].first_chunk()?);
    let zeros = decimals.wrapping_sub(0x3030_3030_3030_3030);
    // A byte that is no digit has a bit among its high four, before or after six is added.
    if (zeros | zeros.wrapping_add(0x0606_0606_0606_0606)) & 0xf0f0_f0f0_f0f0_f0f0 != 0 {
        return None;
    }
    // Eight digits to a number, by pairs (the ninth and the two before must be 0: whole microseconds).
    let pairs = zeros.wrapping_mul(10).wrapping_add(zeros >> 8) & 0x00ff_00ff_00ff_00ff;
    let fours = pairs.wrapping_mul(100).wrapping_add(pairs >> 16) & 0x0000_ffff_0000_ffff;
    let hundredths = fours.wrapping_mul(10_000).wrapping_add(fours >> 32) & 0xffff_ffff;
    if hundredths % 100 != 0 || bytes[at + 8] != b'0' || bytes[at + 9] != b' ' {
        return None;
    }
    at += 10;
    let (x, at) = number(bytes, at, 5, b' ')?;
    let (y, at) = number(bytes, at, 5, b' ')?;
    let on = bytes[at].wrapping_sub(b'0');
    if on > 1 || bytes[at + 1] != b'\n' {
        return None;
    }
    #[allow(clippy::cast_possible_wrap, reason = "12 digits of seconds")]
    let t = (seconds * 1_000_000 + hundredths / 100) as i64;
    Some((Event::new(t, u16::try_from(x).ok()?, u16::try_from(y).ok()?, on == 1), at + 2))
}

/// Returns a number of one to `most` digits from `at`, and where the `end` that follows it is over.
#[inline]
fn number(bytes: &[u8; 48], at: usize, most: usize, end: u8) -> Option<(u64, usize)> {
    let mut number = u64::from(digit(bytes[at])?);
    for (offset, &byte) in bytes.iter().enumerate().skip(at + 1).take(most) {
        if byte == end {
            return Some((number, offset + 1));
        }
        number = 10 * number + u64::from(digit(byte)?);
    }
    None
}

#[inline]
fn digit(byte: u8) -> Option<u8> {
    let digit = byte.wrapping_sub(b'0');
    (digit <= 9).then_some(digit)
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

/// Returns whether a last line without newline is one that was cut: made of what lines are made of, but no event.
fn is_cut(line: &[u8]) -> bool {
    line.iter().all(|b| b.is_ascii_digit() || b". ".contains(b)) && parse_line(line).is_err()
}

/// Reads `width height`, two integers of 1..65536.
fn parse_size(line: &[u8]) -> Option<(u32, u32)> {
    let mut words = line.split(|&b| b == b' ').filter(|word| !word.is_empty());
    let (Some(width), Some(height), None) = (words.next(), words.next(), words.next()) else { return None };
    let side = |word| parse_number(word).filter(|n| (1..=65_536).contains(n)).and_then(|n| u32::try_from(n).ok());
    Some((side(width)?, side(height)?))
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

/// Returns a number of decimal digits alone, if it fits.
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
    use crate::read::EventReader;
    use crate::read::testing::{any_split_decodes_alike, read};
    use crate::write::{EventWriter, Limits, TextEncoder};
    use proptest::prelude::*;

    #[test]
    fn faults_are_named_with_line_and_byte() {
        for (line, rule) in [
            ("1.0 2 3", "a line must be"),
            ("1.0 2 3 1 5", "a line must be"),
            ("240 180", "a line must be"),
            ("1 2 3 1", "decimals"),
            ("1. 2 3 1", "decimals"),
            ("1.0000000000 2 3 1", "decimals"),
            ("-1.0 2 3 1", "decimals"),
            ("1e3.0 2 3 1", "decimals"),
            ("9223372036855.0 2 3 1", "decimals"),
            ("1.0000001 2 3 1", "whole microseconds"),
            ("1.000000001 2 3 1", "whole microseconds"),
            ("1.000000010 2 3 1", "whole microseconds"),
            ("1.00000:000 2 3 1", "decimals"),
            ("1.00000/000 2 3 1", "decimals"),
            ("1.0 65536 3 1", "x must be"),
            ("1.000000000 65536 3 1", "x must be"),
            ("1.0 2 -3 1", "y must be"),
            ("1.0 2 3 2", "polarity"),
            ("0.4 2 3 1", "must not decrease"),
            ("0.400000000 2 3 1", "must not decrease"),
            ("", "a line must be"),
        ] {
            // With lines behind it, it meets the rule of common lines; without, the other one.
            for behind in ["", "2.000000000 1 1 0\n2.000000000 1 1 0\n2.000000000 1 1 0\n"] {
                let text = format!("0.500000000 1 1 0\n{line}\n{behind}");
                match read(text.as_bytes(), TextDecoder::new()) {
                    Err(Error::Format { message, line: Some(2), byte: 18 }) => {
                        assert!(message.contains(rule), "{line:?}: {message}");
                    }
                    other => panic!("{line:?}: {other:?}"),
                }
            }
        }
        assert!(matches!(read(&[b'1'; 1000], TextDecoder::new()), Err(Error::Format { line: Some(1), .. })));
    }

    #[test]
    fn fewer_decimals_and_a_last_line_without_newline_are_read() {
        let events = read(b"0.5 1 2 0\r\n0.500001 3 4 1", TextDecoder::new()).unwrap();
        assert_eq!(events, [Event::new(500_000, 1, 2, false), Event::new(500_001, 3, 4, true)]);
    }

    #[test]
    fn a_cut_last_line_is_left_over() {
        let whole = b"0.500000000 10 20 0\n0.500001000 30 40 1\n";
        for cut in 21..whole.len() {
            let mut reader = EventReader::new(&whole[..cut], TextDecoder::new());
            let mut events = Vec::new();
            reader.read(usize::MAX, &mut events).unwrap();
            let second_is_whole = cut + 1 >= whole.len();
            assert_eq!((events.len(), reader.left_over() == 0), (1 + usize::from(second_is_whole), second_is_whole));
        }
        assert!(read(b"0.5 1 2 0\n0.5 1 x", TextDecoder::new()).is_err());
    }

    #[test]
    fn a_first_line_may_hold_the_size() {
        let mut reader = EventReader::new(&b"240 180\n0.5 1 2 0\n"[..], TextDecoder::new());
        let mut events = Vec::new();
        reader.read(usize::MAX, &mut events).unwrap();
        assert_eq!((reader.size(), events.len(), reader.left_over()), (Some((240, 180)), 1, 0));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(raw in prop::collection::vec((0i64..1 << 40, any::<u16>(), any::<u16>(), any::<bool>()), 0..50), cut in 0usize..2000) {
            let mut events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            events.sort_by_key(|e| e.t);
            let mut writer = EventWriter::new(Vec::new(), TextEncoder::new(Limits::NONE)).unwrap();
            for packet in events.chunks(7) {
                writer.write(packet).unwrap();
            }
            let bytes = writer.finish().unwrap();
            any_split_decodes_alike(&bytes, cut, TextDecoder::new, &events)?;
        }

        #[test]
        fn any_bytes_are_read_or_refused_alike_in_any_split(bytes in prop::collection::vec(prop::sample::select(&b"0129. \n\r-"[..]), 0..300), cut in 0usize..300) {
            if let Ok(events) = read(&bytes, TextDecoder::new()) {
                any_split_decodes_alike(&bytes, cut, TextDecoder::new, &events)?;
            }
        }
    }
}
