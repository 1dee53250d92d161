//! Prophesee's EVT 2.0: little-endian words of 32 bits.
//!
//! Type in the highest four bits. `0` OFF and `1` ON: time 5..0 in bits 27..22, x in 21..11, y in 10..0. `8`: time
//! 33..6 in bits 27..0, before the first event and whenever it changes. (Prophesee, EVT 2.0 format, in Metavision's
//! documentation.)

use super::evt::{SIDE, header, push_words};
use super::limits::Limits;
use super::writer::Encode;
use crate::event::Event;

const TIME_HIGH: u32 = 8 << 28;

/// Events as EVT 2.0.
pub struct Evt2Encoder {
    limits: Limits,
    /// Bits 33..6 of the time, as last written.
    high: Option<u32>,
    words: Vec<u32>,
}

impl Evt2Encoder {
    /// Times have 34 bits (4.7 hours), coordinates 11.
    pub const LIMITS: Limits = Limits { latest_us: (1 << 34) - 1, width: SIDE, height: SIDE };

    /// Returns an encoder for a sensor of at most 2048 x 2048 pixels; a larger one is cut to that.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { limits: Self::LIMITS.for_sensor(width, height), high: None, words: Vec::new() }
    }
}

impl Encode for Evt2Encoder {
    fn limits(&self) -> Limits {
        self.limits
    }

    fn begin(&mut self, out: &mut Vec<u8>) {
        out.extend_from_slice(header(2, self.limits).as_bytes());
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times have 34 bits")]
    fn encode(&mut self, events: &[Event], out: &mut Vec<u8>) {
        let words = &mut self.words;
        words.resize(words.len().max(2 * events.len()), 0);
        let mut at = 0;
        for event in events {
            let high = (event.t >> 6) as u32;
            if self.high != Some(high) {
                self.high = Some(high);
                words[at] = TIME_HIGH | high;
                at += 1;
            }
            words[at] =
                u32::from(event.p) << 28 | (event.t as u32 & 63) << 22 | u32::from(event.x) << 11 | u32::from(event.y);
            at += 1;
        }
        push_words(&words[..at], u32::to_le_bytes, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_the_format() {
        let mut out = Vec::new();
        let mut encoder = Evt2Encoder::new(1280, 720);
        encoder.encode(&[Event::new(64 * 5 + 3, 1279, 719, true), Event::new(64 * 5 + 3, 1, 2, false)], &mut out);
        encoder.encode(&[Event::new((1 << 34) - 1, 0, 0, true)], &mut out);
        let words: Vec<u32> = out.chunks(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect();
        let time = |low: u32| low << 22;
        assert_eq!(
            words,
            [
                0x8000_0005,
                0x1000_0000 | time(3) | 0x4ff << 11 | 0x2cf,
                time(3) | 1 << 11 | 2,
                0x8fff_ffff,
                0x1000_0000 | time(63)
            ]
        );
    }
}
