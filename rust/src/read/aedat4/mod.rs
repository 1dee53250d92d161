//! AEDAT 4.0 to events; the file is described in `write::aedat4`.

mod contents;
mod flatbuffer;
mod frame;
mod header;
mod packets;
mod recording;
mod records;
mod unpack;

pub use frame::Aedat4Frame;
pub use header::Kind as Aedat4Kind;
pub use recording::{Aedat4Piece, Aedat4Recording};
pub use records::{Aedat4Imu, Aedat4Trigger};
pub use unpack::MAX_PACKET_BYTES;

use self::header::Kind;
use self::packets::Packets;
use super::reader::{Decode, DecoderState};
use crate::error::{Error, Result};
use crate::event::Event;

/// Decodes the events of AEDAT 4.0: the first stream of them, from the beginning or a packet; other streams are passed
/// over. [`Aedat4Recording`] has all of them.
pub struct Aedat4Decoder(Packets);

impl Default for Aedat4Decoder {
    fn default() -> Self {
        Self::new(MAX_PACKET_BYTES)
    }
}

impl Aedat4Decoder {
    /// Returns a decoder of a file's bytes, from its beginning; a packet may unpack to `max_packet_bytes`.
    #[must_use]
    pub fn new(max_packet_bytes: usize) -> Self {
        Self(Packets::new(max_packet_bytes))
    }
}

impl Decode for Aedat4Decoder {
    fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize> {
        let used = self.0.push(bytes, &[Kind::Events], |packet| match packet {
            Some((_, body)) => records::events(body, events),
            None => Ok(()),
        })?;
        match &self.0.header {
            Some(header) if header.stream(Kind::Events).is_none() => {
                let message = "the file has no stream of events (EVTS)".into();
                Err(Error::Format { message, line: None, byte: header::MAGIC.len() })
            }
            _ => Ok(used),
        }
    }

    fn end(&mut self, bytes: &[u8], _events: &mut Vec<Event>) -> Result<usize> {
        self.0.end(bytes)?;
        Ok(0)
    }

    fn over(&self) -> bool {
        self.0.over
    }

    fn size(&self) -> Option<(u32, u32)> {
        self.0.header.as_ref()?.stream(Kind::Events)?.size
    }

    fn resume(&mut self, byte: usize, _state: DecoderState) -> Result<()> {
        (self.0.offset, self.0.over) = (byte, false);
        if byte == 0 {
            self.0.header = None;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::testing::{any_split_decodes_alike, read};
    use crate::write::{Aedat4Encoder, Compression, EventWriter};
    use proptest::prelude::*;
    use std::io::Cursor;

    fn written(events: &[Event], compression: Compression, packet: usize, start_us: i64) -> Vec<u8> {
        let encoder = Aedat4Encoder::new(1 << 15, 1 << 15, compression, start_us);
        let mut writer = EventWriter::new(Cursor::new(Vec::new()), encoder).unwrap();
        for packet in events.chunks(packet) {
            writer.write(packet).unwrap();
        }
        writer.finish_with_contents().unwrap().into_inner()
    }

    fn some() -> Vec<Event> {
        (0..100u16).map(|i| Event::new(i64::from(i / 3), i, 7 * i, i % 2 == 0)).collect()
    }

    #[test]
    fn the_start_is_added_to_all_times() {
        let events = read(&written(&some(), Compression::None, 7, 1 << 50), Aedat4Decoder::default()).unwrap();
        assert_eq!(events[99].t, (1 << 50) + 33);
    }

    #[test]
    fn a_file_that_ends_anywhere_gives_its_whole_packets() {
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd(1)] {
            let encoder = Aedat4Encoder::new(240, 180, compression, 0);
            let mut writer = EventWriter::new(Cursor::new(Vec::new()), encoder).unwrap();
            let events: Vec<Event> = some().into_iter().map(|e| Event::new(e.t, e.x, 0, e.p > 0)).collect();
            let mut ends = vec![writer.bytes()];
            for packet in events.chunks(10) {
                writer.write(packet).unwrap();
                ends.push(writer.bytes());
            }
            // As a killed writer leaves it: the header knows no table of contents, of which a part may be there.
            let header = writer.sink().clone().into_inner();
            let mut bytes = writer.finish_with_contents().unwrap().into_inner();
            bytes[..header.len()].copy_from_slice(&header);
            for cut in (usize::try_from(ends[0]).unwrap()..=bytes.len()).step_by(13) {
                let whole = ends.iter().filter(|&&end| end <= cut as u64).count() - 1;
                assert_eq!(read(&bytes[..cut], Aedat4Decoder::default()).unwrap(), events[..10 * whole]);
            }
        }
    }

    #[test]
    fn faults_are_named_with_their_byte() {
        let good = written(&some(), Compression::None, 100, 0);
        for (offset, rule) in [(0, "not an AEDAT 4.0 file"), (20, "IOHE")] {
            let mut bad = good.clone();
            bad[offset] ^= 0xff;
            let error = read(&bad, Aedat4Decoder::default()).unwrap_err().to_string();
            assert!(error.contains(rule), "{error}");
        }
        let evts = good.windows(4).rposition(|w| w == b"EVTS").unwrap();
        let mut bad = good.clone();
        bad[evts] = b'X';
        let error = read(&bad, Aedat4Decoder::default()).unwrap_err().to_string();
        assert!(error.contains("EVTS") && error.contains(&format!("byte {}", evts - 16)), "{error}");
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(raw in prop::collection::vec((0i64..1 << 60, 0u16..1 << 15, 0u16..1 << 15, any::<bool>()), 0..50), cut in 0usize..3000, kind in 0usize..3) {
            let mut events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            events.sort_by_key(|e| e.t);
            let compression = [Compression::None, Compression::Lz4, Compression::Zstd(1)][kind];
            let bytes = written(&events, compression, 7, 0);
            prop_assert_eq!(read(&bytes, Aedat4Decoder::default()).unwrap(), &events[..]);
            any_split_decodes_alike(&bytes, cut, Aedat4Decoder::default, &events)?;
        }

        #[test]
        fn damaged_files_never_panic(damage in prop::collection::vec((0usize..3000, any::<u8>()), 1..20), kind in 0usize..3) {
            let compression = [Compression::None, Compression::Lz4, Compression::Zstd(1)][kind];
            let mut bytes = written(&some(), compression, 10, 0);
            let length = bytes.len();
            for (offset, value) in damage {
                bytes[offset % length] = value;
            }
            let _ = read(&bytes, Aedat4Decoder::default());
        }
    }
}
