//! Events as images, the hot part of it: counts, last times and voxel grids.
//!
//! Each is one pass over the events, without threads, so that the same events give the same bits everywhere. Which
//! image is made of them is decided in Python (`davis_rs.represent`).

mod counts;
mod latest;
mod voxel;

pub use counts::count_events;
pub use latest::latest_times;
pub use voxel::{TimeBins, voxel_grid};

use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// The refusal of an event that has no pixel, or no polarity.
#[cold]
fn misplaced(index: usize, event: &Event, size: SensorSize) -> Error {
    Error::Argument(if event.p > 1 {
        format!("polarity must be 0 or 1: event {index} has {}", event.p)
    } else {
        format!(
            "events must lie on the {} x {} sensor: event {index} is at ({}, {})",
            size.width, size.height, event.x, event.y
        )
    })
}

/// The row-major index of an event in two planes, OFF before ON.
#[inline]
fn cell(index: usize, event: &Event, size: SensorSize) -> Result<usize> {
    if event.x < size.width && event.y < size.height && event.p <= 1 {
        Ok(usize::from(event.p) * size.pixels() + event.pixel(size))
    } else {
        Err(misplaced(index, event, size))
    }
}
