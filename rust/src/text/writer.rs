//! Events to text, streaming.

use std::io::Write;

use crate::error::{Error, Result};
use crate::event::Event;

/// Bytes gathered before they are handed to the operating system.
const BUFFER: usize = 1 << 18;

/// The longest line: a time of 19 digits, the point, five digits for each coordinate, spaces, polarity, newline.
const LONGEST_LINE: usize = 48;

/// Writes events as lines `sec.nnnnnnnnn x y p`.
///
/// Bytes go out in whole lines, so that what a killed process leaves behind ends with a complete one.
pub struct EventTextWriter<W: Write> {
    sink: W,
    buffer: Vec<u8>,
    last_us: i64,
    /// Events whose lines went out, and those that wait in the buffer.
    events: u64,
    waiting: u64,
    failed: bool,
}

impl<W: Write> EventTextWriter<W> {
    /// A writer into any byte sink; it buffers by itself.
    pub fn new(sink: W) -> Self {
        Self {
            sink,
            buffer: Vec::with_capacity(BUFFER + LONGEST_LINE),
            last_us: 0,
            events: 0,
            waiting: 0,
            failed: false,
        }
    }

    /// The number of events handed to the sink; after [`Self::flush`], all.
    pub fn events(&self) -> u64 {
        self.events
    }

    /// Appends events; their times may not decrease, within the packet or from the one before it.
    ///
    /// # Errors
    /// [`Error::Order`] or [`Error::Argument`] with the index of the first bad event, before anything of the packet is
    /// written; [`Error::Io`] if the sink refuses.
    pub fn write(&mut self, events: &[Event]) -> Result<()> {
        self.refuse_after_failure()?;
        self.check(events)?;
        for event in events {
            push_line(&mut self.buffer, event);
            self.last_us = event.t;
            self.waiting += 1;
            if self.buffer.len() >= BUFFER {
                self.drain()?;
            }
        }
        Ok(())
    }

    /// Hands everything to the sink and flushes it.
    ///
    /// # Errors
    /// [`Error::Io`] if the sink refuses.
    pub fn flush(&mut self) -> Result<()> {
        self.drain()?;
        self.sink.flush().map_err(Error::io("writing events"))
    }

    /// Flushes and gives the sink back.
    ///
    /// # Errors
    /// [`Error::Io`] if the sink refuses.
    pub fn finish(mut self) -> Result<W> {
        self.flush()?;
        Ok(self.sink)
    }

    fn drain(&mut self) -> Result<()> {
        self.refuse_after_failure()?;
        let written = self.sink.write_all(&self.buffer);
        // After a failure nobody knows how much went out: going on would write into a cut line, or twice.
        self.failed = written.is_err();
        self.buffer.clear();
        written.map_err(Error::io("writing events"))?;
        self.events += std::mem::take(&mut self.waiting);
        Ok(())
    }

    fn refuse_after_failure(&self) -> Result<()> {
        if self.failed {
            let source = std::io::Error::other("an earlier write failed: nothing more is taken");
            return Err(Error::Io { context: "writing events".into(), source });
        }
        Ok(())
    }

    fn check(&self, events: &[Event]) -> Result<()> {
        let mut last_us = self.last_us;
        for (index, event) in events.iter().enumerate() {
            if event.t < last_us {
                return Err(Error::Order(format!(
                    "event times must not decrease and start at 0 or later: event {index} of the packet is at {} us, \
                     after {last_us} us",
                    event.t
                )));
            }
            if event.p > 1 {
                return Err(Error::Argument(format!(
                    "polarity must be 0 or 1: event {index} of the packet has {}",
                    event.p
                )));
            }
            last_us = event.t;
        }
        Ok(())
    }
}

fn push_line(buffer: &mut Vec<u8>, event: &Event) {
    let t = event.t.unsigned_abs();
    push_number(buffer, t / 1_000_000, 1);
    buffer.push(b'.');
    push_number(buffer, t % 1_000_000, 6);
    buffer.extend_from_slice(b"000 ");
    push_number(buffer, event.x.into(), 1);
    buffer.push(b' ');
    push_number(buffer, event.y.into(), 1);
    buffer.extend_from_slice(&[b' ', b'0' + event.p, b'\n']);
}

/// Appends a decimal number, with leading zeros up to `least` digits.
#[allow(clippy::cast_possible_truncation, reason = "a digit")]
fn push_number(buffer: &mut Vec<u8>, mut number: u64, least: usize) {
    let mut digits = [b'0'; 20];
    let mut start = digits.len();
    while number > 0 {
        start -= 1;
        digits[start] += (number % 10) as u8;
        number /= 10;
    }
    buffer.extend_from_slice(&digits[start.min(digits.len() - least)..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(events: &[Event]) -> String {
        let mut writer = EventTextWriter::new(Vec::new());
        writer.write(events).unwrap();
        String::from_utf8(writer.finish().unwrap()).unwrap()
    }

    #[test]
    fn lines_follow_the_dataset() {
        let events =
            [Event::new(0, 0, 0, false), Event::new(3_811, 96, 133, false), Event::new(1_000_000, 239, 9, true)];
        assert_eq!(text(&events), "0.000000000 0 0 0\n0.003811000 96 133 0\n1.000000000 239 9 1\n");
    }

    #[test]
    fn the_longest_line_is_whole() {
        let line = text(&[Event::new(i64::MAX, u16::MAX, u16::MAX, true)]);
        assert_eq!(line, "9223372036854.775807000 65535 65535 1\n");
        assert!(line.len() <= LONGEST_LINE);
    }

    #[test]
    fn a_bad_packet_leaves_nothing_of_itself() {
        let mut writer = EventTextWriter::new(Vec::new());
        writer.write(&[Event::new(5, 0, 0, true)]).unwrap();
        let backward = writer.write(&[Event::new(6, 0, 0, true), Event::new(4, 1, 1, true)]);
        assert!(matches!(backward, Err(Error::Order(ref m)) if m.contains("event 1") && m.contains("4 us")));
        assert!(matches!(writer.write(&[Event::new(-1, 0, 0, true)]), Err(Error::Order(_))));
        let mut wrong = Event::new(7, 0, 0, true);
        wrong.p = 2;
        assert!(matches!(writer.write(&[wrong]), Err(Error::Argument(_))));
        writer.flush().unwrap();
        assert_eq!(writer.events(), 1);
        assert_eq!(writer.finish().unwrap(), b"0.000005000 0 0 1\n");
    }

    /// A sink with room for so many bytes, as a disk that fills up.
    struct Disk(usize);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let n = bytes.len().min(self.0);
            self.0 -= n;
            if n == 0 { Err(std::io::ErrorKind::StorageFull.into()) } else { Ok(n) }
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_is_reported_at_the_latest_by_flush() {
        let mut writer = EventTextWriter::new(Disk(10));
        writer.write(&[Event::new(0, 0, 0, true)]).unwrap();
        assert!(matches!(writer.flush(), Err(Error::Io { .. })));
        // The last line is cut: what came after would be glued to it.
        assert!(matches!(writer.write(&[Event::new(1, 0, 0, true)]), Err(Error::Io { .. })));
        assert!(writer.flush().is_err());
        assert_eq!(writer.events(), 0);
    }
}
