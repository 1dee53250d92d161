//! The streaming writer that all formats share.

use std::io::{Seek, SeekFrom, Write};

use super::limits::Limits;
use crate::error::{Error, Result};
use crate::event::Event;

/// Events encoded at a time, so that their bytes are still in the cache when the sink takes them.
const AT_ONCE: usize = 1 << 13;

/// A format: how events become bytes. It does no I/O, and is given only events within its limits.
pub trait Encode: Send + Sync {
    /// Returns what the format can hold of a sensor.
    fn limits(&self) -> Limits;

    /// Writes the bytes before the first event.
    fn begin(&mut self, _out: &mut Vec<u8>) {}

    /// Appends events; a format of packets may keep some back.
    fn encode(&mut self, events: &[Event], out: &mut Vec<u8>);

    /// Appends what was kept back.
    fn flush(&mut self, _out: &mut Vec<u8>) {}

    /// Appends a table of contents, for a sink that is seekable; returns bytes that are to replace some written
    /// before, and their offset.
    fn contents(&mut self, _out: &mut Vec<u8>) -> Option<(u64, Vec<u8>)> {
        None
    }
}

/// Writes events in any format into any byte sink.
///
/// A packet's bytes are handed to the sink before [`Self::write`] returns (but for what the format keeps back until
/// [`Self::flush`]), so that a killed process loses no packet that it has seen written.
pub struct EventWriter<W: Write> {
    sink: W,
    encoder: Box<dyn Encode>,
    limits: Limits,
    buffer: Vec<u8>,
    last_us: i64,
    bytes: u64,
    failed: bool,
}

impl<W: Write> EventWriter<W> {
    /// Returns a writer into `sink`.
    ///
    /// # Errors
    /// [`Error::Io`] if the sink refuses the format's header.
    pub fn new(sink: W, encoder: impl Encode + 'static) -> Result<Self> {
        Self::boxed(sink, Box::new(encoder))
    }

    /// Does what [`Self::new`] does, for a format chosen at run time.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn boxed(sink: W, encoder: Box<dyn Encode>) -> Result<Self> {
        let limits = encoder.limits();
        let mut writer = Self { sink, encoder, limits, buffer: Vec::new(), last_us: 0, bytes: 0, failed: false };
        writer.encoder.begin(&mut writer.buffer);
        writer.drain()?;
        Ok(writer)
    }

    /// Returns the sink.
    pub fn sink(&self) -> &W {
        &self.sink
    }

    /// Returns the number of bytes that the sink has taken.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Appends events; their times may not decrease, within the packet or from the one before it.
    ///
    /// # Errors
    /// [`Error::Order`] or [`Error::Argument`] with the index of the first bad event, before anything of the packet is
    /// written; [`Error::Io`] if the sink refuses.
    pub fn write(&mut self, events: &[Event]) -> Result<()> {
        self.limits.check(events, self.last_us)?;
        for chunk in events.chunks(AT_ONCE) {
            self.encoder.encode(chunk, &mut self.buffer);
            self.drain()?;
        }
        self.last_us = events.last().map_or(self.last_us, |event| event.t);
        Ok(())
    }

    /// Hands everything to the sink and flushes it.
    ///
    /// # Errors
    /// [`Error::Io`] if the sink refuses.
    pub fn flush(&mut self) -> Result<()> {
        self.encoder.flush(&mut self.buffer);
        self.drain()?;
        self.sink.flush().map_err(Error::io(WRITING))
    }

    /// Writes what is left and gives the sink back.
    ///
    /// # Errors
    /// [`Error::Io`] if the sink refuses.
    pub fn finish(mut self) -> Result<W> {
        self.flush()?;
        Ok(self.sink)
    }

    fn drain(&mut self) -> Result<()> {
        if self.failed {
            let source = std::io::Error::other("an earlier write failed: nothing more is taken");
            return Err(Error::Io { context: WRITING.into(), source });
        }
        let written = self.sink.write_all(&self.buffer);
        // After a failure nobody knows how much went out: going on would write into a cut record, or twice.
        self.failed = written.is_err();
        self.bytes += self.buffer.len() as u64;
        self.buffer.clear();
        written.map_err(Error::io(WRITING))
    }
}

impl<W: Write + Seek> EventWriter<W> {
    /// Does what [`Self::finish`] does, with a table of contents if the format has one.
    ///
    /// # Errors
    /// [`Error::Io`] if the sink refuses.
    pub fn finish_with_contents(mut self) -> Result<W> {
        self.write_contents()?;
        Ok(self.sink)
    }

    /// Writes what is left and the table of contents; nothing may be written after it.
    pub(crate) fn write_contents(&mut self) -> Result<()> {
        self.flush()?;
        if let Some((offset, bytes)) = self.encoder.contents(&mut self.buffer) {
            self.drain()?;
            self.sink.seek(SeekFrom::Start(offset)).map_err(Error::io(WRITING))?;
            self.sink.write_all(&bytes).map_err(Error::io(WRITING))?;
            self.sink.flush().map_err(Error::io(WRITING))?;
        }
        Ok(())
    }
}

const WRITING: &str = "writing events";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::TextEncoder;

    #[test]
    fn a_bad_packet_leaves_nothing_of_itself() {
        let mut writer = EventWriter::new(Vec::new(), TextEncoder::new(Limits::NONE)).unwrap();
        writer.write(&[Event::new(5, 0, 0, true)]).unwrap();
        let backward = writer.write(&[Event::new(6, 0, 0, true), Event::new(4, 1, 1, true)]);
        assert!(matches!(backward, Err(Error::Order(ref m)) if m.contains("event 1") && m.contains("4 us")));
        assert!(matches!(writer.write(&[Event::new(-1, 0, 0, true)]), Err(Error::Order(_))));
        assert_eq!(writer.finish().unwrap(), b"0.000005000 0 0 1\n");
    }

    /// A sink with room for a number of bytes, like a disk that fills up.
    struct Disk(usize);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let n = bytes.len().min(self.0);
            self.0 -= n;
            if n == 0 && !bytes.is_empty() { Err(std::io::ErrorKind::StorageFull.into()) } else { Ok(n) }
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_is_reported_by_the_write_that_meets_it() {
        let mut writer = EventWriter::new(Disk(25), TextEncoder::new(Limits::NONE)).unwrap();
        writer.write(&[Event::new(0, 0, 0, true)]).unwrap();
        assert!(matches!(writer.write(&[Event::new(1, 0, 0, true)]), Err(Error::Io { .. })));
        // The last line is cut: what came after would be glued to it.
        assert!(matches!(writer.write(&[Event::new(2, 0, 0, true)]), Err(Error::Io { .. })));
        assert!(writer.flush().is_err());
    }
}
