//! Prophesee's EVT 3.0: little-endian words of 16 bits, each of which changes a state.
//!
//! Type in the highest four bits. `8`: time 23..12, `6`: time 11..0, `0`: y, `2`: x in bits 10..0 and polarity in bit
//! 11, which is an event. (Prophesee, EVT 3.0 format, in Metavision's documentation.) Words that hold several events of
//! a row are not written: events keep their order, whatever it is.

use super::evt::{SIDE, header, push_words};
use super::limits::Limits;
use super::writer::Encode;
use crate::event::Event;

const TIME_HIGH: u16 = 8 << 12;
const TIME_LOW: u16 = 6 << 12;
const ADDRESS_X: u16 = 2 << 12;

/// The largest step of the high time, below half a round, so that it cannot be taken for one back.
const STEP: i64 = 1 << 10;

/// Events as EVT 3.0.
pub struct Evt3Encoder {
    limits: Limits,
    /// Time above its low 12 bits, as last written; -1 before.
    high: i64,
    low: u16,
    y: u16,
    words: Vec<u16>,
}

impl Evt3Encoder {
    /// Time is written modulo 2^24 us, so that readers count its rounds: each costs 10 bytes even where nothing
    /// happens, and that is done for 2^16 rounds (12.7 days). Coordinates have 11 bits.
    pub const LIMITS: Limits = Limits { latest_us: (1 << 40) - 1, width: SIDE, height: SIDE };

    /// Returns an encoder for a sensor of at most 2048 x 2048 pixels; a larger one is cut to that.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { limits: Self::LIMITS.for_sensor(width, height), high: -1, low: u16::MAX, y: u16::MAX, words: Vec::new() }
    }

    /// Returns an encoder of words alone that begins at a time of its own: what it writes first is that time's high
    /// part, so that a packet can be read without those before it.
    #[must_use]
    pub fn starting_at(t_us: i64, width: u32, height: u32) -> Self {
        Self { high: (t_us >> 12) - 1, ..Self::new(width, height) }
    }

    /// Writes the high times between the last one and `high`. A round ends with 0xfff and begins with 0: some readers
    /// count it by nothing else.
    #[cold]
    fn advance(&mut self, high: i64, out: &mut Vec<u8>) {
        loop {
            let end = self.high | 0xfff;
            let next = if self.high == end { end + 1 } else { end.min(self.high + STEP) };
            if next >= high {
                return;
            }
            self.high = next;
            out.extend_from_slice(&time_high(next).to_le_bytes());
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "12 bits")]
fn time_high(high: i64) -> u16 {
    TIME_HIGH | (high & 0xfff) as u16
}

impl Encode for Evt3Encoder {
    fn limits(&self) -> Limits {
        self.limits
    }

    fn begin(&mut self, out: &mut Vec<u8>) {
        out.extend_from_slice(header(3, self.limits).as_bytes());
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "12 bits")]
    fn encode(&mut self, events: &[Event], out: &mut Vec<u8>) {
        let mut words = std::mem::take(&mut self.words);
        words.resize(words.len().max(4 * events.len()), 0);
        let mut at = 0;
        for event in events {
            let high = event.t >> 12;
            if high - self.high > 1 {
                push_words(&words[..at], u16::to_le_bytes, out);
                at = 0;
                self.advance(high, out);
            }
            // Each word is stored, and stays if it says something new: that is seldom foreseen.
            let slot: &mut [u16; 4] = (&mut words[at..at + 4]).try_into().expect("of that length");
            let low = event.t as u16 & 0xfff;
            let new_high = high != self.high;
            let new_low = new_high || low != self.low;
            let new_y = event.y != self.y;
            let mut next = usize::from(new_high);
            slot[0] = time_high(high);
            slot[next] = TIME_LOW | low;
            next += usize::from(new_low);
            slot[next] = event.y;
            next += usize::from(new_y);
            slot[next] = ADDRESS_X | u16::from(event.p) << 11 | event.x;
            at += next + 1;
            (self.high, self.low, self.y) = (high, low, event.y);
        }
        push_words(&words[..at], u16::to_le_bytes, out);
        self.words = words;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(events: &[Event]) -> Vec<u16> {
        let mut out = Vec::new();
        Evt3Encoder::new(1280, 720).encode(events, &mut out);
        out.chunks(2).map(|w| u16::from_le_bytes(w.try_into().unwrap())).collect()
    }

    #[test]
    fn words_are_those_of_the_format() {
        let events = [
            Event::new(0x1003, 1279, 719, true),
            Event::new(0x1003, 1, 719, false),
            Event::new(0x1004, 1, 2, false),
            Event::new(0x2004, 1, 2, false),
        ];
        assert_eq!(
            words(&events),
            [
                0x8000, 0x8001, 0x6003, 719, 0x2cff, 0x2001, // all is new, and the high time counts from 0
                0x6004, 2, 0x2001, // time and row
                0x8002, 0x6004, 0x2001, // the low time comes again with the high one
            ]
        );
    }

    #[test]
    fn a_packet_begins_with_its_own_time() {
        let mut out = Vec::new();
        let t = 1_700_000_000_000_000;
        Evt3Encoder::starting_at(t, 1280, 720).encode(&[Event::new(t, 3, 7, true)], &mut out);
        let words: Vec<u16> = out.chunks(2).map(|w| u16::from_le_bytes(w.try_into().unwrap())).collect();
        assert_eq!((i64::from(words[0]), i64::from(words[1])), (0x8000 | (t >> 12 & 0xfff), 0x6000 | (t & 0xfff)));
        assert_eq!(words[2..], [7, 0x2803]);
    }

    #[test]
    fn a_long_silence_is_counted_round_by_round_and_no_further() {
        let all = words(&[Event::new(5, 0, 0, true), Event::new((1 << 40) - 1, 0, 0, true)]);
        let highs: Vec<u16> = all.iter().filter(|&&w| w >> 12 == 8).map(|w| w & 0xfff).collect();
        let rounds = highs.windows(2).filter(|pair| pair[1] < pair[0]).count();
        assert_eq!((rounds, *highs.last().unwrap()), ((1 << 16) - 1, 0xfff));
        assert_eq!(all.len(), 5 * (1 << 16) + 5);
    }
}
