//! All that a file of AEDAT 4.0 holds, piece by piece.

use std::io::Read;

use super::frame::{Aedat4Frame, frame};
use super::header::{Header, Kind};
use super::packets::Packets;
use super::records::{Aedat4Imu, Aedat4Trigger, events, imu, triggers};
use crate::error::{Error, Result};
use crate::event::Event;

/// Bytes asked of the source at a time.
const AT_ONCE: usize = 1 << 18;

/// Of the first stream of each kind, the packets that follow each other, in the order of the file.
#[derive(Default)]
pub struct Aedat4Piece {
    /// Brightness changes; their times may go back, and their pixels lie outside of the sensor.
    pub events: Vec<Event>,
    /// Inertial samples.
    pub imu: Vec<Aedat4Imu>,
    /// Frames.
    pub frames: Vec<Aedat4Frame>,
    /// Triggers.
    pub triggers: Vec<Aedat4Trigger>,
    /// Packets of kinds that were not asked for, and of other streams, which were passed over.
    pub other_packets: u64,
}

/// Reads a file from its beginning to its end.
pub struct Aedat4Recording<R> {
    input: R,
    packets: Packets,
    wanted: Vec<Kind>,
    buffer: Vec<u8>,
    at_end: bool,
    ready: Option<Aedat4Piece>,
}

impl<R: Read> Aedat4Recording<R> {
    /// Reads the header; of packets, those of kinds that are `wanted` are unpacked, each to `max_packet_bytes` at most.
    ///
    /// # Errors
    /// As [`Self::next_piece`].
    pub fn new(input: R, wanted: Vec<Kind>, max_packet_bytes: usize) -> Result<Self> {
        let packets = Packets::new(max_packet_bytes);
        let mut recording = Self { input, packets, wanted, buffer: Vec::new(), at_end: false, ready: None };
        while recording.packets.header.is_none() && !recording.at_end {
            recording.ready = Some(recording.advance()?);
        }
        recording.packets.end(&recording.buffer)?;
        Ok(recording)
    }

    /// Returns what some hundred kilobytes of the file hold, None at its end.
    ///
    /// # Errors
    /// [`Error::Io`] if the source refuses, [`Error::Format`] for the first packet that does not follow the format.
    pub fn next_piece(&mut self) -> Result<Option<Aedat4Piece>> {
        if let Some(piece) = self.ready.take() {
            return Ok(Some(piece));
        }
        if self.at_end || self.packets.over {
            return Ok(None);
        }
        self.advance().map(Some)
    }

    /// Returns width and height of the sensor, where the header says.
    pub fn size(&self) -> Option<(u32, u32)> {
        self.packets.header.as_ref()?.camera()?.size
    }

    /// Returns the camera that the header names, or nothing.
    pub fn source(&self) -> &str {
        self.packets.header.as_ref().and_then(Header::camera).map_or("", |stream| &stream.source)
    }

    /// Returns whether the header announces a stream of a kind.
    pub fn has(&self, kind: Kind) -> bool {
        self.packets.header.as_ref().is_some_and(|header| header.stream(kind).is_some())
    }

    /// Returns how many bytes there are of the file whose packets were handed out.
    pub fn bytes(&self) -> usize {
        self.packets.offset
    }

    /// Returns what the end of the file cuts off, and where; known at the end.
    pub fn cut(&self) -> Option<String> {
        let (header, offset) = (self.packets.header.as_ref()?, self.packets.offset);
        let end = offset + self.buffer.len();
        match header.table_offset {
            _ if self.packets.over => None,
            _ if !self.buffer.is_empty() => Some(format!("byte {offset}: the last packet is cut off")),
            Some(table) => {
                Some(format!("byte {end}: the file is cut off before its table of packets, at byte {table}"))
            }
            None => None,
        }
    }

    fn advance(&mut self) -> Result<Aedat4Piece> {
        let (mut piece, limit, before) = (Aedat4Piece::default(), self.packets.limit, self.buffer.len());
        let mut next_bytes = self.input.by_ref().take(AT_ONCE.max(before) as u64);
        next_bytes.read_to_end(&mut self.buffer).map_err(Error::io("reading a recording"))?;
        self.at_end = self.buffer.len() == before;
        let used = self.packets.push(&self.buffer, &self.wanted, |packet| piece.take(packet, limit))?;
        self.buffer.drain(..used);
        Ok(piece)
    }
}

impl Aedat4Piece {
    fn take(&mut self, packet: Option<(Kind, &[u8])>, limit: usize) -> std::result::Result<(), String> {
        match packet {
            Some((Kind::Events, body)) => events(body, &mut self.events)?,
            Some((Kind::Imu, body)) => imu(body, limit, &mut self.imu)?,
            Some((Kind::Triggers, body)) => triggers(body, limit, &mut self.triggers)?,
            Some((Kind::Frames, body)) => self.frames.push(frame(body)?),
            None => self.other_packets += 1,
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::aedat4::MAX_PACKET_BYTES;
    use crate::write::{Aedat4Encoder, Compression, EventWriter};
    use proptest::prelude::*;
    use std::io::Cursor;

    fn written(events: &[Event]) -> Vec<u8> {
        let encoder = Aedat4Encoder::new(240, 180, Compression::Lz4, 0);
        let mut writer = EventWriter::new(Cursor::new(Vec::new()), encoder).unwrap();
        for packet in events.chunks(7) {
            writer.write(packet).unwrap();
        }
        writer.finish_with_contents().unwrap().into_inner()
    }

    fn some() -> Vec<Event> {
        (0..100u16).map(|i| Event::new(i64::from(i / 3), i, i, i % 2 == 0)).collect()
    }

    const ALL: [Kind; 4] = [Kind::Events, Kind::Frames, Kind::Imu, Kind::Triggers];

    /// Returns the events, how many packets were passed over, and what is said of a cut end.
    fn read(bytes: &[u8], kinds: &[Kind]) -> Result<(Vec<Event>, u64, Option<String>)> {
        let mut recording = Aedat4Recording::new(bytes, kinds.to_vec(), MAX_PACKET_BYTES)?;
        let (mut events, mut others) = (Vec::new(), 0);
        while let Some(piece) = recording.next_piece()? {
            events.extend(piece.events);
            others += piece.other_packets;
        }
        Ok((events, others, recording.cut()))
    }

    #[test]
    fn what_is_written_is_read_and_a_cut_end_is_told() {
        let bytes = written(&some());
        assert_eq!(read(&bytes, &ALL).unwrap(), (some(), 0, None));
        let recording = Aedat4Recording::new(&bytes[..], vec![], MAX_PACKET_BYTES).unwrap();
        assert_eq!(recording.size(), Some((240, 180)));
        assert!(recording.has(Kind::Events) && !recording.has(Kind::Frames));
        let (events, _, cut) = read(&bytes[..1000], &ALL).unwrap();
        assert!(cut.is_some_and(|cut| cut.contains("cut off")) && some().starts_with(&events));
    }

    #[test]
    fn kinds_that_were_not_asked_for_are_passed_over() {
        assert_eq!(read(&written(&some()), &[Kind::Imu]).unwrap(), (vec![], 15, None));
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(damage in prop::collection::vec((0usize..3000, any::<u8>()), 1..20)) {
            let mut bytes = written(&some());
            let length = bytes.len();
            for (offset, value) in damage {
                bytes[offset % length] = value;
            }
            let _ = read(&bytes, &ALL);
        }
    }
}
