//! EVT 2.1 to events: words of 64 bits, each with up to 32 events of one row, polarity and time.
//!
//! A word has its kind in the upper four bits. An event word (0 OFF, 1 ON) has the lower six bits of the time, the column
//! of its first pixel, the row, and a bit for each of 32 pixels from that one on. A time word (8) has the bits 33..6 of
//! the time. In files of cameras of an early kind, whose header says `endianness=legacy`, both halves of a word are
//! swapped.
//!
//! Source: Prophesee, EVT 2.1 format, in Metavision's documentation; `OpenEB`, `evt21_event_types.h`.

use super::evt::{Evt2Time, EvtDecoder, Words};
use super::reader::DecoderState;
use crate::error::Result;
use crate::event::Event;

/// Decodes EVT 2.1. Words other than events and times are passed over, and so are events before the first time. Where
/// the 34 bits of time go round, time goes on.
pub type Evt21Decoder = EvtDecoder<Evt21Words>;

/// What the words of EVT 2.1 change.
#[derive(Default)]
pub struct Evt21Words {
    high: Evt2Time,
    halves_swapped: bool,
}

impl Words for Evt21Words {
    fn begin(&mut self, legacy: bool) {
        self.halves_swapped = legacy;
    }

    #[allow(clippy::cast_possible_truncation, reason = "fields of 11 bits")]
    fn decode(&mut self, bytes: &[u8], start_us: i64, events: &mut Vec<Event>) -> usize {
        let words = bytes.as_chunks::<8>().0;
        let mut high = self.high;
        for &word in words {
            let word = u64::from_le_bytes(word);
            let word = if self.halves_swapped { word.rotate_left(32) } else { word };
            match word >> 60 {
                kind @ (0 | 1) => {
                    let Some(high) = high.get() else { continue };
                    let t = start_us + (high << 6 | (word >> 54 & 63).cast_signed());
                    let (x, y) = ((word >> 43 & 0x7ff) as u16, (word >> 32 & 0x7ff) as u16);
                    let mut valid = word as u32;
                    events.reserve(valid.count_ones() as usize);
                    while valid != 0 {
                        events.push(Event::new(t, x + valid.trailing_zeros() as u16, y, kind == 1));
                        valid &= valid - 1;
                    }
                }
                8 => high.advance((word >> 32 & 0x0fff_ffff).cast_signed()),
                _ => {}
            }
        }
        self.high = high;
        8 * words.len()
    }

    fn state(&self) -> DecoderState {
        self.high.decoder_state()
    }

    fn resume(&mut self, state: DecoderState) -> Result<()> {
        self.high = Evt2Time::of_decoder_state(state)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::Decode;
    use crate::read::testing::{any_split_decodes_alike, read};
    use proptest::prelude::*;

    fn time(t: i64) -> u64 {
        8 << 60 | (t.cast_unsigned() >> 6 & 0x0fff_ffff) << 32
    }

    fn row(t: i64, x: u16, y: u16, on: bool, valid: u32) -> u64 {
        u64::from(on) << 60
            | (t.cast_unsigned() & 63) << 54
            | u64::from(x) << 43
            | u64::from(y) << 32
            | u64::from(valid)
    }

    fn file(header: &str, words: &[u64]) -> Vec<u8> {
        let bytes = words.iter().flat_map(|word| word.to_le_bytes());
        header.bytes().chain(bytes).collect()
    }

    #[test]
    fn a_word_has_the_events_of_a_row() {
        let words = [
            row(5, 1, 1, true, 1), // before the first time
            time(64 * 7),
            row(64 * 7 + 5, 32, 9, true, 1 << 31 | 0b101),
            row(64 * 7 + 6, 0, 719, false, 0),
            row(64 * 7 + 7, 2047, 1500, false, 1),
            row(64 * 7 + 63, 1247, 719, false, 1 << 31),
            0xa << 60, // a trigger
            time(0),   // goes round
            row(2, 3, 4, false, 1),
        ];
        let t = 64 * 7;
        let expected = [
            Event::new(t + 5, 32, 9, true),
            Event::new(t + 5, 34, 9, true),
            Event::new(t + 5, 63, 9, true),
            Event::new(t + 7, 2047, 1500, false),
            Event::new(t + 63, 1278, 719, false),
        ];
        let events = read(&file("% evt 2.1\n% end\n", &words[..7]), Evt21Decoder::new()).unwrap();
        assert_eq!(events, expected);
        let late = [time((1 << 34) - 64), row(0, 1, 1, true, 1), words[7], words[8]];
        let events = read(&file("", &late), Evt21Decoder::new()).unwrap();
        assert_eq!(events, [Event::new((1 << 34) - 64, 1, 1, true), Event::new((1 << 34) + 2, 3, 4, false)]);
    }

    #[test]
    fn a_decoder_goes_on_from_a_state_in_the_second_round() {
        let words = [time(1 << 33), row(1, 1, 1, true, 1), time(0), row(2, 3, 4, false, 1)];
        let mut decoder = Evt21Decoder::of_words();
        let mut events = vec![];
        decoder.decode(&file("", &words[..3]), &mut events).unwrap();
        let mut later = Evt21Decoder::of_words();
        later.resume(24, decoder.state()).unwrap();
        later.decode(&file("", &words[3..]), &mut events).unwrap();
        assert_eq!(events, [Event::new((1 << 33) + 1, 1, 1, true), Event::new((1 << 34) + 2, 3, 4, false)]);
    }

    #[test]
    fn halves_may_be_swapped() {
        let words = [time(64), row(65, 32, 9, true, 3)];
        let swapped = words.map(|word| word.rotate_left(32));
        let header = "% format EVT21;endianness=legacy;width=1280;height=720\n% end\n";
        let events = read(&file(header, &swapped), Evt21Decoder::new()).unwrap();
        assert_eq!(events, [Event::new(65, 32, 9, true), Event::new(65, 33, 9, true)]);
        assert!(read(&file("% format EVT21\n% end\n", &swapped), Evt21Decoder::new()).unwrap().is_empty());
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_alike_in_any_split(bytes in prop::collection::vec(any::<u8>(), 0..300), first in any::<u32>(), cut in 0usize..300) {
            let mut all = file("% evt 2.1\n% end\n", &[time(i64::from(first))]);
            all.extend(bytes);
            let events = read(&all, Evt21Decoder::new()).unwrap();
            any_split_decodes_alike(&all, cut, Evt21Decoder::new, &events)?;
        }
    }
}
