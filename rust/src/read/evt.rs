//! What EVT 2.0, EVT 2.1 and EVT 3.0 share: the text before the words, and times whose high part goes round.

use super::reader::{Decode, DecoderState};
use crate::error::{Error, Result};
use crate::event::Event;

/// A header is no longer; what goes on beyond is no `.raw` file.
const LONGEST: usize = 1 << 16;

/// Reads length and sensor size of a `.raw` file's header, once all of it is in `bytes` (at the end of the input:
/// however it ends).
fn header(bytes: &[u8], at_end: bool) -> Result<Option<Header>> {
    let mut header = Header { length: 0, size: None, start_us: 0, legacy: false };
    let (mut width, mut height) = (None, None);
    loop {
        let rest = &bytes[header.length..];
        match rest.first() {
            Some(b'%') => {}
            Some(_) => break,
            None if at_end => break,
            None => return Ok(None),
        }
        let Some(end) = rest.iter().position(|&b| b == b'\n') else {
            if !at_end && rest.len() < LONGEST {
                return Ok(None);
            }
            let message = "a header line must end with a newline".to_owned();
            return Err(Error::Format { message, line: None, byte: header.length });
        };
        header.length += end + 1;
        let line = String::from_utf8_lossy(&rest[1..end]);
        let line = line.trim();
        if line == "end" {
            break;
        }
        if let Some(geometry) = line.strip_prefix("geometry ") {
            if let Some((w, h)) = geometry.split_once('x') {
                (width, height) = (w.trim().parse().ok(), h.trim().parse().ok());
            }
        } else if let Some(start) = line.strip_prefix("t0 ") {
            // Below 2^62, so that no time added to it leaves an i64.
            header.start_us = start.trim().parse().ok().filter(|start| (0..1 << 62).contains(start)).unwrap_or(0);
        } else if let Some(format) = line.strip_prefix("format ") {
            for (key, value) in format.split(';').filter_map(|item| item.split_once('=')) {
                match key.trim() {
                    "width" => width = value.trim().parse().ok(),
                    "height" => height = value.trim().parse().ok(),
                    "endianness" => header.legacy = value.trim() == "legacy",
                    _ => {}
                }
            }
        }
    }
    header.size = width.zip(height).filter(|&(width, height)| width > 0 && height > 0);
    Ok(Some(header))
}

struct Header {
    length: usize,
    size: Option<(u32, u32)>,
    /// What all times have to be added to: faery takes the first time off.
    start_us: i64,
    /// Of EVT 2.1: both halves of a word are swapped.
    legacy: bool,
}

/// How far a decoder is past the header.
#[derive(Default)]
pub(super) struct Preamble(Option<Header>);

impl Preamble {
    /// Returns the preamble of a stream that has no header.
    pub(super) fn none() -> Self {
        Self(Some(Header { length: 0, size: None, start_us: 0, legacy: false }))
    }

    /// Returns how many of the bytes lie before the words; None until all of the header is there.
    pub(super) fn pass(&mut self, bytes: &[u8]) -> Result<Option<usize>> {
        if self.0.is_some() {
            return Ok(Some(0));
        }
        self.0 = header(bytes, false)?;
        Ok(self.0.as_ref().map(|header| header.length))
    }

    /// Returns how many of the bytes at the end of the input belong to the header.
    pub(super) fn end(&self, bytes: &[u8]) -> Result<usize> {
        Ok(if self.0.is_some() { 0 } else { header(bytes, true)?.map_or(0, |header| header.length) })
    }

    pub(super) fn size(&self) -> Option<(u32, u32)> {
        self.0.as_ref()?.size
    }

    /// Returns whether the words are of a camera of an early kind.
    fn legacy(&self) -> bool {
        self.0.as_ref().is_some_and(|header| header.legacy)
    }

    /// Returns what is added to all times.
    pub(super) fn start_us(&self) -> i64 {
        self.0.as_ref().map_or(0, |header| header.start_us)
    }
}

/// Words of one of the formats, and the state that they change.
pub trait Words: Default + Send + Sync {
    /// Takes what the header says of the order of bytes, before any words.
    fn begin(&mut self, _legacy: bool) {}

    /// Decodes whole words, adds `start_us` to their times, and returns how many bytes they have.
    fn decode(&mut self, bytes: &[u8], start_us: i64, events: &mut Vec<Event>) -> usize;

    /// Returns what [`Decode::state`] does.
    fn state(&self) -> DecoderState;

    /// Does what [`Decode::resume`] does.
    ///
    /// # Errors
    /// [`Error::Argument`] for a state that no decoder has.
    fn resume(&mut self, state: DecoderState) -> Result<()>;
}

/// Decodes a `.raw` file: a header, then words.
#[derive(Default)]
pub struct EvtDecoder<W> {
    preamble: Preamble,
    words: W,
}

impl<W: Words> EvtDecoder<W> {
    /// Returns a decoder of a file's bytes, from its beginning.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns a decoder of words alone, without a header before them: those of packets of a stream.
    #[must_use]
    pub fn of_words() -> Self {
        Self { preamble: Preamble::none(), words: W::default() }
    }
}

impl<W: Words> Decode for EvtDecoder<W> {
    fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<usize> {
        let Some(used) = self.preamble.pass(bytes)? else { return Ok(0) };
        self.words.begin(self.preamble.legacy());
        Ok(used + self.words.decode(&bytes[used..], self.preamble.start_us(), events))
    }

    fn end(&mut self, bytes: &[u8], _events: &mut Vec<Event>) -> Result<usize> {
        self.preamble.end(bytes)
    }

    fn size(&self) -> Option<(u32, u32)> {
        self.preamble.size()
    }

    fn state(&self) -> DecoderState {
        self.words.state()
    }

    fn resume(&mut self, byte: usize, state: DecoderState) -> Result<()> {
        if byte == 0 {
            self.preamble = Preamble::default();
        }
        self.words.resume(state)
    }
}

/// The high part of EVT 2.0's and 2.1's times, in units of 64 us: bits 33..6 go round. It is all the state that these
/// decoders have.
pub(super) type Evt2Time = HighTime<{ 1 << 28 }>;

impl Evt2Time {
    /// Returns what [`Words::state`] does.
    pub(super) fn decoder_state(self) -> DecoderState {
        [self.state(), 0, 0, 0, 0]
    }

    /// Returns the one of a decoder's state.
    pub(super) fn of_decoder_state([high, ..]: DecoderState) -> Result<Self> {
        Self::of_state(high, 1 << 55)
    }
}

/// The high part of a time, rounds included: a counter that goes round at `ROUND`. It has none before its first value.
#[derive(Clone, Copy, Default)]
pub(super) struct HighTime<const ROUND: i64>(Option<i64>);

impl<const ROUND: i64> HighTime<ROUND> {
    pub(super) fn get(self) -> Option<i64> {
        self.0
    }

    /// Takes the counter's next value; one that goes back by half a round or more has gone round.
    pub(super) fn advance(&mut self, value: i64) {
        let Some(last) = self.0 else {
            self.0 = Some(value);
            return;
        };
        let same_round = last - last % ROUND + value;
        self.0 = Some(if last - same_round >= ROUND / 2 { same_round + ROUND } else { same_round });
    }

    /// Returns the number that stands for it in a decoder's state: 0 for none.
    pub(super) fn state(self) -> i64 {
        self.0.map_or(0, |high| high + 1)
    }

    /// Returns the one that a number in a decoder's state stands for, which must lie below `end`.
    pub(super) fn of_state(state: i64, end: i64) -> Result<Self> {
        let next: i64 = state_number(state, end)?;
        Ok(Self((next > 0).then(|| next - 1)))
    }
}

/// Returns a number of a decoder's state, which must lie in `0..end`.
pub(super) fn state_number<T: TryFrom<i64>>(value: i64, end: i64) -> Result<T> {
    let number = (0..end).contains(&value).then(|| T::try_from(value).ok()).flatten();
    number.ok_or_else(|| Error::Argument(format!("a decoder's state must lie in 0..{end}: got {value}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_cameras_and_of_other_programs_are_read() {
        for (text, size, start_us) in [
            (&b"% evt 3.0\n% format EVT3;height=720;width=1280\n% end\n\x25\x80"[..], Some((1280, 720)), 0),
            (b"% date 2020-01-01 00:00:00\n% evt 2.0\n% geometry 640x480\n% t0 70\n\x00\x80", Some((640, 480)), 70),
            (b"% evt 2.0\n\x00\x80", None, 0),
            (b"\x00\x80", None, 0),
        ] {
            let decoded = header(text, false).unwrap().unwrap();
            assert_eq!((decoded.size, decoded.start_us), (size, start_us));
            assert_eq!(decoded.length, text.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1));
        }
        assert!(header(b"% evt 2.0\n% geo", false).unwrap().is_none());
        assert!(header(b"% evt 2.0\n% geo", true).is_err());
        assert!(header(&vec![b'%'; 70_000], false).is_err());
    }
}
