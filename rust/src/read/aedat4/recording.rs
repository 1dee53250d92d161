//! All that a file of AEDAT 4.0 holds, at once.

use std::io::Read;

use super::frame::{Aedat4Frame, frame};
use super::header::Kind;
use super::packets::Packets;
use super::records::{Aedat4Imu, Aedat4Trigger, events, imu, triggers};
use crate::error::{Error, Result};
use crate::event::Event;

/// Bytes asked of the source at a time.
const AT_ONCE: usize = 1 << 18;

const ALL: [Kind; 4] = [Kind::Events, Kind::Frames, Kind::Imu, Kind::Triggers];

/// The first stream of each kind, in the order of the file.
#[derive(Default)]
pub struct Aedat4Recording {
    /// Brightness changes; their times may go back, and their pixels lie outside of the sensor.
    pub events: Vec<Event>,
    /// Inertial samples.
    pub imu: Vec<Aedat4Imu>,
    /// Frames.
    pub frames: Vec<Aedat4Frame>,
    /// Triggers.
    pub triggers: Vec<Aedat4Trigger>,
    /// Width and height of the sensor, where the header says.
    pub size: Option<(u32, u32)>,
    /// The camera that the header names, or nothing.
    pub source: String,
    /// Packets of other streams, which were passed over.
    pub other_packets: u64,
    /// What the end of the file cuts off, and where.
    pub cut: Option<String>,
}

impl Aedat4Recording {
    /// Reads a file from its beginning; a packet may unpack to `max_packet_bytes`.
    ///
    /// # Errors
    /// [`Error::Io`] if the source refuses, [`Error::Format`] for the first packet that does not follow the format.
    pub fn read(mut source: impl Read, max_packet_bytes: usize) -> Result<Self> {
        let (mut packets, mut recording) = (Packets::new(max_packet_bytes), Self::default());
        let (mut buffer, mut at_end) = (Vec::new(), false);
        while !at_end && !packets.over {
            let before = buffer.len();
            let mut part = source.by_ref().take(AT_ONCE.max(before) as u64);
            part.read_to_end(&mut buffer).map_err(Error::io("reading a recording"))?;
            at_end = buffer.len() == before;
            let used = packets.push(&buffer, &ALL, |packet| recording.take(packet, max_packet_bytes))?;
            buffer.drain(..used);
        }
        packets.end(&buffer)?;
        let Some(header) = &packets.header else { return Ok(recording) };
        let end = packets.place + buffer.len();
        recording.cut = match header.table_place {
            _ if packets.over => None,
            _ if !buffer.is_empty() => Some(format!("byte {}: the last packet is cut off", packets.place)),
            Some(table) => {
                Some(format!("byte {end}: the file is cut off before its table of packets, at byte {table}"))
            }
            None => None,
        };
        if let Some(stream) = header.stream(Kind::Events).or_else(|| header.stream(Kind::Frames)) {
            (recording.size, recording.source) = (stream.size, stream.source.clone());
        }
        Ok(recording)
    }

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

    #[test]
    fn what_is_written_is_read_and_a_cut_end_is_told() {
        let bytes = written(&some());
        let whole = Aedat4Recording::read(&bytes[..], MAX_PACKET_BYTES).unwrap();
        assert_eq!((whole.events, whole.size, whole.cut), (some(), Some((240, 180)), None));
        let cut = Aedat4Recording::read(&bytes[..1000], MAX_PACKET_BYTES).unwrap();
        assert!(cut.cut.is_some_and(|cut| cut.contains("cut off")) && some().starts_with(&cut.events));
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(damage in prop::collection::vec((0usize..3000, any::<u8>()), 1..20)) {
            let mut bytes = written(&some());
            let length = bytes.len();
            for (place, value) in damage {
                bytes[place % length] = value;
            }
            let _ = Aedat4Recording::read(&bytes[..], MAX_PACKET_BYTES);
        }
    }
}
