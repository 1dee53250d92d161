//! events.txt, the text of the public Event-Camera Dataset: one line `timestamp x y polarity` an event.
//!
//! The timestamp is in seconds with nine decimals, polarity 0 or 1 (Mueggler et al., IJRR 2017, section 4). Text and
//! microseconds are converted in integers alone, so that no time is rounded.

use super::limits::Limits;
use super::writer::Encode;
use crate::event::Event;

/// The longest line: a time of 13 digits, the point, nine decimals, five digits for each coordinate, spaces, polarity,
/// newline; and what is stored past a line's end because whole words are.
const LONGEST_LINE: usize = 40 + 8;

const SECOND: i64 = 1_000_000;

/// Events as lines `sec.nnnnnnnnn x y p`.
pub struct TextEncoder {
    limits: Limits,
    size_line: Option<(u32, u32)>,
    /// The second of the last event and its text, up to the point.
    second_us: i64,
    second: [u8; 16],
    second_length: usize,
    lines: Vec<u8>,
}

impl TextEncoder {
    /// Returns an encoder for events within `limits`.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, size_line: None, second_us: i64::MIN, second: [0; 16], second_length: 0, lines: Vec::new() }
    }

    /// Adds a first line `width height`, which some readers ask for and the dataset does not have.
    #[must_use]
    pub fn with_size_line(mut self) -> Self {
        self.size_line = Some((self.limits.width, self.limits.height));
        self
    }

    fn enter_second(&mut self, t: i64) {
        self.second_us = t - t % SECOND;
        let text = format!("{}.", t / SECOND);
        self.second[..text.len()].copy_from_slice(text.as_bytes());
        self.second_length = text.len();
    }
}

impl Encode for TextEncoder {
    fn limits(&self) -> Limits {
        self.limits
    }

    fn begin(&mut self, out: &mut Vec<u8>) {
        if let Some((width, height)) = self.size_line {
            out.extend_from_slice(format!("{width} {height}\n").as_bytes());
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below a second in microseconds")]
    fn encode(&mut self, events: &[Event], out: &mut Vec<u8>) {
        let mut lines = std::mem::take(&mut self.lines);
        lines.resize(lines.len().max(events.len() * LONGEST_LINE), 0);
        let mut at = 0;
        for event in events {
            // Before the first event the difference is out of range as well, whatever wraps.
            let mut us = event.t.wrapping_sub(self.second_us) as u64;
            if us >= SECOND as u64 {
                self.enter_second(event.t);
                us = (event.t - self.second_us) as u64;
            }
            let line: &mut [u8; LONGEST_LINE] = (&mut lines[at..at + LONGEST_LINE]).try_into().expect("of that length");
            line[..16].copy_from_slice(&self.second);
            let mut end = self.second_length;
            let (high, low) = (DECIMALS[us as usize / 1000], DECIMALS[us as usize % 1000]);
            put(
                line,
                end,
                u64::from(high.digits) | u64::from(low.digits) << 24 | u64::from(b'0') << 48 | u64::from(b'0') << 56,
            );
            line[end + 8] = b'0';
            line[end + 9] = b' ';
            end += 10;
            end = put_coordinate(line, end, event.x);
            end = put_coordinate(line, end, event.y);
            line[end] = b'0' + event.p;
            line[end + 1] = b'\n';
            at += end + 2;
        }
        out.extend_from_slice(&lines[..at]);
        self.lines = lines;
    }
}

/// A number below 1000 as text.
#[derive(Clone, Copy)]
struct Decimal {
    /// Three digits, the first one in the lowest byte.
    digits: u32,
    /// Without leading zeros, and with a space behind it.
    word: u32,
    /// The length of `word` with its space.
    length: u8,
}

static DECIMALS: [Decimal; 1000] = {
    let mut table = [Decimal { digits: 0, word: 0, length: 0 }; 1000];
    let (mut index, mut n) = (0, 0u32);
    while index < table.len() {
        let digits = n / 100 + ((n / 10 % 10) << 8) + ((n % 10) << 16) + 0x30_3030;
        let zeros: u8 = if n < 10 { 2 } else { (n < 100) as u8 };
        let word = (digits | (b' ' as u32) << 24) >> (8 * zeros as u32);
        table[index] = Decimal { digits, word, length: 4 - zeros };
        index += 1;
        n += 1;
    }
    table
};

#[inline]
fn put(line: &mut [u8; LONGEST_LINE], at: usize, word: u64) {
    line[at..at + 8].copy_from_slice(&word.to_le_bytes());
}

/// Puts a coordinate and a space; returns where they end.
#[inline]
fn put_coordinate(line: &mut [u8; LONGEST_LINE], at: usize, value: u16) -> usize {
    let value = usize::from(value);
    if value < 1000 {
        let decimal = DECIMALS[value];
        line[at..at + 4].copy_from_slice(&decimal.word.to_le_bytes());
        return at + usize::from(decimal.length);
    }
    let (high, low) = (DECIMALS[value / 1000], DECIMALS[value % 1000]);
    line[at..at + 4].copy_from_slice(&high.word.to_le_bytes());
    let end = at + usize::from(high.length) - 1;
    line[end..end + 4].copy_from_slice(&(low.digits | u32::from(b' ') << 24).to_le_bytes());
    end + 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(events: &[Event]) -> String {
        let mut out = Vec::new();
        TextEncoder::new(Limits::NONE).encode(events, &mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn lines_follow_the_dataset() {
        let events =
            [Event::new(0, 0, 0, false), Event::new(3_811, 96, 133, false), Event::new(1_000_000, 239, 9, true)];
        assert_eq!(text(&events), "0.000000000 0 0 0\n0.003811000 96 133 0\n1.000000000 239 9 1\n");
    }

    #[test]
    fn the_longest_line_is_whole() {
        let line = text(&[Event::new(i64::MAX, u16::MAX, u16::MAX, true)]);
        assert_eq!(line, "9223372036854.775807000 65535 65535 1\n");
        assert!(line.len() + 8 <= LONGEST_LINE);
    }

    #[test]
    fn the_size_comes_first_where_it_is_asked_for() {
        let limits = Limits { width: 240, height: 180, ..Limits::NONE };
        let mut out = Vec::new();
        TextEncoder::new(limits).with_size_line().begin(&mut out);
        assert_eq!(out, b"240 180\n");
    }

    proptest! {
        #[test]
        fn every_number_is_formatted_as_the_standard_library_does(t in 0..i64::MAX, x: u16, y: u16, p: bool, step in 0i64..3_000_000) {
            let events = [Event::new(t, x, y, p), Event::new(t.saturating_add(step), y, x, !p)];
            let line = |e: &Event| format!("{}.{:06}000 {} {} {}\n", e.t / SECOND, e.t % SECOND, e.x, e.y, e.p);
            prop_assert_eq!(text(&events), events.iter().map(line).collect::<String>());
        }
    }
}
