//! What the decoders' tests share.

use std::io::Read;

use proptest::prelude::*;

use super::reader::{Decode, EventReader};
use crate::error::Result;
use crate::event::Event;

pub(super) fn read(bytes: &[u8], decoder: impl Decode + 'static) -> Result<Vec<Event>> {
    let mut events = Vec::new();
    EventReader::new(bytes, decoder).read(usize::MAX, &mut events)?;
    Ok(events)
}

/// Returns a source that gives its bytes in two parts, cut anywhere, gives the same events.
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
