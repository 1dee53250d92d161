//! AEDAT 4.0, the files of iniVation's DV: packets of events as flatbuffers, each compressed by itself.
//!
//! The line `#!AER-DAT4.0`, a header (`IOHE`), packets (stream, size, then an `EVTS`), and a table of contents (`FTAB`)
//! whose offset the header tells; -1 there means that there is none. An event has 16 bytes: i64 microseconds (Unix
//! time), i16 x, i16 y, polarity, padding. (iniVation, AEDAT 4.0 file format; the schemas of dv-processing.)

mod compression;
mod flatbuffer;

pub use compression::Compression;

use self::compression::Compressor;
use self::flatbuffer::Entry;
use super::limits::Limits;
use super::writer::Encode;
use crate::event::Event;

/// What the file begins with.
const MAGIC: &[u8] = b"#!AER-DAT4.0\r\n";

/// Events as AEDAT 4.0: each packet that is written becomes one of the file's, or several of 8192 events at most.
pub struct Aedat4Encoder {
    limits: Limits,
    /// Added to all times.
    start_us: i64,
    compressor: Compressor,
    /// Bytes written so far.
    bytes: u64,
    table: Vec<Entry>,
    packet: Vec<u8>,
}

impl Aedat4Encoder {
    /// Coordinates are i16.
    pub const LIMITS: Limits = Limits { latest_us: i64::MAX, width: 1 << 15, height: 1 << 15 };

    /// Returns an encoder for a sensor of at most 32768 x 32768 pixels (a larger one is cut to that). `start_us`, at
    /// least 0, is the Unix time of the events' 0.
    #[must_use]
    pub fn new(width: u32, height: u32, compression: Compression, start_us: i64) -> Self {
        Self {
            limits: Limits { latest_us: i64::MAX - start_us, ..Self::LIMITS }.for_sensor(width, height),
            start_us,
            compressor: Compressor::new(compression),
            bytes: 0,
            table: Vec::new(),
            packet: Vec::new(),
        }
    }
}

impl Encode for Aedat4Encoder {
    fn limits(&self) -> Limits {
        self.limits
    }

    fn begin(&mut self, out: &mut Vec<u8>) {
        out.extend_from_slice(MAGIC);
        let info = info(self.limits, self.compressor.compression);
        out.extend_from_slice(&flatbuffer::header(self.compressor.compression.code(), &info));
        self.bytes = out.len() as u64;
    }

    fn encode(&mut self, events: &[Event], out: &mut Vec<u8>) {
        if let (Some(first), Some(last)) = (events.first(), events.last()) {
            self.packet(events, first.t, last.t, out);
        }
    }

    fn contents(&mut self, out: &mut Vec<u8>) -> Option<(u64, Vec<u8>)> {
        self.compressor.compress(&flatbuffer::table(&self.table), out);
        let offset = MAGIC.len() + flatbuffer::TABLE_OFFSET;
        Some((offset as u64, self.bytes.to_le_bytes().to_vec()))
    }
}

impl Aedat4Encoder {
    fn packet(&mut self, events: &[Event], first_us: i64, last_us: i64, out: &mut Vec<u8>) {
        self.packet.clear();
        flatbuffer::events(events, self.start_us, &mut self.packet);
        let start = out.len();
        out.extend_from_slice(&[0; 8]);
        let size = self.compressor.compress(&self.packet, out);
        // The stream is 0, the only one.
        out[start + 4..start + 8].copy_from_slice(&size.to_le_bytes());
        self.table.push(Entry {
            offset: self.bytes + 8,
            size,
            events: events.len(),
            first_us: first_us + self.start_us,
            last_us: last_us + self.start_us,
        });
        self.bytes += (out.len() - start) as u64;
    }
}

/// Returns the description of the streams, in DV's XML.
fn info(limits: Limits, compression: Compression) -> String {
    let attribute =
        |key: &str, kind: &str, value: &str| format!("<attr key=\"{key}\" type=\"{kind}\">{value}</attr>\n");
    let mut xml = "<dv version=\"2.0\">\n<node name=\"outInfo\" path=\"/outInfo/\">\n".to_owned();
    xml += "<node name=\"0\" path=\"/outInfo/0/\">\n";
    for (key, value) in [
        ("compression", compression.name()),
        ("originalModuleName", "davis_rs"),
        ("originalOutputName", "events"),
        ("typeDescription", "Array of events (polarity ON/OFF)."),
        ("typeIdentifier", "EVTS"),
    ] {
        xml += &attribute(key, "string", value);
    }
    xml += "<node name=\"info\" path=\"/outInfo/0/info/\">\n";
    xml += &attribute("sizeX", "int", &limits.width.to_string());
    xml += &attribute("sizeY", "int", &limits.height.to_string());
    xml += &attribute("source", "string", "davis_rs");
    xml + "</node>\n</node>\n</node>\n</dv>\n"
}
