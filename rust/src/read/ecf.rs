//! Chunks of ECF to events: the compression of Metavision's HDF5 files.
//!
//! A chunk begins with the number of its events and their layout, in 32 bits, and the first time, in 64. Times follow as
//! runs of events, then rows, columns and polarities. They lie in one of three layouts: all three packed into 24 bits;
//! runs of rows, with columns and polarities packed into 12 bits; or runs of each, where a column has a bit for each of
//! the next five.
//!
//! What must not break: a run never goes beyond the number of events that the chunk says, and that number never beyond
//! what the caller allows, so that damaged bytes take no more memory than that.
//!
//! Source: `hdf5_ecf`, Prophesee's codec, HDF5's filter 0x8ECF.

use crate::error::{Error, Result};
use crate::event::Event;

/// Decodes one chunk. Times are never less than the first one.
///
/// # Errors
///
/// [`Error::Format`] for more events than `most`, and for bytes that end too early, go beyond the number of events, or
/// are left over.
pub fn decode_ecf(bytes: &[u8], most: usize) -> Result<Vec<Event>> {
    let mut chunk = Chunk { bytes, next: 0 };
    let header = chunk.u32()?;
    let count = (header >> 2) as usize;
    if count > most {
        return Err(chunk.wrong(format!("it says {count} events, and may have {most}")));
    }
    let mut columns = Columns::new(count);
    chunk.times(&mut columns)?;
    if header & 2 != 0 {
        chunk.packed_pixels(&mut columns)?;
    } else {
        chunk.rows(&mut columns)?;
        if header & 1 != 0 {
            chunk.packed_columns(&mut columns)?;
        } else {
            chunk.masked_columns(&mut columns)?;
            chunk.polarities(&mut columns)?;
        }
    }
    if chunk.next < bytes.len() {
        return Err(chunk.wrong(format!("its events end here, but it has {} bytes", bytes.len())));
    }
    Ok(columns.events())
}

/// What has been decoded of each event.
struct Columns {
    count: usize,
    t: Vec<i64>,
    x: Vec<u16>,
    y: Vec<u16>,
    on: Vec<bool>,
}

impl Columns {
    fn new(count: usize) -> Self {
        Self {
            count,
            t: Vec::with_capacity(count),
            x: Vec::with_capacity(count),
            y: Vec::with_capacity(count),
            on: Vec::with_capacity(count),
        }
    }

    fn events(self) -> Vec<Event> {
        let pixels = self.x.into_iter().zip(self.y).zip(self.on);
        self.t.into_iter().zip(pixels).map(|(t, ((x, y), on))| Event::new(t, x, y, on)).collect()
    }
}

/// The bytes of a chunk, and where the next one lies.
struct Chunk<'a> {
    bytes: &'a [u8],
    next: usize,
}

impl Chunk<'_> {
    fn wrong(&self, message: String) -> Error {
        Error::Format { message, line: None, byte: self.next }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let Some(bytes) = self.bytes[self.next..].first_chunk() else {
            return Err(self.wrong("it ends within its events".into()));
        };
        self.next += N;
        Ok(*bytes)
    }

    fn u8(&mut self) -> Result<u8> {
        self.take::<1>().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Result<u16> {
        self.take().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// Appends a value so many times.
    fn repeat<T: Copy>(&self, values: &mut Vec<T>, value: T, times: usize, count: usize) -> Result<()> {
        if times > count - values.len() {
            return Err(self.wrong(format!("a run goes beyond its {count} events")));
        }
        values.resize(values.len() + times, value);
        Ok(())
    }

    /// Decodes times: in each byte the steps from the time before, and how many events there are at this one. 15 events
    /// stand for a number in the next 16 bits. 15 steps stand for four bits of a longer way, the lowest ones first.
    fn times(&mut self, columns: &mut Columns) -> Result<()> {
        let first = self.take().map(u64::from_le_bytes)?;
        let (mut t, mut way, mut bits) = (u128::from(first), 0u128, 0);
        while columns.t.len() < columns.count {
            let byte = self.u8()?;
            let (steps, run) = (byte >> 4, byte & 15);
            if steps == 15 {
                if bits == 64 {
                    return Err(self.wrong("a way in time has more than 64 bits".into()));
                }
                way |= u128::from(run) << bits;
                bits += 4;
                continue;
            }
            t += way + u128::from(steps);
            (way, bits) = (0, 0);
            let run = if run == 15 { usize::from(self.u16()?) } else { usize::from(run) };
            let Ok(time) = i64::try_from(t) else {
                return Err(self.wrong(format!("time {t} does not fit into 63 bits")));
            };
            self.repeat(&mut columns.t, time, run, columns.count)?;
        }
        Ok(())
    }

    /// Decodes rows: 11 bits, and 5 for how many events are in it; 31 stands for a number in the next 16 bits.
    fn rows(&mut self, columns: &mut Columns) -> Result<()> {
        while columns.y.len() < columns.count {
            let word = self.u16()?;
            let run = if word & 31 == 31 { self.u16()? } else { word & 31 };
            self.repeat(&mut columns.y, word >> 5, run.into(), columns.count)?;
        }
        Ok(())
    }

    /// Decodes columns: 11 bits, and a bit for each of the next five, the nearest one first.
    fn masked_columns(&mut self, columns: &mut Columns) -> Result<()> {
        while columns.x.len() < columns.count {
            let word = self.u16()?;
            columns.x.push(word >> 5);
            columns.x.extend((1..=5).filter(|step| word >> (5 - step) & 1 == 1).map(|step| (word >> 5) + step));
        }
        // Encoders look a little beyond the last event.
        columns.x.truncate(columns.count);
        Ok(())
    }

    /// Decodes polarities: one bit, and 7 for how many events have it; 127 stands for a number in the next 16 bits.
    fn polarities(&mut self, columns: &mut Columns) -> Result<()> {
        while columns.on.len() < columns.count {
            let byte = self.u8()?;
            let run = if byte & 127 == 127 { self.u16()? } else { u16::from(byte & 127) };
            self.repeat(&mut columns.on, byte >> 7 == 1, run.into(), columns.count)?;
        }
        Ok(())
    }

    /// Decodes four columns and polarities of 12 bits each from three words of 16.
    fn packed_columns(&mut self, columns: &mut Columns) -> Result<()> {
        while columns.x.len() < columns.count {
            let [a, b, c] = [self.u16()?, self.u16()?, self.u16()?];
            for value in [a >> 4, (a & 0xf) | b >> 8 << 4, (b & 0xff) | c >> 12 << 8, c & 0xfff] {
                columns.x.push(value >> 1);
                columns.on.push(value & 1 == 1);
            }
        }
        columns.x.truncate(columns.count);
        columns.on.truncate(columns.count);
        Ok(())
    }

    /// Decodes rows, columns and polarities of four events, of 24 bits each, from three words of 32.
    #[allow(clippy::cast_possible_truncation, reason = "fields of 11 bits")]
    fn packed_pixels(&mut self, columns: &mut Columns) -> Result<()> {
        while columns.x.len() < columns.count {
            let [a, b, c] = [self.u32()?, self.u32()?, self.u32()?];
            for value in [a >> 8, (a & 0xff) | b >> 16 << 8, (b & 0xffff) | c >> 24 << 16, c & 0xff_ffff] {
                columns.y.push((value >> 12 & 0x7ff) as u16);
                columns.x.push((value >> 1 & 0x7ff) as u16);
                columns.on.push(value & 1 == 1);
            }
        }
        columns.y.truncate(columns.count);
        columns.x.truncate(columns.count);
        columns.on.truncate(columns.count);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chunk's header and first time.
    fn head(count: u32, layout: u32, first: u64) -> Vec<u8> {
        [(count << 2 | layout).to_le_bytes().as_slice(), &first.to_le_bytes()].concat()
    }

    fn words<const N: usize>(words: [u16; N]) -> Vec<u8> {
        words.into_iter().flat_map(u16::to_le_bytes).collect()
    }

    fn rule(bytes: &[u8], most: usize) -> String {
        decode_ecf(bytes, most).unwrap_err().to_string()
    }

    #[test]
    fn runs_are_events() {
        // Two at 1000, one 3 later, one 0x123 after that; rows 7 and 9; columns 5, 6 and 10, and 2; ON, OFF.
        let times = [0x02, 0x31, 0xf3, 0xf2, 0xf1, 0x01];
        let rows = words([7 << 5 | 3, 9 << 5 | 1]);
        let columns = words([5 << 5 | 0b10001, 2 << 5]);
        let polarities = [0x83, 0x01];
        let bytes = [head(4, 0, 1000), times.to_vec(), rows, columns, polarities.to_vec()].concat();
        let expected = [
            Event::new(1000, 5, 7, true),
            Event::new(1000, 6, 7, true),
            Event::new(1003, 10, 7, true),
            Event::new(1003 + 0x123, 2, 9, false),
        ];
        assert_eq!(decode_ecf(&bytes, 4).unwrap(), expected);
        assert_eq!(rule(&bytes, 3), "it says 4 events, and may have 3 (byte 4)");
        for end in 0..bytes.len() {
            assert!(rule(&bytes[..end], 4).starts_with("it ends within its events"), "{end}");
        }
        assert_eq!(rule(&[&bytes[..], &[0]].concat(), 4), "its events end here, but it has 29 bytes (byte 28)");
    }

    #[test]
    fn long_runs_have_a_number_of_their_own() {
        let times = [0x0f, 0x2c, 0x01]; // 300
        let (rows, columns) = (words([4 << 5 | 31, 300]), words([6 << 5; 300]));
        let polarities = [0xff, 0x2c, 0x01];
        let bytes = [head(300, 0, 5), times.to_vec(), rows, columns, polarities.to_vec()].concat();
        assert_eq!(decode_ecf(&bytes, 1 << 16).unwrap(), vec![Event::new(5, 6, 4, true); 300]);
        let bytes = [head(299, 0, 5), times.to_vec()].concat();
        assert_eq!(rule(&bytes, 299), "a run goes beyond its 299 events (byte 15)");
    }

    #[test]
    fn packed_layouts_are_events_of_which_the_last_group_may_be_short() {
        let expected = |n: usize| -> Vec<Event> {
            [(2047, 3, true), (1, 2047, false), (1365, 682, true), (682, 1365, false), (9, 8, true)][..n]
                .iter()
                .map(|&(x, y, on)| Event::new(70, x, y, on))
                .collect()
        };
        for n in 1..=5usize {
            let mut padded = expected(n);
            padded.resize(n.next_multiple_of(4), Event::new(0, 77, 78, true));
            let (mut columns, mut pixels) = (vec![], vec![]);
            for group in padded.chunks(4) {
                let v: Vec<u32> = group.iter().map(|e| u32::from(e.x) << 1 | u32::from(e.p)).collect();
                let of_columns = [v[0] << 4 | v[1] & 15, v[1] >> 4 << 8 | v[2] & 255, v[2] >> 8 << 12 | v[3]];
                columns.extend(of_columns.into_iter().flat_map(|word| u16::try_from(word).unwrap().to_le_bytes()));
                let v: Vec<u32> = group.iter().zip(&v).map(|(e, v)| u32::from(e.y) << 12 | v).collect();
                let of_pixels = [v[0] << 8 | v[1] & 0xff, v[1] >> 8 << 16 | v[2] & 0xffff, v[2] >> 16 << 24 | v[3]];
                pixels.extend(of_pixels.into_iter().flat_map(u32::to_le_bytes));
            }
            let (count, times) = (u32::try_from(n).unwrap(), vec![0x70 | u8::try_from(n).unwrap()]);
            let rows: Vec<u8> = expected(n).iter().flat_map(|event| (event.y << 5 | 1).to_le_bytes()).collect();
            let by_columns = [head(count, 1, 63), times.clone(), rows, columns].concat();
            assert_eq!(decode_ecf(&by_columns, 5).unwrap(), expected(n));
            let by_pixels = [head(count, 2, 63), times, pixels].concat();
            assert_eq!(decode_ecf(&by_pixels, 5).unwrap(), expected(n));
        }
    }

    #[test]
    fn times_that_do_not_fit_are_refused() {
        let latest = i64::MAX.cast_unsigned();
        assert!(rule(&[head(1, 0, latest), vec![0x11]].concat(), 1).starts_with("time 9223372036854775808 does not"));
        assert!(rule(&[head(1, 0, 0), vec![0xf1; 17]].concat(), 1).starts_with("a way in time has more than 64 bits"));
        assert!(rule(&[head(1, 0, 0), vec![0xf0; 16], vec![0x02]].concat(), 1).starts_with("a run goes beyond"));
    }
}
