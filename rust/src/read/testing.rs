//! What the decoders' tests share.

use std::io::{Cursor, Read};

use proptest::prelude::*;

use super::reader::{Decode, EventReader};
use crate::error::Result;
use crate::event::Event;
use crate::write::{Aedat4Encoder, EventWriter};

pub(super) fn read(bytes: &[u8], decoder: impl Decode + 'static) -> Result<Vec<Event>> {
    let mut events = Vec::new();
    EventReader::new(bytes, decoder).read(usize::MAX, &mut events)?;
    Ok(events)
}

/// A source that gives its bytes in two parts, cut anywhere, gives the same events.
pub(super) fn any_split_decodes_alike<D: Decode + 'static>(
    bytes: &[u8],
    cut: usize,
    decoder: impl Fn() -> D,
    expected: &[Event],
) -> std::result::Result<(), TestCaseError> {
    let (a, b) = bytes.split_at(cut.min(bytes.len()));
    let mut events = Vec::new();
    EventReader::new(a.chain(b), decoder()).read(usize::MAX, &mut events)?;
    prop_assert_eq!(events, expected);
    Ok(())
}

/// A file of AEDAT 4.0 with a table of contents, whose packets have so many events each.
pub(super) fn aedat4_file(events: &[Event], encoder: Aedat4Encoder, packet: usize) -> Vec<u8> {
    let mut writer = EventWriter::new(Cursor::new(Vec::new()), encoder).unwrap();
    for packet in events.chunks(packet) {
        writer.write(packet).unwrap();
    }
    writer.finish_with_contents().unwrap().into_inner()
}
