//! The table of contents: which packets a slice of time needs.

use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

use super::Aedat4Decoder;
use super::flatbuffer::Flatbuffer;
use super::header::{Header, Kind, MAGIC};
use super::packets::Packets;
use super::unpack::unpack;
use crate::error::{Error, Result};

impl Aedat4Decoder {
    /// Returns a decoder of the packets that hold the events with `start_us` <= t < `stop_us`, to the first of which
    /// `source` is moved; of all packets in a file without a table of contents. A packet may unpack to
    /// `max_packet_bytes`.
    ///
    /// # Errors
    /// [`Error::Io`] if the source refuses; [`Error::Format`] for a malformed header.
    pub fn of_slice(source: &mut (impl Read + Seek), times: Range<i64>, max_packet_bytes: usize) -> Result<Self> {
        let io = || Error::io("reading events");
        let mut begin = Vec::new();
        source.by_ref().take(MAGIC.len() as u64 + 4).read_to_end(&mut begin).map_err(io())?;
        if let Some(size) = begin.get(MAGIC.len()..).and_then(|size| size.first_chunk()) {
            source.by_ref().take(u32::from_le_bytes(*size).into()).read_to_end(&mut begin).map_err(io())?;
        }
        let mut decoder = Packets::new(max_packet_bytes);
        let offset = if let Some(mut header) = Header::parse(&begin)? {
            let mut offset = header.length;
            if let Some(table) = header.table_offset {
                let mut bytes = Vec::new();
                source.seek(SeekFrom::Start(table as u64)).map_err(io())?;
                source.by_ref().take(max_packet_bytes as u64).read_to_end(&mut bytes).map_err(io())?;
                // All packets, if the table cannot be read.
                let packets = packets(&bytes, &header, &times, max_packet_bytes).unwrap_or(header.length..table);
                offset = packets.start;
                header.table_offset = Some(packets.end);
            }
            (decoder.header, decoder.offset) = (Some(header), offset);
            offset
        } else {
            0
        };
        source.seek(SeekFrom::Start(offset as u64)).map_err(io())?;
        Ok(Self(decoder))
    }
}

/// Returns the bytes from the first packet that a slice needs to the end of the last one; None if the table cannot be
/// read.
fn packets(frame: &[u8], header: &Header, times: &Range<i64>, limit: usize) -> Option<Range<usize>> {
    let mut bytes = Vec::new();
    if header.compression == 0 {
        bytes.extend_from_slice(frame);
    } else {
        unpack(frame, header.compression, limit, &mut bytes).ok()?;
    }
    let buffer = Flatbuffer::with_size(&bytes)?;
    if buffer.identifier()? != b"FTAB" {
        return None;
    }
    let mut needed = header.length..header.length;
    for entry in buffer.tables(buffer.field(buffer.root()?, 0)?)? {
        let entry = entry?;
        let number = |index| buffer.field(entry, index).map_or(Some(0), |offset| buffer.i64(offset));
        let offset = usize::try_from(number(0)?).ok()?;
        let info = buffer.field(entry, 1)?;
        let (stream, size) = (buffer.i32(info)?, usize::try_from(buffer.i32(info + 4)?).ok()?);
        // A packet's head of eight bytes stands before its offset.
        let offset = offset.checked_sub(8).filter(|&offset| offset >= header.length)?;
        if header.kind_of(stream) == Some(Kind::Events) && number(4)? >= times.start && number(3)? < times.end {
            let end = offset.checked_add(8 + size)?;
            needed = if needed.is_empty() { offset..end } else { needed.start.min(offset)..needed.end.max(end) };
        }
    }
    Some(needed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::read::EventReader;
    use crate::read::aedat4::MAX_PACKET_BYTES;
    use crate::write::{Aedat4Encoder, Compression, EventWriter};
    use std::io::Cursor;

    #[test]
    fn only_the_packets_of_a_slice_are_read() {
        let events: Vec<Event> = (0..1000).map(|t| Event::new(t, 1, 2, true)).collect();
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd(1)] {
            let encoder = Aedat4Encoder::new(240, 180, compression, 0);
            let mut writer = EventWriter::new(Cursor::new(Vec::new()), encoder).unwrap();
            for packet in events.chunks(10) {
                writer.write(packet).unwrap();
            }
            let mut bytes = writer.finish_with_contents().unwrap().into_inner();
            let slice = |bytes: &[u8], times: Range<i64>| {
                let mut source = Cursor::new(bytes);
                let decoder = Aedat4Decoder::of_slice(&mut source, times, MAX_PACKET_BYTES).unwrap();
                let mut events = Vec::new();
                EventReader::new(source, decoder).read(usize::MAX, &mut events).unwrap();
                events
            };
            for (times, packets) in [(205..231, 200..240), (0..1, 0..10), (990..5000, 990..1000), (1000..2000, 0..0)] {
                assert_eq!(slice(&bytes, times), events[packets]);
            }
            // Without its table, all packets are read.
            bytes.truncate(bytes.len() - 10);
            assert_eq!(slice(&bytes, 205..231), events);
        }
    }
}
