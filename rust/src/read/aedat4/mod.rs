//! AEDAT 4.0 to events; the file is described in `write::aedat4`.

mod contents;
mod flatbuffer;
mod header;

use std::io::Read;

use self::flatbuffer::Flatbuffer;
use self::header::{Header, MAGIC};
use super::reader::Decode;
use crate::error::{Error, Result};
use crate::event::Event;

/// Decodes AEDAT 4.0: the first stream of events, from the beginning or a packet; other streams are passed over.
#[derive(Default)]
pub struct Aedat4Decoder {
    header: Option<Header>,
    /// Where the bytes that come next are in the file.
    place: usize,
    over: bool,
    body: Vec<u8>,
}

impl Aedat4Decoder {
    /// A decoder of a file's bytes, from its beginning.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn packet(&mut self, body: &[u8], compression: i32, events: &mut Vec<Event>) -> Result<()> {
        let place = self.place;
        let fault = |message: String| Error::Format { message, line: None, byte: place };
        let body = if compression == 0 {
            body
        } else {
            self.body.clear();
            decompress(body, compression, &mut self.body)
                .map_err(|error| fault(format!("a packet must be a compressed frame: {error}")))?;
            &self.body
        };
        let records = events_of(body).ok_or_else(|| fault("a packet of events must be an EVTS flatbuffer".into()))?;
        events.reserve(records.len());
        for record in records {
            let [t @ .., _, _, _, _, _, _, _, _] = record;
            let [.., x0, x1, y0, y1, p, _, _, _] = *record;
            let (x, y) = (u16::from_le_bytes([x0, x1]), u16::from_le_bytes([y0, y1]));
            events.push(Event::new(i64::from_le_bytes(*t), x, y, p != 0));
        }
        Ok(())
    }
}

/// The events of an `EVTS`, 16 bytes each.
fn events_of(bytes: &[u8]) -> Option<&[[u8; 16]]> {
    let buffer = Flatbuffer::with_size(bytes)?;
    if buffer.identifier()? != b"EVTS" {
        return None;
    }
    let Some(elements) = buffer.field(buffer.root()?, 0) else { return Some(&[]) };
    Some(buffer.vector(elements, 16)?.as_chunks().0)
}

fn decompress(frame: &[u8], compression: i32, out: &mut Vec<u8>) -> std::io::Result<()> {
    if compression <= 2 {
        lz4_flex::frame::FrameDecoder::new(frame).read_to_end(out)?;
    } else {
        zstd::stream::copy_decode(frame, out)?;
    }
    Ok(())
}

impl Decode for Aedat4Decoder {
    fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize> {
        let mut at = 0;
        if self.header.is_none() {
            match Header::parse(bytes)? {
                Some(header) => {
                    at = header.length;
                    self.place = at;
                    self.header = Some(header);
                }
                None => return Ok(0),
            }
        }
        while let Some(header) = &self.header {
            self.over |= header.table_place.is_some_and(|table| self.place >= table);
            let Some((stream, size)) = packet_header(&bytes[at..]) else { break };
            // A stream that was not announced: a table of contents that was being written when its writer ended.
            self.over |= !header.streams.contains(&stream);
            if self.over {
                break;
            }
            let fault = |message: String| Error::Format { message, line: None, byte: self.place };
            let size =
                usize::try_from(size).map_err(|_| fault(format!("a packet's size must be positive, not {size}")))?;
            let Some(body) = bytes[at + 8..].get(..size) else { break };
            let (event_stream, compression) = (header.event_stream, header.compression);
            if stream == event_stream {
                self.packet(body, compression, events)?;
            }
            at += 8 + size;
            self.place += 8 + size;
        }
        // What comes behind the last packet is passed over.
        Ok(if self.over { bytes.len() } else { at })
    }

    fn end(&mut self, bytes: &[u8], _events: &mut Vec<Event>) -> Result<usize> {
        if self.header.is_none() {
            let message = if bytes.starts_with(MAGIC) { "the header is cut off" } else { "not an AEDAT 4.0 file" };
            return Err(Error::Format { message: message.into(), line: None, byte: 0 });
        }
        Ok(0)
    }

    fn over(&self) -> bool {
        self.over
    }

    fn size(&self) -> Option<(u32, u32)> {
        self.header.as_ref().and_then(|header| header.size)
    }
}

/// Stream and size of the packet that begins here.
fn packet_header(bytes: &[u8]) -> Option<(i32, i32)> {
    let (stream, rest) = bytes.split_first_chunk()?;
    Some((i32::from_le_bytes(*stream), i32::from_le_bytes(*rest.first_chunk()?)))
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
        let events = read(&written(&some(), Compression::None, 7, 1 << 50), Aedat4Decoder::new()).unwrap();
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
                assert_eq!(read(&bytes[..cut], Aedat4Decoder::new()).unwrap(), events[..10 * whole]);
            }
        }
    }

    #[test]
    fn faults_are_named_with_their_byte() {
        let good = written(&some(), Compression::None, 100, 0);
        for (place, rule) in [(0, "not an AEDAT 4.0 file"), (20, "IOHE")] {
            let mut bad = good.clone();
            bad[place] ^= 0xff;
            let error = read(&bad, Aedat4Decoder::new()).unwrap_err().to_string();
            assert!(error.contains(rule), "{error}");
        }
        let evts = good.windows(4).rposition(|w| w == b"EVTS").unwrap();
        let mut bad = good.clone();
        bad[evts] = b'X';
        let error = read(&bad, Aedat4Decoder::new()).unwrap_err().to_string();
        assert!(error.contains("EVTS") && error.contains(&format!("byte {}", evts - 16)), "{error}");
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(raw in prop::collection::vec((0i64..1 << 60, 0u16..1 << 15, 0u16..1 << 15, any::<bool>()), 0..50), cut in 0usize..3000, kind in 0usize..3) {
            let mut events: Vec<Event> = raw.iter().map(|&(t, x, y, p)| Event::new(t, x, y, p)).collect();
            events.sort_by_key(|e| e.t);
            let compression = [Compression::None, Compression::Lz4, Compression::Zstd(1)][kind];
            let bytes = written(&events, compression, 7, 0);
            prop_assert_eq!(read(&bytes, Aedat4Decoder::new()).unwrap(), &events[..]);
            any_split_decodes_alike(&bytes, cut, Aedat4Decoder::new, &events)?;
        }

        #[test]
        fn damaged_files_never_panic(damage in prop::collection::vec((0usize..3000, any::<u8>()), 1..20), kind in 0usize..3) {
            let compression = [Compression::None, Compression::Lz4, Compression::Zstd(1)][kind];
            let mut bytes = written(&some(), compression, 10, 0);
            let length = bytes.len();
            for (place, value) in damage {
                bytes[place % length] = value;
            }
            let _ = read(&bytes, Aedat4Decoder::new());
        }
    }
}
