//! The three flatbuffers of a file, laid out by hand: little-endian, with their size before them.
//!
//! A table begins with the distance back to its vtable; that holds its own size, the table's, and the offset of each
//! field in it. Places are counted from the size, so that what is aligned there is aligned in memory.

use crate::event::Event;

/// Bytes of an entry in the table of contents, padding included.
const ENTRY: usize = 48;

/// Where [`header`] keeps the offset of the table of contents.
pub(super) const TABLE_OFFSET: usize = 32;

/// A packet in the table of contents.
pub(super) struct Entry {
    /// Where its body begins, and how long it is.
    pub(super) offset: u64,
    pub(super) size: i32,
    pub(super) events: usize,
    pub(super) first_us: i64,
    pub(super) last_us: i64,
}

/// Returns `IOHE`: compression (i32), offset of the table of contents (i64, -1 for none), description (string).
pub(super) fn header(compression: i32, info: &str) -> Vec<u8> {
    let mut b = start(*b"IOHE", 24);
    // The vtable: three fields, of a table of 24 bytes.
    words16(&mut b, &[10, 24, 4, 8, 16, 0]);
    words32(&mut b, &[12, compression]);
    b.extend_from_slice(&(-1i64).to_le_bytes());
    words32(&mut b, &[8, 0, length(info.len())]);
    b.extend_from_slice(info.as_bytes());
    b.push(0);
    finish(b)
}

/// Writes `EVTS`: a vector of events, which have `start_us` added to their times.
pub(super) fn events(events: &[Event], start_us: i64, b: &mut Vec<u8>) {
    b.extend(start(*b"EVTS", 20));
    words16(b, &[0, 6, 8, 4]);
    words32(b, &[6, 4, length(events.len())]);
    b.extend(events.iter().flat_map(|event| {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&(event.t + start_us).to_le_bytes());
        bytes[8..10].copy_from_slice(&event.x.to_le_bytes());
        bytes[10..12].copy_from_slice(&event.y.to_le_bytes());
        bytes[12] = event.p;
        bytes
    }));
    let size = length(b.len() - 4);
    b[..4].copy_from_slice(&size.to_le_bytes());
}

/// Returns `FTAB`: a vector of tables, one a packet: offset (i64), stream and size (struct of two i32), number of
/// events, time of the first and of the last (i64).
pub(super) fn table(entries: &[Entry]) -> Vec<u8> {
    let mut b = start(*b"FTAB", 20);
    words16(&mut b, &[6, 8, 4, 0]);
    words32(&mut b, &[8, 4, length(entries.len())]);
    // One vtable for all, behind the vector; then the entries, their i64 aligned.
    let vtable = b.len() + 4 * entries.len();
    let first = (vtable + 14).next_multiple_of(8) + 4;
    for (i, offset) in (b.len()..vtable).step_by(4).enumerate() {
        words32(&mut b, &[length(first + ENTRY * i - offset)]);
    }
    words16(&mut b, &[14, 44, 12, 4, 20, 28, 36]);
    b.resize(first, 0);
    for entry in entries {
        let distance = length(b.len() - vtable);
        words32(&mut b, &[distance, 0, entry.size]);
        for value in [entry.offset.cast_signed(), length(entry.events).into(), entry.first_us, entry.last_us] {
            b.extend_from_slice(&value.to_le_bytes());
        }
        words32(&mut b, &[0]);
    }
    finish(b)
}

/// Returns size (not known yet), offset of the root table, identifier.
fn start(identifier: [u8; 4], root: usize) -> Vec<u8> {
    let mut b = vec![0; 4];
    words32(&mut b, &[length(root - 4)]);
    b.extend_from_slice(&identifier);
    b
}

/// Pads, and puts the size in.
fn finish(mut b: Vec<u8>) -> Vec<u8> {
    b.resize(b.len().next_multiple_of(8), 0);
    let size = length(b.len() - 4);
    b[..4].copy_from_slice(&size.to_le_bytes());
    b
}

fn words16(b: &mut Vec<u8>, words: &[u16]) {
    b.extend(words.iter().flat_map(|word| word.to_le_bytes()));
}

fn words32(b: &mut Vec<u8>, words: &[i32]) {
    b.extend(words.iter().flat_map(|word| word.to_le_bytes()));
}

fn length(n: usize) -> i32 {
    i32::try_from(n).expect("flatbuffers are smaller than 2 GB")
}
