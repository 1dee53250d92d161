//! The streaming reader that all formats share.

use std::io::Read;

use crate::error::{Error, Result};
use crate::event::Event;

/// Bytes asked of the source at a time.
const AT_ONCE: usize = 1 << 18;

/// Bytes asked of it for a first look.
const LOOK: usize = 1 << 12;

/// A format: how bytes become events. It does no I/O; any split of the bytes decodes alike.
pub trait Decode: Send + Sync {
    /// Appends the events of the whole records at the beginning of `bytes`, which follow those used before, and returns
    /// how many bytes they have used; the rest comes again, with more behind it.
    ///
    /// # Errors
    /// [`Error::Format`] with the place of the first record that does not follow the format.
    fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize>;

    /// [`Self::decode`] of the last bytes, behind which nothing comes. What is left over is a record that was cut off.
    ///
    /// # Errors
    /// As [`Self::decode`].
    fn end(&mut self, _bytes: &[u8], _events: &mut Vec<Event>) -> Result<usize> {
        Ok(0)
    }

    /// Whether no events can follow, whatever the source still holds.
    fn over(&self) -> bool {
        false
    }

    /// Width and height of the sensor, where the bytes so far tell.
    fn size(&self) -> Option<(u32, u32)> {
        None
    }
}

/// Reads events in any format from any byte source, in constant memory.
pub struct EventReader<R: Read> {
    source: R,
    decoder: Box<dyn Decode>,
    buffer: Vec<u8>,
    /// The bytes of `buffer` that wait to be decoded.
    waiting: std::ops::Range<usize>,
    bytes: u64,
    left_over: u64,
    over: bool,
}

impl<R: Read> EventReader<R> {
    /// A reader of `source`.
    pub fn new(source: R, decoder: impl Decode + 'static) -> Self {
        let (decoder, buffer) = (Box::new(decoder), vec![0; 2 * AT_ONCE]);
        Self { source, decoder, buffer, waiting: 0..0, bytes: 0, left_over: 0, over: false }
    }

    /// The number of bytes that have become events.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Once the source is over: the number of bytes at its end that are no whole record.
    pub fn left_over(&self) -> u64 {
        self.left_over
    }

    /// Width and height of the sensor, where what was read tells.
    pub fn size(&self) -> Option<(u32, u32)> {
        self.decoder.size()
    }

    /// Appends events until there are `enough` or a little more; false once the source is over.
    ///
    /// # Errors
    /// [`Error::Io`] if the source refuses, [`Error::Format`] from the decoder.
    pub fn read(&mut self, enough: usize, events: &mut Vec<Event>) -> Result<bool> {
        while !self.over && events.len() < enough {
            self.step(AT_ONCE, events)?;
        }
        Ok(!self.over)
    }

    /// Reads until there is an event or the size is known, and little more; for a reader that will read nothing else.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn look(&mut self) -> Result<()> {
        let mut events = Vec::new();
        while !self.over && events.is_empty() && self.size().is_none() {
            self.step(LOOK, &mut events)?;
        }
        Ok(())
    }

    fn step(&mut self, at_once: usize, events: &mut Vec<Event>) -> Result<()> {
        self.fill(at_once)?;
        let bytes = &self.buffer[self.waiting.clone()];
        let mut used = self.decoder.decode(bytes, events)?;
        if self.over {
            used += self.decoder.end(&bytes[used..], events)?;
            self.left_over = (bytes.len() - used) as u64;
        }
        self.over |= self.decoder.over();
        self.waiting.start += used;
        self.bytes += used as u64;
        Ok(())
    }

    /// Moves what waits to the front and puts more behind it; a record that fills the buffer makes it grow.
    fn fill(&mut self, at_once: usize) -> Result<()> {
        let kept = self.waiting.len();
        self.buffer.copy_within(self.waiting.clone(), 0);
        if self.buffer.len() < kept + at_once {
            self.buffer.resize(2 * (kept + at_once), 0);
        }
        self.waiting = 0..kept;
        // To the buffer's end only where it has grown: what is decoded should still be in the cache.
        let until = (kept + at_once).max(2 * kept).min(self.buffer.len());
        loop {
            match self.source.read(&mut self.buffer[kept..until]) {
                Ok(0) => self.over = true,
                Ok(n) => self.waiting.end += n,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(Error::io("reading events")(error)),
            }
            return Ok(());
        }
    }
}
