//! EVT 3.0 to events; the words are described in `write::evt3`.

use super::evt::{EvtDecoder, HighTime, Words, state_number};
use super::reader::DecoderState;
use crate::error::Result;
use crate::event::Event;

/// Decodes EVT 3.0, words of several events (`3` base, `4` twelve and `5` eight pixels) included. Other words
/// (triggers, counters) are passed over, and so are events before the first time. Where the 24 bits of time go round,
/// time goes on.
pub type Evt3Decoder = EvtDecoder<Evt3Words>;

/// What the words of EVT 3.0 change.
#[derive(Default)]
pub struct Evt3Words {
    /// Time above its low 12 bits: bits 23..12 go round.
    high: HighTime<{ 1 << 12 }>,
    low: i64,
    y: u16,
    /// Where the next vector begins, and its polarity.
    base_x: u16,
    base_on: bool,
}

impl Evt3Words {
    fn vector(&mut self, mut pixels: u16, length: u16, time: Option<i64>, events: &mut Vec<Event>) {
        if let Some(t) = time {
            while pixels != 0 {
                #[allow(clippy::cast_possible_truncation, reason = "a word has 12 pixels at most")]
                let offset = pixels.trailing_zeros() as u16;
                events.push(Event::new(t, self.base_x.wrapping_add(offset), self.y, self.base_on));
                pixels &= pixels - 1;
            }
        }
        self.base_x = self.base_x.wrapping_add(length);
    }
}

impl Words for Evt3Words {
    fn decode(&mut self, bytes: &[u8], start_us: i64, events: &mut Vec<Event>) -> usize {
        let words = bytes.as_chunks::<2>().0;
        events.reserve(words.len() / 2);
        let mut time = self.high.get().map(|high| start_us + (high << 12 | self.low));
        for &word in words {
            let word = u16::from_le_bytes(word);
            let on = word & 0x800 != 0;
            match word >> 12 {
                0 => self.y = word & 0x7ff,
                2 => {
                    if let Some(t) = time {
                        events.push(Event::new(t, word & 0x7ff, self.y, on));
                    }
                }
                3 => (self.base_x, self.base_on) = (word & 0x7ff, on),
                4 => self.vector(word & 0xfff, 12, time, events),
                5 => self.vector(word & 0xff, 8, time, events),
                6 => {
                    self.low = i64::from(word & 0xfff);
                    time = self.high.get().map(|high| start_us + (high << 12 | self.low));
                }
                8 => {
                    let last = self.high.get();
                    self.high.advance(i64::from(word & 0xfff));
                    // Cameras repeat the high time as a sign of life; only where it is new does the low one start
                    // again.
                    if self.high.get() != last {
                        self.low = 0;
                        time = self.high.get().map(|high| start_us + (high << 12));
                    }
                }
                _ => {}
            }
        }
        2 * words.len()
    }

    fn state(&self) -> DecoderState {
        [self.high.state(), self.low, self.y.into(), self.base_x.into(), self.base_on.into()]
    }

    fn resume(&mut self, [high, low, y, base_x, base_on]: DecoderState) -> Result<()> {
        self.high = HighTime::of_state(high, 1 << 49)?;
        self.low = state_number(low, 1 << 12)?;
        (self.y, self.base_x) = (state_number(y, 1 << 16)?, state_number(base_x, 1 << 16)?);
        self.base_on = state_number::<i64>(base_on, 2)? == 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::testing::{any_split_decodes_alike, read};
    use crate::write::{EventWriter, Evt3Encoder};
    use proptest::prelude::*;

    #[test]
    fn vectors_are_unfolded_in_order_of_x() {
        let words = [0x2001u16, 0x8001, 0x6002, 0x0007, 0x3864, 0x4805, 0x5081, 0x8001, 0x2001, 0x8fff, 0x8000, 0x2003];
        let bytes: Vec<u8> = words.into_iter().flat_map(u16::to_le_bytes).collect();
        let events = read(&bytes, Evt3Decoder::new()).unwrap();
        let t = 0x1002;
        let expected = [
            Event::new(t, 100, 7, true),
            Event::new(t, 102, 7, true),
            Event::new(t, 111, 7, true),
            Event::new(t, 112, 7, true),
            Event::new(t, 119, 7, true),
            Event::new(t, 1, 7, false),
            Event::new(1 << 24, 3, 7, false),
        ];
        assert_eq!(events, expected);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(raw in prop::collection::vec((0i64..1 << 32, 0u16..2048, 0u16..2048, any::<bool>()), 0..50), cut in 0usize..5000) {
            let mut events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            events.sort_by_key(|e| e.t);
            let mut writer = EventWriter::new(Vec::new(), Evt3Encoder::new(2048, 2048)).unwrap();
            writer.write(&events).unwrap();
            let bytes = writer.finish().unwrap();
            prop_assert_eq!(read(&bytes, Evt3Decoder::new()).unwrap(), &events[..]);
            any_split_decodes_alike(&bytes, cut, Evt3Decoder::new, &events)?;
        }

        #[test]
        fn any_bytes_are_read_or_refused_alike_in_any_split(bytes in prop::collection::vec(any::<u8>(), 0..300), cut in 0usize..300) {
            if let Ok(events) = read(&bytes, Evt3Decoder::new()) {
                any_split_decodes_alike(&bytes, cut, Evt3Decoder::new, &events)?;
            }
        }
    }
}
