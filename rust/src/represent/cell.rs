//! Where an event belongs in planes by polarity and pixel, and the refusal of one that belongs nowhere.

use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// Returns the refusal of an event that has no pixel, or no polarity.
#[cold]
pub(super) fn misplaced(index: usize, event: &Event, size: SensorSize) -> Error {
    Error::Argument(if event.p > 1 {
        format!("polarity must be 0 or 1: event {index} has {}", event.p)
    } else {
        format!(
            "events must lie on the {} x {} sensor: event {index} is at ({}, {})",
            size.width, size.height, event.x, event.y
        )
    })
}

/// Returns the row-major index of an event in two planes, OFF before ON.
#[inline]
pub(super) fn cell(index: usize, event: &Event, size: SensorSize) -> Result<usize> {
    if event.x < size.width && event.y < size.height && event.p <= 1 {
        Ok(usize::from(event.p) * size.pixels() + event.pixel(size))
    } else {
        Err(misplaced(index, event, size))
    }
}
