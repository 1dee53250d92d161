//! The streaming reader that all formats share.

use std::io::{Read, Seek, SeekFrom};

use crate::error::{Error, Result};
use crate::event::Event;

/// Bytes asked of the source at a time.
const AT_ONCE: usize = 1 << 18;

/// Bytes asked of it for a first look.
const LOOK: usize = 1 << 12;

/// Bytes of the file in a block of [`EventReader::scan`], or one record if that is longer.
const BLOCK: usize = 1 << 15;

/// What a decoder carries from record to record, apart from the file's header; zeros where it carries less.
pub type DecoderState = [i64; 5];

/// Bytes of a file that can be decoded without those before them, but for its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Where it begins.
    pub byte: u64,
    /// What the decoder carries there.
    pub state: DecoderState,
    /// The number of its events, at least 1.
    pub events: usize,
    /// The time of its first event in microseconds.
    pub first_us: i64,
    /// The time of its last event in microseconds.
    pub last_us: i64,
}

/// A format: how bytes become events. It does no I/O; any split of the bytes decodes alike.
pub trait Decode: Send + Sync {
    /// Appends the events of the whole records at the beginning of `bytes`, which follow those used before, and returns
    /// how many bytes they have used; the rest comes again, with more behind it.
    ///
    /// # Errors
    /// [`Error::Format`] with the position of the first record that does not follow the format.
    fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize>;

    /// Decodes the last bytes, as [`Self::decode`] does, behind which nothing comes. What is left over is a record that
    /// was cut off.
    ///
    /// # Errors
    /// As [`Self::decode`].
    fn end(&mut self, _bytes: &[u8], _events: &mut Vec<Event>) -> Result<usize> {
        Ok(0)
    }

    /// Returns whether no events can follow, whatever the source still holds.
    fn over(&self) -> bool {
        false
    }

    /// Returns width and height of the sensor, where the bytes so far tell.
    fn size(&self) -> Option<(u32, u32)> {
        None
    }

    /// Returns what it carries from the records behind it to the next one.
    fn state(&self) -> DecoderState {
        DecoderState::default()
    }

    /// Goes on at another byte of the same file, where a decoder that had come so far carried `state`. It has read the
    /// file's header before; at byte 0 it begins anew.
    ///
    /// # Errors
    /// [`Error::Argument`] for a state that no decoder of the format has.
    fn resume(&mut self, byte: usize, state: DecoderState) -> Result<()>;
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
    looked: bool,
    /// Of what [`Self::scan`] has met: the last time, and the number of events.
    scanned: (i64, u64),
}

impl<R: Read> EventReader<R> {
    /// Returns a reader of `source`.
    pub fn new(source: R, decoder: impl Decode + 'static) -> Self {
        let (decoder, buffer) = (Box::new(decoder), vec![0; 2 * AT_ONCE]);
        let (bytes, left_over, scanned) = (0, 0, (0, 0));
        Self { source, decoder, buffer, waiting: 0..0, bytes, left_over, over: false, looked: false, scanned }
    }

    /// Returns the number of bytes that have become events.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Returns, once the source is over, the number of bytes at its end that are no whole record.
    pub fn left_over(&self) -> u64 {
        self.left_over
    }

    /// Returns width and height of the sensor, where what was read tells.
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

    /// Goes on from where the reader is, and appends blocks until there are `enough`; false once the source is over.
    ///
    /// # Errors
    /// As [`Self::read`]; [`Error::Format`] for an event before 0, or earlier than the one before it.
    pub fn scan(&mut self, enough: usize, blocks: &mut Vec<Block>) -> Result<bool> {
        let mut events = Vec::new();
        while !self.over && blocks.len() < enough {
            let (byte, state) = (self.bytes, self.decoder.state());
            self.step(BLOCK, &mut events)?;
            if let (Some(first), Some(last)) = (events.first(), events.last()) {
                blocks.push(Block { byte, state, events: events.len(), first_us: first.t, last_us: last.t });
            }
            let (mut last_us, mut number) = self.scanned;
            for event in events.drain(..) {
                if event.t < last_us {
                    let message = format!(
                        "times may not lie before 0, nor go back: event {number} is at {} us, after {last_us} us",
                        event.t
                    );
                    let byte = usize::try_from(byte).unwrap_or(usize::MAX);
                    return Err(Error::Format { message, line: None, byte });
                }
                (last_us, number) = (event.t, number + 1);
            }
            self.scanned = (last_us, number);
        }
        Ok(!self.over)
    }

    fn step(&mut self, at_once: usize, events: &mut Vec<Event>) -> Result<()> {
        self.looked = true;
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

impl<R: Read + Seek> EventReader<R> {
    /// Goes to where a line of text or a packet of events begins.
    ///
    /// # Errors
    /// [`Error::Io`] if the source refuses.
    pub fn go_to(&mut self, byte: u64) -> Result<()> {
        self.resume(byte, DecoderState::default())
    }

    /// Returns the events of a block that [`Self::scan`] has found in the same file, which ends where the next one
    /// begins (`end`).
    ///
    /// # Errors
    /// [`Error::Io`] if the source refuses; [`Error::Format`] from the decoder; [`Error::Argument`] for a `state` that no
    /// decoder has.
    pub fn read_block(&mut self, byte: u64, state: DecoderState, end: u64) -> Result<Vec<Event>> {
        self.resume(byte, state)?;
        let mut bytes = Vec::new();
        self.source
            .by_ref()
            .take(end.saturating_sub(byte))
            .read_to_end(&mut bytes)
            .map_err(Error::io("reading events"))?;
        let mut events = Vec::new();
        let used = self.decoder.decode(&bytes, &mut events)?;
        if used < bytes.len() {
            self.decoder.end(&bytes[used..], &mut events)?;
        }
        Ok(events)
    }

    fn resume(&mut self, byte: u64, state: DecoderState) -> Result<()> {
        if !self.looked {
            self.look()?;
        }
        self.source.seek(SeekFrom::Start(byte)).map_err(Error::io("reading events"))?;
        self.decoder.resume(usize::try_from(byte).unwrap_or(usize::MAX), state)?;
        (self.waiting, self.bytes, self.over) = (0..0, byte, false);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::Evt3Decoder;
    use std::io::Cursor;

    #[test]
    fn blocks_are_read_by_themselves_in_any_order() {
        // Times, rows, and vectors that go on from one to the next: all that EVT 3.0 carries changes on the way.
        let mut words = vec![0x8001u16, 0x6000, 0x0007];
        for k in 0u16..30_000 {
            words.extend([0x3000 | (k & 0x800) | (k % 700), 0x4fff, 0x5081, 0x6000 | (k / 10)]);
            words.extend((k % 500 == 0).then_some(k % 2048));
            words.push(0x4801);
        }
        let mut bytes = b"% geometry 2048x2048\n% end\n".to_vec();
        bytes.extend(words.into_iter().flat_map(u16::to_le_bytes));
        let mut whole = Vec::new();
        EventReader::new(&bytes[..], Evt3Decoder::new()).read(usize::MAX, &mut whole).unwrap();
        let reader = || EventReader::new(Cursor::new(&bytes), Evt3Decoder::new());
        let (mut blocks, mut scanned) = (Vec::new(), reader());
        while scanned.scan(blocks.len() + 2, &mut blocks).unwrap() {}
        assert!(blocks.len() > 5);
        assert_eq!(blocks.iter().map(|block| block.events).sum::<usize>(), whole.len());
        let (mut end, mut end_byte, mut fresh) = (whole.len(), bytes.len() as u64, reader());
        for block in blocks.iter().rev() {
            let expected = &whole[end - block.events..end];
            assert_eq!((block.first_us, block.last_us), (expected[0].t, expected[block.events - 1].t));
            assert_eq!(fresh.read_block(block.byte, block.state, end_byte).unwrap(), expected);
            (end, end_byte) = (end - block.events, block.byte);
        }
        assert!(matches!(fresh.read_block(100, [-1; 5], 200), Err(Error::Argument(_))));
    }
}
