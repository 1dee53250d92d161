//! EVT 2.0 to events; the words are described in `write::evt2`.

use super::evt::{Evt2Time, EvtDecoder, Words};
use super::reader::DecoderState;
use crate::error::Result;
use crate::event::Event;

/// Decodes EVT 2.0. Words other than events and times (triggers, counters) are passed over, and so are events before
/// the first time. Where the 34 bits of time go round, time goes on.
pub type Evt2Decoder = EvtDecoder<Evt2Words>;

/// What the words of EVT 2.0 change.
#[derive(Default)]
pub struct Evt2Words {
    high: Evt2Time,
}

impl Words for Evt2Words {
    #[allow(clippy::cast_possible_truncation, reason = "fields of 11 bits")]
    fn decode(&mut self, bytes: &[u8], start_us: i64, events: &mut Vec<Event>) -> usize {
        let words = bytes.as_chunks::<4>().0;
        events.reserve(words.len());
        let mut high = self.high;
        for &word in words {
            let word = u32::from_le_bytes(word);
            match word >> 28 {
                kind @ (0 | 1) => {
                    if let Some(high) = high.get() {
                        let t = start_us + (high << 6 | i64::from(word >> 22 & 63));
                        events.push(Event::new(t, (word >> 11 & 0x7ff) as u16, (word & 0x7ff) as u16, kind == 1));
                    }
                }
                8 => high.advance(i64::from(word & 0x0fff_ffff)),
                _ => {}
            }
        }
        self.high = high;
        4 * words.len()
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
    use crate::read::testing::{any_split_decodes_alike, read};
    use crate::write::{EventWriter, Evt2Encoder};
    use proptest::prelude::*;

    #[test]
    fn other_words_are_passed_over_and_time_goes_round() {
        let words = [0x1000_0000u32, 0xa000_0000, 0x8fff_ffff, 0x0000_0000, 0xe000_0000, 0x8000_0000, 0x1040_1002];
        let bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        let events = read(&bytes, Evt2Decoder::new()).unwrap();
        let round = 1i64 << 34;
        assert_eq!(events, [Event::new(round - 64, 0, 0, false), Event::new(round + 1, 2, 2, true)]);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(raw in prop::collection::vec((0i64..1 << 34, 0u16..2048, 0u16..2048, any::<bool>()), 0..50), cut in 0usize..500) {
            let mut events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            events.sort_by_key(|e| e.t);
            let mut writer = EventWriter::new(Vec::new(), Evt2Encoder::new(2048, 2048)).unwrap();
            writer.write(&events).unwrap();
            let bytes = writer.finish().unwrap();
            prop_assert_eq!(read(&bytes, Evt2Decoder::new()).unwrap(), &events[..]);
            any_split_decodes_alike(&bytes, cut, Evt2Decoder::new, &events)?;
        }

        #[test]
        fn any_bytes_are_read_or_refused_alike_in_any_split(bytes in prop::collection::vec(any::<u8>(), 0..300), cut in 0usize..300) {
            if let Ok(events) = read(&bytes, Evt2Decoder::new()) {
                any_split_decodes_alike(&bytes, cut, Evt2Decoder::new, &events)?;
            }
        }
    }
}
